//! Shots are expanded by what the photo has in places that look alike (Sabbadin 2019, 4.1, the third strategy).

use glam::{UVec2, Vec2, Vec3};
use rayon::prelude::*;

use super::patchmatch::{self, RADIUS};
use super::pyramid::Pyramid;
use super::reprojection::Expanded;
use super::shots::{NO_POINT, Shot, direction, project};
use crate::scene::{Cloud, Picture};

/// Pixels around what is over-exposed that are matched too: an over-exposed point may be seen in one of them.
const BORDER: u32 = 2;
/// The coarsest level of a face is at most this wide: a patch then covers half of what the eye sees on one side.
const COARSEST: u32 = 16;

/// Faces and photos are matched at the first of their pyramid's levels that is no larger than this. Finer ones tell
/// nothing more about lights, and dilute what tells a lamp from a window.
const MATCHED: u32 = 512;
/// The same for the longer side of the photo, which shows less of the place.
const MATCHED_PHOTO: u32 = 1024;

/// Halvings that bring a side down to `most`.
fn halvings(side: u32, most: u32) -> u32 {
    (0..32).find(|&n| side.div_ceil(1 << n) <= most).unwrap_or(0)
}

/// Levels of the pyramids over a face that is matched at `size`, and over the photo.
fn levels(size: u32) -> usize {
    (size.max(COARSEST) / COARSEST).ilog2() as usize + 1
}

/// The photo at an exposure.
pub(super) struct Exposed {
    /// Clamped (Eq. 1).
    clamped: Pyramid,
    /// Not clamped, and without the mixed pixels around lights: see [`unmixed`].
    lights: Picture,
}

impl Exposed {
    pub(super) fn new(photo: &Picture, alpha: f32, shot_size: u32) -> Self {
        let mut small = photo.clone();
        for _ in 0..halvings(photo.width.max(photo.height), MATCHED_PHOTO) {
            small = halved(&small);
        }
        let lights = unmixed(&small, alpha);
        let texel = |x, y| ((small.at(x, y) * alpha).min(Vec3::ONE), 1.0);
        let count = levels(shot_size >> halvings(shot_size, MATCHED));
        Self { clamped: Pyramid::new(small.width, small.height, count, texel).bounded(), lights }
    }

    pub(super) fn size(&self) -> UVec2 {
        UVec2::new(self.lights.width, self.lights.height)
    }
}

/// Means of 2 x 2 pixels; a last odd row or column is left out.
fn halved(picture: &Picture) -> Picture {
    let (width, height) = ((picture.width / 2).max(1), (picture.height / 2).max(1));
    let mean = |n: u32| {
        let (x, y) = (2 * (n % width), 2 * (n / width));
        let (right, below) = ((x + 1).min(picture.width - 1), (y + 1).min(picture.height - 1));
        0.25 * (picture.at(x, y) + picture.at(right, y) + picture.at(x, below) + picture.at(right, below))
    };
    Picture { width, height, rgb: (0..width * height).into_par_iter().map(mean).collect() }
}

/// How far a pixel on the rim of a light looks for one inside of it.
const RIM: i32 = 2;

/// The photo at an exposure, where pixels on the rim of what clips have the value of the nearest clipped pixel that is
/// not on the rim. A pixel on a lamp's edge mixes lamp and wall, and clips all the same; the points of a cloud mix
/// nothing, so that lamps would lose an eighth of their light to their rims.
fn unmixed(photo: &Picture, alpha: f32) -> Picture {
    let (width, height) = (photo.width as i32, photo.height as i32);
    let clips = |x: i32, y: i32| {
        let inside = photo.at(x.clamp(0, width - 1) as u32, y.clamp(0, height - 1) as u32);
        inside.max_element() * alpha >= 1.0
    };
    let is_inner = |x: i32, y: i32| (-1..=1).all(|dy| (-1..=1).all(|dx| clips(x + dx, y + dy)));
    let value = |n: usize| {
        let (x, y) = (n as i32 % width, n as i32 / width);
        let own = photo.rgb[n] * alpha;
        if !clips(x, y) || is_inner(x, y) {
            return own;
        }
        let around = (-RIM..=RIM).flat_map(|dy| (-RIM..=RIM).map(move |dx| (dx * dx + dy * dy, x + dx, y + dy)));
        let inner = around.filter(|&(_, x, y)| (0..width).contains(&x) && (0..height).contains(&y) && is_inner(x, y));
        inner.min().map_or(own, |(_, x, y)| photo.at(x as u32, y as u32) * alpha)
    };
    Picture { width: photo.width, height: photo.height, rgb: (0..photo.rgb.len()).into_par_iter().map(value).collect() }
}

/// A face with what lies around it, as wide as patches of the coarsest level reach, from the level that is matched on;
/// (pyramid, pixels of that level around the face).
fn face_pyramid(cloud: &Cloud, shot: &Shot, face: usize) -> (Pyramid, u32) {
    let skipped = halvings(shot.size, MATCHED);
    let count = levels(shot.size >> skipped);
    let around = (RADIUS as u32) << (count - 1);
    let side = shot.size + 2 * (around << skipped);
    let texel = |x: u32, y: u32| {
        let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - (around << skipped) as f32;
        let (face, at) = project(direction(face, at, shot.size), shot.size);
        let pixel = at.min(Vec2::splat(shot.size as f32 - 1.0)).as_uvec2();
        match shot.faces[face].point[(pixel.y * shot.size + pixel.x) as usize] {
            NO_POINT => (Vec3::ZERO, 0.0),
            point => (cloud.colors[point as usize].min(Vec3::ONE), 1.0),
        }
    };
    let mut pyramid = Pyramid::new(side, side, count + skipped as usize, texel);
    pyramid.levels.drain(..skipped as usize);
    (pyramid, around)
}

/// Matches count by the inverse square of their cost; one of no cost would count for everything.
const LEAST_COST: f32 = 0.05;

/// Expands the pixels of a face that are wanted; (expanded face, patches that were compared).
pub(super) fn expand(
    (cloud, shot, face): (&Cloud, &Shot, usize),
    photo: &Exposed,
    wanted: &[bool],
    match_threshold: f32,
    seed: u64,
) -> (Expanded, u64) {
    let (pyramid, around) = face_pyramid(cloud, shot, face);
    let shrink = halvings(shot.size, MATCHED);
    let side = shot.size.div_ceil(1 << shrink);
    let mut small = vec![false; (side * side) as usize];
    let of = |pixel: usize| {
        let (x, y) = (pixel as u32 % shot.size, pixel as u32 / shot.size);
        ((y >> shrink) * side + (x >> shrink)) as usize
    };
    for pixel in (0..wanted.len()).filter(|&n| wanted[n]) {
        small[of(pixel)] = true;
    }
    let options = patchmatch::Options { seed: seed.wrapping_add(face as u64), ..patchmatch::Options::default() };
    let field = patchmatch::search((&pyramid, around, (side, side)), &photo.clamped, &small, &options);
    let last = (photo.size() - 1).as_vec2();
    let value = |found: &patchmatch::Match| {
        if found.cost > match_threshold {
            return (Vec3::ZERO, 0.0);
        }
        let at = found.at.round().clamp(Vec2::ZERO, last).as_uvec2();
        (photo.lights.at(at.x, at.y), 1.0 / (found.cost + LEAST_COST).powi(2))
    };
    let found = |pixel: usize| &field.matches[of(pixel)];
    let (colors, weights) = (0..wanted.len()).into_par_iter().map(|pixel| value(found(pixel))).unzip();
    let costs = (0..wanted.len()).map(|pixel| found(pixel).cost).collect();
    let size = photo.size().as_vec2();
    let places = (0..wanted.len()).map(|pixel| (found(pixel).at + 0.5) / size).collect();
    (Expanded { colors, weights, costs, places }, field.compared)
}

/// Pixels that show an over-exposed point, and those beside them.
pub(super) fn wanted(shot: &Shot, face: usize, over: &[bool]) -> Vec<bool> {
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
