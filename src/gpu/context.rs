//! Instance, device and queue, and what the device can do.

use std::ffi::{CStr, CString, c_char, c_void};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ash::{ext, khr, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};

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

/// What a device supports of what relume uses.
#[derive(Clone, Debug)]
pub struct Capabilities {
    /// Name as the driver gives it.
    pub name: String,
    /// Kind of device.
    pub kind: vk::PhysicalDeviceType,
    /// Supported Vulkan version.
    pub api_version: u32,
    /// Driver name and version text.
    pub driver: String,
    /// What relume cannot do without and the device lacks; empty on a usable device.
    pub missing: Vec<&'static str>,
    /// What the techniques with a geometry shader need and the device lacks; `classic` runs without.
    pub missing_feedback: Vec<&'static str>,
    /// Largest range of a storage buffer, bytes.
    pub max_storage_range: u64,
    /// Most elements of a texel buffer.
    pub max_texels: u32,
    /// Largest width and height of an image.
    pub max_image_size: u32,
    /// Most workgroups in one dimension of a dispatch.
    pub max_workgroups: u32,
    /// Whether 32-bit float images can be sampled with a linear filter.
    pub linear_float32: bool,
}

impl Capabilities {
    /// True when relume can run on the device at all.
    pub fn usable(&self) -> bool {
        self.missing.is_empty()
    }

    /// True when the techniques with a geometry shader and transform feedback run.
    pub fn feedback(&self) -> bool {
        self.missing_feedback.is_empty()
    }

    /// One line that tells why the techniques with a geometry shader do not run here; `None` where they do.
    pub fn why_no_feedback(&self) -> Option<String> {
        let missing = &self.missing_feedback;
        (!missing.is_empty())
            .then(|| format!("{} lacks {}; technique classic runs without it", self.name, missing.join(", ")))
    }

    /// Lower is better: what runs at all, then what runs everything, then the faster kind.
    fn rank(&self) -> (bool, bool, u8) {
        let kind = match self.kind {
            vk::PhysicalDeviceType::DISCRETE_GPU => 0,
            vk::PhysicalDeviceType::INTEGRATED_GPU => 1,
            vk::PhysicalDeviceType::VIRTUAL_GPU => 2,
            _ => 3,
        };
        (!self.usable(), !self.feedback(), kind)
    }
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

/// All devices of the system, in the order in which relume prefers them.
///
/// # Errors
/// When there is no Vulkan loader or no instance can be made.
pub fn devices() -> Result<Vec<Capabilities>> {
    let start = start(false, &[])?;
    let found = ranked(&start.instance).map(|list| list.into_iter().map(|(_, c)| c).collect());
    // SAFETY: nothing made from the instance is alive.
    unsafe { start.instance.destroy_instance(None) };
    found
}

/// Usable devices first; discrete before integrated before virtual before software.
fn ranked(instance: &ash::Instance) -> Result<Vec<(vk::PhysicalDevice, Capabilities)>> {
    // SAFETY: a plain query on a live instance.
    let physical = unsafe { instance.enumerate_physical_devices() }.map_err(vulkan("vkEnumeratePhysicalDevices"))?;
    let mut list: Vec<_> = physical.into_iter().map(|device| (device, inspect(instance, device))).collect();
    list.sort_by_key(|(_, capabilities)| capabilities.rank());
    Ok(list)
}

fn has_extension(extensions: &[vk::ExtensionProperties], name: &CStr) -> bool {
    extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name))
}

fn device_extensions(instance: &ash::Instance, device: vk::PhysicalDevice) -> Vec<vk::ExtensionProperties> {
    // SAFETY: a plain query on a live instance; a driver that fails it offers no extension.
    unsafe { instance.enumerate_device_extension_properties(device) }.unwrap_or_default()
}

fn inspect(instance: &ash::Instance, device: vk::PhysicalDevice) -> Capabilities {
    let extensions = device_extensions(instance, device);
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut driver);
    // SAFETY: plain queries on a live instance; the chained structs are valid for Vulkan 1.2, below which drivers
    // ignore them.
    unsafe { instance.get_physical_device_properties2(device, &mut properties) };
    let core = properties.properties;

    let mut feedback = vk::PhysicalDeviceTransformFeedbackFeaturesEXT::default();
    let mut rendering = vk::PhysicalDeviceDynamicRenderingFeatures::default();
    let mut vulkan12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut vulkan12);
    let feedback_extension = has_extension(&extensions, ext::transform_feedback::NAME);
    let rendering_available =
        core.api_version >= vk::API_VERSION_1_3 || has_extension(&extensions, khr::dynamic_rendering::NAME);
    if feedback_extension {
        features = features.push_next(&mut feedback);
    }
    if rendering_available {
        features = features.push_next(&mut rendering);
    }
    // SAFETY: as above.
    unsafe { instance.get_physical_device_features2(device, &mut features) };
    let base = features.features;

    let mut feedback_limits = vk::PhysicalDeviceTransformFeedbackPropertiesEXT::default();
    if feedback_extension {
        let mut again = vk::PhysicalDeviceProperties2::default().push_next(&mut feedback_limits);
        // SAFETY: as above; the extension is there.
        unsafe { instance.get_physical_device_properties2(device, &mut again) };
    }

    let mut missing = Vec::new();
    let mut need = |there: bool, what| {
        if !there {
            missing.push(what);
        }
    };
    need(core.api_version >= vk::API_VERSION_1_2, "Vulkan 1.2");
    need(rendering.dynamic_rendering != 0, "dynamic rendering (Vulkan 1.3 or VK_KHR_dynamic_rendering)");
    need(base.shader_int64 != 0, "shaderInt64");
    need(vulkan12.shader_buffer_int64_atomics != 0, "shaderBufferInt64Atomics");
    need(graphics_family(instance, device).is_some(), "a queue with graphics and compute");
    let mut missing_feedback = Vec::new();
    let mut need = |there: bool, what| {
        if !there {
            missing_feedback.push(what);
        }
    };
    need(base.geometry_shader != 0, "geometryShader");
    need(feedback_extension && feedback.transform_feedback != 0, "VK_EXT_transform_feedback");
    need(feedback.geometry_streams != 0, "geometryStreams");
    need(feedback_limits.max_transform_feedback_streams >= 2, "two transform feedback streams");
    need(feedback_limits.transform_feedback_queries != 0, "transformFeedbackQueries");
    need(feedback_limits.transform_feedback_draw != 0, "transformFeedbackDraw");

    // SAFETY: a plain query.
    let float32 = unsafe { instance.get_physical_device_format_properties(device, vk::Format::R32G32B32A32_SFLOAT) };
    let text = |chars: &[c_char]| {
        let bytes: Vec<u8> = chars.iter().take_while(|c| **c != 0).map(|c| c.to_ne_bytes()[0]).collect();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    Capabilities {
        name: text(&core.device_name),
        kind: core.device_type,
        api_version: core.api_version,
        driver: format!("{} {}", text(&driver.driver_name), text(&driver.driver_info)),
        missing,
        missing_feedback,
        max_storage_range: u64::from(core.limits.max_storage_buffer_range),
        max_texels: core.limits.max_texel_buffer_elements,
        max_image_size: core.limits.max_image_dimension2_d,
        max_workgroups: core.limits.max_compute_work_group_count[0],
        linear_float32: float32
            .optimal_tiling_features
            .contains(vk::FormatFeatureFlags::SAMPLED_IMAGE_FILTER_LINEAR | vk::FormatFeatureFlags::TRANSFER_DST),
    }
}

fn graphics_family(instance: &ash::Instance, device: vk::PhysicalDevice) -> Option<u32> {
    // SAFETY: a plain query on a live instance.
    let families = unsafe { instance.get_physical_device_queue_family_properties(device) };
    let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    families.iter().position(|f| f.queue_flags.contains(wanted)).and_then(|i| u32::try_from(i).ok())
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

/// The first of `list`, or the first with `wanted` in its name; an error where that one lacks what relume needs.
fn pick<D>(list: Vec<(D, Capabilities)>, wanted: Option<&str>) -> Result<(D, Capabilities)> {
    let mut names = list.iter().map(|(_, c)| c.name.as_str()).collect::<Vec<_>>().join("; ");
    if names.is_empty() {
        names = "none".into();
    }
    let chosen = match wanted {
        None => list
            .into_iter()
            .next()
            .ok_or_else(|| Error::Device("no Vulkan device was found (tools/setup installs a software one)".into()))?,
        Some(wanted) => list
            .into_iter()
            .find(|(_, c)| c.name.to_lowercase().contains(&wanted.to_lowercase()))
            .ok_or_else(|| Error::Device(format!("no device is named {wanted:?}; there are: {names}")))?,
    };
    if !chosen.1.usable() {
        let lacks = chosen.1.missing.join(", ");
        return Err(Error::Device(format!("{} lacks {lacks}, which relume needs", chosen.1.name)));
    }
    Ok(chosen)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A discrete device that lacks `missing` for everything and `missing_feedback` for two of the techniques.
    fn device(name: &str, missing: &[&'static str], missing_feedback: &[&'static str]) -> Capabilities {
        Capabilities {
            name: name.into(),
            kind: vk::PhysicalDeviceType::DISCRETE_GPU,
            api_version: vk::API_VERSION_1_3,
            driver: String::new(),
            missing: missing.to_vec(),
            missing_feedback: missing_feedback.to_vec(),
            max_storage_range: 1 << 27,
            max_texels: 1 << 27,
            max_image_size: 16_384,
            max_workgroups: 65_535,
            linear_float32: true,
        }
    }

    fn message(list: &[Capabilities], wanted: Option<&str>) -> String {
        let list = list.iter().map(|c| ((), c.clone())).collect();
        pick(list, wanted).expect_err("nothing suits").to_string()
    }

    #[test]
    fn a_device_without_what_relume_needs_is_refused_by_what_it_lacks() {
        let old = device("Old GPU", &["shaderInt64", "shaderBufferInt64Atomics"], &[]);
        let expected = "Old GPU lacks shaderInt64, shaderBufferInt64Atomics, which relume needs";
        assert_eq!(message(std::slice::from_ref(&old), None), expected);
        assert_eq!(message(&[device("Good GPU", &[], &[]), old], Some("old")), expected);
    }

    #[test]
    fn a_name_that_no_device_has_lists_those_there_are() {
        let list = [device("First", &[], &[]), device("Second", &[], &[])];
        assert_eq!(message(&list, Some("third")), "no device is named \"third\"; there are: First; Second");
        assert!(message(&[], None).contains("no Vulkan device was found"));
        assert!(message(&[], Some("third")).contains("there are: none"));
    }

    #[test]
    fn devices_that_run_everything_come_first() {
        let mut list = [
            device("unusable", &["shaderInt64"], &[]),
            device("no feedback", &[], &["geometryShader"]),
            Capabilities { kind: vk::PhysicalDeviceType::CPU, ..device("software", &[], &[]) },
            Capabilities { kind: vk::PhysicalDeviceType::INTEGRATED_GPU, ..device("integrated", &[], &[]) },
            device("discrete", &[], &[]),
        ];
        list.sort_by_key(Capabilities::rank);
        let names: Vec<&str> = list.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(names, ["discrete", "integrated", "software", "no feedback", "unusable"]);
    }

    #[test]
    fn a_device_without_geometry_shaders_says_so_and_is_still_picked() {
        let plain = device("Plain GPU", &[], &["geometryShader", "VK_EXT_transform_feedback"]);
        let (_, picked) = pick(vec![((), plain)], None).expect("classic runs on it");
        assert_eq!(
            picked.why_no_feedback().as_deref(),
            Some("Plain GPU lacks geometryShader, VK_EXT_transform_feedback; technique classic runs without it")
        );
        assert_eq!(device("Good GPU", &[], &[]).why_no_feedback(), None);
    }
}
