//! How far the surface of an object is, on a grid around it: what soft shadows are traced through.

use glam::{IVec3, UVec3, Vec3};

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
    /// The field of an object: samples of its surface give their distances to the grid points around them, which hand
    /// the nearest sample on from neighbour to neighbour (Danielsson 1980).
    pub fn new(object: &Object) -> Self {
        let (low, high) = object.bounds();
        let cell = (high - low).max_element().max(f32::MIN_POSITIVE) / CELLS;
        let size = ((high - low) / cell + 2.0 * MARGIN).ceil().as_uvec3() + 1;
        let low = low - MARGIN * cell;
        let samples = surface_samples(object, SPACING * cell);
        let mut grid = Grid { low, cell, size: size.as_ivec3(), nearest: vec![None; size.element_product() as usize] };
        for (index, sample) in samples.iter().enumerate() {
            let corner = ((*sample - low) / cell).floor().as_ivec3();
            for k in 0..8 {
                grid.offer(corner + IVec3::new(k & 1, k >> 1 & 1, k >> 2), index as u32, &samples);
            }
        }
        grid.sweep(&samples);
        // Every grid point has heard of a sample by now.
        let distances = (0..grid.nearest.len())
            .map(|at| grid.nearest[at].map_or(f32::MAX, |index| grid.place(at).distance(samples[index as usize])))
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

/// The nearest sample that each grid point knows of.
struct Grid {
    low: Vec3,
    cell: f32,
    size: IVec3,
    nearest: Vec<Option<u32>>,
}

impl Grid {
    fn index(&self, at: IVec3) -> Option<usize> {
        let inside = at.min_element() >= 0 && at.cmplt(self.size).all();
        inside.then(|| ((at.z * self.size.y + at.y) * self.size.x + at.x) as usize)
    }

    fn at(&self, index: usize) -> IVec3 {
        let index = index as i32;
        IVec3::new(index % self.size.x, index / self.size.x % self.size.y, index / self.size.x / self.size.y)
    }

    fn place(&self, index: usize) -> Vec3 {
        self.low + self.at(index).as_vec3() * self.cell
    }

    /// Keeps a sample where it is nearer than what is known.
    fn offer(&mut self, at: IVec3, sample: u32, samples: &[Vec3]) {
        let Some(index) = self.index(at) else { return };
        let place = self.place(index);
        let distance2 = |sample: u32| samples[sample as usize].distance_squared(place);
        if self.nearest[index].is_none_or(|known| distance2(sample) < distance2(known)) {
            self.nearest[index] = Some(sample);
        }
    }

    /// Hands samples on: forwards and backwards, each grid point looking at the half of its neighbours that came before.
    fn sweep(&mut self, samples: &[Vec3]) {
        let before: Vec<IVec3> = (0..13).map(|k| IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1)).collect();
        for turn in 0..4 {
            for step in 0..self.nearest.len() {
                let (index, sign) = if turn % 2 == 0 { (step, 1) } else { (self.nearest.len() - 1 - step, -1) };
                let at = self.at(index);
                for side in &before {
                    if let Some(sample) = self.index(at + *side * sign).and_then(|other| self.nearest[other]) {
                        self.offer(at, sample, samples);
                    }
                }
            }
        }
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
}
