//! An object in the light of a probe: irradiance of its vertices by precomputed transfer, G-buffer, reflection
//! (Hajisharif et al. 2012, 3.7).

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use ash::vk;
use bytemuck::{Pod, Zeroable};
use glam::DMat3;

use super::convolve::MaterialChoice;
use super::gbuffer::{GBuffer, GBufferPass, View};
use super::probe_light::ProbeLight;
use crate::gpu::pipeline::{DescriptorSet, Sampler};
use crate::gpu::{Buffer, ComputePipeline, Constant, Context, Recorder, Use};
use crate::preprocess::transfer::Transfer;
use crate::scene::harmonics::{MOST_COEFFICIENTS, rotation};
use crate::scene::{Camera, Object, Vertex};
use crate::{Error, Result};

/// Push constants of the vertices' irradiance (`glsl/shared/transfer.glsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct TransferConstants {
    /// Vertices of the object.
    pub vertices: u32,
    /// Invocations; each does its own vertex and those that lie so many, and multiples of it, behind it.
    pub invocations: u32,
}

/// Vertices of an invocation (`irradiance.comp`).
const VERTICES: u32 = 4;

/// Push constants of the reflection (`glsl/shared/probe_shade.glsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ShadeConstants {
    /// Eye, world space.
    pub eye: [f32; 3],
    /// Width of the image region, pixels.
    pub width: u32,
    /// Height of the image region, pixels.
    pub height: u32,
    /// Albedo of a diffuse override, GGX alpha of a metal one.
    pub material_parameter: f32,
    /// GGX alpha below which lobes have buffers of their own: none.
    pub sharp_alpha: f32,
    /// c_k of Eq. 15.
    pub mirror: f32,
}

/// What a surface mirrors.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Reflection {
    /// Nothing: Lambert alone.
    None,
    /// What its material says, a GGX lobe; from so many samples of the pyramid where it is narrow. With 32 and more wide
    /// lobes are finer too.
    Lobes(u32),
    /// The probe as in a perfect mirror, with this reflectivity whatever the material (Eq. 15).
    Mirror(f32),
}

impl Default for Reflection {
    fn default() -> Self {
        Self::Lobes(64)
    }
}

impl fmt::Display for Reflection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("none"),
            Self::Lobes(samples) => write!(f, "lobes:{samples}"),
            Self::Mirror(share) => write!(f, "mirror:{share}"),
        }
    }
}

impl FromStr for Reflection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "{text:?} is no reflection; there are none, lobes, lobes:SAMPLES with 1 to 4096, and mirror:SHARE with 0 to 1"
            )
        };
        match text.split_once(':') {
            None if text == "none" => Ok(Self::None),
            None if text == "lobes" => Ok(Self::default()),
            Some(("lobes", samples)) => {
                samples.parse().ok().filter(|n| (1..=4096).contains(n)).map(Self::Lobes).ok_or_else(wrong)
            }
            Some(("mirror", share)) => {
                let share = share.parse().ok().filter(|share| (0.0..=1.0).contains(share));
                share.map(Self::Mirror).ok_or_else(wrong)
            }
            _ => Err(wrong()),
        }
    }
}

impl Reflection {
    fn code(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Lobes(_) => 1,
            Self::Mirror(_) => 2,
        }
    }

    /// Whether the levels of the probe's pyramid are looked at, with that material.
    pub fn needs_levels(self, material: MaterialChoice) -> bool {
        matches!(self, Self::Lobes(_)) && !matches!(material, MaterialChoice::Diffuse(_))
    }
}

/// The transfer of all vertices on the device.
struct GpuTransfer {
    pipeline: ComputePipeline,
    rotation: Buffer,
    set: DescriptorSet,
    vertices: u32,
    _coefficients: Buffer,
}

/// The object and its passes.
pub struct ProbeObject {
    gbuffer: GBufferPass,
    transfer: Option<GpuTransfer>,
    _irradiance: Buffer,
    shade: ComputePipeline,
    material: MaterialChoice,
    reflection: Reflection,
    nearest: Sampler,
}

impl ProbeObject {
    /// Uploads an object in world space and its transfer; without one, every vertex sees the whole hemisphere.
    ///
    /// # Errors
    /// [`Error::Argument`] where the transfer is that of another object or of another order than the light;
    /// [`Error::Limit`] where something does not fit the device.
    pub fn new(
        context: &Arc<Context>,
        object: &Object,
        transfer: Option<&Transfer>,
        light: &ProbeLight,
        (material, reflection): (MaterialChoice, Reflection),
    ) -> Result<Self> {
        let count = if transfer.is_some() { object.vertices.len() } else { 1 };
        let irradiance =
            Buffer::with_texels(context, "vertex irradiance", count as u64 * 16, vk::Format::R32G32B32A32_SFLOAT)?;
        let transfer =
            transfer.map(|transfer| GpuTransfer::new(context, object, transfer, light, &irradiance)).transpose()?;
        let constants = [Constant::new(0, light.order() as u32), Constant::new(2, transfer.is_some())];
        let bindings = light.light_bindings().buffer("vertex_irradiance", &irradiance);
        let gbuffer = GBufferPass::with_irradiance(context, object, &bindings, &constants)?;
        let samples = match reflection {
            Reflection::Lobes(samples) => samples.max(1),
            _ => 1,
        };
        let constants =
            [Constant::new(8, material.code()), Constant::new(3, reflection.code()), Constant::new(4, samples)];
        Ok(Self {
            gbuffer,
            transfer,
            _irradiance: irradiance,
            shade: ComputePipeline::new(context, "probe_object/shade.comp", &constants)?,
            material,
            reflection,
            nearest: Sampler::new(context, vk::Filter::NEAREST, vk::SamplerAddressMode::CLAMP_TO_EDGE)?,
        })
    }

    /// Changes an albedo, which is a constant of a frame; false, and nothing changes, where other pipelines are needed.
    pub fn set_material(&mut self, material: MaterialChoice) -> bool {
        let fits = material.same_passes(self.material);
        if fits {
            self.material = material;
        }
        fits
    }

    /// Moves the object: the same vertices, in their order, and how its own axes lie in the world.
    ///
    /// # Errors
    /// [`Error::Argument`] for another number of vertices; Vulkan's own errors.
    pub fn place(&self, vertices: &[Vertex], world_from_object: DMat3) -> Result<()> {
        self.turn(world_from_object)?;
        self.gbuffer.place(vertices)
    }

    /// How the object's own axes lie in the world, where its transfer is not that of the world's axes.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn turn(&self, world_from_object: DMat3) -> Result<()> {
        let Some(transfer) = &self.transfer else { return Ok(()) };
        let rows = rotation(world_from_object.transpose());
        let flat: Vec<f32> = rows.as_flattened().iter().map(|entry| *entry as f32).collect();
        transfer.rotation.upload(bytemuck::cast_slice(&flat))
    }

    /// Records what the light alone changes: the irradiance of all vertices.
    ///
    /// # Errors
    /// When the object has more vertices than a dispatch has invocations.
    pub fn record_light(&self, recorder: &mut Recorder) -> Result<()> {
        let Some(transfer) = &self.transfer else { return Ok(()) };
        let invocations = transfer.vertices.div_ceil(VERTICES);
        let constants = TransferConstants { vertices: transfer.vertices, invocations };
        recorder.pass("vertex irradiance", |_, commands| {
            transfer.pipeline.dispatch(commands, &transfer.set, &constants, invocations)
        })?;
        recorder.count("vertices", u64::from(transfer.vertices));
        recorder.barrier(&[Use::ComputeWrite], &[Use::VertexRead]);
        Ok(())
    }

    /// A descriptor set of the reflection for a G-buffer that this object's frames use, and where they go.
    ///
    /// # Errors
    /// When a resource is missing, as before the first probe.
    pub fn bind(&self, light: &ProbeLight, target: &GBuffer, output: &Buffer) -> Result<DescriptorSet> {
        let (Some(lookup), Some(irradiance)) = (light.lookup_bindings(), &target.irradiance) else {
            return Err(Error::Argument("there is no probe yet".into()));
        };
        let sampler = self.nearest.handle;
        self.shade.bind(
            &lookup
                .sampled("position_map", &target.position, sampler)
                .sampled("irradiance_map", irradiance, sampler)
                .sampled("normal_map", &target.normal, sampler)
                .sampled("base_metallic_map", &target.base_metallic, sampler)
                .sampled("emissive_roughness_map", &target.emissive_roughness, sampler)
                .buffer("output_image", output),
        )
    }

    /// Records a region of an image: G-buffer and reflection.
    ///
    /// # Errors
    /// When the region is larger than a dispatch.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        target: &GBuffer,
        set: &DescriptorSet,
        camera: &Camera,
        view: View,
    ) -> Result<()> {
        self.gbuffer.record(recorder, target, camera, view);
        let (width, height) = (view.region.width, view.region.height);
        let constants = ShadeConstants {
            eye: camera.from.into(),
            width,
            height,
            material_parameter: self.material.parameter(),
            sharp_alpha: 0.0,
            mirror: if let Reflection::Mirror(share) = self.reflection { share } else { 0.0 },
        };
        recorder.pass("probe shade", |_, commands| self.shade.dispatch(commands, set, &constants, width * height))?;
        recorder.count("pixels", u64::from(width) * u64::from(height));
        recorder.barrier(&[Use::ComputeWrite], &[Use::CopySource]);
        Ok(())
    }
}

impl GpuTransfer {
    fn new(
        context: &Arc<Context>,
        object: &Object,
        transfer: &Transfer,
        light: &ProbeLight,
        irradiance: &Buffer,
    ) -> Result<Self> {
        let vertices = object.vertices.len();
        if transfer.vertices != vertices {
            let other = transfer.vertices;
            return Err(Error::Argument(format!("a transfer of {other} vertices for an object of {vertices}")));
        }
        if transfer.order != light.order() {
            let (own, other) = (transfer.order, light.order());
            return Err(Error::Argument(format!("a transfer of order {own} for light of order {other}")));
        }
        let four = vk::Format::R32G32B32A32_SFLOAT;
        let texels = padded(&transfer.coefficients, transfer.order * transfer.order);
        let coefficients = Buffer::texels_from_slice(context, "transfer", &texels, four)?;
        let rotation = Buffer::with_texels(
            context,
            "object rotation",
            (MOST_COEFFICIENTS * MOST_COEFFICIENTS * 4) as u64,
            vk::Format::R32_SFLOAT,
        )?;
        let constants = [Constant::new(0, transfer.order as u32), Constant::new(1, transfer.channels as u32)];
        let pipeline = ComputePipeline::new(context, "probe_object/irradiance.comp", &constants)?;
        let set = pipeline.bind(
            &light
                .light_bindings()
                .buffer("transfer_texels", &coefficients)
                .buffer("object_rotation", &rotation)
                .buffer("vertex_irradiance_out", irradiance),
        )?;
        Ok(Self { pipeline, rotation, set, vertices: vertices as u32, _coefficients: coefficients })
    }
}

/// Runs of `count` values in whole texels of four, the last one filled up with zeros.
fn padded(values: &[f32], count: usize) -> Vec<[f32; 4]> {
    let texel = |part: &[f32]| std::array::from_fn(|i| part.get(i).copied().unwrap_or(0.0));
    values.chunks(count).flat_map(|run| run.chunks(4).map(texel)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reflections_have_names() {
        for reflection in [Reflection::None, Reflection::default(), Reflection::Mirror(0.25)] {
            assert_eq!(reflection.to_string().parse(), Ok(reflection));
        }
        for wrong in ["", "mirror", "mirror:2", "mirror:nan", "lobes:0"] {
            assert!(wrong.parse::<Reflection>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn runs_start_at_whole_texels() {
        let values: Vec<f32> = (0..18).map(|i| i as f32).collect();
        let texels = padded(&values, 9);
        assert_eq!(texels.len(), 6);
        assert_eq!(texels[2], [8.0, 0.0, 0.0, 0.0]);
        assert_eq!(texels[3], [9.0, 10.0, 11.0, 12.0]);
        assert_eq!(padded(&values[..16], 16).len(), 4);
    }
}
