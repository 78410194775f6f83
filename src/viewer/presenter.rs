//! The device that shows the window's contents: an instance of its own, apart from the renderer's.

use std::ffi::CStr;
use std::sync::Arc;

use ash::{ext, khr, vk};
use winit::raw_window_handle::{HasDisplayHandle, HasWindowHandle};
use winit::window::Window;

use super::swapchain::{Swapchain, Target};
use crate::gpu::context::{Start, ValidationLog, messenger, start, vulkan};
use crate::{Error, Result};

/// What one frame draws.
pub(super) struct Painting {
    pub(super) primitives: Vec<egui::ClippedPrimitive>,
    pub(super) textures: egui::TexturesDelta,
    pub(super) pixels_per_point: f32,
}

/// Whether a frame came to the screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shown {
    Yes,
    /// The window has no area, or its swapchain was out of date; the next frame may do.
    No,
}

/// Instance, device, swapchain, and the painter of widgets.
pub(super) struct Presenter {
    swapchain: Option<Swapchain>,
    painter: Option<egui_ash_renderer::Renderer<egui_ash_renderer::allocator::DefaultAllocator>>,
    /// Textures that the frame in flight may still use.
    unused: Vec<egui::TextureId>,
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    acquired: vk::Semaphore,
    done: vk::Fence,
    target: Target,
    log: Arc<ValidationLog>,
    debug_messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    start: Start,
    // The surface is the window's: it must not outlive it.
    _window: Arc<Window>,
}

fn painter_error(error: egui_ash_renderer::RendererError) -> Error {
    match error {
        egui_ash_renderer::RendererError::Vulkan(result) => {
            Error::Vulkan { call: "a call of the window's painter", result }
        }
        other => Error::Device(format!("the window's painter: {other}")),
    }
}

fn no_window(error: impl std::fmt::Display) -> Error {
    Error::Device(format!("the window cannot be drawn to: {error}"))
}

impl Presenter {
    /// Opens a device that can draw to the window, the one named so if it can.
    ///
    /// # Errors
    /// When there is none, or a Vulkan call fails.
    pub(super) fn new(window: &Arc<Window>, device: Option<&str>, validation: bool) -> Result<Self> {
        let display = window.display_handle().map_err(no_window)?.as_raw();
        let handle = window.window_handle().map_err(no_window)?.as_raw();
        let extensions = ash_window::enumerate_required_extensions(display).map_err(no_window)?;
        let start = start(validation, extensions)?;
        let log = Arc::new(ValidationLog::default());
        let debug_messenger = (validation && start.debug_utils).then(|| messenger(&start, &log)).transpose()?;
        // SAFETY: the instance has the extensions that the display asks for, and the window lives as long as the
        // presenter, which holds it.
        let surface = unsafe { ash_window::create_surface(&start.entry, &start.instance, display, handle, None) }
            .map_err(|e| Error::Device(format!("the window has no Vulkan surface: {e}")))?;
        let surfaces = khr::surface::Instance::new(&start.entry, &start.instance);
        let (physical, family) = pick(&start.instance, &surfaces, surface, device)?;
        let device = open(&start.instance, physical, family)?;
        // SAFETY: plain creations on a live device; everything is destroyed in `drop`.
        unsafe {
            let queue = device.get_device_queue(family, 0);
            let pool = vk::CommandPoolCreateInfo::default()
                .queue_family_index(family)
                .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
            let pool = device.create_command_pool(&pool, None).map_err(vulkan("vkCreateCommandPool"))?;
            let allocate = vk::CommandBufferAllocateInfo::default()
                .command_pool(pool)
                .level(vk::CommandBufferLevel::PRIMARY)
                .command_buffer_count(1);
            let commands = device.allocate_command_buffers(&allocate).map_err(vulkan("vkAllocateCommandBuffers"))?[0];
            let acquired = device.create_semaphore(&Default::default(), None).map_err(vulkan("vkCreateSemaphore"))?;
            let signaled = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
            let done = device.create_fence(&signaled, None).map_err(vulkan("vkCreateFence"))?;
            let target = Target::new(&start.instance, device, surfaces, surface, physical, queue)?;
            let painter = egui_ash_renderer::Renderer::with_default_allocator(
                &start.instance,
                physical,
                target.device.clone(),
                egui_ash_renderer::RenderMode::RenderPass(target.render_pass),
                egui_ash_renderer::Options::default(),
            )
            .map_err(painter_error)?;
            Ok(Self {
                swapchain: None,
                painter: Some(painter),
                unused: Vec::new(),
                pool,
                commands,
                acquired,
                done,
                target,
                log,
                debug_messenger,
                start,
                _window: window.clone(),
            })
        }
    }

    /// Largest side of a texture, pixels.
    pub(super) fn max_texture_side(&self) -> usize {
        self.target.max_texture_side as usize
    }

    /// Messages of the validation layer.
    pub(super) fn log(&self) -> Arc<ValidationLog> {
        self.log.clone()
    }

    /// The swapchain no longer fits the window.
    pub(super) fn outdated(&mut self) {
        if let Some(swapchain) = &mut self.swapchain {
            swapchain.outdated = true;
        }
    }

    /// Draws a frame and hands it to the screen. Textures are taken over even where it is not shown.
    ///
    /// # Errors
    /// A lost device or surface, which another presenter may have back; Vulkan's other errors.
    pub(super) fn draw(&mut self, size: [u32; 2], painting: Painting) -> Result<Shown> {
        let device = self.target.device.clone();
        let Some(painter) = &mut self.painter else { return Ok(Shown::No) };
        // SAFETY: the fence is live; it was submitted or made signaled.
        unsafe { device.wait_for_fences(&[self.done], true, u64::MAX) }.map_err(vulkan("vkWaitForFences"))?;
        for id in self.unused.drain(..) {
            painter.free_texture(id).map_err(painter_error)?;
        }
        let mut textures = painting.textures;
        for (id, deltas) in textures.set.drain() {
            for delta in deltas {
                painter.set_texture(self.target.queue, self.pool, id, &delta).map_err(painter_error)?;
            }
        }
        self.unused.extend(textures.free.drain());
        if self.swapchain.as_ref().is_none_or(|swapchain| swapchain.outdated) {
            let old = self.swapchain.take();
            self.swapchain = Swapchain::new(&self.target, size, old)?;
        }
        let Some(swapchain) = &mut self.swapchain else { return Ok(Shown::No) };
        // SAFETY: the semaphore has no signal pending: the last frame, which waited for it, is done.
        let acquired = unsafe {
            self.target.swapchains.acquire_next_image(swapchain.handle, u64::MAX, self.acquired, vk::Fence::null())
        };
        let (image, suboptimal) = match acquired {
            Ok(acquired) => acquired,
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => {
                swapchain.outdated = true;
                return Ok(Shown::No);
            }
            Err(result) => return Err(vulkan("vkAcquireNextImageKHR")(result)),
        };
        swapchain.outdated |= suboptimal;
        let extent = swapchain.extent;
        let clear = [vk::ClearValue { color: vk::ClearColorValue { float32: [0.08, 0.08, 0.08, 1.0] } }];
        let pass = vk::RenderPassBeginInfo::default()
            .render_pass(self.target.render_pass)
            .framebuffer(swapchain.framebuffers[image as usize])
            .render_area(extent.into())
            .clear_values(&clear);
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the command buffer is not in flight; all handles are live.
        unsafe {
            device.begin_command_buffer(self.commands, &begin).map_err(vulkan("vkBeginCommandBuffer"))?;
            device.cmd_begin_render_pass(self.commands, &pass, vk::SubpassContents::INLINE);
        }
        painter
            .cmd_draw(self.commands, extent, painting.pixels_per_point, &painting.primitives)
            .map_err(painter_error)?;
        let (wait, signal, buffers) = ([self.acquired], [swapchain.drawn[image as usize]], [self.commands]);
        let stages = [vk::PipelineStageFlags::COLOR_ATTACHMENT_OUTPUT];
        let submit = vk::SubmitInfo::default()
            .wait_semaphores(&wait)
            .wait_dst_stage_mask(&stages)
            .command_buffers(&buffers)
            .signal_semaphores(&signal);
        let (handles, images) = ([swapchain.handle], [image]);
        let present =
            vk::PresentInfoKHR::default().wait_semaphores(&signal).swapchains(&handles).image_indices(&images);
        // SAFETY: as above; the fence is signaled and not in use.
        let presented = unsafe {
            device.cmd_end_render_pass(self.commands);
            device.end_command_buffer(self.commands).map_err(vulkan("vkEndCommandBuffer"))?;
            device.reset_fences(&[self.done]).map_err(vulkan("vkResetFences"))?;
            device.queue_submit(self.target.queue, &[submit], self.done).map_err(vulkan("vkQueueSubmit"))?;
            self.target.swapchains.queue_present(self.target.queue, &present)
        };
        match presented {
            Ok(suboptimal) => {
                swapchain.outdated |= suboptimal;
                Ok(Shown::Yes)
            }
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => {
                swapchain.outdated = true;
                Ok(Shown::No)
            }
            Err(result) => Err(vulkan("vkQueuePresentKHR")(result)),
        }
    }
}

impl Drop for Presenter {
    fn drop(&mut self) {
        let device = self.target.device.clone();
        // SAFETY: nothing is in flight after the wait; a lost device has nothing to wait for. The order is the reverse
        // of creation.
        unsafe {
            let _ = device.device_wait_idle();
            self.painter = None;
            self.swapchain = None;
            device.destroy_fence(self.done, None);
            device.destroy_semaphore(self.acquired, None);
            device.destroy_command_pool(self.pool, None);
            self.target.destroy();
            if let Some((loader, handle)) = self.debug_messenger.take() {
                loader.destroy_debug_utils_messenger(handle, None);
            }
            self.start.instance.destroy_instance(None);
        }
    }
}

/// A device with a queue that draws and presents: the one named so, else the fastest kind.
fn pick(
    instance: &ash::Instance,
    surfaces: &khr::surface::Instance,
    surface: vk::SurfaceKHR,
    wanted: Option<&str>,
) -> Result<(vk::PhysicalDevice, u32)> {
    // SAFETY: plain queries on a live instance.
    let devices = unsafe { instance.enumerate_physical_devices() }.map_err(vulkan("vkEnumeratePhysicalDevices"))?;
    let family = |device: vk::PhysicalDevice| {
        // SAFETY: as above.
        let families = unsafe { instance.get_physical_device_queue_family_properties(device) };
        (0..families.len() as u32).find(|family| {
            let draws = families[*family as usize].queue_flags.contains(vk::QueueFlags::GRAPHICS);
            // SAFETY: as above; a driver that fails the query presents nothing.
            draws && unsafe { surfaces.get_physical_device_surface_support(device, *family, surface) }.unwrap_or(false)
        })
    };
    let rank = |device: vk::PhysicalDevice| {
        // SAFETY: as above.
        let properties = unsafe { instance.get_physical_device_properties(device) };
        let name = properties.device_name_as_c_str().map(CStr::to_string_lossy).unwrap_or_default().to_lowercase();
        let kind = match properties.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => 0,
            vk::PhysicalDeviceType::INTEGRATED_GPU => 1,
            vk::PhysicalDeviceType::VIRTUAL_GPU => 2,
            _ => 3,
        };
        (wanted.is_none_or(|wanted| !name.contains(&wanted.to_lowercase())), kind)
    };
    devices
        .into_iter()
        .filter_map(|device| family(device).map(|family| (device, family)))
        .min_by_key(|(device, _)| rank(*device))
        .ok_or_else(|| Error::Device("no Vulkan device can draw to the window".into()))
}

fn open(instance: &ash::Instance, physical: vk::PhysicalDevice, family: u32) -> Result<ash::Device> {
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
    let names = [khr::swapchain::NAME.as_ptr()];
    let create = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&names);
    // SAFETY: a device that presents has the extension; the create info outlives the call.
    unsafe { instance.create_device(physical, &create, None) }.map_err(vulkan("vkCreateDevice"))
}
