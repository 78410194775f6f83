//! Eq. 2 as a symmetric matrix, and its connected parts.

use super::multigrid::Matrix;
use super::neighbours::Row;
use super::sparse::{Channels, Sparse};

/// The equations of all sites.
pub(super) struct System<const C: usize> {
    pub(super) matrix: Matrix,
    pub(super) right: Channels<C>,
    /// For each site the mean of the known values around its component, to start from; zero where there are none.
    pub(super) start: Channels<C>,
    /// Whether a site's component has no known neighbour at all.
    pub(super) stranded: Vec<bool>,
    /// Number of components.
    pub(super) components: usize,
}

impl<const C: usize> System<C> {
    pub(super) fn new(rows: Vec<Row<C>>) -> Self {
        let off_diagonal = symmetric(&rows);
        let known: Vec<u32> = rows.iter().map(|row| row.known).collect();
        let right: Channels<C> = rows.into_iter().map(|row| row.sum).collect();
        let mut system = Self {
            matrix: Matrix { diagonal: Vec::new(), off_diagonal },
            start: vec![[0.0; C]; right.len()],
            right,
            stranded: vec![false; known.len()],
            components: 0,
        };
        system.find_components(&known);
        let graph = &system.matrix.off_diagonal;
        system.matrix.diagonal = (0..known.len())
            .map(|site| {
                // |N_p| of Sabbadin 2019, Eq. 2. Where nothing is known the equations are singular; a tie to zero makes
                // zero, which is the rule there, their only solution.
                let ties = if system.stranded[site] { 1 } else { known[site] as usize };
                (graph.columns_of(site).len() + ties) as f64
            })
            .collect();
        system
    }

    fn find_components(&mut self, known: &[u32]) {
        let graph = &self.matrix.off_diagonal;
        let mut seen = vec![false; known.len()];
        let mut component: Vec<u32> = Vec::new();
        for first in 0..known.len() {
            if seen[first] {
                continue;
            }
            seen[first] = true;
            component.push(first as u32);
            let mut at = 0;
            let (mut count, mut sum) = (0.0, [0.0; C]);
            while let Some(&site) = component.get(at) {
                at += 1;
                count += f64::from(known[site as usize]);
                sum = std::array::from_fn(|c| sum[c] + self.right[site as usize][c]);
                for &other in graph.columns_of(site as usize) {
                    if !std::mem::replace(&mut seen[other as usize], true) {
                        component.push(other);
                    }
                }
            }
            for site in component.drain(..) {
                self.stranded[site as usize] = count == 0.0;
                if count > 0.0 {
                    self.start[site as usize] = sum.map(|sum| sum / count);
                }
            }
            self.components += 1;
        }
    }
}

/// The graph among the unknowns, each edge in both its rows.
///
/// Deviation from Sabbadin 2019, Eq. 2: p may be among the nearest of q without q being among the nearest of p, and the
/// paper's matrix is then not symmetric. Here either makes them neighbours of each other, so that the matrix is positive
/// definite; the equation's meaning, that gradients are the LDR ones, is the same.
fn symmetric<const C: usize>(rows: &[Row<C>]) -> Sparse {
    let mut starts = vec![0; rows.len() + 1];
    for (site, row) in rows.iter().enumerate() {
        starts[site + 1] += row.unknown.len();
        row.unknown.iter().for_each(|&other| starts[other as usize + 1] += 1);
    }
    (0..rows.len()).for_each(|site| starts[site + 1] += starts[site]);
    let mut next = starts.clone();
    let mut columns = vec![0u32; starts[rows.len()]];
    let mut put = |row: usize, column: u32| {
        columns[next[row]] = column;
        next[row] += 1;
    };
    for (site, row) in rows.iter().enumerate() {
        for &other in &row.unknown {
            put(site, other);
            put(other as usize, site as u32);
        }
    }
    // Edges that were there in both directions are there twice.
    let mut kept = 0;
    let mut begin = 0;
    for site in 0..rows.len() {
        let end = starts[site + 1];
        columns[begin..end].sort_unstable();
        starts[site] = kept;
        for at in begin..end {
            if at == begin || columns[at] != columns[kept - 1] {
                columns[kept] = columns[at];
                kept += 1;
            }
        }
        begin = end;
    }
    starts[rows.len()] = kept;
    columns.truncate(kept);
    columns.shrink_to_fit();
    Sparse { starts, columns, values: Vec::new() }
}
