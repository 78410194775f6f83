//! Next event estimation: points on the emitting rectangles, chosen in proportion to what they may contribute.

use glam::{Vec2, Vec3};

use super::rooms::{Rectangle, Room};
use crate::compare::luminance;

/// The rectangles that emit.
pub(super) struct Emitters {
    surfaces: Vec<Emitter>,
}

struct Emitter {
    surface: usize,
    rectangle: Rectangle,
    normal: Vec3,
    area: f32,
}

/// A point on an emitter as seen from a receiver.
pub(super) struct EmitterSample {
    /// Unit direction towards it.
    pub(super) direction: Vec3,
    /// Distance, metres.
    pub(super) distance: f32,
    /// Its radiance.
    pub(super) emission: Vec3,
    /// Probability density of the sample over solid angle.
    pub(super) density: f32,
}

/// The chance of each emitter to be chosen at one receiver; sums to 1, or is all zero where none can contribute.
pub(super) struct Shares(Vec<f32>);

impl Emitters {
    pub(super) fn new(room: &Room) -> Self {
        let emitting = room.surfaces.iter().enumerate().filter(|(_, r)| r.emission.max_element() > 0.0);
        let surfaces = emitting
            .map(|(surface, r)| Emitter { surface, rectangle: *r, normal: r.normal(), area: r.area() })
            .collect();
        Self { surfaces }
    }

    /// An emitter counts with its unoccluded power over its squared distance; never with zero when it can contribute,
    /// or the estimate would be biased.
    pub(super) fn shares(&self, position: Vec3, normal: Vec3) -> Shares {
        let weight = |emitter: &Emitter| {
            let rectangle = &emitter.rectangle;
            let faces = emitter.normal.dot(position - rectangle.corner) > 0.0;
            let above = rectangle.corners().iter().any(|&corner| normal.dot(corner - position) > 0.0);
            if !(faces && above) {
                return 0.0;
            }
            let squared = rectangle.centre().distance_squared(position);
            luminance(rectangle.emission) * emitter.area / (squared + emitter.area)
        };
        let mut shares: Vec<f32> = self.surfaces.iter().map(weight).collect();
        let total: f32 = shares.iter().sum();
        shares.iter_mut().for_each(|share| *share = if total > 0.0 { *share / total } else { 0.0 });
        Shares(shares)
    }

    /// A sample of emitter `index` alone, at `square` of its rectangle.
    fn sample_one(&self, index: usize, position: Vec3, square: Vec2) -> Option<EmitterSample> {
        let Emitter { rectangle, normal, area, .. } = &self.surfaces[index];
        let target = rectangle.corner + rectangle.edge_u * square.x + rectangle.edge_v * square.y;
        let (direction, distance) = (target - position).normalize_and_length();
        let cosine = -direction.dot(*normal);
        // from area to solid angle: dA cos / d^2
        let density = distance * distance / (cosine * area);
        (cosine > 0.0 && density.is_finite() && density > 0.0).then_some(EmitterSample {
            direction,
            distance,
            emission: rectangle.emission,
            density,
        })
    }

    /// A sample of all emitters: `pick` in [0, 1) chooses the emitter by `shares`. None where nothing can arrive.
    pub(super) fn sample(&self, shares: &Shares, position: Vec3, pick: f32, square: Vec2) -> Option<EmitterSample> {
        let mut sum = 0.0;
        let chosen = shares.0.iter().position(|&share| {
            sum += share;
            share > 0.0 && pick < sum
        });
        // rounding may leave the sum just below 1 and `pick` above it
        let index = chosen.or_else(|| shares.0.iter().rposition(|&share| share > 0.0))?;
        let sample = self.sample_one(index, position, square)?;
        Some(EmitterSample { density: sample.density * shares.0[index], ..sample })
    }

    /// The density with which [`Emitters::sample`] would have found `surface` at `distance` along `direction`.
    pub(super) fn density(&self, shares: &Shares, surface: usize, direction: Vec3, distance: f32) -> f32 {
        let Some(index) = self.surfaces.iter().position(|emitter| emitter.surface == surface) else { return 0.0 };
        let Emitter { normal, area, .. } = &self.surfaces[index];
        let cosine = -direction.dot(*normal);
        if cosine > 0.0 { shares.0[index] * distance * distance / (cosine * area) } else { 0.0 }
    }

    /// Direct irradiance at a receiver, about `samples` shared among the emitters, each at least once. `square` gives
    /// the n-th point of an even sequence; `visible` tells whether (direction, distance) is unobstructed.
    pub(super) fn irradiance(
        &self,
        (position, normal): (Vec3, Vec3),
        samples: u32,
        square: impl Fn(u32) -> Vec2,
        visible: impl Fn(Vec3, f32) -> bool,
    ) -> Vec3 {
        let shares = self.shares(position, normal);
        let mut irradiance = Vec3::ZERO;
        for (index, &share) in shares.0.iter().enumerate().filter(|(_, share)| **share > 0.0) {
            let count = (share * samples as f32).ceil().max(1.0) as u32;
            let mut sum = Vec3::ZERO;
            for sample in (0..count).filter_map(|n| self.sample_one(index, position, square(n))) {
                let cosine = normal.dot(sample.direction);
                if cosine > 0.0 && visible(sample.direction, sample.distance) {
                    sum += sample.emission * (cosine / sample.density);
                }
            }
            irradiance += sum / count as f32;
        }
        irradiance
    }
}
