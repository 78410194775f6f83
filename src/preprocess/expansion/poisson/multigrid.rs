//! Smoothed aggregation: Vanek, Mandel, Brezina: "Algebraic Multigrid by Smoothed Aggregation for Second and Fourth
//! Order Elliptic Problems", 1996. One V-cycle of it preconditions the conjugate gradient, which then takes about as
//! many iterations on a large hole as on a small one; with the diagonal alone they grow with the hole's width.

use super::sparse::{Channels, Sparse, dot, update};

/// A symmetric positive definite matrix.
pub(super) struct Matrix {
    pub(super) off_diagonal: Sparse,
    pub(super) diagonal: Vec<f64>,
}

impl Matrix {
    pub(super) fn rows(&self) -> usize {
        self.diagonal.len()
    }

    /// (`b` - A `x`) of one row.
    pub(super) fn residual<const C: usize>(&self, row: usize, b: &[[f64; C]], x: &[[f64; C]]) -> [f64; C] {
        let others = self.off_diagonal.times(row, x);
        std::array::from_fn(|c| b[row][c] - self.diagonal[row] * x[row][c] - others[c])
    }

    /// About the largest eigenvalue of D^-1 A, rather too large than too small: by power iteration, with a tenth on top
    /// for what that has not reached, but no more than Gershgorin's bound.
    fn largest_eigenvalue(&self) -> f64 {
        let row = |row| {
            let others: f64 = self.off_diagonal.entries(row).map(|(_, value)| value.abs()).sum();
            1.0 + others / self.diagonal[row]
        };
        let bound = (0..self.rows()).map(row).fold(1.0, f64::max);
        // Any vector with a bit of everything in it.
        let mut x: Channels<1> =
            (0..self.rows() as u32).map(|row| [f64::from(row.wrapping_mul(HASH) as i32)]).collect();
        let mut image = x.clone();
        let mut estimate = 1.0;
        for _ in 0..POWER_ITERATIONS {
            let size = dot(&x, &x)[0].sqrt();
            update(
                &mut image,
                |row, _| [(x[row][0] + self.off_diagonal.times(row, &x)[0] / self.diagonal[row]) / size],
            );
            std::mem::swap(&mut x, &mut image);
            estimate = dot(&x, &x)[0].sqrt();
        }
        // A matrix without rows has nothing to estimate.
        if estimate > 0.0 { bound.min(1.1 * estimate) } else { bound }
    }
}

/// An odd number with its bits well mixed (Knuth's multiplicative hash).
const HASH: u32 = 2_654_435_761;
const POWER_ITERATIONS: usize = 8;
/// Rows of a matrix that is small enough for a dense factorisation.
const DENSE: usize = 128;
/// Relaxation in units of the inverse eigenvalue: so far below 2 that the cycle stays positive definite even where the
/// eigenvalue is a quarter larger than estimated.
const RELAXATION: f64 = 1.5;
/// Vanek's choice for the prolongation, in the same units.
const SMOOTHING: f64 = 4.0 / 3.0;

/// The finest matrix and its ever coarser images.
pub(super) struct Multigrid {
    levels: Vec<Level>,
    dense: Cholesky,
}

struct Level {
    matrix: Matrix,
    /// Relaxation factor over the diagonal.
    relaxation: Vec<f64>,
    prolongation: Sparse,
    restriction: Sparse,
}

/// Vectors of one level of a cycle.
#[derive(Default)]
pub(super) struct Work<const C: usize> {
    right: Channels<C>,
    solution: Channels<C>,
    scratch: Channels<C>,
}

impl Multigrid {
    pub(super) fn new(finest: Matrix) -> Self {
        let mut levels = Vec::new();
        let mut matrix = finest;
        // The finest matrix is always a level, because the solver needs it; each next one has at most half of the rows.
        while levels.is_empty() || matrix.rows() > DENSE {
            let largest = matrix.largest_eigenvalue();
            let (aggregates, count) = aggregate(&matrix.off_diagonal);
            let prolongation = smoothed(&matrix, &aggregates, SMOOTHING / largest);
            let restriction = prolongation.transposed(count);
            let coarse = galerkin(&matrix, &prolongation, &restriction);
            let relaxation = matrix.diagonal.iter().map(|diagonal| RELAXATION / largest / diagonal).collect();
            levels.push(Level { matrix, relaxation, prolongation, restriction });
            matrix = coarse;
        }
        Self { levels, dense: Cholesky::new(&matrix) }
    }

    pub(super) fn finest(&self) -> &Matrix {
        &self.levels[0].matrix
    }

    /// Room for [`Self::precondition`].
    pub(super) fn work<const C: usize>(&self) -> Vec<Work<C>> {
        let rows = self.levels.iter().map(|level| level.matrix.rows()).chain([self.dense.rows]);
        rows.enumerate()
            .map(|(depth, rows)| {
                // The finest level's right-hand side and solution are the caller's.
                let own = if depth == 0 { 0 } else { rows };
                Work { right: vec![[0.0; C]; own], solution: vec![[0.0; C]; own], scratch: vec![[0.0; C]; rows] }
            })
            .collect()
    }

    /// `z` = M^-1 `r` with M^-1 near A^-1, symmetric and positive definite.
    pub(super) fn precondition<const C: usize>(&self, r: &[[f64; C]], z: &mut Channels<C>, work: &mut [Work<C>]) {
        self.cycle(0, r, z, work);
    }

    fn cycle<const C: usize>(&self, depth: usize, r: &[[f64; C]], z: &mut Channels<C>, work: &mut [Work<C>]) {
        let (Some(level), Some((here, below))) = (self.levels.get(depth), work.split_first_mut()) else {
            return self.dense.solve(r, z);
        };
        let (matrix, relaxation) = (&level.matrix, &level.relaxation);
        // Relaxed from zero.
        update(z, |row, _| r[row].map(|r| relaxation[row] * r));
        if let Some(next) = below.first_mut() {
            update(&mut here.scratch, |row, _| matrix.residual(row, r, z));
            let (mut right, mut solution) = (std::mem::take(&mut next.right), std::mem::take(&mut next.solution));
            update(&mut right, |row, _| level.restriction.times(row, &here.scratch));
            self.cycle(depth + 1, &right, &mut solution, below);
            update(z, |row, z| {
                let more = level.prolongation.times(row, &solution);
                std::array::from_fn(|c| z[c] + more[c])
            });
            (below[0].right, below[0].solution) = (right, solution);
        }
        update(&mut here.scratch, |row, _| {
            let residual = matrix.residual(row, r, z);
            std::array::from_fn(|c| z[row][c] + relaxation[row] * residual[c])
        });
        std::mem::swap(z, &mut here.scratch);
    }
}

/// A row that is in no aggregate.
const NONE: u32 = u32::MAX;

/// The aggregate of each row, and how many there are: a row with all its neighbours where none of them is taken yet,
/// then the rest each with a neighbour. Rows without neighbours are in none; relaxation alone solves them.
fn aggregate(graph: &Sparse) -> (Vec<u32>, usize) {
    let mut aggregates = vec![NONE; graph.rows()];
    let mut count = 0;
    for row in 0..graph.rows() {
        let around = graph.columns_of(row);
        let free = aggregates[row] == NONE && around.iter().all(|&other| aggregates[other as usize] == NONE);
        if free && !around.is_empty() {
            aggregates[row] = count;
            around.iter().for_each(|&other| aggregates[other as usize] = count);
            count += 1;
        }
    }
    let seeds = aggregates.clone();
    for row in 0..graph.rows() {
        if seeds[row] == NONE {
            let neighbour = graph.columns_of(row).iter().map(|&other| seeds[other as usize]).find(|&seed| seed != NONE);
            aggregates[row] = neighbour.unwrap_or(NONE);
        }
    }
    (aggregates, count as usize)
}

/// The prolongation that is constant on each aggregate, after one step of relaxation: (1 - `factor` D^-1 A) P.
fn smoothed(matrix: &Matrix, aggregates: &[u32], factor: f64) -> Sparse {
    Sparse::from_rows(matrix.rows(), |row, sum| {
        if aggregates[row] == NONE {
            return;
        }
        sum.add(aggregates[row] as usize, 1.0 - factor);
        for (column, value) in matrix.off_diagonal.entries(row) {
            sum.add(aggregates[column] as usize, -factor * value / matrix.diagonal[row]);
        }
    })
}

/// P^T A P.
fn galerkin(matrix: &Matrix, prolongation: &Sparse, restriction: &Sparse) -> Matrix {
    let product = Sparse::from_rows(matrix.rows(), |row, sum| {
        for (column, value) in matrix.off_diagonal.entries(row).chain([(row, matrix.diagonal[row])]) {
            prolongation.entries(column).for_each(|(coarse, factor)| sum.add(coarse, value * factor));
        }
    });
    let whole = Sparse::from_rows(restriction.rows(), |row, sum| {
        for (fine, factor) in restriction.entries(row) {
            product.entries(fine).for_each(|(column, value)| sum.add(column, factor * value));
        }
    });
    let diagonal = (0..whole.rows()).map(|row| whole.entries(row).find(|e| e.0 == row).map_or(1.0, |e| e.1)).collect();
    let off_diagonal = Sparse::from_rows(whole.rows(), |row, sum| {
        whole.entries(row).filter(|e| e.0 != row).for_each(|(column, value)| sum.add(column, value));
    });
    Matrix { off_diagonal, diagonal }
}

/// L L^T = A of a small matrix, row by row.
struct Cholesky {
    rows: usize,
    lower: Vec<f64>,
}

impl Cholesky {
    fn new(matrix: &Matrix) -> Self {
        let rows = matrix.rows();
        let mut lower = vec![0.0; rows * rows];
        for row in 0..rows {
            matrix.off_diagonal.entries(row).for_each(|(column, value)| lower[row * rows + column] = value);
            lower[row * rows + row] = matrix.diagonal[row];
            for column in 0..=row {
                let known: f64 = (0..column).map(|k| lower[row * rows + k] * lower[column * rows + k]).sum();
                let rest = lower[row * rows + column] - known;
                lower[row * rows + column] = if column < row {
                    rest / lower[column * rows + column]
                } else {
                    // Rounding may eat the whole of a pivot; some positive number keeps the cycle positive definite.
                    rest.max(1e-14 * matrix.diagonal[row]).sqrt()
                };
            }
        }
        Self { rows, lower }
    }

    fn solve<const C: usize>(&self, r: &[[f64; C]], z: &mut [[f64; C]]) {
        let at = |row: usize, column: usize| self.lower[row * self.rows + column];
        for row in 0..self.rows {
            z[row] = std::array::from_fn(|c| {
                let known: f64 = (0..row).map(|k| at(row, k) * z[k][c]).sum();
                (r[row][c] - known) / at(row, row)
            });
        }
        for row in (0..self.rows).rev() {
            z[row] = std::array::from_fn(|c| {
                let known: f64 = (row + 1..self.rows).map(|k| at(k, row) * z[k][c]).sum();
                (z[row][c] - known) / at(row, row)
            });
        }
    }
}
