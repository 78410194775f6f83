//! An object in the light of lamps: its shadow, and the light that comes to it straight from them.

use std::sync::Arc;

use ash::vk;

use super::convolve::MaterialChoice;
use super::gbuffer::{GBuffer, Rect};
use super::lamp_view::{LampPass, LampViewPass};
use super::operator::Operator;
use crate::Result;
use crate::gpu::pipeline::Sampler;
use crate::gpu::{Bindings, Buffer, Constant, Context, Recorder};

/// The pass.
pub struct LampObjectPass {
    occlude: Operator,
    shade: Operator,
    /// Radiance, and 1 where the object is, a pixel of a region.
    radiance: Buffer,
    material: MaterialChoice,
}

/// Where the object is drawn.
pub struct LampObjectTargets {
    /// From a lamp.
    pub lamp: GBuffer,
    /// A region of the camera's image.
    pub camera: GBuffer,
    nearest: Sampler,
}

impl LampObjectTargets {
    /// For lamps' views of `size` x `size` pixels, and regions of the camera's image.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, size: u32, (width, height): (u32, u32)) -> Result<Self> {
        Ok(Self {
            lamp: GBuffer::new(context, size, size)?,
            camera: GBuffer::new(context, width, height)?,
            nearest: Sampler::new(context, vk::Filter::NEAREST, vk::SamplerAddressMode::CLAMP_TO_EDGE)?,
        })
    }

    /// Whether regions of that size fit.
    pub fn hold(&self, (width, height): (u32, u32)) -> bool {
        width <= self.camera.position.width && height <= self.camera.position.height
    }

    fn bindings<'a>(&'a self, from: &'a GBuffer) -> Bindings<'a> {
        let sampler = self.nearest.handle;
        Bindings::new()
            .sampled("position_map", &from.position, sampler)
            .sampled("normal_map", &from.normal, sampler)
            .sampled("base_metallic_map", &from.base_metallic, sampler)
            .sampled("emissive_roughness_map", &from.emissive_roughness, sampler)
    }
}

impl LampObjectPass {
    /// Makes the pipelines for an object that is drawn into `targets`.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(
        context: &Arc<Context>,
        views: &LampViewPass,
        targets: &LampObjectTargets,
        material: MaterialChoice,
    ) -> Result<Self> {
        let pixels = u64::from(targets.camera.position.width) * u64::from(targets.camera.position.height);
        let radiance = Buffer::with_texels(context, "lamps on object", pixels * 16, vk::Format::R32G32B32A32_SFLOAT)?;
        let occlude = views.bindings().and(targets.bindings(&targets.lamp)).and(views.output_bindings());
        let shade = views.bindings().and(targets.bindings(&targets.camera)).buffer("output_image", &radiance);
        let constants = [Constant::new(8, material.code())];
        Ok(Self {
            occlude: Operator::new(context, "lamp_object/occlude.comp", &[], &occlude)?,
            shade: Operator::new(context, "lamp_object/shade.comp", &constants, &shade)?,
            radiance,
            material,
        })
    }

    /// Changes an albedo, which no pipeline depends on; false where another pass is needed, and nothing is changed then.
    pub fn set_material(&mut self, material: MaterialChoice) -> bool {
        let fits = material.same_passes(self.material);
        if fits {
            self.material = material;
        }
        fits
    }

    /// Puts the object, drawn from the lamp, into view `pass.view` of the atlas.
    ///
    /// # Errors
    /// When the view is larger than a dispatch.
    pub fn occlude(&self, recorder: &mut Recorder, pass: LampPass) -> Result<()> {
        self.occlude.record(recorder, "object before lamp", &pass, pass.light_size * pass.light_size)
    }

    /// Light of the lamps on the object, drawn from the camera of `pass` into a region of that size.
    ///
    /// # Errors
    /// When the region is larger than a dispatch.
    pub fn shade(&self, recorder: &mut Recorder, pass: LampPass, Rect { width, height, .. }: Rect) -> Result<()> {
        let pass = LampPass { width, height, material: self.material.parameter(), ..pass };
        self.shade.record(recorder, "lamps on object", &pass, width * height)
    }

    /// What [`LampObjectPass::shade`] made of a region of that size.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn radiance(&self, Rect { width, height, .. }: Rect) -> Result<Vec<[f32; 4]>> {
        self.radiance.download(width as usize * height as usize)
    }
}
