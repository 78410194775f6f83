//! What the devices of the system can do, of what relume uses, and in which order it prefers them.

use std::ffi::{CStr, c_char};

use ash::{ext, khr, vk};

use super::context::{start, vulkan};
use crate::{Error, Result};

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
pub(super) fn ranked(instance: &ash::Instance) -> Result<Vec<(vk::PhysicalDevice, Capabilities)>> {
    // SAFETY: a plain query on a live instance.
    let physical = unsafe { instance.enumerate_physical_devices() }.map_err(vulkan("vkEnumeratePhysicalDevices"))?;
    let mut list: Vec<_> = physical.into_iter().map(|device| (device, inspect(instance, device))).collect();
    list.sort_by_key(|(_, capabilities)| capabilities.rank());
    Ok(list)
}

pub(super) fn has_extension(extensions: &[vk::ExtensionProperties], name: &CStr) -> bool {
    extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name))
}

pub(super) fn device_extensions(instance: &ash::Instance, device: vk::PhysicalDevice) -> Vec<vk::ExtensionProperties> {
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

pub(super) fn graphics_family(instance: &ash::Instance, device: vk::PhysicalDevice) -> Option<u32> {
    // SAFETY: a plain query on a live instance.
    let families = unsafe { instance.get_physical_device_queue_family_properties(device) };
    let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    families.iter().position(|f| f.queue_flags.contains(wanted)).and_then(|i| u32::try_from(i).ok())
}

/// The first of `list`, or the first with `wanted` in its name; an error where that one lacks what relume needs.
pub(super) fn pick<D>(list: Vec<(D, Capabilities)>, wanted: Option<&str>) -> Result<(D, Capabilities)> {
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
