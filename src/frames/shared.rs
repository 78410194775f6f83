//! Technique `shared`: one buffer over the full sphere for all pixels of a tile, blended between neighbouring tiles.
//! No paper among ours has it; it carries the cone mipmap of Sabbadin 2019, 5.2.1, to its end: neighbours see the same
//! nodes in the same directions, so a tile's cut is rasterised once.
//!
//! A tile is a receiver of 16 x 16, 8 x 8 or 4 x 4 pixels: it splits where its extent, as seen from the nodes that light
//! it, is more than a part of a texel. What even 4 x 4 pixels are too much for is left to the per-pixel passes.

use std::sync::Arc;

use super::batch::Coverage;
use super::feedback::Feedback;
use super::pixels::Shot;
use super::plan::TilePlan;
use super::renderer::Outcome;
use super::tile_map::{FINEST, TexelPairs, TileMap};
use super::{FrameStats, Settings};
use crate::Result;
use crate::gpu::{Buffer, Context, Recorder};
use crate::passes::rasterise::{MicroBuffers, RasterInfo, RasterPass};
use crate::passes::tile_convolve::TileConvolvePass;
use crate::passes::tile_radiance::{TileRadiancePass, Tiles};
use crate::passes::{CutRules, GpuHierarchy, Paper, Receiver, Traversal, sin2_of_share};

/// Texels along a tile's side for micro-buffers of `microbuffer` micro-pixels: about the same solid angle each.
pub(super) fn texels(microbuffer: u32) -> u32 {
    2 * (f64::from(microbuffer) * 0.708).round() as u32
}

/// What a tile's buffer is rasterised with.
pub(super) fn raster_info(settings: &Settings) -> RasterInfo {
    RasterInfo { size: texels(settings.microbuffer), walk: false, shared: true, ..RasterInfo::default() }
}

/// A tile's pairs leave the geometry shader at so many times the solid angle that those of pixels do: there are few of
/// them, and compute passes take them from there on more cores.
const EARLY: f64 = 32.0;

/// The passes and buffers of the technique.
pub(super) struct Shared {
    context: Arc<Context>,
    feedback: Feedback,
    raster: RasterPass,
    /// Sums of the tiles in work.
    sums: MicroBuffers,
    radiance: TileRadiancePass,
    convolve: TileConvolvePass,
    tiles: Tiles,
    pairs: TexelPairs,
    rounds: u32,
    limit: f32,
}

impl Shared {
    pub(super) fn new(
        context: &Arc<Context>,
        settings: &Settings,
        hierarchy: &GpuHierarchy,
        far_field: bool,
        plan: TilePlan,
    ) -> Result<Self> {
        let info = raster_info(settings);
        let rules = CutRules { paper: Paper::default(), shared: true };
        Ok(Self {
            context: context.clone(),
            feedback: Feedback::new(context, true, rules, hierarchy, plan.pairs)?.with_lists(plan.nodes),
            raster: RasterPass::new(context, info)?,
            sums: MicroBuffers::new(context, info, plan.at_once)?,
            radiance: TileRadiancePass::new(context, info.size, far_field)?,
            convolve: TileConvolvePass::new(context, info.size, settings.material, settings.sharp_alpha() > 0.0)?,
            pairs: TexelPairs::new(info.size),
            tiles: Tiles::new(context, info.size, plan.slots)?,
            rounds: 3 + info.size * info.size / 512,
            limit: settings.tile_parallax() as f32,
        })
    }

    /// Lights a region; returns the receivers that are left for the per-pixel passes.
    pub(super) fn light(
        &mut self,
        shot: Shot<'_>,
        coverage: &Coverage,
        stats: &mut FrameStats,
    ) -> Result<Vec<Receiver>> {
        let receivers = &shot.region.receivers;
        let mut map = TileMap::new(receivers, coverage)?;
        let mut free: Vec<u32> = (0..self.tiles.capacity).rev().collect();
        let mut left = Vec::new();
        let mut work = coverage.tiles();
        while !work.is_empty() {
            let mut next = Vec::new();
            let mut start = 0;
            while start < work.len() {
                shot.renderer.check_stop()?;
                let most = self.feedback.batch_tiles().min(self.sums.pixels as usize).min(free.len());
                if most == 0 {
                    left.extend_from_slice(&work[start..]);
                    break;
                }
                let batch = &work[start..work.len().min(start + most)];
                start += batch.len();
                self.fill(shot, batch, &mut map, &mut free, &mut left, stats)?;
                for tile in batch {
                    if let Some(parallax) = map.parallax(*tile).filter(|parallax| *parallax > self.limit) {
                        free.extend(map.remove(*tile));
                        if tile.level() == FINEST {
                            left.push(*tile);
                        } else {
                            let extent = |tile| map.extent(tile, shot.camera.from, shot.pixel_size());
                            split(coverage, self.limit, &extent, *tile, parallax, &mut next);
                        }
                    }
                }
            }
            work = next;
        }
        stats.tiles += map.tiles();
        self.convolve(shot, coverage, &map, stats)?;
        left.sort_unstable();
        Ok(left.into_iter().filter(|r| shot.region.is_core(*r)).collect())
    }

    /// Finds the cuts of a batch of tiles and fills their buffers; what does not fit even alone is left.
    fn fill(
        &mut self,
        shot: Shot<'_>,
        batch: &[Receiver],
        map: &mut TileMap,
        free: &mut Vec<u32>,
        left: &mut Vec<Receiver>,
        stats: &mut FrameStats,
    ) -> Result<()> {
        let Shot { renderer, region, .. } = shot;
        let share = |multiple: f64| sin2_of_share(multiple * 2.0 / f64::from(self.tiles.size * self.tiles.size));
        let constants = Traversal {
            pixels: region.receivers.pixels,
            stop_sin2: share(renderer.settings.stop),
            switch_sin2: share(EARLY * renderer.settings.switch),
            capacity: 0,
            list_capacity: 0,
        };
        let span = self.context.trace.span("batch");
        span.count("tiles", batch.len() as u64);
        let outcome = self.feedback.cut(&renderer.hierarchy, region, batch, constants, stats)?;
        if let Outcome::Overflowed = outcome {
            stats.splits += 1;
            let most = self.feedback.batch_tiles();
            let (first, second) = match batch {
                // Longer lists may do.
                batch if batch.len() > most => batch.split_at(most),
                [tile] => {
                    left.push(*tile);
                    return Ok(());
                }
                batch => batch.split_at(batch.len() / 2),
            };
            self.fill(shot, first, map, free, left, stats)?;
            return self.fill(shot, second, map, free, left, stats);
        }
        stats.batches += 1;
        let codes: Vec<u32> = batch.iter().map(|r| r.0).collect();
        let slots = free.split_off(free.len() - batch.len());
        let entries = Buffer::from_slice(&self.context, "tile entries", &codes)?;
        let slot_buffer = Buffer::from_slice(&self.context, "tile slots", &slots)?;
        let parallax = Buffer::new(&self.context, "tile parallax", batch.len() as u64 * 4)?;
        let bindings = self.tiles.bindings(self.sums.bindings(renderer.node_bindings(region)));
        let bindings = renderer.pixels.count_bindings(renderer.far_field.bindings(bindings));
        let bindings =
            bindings.buffer("Entries", &entries).buffer("TileSlots", &slot_buffer).buffer("TileParallax", &parallax);
        let raster_sets = self.raster.bind(&bindings, &self.sums)?;
        let radiance_set = self.radiance.bind(&bindings)?;
        let gather = shot.gather(self.tiles.size, 0, batch.len() as u32);
        loop {
            let before = renderer.pixels.counts()?;
            let mut recorder = Recorder::new(&self.context)?;
            // Empty texels.
            self.sums.clear(&mut recorder, gather.entry_count);
            // The cut's nodes in them.
            self.raster.record(&mut recorder, &raster_sets, gather, self.rounds)?;
            // Their radiance.
            self.radiance.record(&mut recorder, &radiance_set, gather)?;
            recorder.finish(&mut stats.profile)?;
            if renderer.pixels.counts_since(before, &self.raster)? {
                break;
            }
            self.rounds *= 2;
        }
        let pixel = shot.pixel_size();
        for ((tile, slot), parallax) in batch.iter().zip(slots).zip(parallax.download::<f32>(batch.len())?) {
            let share = map.extent(*tile, shot.camera.from, pixel) / map.radius(*tile).max(1e-20);
            map.insert(*tile, slot, parallax * share);
        }
        Ok(())
    }

    /// Lights all blocks that have tiles.
    fn convolve(&self, shot: Shot<'_>, coverage: &Coverage, map: &TileMap, stats: &mut FrameStats) -> Result<()> {
        let Shot { renderer, region, .. } = shot;
        let (texels, tiles) = map.blocks(coverage, &self.pairs, |tile| region.is_core(tile));
        if tiles.is_empty() {
            return Ok(());
        }
        let format = ash::vk::Format::R32G32B32A32_UINT;
        let block_tiles = Buffer::texels_from_slice(&self.context, "block tiles", &tiles, format)?;
        let pairs = Buffer::texels_from_slice(&self.context, "texel pairs", &texels, ash::vk::Format::R16_UINT)?;
        let bindings = self.tiles.bindings(region.receivers.bindings(renderer.surface_bindings(region, false)));
        let bindings = bindings.buffer("block_tiles", &block_tiles).buffer("texel_pairs", &pairs);
        let set = self.convolve.bind(bindings)?;
        let mut recorder = Recorder::new(&self.context)?;
        self.convolve.record(&mut recorder, &set, shot.gather(self.tiles.size, 0, tiles.len() as u32))?;
        recorder.finish(&mut stats.profile)
    }
}

/// The covered tiles below one with too much parallax that most likely have little enough.
fn split(
    coverage: &Coverage,
    limit: f32,
    extent: &dyn Fn(Receiver) -> f32,
    tile: Receiver,
    parallax: f32,
    next: &mut Vec<Receiver>,
) {
    for child in tile.children().into_iter().filter(|child| coverage.pixels(*child).next().is_some()) {
        let expected = parallax * extent(child) / extent(tile).max(1e-20);
        if child.level() > FINEST && expected > 1.2 * limit {
            split(coverage, limit, extent, child, expected, next);
        } else {
            next.push(child);
        }
    }
}
