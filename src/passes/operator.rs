//! A compute shader with what it is bound to: what most passes are made of.

use std::sync::Arc;

use bytemuck::NoUninit;

use crate::Result;
use crate::gpu::pipeline::DescriptorSet;
use crate::gpu::{Bindings, ComputePipeline, Constant, Context, Recorder, Use};

/// One shader and its resources.
pub(super) struct Operator {
    pipeline: ComputePipeline,
    set: DescriptorSet,
}

impl Operator {
    /// Compiles the shader and binds it.
    pub(super) fn new(
        context: &Arc<Context>,
        shader: &str,
        constants: &[Constant],
        bindings: &Bindings<'_>,
    ) -> Result<Self> {
        let pipeline = ComputePipeline::new(context, shader, constants)?;
        let set = pipeline.bind(bindings)?;
        Ok(Self { pipeline, set })
    }

    /// Binds other resources.
    pub(super) fn bind(&mut self, bindings: &Bindings<'_>) -> Result<()> {
        self.set = self.pipeline.bind(bindings)?;
        Ok(())
    }

    /// Other resources for the same shader.
    pub(super) fn set(&self, bindings: &Bindings<'_>) -> Result<DescriptorSet> {
        self.pipeline.bind(bindings)
    }

    /// Records a pass of one dispatch; what it wrote may be read by what comes next.
    pub(super) fn record<T: NoUninit>(
        &self,
        recorder: &mut Recorder,
        name: &'static str,
        constants: &T,
        invocations: u32,
    ) -> Result<()> {
        self.record_with(recorder, name, &self.set, &[(*constants, invocations)])
    }

    /// Records a pass of several dispatches that may run at once, with resources of their own.
    pub(super) fn record_with<T: NoUninit>(
        &self,
        recorder: &mut Recorder,
        name: &'static str,
        set: &DescriptorSet,
        dispatches: &[(T, u32)],
    ) -> Result<()> {
        recorder.pass(name, |_, commands| {
            dispatches
                .iter()
                .try_for_each(|(constants, invocations)| self.pipeline.dispatch(commands, set, constants, *invocations))
        })?;
        recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeWrite, Use::CopySource]);
        Ok(())
    }
}
