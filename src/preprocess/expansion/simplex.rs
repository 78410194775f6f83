//! Downhill simplex search (Nelder and Mead 1965, "A Simplex Method for Function Minimization").

/// Looks for a minimum of `cost` near `start`, whose neighbours along the axes, a step away, make the first simplex;
/// `rounds` times the worst corner is replaced. Returns the best corner and its cost.
pub(super) fn minimise<const N: usize>(
    start: [f32; N],
    steps: [f32; N],
    rounds: u32,
    cost: impl Fn(&[f32; N]) -> f32,
) -> (f32, [f32; N]) {
    let evaluate = |place: [f32; N]| (cost(&place), place);
    let mut corners = vec![evaluate(start)];
    for axis in 0..N {
        let mut place = start;
        place[axis] += steps[axis];
        corners.push(evaluate(place));
    }
    for _ in 0..rounds {
        corners.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (best, second, worst) = (corners[0], corners[N - 1].0, corners[N]);
        let middle: [f32; N] =
            std::array::from_fn(|axis| corners[..N].iter().map(|(_, place)| place[axis]).sum::<f32>() / N as f32);
        // From the middle of the others, 0, towards the worst, 1.
        let along =
            |share: f32| evaluate(std::array::from_fn(|axis| middle[axis] + share * (worst.1[axis] - middle[axis])));
        let reflected = along(-1.0);
        let replacement = if reflected.0 < best.0 {
            let expanded = along(-2.0);
            Some(if expanded.0 < reflected.0 { expanded } else { reflected })
        } else if reflected.0 < second {
            Some(reflected)
        } else {
            let contracted = along(if reflected.0 < worst.0 { -0.5 } else { 0.5 });
            (contracted.0 < worst.0.min(reflected.0)).then_some(contracted)
        };
        match replacement {
            Some(corner) => corners[N] = corner,
            None => {
                for corner in &mut corners[1..] {
                    *corner = evaluate(std::array::from_fn(|axis| 0.5 * (corner.1[axis] + best.1[axis])));
                }
            }
        }
    }
    corners.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f32::INFINITY, start))
}

#[cfg(test)]
mod tests {
    use super::minimise;

    #[test]
    fn the_bottom_of_a_bowl_is_found() {
        let bowl = |p: &[f32; 3]| (p[0] - 1.0).powi(2) + 4.0 * (p[1] + 2.0).powi(2) + (p[2] - p[0]).powi(2);
        let (cost, place) = minimise([0.0; 3], [0.5; 3], 120, bowl);
        assert!(cost < 1e-6, "{cost} at {place:?}");
        assert!((place[0] - 1.0).abs() < 1e-2 && (place[1] + 2.0).abs() < 1e-2, "{place:?}");
    }
}
