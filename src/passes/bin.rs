//! Counting sort of the cut's pairs by receiver, so that the raster passes find every receiver's nodes side by side.

use std::sync::Arc;

use ash::vk;

use super::{Receiver, Traversal};
use crate::Result;
use crate::gpu::pipeline::{ComputePipeline, DescriptorSet};
use crate::gpu::{Bindings, Buffer, Constant, Context, Recorder, Use};

/// Where the nodes of every receiver lie: what the traversal leaves for the raster passes.
pub struct CutLists {
    /// Offset and length by receiver slot.
    pub lists: Buffer,
    /// Node indices.
    pub nodes: Buffer,
}

impl CutLists {
    /// Lists for the receivers of `pixels` pixel slots with `capacity` nodes in all.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, pixels: u32, capacity: u32) -> Result<Self> {
        Ok(Self {
            lists: Buffer::new(context, "cut lists", u64::from(Receiver::slots(pixels)) * 8)?,
            nodes: Buffer::with_texels(context, "cut nodes", u64::from(capacity) * 4, vk::Format::R32_UINT)?,
        })
    }

    /// The list buffers under the names that shaders use.
    pub fn bindings<'a>(&'a self, others: Bindings<'a>) -> Bindings<'a> {
        others.buffer("Lists", &self.lists).buffer("cut_nodes", &self.nodes)
    }

    /// Gives each of `tiles` a list for up to `capacity` nodes, and no other receiver from `first` on any.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn reserve(&self, first: Receiver, tiles: &[Receiver], pixels: u32, capacity: u32) -> Result<()> {
        let first = first.slot(pixels);
        let mut lists = vec![[0_u32; 2]; (Receiver::slots(pixels) - first) as usize];
        for (i, tile) in tiles.iter().enumerate() {
            lists[(tile.slot(pixels) - first) as usize][0] = i as u32 * capacity;
        }
        self.lists.upload_at(u64::from(first) * 8, bytemuck::cast_slice(&lists))
    }

    /// Records that no receiver has a list.
    pub fn clear(&self, recorder: &mut Recorder) {
        recorder.pass("clear lists", |device, commands| {
            // SAFETY: the buffer is live and was made as a copy target.
            unsafe { device.cmd_fill_buffer(commands, self.lists.handle, 0, vk::WHOLE_SIZE, 0) };
        });
        recorder.barrier(&[Use::CopyTarget], &[Use::ComputeWrite]);
    }
}

/// Counts of a batch (`glsl/common/counts.glsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Counts {
    /// Pairs that the geometry shader left for the compute pass.
    pub handed: u32,
    /// Pairs of the cut.
    pub cut: u32,
    /// Pairs that the compute pass looked at.
    pub visited: u32,
    /// Pairs that the compute pass has begun, or asked for in vain.
    pub taken: u32,
    /// Nodes that have a place in a list; technique `shared`: nodes for the longest list.
    pub placed: u32,
}

/// Sizes a following pass from a counter on the device.
pub struct PreparePass {
    pipeline: ComputePipeline,
}

impl PreparePass {
    /// Makes the pipeline: `from_feedback` reads the feedback counter, else the refinement's count is used.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(context: &Arc<Context>, hybrid: bool, from_feedback: bool) -> Result<Self> {
        let constants = [Constant::new(2, hybrid), Constant::new(5, from_feedback)];
        Ok(Self { pipeline: ComputePipeline::new(context, "bin/prepare.comp", &constants)? })
    }

    /// Records the pass; the returned set must live until the submission is done.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        feedback_counter: &Buffer,
        counts: &Buffer,
        arguments: &Buffer,
        constants: Traversal,
    ) -> Result<DescriptorSet> {
        let set = self.pipeline.bind(
            &Bindings::new()
                .buffer("FeedbackCounter", feedback_counter)
                .buffer("Counts", counts)
                .buffer("Arguments", arguments),
        )?;
        recorder.pass("prepare", |_, commands| self.pipeline.dispatch(commands, &set, &constants, 1))?;
        recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeWrite, Use::IndirectArguments]);
        Ok(set)
    }
}

/// The three steps of the sort.
pub struct BinPass {
    count: ComputePipeline,
    place: ComputePipeline,
    scatter: ComputePipeline,
}

impl BinPass {
    /// Makes the pipelines.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(context: &Arc<Context>) -> Result<Self> {
        Ok(Self {
            count: ComputePipeline::new(context, "bin/count.comp", &[])?,
            place: ComputePipeline::new(context, "bin/place.comp", &[])?,
            scatter: ComputePipeline::new(context, "bin/scatter.comp", &[])?,
        })
    }

    /// Records the sort of `pairs` into cleared `lists`; `arguments` sizes it from the number of pairs. The returned
    /// sets must live until the submission is done.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        pairs: &Buffer,
        lists: &CutLists,
        counts: &Buffer,
        arguments: &Buffer,
        constants: Traversal,
    ) -> Result<[DescriptorSet; 3]> {
        let bindings = lists.bindings(Bindings::new().buffer("cut_pairs", pairs).buffer("Counts", counts));
        let sets = [self.count.bind(&bindings)?, self.place.bind(&bindings)?, self.scatter.bind(&bindings)?];
        recorder.pass("bin", |device, commands| -> Result<()> {
            let turn = || {
                crate::gpu::recorder::barrier(device, commands, &[Use::ComputeWrite], &[Use::ComputeWrite]);
            };
            self.count.dispatch_indirect(commands, &sets[0], &constants, arguments);
            turn();
            self.place.dispatch(commands, &sets[1], &constants, Receiver::slots(constants.pixels))?;
            turn();
            self.scatter.dispatch_indirect(commands, &sets[2], &constants, arguments);
            Ok(())
        })?;
        recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeRead]);
        Ok(sets)
    }
}

/// Buffers that every batch of the feedback techniques uses.
pub struct BatchCounters {
    /// [`Counts`].
    pub counts: Buffer,
    /// Arguments of an indirect dispatch.
    pub arguments: Buffer,
}

impl BatchCounters {
    /// Makes both.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(context: &Arc<Context>) -> Result<Self> {
        Ok(Self {
            counts: Buffer::new(context, "batch counts", size_of::<Counts>() as u64)?,
            arguments: Buffer::new(context, "dispatch arguments", 16)?,
        })
    }

    /// Records that all counts are zero.
    pub fn clear(&self, recorder: &mut Recorder) {
        recorder.pass("clear counts", |device, commands| {
            // SAFETY: the buffer is live and was made as a copy target.
            unsafe { device.cmd_fill_buffer(commands, self.counts.handle, 0, vk::WHOLE_SIZE, 0) };
        });
        recorder.barrier(&[Use::CopyTarget], &[Use::ComputeWrite]);
    }

    /// Reads the counts after the submission is done.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn read(&self) -> Result<Counts> {
        Ok(self.counts.download::<Counts>(1)?[0])
    }
}
