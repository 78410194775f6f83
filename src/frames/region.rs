//! Parts of an image, and what an object takes of it.

use glam::Vec3;

use super::Frame;
use super::tile_map::pixel_place;
use crate::Result;
use crate::gpu::{Buffer, Image, Use};
use crate::passes::Receiver;
use crate::passes::bin::CutLists;
use crate::passes::gbuffer::{GBuffer, Rect};
use crate::passes::receivers::Receivers;
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

/// The images and buffers of one image region.
pub(super) struct Region {
    pub(super) rect: Rect,
    /// The part of it that is lit; what lies around it only helps to light it.
    pub(super) core: Rect,
    pub(super) gbuffer: GBuffer,
    pub(super) receivers: Receivers,
    pub(super) lists: CutLists,
    pub(super) output: Buffer,
    /// What narrow lobes add to it.
    pub(super) lobe_output: Option<Buffer>,
}

impl Region {
    /// Whether a receiver is lit here.
    pub(super) fn is_core(&self, receiver: Receiver) -> bool {
        let (x, y) = pixel_place(receiver.pixels().start, self.receivers.tiles_x);
        self.core.holds(self.rect.x + x, self.rect.y + y)
    }

    /// Index in the image of a pixel slot.
    pub(super) fn pixel_of(&self, slot: u32, width: u32) -> u32 {
        let (x, y) = pixel_place(slot, self.receivers.tiles_x);
        (self.rect.y + y) * width + self.rect.x + x
    }

    /// Reads a finished region into the frame.
    pub(super) fn collect(&self, frame: &mut Frame) -> Result<()> {
        let pixels = self.rect.width as usize * self.rect.height as usize;
        let mut output: Vec<[f32; 4]> = self.output.download(pixels)?;
        if let Some(lobes) = &self.lobe_output {
            let added: Vec<[f32; 4]> = lobes.download(pixels)?;
            output.iter_mut().zip(added).for_each(|(sum, more)| (0..3).for_each(|c| sum[c] += more[c]));
        }
        let position: Vec<[f32; 4]> = read_image(&self.gbuffer.position)?;
        let normal: Vec<[f32; 4]> = read_image(&self.gbuffer.normal)?;
        let albedo: Vec<[half::f16; 4]> = read_image(&self.gbuffer.base_metallic)?;
        let Rect { width, x, y, .. } = self.rect;
        for i in (0..pixels).filter(|i| self.core.holds(x + *i as u32 % width, y + *i as u32 / width)) {
            let at = self.rect.index(i as u32, frame.width);
            frame.rgba[at] = output[i];
            frame.position[at] = position[i];
            frame.normal[at] = normal[i];
            frame.albedo[at] = albedo[i].map(half::f16::to_f32);
        }
        Ok(())
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
