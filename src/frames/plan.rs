//! What fits: image regions, pair buffers and micro-buffers under a memory budget.

use super::{Settings, Technique, renderer, shared};
use crate::gpu::Context;
use crate::passes::rasterise::{MicroBuffers, RasterInfo};
use crate::passes::tile_radiance::Tiles;
use crate::passes::{gbuffer, receivers};
use crate::{Error, Result};

/// Staging for uploads and downloads comes and goes beside everything else.
const STAGING: u64 = 5 << 20;
/// Fixed bytes a region pixel: G-buffer, receivers, output, list headers.
const REGION_BYTES_PER_PIXEL: u64 = gbuffer::BYTES_PER_PIXEL + receivers::BYTES_PER_PIXEL + 16 + 11;
/// Larger micro-buffer memory than this only leaves the caches.
const MOST_MICROBUFFER_BYTES: u64 = 16 << 20;
/// A dispatch sized from a count has at most 65,535 workgroups of 64.
const MOST_PAIRS: u64 = 65_535 * 64;
/// Tiles of technique `shared` have few pairs.
const MOST_TILE_PAIRS: u64 = 1 << 21;

/// Sizes for one scene and one budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Plan {
    /// Largest side of an image region, a multiple of 16.
    pub(super) region: u32,
    /// Pairs that one feedback buffer holds (feedback techniques), or nodes in all lists (classic).
    pub(super) pairs: u32,
    /// Micro-buffers at once.
    pub(super) micro_pixels: u32,
    /// Buffers of narrow lobes at once.
    pub(super) lobe_pixels: u32,
    /// What technique `shared` has.
    pub(super) tiles: Option<TilePlan>,
}

/// Sizes of technique `shared`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TilePlan {
    /// Buffers of tiles.
    pub(super) slots: u32,
    /// Tiles that are rasterised at once.
    pub(super) at_once: u32,
    /// Pairs that one feedback buffer holds.
    pub(super) pairs: u32,
    /// Nodes in the lists of all tiles that are rasterised at once.
    pub(super) nodes: u32,
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
        let shared = settings.technique == Technique::Shared;
        let sides = [1024, 512, 256, 128, 64, 32, 16_u32];
        // Technique `shared` takes in the tiles around a region.
        let margin = if shared { 32 } else { 0 };
        let region_pixels = |side: u32| {
            let clip = |length: u32| u64::from(length.min(side + margin).next_multiple_of(16));
            clip(settings.width) * clip(settings.height)
        };
        let tile_bytes = Tiles::bytes(shared::texels(settings.microbuffer));
        // Room for some tiles to split.
        let slots = |side: u32| region_pixels(side) / 256 * 3 / 2 + 16;
        let fits = |side: &u32| {
            let share = if shared { 2 } else { 5 };
            region_pixels(*side) * REGION_BYTES_PER_PIXEL <= free / 8 * share
                && (!shared || slots(*side) * tile_bytes <= free / 4)
        };
        let region = sides.into_iter().find(fits).unwrap_or(16);
        let mut rest = free.saturating_sub(region_pixels(region) * REGION_BYTES_PER_PIXEL);
        let tiles = shared.then(|| {
            rest = rest.saturating_sub(slots(region) * tile_bytes);
            let sums = shared::raster_info(settings);
            let at_once = ((rest / 4).min(MOST_MICROBUFFER_BYTES) / sums.bytes_per_pixel())
                .min(MicroBuffers::most(context, sums))
                .max(1);
            rest = rest.saturating_sub(at_once * sums.bytes_per_pixel());
            let nodes = (rest / 4 / 4).clamp(1024, MOST_TILE_PAIRS);
            rest = rest.saturating_sub(nodes * 4);
            let pairs = (rest / 3 / bytes_per_pair).clamp(64, MOST_TILE_PAIRS);
            rest = rest.saturating_sub(pairs * bytes_per_pair);
            TilePlan { slots: slots(region) as u32, at_once: at_once as u32, pairs: pairs as u32, nodes: nodes as u32 }
        });
        let lobe_bytes = renderer::LOBE_INFO.bytes_per_pixel();
        let lobe_pixels =
            if settings.sharp_alpha() > 0.0 { ((rest / 4).min(MOST_MICROBUFFER_BYTES) / lobe_bytes).max(4) } else { 0 };
        rest = rest.saturating_sub(lobe_pixels * lobe_bytes);
        let micro = raster.bytes_per_pixel();
        let micro_pixels = (rest / 2).min(MOST_MICROBUFFER_BYTES) / micro;
        let micro_pixels = micro_pixels.min(MicroBuffers::most(context, raster)) / 4 * 4;
        let pairs = settings.pair_capacity.map_or(rest / 2 / bytes_per_pair, u64::from).min(MOST_PAIRS);
        let largest = context.capabilities.max_storage_range / 8;
        let pairs = pairs.min(largest);
        // One block of pixels and a few pairs are the least that makes progress.
        let (least_pixels, least_pairs) = (4, 64);
        if micro_pixels < least_pixels || pairs < least_pairs {
            let needed = scene_bytes
                + STAGING
                + region_pixels(16) * REGION_BYTES_PER_PIXEL
                + 2 * (least_pixels * micro + (1 << 20));
            return Err(Error::Limit(format!(
                "a memory budget of {} MiB is too small for this scene: it needs about {} MiB",
                budget >> 20,
                needed.div_ceil(1 << 20)
            )));
        }
        Ok(Self {
            region,
            pairs: pairs as u32,
            micro_pixels: micro_pixels as u32,
            lobe_pixels: lobe_pixels as u32,
            tiles,
        })
    }

    /// Nodes in all lists of a region.
    pub(super) fn nodes(&self) -> u32 {
        self.pairs.max(self.tiles.map_or(0, |tiles| tiles.nodes))
    }
}
