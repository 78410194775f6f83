//! Hybrid's second part: what the geometry shader left is refined depth first in compute (Sabbadin 2019, 5.2.2).

use std::sync::Arc;

use ash::vk;

use super::traverse::PAIR_BYTES;
use super::{CutRules, Traversal};
use crate::Result;
use crate::gpu::pipeline::{ComputePipeline, DescriptorSet};
use crate::gpu::{Bindings, Buffer, Context, Recorder, Use};

/// The pass.
pub struct RefinePass {
    pipeline: ComputePipeline,
    /// Pairs of the cut.
    pub cut: Buffer,
}

impl RefinePass {
    /// Makes the pipeline and room for `capacity` pairs.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, rules: CutRules, capacity: u32) -> Result<Self> {
        Ok(Self {
            pipeline: ComputePipeline::new(context, "refine/refine.comp", &rules.constants())?,
            cut: Buffer::with_texels(context, "cut pairs", u64::from(capacity) * PAIR_BYTES, vk::Format::R32G32_UINT)?,
        })
    }

    /// Records the refinement of `handed` pairs; `arguments` sizes it. The returned set must live until the
    /// submission is done.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        bindings: Bindings<'_>,
        handed: &Buffer,
        counts: &Buffer,
        arguments: &Buffer,
        constants: Traversal,
    ) -> Result<DescriptorSet> {
        let set = self
            .pipeline
            .bind(&bindings.buffer("handed_pairs", handed).buffer("cut_pairs", &self.cut).buffer("Counts", counts))?;
        recorder.pass("refine", |_, commands| {
            self.pipeline.dispatch_indirect(commands, &set, &constants, arguments);
        });
        recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeWrite, Use::CopySource]);
        Ok(set)
    }
}
