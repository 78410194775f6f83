//! Command recording: every pass gets a debug label, a pair of timestamps and a place in the profile here, never by
//! its own hand.

use std::collections::BTreeMap;
use std::sync::Arc;

use ash::vk;

use super::context::{Context, vulkan};
use super::uses::Use;
use crate::Result;

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

/// Passes of one submission; more are recorded without timestamps.
const MAX_PASSES: u32 = 1024;

/// Records one submission.
pub struct Recorder {
    context: Arc<Context>,
    pool: vk::CommandPool,
    /// The command buffer, for passes.
    pub(crate) commands: vk::CommandBuffer,
    timestamps: vk::QueryPool,
    passes: Vec<&'static str>,
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
                timestamps: vk::QueryPool::null(),
                passes: Vec::new(),
            };
            let allocate = vk::CommandBufferAllocateInfo::default()
                .command_pool(pool)
                .level(vk::CommandBufferLevel::PRIMARY)
                .command_buffer_count(1);
            recorder.commands =
                device.allocate_command_buffers(&allocate).map_err(vulkan("vkAllocateCommandBuffers"))?[0];
            let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            device.begin_command_buffer(recorder.commands, &begin).map_err(vulkan("vkBeginCommandBuffer"))?;
            // A begin and an end a pass.
            let create =
                vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(2 * MAX_PASSES);
            recorder.timestamps = device.create_query_pool(&create, None).map_err(vulkan("vkCreateQueryPool"))?;
            device.cmd_reset_query_pool(recorder.commands, recorder.timestamps, 0, 2 * MAX_PASSES);
            Ok(recorder)
        }
    }

    /// The context that the commands are for.
    pub fn context(&self) -> &Arc<Context> {
        &self.context
    }

    /// Records a pass: label, timestamps, and what `record` adds.
    pub fn pass<T>(&mut self, name: &'static str, record: impl FnOnce(&ash::Device, vk::CommandBuffer) -> T) -> T {
        let device = &self.context.device;
        let first = 2 * self.passes.len() as u32;
        let timed = first + 1 < 2 * MAX_PASSES;
        self.context.begin_label(self.commands, name);
        let stage = vk::PipelineStageFlags::BOTTOM_OF_PIPE;
        let stamp = |query| {
            if timed {
                // SAFETY: the command buffer is recording and the queries were reset at its start.
                unsafe { device.cmd_write_timestamp(self.commands, stage, self.timestamps, query) };
                self.settle();
            }
        };
        stamp(first);
        let result = record(device, self.commands);
        self.settle();
        stamp(first + 1);
        if timed {
            self.passes.push(name);
        }
        self.context.end_label(self.commands);
        result
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

    /// Submits, waits, and adds the times to `profile`.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn finish(self, profile: &mut Profile) -> Result<()> {
        submit_and_wait(&self.context, self.commands)?;
        if self.passes.is_empty() {
            return Ok(());
        }
        let mut times = vec![0_u64; 2 * self.passes.len()];
        // SAFETY: every query asked for was written in the submission that was waited for.
        unsafe {
            self.context
                .device
                .get_query_pool_results(
                    self.timestamps,
                    0,
                    &mut times,
                    vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT,
                )
                .map_err(vulkan("vkGetQueryPoolResults"))?;
        }
        for (name, stamps) in self.passes.iter().zip(times.chunks_exact(2)) {
            let ticks = stamps[1].wrapping_sub(stamps[0]) & self.context.timestamp_mask;
            let pass = profile.passes.entry(name).or_default();
            pass.gpu_ms += ticks as f64 * f64::from(self.context.timestamp_period) * 1e-6;
            pass.runs += 1;
        }
        Ok(())
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // SAFETY: a submission was waited for; null handles are ignored.
        unsafe {
            self.context.device.destroy_query_pool(self.timestamps, None);
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
    let recorder = Recorder::new(context)?;
    let everything = vk::PipelineStageFlags::ALL_COMMANDS;
    let memory = vk::MemoryBarrier::default()
        .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
        .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE);
    // SAFETY: the command buffer is recording.
    unsafe {
        context.device.cmd_pipeline_barrier(
            recorder.commands,
            everything,
            everything,
            vk::DependencyFlags::empty(),
            &[memory],
            &[],
            &[],
        );
    }
    record(&context.device, recorder.commands);
    barrier(&context.device, recorder.commands, &[Use::CopyTarget], &[Use::HostRead, Use::ComputeWrite]);
    recorder.finish(&mut Profile::default())
}
