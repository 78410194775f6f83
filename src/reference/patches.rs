//! What a match of PatchMatch costs, straight from its definition (Sabbadin 2019, 4.1): texel by texel and level by
//! level, in double precision, without an end before the last of them.

use glam::{DVec2, IVec2, UVec2, Vec2};

use crate::preprocess::expansion::patchmatch::{Match, RADIUS, SIDE};
use crate::preprocess::expansion::pyramid::{Level, MARGIN, Pyramid};

/// What a level counts for against the next finer one.
const CONTEXT: f64 = 0.7;

/// Colour and validity between four texels; beyond the margin its edge is repeated. Texel (0, 0) has its centre at
/// (0, 0).
fn bilinear(level: &Level, at: DVec2) -> [f64; 4] {
    let margin = IVec2::splat(MARGIN as i32);
    let last = UVec2::new(level.width, level.height).as_ivec2() - 1 + margin;
    let texel = |x: i32, y: i32| {
        let inside = IVec2::new(x, y).clamp(-margin, last);
        level.texel(inside.x, inside.y).to_array().map(f64::from)
    };
    let (low, part) = (at.floor().as_ivec2(), at - at.floor());
    let mut sum = [0.0; 4];
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let weight_x = if dx == 0 { 1.0 - part.x } else { part.x };
        let weight_y = if dy == 0 { 1.0 - part.y } else { part.y };
        for (sum, value) in sum.iter_mut().zip(texel(low.x + dx, low.y + dy)) {
            *sum += weight_x * weight_y * value;
        }
    }
    sum
}

/// The cost of taking `pixel` of the first image's finest level for `found` in the second's, by
/// [`Measure::Difference`](crate::preprocess::expansion::patchmatch::Measure::Difference).
pub fn difference(first: &Pyramid, second: &Pyramid, pixel: UVec2, found: &Match) -> f64 {
    let step = (Vec2::from_angle(found.angle) * found.log_scale.exp2()).as_dvec2();
    let (mut sum, mut weight) = (0.0, 0.0);
    for (index, (first, second)) in first.levels.iter().zip(&second.levels).enumerate() {
        let shrink = f64::from(1_u32 << index);
        let share = CONTEXT.powi(index as i32);
        // Both places in texels of this level, whose corners lie on whole numbers.
        let here = (pixel.as_dvec2() + 0.5) / shrink;
        let there = (found.at.as_dvec2() + 0.5) / shrink;
        let middle = here.floor().as_ivec2();
        for dy in -RADIUS..=RADIUS {
            for dx in -RADIUS..=RADIUS {
                let texel = middle + IVec2::new(dx, dy);
                let of_first = first.texel(texel.x, texel.y).to_array().map(f64::from);
                let off = texel.as_dvec2() + 0.5 - here;
                let of_second = bilinear(second, there + step.rotate(off) - 0.5);
                let squares: f64 = (0..3).map(|channel| (of_first[channel] - of_second[channel]).powi(2)).sum();
                sum += share * of_first[3] * squares;
                weight += share * of_first[3];
            }
        }
    }
    // The mean over channels and texels, for as many texels as a patch has.
    sum / (3.0 * weight) * (SIDE * SIDE) as f64
}
