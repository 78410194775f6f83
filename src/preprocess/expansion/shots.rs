//! Shots: cubemaps of the cloud in its own colours (Sabbadin 2019, 4.1), rendered on the CPU.
//!
//! Points are splatted as discs in their tangent planes (Zwicker et al. 2001, without the filter), wide enough to close
//! the surface. Depth is settled first; among the discs that lie on the front surface the one whose centre is nearest
//! wins, so that a point is seen where it is and not where its neighbour's rim is.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use super::point_shots;
use crate::scene::Cloud;

/// What no splat covers.
pub const NO_POINT: u32 = u32::MAX;

/// A disc of this many spacings as its radius closes a surface whose points lie at random.
const RADIUS: f32 = 1.1;
/// Discs seen more obliquely than this cosine are drawn as if seen at it, or a rough wall seen from the side has holes.
const LEAST_COSINE: f32 = 0.15;
/// Half the side of the smallest splat in pixels: no smaller than a pixel, so that distant surfaces close.
const LEAST_PIXELS: f32 = 0.71;
/// Half the side of the largest splat in pixels; a point nearer to the eye is no part of a picture.
const MOST_PIXELS: f32 = 96.0;
/// Discs at most this much farther than the nearest belong to the front surface; relative to depth, and in spacings.
const SAME_SURFACE: (f32, f32) = (0.01, 1.0);
/// From where a pixel is wider than this many spacings, a place is too far away to see anything.
const FARTHEST: f32 = 64.0;
/// Points of one parallel task.
const CHUNK: usize = 1 << 14;

/// The six faces in the order of OpenGL and Vulkan: +X, -X, +Y, -Y, +Z, -Z; columns are (right, down, forward). Each is
/// what a camera there would take; a cubemap of those libraries is its mirror image, in which no patch of a photo could
/// be found by turning it.
pub const FACES: [Mat3; 6] = [
    Mat3::from_cols(Vec3::Z, Vec3::NEG_Y, Vec3::X),
    Mat3::from_cols(Vec3::NEG_Z, Vec3::NEG_Y, Vec3::NEG_X),
    Mat3::from_cols(Vec3::X, Vec3::NEG_Z, Vec3::Y),
    Mat3::from_cols(Vec3::X, Vec3::Z, Vec3::NEG_Y),
    Mat3::from_cols(Vec3::NEG_X, Vec3::NEG_Y, Vec3::Z),
    Mat3::from_cols(Vec3::X, Vec3::NEG_Y, Vec3::NEG_Z),
];

/// The face that looks along `direction`, and where on it, in pixels of a face of `size`; the pixel (0, 0) has its
/// centre at (0.5, 0.5).
pub fn project(direction: Vec3, size: u32) -> (usize, Vec2) {
    let magnitude = direction.abs();
    let face = if magnitude.x >= magnitude.y && magnitude.x >= magnitude.z {
        usize::from(direction.x < 0.0)
    } else if magnitude.y >= magnitude.z {
        2 + usize::from(direction.y < 0.0)
    } else {
        4 + usize::from(direction.z < 0.0)
    };
    let view = FACES[face].transpose() * direction;
    let half = 0.5 * size as f32;
    (face, Vec2::new(view.x, view.y) / view.z * half + half)
}

/// Direction, not of unit length, through a place on a face; the inverse of [`project`], also beyond the face's edge.
pub fn direction(face: usize, at: Vec2, size: u32) -> Vec3 {
    let half = 0.5 * size as f32;
    FACES[face] * ((at - half) / half).extend(1.0)
}

/// How shots are rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ShotsBy {
    /// Points as discs in their tangent planes.
    #[default]
    Splats,
    /// Points of a pixel each, and the operators that make a surface of them (Bouchiba et al. 2018).
    Points,
}

/// A cubemap of the cloud from one place.
#[derive(Clone, Debug)]
pub struct Shot {
    /// The eye, in the space of [`Cloud::positions`].
    pub eye: Vec3,
    /// Pixels along a side of a face.
    pub size: u32,
    /// The faces, as [`FACES`].
    pub faces: Vec<Face>,
}

/// One face: `size * size` values each, row by row from the top.
#[derive(Clone, Debug)]
pub struct Face {
    /// Index of the front point; [`NO_POINT`] where there is none.
    pub point: Vec<u32>,
    /// Depth of the front surface along the face's axis, metres; infinite where there is none.
    pub depth: Vec<f32>,
}

impl Shot {
    /// Takes a shot.
    pub fn take(cloud: &Cloud, eye: Vec3, size: u32, by: ShotsBy) -> Self {
        let pane = |axes| Pane { eye, axes, size: [size; 2], focal: 0.5 * size as f32 };
        let render = match by {
            ShotsBy::Splats => render,
            ShotsBy::Points => point_shots::render,
        };
        let faces = FACES.iter().map(|&axes| render(cloud, &pane(axes))).collect();
        Self { eye, size, faces }
    }

    /// Where a point is seen: (face, index of its pixel); `None` where something else is in front of it.
    pub fn sees(&self, position: Vec3, spacing: f32) -> Option<(usize, usize)> {
        let to = position - self.eye;
        let (face, at) = project(to, self.size);
        // Truncates; a place on the far edge belongs to the last pixel. A point in the eye has no place.
        let pixel = at.min(Vec2::splat(self.size as f32 - 1.0)).as_uvec2();
        let index = pixel.y as usize * self.size as usize + pixel.x as usize;
        let depth = to.dot(FACES[face].z_axis);
        let front = self.faces[face].depth[index];
        let pixel = 2.0 * depth / self.size as f32;
        let is_near = depth > 0.0 && pixel <= FARTHEST * spacing;
        (at.is_finite() && is_near && depth <= behind(front, spacing)).then_some((face, index))
    }
}

/// The farthest depth that still belongs to the surface at `front`.
fn behind(front: f32, spacing: f32) -> f32 {
    front * (1.0 + SAME_SURFACE.0) + SAME_SURFACE.1 * spacing
}

/// What an eye sees through a rectangle: a pinhole camera with square pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pane {
    pub(super) eye: Vec3,
    /// (right, down, forward).
    pub(super) axes: Mat3,
    pub(super) size: [u32; 2],
    /// Distance to the pane in pixels.
    pub(super) focal: f32,
}

impl Pane {
    /// Direction, not of unit length, through the centre of a pixel, in the pane's space.
    pub(super) fn ray(&self, x: u32, y: u32) -> Vec3 {
        let pixel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        ((pixel - self.middle()) / self.focal).extend(1.0)
    }

    pub(super) fn middle(&self) -> Vec2 {
        0.5 * Vec2::from(self.size.map(|side| side as f32))
    }
}

/// A disc as a pane shows it.
struct Splat {
    /// Centre in pixels.
    at: Vec2,
    /// Pixels to walk over: first and one past the last, x and y.
    from: [u32; 2],
    to: [u32; 2],
    /// Centre, normal (towards the eye) and radius, in the pane's space.
    centre: Vec3,
    normal: Vec3,
    radius: f32,
}

impl Splat {
    fn new(cloud: &Cloud, index: usize, pane: &Pane) -> Option<Self> {
        let to_view = pane.axes.transpose();
        let centre = to_view * (cloud.positions[index] - pane.eye);
        let radius = RADIUS * cloud.spacing[index];
        let pixels = radius / centre.z * pane.focal;
        if centre.z <= 0.0 || pixels > MOST_PIXELS {
            return None;
        }
        let at = Vec2::new(centre.x, centre.y) / centre.z * pane.focal + pane.middle();
        // Away from the middle of a pane a disc is stretched, by at most this.
        let reach = pixels.max(LEAST_PIXELS) * (centre.length() / centre.z);
        let clamp = |v: Vec2| v.clamp(Vec2::ZERO, 2.0 * pane.middle()).as_uvec2().to_array();
        let (from, to) = (clamp((at - reach - 0.5).ceil()), clamp((at + reach - 0.5).floor() + 1.0));
        if from[0] >= to[0] || from[1] >= to[1] {
            return None;
        }
        Some(Self { at, from, to, centre, normal: facing(to_view * cloud.normals[index], centre), radius })
    }

    /// Calls `f` with the index of every pixel under the disc, the depth there and how far from the centre it is, from
    /// 0 to 1.
    fn for_each(&self, pane: &Pane, mut f: impl FnMut(usize, f32, f32)) {
        let plane = self.normal.dot(self.centre);
        for y in self.from[1]..self.to[1] {
            for x in self.from[0]..self.to[0] {
                let ray = pane.ray(x, y);
                // At most one disc's radius before or behind the centre: a grazing plane goes anywhere.
                let depth =
                    (plane / self.normal.dot(ray)).clamp(self.centre.z - self.radius, self.centre.z + self.radius);
                let off = (ray * depth).distance(self.centre) / self.radius;
                let square = (Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - self.at).abs().max_element() / LEAST_PIXELS;
                let distance = off.min(square);
                if distance <= 1.0 {
                    f((y * pane.size[0] + x) as usize, depth, distance);
                }
            }
        }
    }
}

/// A normal turned towards the eye, and tilted so that its plane is not seen more obliquely than [`LEAST_COSINE`].
fn facing(normal: Vec3, centre: Vec3) -> Vec3 {
    let view = -centre.normalize();
    let normal = if normal.dot(view) < 0.0 { -normal } else { normal };
    let cosine = normal.dot(view);
    if cosine >= LEAST_COSINE {
        return normal;
    }
    let tangent = (normal - view * cosine).normalize_or(view.any_orthonormal_vector());
    view * LEAST_COSINE + tangent * (1.0 - LEAST_COSINE * LEAST_COSINE).sqrt()
}

/// Minima commute: the result is the same whatever the order in which points arrive.
pub(super) fn render(cloud: &Cloud, pane: &Pane) -> Face {
    let pixels = pane.size[0] as usize * pane.size[1] as usize;
    // Bits of positive floats order as the floats do.
    let nearest: Vec<AtomicU32> = (0..pixels).map(|_| AtomicU32::new(f32::INFINITY.to_bits())).collect();
    let splats = |f: &(dyn Fn(usize, &Splat) + Sync)| {
        (0..cloud.len().div_ceil(CHUNK)).into_par_iter().for_each(|chunk| {
            for index in chunk * CHUNK..((chunk + 1) * CHUNK).min(cloud.len()) {
                if let Some(splat) = Splat::new(cloud, index, pane) {
                    f(index, &splat);
                }
            }
        });
    };
    splats(&|_, splat| {
        splat.for_each(pane, |pixel, depth, _| {
            nearest[pixel].fetch_min(depth.max(0.0).to_bits(), Ordering::Relaxed);
        });
    });
    let depth: Vec<f32> = nearest.into_iter().map(|bits| f32::from_bits(bits.into_inner())).collect();
    let front: Vec<AtomicU64> = (0..pixels).map(|_| AtomicU64::new(u64::MAX)).collect();
    splats(&|index, splat| {
        splat.for_each(pane, |pixel, at, distance| {
            if at <= behind(depth[pixel], cloud.spacing[index]) {
                front[pixel].fetch_min(u64::from(distance.to_bits()) << 32 | index as u64, Ordering::Relaxed);
            }
        });
    });
    // The lower half of what was never written is NO_POINT.
    let point = front.into_iter().map(|key| key.into_inner() as u32).collect();
    Face { point, depth }
}
