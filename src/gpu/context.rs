//! Instance, device and queue, and what the device can do.

use std::ffi::{CString, c_char, c_void};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ash::{ext, khr, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};

pub use super::capabilities::{Capabilities, devices};
use super::capabilities::{device_extensions, graphics_family, has_extension, pick, ranked};
use super::clock::GpuClock;
use super::pipeline::{ComputePipeline, Constant};
use crate::trace::Trace;
use crate::{Error, Result};

/// How to pick a device.
#[derive(Clone, Debug, Default)]
pub struct ContextOptions {
    /// Part of the device's name, case-insensitive; the best usable device where `None`.
    pub device: Option<String>,
    /// Load the validation layer and keep its messages.
    pub validation: bool,
}

/// Messages of the validation layer.
#[derive(Debug, Default)]
pub struct ValidationLog(Mutex<Vec<String>>);

impl ValidationLog {
    /// Everything that the layer has reported so far, warnings and errors.
    pub fn messages(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// A device and everything that makes objects on it.
pub struct Context {
    /// What the device supports.
    pub capabilities: Capabilities,
    /// Messages of the validation layer; empty when it was not asked for.
    pub validation: Arc<ValidationLog>,
    pub(crate) device: ash::Device,
    pub(crate) queue: vk::Queue,
    pub(crate) queue_family: u32,
    pub(crate) feedback: Option<ext::transform_feedback::Device>,
    pub(crate) clock: GpuClock,
    /// Where passes and spans go; off unless the context was opened with one.
    pub trace: Trace,
    submissions: AtomicU64,
    dynamic_rendering: Option<khr::dynamic_rendering::Device>,
    debug_device: Option<ext::debug_utils::Device>,
    debug_messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    allocator: Option<Mutex<Allocator>>,
    bytes_now: AtomicU64,
    bytes_peak: AtomicU64,
    instance: ash::Instance,
    _entry: ash::Entry,
}

/// Loader and instance, before a device is chosen.
pub(crate) struct Start {
    pub(crate) entry: ash::Entry,
    pub(crate) instance: ash::Instance,
    pub(crate) debug_utils: bool,
}

/// Loads Vulkan and makes an instance with the `wanted` extensions, those of a window.
pub(crate) fn start(validation: bool, wanted: &[*const c_char]) -> Result<Start> {
    // SAFETY: loading the system's Vulkan loader runs its initialisers, as every Vulkan program does.
    let entry = unsafe { ash::Entry::load() }
        .map_err(|e| Error::Device(format!("no Vulkan loader was found (tools/setup installs one): {e}")))?;
    // SAFETY: plain queries on a live entry.
    let (layers, extensions) = unsafe {
        (
            entry.enumerate_instance_layer_properties().map_err(vulkan("vkEnumerateInstanceLayerProperties"))?,
            entry
                .enumerate_instance_extension_properties(None)
                .map_err(vulkan("vkEnumerateInstanceExtensionProperties"))?,
        )
    };
    let layer = c"VK_LAYER_KHRONOS_validation";
    if validation && !layers.iter().any(|l| l.layer_name_as_c_str() == Ok(layer)) {
        return Err(Error::Device(
            "--validation needs the layer VK_LAYER_KHRONOS_validation, which is not installed (tools/setup installs it)"
                .into(),
        ));
    }
    let debug_utils = extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(ext::debug_utils::NAME));
    let enabled_layers: Vec<*const c_char> = if validation { vec![layer.as_ptr()] } else { Vec::new() };
    let mut enabled_extensions = wanted.to_vec();
    if debug_utils {
        enabled_extensions.push(ext::debug_utils::NAME.as_ptr());
    }
    let application = vk::ApplicationInfo::default()
        .application_name(c"relume")
        .engine_name(c"relume")
        .api_version(vk::API_VERSION_1_3);
    let create = vk::InstanceCreateInfo::default()
        .application_info(&application)
        .enabled_layer_names(&enabled_layers)
        .enabled_extension_names(&enabled_extensions);
    // SAFETY: the create info and everything it points to outlive the call.
    let instance = unsafe { entry.create_instance(&create, None) }
        .map_err(|e| Error::Device(format!("no Vulkan instance could be made (is a driver installed?): {e}")))?;
    Ok(Start { entry, instance, debug_utils })
}

/// Turns a result code into an error that names the call.
pub(crate) fn vulkan(call: &'static str) -> impl Fn(vk::Result) -> Error {
    move |result| Error::Vulkan { call, result }
}

/// Keeps the validation layer's messages.
///
/// # Safety
/// Called by the loader with a live callback data pointer and the log given at creation.
unsafe extern "system" fn keep_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    log: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the loader passes a valid data pointer; `log` is the `ValidationLog` that the context keeps alive for
    // longer than the messenger.
    let (message, log) = unsafe { ((*data).message_as_c_str(), &*log.cast::<ValidationLog>()) };
    let text = message.map(|m| m.to_string_lossy().into_owned()).unwrap_or_default();
    tracing::warn!("validation: {text}");
    log.0.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    vk::FALSE
}

impl Context {
    /// Opens a device.
    ///
    /// # Errors
    /// When there is no loader, no device of that name, or the device lacks what relume needs; the message names it.
    pub fn new(options: &ContextOptions) -> Result<Arc<Self>> {
        Self::traced(options, Trace::default())
    }

    /// Opens a device whose passes go to `trace`.
    ///
    /// # Errors
    /// As [`Context::new`].
    pub fn traced(options: &ContextOptions, trace: Trace) -> Result<Arc<Self>> {
        let start = start(options.validation, &[])?;
        let validation = Arc::new(ValidationLog::default());
        let debug_messenger =
            (options.validation && start.debug_utils).then(|| messenger(&start, &validation)).transpose()?;
        let opened = ranked(&start.instance).and_then(|list| pick(list, options.device.as_deref())).and_then(
            |(physical, capabilities)| {
                let calibrated = trace.is_on() && reads_clock(&start, physical);
                open(&start.instance, physical, &capabilities, calibrated).map(|d| (d, capabilities))
            },
        );
        let (opened, capabilities) = match opened {
            Ok(opened) => opened,
            Err(error) => {
                // SAFETY: the messenger and the instance are not used again.
                unsafe {
                    if let Some((loader, handle)) = debug_messenger {
                        loader.destroy_debug_utils_messenger(handle, None);
                    }
                    start.instance.destroy_instance(None);
                }
                return Err(error);
            }
        };
        let Opened { device, queue_family, physical, calibrated } = opened;
        // SAFETY: the queue was asked for at device creation.
        let queue = unsafe { device.get_device_queue(queue_family, 0) };
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: start.instance.clone(),
            device: device.clone(),
            physical_device: physical,
            debug_settings: Default::default(),
            buffer_device_address: false,
            allocation_sizes: Default::default(),
        })
        .map_err(|e| Error::Device(format!("no memory allocator: {e}")))?;
        // SAFETY: plain queries.
        let (limits, families) = unsafe {
            (
                start.instance.get_physical_device_properties(physical).limits,
                start.instance.get_physical_device_queue_family_properties(physical),
            )
        };
        let bits = families[queue_family as usize].timestamp_valid_bits;
        let calibrated = calibrated.then(|| ext::calibrated_timestamps::Device::new(&start.instance, &device));
        let clock = GpuClock::new(limits.timestamp_period, bits, calibrated);
        trace.set_device(&capabilities.name);
        trace.note("device", capabilities.name.as_str());
        trace.note("driver", capabilities.driver.as_str());
        trace.note("gpu_clock", clock.how());
        let core_rendering = capabilities.api_version >= vk::API_VERSION_1_3;
        Ok(Arc::new(Self {
            feedback: capabilities.feedback().then(|| ext::transform_feedback::Device::new(&start.instance, &device)),
            dynamic_rendering: (!core_rendering).then(|| khr::dynamic_rendering::Device::new(&start.instance, &device)),
            debug_device: start.debug_utils.then(|| ext::debug_utils::Device::new(&start.instance, &device)),
            clock,
            trace,
            submissions: AtomicU64::new(0),
            capabilities,
            validation,
            device,
            queue,
            queue_family,
            debug_messenger,
            allocator: Some(Mutex::new(allocator)),
            bytes_now: AtomicU64::new(0),
            bytes_peak: AtomicU64::new(0),
            instance: start.instance,
            _entry: start.entry,
        }))
    }

    /// The size of a workgroup for passes with few and long invocations, where it matters: a software device runs one
    /// workgroup on one core, and has as many lanes as this.
    pub(crate) fn small_workgroup(&self) -> Option<Constant> {
        let software = self.capabilities.kind == vk::PhysicalDeviceType::CPU;
        software.then(|| Constant::new(ComputePipeline::WORKGROUP, 8_u32))
    }

    /// Bytes of device objects alive now.
    pub fn bytes_now(&self) -> u64 {
        self.bytes_now.load(Ordering::Relaxed)
    }

    /// Most bytes of device objects alive at once so far.
    pub fn bytes_peak(&self) -> u64 {
        self.bytes_peak.load(Ordering::Relaxed)
    }

    /// The number of a submission, from 1.
    pub(crate) fn next_submission(&self) -> u64 {
        self.submissions.fetch_add(1, Ordering::Relaxed) + 1
    }

    pub(crate) fn count_bytes(&self, bytes: u64) {
        let now = self.bytes_now.fetch_add(bytes, Ordering::Relaxed) + bytes;
        self.bytes_peak.fetch_max(now, Ordering::Relaxed);
    }

    pub(crate) fn uncount_bytes(&self, bytes: u64) {
        self.bytes_now.fetch_sub(bytes, Ordering::Relaxed);
    }

    pub(crate) fn allocator(&self) -> MutexGuard<'_, Allocator> {
        let allocator = self.allocator.as_ref().expect("the allocator lives as long as the context");
        allocator.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn begin_rendering(&self, commands: vk::CommandBuffer, info: &vk::RenderingInfo<'_>) {
        // SAFETY: the caller records into `commands`, and the info's views outlive its execution.
        unsafe {
            match &self.dynamic_rendering {
                Some(extension) => extension.cmd_begin_rendering(commands, info),
                None => self.device.cmd_begin_rendering(commands, info),
            }
        }
    }

    pub(crate) fn end_rendering(&self, commands: vk::CommandBuffer) {
        // SAFETY: follows `begin_rendering` on the same command buffer.
        unsafe {
            match &self.dynamic_rendering {
                Some(extension) => extension.cmd_end_rendering(commands),
                None => self.device.cmd_end_rendering(commands),
            }
        }
    }

    pub(crate) fn begin_label(&self, commands: vk::CommandBuffer, name: &str) {
        if let (Some(debug), Ok(name)) = (&self.debug_device, CString::new(name)) {
            let label = vk::DebugUtilsLabelEXT::default().label_name(&name);
            // SAFETY: the label outlives the call and `commands` is recording.
            unsafe { debug.cmd_begin_debug_utils_label(commands, &label) };
        }
    }

    pub(crate) fn end_label(&self, commands: vk::CommandBuffer) {
        if let Some(debug) = &self.debug_device {
            // SAFETY: a label is open on `commands`.
            unsafe { debug.cmd_end_debug_utils_label(commands) };
        }
    }

    pub(crate) fn name_object<T: vk::Handle>(&self, handle: T, name: &str) {
        if let (Some(debug), Ok(name)) = (&self.debug_device, CString::new(name)) {
            let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(handle).object_name(&name);
            // SAFETY: the handle is live. A name that cannot be set costs a caption in a capture, nothing else.
            let _ = unsafe { debug.set_debug_utils_object_name(&info) };
        }
    }

    /// One line that tells why the techniques with a geometry shader do not run here.
    pub fn why_no_feedback(&self) -> Option<String> {
        self.capabilities.why_no_feedback()
    }
}

/// Sends the validation layer's messages to `log`, which must outlive the messenger.
pub(crate) fn messenger(
    start: &Start,
    log: &Arc<ValidationLog>,
) -> Result<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)> {
    let loader = ext::debug_utils::Instance::new(&start.entry, &start.instance);
    let severity = vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR;
    let kind = vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE;
    let create = vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(severity)
        .message_type(kind)
        .pfn_user_callback(Some(keep_message))
        .user_data(Arc::as_ptr(log).cast_mut().cast());
    // SAFETY: the log is kept alive by the context, which destroys the messenger first.
    let handle = unsafe { loader.create_debug_utils_messenger(&create, None) }
        .map_err(vulkan("vkCreateDebugUtilsMessengerEXT"))?;
    Ok((loader, handle))
}

struct Opened {
    device: ash::Device,
    queue_family: u32,
    physical: vk::PhysicalDevice,
    /// The device's clock can be read.
    calibrated: bool,
}

/// Whether a device's clock can be read without a submission.
fn reads_clock(start: &Start, physical: vk::PhysicalDevice) -> bool {
    if !has_extension(&device_extensions(&start.instance, physical), ext::calibrated_timestamps::NAME) {
        return false;
    }
    let loader = ext::calibrated_timestamps::Instance::new(&start.entry, &start.instance);
    // SAFETY: a plain query on a live instance; the device has the extension.
    let domains = unsafe { loader.get_physical_device_calibrateable_time_domains(physical) };
    domains.is_ok_and(|domains| domains.contains(&vk::TimeDomainEXT::DEVICE))
}

fn open(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    capabilities: &Capabilities,
    calibrated: bool,
) -> Result<Opened> {
    let queue_family = graphics_family(instance, physical)
        .ok_or_else(|| Error::Device(format!("{} has no graphics queue", capabilities.name)))?;
    let mut names = Vec::new();
    if capabilities.feedback() {
        names.push(ext::transform_feedback::NAME.as_ptr());
    }
    if capabilities.api_version < vk::API_VERSION_1_3 {
        names.push(khr::dynamic_rendering::NAME.as_ptr());
    }
    if calibrated {
        names.push(ext::calibrated_timestamps::NAME.as_ptr());
    }
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(queue_family).queue_priorities(&[1.0])];
    let features = vk::PhysicalDeviceFeatures::default().shader_int64(true).geometry_shader(capabilities.feedback());
    let mut vulkan12 = vk::PhysicalDeviceVulkan12Features::default().shader_buffer_int64_atomics(true);
    let mut rendering = vk::PhysicalDeviceDynamicRenderingFeatures::default().dynamic_rendering(true);
    let mut feedback =
        vk::PhysicalDeviceTransformFeedbackFeaturesEXT::default().transform_feedback(true).geometry_streams(true);
    let mut create = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&names)
        .enabled_features(&features)
        .push_next(&mut vulkan12)
        .push_next(&mut rendering);
    if capabilities.feedback() {
        create = create.push_next(&mut feedback);
    }
    // SAFETY: everything asked for was found to be supported, and the create info outlives the call.
    let device = unsafe { instance.create_device(physical, &create, None) }.map_err(vulkan("vkCreateDevice"))?;
    Ok(Opened { device, queue_family, physical, calibrated })
}

impl Drop for Context {
    fn drop(&mut self) {
        // SAFETY: every object made from the device holds the context, so none is left; the order is the reverse of
        // creation.
        unsafe {
            // A device that is lost has nothing to wait for.
            let _ = self.device.device_wait_idle();
            self.allocator = None;
            self.device.destroy_device(None);
            if let Some((loader, handle)) = self.debug_messenger.take() {
                loader.destroy_debug_utils_messenger(handle, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}
