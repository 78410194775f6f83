//! The preconditioned conjugate gradient: Hestenes and Stiefel: "Methods of Conjugate Gradients for Solving Linear
//! Systems", 1952.

use super::multigrid::Multigrid;
use super::sparse::{Channels, dot, update};

/// Relative residual at which a channel is done; far below the 1e-6 that is asked for, because the error of a large
/// hole may be a hundred times its residual.
const TOLERANCE: f64 = 1e-8;
/// Iterations after which rounding, not the distance to the solution, is in the way.
const MOST_ITERATIONS: usize = 200;

/// How well a system is solved.
pub(super) struct Solved {
    pub(super) iterations: usize,
    /// |b - A x| / |b| of the worst channel.
    pub(super) residual: f64,
}

/// Solves A `x` = `b` from the `x` that is given, each channel by itself; `progress` hears from 0 to 1.
pub(super) fn solve<const C: usize>(
    multigrid: &Multigrid,
    b: &[[f64; C]],
    x: &mut Channels<C>,
    progress: &dyn Fn(f32),
) -> Solved {
    let matrix = multigrid.finest();
    let norms = dot(b, b).map(f64::sqrt);
    let worst = |squares: [f64; C]| {
        (0..C).filter(|&c| norms[c] > 0.0).map(|c| squares[c].sqrt() / norms[c]).fold(0.0, f64::max)
    };
    let mut r = vec![[0.0; C]; b.len()];
    update(&mut r, |row, _| matrix.residual(row, b, x));
    let mut z = vec![[0.0; C]; b.len()];
    let mut direction = z.clone();
    let mut image = z.clone();
    let mut work = multigrid.work();
    let mut last = [0.0; C];
    let mut iterations = 0;
    let mut squares = dot(&r, &r);
    while worst(squares) > TOLERANCE && iterations < MOST_ITERATIONS {
        multigrid.precondition(&r, &mut z, &mut work);
        let product = dot(&r, &z);
        // A channel that is done stands still.
        let moves: [bool; C] = std::array::from_fn(|c| squares[c].sqrt() > TOLERANCE * norms[c] && product[c] > 0.0);
        let beta: [f64; C] = std::array::from_fn(|c| if last[c] > 0.0 { product[c] / last[c] } else { 0.0 });
        update(&mut direction, |row, old| std::array::from_fn(|c| z[row][c] + beta[c] * old[c]));
        update(&mut image, |row, _| {
            let others = matrix.off_diagonal.times(row, &direction);
            std::array::from_fn(|c| matrix.diagonal[row] * direction[row][c] + others[c])
        });
        let curvature = dot(&direction, &image);
        let alpha: [f64; C] =
            std::array::from_fn(|c| if moves[c] && curvature[c] > 0.0 { product[c] / curvature[c] } else { 0.0 });
        update(x, |row, x| std::array::from_fn(|c| x[c] + alpha[c] * direction[row][c]));
        update(&mut r, |row, r| std::array::from_fn(|c| r[c] - alpha[c] * image[row][c]));
        last = product;
        squares = dot(&r, &r);
        iterations += 1;
        progress((worst(squares).max(TOLERANCE).ln() / TOLERANCE.ln()).clamp(0.0, 1.0) as f32);
        if alpha == [0.0; C] {
            break;
        }
    }
    update(&mut r, |row, _| matrix.residual(row, b, x));
    Solved { iterations, residual: worst(dot(&r, &r)) }
}
