//! Pipelines whose layouts come from reflection, and bindings by name.

use std::sync::Arc;

use ash::vk;

use super::context::{Context, vulkan};
use super::memory::{Buffer, Image};
use super::reflect::{Binding, Reflection};
use super::shaders;
use crate::{Error, Result};

/// A specialisation constant: its id and 32-bit value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Constant {
    /// `constant_id` in the GLSL.
    pub id: u32,
    /// Value; booleans are 0 or 1.
    pub value: u32,
}

impl Constant {
    /// A constant by id and value.
    pub fn new(id: u32, value: impl Into<u32>) -> Self {
        Self { id, value: value.into() }
    }
}

/// A resource for a binding.
#[derive(Clone, Copy)]
pub enum Resource<'a> {
    /// A whole storage buffer.
    Buffer(&'a Buffer),
    /// An image read through a sampler.
    Sampled(&'a Image, vk::Sampler),
    /// A storage image.
    Storage(&'a Image),
}

/// Resources by the names that shaders give them. Shaders pick what they use; a name bound twice keeps the last.
#[derive(Clone, Default)]
pub struct Bindings<'a>(Vec<(&'static str, Resource<'a>)>);

impl<'a> Bindings<'a> {
    /// No resources.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a storage buffer under its block's name.
    pub fn buffer(mut self, name: &'static str, buffer: &'a Buffer) -> Self {
        self.0.push((name, Resource::Buffer(buffer)));
        self
    }

    /// Adds an image with a sampler.
    pub fn sampled(mut self, name: &'static str, image: &'a Image, sampler: vk::Sampler) -> Self {
        self.0.push((name, Resource::Sampled(image, sampler)));
        self
    }

    /// Adds a storage image.
    pub fn storage_image(mut self, name: &'static str, image: &'a Image) -> Self {
        self.0.push((name, Resource::Storage(image)));
        self
    }

    /// Adds all of another list.
    pub fn and(mut self, others: Self) -> Self {
        self.0.extend(others.0);
        self
    }

    fn find(&self, name: &str) -> Option<Resource<'a>> {
        self.0.iter().rev().find(|(known, _)| *known == name).map(|(_, r)| *r)
    }
}

/// Set layout and pipeline layout of one or more stages that share set 0 and a push constant block.
pub struct Layout {
    context: Arc<Context>,
    pub(crate) handle: vk::PipelineLayout,
    set_layout: vk::DescriptorSetLayout,
    bindings: Vec<Binding>,
    pub(crate) push_stages: vk::ShaderStageFlags,
    push_size: u32,
}

impl Layout {
    /// The layout that the stages ask for together.
    ///
    /// # Errors
    /// When two stages disagree about a binding, or a Vulkan call fails.
    pub fn new(context: &Arc<Context>, stages: &[&Reflection]) -> Result<Self> {
        let mut bindings: Vec<Binding> = Vec::new();
        for binding in stages.iter().flat_map(|s| &s.bindings) {
            match bindings.iter().find(|b| b.binding == binding.binding) {
                None => bindings.push(binding.clone()),
                // One buffer may be declared under several names, for views of different element types.
                Some(known) if known.kind == binding.kind => {}
                Some(known) => {
                    return Err(Error::Argument(format!(
                        "stages disagree about binding {}: {} and {}",
                        binding.binding, known.name, binding.name
                    )));
                }
            }
        }
        let all = stages.iter().fold(vk::ShaderStageFlags::empty(), |sum, s| sum | s.stage);
        let described: Vec<_> = bindings
            .iter()
            .map(|b| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(b.binding)
                    .descriptor_type(b.kind)
                    .descriptor_count(1)
                    .stage_flags(all)
            })
            .collect();
        let push_stages = stages
            .iter()
            .filter(|s| !s.push_constants.is_empty())
            .fold(vk::ShaderStageFlags::empty(), |sum, s| sum | s.stage);
        let push_size = stages.iter().map(|s| s.push_constant_size()).max().unwrap_or(0).next_multiple_of(4);
        let ranges = [vk::PushConstantRange { stage_flags: push_stages, offset: 0, size: push_size }];
        // SAFETY: plain creations; both handles are destroyed in `drop`.
        unsafe {
            let set_layout = context
                .device
                .create_descriptor_set_layout(&vk::DescriptorSetLayoutCreateInfo::default().bindings(&described), None)
                .map_err(vulkan("vkCreateDescriptorSetLayout"))?;
            let sets = [set_layout];
            let mut create = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets);
            if push_size > 0 {
                create = create.push_constant_ranges(&ranges);
            }
            let handle = match context.device.create_pipeline_layout(&create, None) {
                Ok(handle) => handle,
                Err(result) => {
                    context.device.destroy_descriptor_set_layout(set_layout, None);
                    return Err(vulkan("vkCreatePipelineLayout")(result));
                }
            };
            Ok(Self { context: context.clone(), handle, set_layout, bindings, push_stages, push_size })
        }
    }

    /// A descriptor set with the resources that the layout names.
    ///
    /// # Errors
    /// When a resource is missing or of another kind, or a Vulkan call fails.
    pub fn bind(&self, resources: &Bindings<'_>) -> Result<DescriptorSet> {
        let device = &self.context.device;
        let mut sizes: Vec<vk::DescriptorPoolSize> = Vec::new();
        for binding in &self.bindings {
            match sizes.iter_mut().find(|s| s.ty == binding.kind) {
                Some(size) => size.descriptor_count += 1,
                None => sizes.push(vk::DescriptorPoolSize { ty: binding.kind, descriptor_count: 1 }),
            }
        }
        // A layout without bindings still gets a set, from a pool that must not be empty.
        if sizes.is_empty() {
            sizes.push(vk::DescriptorPoolSize { ty: vk::DescriptorType::STORAGE_BUFFER, descriptor_count: 1 });
        }
        let create = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        // SAFETY: the pool is destroyed with the set that owns it.
        let pool = unsafe { device.create_descriptor_pool(&create, None) }.map_err(vulkan("vkCreateDescriptorPool"))?;
        let layouts = [self.set_layout];
        let allocate = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        let mut set = DescriptorSet { context: self.context.clone(), pool, handle: vk::DescriptorSet::null() };
        // SAFETY: pool and layout are live.
        set.handle =
            unsafe { device.allocate_descriptor_sets(&allocate) }.map_err(vulkan("vkAllocateDescriptorSets"))?[0];
        for binding in &self.bindings {
            let resource = resources
                .find(&binding.name)
                .ok_or_else(|| Error::Argument(format!("nothing is bound to {}", binding.name)))?;
            let mut write = vk::WriteDescriptorSet::default()
                .dst_set(set.handle)
                .dst_binding(binding.binding)
                .descriptor_type(binding.kind);
            let buffers;
            let images;
            let views;
            match (resource, binding.kind) {
                (Resource::Buffer(buffer), vk::DescriptorType::STORAGE_BUFFER) => {
                    buffers = [vk::DescriptorBufferInfo { buffer: buffer.handle, offset: 0, range: vk::WHOLE_SIZE }];
                    write = write.buffer_info(&buffers);
                }
                (
                    Resource::Buffer(buffer),
                    vk::DescriptorType::UNIFORM_TEXEL_BUFFER | vk::DescriptorType::STORAGE_TEXEL_BUFFER,
                ) if buffer.texels != vk::BufferView::null() => {
                    views = [buffer.texels];
                    write = write.texel_buffer_view(&views);
                }
                (Resource::Sampled(image, sampler), vk::DescriptorType::COMBINED_IMAGE_SAMPLER) => {
                    images = [vk::DescriptorImageInfo {
                        sampler,
                        image_view: image.view,
                        image_layout: vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
                    }];
                    write = write.image_info(&images);
                }
                (Resource::Storage(image), vk::DescriptorType::STORAGE_IMAGE) => {
                    images = [vk::DescriptorImageInfo {
                        sampler: vk::Sampler::null(),
                        image_view: image.view,
                        image_layout: vk::ImageLayout::GENERAL,
                    }];
                    write = write.image_info(&images);
                }
                _ => return Err(Error::Argument(format!("{} is bound to the wrong kind", binding.name))),
            }
            // SAFETY: the infos live until the call returns.
            unsafe { device.update_descriptor_sets(&[write], &[]) };
        }
        Ok(set)
    }

    pub(crate) fn push<T: bytemuck::NoUninit>(&self, commands: vk::CommandBuffer, constants: &T) {
        if self.push_size == 0 {
            return;
        }
        let bytes = bytemuck::bytes_of(constants);
        debug_assert!(bytes.len() as u32 >= self.push_size, "push constants are smaller than the shader's block");
        let bytes = &bytes[..bytes.len().min(self.push_size as usize)];
        // SAFETY: stages and size are those of the layout.
        unsafe { self.context.device.cmd_push_constants(commands, self.handle, self.push_stages, 0, bytes) };
    }
}

impl Drop for Layout {
    fn drop(&mut self) {
        // SAFETY: work that uses the layout is waited for before its owner drops it.
        unsafe {
            self.context.device.destroy_pipeline_layout(self.handle, None);
            self.context.device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

/// A descriptor set with a pool of its own.
pub struct DescriptorSet {
    context: Arc<Context>,
    pool: vk::DescriptorPool,
    pub(crate) handle: vk::DescriptorSet,
}

impl Drop for DescriptorSet {
    fn drop(&mut self) {
        // SAFETY: work that uses the set is waited for before its owner drops it.
        unsafe { self.context.device.destroy_descriptor_pool(self.pool, None) };
    }
}

/// A shader module with its reflection, alive only while pipelines are made from it.
pub(crate) struct Shader {
    context: Arc<Context>,
    pub(crate) module: vk::ShaderModule,
    pub(crate) reflection: Reflection,
}

impl Shader {
    pub(crate) fn new(context: &Arc<Context>, name: &str) -> Result<Self> {
        let words = shaders::spirv(name)?;
        let reflection = Reflection::of(&words)?;
        let create = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the words come from shaderc; the module is destroyed in `drop`.
        let module =
            unsafe { context.device.create_shader_module(&create, None) }.map_err(vulkan("vkCreateShaderModule"))?;
        Ok(Self { context: context.clone(), module, reflection })
    }
}

impl Drop for Shader {
    fn drop(&mut self) {
        // SAFETY: pipelines keep what they need of a module.
        unsafe { self.context.device.destroy_shader_module(self.module, None) };
    }
}

/// Specialisation data as Vulkan wants it.
pub(crate) struct Specialization {
    entries: Vec<vk::SpecializationMapEntry>,
    data: Vec<u32>,
}

impl Specialization {
    pub(crate) fn new(constants: &[Constant]) -> Self {
        let entries = constants
            .iter()
            .enumerate()
            .map(|(i, c)| vk::SpecializationMapEntry { constant_id: c.id, offset: 4 * i as u32, size: 4 })
            .collect();
        Self { entries, data: constants.iter().map(|c| c.value).collect() }
    }

    pub(crate) fn info(&self) -> vk::SpecializationInfo<'_> {
        vk::SpecializationInfo::default().map_entries(&self.entries).data(bytemuck::cast_slice(&self.data))
    }
}

/// A pipeline and its layout.
pub struct Pipeline {
    context: Arc<Context>,
    pub(crate) handle: vk::Pipeline,
    /// Layout, for binding resources.
    pub layout: Layout,
}

impl Pipeline {
    pub(crate) fn new(context: &Arc<Context>, handle: vk::Pipeline, layout: Layout, name: &str) -> Self {
        context.name_object(handle, name);
        Self { context: context.clone(), handle, layout }
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        // SAFETY: work that uses the pipeline is waited for before its owner drops it.
        unsafe { self.context.device.destroy_pipeline(self.handle, None) };
    }
}

/// A compute pipeline.
pub struct ComputePipeline {
    pub(crate) pipeline: Pipeline,
    /// Invocations of a workgroup.
    pub workgroup: u32,
    max_workgroups: u32,
}

impl ComputePipeline {
    /// Id of the constant that some shaders take for the invocations of their workgroup.
    pub const WORKGROUP: u32 = 11;

    /// Compiles the named shader with the given constants.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(context: &Arc<Context>, shader: &str, constants: &[Constant]) -> Result<Self> {
        let loaded = Shader::new(context, shader)?;
        let layout = Layout::new(context, &[&loaded.reflection])?;
        let specialization = Specialization::new(constants);
        let info = specialization.info();
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(loaded.module)
            .name(c"main")
            .specialization_info(&info);
        let create = vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout.handle);
        // SAFETY: module, layout and constants outlive the call.
        let handle = unsafe { context.device.create_compute_pipelines(vk::PipelineCache::null(), &[create], None) }
            .map_err(|(_, result)| vulkan("vkCreateComputePipelines")(result))?[0];
        Ok(Self {
            pipeline: Pipeline::new(context, handle, layout, shader),
            workgroup: constants
                .iter()
                .find(|c| c.id == Self::WORKGROUP)
                .map_or(loaded.reflection.workgroup, |c| c.value),
            max_workgroups: context.capabilities.max_workgroups,
        })
    }

    /// A descriptor set with the resources that the shader names.
    ///
    /// # Errors
    /// As [`Layout::bind`].
    pub fn bind(&self, resources: &Bindings<'_>) -> Result<DescriptorSet> {
        self.pipeline.layout.bind(resources)
    }

    /// Records one dispatch with at least `invocations` invocations.
    ///
    /// # Errors
    /// [`Error::Limit`] when that is more than the device dispatches at once.
    pub fn dispatch<T: bytemuck::NoUninit>(
        &self,
        commands: vk::CommandBuffer,
        set: &DescriptorSet,
        constants: &T,
        invocations: u32,
    ) -> Result<()> {
        let groups = invocations.div_ceil(self.workgroup);
        if groups > self.max_workgroups {
            let limit = self.max_workgroups;
            return Err(Error::Limit(format!("{groups} workgroups in one dispatch; the device allows {limit}")));
        }
        self.prepare(commands, set, constants);
        // SAFETY: pipeline, set and constants are bound.
        unsafe { self.pipeline.context.device.cmd_dispatch(commands, groups, 1, 1) };
        Ok(())
    }

    /// Records one dispatch whose workgroup counts lie at the start of `arguments`.
    pub fn dispatch_indirect<T: bytemuck::NoUninit>(
        &self,
        commands: vk::CommandBuffer,
        set: &DescriptorSet,
        constants: &T,
        arguments: &Buffer,
    ) {
        self.prepare(commands, set, constants);
        // SAFETY: as above; the arguments were written before by a pass with a barrier after it.
        unsafe { self.pipeline.context.device.cmd_dispatch_indirect(commands, arguments.handle, 0) };
    }

    fn prepare<T: bytemuck::NoUninit>(&self, commands: vk::CommandBuffer, set: &DescriptorSet, constants: &T) {
        let device = &self.pipeline.context.device;
        // SAFETY: all handles are live and the set was made from this pipeline's layout.
        unsafe {
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, self.pipeline.handle);
            device.cmd_bind_descriptor_sets(
                commands,
                vk::PipelineBindPoint::COMPUTE,
                self.pipeline.layout.handle,
                0,
                &[set.handle],
                &[],
            );
        }
        self.pipeline.layout.push(commands, constants);
    }
}

/// A sampler.
pub struct Sampler {
    context: Arc<Context>,
    pub(crate) handle: vk::Sampler,
}

impl Sampler {
    /// A sampler with one filter for everything, repeating along x and as given along y.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(context: &Arc<Context>, filter: vk::Filter, along_y: vk::SamplerAddressMode) -> Result<Self> {
        let mip =
            if filter == vk::Filter::LINEAR { vk::SamplerMipmapMode::LINEAR } else { vk::SamplerMipmapMode::NEAREST };
        let create = vk::SamplerCreateInfo::default()
            .mag_filter(filter)
            .min_filter(filter)
            .mipmap_mode(mip)
            .address_mode_u(vk::SamplerAddressMode::REPEAT)
            .address_mode_v(along_y)
            .max_lod(vk::LOD_CLAMP_NONE);
        // SAFETY: a plain creation; the handle is destroyed in `drop`.
        let handle = unsafe { context.device.create_sampler(&create, None) }.map_err(vulkan("vkCreateSampler"))?;
        Ok(Self { context: context.clone(), handle })
    }
}

impl Drop for Sampler {
    fn drop(&mut self) {
        // SAFETY: work that uses the sampler is waited for before its owner drops it.
        unsafe { self.context.device.destroy_sampler(self.handle, None) };
    }
}
