//! Lists what the raster passes cover something with: for tests and for looking at cuts.

use std::sync::Arc;

use super::Gather;
use super::rasterise::RasterInfo;
use crate::Result;
use crate::gpu::pipeline::ComputePipeline;
use crate::gpu::{Bindings, Buffer, Context, Profile, Recorder, Use};

/// The pass and its buffers.
pub struct TracePass {
    context: Arc<Context>,
    pipeline: ComputePipeline,
    pairs: Buffer,
    count: Buffer,
    cursors: Buffer,
    /// Pairs that one run holds.
    pub capacity: u32,
    /// Entries of one run.
    pub chunk: u32,
}

impl TracePass {
    /// Makes the pipeline and room for the pairs of `chunk` pixels.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, info: RasterInfo, chunk: u32) -> Result<Self> {
        // Ten nodes a micro-pixel are more than any cut has at the thresholds that make sense.
        let capacity = chunk * info.size * info.size * 10;
        Ok(Self {
            context: context.clone(),
            pipeline: ComputePipeline::new(context, "trace/trace.comp", &info.constants())?,
            pairs: Buffer::new(context, "traced pairs", u64::from(capacity) * 8)?,
            count: Buffer::new(context, "traced count", 4)?,
            cursors: Buffer::new(context, "trace cursors", u64::from(chunk) * 4)?,
            capacity,
            chunk,
        })
    }

    /// The [pixel slot, node] pairs of a chunk of entries, in no order.
    ///
    /// # Errors
    /// [`crate::Error::Limit`] when there are more than `capacity`; Vulkan's own errors.
    pub fn run(&self, bindings: &Bindings<'_>, constants: Gather) -> Result<Vec<[u32; 2]>> {
        let bindings = bindings
            .clone()
            .buffer("TracedPairs", &self.pairs)
            .buffer("TracedCount", &self.count)
            .buffer("Cursors", &self.cursors);
        let set = self.pipeline.bind(&bindings)?;
        self.count.upload(&[0; 4])?;
        self.cursors.upload(&vec![0; self.cursors.size as usize])?;
        let mut recorder = Recorder::new(&self.context)?;
        // More rounds than a cut needs at thresholds that make sense; those after the last do nothing.
        for _ in 0..8 {
            recorder.pass("trace", |_, c| self.pipeline.dispatch(c, &set, &constants, constants.entry_count))?;
            recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeWrite, Use::CopySource]);
        }
        recorder.finish(&mut Profile::default())?;
        let count = self.count.download::<u32>(1)?[0];
        if count > self.capacity {
            let capacity = self.capacity;
            return Err(crate::Error::Limit(format!("{count} pairs in a trace that holds {capacity}")));
        }
        let cursors: Vec<u32> = self.cursors.download(constants.entry_count as usize)?;
        if cursors.iter().any(|cursor| *cursor != u32::MAX) {
            return Err(crate::Error::Limit("a pixel's cut takes more than 8 dispatches to trace".into()));
        }
        self.pairs.download(count as usize)
    }
}
