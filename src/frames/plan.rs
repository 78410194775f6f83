//! What fits: image regions, pair buffers and micro-buffers under a memory budget.

use super::Settings;
use crate::gpu::Context;
use crate::passes::rasterise::{MicroBuffers, RasterInfo};
use crate::passes::{gbuffer, receivers};
use crate::{Error, Result};

/// Staging for uploads and downloads comes and goes beside everything else.
const STAGING: u64 = 18 << 20;
/// Fixed bytes a region pixel: G-buffer, receivers, output, list headers.
const REGION_BYTES_PER_PIXEL: u64 = gbuffer::BYTES_PER_PIXEL + receivers::BYTES_PER_PIXEL + 16 + 11;
/// Larger micro-buffer memory than this only leaves the caches.
const MOST_MICROBUFFER_BYTES: u64 = 16 << 20;
/// A dispatch sized from a count has at most 65,535 workgroups of 64.
const MOST_PAIRS: u64 = 65_535 * 64;

/// Sizes for one scene and one budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Plan {
    /// Largest side of an image region, a multiple of 16.
    pub(super) region: u32,
    /// Pairs that one feedback buffer holds (feedback techniques), or nodes in all lists (classic).
    pub(super) pairs: u32,
    /// Micro-buffers at once.
    pub(super) micro_pixels: u32,
}

impl Plan {
    /// Divides what the budget leaves beside the scene; `bytes_per_pair` is what one pair of capacity costs.
    pub(super) fn new(
        context: &Context,
        settings: &Settings,
        raster: RasterInfo,
        scene_bytes: u64,
        bytes_per_pair: u64,
    ) -> Result<Self> {
        let budget = settings.memory_budget;
        let free = budget.saturating_sub(scene_bytes + STAGING);
        let sides = [1024, 512, 256, 128, 64, 32, 16_u32];
        let region_bytes = |side: u32| {
            let clip = |length: u32| u64::from(length.min(side).next_multiple_of(16));
            clip(settings.width) * clip(settings.height) * REGION_BYTES_PER_PIXEL
        };
        let region = sides.into_iter().find(|side| region_bytes(*side) <= free / 8 * 5).unwrap_or(16);
        let rest = free.saturating_sub(region_bytes(region));
        let micro = raster.bytes_per_pixel();
        let micro_pixels = (rest / 2).min(MOST_MICROBUFFER_BYTES) / micro;
        let micro_pixels = micro_pixels.min(MicroBuffers::most(context, raster)) / 4 * 4;
        let pairs = settings.pair_capacity.map_or(rest / 2 / bytes_per_pair, u64::from).min(MOST_PAIRS);
        let largest = context.capabilities.max_storage_range / 8;
        let pairs = pairs.min(largest);
        // One block of pixels and a few pairs are the least that makes progress.
        let (least_pixels, least_pairs) = (4, 64);
        if micro_pixels < least_pixels || pairs < least_pairs {
            let needed = scene_bytes + STAGING + region_bytes(16) + 2 * (least_pixels * micro + (1 << 20));
            return Err(Error::Limit(format!(
                "a memory budget of {} MiB is too small for this scene: it needs about {} MiB",
                budget >> 20,
                needed.div_ceil(1 << 20)
            )));
        }
        Ok(Self { region, pairs: pairs as u32, micro_pixels: micro_pixels as u32 })
    }
}
