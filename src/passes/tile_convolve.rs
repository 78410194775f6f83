//! Technique `shared`: blocks of pixels lit by the tiles around them.

use std::f64::consts::PI;
use std::sync::Arc;

use ash::vk;
use half::f16;
use rayon::prelude::*;

use super::Gather;
use super::convolve::MaterialChoice;
use crate::Result;
use crate::gpu::memory::ImageInfo;
use crate::gpu::pipeline::{ComputePipeline, DescriptorSet, Sampler};
use crate::gpu::{Bindings, Constant, Context, Image, Recorder, Use};

/// The four tiles that light a block, or a part of it (`block_tiles` in `tile_convolve.comp`), and their weights: polynomials of the place
/// in the block, x and y from 0 to 1, that add up to 1.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct BlockTiles {
    /// Slots of the tiles.
    pub slots: [u32; 4],
    /// What does not depend on the place.
    pub constant: [f32; 4],
    /// Factors of x.
    pub along_x: [f32; 4],
    /// Factors of y.
    pub along_y: [f32; 4],
    /// Factors of x y.
    pub along_both: [f32; 4],
    /// Weights at the middle of the part that is lit.
    pub middle: [f32; 4],
    /// Block as an index of level 2; which of its pixels are lit, one bit each in Morton order; first and number of the
    /// pairs of texels that light it.
    pub work: [u32; 4],
    /// From the block's middle to those of the tiles, metres: x, y and z of the four.
    pub offsets: [[f32; 4]; 3],
}

/// Roughnesses and view cosines of the table.
const TABLE: (u32, u32) = (32, 48);
/// `LOBE_SHARE` and `LOBE_SURE` of `glsl/common/lobe.glsl`.
const LOBE_SHARE: f64 = 0.9;
const LOBE_SURE: f64 = 0.7;
/// Directions along a side of an entry's quadrature.
const STEPS: u32 = 48;

/// Directional albedos of the principled model's terms for a roughness and a cosine with the normal (Burley 2012, Walter
/// et al. 2007): the diffuse term times pi over pi, the GGX lobe with F = 1, the lobe times (1 - cos d)^5, and the tails
/// of the lobe, which `glsl/common/lobe.glsl` leaves to other buffers.
fn albedos(roughness: f64, view_cosine: f64) -> [f64; 4] {
    let alpha = (roughness * roughness).max(1e-3);
    let view_cosine = view_cosine.max(1e-3);
    let view = glam::DVec3::new((1.0 - view_cosine * view_cosine).sqrt(), 0.0, view_cosine);
    let masking = |c: f64| 2.0 * c / (c + (alpha * alpha + (1.0 - alpha * alpha) * c * c).sqrt());
    let mut sums = [0.0; 4];
    for i in 0..STEPS * STEPS {
        let u = (f64::from(i % STEPS) + 0.5) / f64::from(STEPS);
        // Half a turn: the other half is its mirror image.
        let (sine, cosine) = (PI * (f64::from(i / STEPS) + 0.5) / f64::from(STEPS)).sin_cos();
        let around = |z: f64| {
            let across = (1.0 - z * z).max(0.0).sqrt();
            glam::DVec3::new(across * cosine, across * sine, z)
        };
        // Half vectors by the distribution.
        let half = around(1.0 / (1.0 + alpha * alpha * u / (1.0 - u)).sqrt());
        let along = view.dot(half);
        let light = 2.0 * along * half - view;
        if along > 0.0 && light.z > 0.0 {
            let weight = masking(light.z) * masking(view_cosine) * along / (view_cosine * half.z);
            sums[1] += weight;
            sums[2] += weight * (1.0 - along).powi(5);
            sums[3] += weight * ((u - LOBE_SURE) / (LOBE_SHARE - LOBE_SURE)).clamp(0.0, 1.0);
        }
        // Directions by the cosine.
        let light = around(u.sqrt());
        let along = light.dot((light + view).normalize());
        let grazing = 0.5 + 2.0 * along * along * roughness;
        let term = |c: f64| 1.0 + (grazing - 1.0) * (1.0 - c).powi(5);
        sums[0] += term(light.z) * term(view_cosine);
    }
    sums.map(|sum| sum / f64::from(STEPS * STEPS))
}

/// The pass.
pub struct TileConvolvePass {
    pipeline: ComputePipeline,
    albedo_table: Image,
    sampler: Sampler,
}

impl TileConvolvePass {
    /// Makes the pipeline for tiles with `size` texels along a side, and the material's table; `sharp` where narrow lobes
    /// have buffers of their own.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(context: &Arc<Context>, size: u32, material: MaterialChoice, sharp: bool) -> Result<Self> {
        let roughnesses: Vec<f64> = match material {
            MaterialChoice::File => (0..TABLE.0).map(|i| f64::from(i) / f64::from(TABLE.0 - 1)).collect(),
            MaterialChoice::Metal(alpha) => vec![f64::from(alpha).sqrt()],
            MaterialChoice::Diffuse(_) => vec![1.0],
        };
        let width = roughnesses.len() as u32;
        let texels: Vec<[f16; 4]> = (0..width * TABLE.1)
            .into_par_iter()
            .map(|i| {
                let cosine = f64::from(i / width) / f64::from(TABLE.1 - 1);
                albedos(roughnesses[(i % width) as usize], cosine).map(f16::from_f64)
            })
            .collect();
        let info = ImageInfo {
            name: "albedo table",
            width,
            height: TABLE.1,
            levels: 1,
            format: vk::Format::R16G16B16A16_SFLOAT,
            usage: vk::ImageUsageFlags::SAMPLED,
        };
        let mut constants = vec![Constant::new(3, size), Constant::new(8, material.code()), Constant::new(13, sharp)];
        constants.extend(context.small_workgroup());
        Ok(Self {
            pipeline: ComputePipeline::new(context, "tile_convolve/tile_convolve.comp", &constants)?,
            albedo_table: Image::with_contents(context, info, &[bytemuck::cast_slice(&texels)])?,
            sampler: Sampler::new(context, vk::Filter::LINEAR, vk::SamplerAddressMode::CLAMP_TO_EDGE)?,
        })
    }

    /// A descriptor set for the pass; `bindings` has receivers, [`BlockTiles`], lists of texels, tiles, the G-buffer
    /// and the output.
    ///
    /// # Errors
    /// When a resource is missing.
    pub fn bind<'a>(&'a self, bindings: Bindings<'a>) -> Result<DescriptorSet> {
        self.pipeline.bind(&bindings.sampled("albedo_table", &self.albedo_table, self.sampler.handle))
    }

    /// Records the pass for all blocks.
    ///
    /// # Errors
    /// When there are more than a dispatch has.
    pub fn record(&self, recorder: &mut Recorder, set: &DescriptorSet, constants: Gather) -> Result<()> {
        let blocks = constants.entry_count;
        recorder.pass("tile convolve", |_, c| self.pipeline.dispatch(c, set, &constants, blocks))?;
        recorder.count("blocks", u64::from(blocks));
        recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeWrite, Use::CopySource]);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn albedos_are_those_of_known_surfaces() {
        // A mirror reflects all; without roughness the diffuse term darkens towards grazing angles, with it it brightens.
        let [_, lobe, grazing, tails] = albedos(0.03, 0.5);
        assert!((tails - 0.2).abs() < 0.01, "{tails}");
        assert!((lobe - 1.0).abs() < 0.01, "{lobe}");
        assert!((grazing - 0.5_f64.powi(5)).abs() < 0.01, "{grazing}");
        assert!(albedos(0.0, 0.05)[0] < 0.8 && albedos(1.0, 0.05)[0] > 1.1);
        // At alpha = 1 and normal incidence, the integral of masking alone: 1 - ln 2.
        let rough = albedos(1.0, 1.0)[1];
        assert!((rough - (1.0 - 2.0_f64.ln())).abs() < 1e-3, "{rough}");
    }
}
