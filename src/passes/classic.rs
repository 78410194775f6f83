//! Classic PBGI: one invocation a pixel walks the whole hierarchy (Sabbadin 2019, 5.2, after Ritschel 2009).

use std::sync::Arc;

use super::bin::CutLists;
use super::{Paper, Traversal};
use crate::Result;
use crate::gpu::pipeline::{ComputePipeline, DescriptorSet};
use crate::gpu::{Bindings, Buffer, Context, Recorder, Use};

/// Counts of a batch (`glsl/classic/classic.comp`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct ClassicCounts {
    /// Pixels in the batch.
    pub entries: u32,
    /// Longest list that a pixel wanted.
    pub longest: u32,
    /// Nodes visited by all pixels.
    pub visited: u32,
    /// Nodes kept by all pixels.
    pub cut: u32,
}

/// The pass.
pub struct ClassicPass {
    pipeline: ComputePipeline,
}

impl ClassicPass {
    /// Makes the pipeline.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(context: &Arc<Context>, paper: Paper) -> Result<Self> {
        Ok(Self { pipeline: ComputePipeline::new(context, "classic/classic.comp", &paper.traversal_constants())? })
    }

    /// Records the walk for `count` pixels in `entries`; `counts` holds [`ClassicCounts`]. The returned set must live
    /// until the submission is done.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        bindings: Bindings<'_>,
        lists: &CutLists,
        (entries, count): (&Buffer, u32),
        counts: &Buffer,
        constants: Traversal,
    ) -> Result<DescriptorSet> {
        let set = self.pipeline.bind(
            &lists.bindings(bindings).buffer("Entries", entries).buffer("ClassicCounts", counts),
        )?;
        recorder.pass("traverse (classic)", |_, commands| {
            self.pipeline.dispatch(commands, &set, &constants, count)
        })?;
        recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeRead, Use::CopySource]);
        Ok(set)
    }
}
