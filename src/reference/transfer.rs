//! Transfer of single places, as the definition has it (Hajisharif 2012, Eqs. 3 and 8): many directions, all occluders
//! one by one, in f64. No hierarchy, no packets, nothing that is known beforehand.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use crate::scene::harmonics::{Harmonics, MOST_COEFFICIENTS, basis};

/// Directions over the whole sphere, with the basis functions there.
pub struct Directions {
    all: Vec<(DVec3, Harmonics)>,
}

impl Directions {
    /// `count` directions of equal solid angle: heights are even, and each azimuth is the golden angle on from the last
    /// (Keinert et al., "Spherical Fibonacci Mapping", 2015).
    pub fn new(count: u32) -> Self {
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        let direction = |index: u32| {
            let height = 1.0 - (2.0 * f64::from(index) + 1.0) / f64::from(count);
            let (sine, cosine) = (TAU * (golden * f64::from(index)).fract()).sin_cos();
            let across = (1.0 - height * height).sqrt();
            DVec3::new(across * sine, height, across * cosine)
        };
        Self { all: (0..count).map(direction).map(|direction| (direction, basis(direction))).collect() }
    }

    /// The transfer of a place with a unit normal, from which `blocked` tells in which directions something is in the
    /// way: the coefficients of V max(0, n . w).
    pub fn transfer(&self, normal: DVec3, blocked: impl Fn(DVec3) -> bool) -> Harmonics {
        let weight = 4.0 * PI / self.all.len() as f64;
        let mut coefficients = [0.0; MOST_COEFFICIENTS];
        for (direction, basis) in &self.all {
            let cosine = normal.dot(*direction);
            if cosine > 0.0 && !blocked(*direction) {
                for (coefficient, value) in coefficients.iter_mut().zip(basis) {
                    *coefficient += weight * cosine * value;
                }
            }
        }
        coefficients
    }
}

/// Distance, in lengths of `direction`, at which a ray meets a triangle from either side (Möller and Trumbore 1997);
/// at or behind its origin it meets none.
pub fn triangle_hit([a, b, c]: [DVec3; 3], origin: DVec3, direction: DVec3) -> Option<f64> {
    let (ab, ac, from) = (b - a, c - a, origin - a);
    let across = direction.cross(ac);
    let determinant = ab.dot(across);
    let u = from.dot(across) / determinant;
    let v = direction.dot(from.cross(ab)) / determinant;
    let distance = ac.dot(from.cross(ab)) / determinant;
    // a ray along the plane gives NaN or infinity here, and neither passes
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0 && distance.is_finite()).then_some(distance)
}

/// Whether a ray meets a sphere.
pub fn sphere_blocks(centre: DVec3, radius: f64, origin: DVec3, direction: DVec3) -> bool {
    let to = centre - origin;
    let along = to.dot(direction.normalize());
    along > 0.0 && to.length_squared() - along * along < radius * radius
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::harmonics::{COSINE_LOBE, band};

    #[test]
    fn without_occluders_it_is_the_cosine_lobe() {
        let normal = DVec3::new(0.48, -0.6, 0.64);
        let (transfer, values) = (Directions::new(100_000).transfer(normal, |_| false), basis(normal));
        for k in 0..MOST_COEFFICIENTS {
            let exact = COSINE_LOBE[band(k)] * values[k];
            assert!((transfer[k] - exact).abs() < 2e-4, "{k}: {} instead of {exact}", transfer[k]);
        }
    }

    #[test]
    fn a_sphere_takes_its_form_factor() {
        // straight above, 2 radii away: sin^2 of its half angle
        let blocked = |direction| sphere_blocks(DVec3::Y * 2.0, 1.0, DVec3::ZERO, direction);
        let transfer = Directions::new(100_000).transfer(DVec3::Y, blocked);
        let exact = 0.75 * PI * (0.25 / PI).sqrt();
        assert!((transfer[0] - exact).abs() < 2e-4, "{} instead of {exact}", transfer[0]);
    }

    #[test]
    fn triangles_are_met_from_both_sides_and_in_front_alone() {
        let triangle = [DVec3::new(-1.0, -1.0, 2.0), DVec3::new(3.0, -1.0, 2.0), DVec3::new(-1.0, 3.0, 2.0)];
        let hit = |x: f64, z: f64, direction| triangle_hit(triangle, DVec3::new(x, 0.5, z), direction);
        assert_eq!(hit(0.0, 0.0, DVec3::Z), Some(2.0));
        assert_eq!(hit(0.0, 5.0, DVec3::NEG_Z), Some(3.0));
        assert_eq!(hit(0.0, 0.0, DVec3::NEG_Z), None);
        assert_eq!(hit(1.6, 0.0, DVec3::Z), None);
        assert_eq!(hit(0.0, 2.0, DVec3::X), None);
    }
}
