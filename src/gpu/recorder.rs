//! Command recording: every pass gets a debug label, a pair of timestamps and a place in the profile here, never by
//! its own hand.

use std::collections::BTreeMap;
use std::sync::Arc;

use ash::vk;

use super::context::{Context, vulkan};
use super::uses::Use;
use crate::{Error, Result};

/// Time and counts of every pass, summed over submissions.
#[derive(Clone, Debug, Default)]
pub struct Profile {
    /// By pass name.
    pub passes: BTreeMap<&'static str, PassProfile>,
}

/// What one pass took and did.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct PassProfile {
    /// Milliseconds between the pass's timestamps.
    pub gpu_ms: f64,
    /// How often it ran.
    pub runs: u64,
    /// Counts by name: pairs, nodes, bytes.
    #[serde(flatten)]
    pub counts: BTreeMap<&'static str, u64>,
}

impl Profile {
    /// Adds to a count of a pass.
    pub fn count(&mut self, pass: &'static str, what: &'static str, amount: u64) {
        *self.passes.entry(pass).or_default().counts.entry(what).or_default() += amount;
    }

    /// Adds another profile's times and counts.
    pub fn add(&mut self, other: &Self) {
        for (name, pass) in &other.passes {
            let own = self.passes.entry(name).or_default();
            own.gpu_ms += pass.gpu_ms;
            own.runs += pass.runs;
            for (what, amount) in &pass.counts {
                *own.counts.entry(what).or_default() += amount;
            }
        }
    }

    /// Milliseconds of all passes.
    pub fn total_ms(&self) -> f64 {
        self.passes.values().map(|p| p.gpu_ms).sum()
    }
}

/// Passes whose timestamps one query pool holds; a submission has as many pools as it needs.
const PASSES_PER_POOL: usize = 128;

/// Label of uploads and downloads, which are no pass of a frame.
const TRANSFER: &str = "transfer";

/// A pass that was recorded.
struct RecordedPass {
    name: &'static str,
    /// Counts that are known before it runs.
    counts: Vec<(&'static str, u64)>,
}

/// Records one submission.
pub struct Recorder {
    context: Arc<Context>,
    pool: vk::CommandPool,
    /// The command buffer, for passes.
    pub(crate) commands: vk::CommandBuffer,
    /// A begin and an end for each of [`PASSES_PER_POOL`] passes.
    timestamps: Vec<vk::QueryPool>,
    passes: Vec<RecordedPass>,
    /// Why the last passes have no timestamps.
    failed: Option<Error>,
}

impl Recorder {
    /// Starts a command buffer.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(context: &Arc<Context>) -> Result<Self> {
        let device = &context.device;
        // SAFETY: plain creations; everything is destroyed in `drop`.
        unsafe {
            let create = vk::CommandPoolCreateInfo::default()
                .queue_family_index(context.queue_family)
                .flags(vk::CommandPoolCreateFlags::TRANSIENT);
            let pool = device.create_command_pool(&create, None).map_err(vulkan("vkCreateCommandPool"))?;
            let mut recorder = Self {
                context: context.clone(),
                pool,
                commands: vk::CommandBuffer::null(),
                timestamps: Vec::new(),
                passes: Vec::new(),
                failed: None,
            };
            let allocate = vk::CommandBufferAllocateInfo::default()
                .command_pool(pool)
                .level(vk::CommandBufferLevel::PRIMARY)
                .command_buffer_count(1);
            recorder.commands =
                device.allocate_command_buffers(&allocate).map_err(vulkan("vkAllocateCommandBuffers"))?[0];
            let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            device.begin_command_buffer(recorder.commands, &begin).map_err(vulkan("vkBeginCommandBuffer"))?;
            Ok(recorder)
        }
    }

    /// The context that the commands are for.
    pub fn context(&self) -> &Arc<Context> {
        &self.context
    }

    /// Records a pass: label, timestamps, and what `record` adds.
    pub fn pass<T>(&mut self, name: &'static str, record: impl FnOnce(&ash::Device, vk::CommandBuffer) -> T) -> T {
        let (pool, query) = self.queries(self.passes.len());
        if self.context.clock.exists() && self.failed.is_none() && pool == self.timestamps.len() {
            self.failed = self.add_pool().err();
        }
        self.passes.push(RecordedPass { name, counts: Vec::new() });
        let device = &self.context.device;
        self.context.begin_label(self.commands, name);
        let stamp = |query| {
            if let Some(pool) = self.timestamps.get(pool) {
                let stage = vk::PipelineStageFlags::BOTTOM_OF_PIPE;
                // SAFETY: the command buffer is recording and the queries were reset when the pool was added.
                unsafe { device.cmd_write_timestamp(self.commands, stage, *pool, query) };
                self.settle();
            }
        };
        stamp(query);
        let result = record(device, self.commands);
        self.settle();
        stamp(query + 1);
        self.context.end_label(self.commands);
        result
    }

    /// Adds a count that is known before the last pass runs; [`Context::count`] adds those that are known only after.
    pub fn count(&mut self, what: &'static str, amount: u64) {
        if let Some(pass) = self.passes.last_mut() {
            pass.counts.push((what, amount));
        }
    }

    /// A pass's query pool, and its first query there.
    fn queries(&self, pass: usize) -> (usize, u32) {
        (pass / PASSES_PER_POOL, 2 * (pass % PASSES_PER_POOL) as u32)
    }

    /// Makes room for the timestamps of more passes.
    fn add_pool(&mut self) -> Result<()> {
        let device = &self.context.device;
        let count = 2 * PASSES_PER_POOL as u32;
        let create = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(count);
        // SAFETY: a plain creation, destroyed in `drop`; the command buffer is recording outside a rendering instance.
        unsafe {
            let pool = device.create_query_pool(&create, None).map_err(vulkan("vkCreateQueryPool"))?;
            self.timestamps.push(pool);
            device.cmd_reset_query_pool(self.commands, pool, 0, count);
        }
        Ok(())
    }

    /// Software devices take a timestamp when their queue next drains, which may be passes later: a full barrier drains
    /// it. Others order timestamps by stage.
    fn settle(&self) {
        if self.context.capabilities.kind != vk::PhysicalDeviceType::CPU {
            return;
        }
        let everything = vk::PipelineStageFlags::ALL_COMMANDS;
        let memory = vk::MemoryBarrier::default();
        let none = vk::DependencyFlags::empty();
        // SAFETY: the command buffer is recording outside a rendering instance.
        unsafe {
            let device = &self.context.device;
            device.cmd_pipeline_barrier(self.commands, everything, everything, none, &[memory], &[], &[]);
        }
    }

    /// Makes what came before, used so, visible to what comes after, used so.
    pub fn barrier(&mut self, before: &[Use], after: &[Use]) {
        barrier(&self.context.device, self.commands, before, after);
    }

    /// Submits, waits, and adds times and counts to `profile` and to the context's trace.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn finish(mut self, profile: &mut Profile) -> Result<()> {
        if let Some(error) = self.failed.take() {
            return Err(error);
        }
        let context = &self.context;
        let trace = &context.trace;
        let submission = context.next_submission();
        let span = trace.span("submission");
        span.count("submission", submission);
        let submitted = trace.now();
        submit_and_wait(context, self.commands)?;
        let window = submitted..trace.now();
        drop(span);
        let stamps = self.read_timestamps()?;
        for (at, RecordedPass { name, counts }) in self.passes.iter().enumerate() {
            let pass = profile.passes.entry(name).or_default();
            pass.runs += 1;
            if let Some([begin, end]) = stamps.get(at) {
                pass.gpu_ms += context.clock.nanoseconds(*begin, *end).max(0.0) * 1e-6;
            }
            for (what, amount) in counts {
                profile.count(name, what, *amount);
            }
        }
        if trace.is_on() {
            let places = context.clock.place(&stamps, window, context.clock.read(trace));
            for (RecordedPass { name, counts }, place) in self.passes.iter().zip(places) {
                trace.pass(submission, name, place, counts);
            }
        }
        Ok(())
    }

    /// Begin and end of every pass, after the submission is done; none on a device without timestamps.
    fn read_timestamps(&self) -> Result<Vec<[u64; 2]>> {
        let mut stamps = vec![[0_u64; 2]; if self.timestamps.is_empty() { 0 } else { self.passes.len() }];
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        for (pool, part) in self.timestamps.iter().zip(stamps.chunks_mut(PASSES_PER_POOL)) {
            let flat: &mut [u64] = part.as_flattened_mut();
            // SAFETY: every query asked for was written in the submission that was waited for.
            unsafe { self.context.device.get_query_pool_results(*pool, 0, flat, flags) }
                .map_err(vulkan("vkGetQueryPoolResults"))?;
        }
        Ok(stamps)
    }
}

impl Context {
    /// Adds counts that are known only after a pass's submission to `profile` and to the trace.
    pub(crate) fn count(&self, profile: &mut Profile, pass: &'static str, counts: &[(&'static str, u64)]) {
        for (what, amount) in counts {
            profile.count(pass, what, *amount);
        }
        self.trace.count(pass, counts);
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // SAFETY: a submission was waited for; null handles are ignored.
        unsafe {
            for pool in &self.timestamps {
                self.context.device.destroy_query_pool(*pool, None);
            }
            self.context.device.destroy_command_pool(self.pool, None);
        }
    }
}

/// A memory barrier between uses.
pub(crate) fn barrier(device: &ash::Device, commands: vk::CommandBuffer, before: &[Use], after: &[Use]) {
    let join = |uses: &[Use]| {
        uses.iter().fold((vk::PipelineStageFlags::empty(), vk::AccessFlags::empty()), |(stages, access), u| {
            let scope = u.scope();
            (stages | scope.stages, access | scope.access)
        })
    };
    let ((before_stages, before_access), (after_stages, after_access)) = (join(before), join(after));
    let memory = vk::MemoryBarrier::default().src_access_mask(before_access).dst_access_mask(after_access);
    // SAFETY: `commands` is recording outside a rendering instance.
    unsafe {
        device.cmd_pipeline_barrier(
            commands,
            before_stages,
            after_stages,
            vk::DependencyFlags::empty(),
            &[memory],
            &[],
            &[],
        );
    }
}

fn submit_and_wait(context: &Context, commands: vk::CommandBuffer) -> Result<()> {
    let device = &context.device;
    // SAFETY: the command buffer is recording and complete; the fence is destroyed after the wait.
    unsafe {
        device.end_command_buffer(commands).map_err(vulkan("vkEndCommandBuffer"))?;
        let fence = device.create_fence(&vk::FenceCreateInfo::default(), None).map_err(vulkan("vkCreateFence"))?;
        let buffers = [commands];
        let submit = vk::SubmitInfo::default().command_buffers(&buffers);
        let result = device
            .queue_submit(context.queue, &[submit], fence)
            .map_err(vulkan("vkQueueSubmit"))
            .and_then(|()| device.wait_for_fences(&[fence], true, u64::MAX).map_err(vulkan("vkWaitForFences")));
        device.destroy_fence(fence, None);
        result
    }
}

/// Records, submits and waits for commands that are no pass: uploads and downloads.
pub(crate) fn run_once(context: &Arc<Context>, record: impl FnOnce(&ash::Device, vk::CommandBuffer)) -> Result<()> {
    let mut recorder = Recorder::new(context)?;
    recorder.pass(TRANSFER, |device, commands| {
        let everything = vk::PipelineStageFlags::ALL_COMMANDS;
        let memory = vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
            .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE);
        let none = vk::DependencyFlags::empty();
        // SAFETY: the command buffer is recording.
        unsafe { device.cmd_pipeline_barrier(commands, everything, everything, none, &[memory], &[], &[]) };
        record(device, commands);
        barrier(device, commands, &[Use::CopyTarget], &[Use::HostRead, Use::ComputeWrite]);
    });
    recorder.finish(&mut Profile::default())
}
