//! Eq. 2 as a symmetric matrix, and its connected parts.

use super::multigrid::Matrix;
use super::neighbours::Rows;
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
    pub(super) fn new(rows: Rows<C>) -> Self {
        let off_diagonal = symmetric(&rows);
        let known: Vec<u32> = rows.ends.iter().map(|end| end.known).collect();
        let right: Channels<C> = rows.ends.iter().map(|end| end.sum).collect();
        drop(rows);
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
fn symmetric<const C: usize>(rows: &Rows<C>) -> Sparse {
    // Calls `f` with both ends of every edge that only the first one's row has.
    let one_sided = |f: &mut dyn FnMut(u32, u32)| {
        for site in 0..rows.len() {
            let here = site as u32;
            for &other in rows.unknown(site).iter().filter(|&&other| !rows.unknown(other as usize).contains(&here)) {
                f(here, other);
            }
        }
    };
    let mut starts = vec![0; rows.len() + 1];
    one_sided(&mut |_, other| starts[other as usize + 1] += 1);
    for site in 0..rows.len() {
        starts[site + 1] += starts[site] + rows.unknown(site).len();
    }
    let mut columns = vec![0; starts[rows.len()]];
    let mut next = starts.clone();
    for (site, next) in next[..rows.len()].iter_mut().enumerate() {
        let own = rows.unknown(site);
        columns[*next..*next + own.len()].copy_from_slice(own);
        *next += own.len();
    }
    one_sided(&mut |site, other| {
        columns[next[other as usize]] = site;
        next[other as usize] += 1;
    });
    Sparse { starts, columns, values: Vec::new() }
}
