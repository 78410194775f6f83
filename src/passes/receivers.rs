//! The cone mipmap of the G-buffer: receivers of five levels, pixels to 16 x 16 tiles (Sabbadin 2019, 5.2.1).

use std::sync::Arc;

use ash::vk;

use super::gbuffer::GBuffer;
use super::{ImageRegion, Receiver};
use crate::Result;
use crate::gpu::pipeline::{ComputePipeline, DescriptorSet, Sampler};
use crate::gpu::{Bindings, Buffer, Context, Recorder, Use};

/// Receivers of an image region.
pub struct Receivers {
    /// Centre and radius of the positions, by slot; the radius is negative where nothing is covered.
    pub spheres: Buffer,
    /// Axis and cosine of the half aperture of the normals, by slot.
    pub cones: Buffer,
    coverage: Buffer,
    /// Pixel slots.
    pub pixels: u32,
    /// Tiles in a row.
    pub tiles_x: u32,
}

/// Bytes of receivers a pixel slot, levels above included, rounded up.
pub const BYTES_PER_PIXEL: u64 = 43;

impl Receivers {
    /// Buffers for a region.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, width: u32, height: u32) -> Result<Self> {
        let tiles_x = width.div_ceil(16);
        let pixels = tiles_x * height.div_ceil(16) * 256;
        let bytes = u64::from(Receiver::slots(pixels)) * 16;
        Ok(Self {
            spheres: Buffer::with_texels(context, "receiver spheres", bytes, vk::Format::R32G32B32A32_SFLOAT)?,
            cones: Buffer::with_texels(context, "receiver cones", bytes, vk::Format::R32G32B32A32_SFLOAT)?,
            coverage: Buffer::new(context, "coverage", u64::from(pixels / 8))?,
            pixels,
            tiles_x,
        })
    }

    /// The receiver buffers under the names that shaders use.
    pub fn bindings<'a>(&'a self, others: Bindings<'a>) -> Bindings<'a> {
        others
            .buffer("ReceiverSpheres", &self.spheres)
            .buffer("ReceiverCones", &self.cones)
            .buffer("receiver_spheres", &self.spheres)
            .buffer("receiver_cones", &self.cones)
    }

    /// Covered pixels, one bit each in Morton order, eight words a tile.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn read_coverage(&self) -> Result<Vec<[u32; 8]>> {
        self.coverage.download(self.pixels as usize / 256)
    }
}

/// The pass.
pub struct ReceiverPass {
    pipeline: ComputePipeline,
}

impl ReceiverPass {
    /// Makes the pipeline.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(context: &Arc<Context>) -> Result<Self> {
        Ok(Self { pipeline: ComputePipeline::new(context, "receivers/receivers.comp", &[])? })
    }

    /// Records the pass; the returned set must live until the submission is done.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        gbuffer: &GBuffer,
        receivers: &Receivers,
        nearest: &Sampler,
    ) -> Result<DescriptorSet> {
        let bindings = receivers
            .bindings(Bindings::new())
            .buffer("Coverage", &receivers.coverage)
            .sampled("position_map", &gbuffer.position, nearest.handle)
            .sampled("normal_map", &gbuffer.normal, nearest.handle);
        let set = self.pipeline.bind(&bindings)?;
        let region = ImageRegion {
            width: gbuffer.position.width,
            height: gbuffer.position.height,
            tiles_x: receivers.tiles_x,
            pixels: receivers.pixels,
        };
        recorder
            .pass("receivers", |_, commands| self.pipeline.dispatch(commands, &set, &region, receivers.pixels / 4))?;
        recorder.count("pixels", u64::from(receivers.pixels));
        recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeRead, Use::FeedbackTurn, Use::CopySource]);
        Ok(set)
    }
}
