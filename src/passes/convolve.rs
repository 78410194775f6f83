//! The convolution of micro-buffers with the BRDF (Sabbadin 2019, 5.3, Eq. 9).

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use ash::vk;
use half::f16;

use super::Gather;
use super::rasterise::RasterInfo;
use crate::gpu::memory::ImageInfo;
use crate::gpu::pipeline::{ComputePipeline, DescriptorSet, Sampler};
use crate::gpu::{Bindings, Buffer, Constant, Context, Image, Recorder, Use};
use crate::scene::FarField;
use crate::{Error, Result};

/// What the object is made of.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum MaterialChoice {
    /// The materials of the file.
    File,
    /// Lambertian with this albedo.
    Diffuse(f32),
    /// A GGX mirror metal (F = 1) with this GGX alpha.
    Metal(f32),
}

impl fmt::Display for MaterialChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => f.write_str("file"),
            Self::Diffuse(albedo) => write!(f, "diffuse:{albedo}"),
            Self::Metal(alpha) => write!(f, "metal:{alpha}"),
        }
    }
}

impl FromStr for MaterialChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "{text:?} is no material; there are file, diffuse:ALBEDO with 0 to 1, and metal:ALPHA with 0.001 to 1"
            )
        };
        let number = |value: &str, low: f64| {
            value.parse().ok().filter(|n| (low..=1.0).contains(n)).map(|n: f64| n as f32).ok_or_else(wrong)
        };
        match text.split_once(':') {
            None if text == "file" => Ok(Self::File),
            Some(("diffuse", albedo)) => Ok(Self::Diffuse(number(albedo, 0.0)?)),
            Some(("metal", alpha)) => Ok(Self::Metal(number(alpha, 1e-3)?)),
            _ => Err(wrong()),
        }
    }
}

impl MaterialChoice {
    pub(crate) fn code(self) -> u32 {
        match self {
            Self::File => 0,
            Self::Diffuse(_) => 1,
            Self::Metal(_) => 2,
        }
    }

    /// Albedo or alpha.
    pub fn parameter(self) -> f32 {
        match self {
            Self::File => 0.0,
            Self::Diffuse(parameter) | Self::Metal(parameter) => parameter,
        }
    }

    /// Whether passes and tables for the one are those for the other: an albedo is a constant that a frame takes.
    pub(crate) fn same_passes(self, other: Self) -> bool {
        self == other || matches!((self, other), (Self::Diffuse(_), Self::Diffuse(_)))
    }

    /// BRDF evaluations along a side of a micro-pixel: enough that a lobe of this width is not missed between them.
    fn subsamples(self, size: u32) -> u32 {
        match self {
            Self::Diffuse(_) => 1,
            Self::File => 2,
            // A GGX lobe is about alpha wide in the half vector, twice that in the direction, of a disc of 2.
            Self::Metal(alpha) => ((2.0 / (size as f32 * alpha)).ceil() as u32).clamp(1, 4) + u32::from(alpha < 1.0),
        }
    }
}

/// Directions of the micro-pixels that the unit disc touches.
#[derive(Clone, Debug, Default)]
pub struct MicroPixels {
    /// Index into the micro-buffer, row by row.
    pub indices: Vec<u32>,
    /// Unit direction (z along the normal) of the middle of the part inside the disc, and that part's share of a whole
    /// micro-pixel.
    pub directions: Vec<[f32; 4]>,
}

impl MicroPixels {
    /// All micro-pixels of a micro-buffer with `size` of them along a side.
    pub fn new(size: u32) -> Self {
        const STEPS: u32 = 32;
        let mut list = Self::default();
        let cell = 2.0 / f64::from(size);
        for index in 0..size * size {
            let corner = [index % size, index / size].map(|i| f64::from(i) * cell - 1.0);
            // The disc's part by a fine grid of samples: exact for whole micro-pixels, to 1e-3 on the rim.
            let mut sum = [0.0; 2];
            let mut inside = 0_u32;
            for step in 0..STEPS * STEPS {
                let at = [step % STEPS, step / STEPS].map(|i| (f64::from(i) + 0.5) / f64::from(STEPS) * cell);
                let (x, y) = (corner[0] + at[0], corner[1] + at[1]);
                if x * x + y * y < 1.0 {
                    sum = [sum[0] + x, sum[1] + y];
                    inside += 1;
                }
            }
            if inside > 0 {
                let (x, y) = (sum[0] / f64::from(inside), sum[1] / f64::from(inside));
                let z = (1.0 - x * x - y * y).max(0.0).sqrt();
                list.indices.push(index);
                list.directions.push([x as f32, y as f32, z as f32, inside as f32 / (STEPS * STEPS) as f32]);
            }
        }
        // The parts' sum is the disc's area to 1e-4; make it exact, so that a white surround stays white.
        let total: f64 = list.directions.iter().map(|d| f64::from(d[3])).sum::<f64>() * cell * cell;
        let exact = (std::f64::consts::PI / total) as f32;
        for direction in &mut list.directions {
            if direction[3] < 1.0 {
                direction[3] *= exact;
            }
        }
        list
    }
}

/// A far field on the device, with levels for large micro-pixels; black without one.
pub struct GpuFarField {
    image: Image,
    sampler: Sampler,
    /// Height in texels; 0 without a far field.
    pub height: u32,
    /// Bits of the largest channel of any texel.
    brightest: AtomicU32,
    /// Texels of 32-bit floats, not 16.
    full: bool,
}

impl GpuFarField {
    /// Uploads a panorama.
    ///
    /// # Errors
    /// When it does not fit the device.
    pub fn new(context: &Arc<Context>, far_field: Option<&FarField>) -> Result<Self> {
        let sampler = Sampler::new(context, vk::Filter::LINEAR, vk::SamplerAddressMode::CLAMP_TO_EDGE)?;
        let black = FarField { width: 1, height: 1, radiance: vec![glam::Vec3::ZERO] };
        let source = far_field.unwrap_or(&black);
        let full = context.capabilities.linear_float32;
        let levels = encoded_levels(source, full);
        let info = ImageInfo {
            name: "far field",
            width: source.width,
            height: source.height,
            levels: levels.len() as u32,
            format: if full { vk::Format::R32G32B32A32_SFLOAT } else { vk::Format::R16G16B16A16_SFLOAT },
            usage: vk::ImageUsageFlags::SAMPLED,
        };
        let slices: Vec<&[u8]> = levels.iter().map(Vec::as_slice).collect();
        Ok(Self {
            image: Image::with_contents(context, info, &slices)?,
            sampler,
            height: far_field.map_or(0, |f| f.height),
            brightest: AtomicU32::new(brightest(source).to_bits()),
            full,
        })
    }

    /// Puts another panorama of the same size in its place: the next frame of a sequence. All who share it see it.
    ///
    /// # Errors
    /// [`Error::Argument`] for another size, and where there was none; Vulkan's own errors.
    pub fn update(&self, far_field: &FarField) -> Result<()> {
        let (width, height) = (far_field.width, far_field.height);
        if self.height == 0 || [width, height] != [self.image.width, self.image.height] {
            let [old_width, old_height] = [self.image.width, self.height];
            return Err(Error::Argument(format!(
                "a far field of {width} x {height} cannot take the place of one of {old_width} x {old_height}"
            )));
        }
        let levels = encoded_levels(far_field, self.full);
        let slices: Vec<&[u8]> = levels.iter().map(Vec::as_slice).collect();
        self.image.replace(Use::SampledRead, &slices)?;
        self.brightest.store(brightest(far_field).to_bits(), Ordering::Relaxed);
        Ok(())
    }

    /// The largest channel of any texel.
    pub fn brightest(&self) -> f32 {
        f32::from_bits(self.brightest.load(Ordering::Relaxed))
    }

    /// The image under the name that shaders use.
    pub fn bindings<'a>(&'a self, others: Bindings<'a>) -> Bindings<'a> {
        others.sampled("far_field", &self.image, self.sampler.handle)
    }
}

fn brightest(far_field: &FarField) -> f32 {
    far_field.radiance.iter().fold(0.0, |most, c| most.max(c.max_element()))
}

/// Texels of a panorama and of all its smaller levels.
fn encoded_levels(source: &FarField, full: bool) -> Vec<Vec<u8>> {
    let mut list = vec![encode(source, full)];
    let mut next = source.half();
    while let Some(level) = next {
        list.push(encode(&level, full));
        next = level.half();
    }
    list
}

fn encode(level: &FarField, full: bool) -> Vec<u8> {
    if full {
        level.radiance.iter().flat_map(|c| bytemuck::cast::<[f32; 4], [u8; 16]>([c.x, c.y, c.z, 1.0])).collect()
    } else {
        let half = |value: f32| f16::from_f32(value.min(65504.0));
        level
            .radiance
            .iter()
            .flat_map(|c| bytemuck::cast::<[f16; 4], [u8; 8]>([half(c.x), half(c.y), half(c.z), half(1.0)]))
            .collect()
    }
}

/// The pass.
pub struct ConvolvePass {
    pipeline: ComputePipeline,
    name: &'static str,
    indices: Buffer,
    directions: Buffer,
    /// Not 0 where sums ran over.
    pub overflowed: Buffer,
}

impl ConvolvePass {
    /// Makes the pipeline, with a far field or without; `sharp` where narrow lobes have buffers of their own.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(
        context: &Arc<Context>,
        info: RasterInfo,
        material: MaterialChoice,
        far_field: bool,
        sharp: bool,
    ) -> Result<Self> {
        let constants = [
            Constant::new(10, far_field),
            Constant::new(12, info.lobe),
            Constant::new(13, sharp),
            Constant::new(3, info.size),
            Constant::new(5, info.paper.one_node()),
            Constant::new(6, info.paper.image),
            Constant::new(7, info.paper.weights),
            Constant::new(8, material.code()),
            Constant::new(9, if info.paper.weights { 1 } else { material.subsamples(info.size) }),
        ];
        let micro = MicroPixels::new(info.size);
        Ok(Self {
            pipeline: ComputePipeline::new(context, "convolve/convolve.comp", &constants)?,
            name: if info.lobe { "lobe convolve" } else { "convolve" },
            indices: Buffer::texels_from_slice(context, "micro-pixel indices", &micro.indices, vk::Format::R32_UINT)?,
            directions: Buffer::texels_from_slice(
                context,
                "micro-pixel directions",
                &micro.directions,
                vk::Format::R32G32B32A32_SFLOAT,
            )?,
            overflowed: Buffer::from_slice(context, "convolve counts", &[0_u32])?,
        })
    }

    /// A descriptor set for the pass; `bindings` has the G-buffer, the micro-buffers, the hierarchy and the output.
    ///
    /// # Errors
    /// When a resource is missing.
    pub fn bind<'a>(&'a self, bindings: Bindings<'a>, far_field: &'a GpuFarField) -> Result<DescriptorSet> {
        self.pipeline.bind(
            &far_field
                .bindings(bindings)
                .buffer("micro_indices", &self.indices)
                .buffer("micro_directions", &self.directions)
                .buffer("ConvolveCounts", &self.overflowed),
        )
    }

    /// Records the pass for a chunk of entries.
    ///
    /// # Errors
    /// When the chunk is larger than a dispatch.
    pub fn record(&self, recorder: &mut Recorder, set: &DescriptorSet, constants: Gather) -> Result<()> {
        let pixels = constants.entry_count;
        recorder.pass(self.name, |_, commands| self.pipeline.dispatch(commands, set, &constants, pixels))?;
        recorder.count("pixels", u64::from(pixels));
        recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeWrite, Use::CopySource]);
        Ok(())
    }

    /// Whether a micro-pixel's sums ran over since the last call, after the submissions are done.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn overflowed(&self) -> Result<bool> {
        let flag = self.overflowed.download::<u32>(1)?[0] != 0;
        if flag {
            self.overflowed.upload(&[0; 4])?;
        }
        Ok(flag)
    }
}
