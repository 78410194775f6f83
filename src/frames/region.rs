//! Parts of an image, and what an object takes of it.

use glam::Vec3;

use crate::Result;
use crate::gpu::{Image, Use};
use crate::passes::gbuffer::Rect;
use crate::scene::{Camera, Vertex};

/// A sphere around an object.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    centre: Vec3,
    radius: f32,
}

impl Bounds {
    /// Around the box that holds all vertices.
    pub(super) fn of(vertices: &[Vertex]) -> Self {
        let nothing = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (low, high) = vertices.iter().fold(nothing, |(low, high), v| (low.min(v.position), high.max(v.position)));
        Self { centre: 0.5 * (low + high), radius: 0.5 * (high - low).length() }
    }

    /// Whether the eye is in it, or nearly.
    pub(super) fn hold(&self, camera: &Camera) -> bool {
        camera.from.distance(self.centre) <= self.radius * 1.01
    }

    /// Nearest and farthest depth of the object, metres.
    pub(super) fn depth_range(&self, camera: &Camera) -> (f32, f32) {
        let distance = camera.from.distance(self.centre);
        let far = (distance + self.radius) * 1.01 + 1e-6;
        (((distance - self.radius) * 0.99).max(far * 1e-4), far)
    }
}

impl Rect {
    /// Whether a pixel of the image is in it.
    pub(super) fn holds(&self, x: u32, y: u32) -> bool {
        (self.x..self.x + self.width).contains(&x) && (self.y..self.y + self.height).contains(&y)
    }

    /// Index in an image of the given width of the rectangle's `i`th pixel.
    pub(super) fn index(&self, i: u32, width: u32) -> usize {
        ((self.y + i / self.width) * width + self.x + i % self.width) as usize
    }
}

/// All texels of a G-buffer's image.
pub(super) fn read_image<T: bytemuck::Pod>(image: &Image) -> Result<Vec<T>> {
    Ok(bytemuck::pod_collect_to_vec(&image.download(Use::SampledRead, size_of::<T>())?))
}
