//! Rasterising the cut into micro-buffers: `visibility` and `coverage` (relume's way), or `splat` (the paper's).

use std::sync::Arc;

use ash::vk;

use super::{CutRules, Gather, Paper};
use crate::Result;
use crate::gpu::memory::ImageInfo;
use crate::gpu::pipeline::{ComputePipeline, DescriptorSet};
use crate::gpu::{Bindings, Buffer, Constant, Context, Image, Recorder, Use};

/// How micro-buffers are kept and filled.
#[derive(Clone, Copy, Debug, Default)]
pub struct RasterInfo {
    /// Micro-pixels along a side.
    pub size: u32,
    /// Each pixel walks the hierarchy itself (classic); otherwise the traversal has left lists.
    pub walk: bool,
    /// The paper's ways.
    pub paper: Paper,
    /// Buffers over the full sphere around tiles, instead of the hemispheres above pixels.
    pub shared: bool,
    /// Discs of narrow lobes, for which each pixel walks the hierarchy.
    pub lobe: bool,
}

impl RasterInfo {
    /// Bytes of one micro-buffer.
    pub fn bytes_per_pixel(&self) -> u64 {
        let micro_pixels = u64::from(self.size * self.size);
        match self.paper {
            Paper { image: true, .. } => micro_pixels * 8,
            Paper { coverage: true, .. } => micro_pixels * 8,
            _ if self.shared => micro_pixels * 52,
            _ => micro_pixels * 36,
        }
    }

    /// Bytes and texels of a micro-pixel's nearest: depth, or depth and node.
    fn nearest(&self) -> (u64, vk::Format) {
        match self.paper {
            Paper { image: true, .. } => (0, vk::Format::R32G32_UINT),
            Paper { coverage: true, .. } => (8, vk::Format::R32G32_UINT),
            _ => (4, vk::Format::R32_SFLOAT),
        }
    }

    /// Constants of the shaders that include `common/raster_loop.glsl`.
    pub(crate) fn constants(&self) -> [Constant; 6] {
        let [cut, coverage, shared] = CutRules { paper: self.paper, shared: self.shared }.constants();
        [cut, coverage, shared, Constant::new(2, self.walk), Constant::new(3, self.size), Constant::new(12, self.lobe)]
    }
}

/// Micro-buffers of a chunk of pixels.
pub struct MicroBuffers {
    /// The nearest depth of a micro-pixel; depth and node, 64 bits, where one node is kept; a token where the paper's
    /// image is the store.
    pub nearest: Buffer,
    /// Fixed-point sums of two layers, four 32-bit numbers each; a token where one node a micro-pixel is kept.
    pub layers: Buffer,
    /// Technique `shared`: sums of where in a texel its light comes from; a token otherwise.
    middles: Buffer,
    /// Alphas of lobes, where no others are bound.
    no_alphas: Buffer,
    /// The paper's store; a token otherwise.
    pub store: Image,
    /// How far each pixel of the chunk has come, by pass.
    cursors: [Buffer; 2],
    /// Micro-buffers that fit.
    pub pixels: u32,
    info: RasterInfo,
}

/// Largest word below infinity as a float: no depth, in both halves of a cleared key.
const NO_DEPTH: u32 = 0x7f7f_ffff;

impl MicroBuffers {
    /// Room for `pixels` micro-buffers.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, info: RasterInfo, pixels: u32) -> Result<Self> {
        let micro_pixels = u64::from(info.size * info.size) * u64::from(pixels);
        let (columns, rows) = if info.paper.image { store_shape(context, info.size, pixels) } else { (1, 1) };
        let side = if info.paper.image { info.size } else { 1 };
        let (nearest_bytes, nearest_format) = info.nearest();
        let store = Image::new(
            context,
            ImageInfo {
                name: "micro-buffer store",
                width: columns * side,
                height: rows * side,
                levels: 1,
                format: vk::Format::R16G16B16A16_SFLOAT,
                usage: vk::ImageUsageFlags::STORAGE,
            },
        )?;
        Ok(Self {
            nearest: Buffer::with_texels(context, "micro-buffer depth", micro_pixels * nearest_bytes, nearest_format)?,
            layers: Buffer::with_texels(
                context,
                "micro-buffer layers",
                if info.paper.one_node() { 0 } else { micro_pixels * 32 },
                vk::Format::R32G32B32A32_UINT,
            )?,
            middles: Buffer::with_texels(
                context,
                "texel middles",
                if info.shared { micro_pixels * 16 } else { 0 },
                vk::Format::R32G32B32A32_UINT,
            )?,
            no_alphas: Buffer::with_texels(context, "no lobes", 4, vk::Format::R32_SFLOAT)?,
            store,
            cursors: [
                Buffer::new(context, "raster cursors", u64::from(pixels) * 4)?,
                Buffer::new(context, "raster cursors", u64::from(pixels) * 4)?,
            ],
            pixels,
            info,
        })
    }

    /// Most micro-buffers that the device's limits on buffers and images allow at once.
    pub fn most(context: &Context, info: RasterInfo) -> u64 {
        let micro_pixels = u64::from(info.size * info.size);
        let by_buffer = context.capabilities.max_storage_range / (micro_pixels * 32);
        let side = u64::from(context.capabilities.max_image_size / info.size);
        if info.paper.image { side * side } else { by_buffer }
    }

    /// Micro-buffers in a row of the paper's store.
    pub fn columns(&self) -> u32 {
        self.store.width / self.info.size
    }

    /// The micro-buffers under the names that shaders use.
    pub fn bindings<'a>(&'a self, others: Bindings<'a>) -> Bindings<'a> {
        others
            .buffer("Nearest", &self.nearest)
            .buffer("nearest_depths", &self.nearest)
            .buffer("layers", &self.layers)
            .buffer("middles", &self.middles)
            .buffer("lobe_alphas", &self.no_alphas)
            .storage_image("store", &self.store)
    }

    /// Records that nothing is stored for the first `pixels` micro-buffers.
    pub fn clear(&self, recorder: &mut Recorder, pixels: u32) {
        let micro_pixels = u64::from(self.info.size * self.info.size) * u64::from(pixels);
        recorder.barrier(&[Use::ComputeWrite], &[Use::CopyTarget]);
        recorder.pass("clear", |device, commands| {
            self.store.transition(device, commands, Use::Undefined, Use::StorageImage);
            // SAFETY: the buffers and the image are live and were made as copy targets.
            unsafe {
                if self.info.paper.image {
                    let all = vk::ImageSubresourceRange {
                        aspect_mask: vk::ImageAspectFlags::COLOR,
                        base_mip_level: 0,
                        level_count: 1,
                        base_array_layer: 0,
                        layer_count: 1,
                    };
                    let zero = vk::ClearColorValue { float32: [0.0; 4] };
                    self.store.transition(device, commands, Use::StorageImage, Use::CopyTarget);
                    device.cmd_clear_color_image(
                        commands,
                        self.store.handle,
                        vk::ImageLayout::TRANSFER_DST_OPTIMAL,
                        &zero,
                        &[all],
                    );
                    self.store.transition(device, commands, Use::CopyTarget, Use::StorageImage);
                } else {
                    let bytes = micro_pixels * self.info.nearest().0;
                    device.cmd_fill_buffer(commands, self.nearest.handle, 0, bytes, NO_DEPTH);
                }
                if !self.info.paper.one_node() {
                    device.cmd_fill_buffer(commands, self.layers.handle, 0, micro_pixels * 32, 0);
                }
                if self.info.shared {
                    device.cmd_fill_buffer(commands, self.middles.handle, 0, micro_pixels * 16, 0);
                }
                for cursors in &self.cursors {
                    device.cmd_fill_buffer(commands, cursors.handle, 0, u64::from(pixels) * 4, 0);
                }
            }
        });
        recorder.barrier(&[Use::CopyTarget], &[Use::ComputeWrite]);
    }
}

/// Columns and rows of a store for `pixels` micro-buffers, as square as it gets.
fn store_shape(context: &Context, size: u32, pixels: u32) -> (u32, u32) {
    let most = context.capabilities.max_image_size / size;
    let columns = (f64::from(pixels).sqrt().ceil() as u32).clamp(1, most);
    (columns, pixels.div_ceil(columns).max(1))
}

/// Counts of the raster passes over a frame (`glsl/common/raster_loop.glsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct RasterCounts {
    /// Pixels whose cut was not done in the dispatches that were recorded for it.
    pub unfinished: u32,
    /// Keeps the rest aligned.
    pub reserved: u32,
    /// Nodes handed to pixels.
    pub offered: u64,
    /// Those of them that cover something.
    pub drawn: u64,
    /// Nodes visited by walks.
    pub visited: u64,
}

impl RasterCounts {
    /// What was counted after `before`.
    pub fn since(self, before: Self) -> Self {
        Self {
            unfinished: self.unfinished.wrapping_sub(before.unfinished),
            reserved: 0,
            offered: self.offered.wrapping_sub(before.offered),
            drawn: self.drawn.wrapping_sub(before.drawn),
            visited: self.visited.wrapping_sub(before.visited),
        }
    }
}

/// The passes: `visibility` and `coverage`, or `splat` for one node a micro-pixel as in the paper.
pub struct RasterPass {
    steps: Vec<(&'static str, ComputePipeline)>,
    /// Pixels walk the hierarchy themselves.
    walk: bool,
}

impl RasterPass {
    /// Makes the pipelines.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(context: &Arc<Context>, info: RasterInfo) -> Result<Self> {
        let mut constants = info.constants().to_vec();
        constants.extend(context.small_workgroup());
        let steps = if info.paper.one_node() {
            constants.extend([Constant::new(5, info.paper.coverage), Constant::new(6, info.paper.image)]);
            vec![("splat", ComputePipeline::new(context, "splat/splat.comp", &constants)?)]
        } else {
            let [visibility, coverage] =
                if info.lobe { ["lobe visibility", "lobe coverage"] } else { ["visibility", "coverage"] };
            vec![
                (visibility, ComputePipeline::new(context, "visibility/visibility.comp", &constants)?),
                (coverage, ComputePipeline::new(context, "coverage/coverage.comp", &constants)?),
            ]
        };
        Ok(Self { steps, walk: info.walk })
    }

    /// Name of the pass that counts.
    pub fn counting_pass(&self) -> &'static str {
        self.steps[0].0
    }

    /// Those counts that the passes have, by name.
    pub fn named(&self, counts: RasterCounts) -> Vec<(&'static str, u64)> {
        let mut named = vec![("pairs_in", counts.offered), ("rasterised_nodes", counts.drawn)];
        if self.walk {
            named.push(("visited_nodes", counts.visited));
        }
        named
    }

    /// Descriptor sets for the pass's pipelines.
    ///
    /// # Errors
    /// When a resource is missing.
    pub fn bind(&self, bindings: &Bindings<'_>, micro_buffers: &MicroBuffers) -> Result<Vec<DescriptorSet>> {
        self.steps
            .iter()
            .zip(&micro_buffers.cursors)
            .map(|((_, pipeline), cursors)| pipeline.bind(&bindings.clone().buffer("Cursors", cursors)))
            .collect()
    }

    /// Records the passes for a chunk of entries into cleared micro-buffers, `rounds` dispatches each.
    ///
    /// # Errors
    /// When the chunk is larger than a dispatch.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        sets: &[DescriptorSet],
        constants: Gather,
        rounds: u32,
    ) -> Result<()> {
        for ((name, pipeline), set) in self.steps.iter().zip(sets) {
            for round in 1..=rounds {
                let constants = Gather { last_round: u32::from(round == rounds), ..constants };
                recorder.pass(name, |_, c| pipeline.dispatch(c, set, &constants, constants.entry_count))?;
                let uses = [Use::ComputeWrite, Use::SampledRead, Use::StorageImage];
                recorder.barrier(&[Use::ComputeWrite, Use::StorageImage], &uses);
            }
        }
        Ok(())
    }
}
