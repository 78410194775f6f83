//! `relume info`: devices, what each supports, what relume would use.

use ash::vk;

use super::output::say;
use crate::Result;
use crate::gpu::context::devices;

#[derive(Debug, clap::Args)]
pub(super) struct Args {}

pub(super) fn run(_args: &Args) -> Result<()> {
    let list = devices()?;
    if list.is_empty() {
        say!("no Vulkan device was found (tools/setup installs a software one)")?;
    }
    for (i, device) in list.iter().enumerate() {
        let version = device.api_version;
        let kind = match device.kind {
            vk::PhysicalDeviceType::DISCRETE_GPU => "discrete GPU",
            vk::PhysicalDeviceType::INTEGRATED_GPU => "integrated GPU",
            vk::PhysicalDeviceType::VIRTUAL_GPU => "virtual GPU",
            vk::PhysicalDeviceType::CPU => "software",
            _ => "other",
        };
        say!("{}{}", device.name, if i == 0 && device.usable() { "  <- relume would use this one" } else { "" })?;
        say!("  {kind}, driver {}", device.driver)?;
        say!("  Vulkan {}.{}", vk::api_version_major(version), vk::api_version_minor(version))?;
        say!("  storage buffers up to {} MiB, images up to {}", device.max_storage_range >> 20, device.max_image_size)?;
        let list = |missing: &[&str]| missing.join(", ");
        match (device.usable(), device.feedback()) {
            (false, _) => say!("  unusable: lacks {}", list(&device.missing))?,
            (true, true) => say!("  techniques: classic, mipmapped, hybrid, shared")?,
            (true, false) => say!("  techniques: classic (others need {})", list(&device.missing_feedback))?,
        }
    }
    Ok(())
}
