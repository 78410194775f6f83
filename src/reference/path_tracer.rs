//! A plain Monte Carlo path tracer (Kajiya 1986) with next event estimation and Russian roulette.

use std::f32::consts::PI;

use glam::Vec3;

use super::bvh::Bvh;
pub use super::bvh::Hit;
use super::emitters::Emitters;
use super::rooms::Room;
use super::sampling::{R2, Random, cosine_direction};
use crate::Result;

/// Rays start this far above the surface they leave, metres, and shadow rays end as far before the lamp.
const LIFT: f32 = 1e-4;
/// Paths are never ended by chance before this many bounces, where they still carry most of the light.
const SURE_BOUNCES: u32 = 3;

/// A room made ready for rays.
pub struct PathTracer {
    room: Room,
    bvh: Bvh,
    pub(super) emitters: Emitters,
}

impl PathTracer {
    /// Builds the hierarchy. [`crate::Error::Argument`] says which surface is degenerate, not finite or reflects more
    /// light than it receives.
    pub fn new(room: Room) -> Result<Self> {
        room.check()?;
        let (bvh, emitters) = (Bvh::new(&room.surfaces), Emitters::new(&room));
        Ok(Self { room, bvh, emitters })
    }

    /// The room as it was given.
    pub fn room(&self) -> &Room {
        &self.room
    }

    /// The first surface that the ray meets, from either side.
    pub fn hit(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        self.bvh.closest(origin, direction)
    }

    /// True when nothing lies within `distance` along the unit vector `direction`.
    pub(super) fn visible(&self, origin: Vec3, direction: Vec3, distance: f32) -> bool {
        !self.bvh.blocked(origin, direction, distance - 2.0 * LIFT)
    }

    /// Radiance that arrives at `origin` from the unit vector `direction`: the mean of `paths` independent paths.
    /// The same arguments always give the same result. Backs of surfaces are black.
    pub fn radiance(&self, origin: Vec3, direction: Vec3, paths: u32, seed: u64) -> Vec3 {
        let sum: Vec3 =
            (0..paths).map(|path| self.path(origin, direction, &mut Random::new(u64::from(path), seed))).sum();
        sum / paths.max(1) as f32
    }

    fn path(&self, origin: Vec3, direction: Vec3, random: &mut Random) -> Vec3 {
        let (mut origin, mut direction) = (origin, direction);
        let (mut radiance, mut throughput) = (Vec3::ZERO, Vec3::ONE);
        for bounce in 0_u32.. {
            let Some(hit) = self.hit(origin, direction).filter(|hit| hit.front) else { break };
            let surface = &self.room.surfaces[hit.surface];
            if bounce == 0 {
                // later on, lamps are met by next event estimation
                radiance += surface.emission;
            }
            let normal = surface.normal();
            origin = lifted(surface.at(hit.u, hit.v), normal);
            throughput *= surface.albedo_at(hit.u, hit.v);
            radiance += throughput * self.one_lamp(origin, normal, random) / PI;

            if bounce >= SURE_BOUNCES {
                let survival = throughput.max_element().min(0.95);
                if random.uniform() >= survival {
                    break;
                }
                throughput /= survival;
            }
            direction = cosine_direction(normal, random.square());
        }
        radiance
    }

    /// Direct irradiance from one random point of one random lamp.
    fn one_lamp(&self, position: Vec3, normal: Vec3, random: &mut Random) -> Vec3 {
        let (pick, square) = (random.uniform(), random.square());
        let Some(lamp) = self.emitters.seen_from(position, normal).sample(pick, square) else { return Vec3::ZERO };
        let cosine = normal.dot(lamp.direction);
        if cosine > 0.0 && self.visible(position, lamp.direction, lamp.distance) {
            lamp.emission * (cosine / lamp.density)
        } else {
            Vec3::ZERO
        }
    }

    /// True when a point on a surface lies inside of a box or behind a wall: most of what it sees are backs.
    pub(super) fn hidden(&self, position: Vec3, normal: Vec3) -> bool {
        const MAJORITY: u32 = 4;
        let origin = lifted(position, normal);
        let sequence = R2::new(0, 0);
        let (mut backs, mut others) = (0, 0);
        for n in 0_u32.. {
            let direction = cosine_direction(normal, sequence.square(n));
            if self.hit(origin, direction).is_some_and(|hit| !hit.front) {
                backs += 1;
            } else {
                others += 1;
            }
            if backs.max(others) == MAJORITY {
                break;
            }
        }
        backs == MAJORITY
    }
}

/// `position` moved off its surface, so that rays from it don't meet that surface again.
pub(super) fn lifted(position: Vec3, normal: Vec3) -> Vec3 {
    position + normal * LIFT
}
