//! Lat-long panoramas of another size with the same light in them.

use std::f64::consts::PI;

use glam::Vec3;
use rayon::prelude::*;

use crate::scene::FarField;

/// Part of a source texel in a texel of the result.
#[derive(Clone, Copy)]
struct Tap {
    from: usize,
    weight: f32,
}

/// `panorama` with `width * height` texels. Each is the mean over its solid angle: of the texels below it where there
/// are fewer, of the line between them where there are more. So a sun keeps its radiance times solid angle; only
/// where rows are added it may spread over a pole, where the texels that it spreads to are larger.
pub(super) fn resample(panorama: FarField, width: u32, height: u32) -> FarField {
    if (panorama.width, panorama.height) == (width, height) {
        return panorama;
    }
    let columns = axis(panorama.width, width, |start, end| end - start, |at, side| at.rem_euclid(side));
    // What a part of a row holds of the sphere: Archimedes.
    let band = |top: f64, bottom: f64| (PI * top).cos() - (PI * bottom).cos();
    let rows = axis(panorama.height, height, band, |at, side| at.clamp(0, side - 1));
    let from_width = panorama.width as usize;
    // Rows first: what is added up is then in order in memory.
    let mut radiance = vec![Vec3::ZERO; width as usize * height as usize];
    radiance.par_chunks_mut(width as usize).zip(&rows).for_each(|(result, taps)| {
        let mut row = vec![Vec3::ZERO; from_width];
        for tap in taps {
            let source = &panorama.radiance[tap.from * from_width..][..from_width];
            row.iter_mut().zip(source).for_each(|(sum, &value)| *sum += tap.weight * value);
        }
        for (texel, taps) in result.iter_mut().zip(&columns) {
            *texel = taps.iter().map(|tap| tap.weight * row[tap.from]).sum();
        }
    });
    FarField { width, height, radiance }
}

/// For each of `to` texels along an axis, which of `from` make it up; weights add up to 1. `measure` is how much of the
/// sphere lies between two places from 0 to 1, times any constant; `wrap` brings a texel beyond the ends back inside.
fn axis(from: u32, to: u32, measure: impl Fn(f64, f64) -> f64, wrap: impl Fn(i64, i64) -> i64) -> Vec<Vec<Tap>> {
    // Parts of a new texel over which the line between old ones is averaged.
    const PARTS: u32 = 16;
    let (side, ratio) = (i64::from(from), f64::from(from) / f64::from(to));
    let taps = |texel: u32| {
        let (start, end) = (f64::from(texel) * ratio, f64::from(texel + 1) * ratio);
        let mut taps: Vec<(i64, f64)> = Vec::new();
        let of = |start: f64, end: f64| measure(start / f64::from(from), end / f64::from(from));
        if from == to {
            taps.push((i64::from(texel), 1.0));
        } else if from > to {
            for source in start as i64..side.min(end.ceil() as i64) {
                taps.push((source, of(start.max(source as f64), end.min(source as f64 + 1.0))));
            }
        } else {
            for part in 0..PARTS {
                let edge = |part: u32| start + (end - start) * f64::from(part) / f64::from(PARTS);
                let (weight, centre) = (of(edge(part), edge(part + 1)), (edge(part) + edge(part + 1)) / 2.0 - 0.5);
                let (left, right) = (centre.floor(), centre - centre.floor());
                taps.push((wrap(left as i64, side), weight * (1.0 - right)));
                taps.push((wrap(left as i64 + 1, side), weight * right));
            }
        }
        merge(taps)
    };
    (0..to).map(taps).collect()
}

/// One tap a source, in order, with weights that add up to 1.
fn merge(mut taps: Vec<(i64, f64)>) -> Vec<Tap> {
    taps.sort_unstable_by_key(|tap| tap.0);
    taps.dedup_by(|next, kept| {
        let same = next.0 == kept.0;
        if same {
            kept.1 += next.1;
        }
        same
    });
    let total: f64 = taps.iter().map(|tap| tap.1).sum();
    taps.into_iter().map(|(from, weight)| Tap { from: from as usize, weight: (weight / total) as f32 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Radiance times solid angle, added up.
    fn energy(panorama: &FarField) -> f64 {
        let (width, height) = (panorama.width as usize, f64::from(panorama.height));
        let rows = panorama.radiance.chunks_exact(width).enumerate();
        rows.map(|(row, texels)| {
            let band = (PI * row as f64 / height).cos() - (PI * (row + 1) as f64 / height).cos();
            let sum: f64 = texels.iter().map(|texel| f64::from(texel.x)).sum();
            sum * band * 2.0 * PI / width as f64
        })
        .sum()
    }

    #[test]
    fn a_sun_keeps_its_energy_at_any_size() {
        // One texel of 60x30, in a middle row, at the seam, and at the pole, which is the worst.
        for (row, column, bound) in [(12, 20, 0.004), (20, 59, 0.004), (0, 5, 0.3)] {
            let mut sun = FarField { width: 60, height: 30, radiance: vec![Vec3::ZERO; 1800] };
            sun.radiance[row * 60 + column] = Vec3::splat(1e4);
            let truth = energy(&sun);
            for (width, height) in [(20, 10), (32, 16), (59, 30), (14, 7), (2, 1), (1, 1)] {
                let error = (energy(&resample(sun.clone(), width, height)) / truth - 1.0).abs();
                assert!(error < 1e-5, "{width}x{height}: {error} of the sun in row {row} lost");
            }
            for (width, height) in [(120, 60), (90, 45), (61, 31), (60, 77)] {
                let error = (energy(&resample(sun.clone(), width, height)) / truth - 1.0).abs();
                assert!(error < bound, "{width}x{height}: {error} of the sun in row {row} lost");
            }
        }
    }

    #[test]
    fn an_even_sky_stays_even_and_the_same_size_stays_the_same() {
        let even = FarField { width: 6, height: 3, radiance: vec![Vec3::new(1.0, 2.0, 0.5); 18] };
        for (width, height) in [(6, 3), (4, 2), (13, 8), (1, 1)] {
            for texel in resample(even.clone(), width, height).radiance {
                assert!((texel - even.radiance[0]).abs().max_element() < 1e-6, "{width}x{height}: {texel}");
            }
        }
        let ramp = FarField { radiance: (0..18).map(|i| Vec3::splat(i as f32)).collect(), ..even };
        assert_eq!(resample(ramp.clone(), 6, 3), ramp);
    }

    #[test]
    fn texels_stay_where_they_were() {
        // A row's halves: the seam of the result lies between the texels that it lay between before.
        let halves = FarField { width: 4, height: 1, radiance: [1.0, 1.0, 0.0, 0.0].map(Vec3::splat).to_vec() };
        let wide: Vec<f32> = resample(halves.clone(), 8, 1).radiance.iter().map(|texel| texel.x).collect();
        assert!(wide[2] == 1.0 && wide[6] == 0.0, "{wide:?}");
        assert!((wide[0] + wide[7] - 1.0).abs() < 1e-6 && (wide[3] + wide[4] - 1.0).abs() < 1e-6, "{wide:?}");
        assert_eq!(resample(halves, 2, 1).radiance, [Vec3::ONE, Vec3::ZERO]);
    }
}
