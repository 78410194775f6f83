//! The truth for an object in a room: at every pixel the hemisphere is gathered in the room's real geometry, by Monte
//! Carlo with multiple importance sampling of BRDF and lamps (Veach 1997). The room occludes, the object does not.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::bake::{BakedRoom, Progress, parallel};
use super::emitters::Visible;
use super::sampling::{R2, cosine_density, cosine_direction, tangents};
use crate::{Error, Result};

/// GGX turns into a mirror below this alpha, which sampling in f32 could not resolve.
const LEAST_ALPHA: f32 = 1e-3;

/// How the object reflects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Brdf {
    /// Lambert.
    Diffuse {
        /// Reflectance, 0 to 1.
        albedo: Vec3,
    },
    /// A metal that reflects everything (F = 1): GGX with separable Smith shadowing, single scattering.
    Metal {
        /// GGX alpha (the square of perceptual roughness), above 0 and at most 1; values below 0.001 count as 0.001.
        alpha: f32,
    },
}

/// One pixel of an object: what a G-buffer holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// World space, metres.
    pub position: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// Unit vector from the position to the eye.
    pub view: Vec3,
}

impl Receiver {
    /// A receiver as `eye` sees it.
    pub fn seen_from(eye: Vec3, position: Vec3, normal: Vec3) -> Self {
        Self { position, normal, view: (eye - position).normalize_or_zero() }
    }
}

/// A BRDF about one normal and view: values times cosine, densities and directions.
struct Lobe {
    brdf: Brdf,
    normal: Vec3,
    view: Vec3,
}

/// Smith's G1 of GGX for a direction at `cosine` to the normal.
fn smith(cosine: f32, alpha: f32) -> f32 {
    let squared = alpha * alpha;
    2.0 * cosine / (cosine + (squared + (1.0 - squared) * cosine * cosine).sqrt())
}

/// GGX's distribution of normals at `cosine` to the normal.
fn distribution(cosine: f32, alpha: f32) -> f32 {
    let squared = alpha * alpha;
    let base = cosine * cosine * (squared - 1.0) + 1.0;
    squared / (PI * base * base)
}

impl Lobe {
    fn new(brdf: Brdf, receiver: &Receiver) -> Self {
        let brdf = match brdf {
            Brdf::Metal { alpha } => Brdf::Metal { alpha: alpha.max(LEAST_ALPHA) },
            diffuse => diffuse,
        };
        Self { brdf, normal: receiver.normal, view: receiver.view }
    }

    /// A direction for a point of the unit square; it may lie below the horizon.
    fn sample(&self, square: Vec2) -> Vec3 {
        match self.brdf {
            Brdf::Diffuse { .. } => cosine_direction(self.normal, square),
            Brdf::Metal { alpha } => {
                let half = self.visible_normal(alpha, square);
                half * (2.0 * self.view.dot(half)) - self.view
            }
        }
    }

    /// A microfacet normal with the density in which the eye sees them (Heitz 2018, listing 1).
    fn visible_normal(&self, alpha: f32, square: Vec2) -> Vec3 {
        let (t, b) = tangents(self.normal);
        let local = Vec3::new(t.dot(self.view), b.dot(self.view), self.normal.dot(self.view));
        let stretched = Vec3::new(alpha * local.x, alpha * local.y, local.z).normalize_or(Vec3::Z);
        let first = Vec3::new(-stretched.y, stretched.x, 0.0).normalize_or(Vec3::X);
        let second = stretched.cross(first);
        let (radius, angle) = (square.x.sqrt(), 2.0 * PI * square.y);
        let (x, y) = (radius * angle.cos(), radius * angle.sin());
        let half = 0.5 * (1.0 + stretched.z);
        let y = (1.0 - half) * (1.0 - x * x).max(0.0).sqrt() + half * y;
        let z = (1.0 - x * x - y * y).max(0.0).sqrt();
        let m = first * x + second * y + stretched * z;
        let m = Vec3::new(alpha * m.x, alpha * m.y, m.z.max(1e-6)).normalize_or(Vec3::Z);
        t * m.x + b * m.y + self.normal * m.z
    }

    /// (value times cosine, density of [`Lobe::sample`]) for light from the unit vector `light`.
    fn evaluate(&self, light: Vec3) -> (Vec3, f32) {
        let cosine = self.normal.dot(light);
        if cosine <= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        match self.brdf {
            Brdf::Diffuse { albedo } => (albedo * (cosine / PI), cosine_density(cosine)),
            Brdf::Metal { alpha } => {
                let seen = self.normal.dot(self.view);
                let half = (self.view + light).normalize_or(self.normal);
                // D G1(v) / (4 n.v) is the density of visible normals after reflection; G1(l) is what remains
                let density = distribution(self.normal.dot(half), alpha) * smith(seen, alpha) / (4.0 * seen);
                (Vec3::splat(density * smith(cosine, alpha)), density)
            }
        }
    }
}

/// Radiance that leaves `receiver` towards the eye, lit by the room. `samples` directions are taken from the BRDF and
/// as many from the lamps; `seed` changes the noise and nothing else. Where the normal faces away from the eye a metal
/// is black.
pub fn gather(baked: &BakedRoom, receiver: &Receiver, brdf: Brdf, samples: u32, seed: u64) -> Vec3 {
    if matches!(brdf, Brdf::Metal { .. }) && receiver.normal.dot(receiver.view) <= 0.0 {
        return Vec3::ZERO;
    }
    let lobe = Lobe::new(brdf, receiver);
    let emitters = baked.tracer.emitters.seen_from(receiver.position, receiver.normal);
    let (directions, lamps) = (R2::new(0, seed), R2::new(1, seed));
    let mut sum = Vec3::ZERO;
    for n in 0..samples {
        sum += from_brdf(baked, receiver, &lobe, &emitters, directions.square(n));
        // picking in order gives every lamp a stretch of the sequence, which is even by itself
        let pick = (n as f32 + 0.5) / samples as f32;
        if let Some(lamp) = emitters.sample(pick, lamps.square(n)) {
            let (value, density) = lobe.evaluate(lamp.direction);
            if value != Vec3::ZERO && baked.tracer.visible(receiver.position, lamp.direction, lamp.distance) {
                // balance heuristic: value / p_lamp * p_lamp / (p_brdf + p_lamp)
                sum += value * lamp.emission / (density + lamp.density);
            }
        }
    }
    sum / samples.max(1) as f32
}

/// One sample of the BRDF: all that the room reflects, and of what it emits the part that lamp samples leave.
fn from_brdf(baked: &BakedRoom, receiver: &Receiver, lobe: &Lobe, emitters: &Visible, square: Vec2) -> Vec3 {
    let direction = lobe.sample(square);
    let (value, density) = lobe.evaluate(direction);
    let Some(hit) = baked.tracer.hit(receiver.position, direction).filter(|hit| hit.front && density > 0.0) else {
        return Vec3::ZERO;
    };
    let emission = baked.room().surfaces[hit.surface].emission;
    let lamp_density = emitters.density(hit.surface);
    let reflected = baked.reflected_at(hit.surface, hit.u, hit.v);
    value * (reflected / density + emission / (density + lamp_density))
}

/// [`gather`] at every receiver, on all threads; the same result on any number of them.
///
/// [`Error::Argument`] for a receiver that is not finite or whose vectors are not unit vectors, and for an albedo or
/// alpha out of range.
pub fn render_reference(
    baked: &BakedRoom,
    receivers: &[Receiver],
    brdf: Brdf,
    samples: u32,
    progress: Progress,
) -> Result<Vec<Vec3>> {
    let in_range = match brdf {
        Brdf::Diffuse { albedo } => albedo.min_element() >= 0.0 && albedo.max_element() <= 1.0,
        Brdf::Metal { alpha } => alpha > 0.0 && alpha <= 1.0,
    };
    if !in_range {
        return Err(Error::Argument(format!("reference: {brdf:?}, albedo and alpha must lie in 0 to 1")));
    }
    let unusable = |r: &Receiver| !(r.position.is_finite() && unit_length(r.normal) && unit_length(r.view));
    if let Some(index) = receivers.iter().position(unusable) {
        return Err(Error::Argument(format!("reference: receiver {index} needs a finite place and unit vectors")));
    }
    Ok(parallel(receivers, progress, |(index, receiver)| gather(baked, receiver, brdf, samples, index as u64)))
}

/// True up to the rounding of 16-bit G-buffers.
fn unit_length(vector: Vec3) -> bool {
    (vector.length() - 1.0).abs() < 2e-3
}
