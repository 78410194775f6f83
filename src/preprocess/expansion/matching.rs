//! Shots are expanded by what the photo has in places that look alike (Sabbadin 2019, 4.1, the third strategy).

use glam::{Vec2, Vec3, Vec4Swizzles};
use rayon::prelude::*;

use super::patchmatch::{self, Field, RADIUS};
use super::pyramid::Pyramid;
use super::shots::{NO_POINT, Shot, direction, project};
use crate::scene::Picture;

/// Pixels around what is over-exposed that are matched too: an over-exposed point may be seen in one of them.
const BORDER: u32 = 2;
/// The coarsest level of a face is at most this wide: a patch then covers half of what the eye sees on one side.
const COARSEST: u32 = 16;

/// Levels of a pyramid over a face.
fn levels(size: u32) -> usize {
    (size.max(COARSEST) / COARSEST).ilog2() as usize + 1
}

/// A face with what lies around it, as wide as patches of the coarsest level reach; (pyramid, pixels around the face).
pub(crate) fn face_pyramid(shot: &Shot, face: usize, colors: &(dyn Fn(u32) -> Vec3 + Sync)) -> (Pyramid, u32) {
    let count = levels(shot.size);
    let around = (RADIUS as u32) << (count - 1);
    let side = shot.size + 2 * around;
    let texel = |x: u32, y: u32| {
        let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - around as f32;
        let (face, at) = project(direction(face, at, shot.size), shot.size);
        let pixel = at.min(Vec2::splat(shot.size as f32 - 1.0)).as_uvec2();
        match shot.faces[face].point[(pixel.y * shot.size + pixel.x) as usize] {
            NO_POINT => (Vec3::ZERO, 0.0),
            point => (colors(point), 1.0),
        }
    };
    (Pyramid::new(side, side, count, texel), around)
}

/// The photo at an exposure, clamped (Eq. 1).
pub(crate) fn photo_pyramid(photo: &Picture, alpha: f32, size: u32) -> Pyramid {
    let texel = |x, y| ((photo.at(x, y) * alpha).min(Vec3::ONE), 1.0);
    Pyramid::new(photo.width, photo.height, levels(size), texel)
}

/// Pixels that show an over-exposed point, and those beside them.
pub(crate) fn wanted(shot: &Shot, face: usize, over: &[bool]) -> Vec<bool> {
    let size = shot.size as i32;
    let points = &shot.faces[face].point;
    let is_over = |x: i32, y: i32| {
        let inside = (0..size).contains(&x) && (0..size).contains(&y);
        inside && over.get(points[(y * size + x) as usize] as usize).copied().unwrap_or(false)
    };
    let border = BORDER as i32;
    let near = |n: i32| {
        let (x, y) = (n % size, n / size);
        points[n as usize] != NO_POINT
            && (-border..=border).any(|dy| (-border..=border).any(|dx| is_over(x + dx, y + dy)))
    };
    (0..size * size).into_par_iter().map(near).collect()
}
