//! The traversal by geometry shader and transform feedback (Sabbadin 2019, 5.2.1 and 5.2.2): [node, receiver] pairs go
//! round in a ping-pong loop of two buffers; a second stream collects the pairs that are done. All iterations are
//! recorded up front: one costs next to nothing once no pairs are left, and nothing is read back inside the loop.

use std::sync::Arc;

use ash::vk;

use super::{CutRules, GpuHierarchy, Receiver, Traversal};
use crate::gpu::context::vulkan;
use crate::gpu::pipeline::{DescriptorSet, Layout, Pipeline, Shader, Specialization};
use crate::gpu::recorder::barrier;
use crate::gpu::{Bindings, Buffer, Constant, Context, Recorder, Use};
use crate::{Error, Result};

/// A pair as it lies in the feedback buffers.
pub const PAIR_BYTES: u64 = 8;

/// Buffers of the loop, reused by every batch.
pub struct FeedbackBuffers {
    ping: Buffer,
    pong: Buffer,
    /// Pairs of the second stream.
    pub done: Buffer,
    /// One slot an iteration for stream 0, in bytes.
    counters: Buffer,
    /// Bytes in `done`.
    pub done_counter: Buffer,
    /// Pairs that each of the three pair buffers holds.
    pub capacity: u32,
}

impl FeedbackBuffers {
    /// Buffers for `capacity` pairs each.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, capacity: u32, iterations: u32) -> Result<Self> {
        let bytes = u64::from(capacity) * PAIR_BYTES;
        Ok(Self {
            ping: Buffer::new(context, "pairs ping", bytes)?,
            pong: Buffer::new(context, "pairs pong", bytes)?,
            done: Buffer::with_texels(context, "pairs done", bytes, vk::Format::R32G32_UINT)?,
            counters: Buffer::new(context, "feedback counters", u64::from(iterations) * 4)?,
            done_counter: Buffer::new(context, "feedback done counter", 4)?,
            capacity,
        })
    }
}

/// What the loop did, read after its submission.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TraverseCounts {
    /// Pairs that went into the geometry shader, over all iterations.
    pub pairs_in: u64,
    /// The same by iteration, up to the last that had any.
    pub by_iteration: Vec<u64>,
    /// Pairs of the second stream.
    pub pairs_done: u64,
    /// Most pairs in flight between two iterations.
    pub peak_pairs: u64,
    /// True when a buffer was too small; the batch is void then.
    pub overflowed: bool,
}

/// The pass.
pub struct TraversePass {
    context: Arc<Context>,
    pipeline: Pipeline,
    /// The pass's name in profiles.
    pub name: &'static str,
}

/// Queries of one loop; lives until they are read.
pub struct LoopQueries {
    context: Arc<Context>,
    pool: vk::QueryPool,
    iterations: u32,
    start_pairs: u32,
    _start: Buffer,
    _set: DescriptorSet,
}

impl TraversePass {
    /// Makes the pipeline for one of the two techniques.
    ///
    /// # Errors
    /// [`Error::Device`] where the device has no geometry shaders or transform feedback.
    pub fn new(context: &Arc<Context>, hybrid: bool, rules: CutRules) -> Result<Self> {
        if let Some(why) = context.why_no_feedback() {
            return Err(Error::Device(why));
        }
        let vertex = Shader::new(context, "traverse/traverse.vert")?;
        let geometry = Shader::new(context, "traverse/traverse.geom")?;
        let layout = Layout::new(context, &[&vertex.reflection, &geometry.reflection])?;
        let [cut, coverage, shared] = rules.constants();
        let specialization = Specialization::new(&[cut, coverage, shared, Constant::new(2, hybrid)]);
        let handle = make_pipeline(context, &vertex, &geometry, layout.handle, &specialization)?;
        let name = match rules.shared {
            true => "traverse (shared)",
            false if hybrid => "traverse (hybrid)",
            false => "traverse (mipmapped)",
        };
        Ok(Self { context: context.clone(), pipeline: Pipeline::new(context, handle, layout, name), name })
    }

    /// How many iterations a hierarchy can take: every one goes a level down in it or in the receivers.
    pub fn iterations(hierarchy: &GpuHierarchy) -> u32 {
        hierarchy.depth + Receiver::TILE_LEVEL + 1
    }

    /// Records the loop from pairs of the root with each of `start`.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        buffers: &FeedbackBuffers,
        bindings: &Bindings<'_>,
        start: &[Receiver],
        constants: Traversal,
        iterations: u32,
    ) -> Result<LoopQueries> {
        let pairs: Vec<[u32; 2]> = start.iter().map(|r| [0, r.0]).collect();
        let queries = LoopQueries {
            context: self.context.clone(),
            pool: self.query_pool(2 * iterations)?,
            iterations,
            start_pairs: start.len() as u32,
            _start: Buffer::from_slice(&self.context, "pairs start", &pairs)?,
            _set: self.pipeline.layout.bind(bindings)?,
        };
        recorder.pass(self.name, |device, commands| {
            // SAFETY: all handles are live until the submission is done, and the buffers have the usages.
            unsafe {
                device.cmd_reset_query_pool(commands, queries.pool, 0, 2 * iterations);
                device.cmd_fill_buffer(commands, buffers.done_counter.handle, 0, 4, 0);
            }
            barrier(device, commands, &[Use::CopyTarget], &[Use::FeedbackTurn]);
            // SAFETY: as above.
            unsafe {
                device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::GRAPHICS, self.pipeline.handle);
                device.cmd_bind_descriptor_sets(
                    commands,
                    vk::PipelineBindPoint::GRAPHICS,
                    self.pipeline.layout.handle,
                    0,
                    &[queries._set.handle],
                    &[],
                );
            }
            self.pipeline.layout.push(commands, &constants);
            for iteration in 0..iterations {
                self.iterate(device, commands, buffers, &queries, iteration);
                barrier(device, commands, &[Use::FeedbackWrite, Use::FeedbackTurn], &[Use::FeedbackTurn]);
            }
        });
        recorder.barrier(&[Use::FeedbackWrite], &[Use::ComputeRead, Use::CopySource]);
        Ok(queries)
    }

    /// One iteration: the pairs of the last one in, their successors out.
    fn iterate(
        &self,
        device: &ash::Device,
        commands: vk::CommandBuffer,
        buffers: &FeedbackBuffers,
        queries: &LoopQueries,
        iteration: u32,
    ) {
        let Some(feedback) = &self.context.feedback else { return };
        let (source, target) = match iteration {
            0 => (&queries._start, &buffers.ping),
            i if i % 2 == 1 => (&buffers.ping, &buffers.pong),
            _ => (&buffers.pong, &buffers.ping),
        };
        let size = u64::from(buffers.capacity) * PAIR_BYTES;
        let slot = u64::from(iteration) * 4;
        let area = vk::Rect2D { offset: vk::Offset2D::default(), extent: vk::Extent2D { width: 1, height: 1 } };
        let rendering = vk::RenderingInfo::default().render_area(area).layer_count(1);
        let call = feedback.fp();
        let targets = [target.handle, buffers.done.handle];
        // Stream 0 starts afresh; stream 1 goes on where the last iteration ended.
        let counters_before = [vk::Buffer::null(), buffers.done_counter.handle];
        let counters_after = [buffers.counters.handle, buffers.done_counter.handle];
        // SAFETY: the loop runs inside a command buffer that is recording; every buffer has the feedback, counter and
        // vertex usages, the arrays have two elements each, and the barrier after each iteration orders the next.
        unsafe {
            device.cmd_bind_vertex_buffers(commands, 0, &[source.handle], &[0]);
            (call.cmd_bind_transform_feedback_buffers_ext)(
                commands,
                0,
                2,
                targets.as_ptr(),
                [0, 0].as_ptr(),
                [size, size].as_ptr(),
            );
            self.context.begin_rendering(commands, &rendering);
            for stream in 0..2 {
                let query = 2 * iteration + stream;
                let flags = vk::QueryControlFlags::empty();
                (call.cmd_begin_query_indexed_ext)(commands, queries.pool, query, flags, stream);
            }
            (call.cmd_begin_transform_feedback_ext)(commands, 0, 2, counters_before.as_ptr(), [0, 0].as_ptr());
            if iteration == 0 {
                device.cmd_draw(commands, queries.start_pairs, 1, 0, 0);
            } else {
                let stride = PAIR_BYTES as u32;
                let counter = buffers.counters.handle;
                (call.cmd_draw_indirect_byte_count_ext)(commands, 1, 0, counter, slot - 4, 0, stride);
            }
            (call.cmd_end_transform_feedback_ext)(commands, 0, 2, counters_after.as_ptr(), [slot, 0].as_ptr());
            for stream in 0..2 {
                (call.cmd_end_query_indexed_ext)(commands, queries.pool, 2 * iteration + stream, stream);
            }
            self.context.end_rendering(commands);
        }
    }

    fn query_pool(&self, count: u32) -> Result<vk::QueryPool> {
        let create = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::TRANSFORM_FEEDBACK_STREAM_EXT)
            .query_count(count);
        // SAFETY: a plain creation; the pool is destroyed with `LoopQueries`.
        unsafe { self.context.device.create_query_pool(&create, None) }.map_err(vulkan("vkCreateQueryPool"))
    }
}

impl LoopQueries {
    /// Reads the counts after the submission is done.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn read(&self) -> Result<TraverseCounts> {
        // Written and needed, a pair of numbers a query.
        let mut results = vec![[0_u64; 2]; 2 * self.iterations as usize];
        // SAFETY: every query was ended in the submission that was waited for.
        unsafe {
            self.context
                .device
                .get_query_pool_results(
                    self.pool,
                    0,
                    &mut results,
                    vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT,
                )
                .map_err(vulkan("vkGetQueryPoolResults"))?;
        }
        let start = u64::from(self.start_pairs);
        let mut counts = TraverseCounts { pairs_in: start, by_iteration: vec![start], ..TraverseCounts::default() };
        for streams in results.chunks_exact(2) {
            let [[next_written, next_needed], [done_written, done_needed]] = [streams[0], streams[1]];
            counts.pairs_in += next_written;
            if next_written > 0 {
                counts.by_iteration.push(next_written);
            }
            counts.pairs_done += done_written;
            counts.peak_pairs = counts.peak_pairs.max(next_written);
            counts.overflowed |= next_needed > next_written || done_needed > done_written;
        }
        Ok(counts)
    }
}

impl Drop for LoopQueries {
    fn drop(&mut self) {
        // SAFETY: the submission that uses the pool was waited for.
        unsafe { self.context.device.destroy_query_pool(self.pool, None) };
    }
}

fn make_pipeline(
    context: &Arc<Context>,
    vertex: &Shader,
    geometry: &Shader,
    layout: vk::PipelineLayout,
    specialization: &Specialization,
) -> Result<vk::Pipeline> {
    let info = specialization.info();
    let stage = |shader: &Shader, stage| {
        vk::PipelineShaderStageCreateInfo::default().stage(stage).module(shader.module).name(c"main")
    };
    let stages = [
        stage(vertex, vk::ShaderStageFlags::VERTEX),
        stage(geometry, vk::ShaderStageFlags::GEOMETRY).specialization_info(&info),
    ];
    let bindings = [vk::VertexInputBindingDescription {
        binding: 0,
        stride: PAIR_BYTES as u32,
        input_rate: vk::VertexInputRate::VERTEX,
    }];
    let attributes =
        [vk::VertexInputAttributeDescription { location: 0, binding: 0, format: vk::Format::R32G32_UINT, offset: 0 }];
    let input = vk::PipelineVertexInputStateCreateInfo::default()
        .vertex_binding_descriptions(&bindings)
        .vertex_attribute_descriptions(&attributes);
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::POINT_LIST);
    let raster = vk::PipelineRasterizationStateCreateInfo::default().rasterizer_discard_enable(true).line_width(1.0);
    let mut rendering = vk::PipelineRenderingCreateInfo::default();
    let create = vk::GraphicsPipelineCreateInfo::default()
        .stages(&stages)
        .vertex_input_state(&input)
        .input_assembly_state(&assembly)
        .rasterization_state(&raster)
        .layout(layout)
        .push_next(&mut rendering);
    // SAFETY: everything that the create info points to outlives the call.
    unsafe { context.device.create_graphics_pipelines(vk::PipelineCache::null(), &[create], None) }
        .map_err(|(_, result)| vulkan("vkCreateGraphicsPipelines")(result))
        .map(|pipelines| pipelines[0])
}
