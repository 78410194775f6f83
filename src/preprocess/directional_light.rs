//! From which directions light comes to a place in a scan: what weighs the cones of the contact shadow.

use glam::Vec3;
use rayon::prelude::*;

use super::point_chunks::PointChunks;
use crate::formats::color::unpack_rgb9e5;
use crate::scene::FarField;

/// Directions that are looked into.
pub const DIRECTIONS: usize = 32;
/// Cosine of the angle around a direction within which light is counted.
const WIDTH: f32 = 0.9;
/// Points of one parallel task.
const CHUNK: usize = 1 << 14;
/// Points that are enough; of more, every so manieth is taken.
const ENOUGH: usize = 1 << 18;

/// Directions all around, evenly spread (Fibonacci's spiral), and the mean radiance that comes from each to `place`:
/// that of the points around a direction by the solid angle of each, whatever is in front of it, and the far field's
/// where there is none. Points nearer than `nearest` metres do not count.
pub fn estimate(chunks: &PointChunks, place: Vec3, nearest: f32, far_field: Option<&FarField>) -> Vec<(Vec3, Vec3)> {
    beyond(&of_points(chunks, place, nearest), far_field)
}

/// The same directions in front of a far field, whose light comes from where there are no points.
pub fn beyond(of_points: &[(Vec3, Option<Vec3>)], far_field: Option<&FarField>) -> Vec<(Vec3, Vec3)> {
    let far = |direction| far_field.map_or(Vec3::ZERO, |far_field| far_field.sample(direction));
    of_points.iter().map(|&(direction, light)| (direction, light.unwrap_or_else(|| far(direction)))).collect()
}

/// What [`estimate`] has of the points alone, which takes nearly all of its time.
pub fn of_points(chunks: &PointChunks, place: Vec3, nearest: f32) -> Vec<(Vec3, Option<Vec3>)> {
    let directions: Vec<Vec3> = (0..DIRECTIONS)
        .map(|k| {
            let y = 1.0 - (2.0 * k as f32 + 1.0) / DIRECTIONS as f32;
            let (sine, cosine) = (k as f32 * 2.399_963_2).sin_cos();
            let across = (1.0 - y * y).sqrt();
            Vec3::new(across * cosine, y, across * sine)
        })
        .collect();
    let area = chunks.spacing * chunks.spacing;
    let stride = chunks.points.len().div_ceil(ENOUGH).max(1);
    // Sums of a chunk of points, added up in their order: the same whatever the number of threads.
    let sums: Vec<Vec<(Vec3, f32)>> = chunks
        .points
        .par_chunks(CHUNK)
        .map(|points| {
            let mut sums = vec![(Vec3::ZERO, 0.0); DIRECTIONS];
            for [x, y, z, color] in points.iter().step_by(stride) {
                let to = Vec3::from([*x, *y, *z].map(f32::from_bits)) - place;
                let distance2 = to.length_squared();
                if distance2 < nearest * nearest || !distance2.is_finite() {
                    continue;
                }
                let (towards, color) = (to / distance2.sqrt(), unpack_rgb9e5(*color));
                for (sum, direction) in sums.iter_mut().zip(&directions) {
                    let weight = (towards.dot(*direction) - WIDTH).max(0.0) * area / distance2;
                    sum.0 += color * weight;
                    sum.1 += weight;
                }
            }
            sums
        })
        .collect();
    directions
        .iter()
        .enumerate()
        .map(|(k, &direction)| {
            let (light, weight) =
                sums.iter().fold((Vec3::ZERO, 0.0), |sum, part| (sum.0 + part[k].0, sum.1 + part[k].1));
            (direction, (weight > 0.0).then(|| light / weight))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_comes_from_where_the_bright_points_are() {
        let positions: Vec<Vec3> = (0..20_000)
            .map(|k| {
                let (a, b) = ((k % 141) as f32 / 70.0 - 1.0, (k / 141) as f32 / 70.0 - 1.0);
                Vec3::new(a, b, 1.0).normalize() * 3.0
            })
            .collect();
        let both: Vec<Vec3> = positions.iter().copied().chain(positions.iter().map(|p| -*p)).collect();
        let colors: Vec<Vec3> =
            both.iter().map(|p| if p.z > 0.0 { Vec3::new(4.0, 2.0, 1.0) } else { Vec3::splat(0.1) }).collect();
        let chunks = PointChunks::from_points(&both, &colors, &[0.05]).expect("few points");
        for (direction, light) in estimate(&chunks, Vec3::ZERO, 0.1, None) {
            if direction.z.abs() > 0.8 {
                let expected = if direction.z > 0.0 { Vec3::new(4.0, 2.0, 1.0) } else { Vec3::splat(0.1) };
                assert!((light - expected).abs().max_element() < 0.02, "{light} from {direction}");
            }
            assert!(direction.is_normalized());
        }
        let far_field = FarField { width: 1, height: 1, radiance: vec![Vec3::splat(0.5)] };
        let none = estimate(&PointChunks::default(), Vec3::ZERO, 0.1, Some(&far_field));
        assert!(none.iter().all(|(_, light)| *light == Vec3::splat(0.5)));
    }
}
