//! Light of lamps by paths (Kajiya 1986), bounce by bounce: what virtual point lights are held against. And clouds of
//! rooms whose colours are albedos, as a scan under even light would have them.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::bake::cloud_of;
use super::path_tracer::{PathTracer, lifted};
use super::rooms::Rectangle;
use super::sampling::{R2, Random, cosine_direction};
use crate::scene::{Cloud, Lamp};

/// Samples of lamps that are farther than any room.
const BEYOND: f32 = 1e6;

impl PathTracer {
    /// Direct irradiance of a lamp at a place on a surface, shadows included.
    pub fn lamp_irradiance(&self, lamp: &Lamp, position: Vec3, normal: Vec3) -> Vec3 {
        let origin = lifted(position, normal);
        let Some(light) = lamp.incident(origin) else { return Vec3::ZERO };
        let cosine = normal.dot(light.towards);
        if cosine > 0.0 && self.visible(origin, light.towards, light.distance.min(BEYOND)) {
            light.irradiance * cosine
        } else {
            Vec3::ZERO
        }
    }

    /// Irradiance at a place on a surface that lamps alone light, by the number of times that the light was reflected
    /// diffusely before: first the direct one, last that of `bounces` bounces. From the mean of `paths` paths, the same
    /// for the same arguments.
    pub fn lamp_bounces(
        &self,
        lamps: &[Lamp],
        (position, normal): (Vec3, Vec3),
        bounces: usize,
        paths: u32,
        seed: u64,
    ) -> Vec<Vec3> {
        let direct =
            |position, normal| lamps.iter().map(|lamp| self.lamp_irradiance(lamp, position, normal)).sum::<Vec3>();
        let mut irradiance = vec![Vec3::ZERO; bounces + 1];
        irradiance[0] = direct(position, normal);
        let sequence = R2::new(0, seed);
        for path in 0..paths {
            let mut random = Random::new(u64::from(path), seed);
            let (mut position, mut normal, mut throughput) = (position, normal, Vec3::ONE);
            for (bounce, sum) in irradiance.iter_mut().enumerate().skip(1) {
                // The first direction decides most: an even sequence.
                let square = if bounce == 1 { sequence.square(path) } else { random.square() };
                let origin = lifted(position, normal);
                let hit = self.hit(origin, cosine_direction(normal, square)).filter(|hit| hit.front);
                let Some(hit) = hit else { break };
                let surface = &self.room().surfaces[hit.surface];
                (position, normal) = (surface.at(hit.u, hit.v), surface.normal());
                // Cosine and pi of the irradiance cancel against the density, those of the reflection do not.
                throughput *= surface.albedo_at(hit.u, hit.v);
                *sum += throughput * direct(position, normal) / paths as f32;
            }
        }
        irradiance
    }

    /// About `points` points, spread evenly by area over the surfaces that can be seen, with normals, spacing and the
    /// albedo as colour.
    pub fn albedo_cloud(&self, points: usize, seed: u64) -> Cloud {
        let surfaces = &self.room().surfaces;
        let density = points as f32 / surfaces.iter().map(Rectangle::area).sum::<f32>();
        let scan = |(index, surface): (usize, &Rectangle)| -> Vec<(Vec3, Vec3, Vec3)> {
            let edges = Vec2::new(surface.edge_u.length(), surface.edge_v.length());
            // The sequence is even in a square, of which a long rectangle takes its part.
            let side = edges.max_element();
            let sequence = R2::new(index as u64, seed);
            let normal = surface.normal();
            (0..(density * side * side) as u32)
                .map(|n| sequence.square(n) * side / edges)
                .filter(|p| p.x < 1.0 && p.y < 1.0)
                .map(|p| (surface.at(p.x, p.y), normal, surface.albedo_at(p.x, p.y)))
                .filter(|(position, ..)| !self.hidden(*position, normal))
                .collect()
        };
        let scanned: Vec<_> = surfaces.par_iter().enumerate().map(scan).collect();
        cloud_of(scanned, density)
    }
}

#[cfg(test)]
mod tests {
    use super::super::rooms::{Room, cornell_box};
    use super::*;
    use glam::vec3;

    fn lamp(text: &str) -> Lamp {
        text.parse().expect("a lamp")
    }

    /// A closed white box of 2 m, its walls looking inwards.
    fn furnace(albedo: f32) -> PathTracer {
        let (low, high) = (Vec3::splat(-1.0), Vec3::splat(1.0));
        let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
        let walls = [(low, z, x), (low, x, y), (low, y, z), (high, -x, -z), (high, -y, -x), (high, -z, -y)];
        let white = Vec3::splat(albedo);
        let surfaces = walls.into_iter().map(|(corner, u, v)| Rectangle::new(corner, u, v, white)).collect();
        PathTracer::new(Room { surfaces }).expect("a room")
    }

    #[test]
    fn a_spot_lights_a_floor_as_computed_by_hand_and_casts_shadows() {
        let floor = Rectangle::new(vec3(-5.0, 0.0, -5.0), Vec3::Z * 10.0, Vec3::X * 10.0, Vec3::ONE);
        let lid = Rectangle::new(vec3(0.4, 1.0, -0.5), Vec3::Z, Vec3::X, Vec3::ONE);
        let tracer = PathTracer::new(Room { surfaces: vec![floor, lid] }).expect("a room");
        let spot = lamp("spot at=0,2,0 to=0,0,0 power=10 angle=120");
        let strength = spot.strength().x;
        let at = |x: f32| tracer.lamp_irradiance(&spot, vec3(x, 0.0, 0.0), Vec3::Y).x;
        assert!((at(0.0) - strength / 4.0).abs() < 1e-3);
        assert!((at(-2.0) - strength / 8.0 * 0.5_f32.sqrt()).abs() < 1e-3);
        assert_eq!(at(1.5), 0.0, "in the lid's shadow");
        assert_eq!(at(-4.0), 0.0, "outside the cone");
        assert_eq!(tracer.lamp_irradiance(&spot, Vec3::ZERO, Vec3::NEG_Y).x, 0.0, "from below");
    }

    #[test]
    fn a_closed_white_box_keeps_the_energy_of_every_bounce() {
        let (albedo, power) = (0.6, 12.0);
        let tracer = furnace(albedo);
        let spot = lamp(&format!("spot at=0.2,0.5,0.1 to=0.2,-1,0.3 power={power} angle=70"));
        let mut sums = [Vec3::ZERO; 4];
        let mut places = 0_u8;
        for surface in &tracer.room().surfaces {
            let sequence = R2::new(1, 1);
            for n in 0..500 {
                let square = sequence.square(n);
                let place = (surface.at(square.x, square.y), surface.normal());
                let bounces = tracer.lamp_bounces(&[spot], place, 3, 16, u64::from(n));
                sums.iter_mut().zip(bounces).for_each(|(sum, value)| *sum += value / 500.0 * surface.area());
            }
            places += 1;
        }
        assert_eq!(places, 6);
        for (bounce, sum) in sums.into_iter().enumerate() {
            let expected = power * albedo.powi(bounce as i32);
            assert!((sum.x / expected - 1.0).abs() < 0.04, "bounce {bounce}: {} W instead of {expected} W", sum.x);
        }
    }

    #[test]
    fn the_scanned_box_has_even_points_with_albedos_and_none_under_the_blocks() {
        let tracer = PathTracer::new(cornell_box()).expect("a room");
        let cloud = tracer.albedo_cloud(20_000, 1);
        assert!((18_000..=20_100).contains(&cloud.len()), "{} points", cloud.len());
        let red = cloud.positions.iter().zip(&cloud.colors).filter(|(p, _)| p.x == -1.0);
        assert!(red.clone().count() > 2_500 && red.clone().all(|(_, c)| c.x > 0.6 && c.y < 0.1));
        let under = cloud
            .positions
            .iter()
            .filter(|p| p.y == 0.0 && p.x.abs() < 0.5)
            .filter(|p| p.distance(vec3(-0.34, 0.0, -0.36)) < 0.25 || p.distance(vec3(0.36, 0.0, 0.3)) < 0.25);
        assert_eq!(under.count(), 0);
    }
}
