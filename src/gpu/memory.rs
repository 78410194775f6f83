//! Buffers and images with names; every byte is counted by the context.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};

use super::context::{Context, vulkan};
use super::recorder::run_once;
use super::uses::Use;
use crate::{Error, Result};

/// Uploads and downloads go through a staging buffer of at most this many bytes, or one row of an image.
const PIECE: usize = 4 << 20;

/// A buffer on the device.
pub struct Buffer {
    context: Arc<Context>,
    allocation: Option<Allocation>,
    pub(crate) handle: vk::Buffer,
    /// View for texel fetches; null for a buffer that has none.
    pub(crate) texels: vk::BufferView,
    /// Size in bytes.
    pub size: u64,
}

impl Buffer {
    /// A storage buffer of `size` bytes (at least 16) on the device, usable for everything that relume does with
    /// buffers.
    ///
    /// # Errors
    /// [`Error::Limit`] when it is larger than the device's storage buffers may be or does not fit its memory.
    pub fn new(context: &Arc<Context>, name: &str, size: u64) -> Result<Self> {
        let mut usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST
            | vk::BufferUsageFlags::VERTEX_BUFFER
            | vk::BufferUsageFlags::INDEX_BUFFER
            | vk::BufferUsageFlags::INDIRECT_BUFFER
            | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER
            | vk::BufferUsageFlags::STORAGE_TEXEL_BUFFER;
        if context.feedback.is_some() {
            usage |= vk::BufferUsageFlags::TRANSFORM_FEEDBACK_BUFFER_EXT
                | vk::BufferUsageFlags::TRANSFORM_FEEDBACK_COUNTER_BUFFER_EXT;
        }
        let limit = context.capabilities.max_storage_range;
        if size > limit {
            return Err(Error::Limit(format!(
                "{name} needs {size} bytes, but a storage buffer of {} holds at most {limit}",
                context.capabilities.name
            )));
        }
        Self::with_usage(context, name, size.max(16), usage, MemoryLocation::GpuOnly)
    }

    /// A buffer that shaders may also read by texel fetches in `format`: what many invocations read at scattered
    /// places, since devices (a software one above all) fetch a whole texel faster than its words one by one.
    ///
    /// # Errors
    /// As [`Buffer::new`]; also when it has more texels than the device's views may have.
    pub fn with_texels(context: &Arc<Context>, name: &str, size: u64, format: vk::Format) -> Result<Self> {
        let texel = match format {
            vk::Format::R32G32B32A32_SFLOAT | vk::Format::R32G32B32A32_UINT => 16,
            vk::Format::R32G32_UINT => 8,
            vk::Format::R16_UINT => 2,
            _ => 4,
        };
        let limit = u64::from(context.capabilities.max_texels);
        if size / texel > limit {
            let (count, device) = (size / texel, &context.capabilities.name);
            return Err(Error::Limit(format!("{name} has {count} elements, but {device} reads at most {limit}")));
        }
        let mut buffer = Self::new(context, name, size)?;
        let create = vk::BufferViewCreateInfo::default().buffer(buffer.handle).format(format).range(vk::WHOLE_SIZE);
        // SAFETY: the buffer is live and has the usage; the view is destroyed before it.
        buffer.texels =
            unsafe { context.device.create_buffer_view(&create, None) }.map_err(vulkan("vkCreateBufferView"))?;
        Ok(buffer)
    }

    /// [`Buffer::with_texels`] with the given contents.
    ///
    /// # Errors
    /// As [`Buffer::with_texels`].
    pub fn texels_from_slice<T: bytemuck::NoUninit>(
        context: &Arc<Context>,
        name: &str,
        data: &[T],
        format: vk::Format,
    ) -> Result<Self> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = Self::with_texels(context, name, bytes.len() as u64, format)?;
        buffer.upload(bytes)?;
        Ok(buffer)
    }

    fn with_usage(
        context: &Arc<Context>,
        name: &str,
        size: u64,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
    ) -> Result<Self> {
        let info = vk::BufferCreateInfo::default().size(size).usage(usage);
        // SAFETY: a plain creation; the handle is destroyed in `drop`.
        let handle = unsafe { context.device.create_buffer(&info, None) }.map_err(vulkan("vkCreateBuffer"))?;
        // SAFETY: the handle is live.
        let requirements = unsafe { context.device.get_buffer_memory_requirements(handle) };
        let allocation = context.allocator().allocate(&AllocationCreateDesc {
            name,
            requirements,
            location,
            linear: true,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        });
        let allocation = match allocation {
            Ok(allocation) => allocation,
            Err(error) => {
                // SAFETY: the handle is not used again.
                unsafe { context.device.destroy_buffer(handle, None) };
                return Err(Error::Limit(format!("no device memory for {name} ({size} bytes): {error}")));
            }
        };
        // SAFETY: the allocation is kept in the buffer for as long as the memory is bound.
        let (memory, offset) = (unsafe { allocation.memory() }, allocation.offset());
        context.count_bytes(size);
        let texels = vk::BufferView::null();
        let buffer = Self { context: context.clone(), handle, texels, size, allocation: Some(allocation) };
        // SAFETY: memory and offset come from the allocator for these requirements.
        unsafe { context.device.bind_buffer_memory(handle, memory, offset) }.map_err(vulkan("vkBindBufferMemory"))?;
        context.name_object(handle, name);
        Ok(buffer)
    }

    /// A buffer with the given contents.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn from_slice<T: bytemuck::NoUninit>(context: &Arc<Context>, name: &str, data: &[T]) -> Result<Self> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = Self::new(context, name, bytes.len() as u64)?;
        buffer.upload(bytes)?;
        Ok(buffer)
    }

    /// A buffer that the host writes ([`Buffer::mapped_mut`]) and the device copies from.
    ///
    /// # Errors
    /// [`Error::Limit`] where it does not fit the memory.
    pub(crate) fn staging_to_device(context: &Arc<Context>, size: u64) -> Result<Self> {
        Self::staging(context, size, MemoryLocation::CpuToGpu)
    }

    fn staging(context: &Arc<Context>, size: u64, location: MemoryLocation) -> Result<Self> {
        let usage = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
        Self::with_usage(context, "staging", size.max(16), usage, location)
    }

    /// Copies `bytes` to the start of the buffer, in pieces so that staging stays small.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn upload(&self, bytes: &[u8]) -> Result<()> {
        self.upload_at(0, bytes)
    }

    /// Copies `bytes` to `offset` bytes from the start, where they must fit.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn upload_at(&self, offset: u64, bytes: &[u8]) -> Result<()> {
        if bytes.is_empty() {
            return Ok(());
        }
        let mut staging = Self::staging(&self.context, bytes.len().min(PIECE) as u64, MemoryLocation::CpuToGpu)?;
        for (i, piece) in bytes.chunks(PIECE).enumerate() {
            staging.mapped_mut()?[..piece.len()].copy_from_slice(piece);
            let region = vk::BufferCopy::default().dst_offset(offset + (i * PIECE) as u64).size(piece.len() as u64);
            run_once(&self.context, |device, commands| {
                // SAFETY: both buffers are live and large enough for the region.
                unsafe { device.cmd_copy_buffer(commands, staging.handle, self.handle, &[region]) };
            })?;
        }
        Ok(())
    }

    /// The first `count` values of the buffer.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn download<T: bytemuck::Pod>(&self, count: usize) -> Result<Vec<T>> {
        self.download_at(0, count)
    }

    /// `count` values from `offset` bytes on.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn download_at<T: bytemuck::Pod>(&self, offset: u64, count: usize) -> Result<Vec<T>> {
        let total = count * size_of::<T>();
        let mut bytes = vec![0_u8; total];
        if total == 0 {
            return Ok(Vec::new());
        }
        let staging = Self::staging(&self.context, total.min(PIECE) as u64, MemoryLocation::GpuToCpu)?;
        for (i, piece) in bytes.chunks_mut(PIECE).enumerate() {
            let region = vk::BufferCopy::default().src_offset(offset + (i * PIECE) as u64).size(piece.len() as u64);
            run_once(&self.context, |device, commands| {
                // SAFETY: both buffers are live and large enough for the region.
                unsafe { device.cmd_copy_buffer(commands, self.handle, staging.handle, &[region]) };
            })?;
            piece.copy_from_slice(&staging.mapped()?[..piece.len()]);
        }
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }

    fn mapped(&self) -> Result<&[u8]> {
        self.allocation
            .as_ref()
            .and_then(Allocation::mapped_slice)
            .ok_or_else(|| Error::Device("staging memory is not mapped".into()))
    }

    /// The memory of a staging buffer; no submission that reads it may be under way.
    ///
    /// # Errors
    /// [`Error::Device`] for a buffer that the host does not see.
    pub(crate) fn mapped_mut(&mut self) -> Result<&mut [u8]> {
        let size = self.size as usize;
        self.allocation
            .as_mut()
            .and_then(Allocation::mapped_slice_mut)
            .map(|bytes| &mut bytes[..size])
            .ok_or_else(|| Error::Device("staging memory is not mapped".into()))
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: work that uses the buffer is waited for before its owner drops it.
        unsafe {
            self.context.device.destroy_buffer_view(self.texels, None);
            self.context.device.destroy_buffer(self.handle, None);
        }
        if let Some(allocation) = self.allocation.take() {
            // Freeing a live allocation does not fail.
            let _ = self.context.allocator().free(allocation);
        }
        self.context.uncount_bytes(self.size);
    }
}

/// A 2D image on the device with one view of all its levels.
pub struct Image {
    context: Arc<Context>,
    allocation: Option<Allocation>,
    bytes: u64,
    pub(crate) handle: vk::Image,
    pub(crate) view: vk::ImageView,
    /// Texel format.
    pub format: vk::Format,
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// Mip levels.
    pub levels: u32,
}

/// What an image is made of.
#[derive(Clone, Copy, Debug)]
pub struct ImageInfo<'a> {
    /// Name in captures.
    pub name: &'a str,
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// Mip levels.
    pub levels: u32,
    /// Texel format.
    pub format: vk::Format,
    /// What it is used for, besides copies.
    pub usage: vk::ImageUsageFlags,
}

impl Image {
    /// An image with undefined contents.
    ///
    /// # Errors
    /// [`Error::Limit`] when it is too large for the device or its memory.
    pub fn new(context: &Arc<Context>, info: ImageInfo<'_>) -> Result<Self> {
        let limit = context.capabilities.max_image_size;
        if info.width.max(info.height) > limit {
            return Err(Error::Limit(format!(
                "{} is {} x {} texels, but an image of {} has at most {limit} a side",
                info.name, info.width, info.height, context.capabilities.name
            )));
        }
        let create = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(info.format)
            .extent(vk::Extent3D { width: info.width, height: info.height, depth: 1 })
            .mip_levels(info.levels)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(info.usage | vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST);
        // SAFETY: a plain creation; the handle is destroyed in `drop`.
        let handle = unsafe { context.device.create_image(&create, None) }.map_err(vulkan("vkCreateImage"))?;
        // SAFETY: the handle is live.
        let requirements = unsafe { context.device.get_image_memory_requirements(handle) };
        let mut image = Self {
            context: context.clone(),
            allocation: None,
            bytes: requirements.size,
            handle,
            view: vk::ImageView::null(),
            format: info.format,
            width: info.width,
            height: info.height,
            levels: info.levels,
        };
        context.count_bytes(requirements.size);
        let allocation = context
            .allocator()
            .allocate(&AllocationCreateDesc {
                name: info.name,
                requirements,
                location: MemoryLocation::GpuOnly,
                linear: false,
                allocation_scheme: AllocationScheme::GpuAllocatorManaged,
            })
            .map_err(|e| {
                Error::Limit(format!("no device memory for {} ({} bytes): {e}", info.name, requirements.size))
            })?;
        let (memory, offset) = {
            // SAFETY: the allocation is kept in the image for as long as the memory is bound.
            (unsafe { allocation.memory() }, allocation.offset())
        };
        image.allocation = Some(allocation);
        let aspect = if info.usage.contains(vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT) {
            vk::ImageAspectFlags::DEPTH
        } else {
            vk::ImageAspectFlags::COLOR
        };
        // SAFETY: memory and offset come from the allocator for these requirements; the view is destroyed in `drop`.
        unsafe {
            context.device.bind_image_memory(handle, memory, offset).map_err(vulkan("vkBindImageMemory"))?;
            let view = vk::ImageViewCreateInfo::default()
                .image(handle)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(info.format)
                .subresource_range(range_of(aspect, info.levels));
            image.view = context.device.create_image_view(&view, None).map_err(vulkan("vkCreateImageView"))?;
        }
        context.name_object(handle, info.name);
        Ok(image)
    }

    /// A sampled image with the given levels, each tightly packed.
    ///
    /// # Errors
    /// As [`Image::new`].
    pub fn with_contents(context: &Arc<Context>, info: ImageInfo<'_>, levels: &[&[u8]]) -> Result<Self> {
        let image = Self::new(context, info)?;
        image.replace(Use::Undefined, levels)?;
        Ok(image)
    }

    /// Replaces all levels, each tightly packed, of a sampled image that was used as `before`.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub(crate) fn replace(&self, before: Use, levels: &[&[u8]]) -> Result<()> {
        let context = &self.context;
        run_once(context, |device, commands| self.transition(device, commands, before, Use::CopyTarget))?;
        for (level, texels) in levels.iter().enumerate() {
            self.upload_level(level as u32, (self.height >> level).max(1), texels)?;
        }
        run_once(context, |device, commands| self.transition(device, commands, Use::CopyTarget, Use::SampledRead))
    }

    /// Fills a level of `height` rows, as many rows at once as the staging buffer holds. The image must be a copy target.
    fn upload_level(&self, level: u32, height: u32, texels: &[u8]) -> Result<()> {
        let row = texels.len() / height as usize;
        let rows = (PIECE / row).clamp(1, height as usize);
        let mut staging = Buffer::staging(&self.context, (rows * row) as u64, MemoryLocation::CpuToGpu)?;
        for (i, piece) in texels.chunks(rows * row).enumerate() {
            staging.mapped_mut()?[..piece.len()].copy_from_slice(piece);
            let region = vk::BufferImageCopy::default()
                .image_subresource(layers_of(vk::ImageAspectFlags::COLOR, level))
                .image_offset(vk::Offset3D { x: 0, y: (i * rows) as i32, z: 0 })
                .image_extent(vk::Extent3D {
                    width: (self.width >> level).max(1),
                    height: (piece.len() / row) as u32,
                    depth: 1,
                });
            run_once(&self.context, |device, commands| {
                let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
                // SAFETY: the region lies inside the staging buffer and the image, which is in this layout.
                unsafe {
                    device.cmd_copy_buffer_to_image(commands, staging.handle, self.handle, layout, &[region]);
                }
            })?;
        }
        Ok(())
    }

    /// Texels of level 0, tightly packed rows from the top. The image must be in the layout of `now` and stays there.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn download(&self, now: Use, bytes_per_texel: usize) -> Result<Vec<u8>> {
        let total = self.width as usize * self.height as usize * bytes_per_texel;
        let staging = Buffer::staging(&self.context, total as u64, MemoryLocation::GpuToCpu)?;
        let region = vk::BufferImageCopy::default()
            .image_subresource(layers_of(self.aspect(), 0))
            .image_extent(vk::Extent3D { width: self.width, height: self.height, depth: 1 });
        run_once(&self.context, |device, commands| {
            self.transition(device, commands, now, Use::CopySource);
            // SAFETY: the region lies inside both, and the image is in this layout.
            unsafe {
                device.cmd_copy_image_to_buffer(
                    commands,
                    self.handle,
                    vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
                    staging.handle,
                    &[region],
                );
            }
            self.transition(device, commands, Use::CopySource, now);
        })?;
        Ok(staging.mapped()?[..total].to_vec())
    }

    fn aspect(&self) -> vk::ImageAspectFlags {
        if self.format == vk::Format::D32_SFLOAT { vk::ImageAspectFlags::DEPTH } else { vk::ImageAspectFlags::COLOR }
    }

    /// Records the change from one use to the next, all levels.
    pub(crate) fn transition(&self, device: &ash::Device, commands: vk::CommandBuffer, before: Use, after: Use) {
        let (before, after) = (before.scope(), after.scope());
        let barrier = vk::ImageMemoryBarrier::default()
            .src_access_mask(before.access)
            .dst_access_mask(after.access)
            .old_layout(before.layout)
            .new_layout(after.layout)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(self.handle)
            .subresource_range(range_of(self.aspect(), self.levels));
        // SAFETY: `commands` is recording and the image outlives its execution.
        unsafe {
            device.cmd_pipeline_barrier(
                commands,
                before.stages,
                after.stages,
                vk::DependencyFlags::empty(),
                &[],
                &[],
                &[barrier],
            );
        }
    }
}

fn range_of(aspect: vk::ImageAspectFlags, levels: u32) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange {
        aspect_mask: aspect,
        base_mip_level: 0,
        level_count: levels,
        base_array_layer: 0,
        layer_count: 1,
    }
}

fn layers_of(aspect: vk::ImageAspectFlags, level: u32) -> vk::ImageSubresourceLayers {
    vk::ImageSubresourceLayers { aspect_mask: aspect, mip_level: level, base_array_layer: 0, layer_count: 1 }
}

impl Drop for Image {
    fn drop(&mut self) {
        // SAFETY: work that uses the image is waited for before its owner drops it; null handles are ignored.
        unsafe {
            self.context.device.destroy_image_view(self.view, None);
            self.context.device.destroy_image(self.handle, None);
        }
        if let Some(allocation) = self.allocation.take() {
            // Freeing a live allocation does not fail.
            let _ = self.context.allocator().free(allocation);
        }
        self.context.uncount_bytes(self.bytes);
    }
}
