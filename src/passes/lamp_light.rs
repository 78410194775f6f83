//! Light at the camera's pixels: direct by the lamps' shadow maps, bounced by virtual point lights with interleaved
//! sampling, and the picture of both (Preiner 2010, 3 and 4.4).

use std::sync::Arc;

use ash::vk;

use super::ism::IsmPass;
use super::lamp_view::{LampPass, LampViewPass};
use super::operator::Operator;
use super::surfel_view::SurfelViewPass;
use super::vpl::VplBuffers;
use crate::Result;
use crate::gpu::pipeline::DescriptorSet;
use crate::gpu::{Bindings, Buffer, Constant, Context, Recorder};

/// Invocations of a workgroup of `gather.comp`, whose parts of the image begin at a whole one.
const GROUP: u32 = 64;

/// The pass for images of one size.
pub struct LampLightPass {
    context: Arc<Context>,
    /// What it has found.
    pub images: LightImages,
    direct_light: Operator,
    gather: Operator,
    /// By which lights are the present ones.
    gather_sets: [DescriptorSet; 2],
    compose: Operator,
}

/// Light at all pixels.
pub struct LightImages {
    /// Radiance, and depth along the view in metres or 0, a pixel.
    pub lit: Buffer,
    /// Irradiance straight from the lamps, a pixel.
    pub direct: Buffer,
    /// Irradiance of all bounces after the filter, a pixel.
    pub bounced: Buffer,
    /// The same before the filter.
    pub sums: Buffer,
    /// Radiance of all mirror lobes, a pixel.
    pub lobes: Buffer,
}

impl LightImages {
    fn new(context: &Arc<Context>, width: u32, height: u32) -> Result<Self> {
        let bytes = u64::from(width) * u64::from(height) * 16;
        let buffer = |name| Buffer::with_texels(context, name, bytes, vk::Format::R32G32B32A32_SFLOAT);
        Ok(Self {
            lit: buffer("lit points")?,
            direct: buffer("direct light")?,
            bounced: buffer("bounced light")?,
            sums: buffer("light of all bounces")?,
            lobes: buffer("mirrored light")?,
        })
    }

    fn bindings(&self) -> Bindings<'_> {
        Bindings::new()
            .buffer("direct_out", &self.direct)
            .buffer("direct_in", &self.direct)
            .buffer("bounced", &self.sums)
            .buffer("bounced_in", &self.sums)
            .buffer("bounced_out", &self.sums)
            .buffer("glossy", &self.lobes)
            .buffer("glossy_in", &self.lobes)
            .buffer("glossy_out", &self.lobes)
            .buffer("lit_out", &self.lit)
            .buffer("smooth_out", &self.bounced)
    }
}

impl LampLightPass {
    /// Makes buffers and pipelines for a camera whose G-buffer is in `surface`; `glossy` where surfaces have mirror
    /// lobes.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(
        context: &Arc<Context>,
        (surface, width, height): (&SurfelViewPass, u32, u32),
        lights: &VplBuffers,
        (views, ism): (&LampViewPass, &IsmPass),
        glossy: bool,
    ) -> Result<Self> {
        let images = LightImages::new(context, width, height)?;
        let constants = [Constant::new(0, glossy)];
        let bindings = |now: usize| bindings((surface, &images), (lights, now), (views, ism));
        let direct_light = Operator::new(context, "lamp_light/direct.comp", &constants, &bindings(0))?;
        let gather = Operator::new(context, "lamp_light/gather.comp", &constants, &bindings(0))?;
        let gather_sets = [gather.set(&bindings(0))?, gather.set(&bindings(1))?];
        let compose = Operator::new(context, "lamp_light/compose.comp", &[], &bindings(0))?;
        Ok(Self { context: context.clone(), images, direct_light, gather, gather_sets, compose })
    }

    /// Lights a camera's G-buffer of another size from now on.
    ///
    /// # Errors
    /// When buffers of that size do not fit the device.
    pub fn bind(
        &mut self,
        (surface, width, height): (&SurfelViewPass, u32, u32),
        lights: &VplBuffers,
        (views, ism): (&LampViewPass, &IsmPass),
    ) -> Result<()> {
        self.images = LightImages::new(&self.context, width, height)?;
        let bindings = |now: usize| bindings((surface, &self.images), (lights, now), (views, ism));
        self.direct_light.bind(&bindings(0))?;
        self.gather.bind(&bindings(0))?;
        self.gather_sets = [self.gather.set(&bindings(0))?, self.gather.set(&bindings(1))?];
        self.compose.bind(&bindings(0))
    }

    /// Direct light; empties the sums of bounces.
    ///
    /// # Errors
    /// When the image is larger than a dispatch.
    pub fn direct(&self, recorder: &mut Recorder, pass: LampPass) -> Result<()> {
        self.direct_light.record(recorder, "direct light", &pass, pass.pixels())
    }

    /// Adds what the lights in buffer `now` send to every pixel.
    ///
    /// # Errors
    /// When the image is larger than a dispatch.
    pub fn gather(&self, recorder: &mut Recorder, pass: LampPass, now: usize) -> Result<()> {
        let part = pass.width.div_ceil(pass.interleave) * pass.height.div_ceil(pass.interleave);
        let invocations = pass.interleave * pass.interleave * part.next_multiple_of(GROUP);
        self.gather.record_with(recorder, "gather lights", &self.gather_sets[now], &[(pass, invocations)])
    }

    /// The picture.
    ///
    /// # Errors
    /// When the image is larger than a dispatch.
    pub fn compose(&self, recorder: &mut Recorder, pass: LampPass) -> Result<()> {
        self.compose.record(recorder, "compose light", &pass, pass.pixels())
    }
}

/// Everything that the shaders read and write, with the lights of buffer `now`.
fn bindings<'a>(
    (surface, images): (&'a SurfelViewPass, &'a LightImages),
    (lights, now): (&'a VplBuffers, usize),
    (views, ism): (&'a LampViewPass, &'a IsmPass),
) -> Bindings<'a> {
    Bindings::new()
        .and(views.bindings())
        .and(surface.bindings())
        .buffer("vpl", &lights.lights[now])
        .buffer("ism", &ism.depths)
        .and(images.bindings())
}
