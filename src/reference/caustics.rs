//! Clouds of polished metal on a floor, whose caustics are known: a ring, in which light gathers along a nephroid, and a
//! parabolic mirror, which gathers it in its focus.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::sampling::R2;
use crate::scene::{Brush, Cloud, Surfaces};

/// Colour of the metal, linear.
pub const GOLD: Vec3 = Vec3::new(1.0, 0.72, 0.32);
/// Inner radius of the ring, metres.
pub const RING_RADIUS: f32 = 0.5;
/// Distance of the focus from the mirror's vertex, metres; it lies on the floor at (this, 0, 0).
pub const FOCUS: f32 = 0.6;

const FLOOR: Vec3 = Vec3::new(0.5, 0.5, 0.5);
const RING_HEIGHT: f32 = 0.36;
const RING_WIDTH: f32 = 0.04;

/// What the metal is made of.
pub fn polished_gold() -> Brush {
    let half = Vec3::splat(0.05);
    let surfaces = Surfaces { diffuse: 0.1, specular: 0.85, shininess: 600.0 };
    Brush { from: GOLD - half, to: GOLD + half, surfaces }
}

/// A surface over a rectangle of parameters.
struct Patch<'a> {
    low: Vec2,
    high: Vec2,
    /// Position, normal, and square metres for each unit of the rectangle's area.
    at: &'a dyn Fn(Vec2) -> (Vec3, Vec3, f32),
    color: Vec3,
}

/// About `points` points on all of them, as even as a rectangle's are on each.
fn scatter(patches: &[Patch<'_>], points: usize) -> Cloud {
    let stretch = |patch: &Patch<'_>| (patch.at)(0.5 * (patch.low + patch.high)).2;
    let area = |patch: &Patch<'_>| (patch.high - patch.low).element_product() * stretch(patch);
    let density = points as f32 / patches.iter().map(area).sum::<f32>();
    let mut cloud = Cloud::default();
    for (patch, stream) in patches.iter().zip(0..) {
        let edges = patch.high - patch.low;
        let side = edges.max_element();
        let sequence = R2::new(stream, 1);
        let local = density * stretch(patch);
        let squares = (0..(local * side * side) as u32).map(|n| sequence.square(n) * side);
        for place in squares.filter(|place| place.cmplt(edges).all()) {
            let (position, normal, stretch) = (patch.at)(patch.low + place);
            cloud.positions.push(position);
            cloud.normals.push(normal);
            cloud.colors.push(patch.color);
            cloud.spacing.push((stretch / local).sqrt());
        }
    }
    cloud
}

/// A ring that lies on a floor of 2.4 x 2.4 m about the origin, of about `points` points.
pub fn ring(points: usize) -> Cloud {
    let around = |angle: f32| Vec3::new(angle.cos(), 0.0, angle.sin());
    let outer = RING_RADIUS + RING_WIDTH;
    let wall = |radius: f32, side: f32| {
        move |p: Vec2| (around(p.x / radius) * radius + Vec3::Y * p.y, around(p.x / radius) * side, 1.0)
    };
    let (inside, outside) = (wall(RING_RADIUS, -1.0), wall(outer, 1.0));
    let top = |p: Vec2| {
        let angle = p.x / outer;
        (around(angle) * p.y + Vec3::Y * RING_HEIGHT, Vec3::Y, p.y / outer)
    };
    let floor = |p: Vec2| (Vec3::new(p.x, 0.0, p.y), Vec3::Y, 1.0);
    let half = Vec2::splat(1.2);
    scatter(
        &[
            Patch { low: -half, high: half, at: &floor, color: FLOOR },
            Patch { low: Vec2::ZERO, high: Vec2::new(TAU * RING_RADIUS, RING_HEIGHT), at: &inside, color: GOLD },
            Patch { low: Vec2::ZERO, high: Vec2::new(TAU * outer, RING_HEIGHT), at: &outside, color: GOLD },
            Patch { low: Vec2::new(0.0, RING_RADIUS), high: Vec2::new(TAU * outer, outer), at: &top, color: GOLD },
        ],
        points,
    )
}

/// A part of a parabolic mirror above a floor, of about `points` points: light along -X gathers at ([`FOCUS`], 0, 0).
pub fn parabolic_mirror(points: usize) -> Cloud {
    let mirror = |p: Vec2| {
        let gradient = Vec3::new(1.0, -0.5 * p.x / FOCUS, -0.5 * p.y / FOCUS);
        (Vec3::new(0.25 * p.length_squared() / FOCUS, p.x, p.y), gradient.normalize(), gradient.length())
    };
    let floor = |p: Vec2| (Vec3::new(p.x, 0.0, p.y), Vec3::Y, 1.0);
    scatter(
        &[
            Patch { low: Vec2::new(-0.3, -0.8), high: Vec2::new(1.5, 0.8), at: &floor, color: FLOOR },
            Patch { low: Vec2::new(0.15, -0.4), high: Vec2::new(0.9, 0.4), at: &mirror, color: GOLD },
        ],
        points,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_along_the_axis_meets_in_the_focus_of_the_mirror() {
        let cloud = parabolic_mirror(20_000);
        assert!((18_000..23_000).contains(&cloud.len()), "{} points", cloud.len());
        let mirror = cloud.positions.iter().zip(&cloud.normals).zip(&cloud.colors).filter(|(_, color)| **color == GOLD);
        assert!(mirror.clone().count() > 2_000);
        for ((position, normal), _) in mirror {
            let reflected = Vec3::NEG_X.reflect(*normal);
            let to = (Vec3::X * FOCUS - position).normalize();
            assert!(reflected.dot(to) > 0.9999, "{position}: {reflected} instead of {to}");
        }
    }

    #[test]
    fn the_ring_is_of_gold_and_its_points_stand_for_its_area() {
        let cloud = ring(30_000);
        let gold: Vec<usize> = (0..cloud.len()).filter(|n| polished_gold().fits(cloud.colors[*n])).collect();
        let area: f32 = gold.iter().map(|n| cloud.spacing[*n].powi(2)).sum();
        let outer = RING_RADIUS + RING_WIDTH;
        let expected = TAU * RING_HEIGHT * (RING_RADIUS + outer) + 0.5 * TAU * (outer.powi(2) - RING_RADIUS.powi(2));
        assert!((area / expected - 1.0).abs() < 0.02, "{area} instead of {expected} m2");
        assert!(gold.iter().all(|n| cloud.positions[*n].with_y(0.0).length() > 0.999 * RING_RADIUS));
    }
}
