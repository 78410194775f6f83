//! The images that the window shows.

use ash::{khr, vk};

use crate::Result;
use crate::gpu::context::vulkan;

/// What all swapchains of a window share.
pub(super) struct Target {
    pub(super) device: ash::Device,
    pub(super) queue: vk::Queue,
    pub(super) swapchains: khr::swapchain::Device,
    pub(super) render_pass: vk::RenderPass,
    pub(super) max_texture_side: u32,
    surfaces: khr::surface::Instance,
    surface: vk::SurfaceKHR,
    physical: vk::PhysicalDevice,
    format: vk::SurfaceFormatKHR,
}

impl Target {
    pub(super) fn new(
        instance: &ash::Instance,
        device: ash::Device,
        surfaces: khr::surface::Instance,
        surface: vk::SurfaceKHR,
        physical: vk::PhysicalDevice,
        queue: vk::Queue,
    ) -> Result<Self> {
        // SAFETY: a plain query.
        let formats = unsafe { surfaces.get_physical_device_surface_formats(physical, surface) }
            .map_err(vulkan("vkGetPhysicalDeviceSurfaceFormatsKHR"))?;
        // The painter encodes sRGB itself.
        let plain = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM];
        let format = formats.iter().find(|f| plain.contains(&f.format)).or(formats.first()).copied();
        let format = format.unwrap_or_default();
        let render_pass = render_pass(&device, format.format)?;
        let swapchains = khr::swapchain::Device::new(instance, &device);
        // SAFETY: a plain query.
        let limits = unsafe { instance.get_physical_device_properties(physical) }.limits;
        let max_texture_side = limits.max_image_dimension2_d;
        Ok(Self { device, queue, swapchains, render_pass, max_texture_side, surfaces, surface, physical, format })
    }

    /// Destroys pass, device and surface.
    ///
    /// # Safety
    /// Nothing made from the device is alive, and nothing is called on the target afterwards.
    pub(super) unsafe fn destroy(&mut self) {
        // SAFETY: as promised by the caller.
        unsafe {
            self.device.destroy_render_pass(self.render_pass, None);
            self.device.destroy_device(None);
            self.surfaces.destroy_surface(self.surface, None);
        }
    }
}

fn render_pass(device: &ash::Device, format: vk::Format) -> Result<vk::RenderPass> {
    let attachments = [vk::AttachmentDescription::default()
        .format(format)
        .samples(vk::SampleCountFlags::TYPE_1)
        .load_op(vk::AttachmentLoadOp::CLEAR)
        .store_op(vk::AttachmentStoreOp::STORE)
        .final_layout(vk::ImageLayout::PRESENT_SRC_KHR)];
    let colors = [vk::AttachmentReference { attachment: 0, layout: vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL }];
    let subpasses = [vk::SubpassDescription::default()
        .pipeline_bind_point(vk::PipelineBindPoint::GRAPHICS)
        .color_attachments(&colors)];
    // The image is written only once it has been acquired.
    let stage = vk::PipelineStageFlags::COLOR_ATTACHMENT_OUTPUT;
    let dependencies = [vk::SubpassDependency::default()
        .src_subpass(vk::SUBPASS_EXTERNAL)
        .src_stage_mask(stage)
        .dst_stage_mask(stage)
        .dst_access_mask(vk::AccessFlags::COLOR_ATTACHMENT_WRITE)];
    let create =
        vk::RenderPassCreateInfo::default().attachments(&attachments).subpasses(&subpasses).dependencies(&dependencies);
    // SAFETY: the create info outlives the call.
    unsafe { device.create_render_pass(&create, None) }.map_err(vulkan("vkCreateRenderPass"))
}

/// A swapchain and what draws to its images.
pub(super) struct Swapchain {
    pub(super) handle: vk::SwapchainKHR,
    pub(super) extent: vk::Extent2D,
    pub(super) framebuffers: Vec<vk::Framebuffer>,
    /// Signaled when an image is drawn, one an image.
    pub(super) drawn: Vec<vk::Semaphore>,
    /// Another one is needed.
    pub(super) outdated: bool,
    views: Vec<vk::ImageView>,
    device: ash::Device,
    swapchains: khr::swapchain::Device,
}

impl Swapchain {
    /// Images of the window's size in pixels, `None` where it has no area; the `old` ones are destroyed.
    pub(super) fn new(target: &Target, size: [u32; 2], old: Option<Self>) -> Result<Option<Self>> {
        let Target { device, surfaces, surface, physical, format, .. } = target;
        // SAFETY: plain queries; the old swapchain's images are in use no longer after the wait.
        let capabilities = unsafe {
            device.device_wait_idle().map_err(vulkan("vkDeviceWaitIdle"))?;
            surfaces
                .get_physical_device_surface_capabilities(*physical, *surface)
                .map_err(vulkan("vkGetPhysicalDeviceSurfaceCapabilitiesKHR"))?
        };
        let extent = match capabilities.current_extent {
            // The surface takes the size of the swapchain.
            vk::Extent2D { width: u32::MAX, .. } => {
                let (low, high) = (capabilities.min_image_extent, capabilities.max_image_extent);
                vk::Extent2D {
                    width: size[0].clamp(low.width, high.width.max(low.width)),
                    height: size[1].clamp(low.height, high.height.max(low.height)),
                }
            }
            extent => extent,
        };
        if extent.width == 0 || extent.height == 0 || size.contains(&0) {
            return Ok(None);
        }
        let most = if capabilities.max_image_count == 0 { u32::MAX } else { capabilities.max_image_count };
        let opaque = vk::CompositeAlphaFlagsKHR::OPAQUE;
        let alpha = if capabilities.supported_composite_alpha.contains(opaque) {
            opaque
        } else {
            vk::CompositeAlphaFlagsKHR::INHERIT
        };
        let create = vk::SwapchainCreateInfoKHR::default()
            .surface(*surface)
            .min_image_count((capabilities.min_image_count + 1).min(most))
            .image_format(format.format)
            .image_color_space(format.color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::COLOR_ATTACHMENT)
            .pre_transform(capabilities.current_transform)
            .composite_alpha(alpha)
            // Every device has it.
            .present_mode(vk::PresentModeKHR::FIFO)
            .clipped(true)
            .old_swapchain(old.as_ref().map_or(vk::SwapchainKHR::null(), |old| old.handle));
        // SAFETY: the create info outlives the call; the old swapchain is destroyed after it.
        let handle =
            unsafe { target.swapchains.create_swapchain(&create, None) }.map_err(vulkan("vkCreateSwapchainKHR"))?;
        drop(old);
        let mut swapchain = Self {
            handle,
            extent,
            framebuffers: Vec::new(),
            drawn: Vec::new(),
            outdated: false,
            views: Vec::new(),
            device: device.clone(),
            swapchains: target.swapchains.clone(),
        };
        swapchain.make_images(target)?;
        Ok(Some(swapchain))
    }

    fn make_images(&mut self, target: &Target) -> Result<()> {
        let range = vk::ImageSubresourceRange {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            level_count: 1,
            layer_count: 1,
            ..Default::default()
        };
        // SAFETY: plain creations on live handles; what was made is destroyed in `drop`, also after a failure.
        unsafe {
            let images =
                self.swapchains.get_swapchain_images(self.handle).map_err(vulkan("vkGetSwapchainImagesKHR"))?;
            for image in images {
                let view = vk::ImageViewCreateInfo::default()
                    .image(image)
                    .view_type(vk::ImageViewType::TYPE_2D)
                    .format(target.format.format)
                    .subresource_range(range);
                let view = self.device.create_image_view(&view, None).map_err(vulkan("vkCreateImageView"))?;
                self.views.push(view);
                let attachments = [view];
                let framebuffer = vk::FramebufferCreateInfo::default()
                    .render_pass(target.render_pass)
                    .attachments(&attachments)
                    .width(self.extent.width)
                    .height(self.extent.height)
                    .layers(1);
                self.framebuffers
                    .push(self.device.create_framebuffer(&framebuffer, None).map_err(vulkan("vkCreateFramebuffer"))?);
                self.drawn.push(
                    self.device.create_semaphore(&Default::default(), None).map_err(vulkan("vkCreateSemaphore"))?,
                );
            }
        }
        Ok(())
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        // SAFETY: the device was waited for before a swapchain is dropped.
        unsafe {
            self.framebuffers.iter().for_each(|framebuffer| self.device.destroy_framebuffer(*framebuffer, None));
            self.views.iter().for_each(|view| self.device.destroy_image_view(*view, None));
            self.swapchains.destroy_swapchain(self.handle, None);
            self.drawn.iter().for_each(|semaphore| self.device.destroy_semaphore(*semaphore, None));
        }
    }
}
