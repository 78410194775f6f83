//! What a buffer or image is used for. Barriers name uses; this table is the only place that knows stages, accesses
//! and layouts.

use ash::vk;

/// One way of using memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// Contents that do not matter.
    Undefined,
    /// Source of a copy.
    CopySource,
    /// Target of a copy or fill.
    CopyTarget,
    /// Read by a compute shader as a storage buffer.
    ComputeRead,
    /// Read and written by a compute shader as a storage buffer.
    ComputeWrite,
    /// Read and written by a compute shader as a storage image.
    StorageImage,
    /// Read through a sampler, by any shader.
    SampledRead,
    /// Read by a vertex or fragment shader from a buffer.
    VertexRead,
    /// Written as a colour attachment.
    ColorTarget,
    /// Written as a depth attachment.
    DepthTarget,
    /// Written by transform feedback, counters included.
    FeedbackWrite,
    /// Read as vertices, as the byte count of an indirect draw and as counters that feedback resumes from, then
    /// written by feedback again: one turn of the ping-pong loop.
    FeedbackTurn,
    /// Read as arguments of an indirect dispatch.
    IndirectArguments,
    /// Read by the host after a fence.
    HostRead,
}

pub(crate) struct Scope {
    pub(crate) stages: vk::PipelineStageFlags,
    pub(crate) access: vk::AccessFlags,
    pub(crate) layout: vk::ImageLayout,
}

impl Use {
    pub(crate) fn scope(self) -> Scope {
        use vk::{AccessFlags as A, ImageLayout as L, PipelineStageFlags as S};
        let feedback_writes = A::TRANSFORM_FEEDBACK_WRITE_EXT | A::TRANSFORM_FEEDBACK_COUNTER_WRITE_EXT;
        let (stages, access, layout) = match self {
            Self::Undefined => (S::TOP_OF_PIPE, A::empty(), L::UNDEFINED),
            Self::CopySource => (S::TRANSFER, A::TRANSFER_READ, L::TRANSFER_SRC_OPTIMAL),
            Self::CopyTarget => (S::TRANSFER, A::TRANSFER_WRITE, L::TRANSFER_DST_OPTIMAL),
            Self::ComputeRead => (S::COMPUTE_SHADER, A::SHADER_READ, L::GENERAL),
            Self::ComputeWrite => (S::COMPUTE_SHADER, A::SHADER_READ | A::SHADER_WRITE, L::GENERAL),
            Self::StorageImage => (S::COMPUTE_SHADER, A::SHADER_READ | A::SHADER_WRITE, L::GENERAL),
            Self::SampledRead => (S::COMPUTE_SHADER | S::FRAGMENT_SHADER, A::SHADER_READ, L::SHADER_READ_ONLY_OPTIMAL),
            Self::VertexRead => (S::VERTEX_SHADER | S::FRAGMENT_SHADER, A::SHADER_READ, L::UNDEFINED),
            Self::ColorTarget => (
                S::COLOR_ATTACHMENT_OUTPUT,
                A::COLOR_ATTACHMENT_READ | A::COLOR_ATTACHMENT_WRITE,
                L::COLOR_ATTACHMENT_OPTIMAL,
            ),
            Self::DepthTarget => (
                S::EARLY_FRAGMENT_TESTS | S::LATE_FRAGMENT_TESTS,
                A::DEPTH_STENCIL_ATTACHMENT_READ | A::DEPTH_STENCIL_ATTACHMENT_WRITE,
                L::DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
            ),
            Self::FeedbackWrite => (S::TRANSFORM_FEEDBACK_EXT, feedback_writes, L::UNDEFINED),
            Self::FeedbackTurn => (
                S::TRANSFORM_FEEDBACK_EXT | S::VERTEX_INPUT | S::DRAW_INDIRECT | S::GEOMETRY_SHADER,
                feedback_writes
                    | A::TRANSFORM_FEEDBACK_COUNTER_READ_EXT
                    | A::VERTEX_ATTRIBUTE_READ
                    | A::INDIRECT_COMMAND_READ
                    | A::SHADER_READ,
                L::UNDEFINED,
            ),
            Self::IndirectArguments => (S::DRAW_INDIRECT, A::INDIRECT_COMMAND_READ, L::UNDEFINED),
            Self::HostRead => (S::HOST, A::HOST_READ, L::UNDEFINED),
        };
        Scope { stages, access, layout }
    }
}
