//! How far the surface of an object is, on a grid around it: what soft shadows are traced through.

use glam::{UVec3, Vec3};
use kiddo::{KdTree, SquaredEuclidean};
use rayon::prelude::*;

use crate::scene::Object;

/// Distances to a surface at the points of a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceField {
    /// The grid's first point, in the object's space.
    pub low: Vec3,
    /// From a point to the next, metres.
    pub cell: f32,
    /// Points along each axis.
    pub size: UVec3,
    /// Distances in metres, x fastest, then y.
    pub distances: Vec<f32>,
}

/// Cells along the longest side of the object.
const CELLS: f32 = 48.0;
/// Cells around the object's bounds on each side.
const MARGIN: f32 = 3.0;
/// Samples of the surface are at most this many cells apart.
const SPACING: f32 = 0.5;
/// Most samples; surfaces of more are sampled more thinly.
const MOST_SAMPLES: f32 = 2e6;

impl DistanceField {
    /// The field of an object, by samples of its surface; without a triangle, everything is far away.
    pub fn new(object: &Object) -> Self {
        let (low, high) = object.bounds();
        let extent = (high - low).max_element().max(f32::MIN_POSITIVE);
        let cell = extent / CELLS;
        let size = ((high - low) / cell + 2.0 * MARGIN).ceil().as_uvec3() + 1;
        let low = low - MARGIN * cell;
        let mut samples: KdTree<f32, 3> = KdTree::new();
        for sample in surface_samples(object, SPACING * cell) {
            samples.add(&sample.to_array(), 0);
        }
        let distances = (0..size.element_product())
            .into_par_iter()
            .map(|index| {
                let at = UVec3::new(index % size.x, index / size.x % size.y, index / size.x / size.y);
                let place = low + at.as_vec3() * cell;
                match samples.size() {
                    0 => f32::MAX,
                    _ => samples.nearest_one::<SquaredEuclidean>(&place.to_array()).distance.sqrt(),
                }
            })
            .collect();
        Self { low, cell, size, distances }
    }

    /// Upper corner of the grid.
    pub fn high(&self) -> Vec3 {
        self.low + (self.size - 1).as_vec3() * self.cell
    }

    /// Distance at a place inside of the grid, interpolated along all axes.
    pub fn sample(&self, place: Vec3) -> f32 {
        let at = ((place - self.low) / self.cell).clamp(Vec3::ZERO, (self.size - 1).as_vec3() - 1e-3);
        let (corner, part) = (at.floor().as_uvec3(), at.fract());
        (0..8_u32)
            .map(|k| {
                let side = UVec3::new(k & 1, k >> 1 & 1, k >> 2);
                let p = (corner + side).min(self.size - 1);
                let share = Vec3::ONE - (part - side.as_vec3()).abs();
                self.distances[((p.z * self.size.y + p.y) * self.size.x + p.x) as usize] * share.element_product()
            })
            .sum()
    }
}

/// Points on all triangles, about `spacing` metres apart.
fn surface_samples(object: &Object, spacing: f32) -> Vec<Vec3> {
    let triangles: Vec<[Vec3; 3]> = object
        .primitives
        .iter()
        .flat_map(|p| object.indices[p.indices.start as usize..p.indices.end as usize].chunks_exact(3))
        .map(|t| [0, 1, 2].map(|k| object.vertices[t[k] as usize].position))
        .collect();
    let area: f32 = triangles.iter().map(|[a, b, c]| 0.5 * (*b - *a).cross(*c - *a).length()).sum();
    let spacing = spacing.max((area / MOST_SAMPLES).sqrt()).max(f32::MIN_POSITIVE);
    let mut samples = Vec::new();
    for [a, b, c] in triangles {
        let longest = (b - a).length().max((c - a).length()).max((c - b).length());
        let steps = (longest / spacing).ceil().clamp(1.0, 4096.0) as u32;
        for i in 0..=steps {
            for j in 0..=steps - i {
                samples.push(a + (b - a) * (i as f32 / steps as f32) + (c - a) * (j as f32 / steps as f32));
            }
        }
    }
    samples
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::shapes::sphere;

    #[test]
    fn distances_are_those_to_the_surface() {
        let field = DistanceField::new(&sphere(0.5, 32));
        for k in 0..200 {
            let direction = Vec3::new((k as f32).sin(), (1.7 * k as f32).cos(), (0.3 * k as f32).sin()).normalize();
            let radius = 0.55 * (k as f32 / 200.0);
            let found = field.sample(direction * radius);
            let expected = (0.5 - radius).abs();
            assert!((found - expected).abs() < 0.6 * field.cell, "{found} instead of {expected} at {radius}");
        }
    }

    #[test]
    fn an_object_without_extent_is_a_point() {
        let object = Object::default();
        assert!(DistanceField::new(&object).distances.iter().all(|d| *d == f32::MAX));
    }
}
