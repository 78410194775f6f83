//! Graphics pipelines with a vertex buffer, colour attachments and a depth test.

use std::sync::Arc;

use ash::vk;

use super::context::{Context, vulkan};
use super::pipeline::{Constant, Layout, Pipeline, Shader, Specialization};
use crate::Result;

/// What a graphics pipeline is made of.
pub(crate) struct GraphicsInfo<'a> {
    /// Name in captures.
    pub(crate) name: &'a str,
    /// Vertex and fragment shader, as files below `glsl/`.
    pub(crate) shaders: [&'a str; 2],
    /// For both of them.
    pub(crate) constants: &'a [Constant],
    /// What vertices make.
    pub(crate) topology: vk::PrimitiveTopology,
    /// Bytes from a vertex to the next.
    pub(crate) stride: usize,
    /// Format and offset in a vertex of each location.
    pub(crate) attributes: &'a [(vk::Format, usize)],
    /// Formats of the colour attachments.
    pub(crate) colors: &'a [vk::Format],
    /// Fragments whose depth compares so with what is there are kept.
    pub(crate) nearer: vk::CompareOp,
}

/// Makes a pipeline that draws into attachments of any size, with a 32-bit float depth attachment. Scans and quick
/// models are often open or turned inside out: both sides of triangles are drawn.
///
/// # Errors
/// When a Vulkan call fails.
pub(crate) fn graphics_pipeline(context: &Arc<Context>, info: &GraphicsInfo<'_>) -> Result<Pipeline> {
    let vertex = Shader::new(context, info.shaders[0])?;
    let fragment = Shader::new(context, info.shaders[1])?;
    let layout = Layout::new(context, &[&vertex.reflection, &fragment.reflection])?;
    let specialization = Specialization::new(info.constants);
    let constants = specialization.info();
    let stages = [(&vertex, vk::ShaderStageFlags::VERTEX), (&fragment, vk::ShaderStageFlags::FRAGMENT)].map(
        |(shader, stage)| {
            vk::PipelineShaderStageCreateInfo::default()
                .stage(stage)
                .module(shader.module)
                .name(c"main")
                .specialization_info(&constants)
        },
    );
    let bindings = [vk::VertexInputBindingDescription {
        binding: 0,
        stride: info.stride as u32,
        input_rate: vk::VertexInputRate::VERTEX,
    }];
    let attributes: Vec<_> = info
        .attributes
        .iter()
        .zip(0..)
        .map(|(&(format, offset), location)| vk::VertexInputAttributeDescription {
            location,
            binding: 0,
            format,
            offset: offset as u32,
        })
        .collect();
    let input = vk::PipelineVertexInputStateCreateInfo::default()
        .vertex_binding_descriptions(&bindings)
        .vertex_attribute_descriptions(&attributes);
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(info.topology);
    let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
    let raster = vk::PipelineRasterizationStateCreateInfo::default().cull_mode(vk::CullModeFlags::NONE).line_width(1.0);
    let samples = vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let depth = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(info.nearer);
    let mask = vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::RGBA);
    let masks = vec![mask; info.colors.len()];
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&masks);
    let dynamic = vk::PipelineDynamicStateCreateInfo::default()
        .dynamic_states(&[vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR]);
    let mut rendering = vk::PipelineRenderingCreateInfo::default()
        .color_attachment_formats(info.colors)
        .depth_attachment_format(vk::Format::D32_SFLOAT);
    let create = vk::GraphicsPipelineCreateInfo::default()
        .stages(&stages)
        .vertex_input_state(&input)
        .input_assembly_state(&assembly)
        .viewport_state(&viewport)
        .rasterization_state(&raster)
        .multisample_state(&samples)
        .depth_stencil_state(&depth)
        .color_blend_state(&blend)
        .dynamic_state(&dynamic)
        .layout(layout.handle)
        .push_next(&mut rendering);
    // SAFETY: everything that the create info points to outlives the call.
    let handle = unsafe { context.device.create_graphics_pipelines(vk::PipelineCache::null(), &[create], None) }
        .map_err(|(_, result)| vulkan("vkCreateGraphicsPipelines")(result))?[0];
    Ok(Pipeline::new(context, handle, layout, info.name))
}
