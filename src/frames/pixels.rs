//! Lights pixels one by one, from micro-buffers of their own: all of them with the paper's techniques, what technique
//! `shared` leaves, and narrow lobes.

use std::cell::Cell;
use std::sync::Arc;

use super::region::Region;
use super::renderer::{Batch, Renderer};
use super::{FrameStats, Settings, Technique};
use crate::Result;
use crate::gpu::{Bindings, Buffer, Context, Recorder};
use crate::passes::convolve::ConvolvePass;
use crate::passes::rasterise::{MicroBuffers, RasterCounts, RasterInfo, RasterPass};
use crate::passes::tile_radiance::radiance_scale;
use crate::passes::{Gather, sin2_of_share};
use crate::scene::Camera;

/// Chunks of one submission: enough to hide its cost, few enough for progress to move.
const CHUNKS_PER_SUBMISSION: usize = 16;

/// The passes and their buffers.
pub(super) struct PixelPasses {
    context: Arc<Context>,
    pub(super) info: RasterInfo,
    raster: RasterPass,
    pub(super) micro_buffers: MicroBuffers,
    counts: Buffer,
    /// Dispatches that a chunk's raster passes are given; grows when they do not suffice.
    rounds: Cell<u32>,
    pub(super) convolve: ConvolvePass,
}

/// Where and for whom pixels are lit.
#[derive(Clone, Copy)]
pub(super) struct Shot<'a> {
    pub(super) renderer: &'a Renderer,
    pub(super) region: &'a Region,
    pub(super) camera: &'a Camera,
    pub(super) coverage_limit: f32,
}

impl Shot<'_> {
    /// Size of a pixel a metre away, metres.
    pub(super) fn pixel_size(&self) -> f32 {
        2.0 * (0.5 * self.camera.fov_y).tan() / self.renderer.settings.height as f32
    }

    /// Constants of the raster passes and the convolution, for `count` micro-buffers of `size` micro-pixels a side.
    pub(super) fn gather(&self, size: u32, first: u32, count: u32) -> Gather {
        let Shot { renderer, region, camera, coverage_limit } = *self;
        // Not so dark that the scale would be infinite: black clouds.
        let brightest = f64::from(renderer.hierarchy.brightest().max(1e-20));
        Gather {
            pixels: region.receivers.pixels,
            first_entry: first,
            entry_count: count,
            // Sums of 32 bits hold `coverage_limit` micro-pixels of the brightest radiance, and one to spare.
            color_scale: (4_294_967_296.0 / (f64::from(coverage_limit + 1.0) * brightest)) as f32,
            eye: camera.from.into(),
            coverage_limit,
            width: region.rect.width,
            height: region.rect.height,
            tiles_x: region.receivers.tiles_x,
            material_parameter: renderer.settings.material.parameter(),
            far_field_height: renderer.far_field.height,
            stop_sin2: stop_sin2(&renderer.settings, size),
            last_round: 0,
            typical: renderer.hierarchy.typical().max(1e-20),
            sharp_alpha: renderer.settings.sharp_alpha(),
            radiance_scale: radiance_scale(renderer.hierarchy.brightest().max(renderer.far_field.brightest())),
            store_columns: renderer.pixels.micro_buffers.columns(),
        }
    }
}

/// Squared sine of the half angle of a cone as large as the nodes that stop, for micro-buffers of `size` micro-pixels a
/// side.
pub(super) fn stop_sin2(settings: &Settings, size: u32) -> f32 {
    sin2_of_share(settings.stop / f64::from(size * size))
}

impl PixelPasses {
    /// Passes with room for `pixels` micro-buffers.
    pub(super) fn new(
        context: &Arc<Context>,
        settings: &Settings,
        info: RasterInfo,
        convolve: ConvolvePass,
        pixels: u32,
    ) -> Result<Self> {
        Ok(Self {
            context: context.clone(),
            raster: RasterPass::new(context, info)?,
            micro_buffers: MicroBuffers::new(context, info, pixels)?,
            counts: Buffer::new(context, "raster counts", size_of::<RasterCounts>() as u64)?,
            rounds: Cell::new(first_rounds(settings, info)),
            convolve,
            info,
        })
    }

    /// Micro-buffers and image of a batch, chunk by chunk: the passes after the traversal, in order.
    pub(super) fn shade(
        &self,
        shot: Shot<'_>,
        batch: &Batch,
        stats: &mut FrameStats,
        progress: &mut dyn FnMut(u64),
    ) -> Result<()> {
        let chunk = self.micro_buffers.pixels;
        let total = batch.pixels.len() as u32;
        let starts: Vec<u32> = (0..total).step_by(chunk as usize).collect();
        for group in starts.chunks(CHUNKS_PER_SUBMISSION) {
            shot.renderer.check_stop()?;
            while !self.shade_chunks(shot, batch, group, stats)? {
                self.rounds.set(self.rounds.get() * 2);
            }
            progress(u64::from(group.last().map_or(0, |first| (first + chunk).min(total))));
        }
        Ok(())
    }

    /// One submission of [`PixelPasses::shade`]; false when the raster passes need more rounds, and nothing counts then.
    fn shade_chunks(&self, shot: Shot<'_>, batch: &Batch, starts: &[u32], stats: &mut FrameStats) -> Result<bool> {
        let bindings = self.bindings(shot.renderer.node_bindings(shot.region), batch);
        let raster_sets = self.raster.bind(&bindings, &self.micro_buffers)?;
        let surfaces = shot.renderer.surface_bindings(shot.region, self.info.lobe);
        let convolve_set = self.convolve.bind(bindings.and(surfaces), &shot.renderer.far_field)?;
        let before = self.counts()?;
        let mut recorder = Recorder::new(&self.context)?;
        for first in starts {
            let count = self.micro_buffers.pixels.min(batch.pixels.len() as u32 - first);
            let constants = shot.gather(self.info.size, *first, count);
            // Empty micro-buffers.
            self.micro_buffers.clear(&mut recorder, count);
            // The cut's nodes in them.
            self.raster.record(&mut recorder, &raster_sets, constants, self.rounds.get())?;
            // Times the BRDF.
            self.convolve.record(&mut recorder, &convolve_set, constants)?;
        }
        recorder.finish(&mut stats.profile)?;
        self.counts_since(before, &self.raster)
    }

    /// What the raster passes bind for a batch, beside nodes and receivers.
    pub(super) fn bindings<'a>(&'a self, others: Bindings<'a>, batch: &'a Batch) -> Bindings<'a> {
        let bindings = self.micro_buffers.bindings(others).buffer("Entries", &batch.entries);
        let bindings = bindings.buffer("RasterCounts", &self.counts);
        match &batch.alphas {
            None => bindings,
            Some(alphas) => bindings.buffer("lobe_alphas", alphas),
        }
    }

    /// The counts' buffer under the name that shaders use, for raster passes elsewhere.
    pub(super) fn count_bindings<'a>(&'a self, others: Bindings<'a>) -> Bindings<'a> {
        others.buffer("RasterCounts", &self.counts).buffer("ConvolveCounts", &self.convolve.overflowed)
    }

    /// Sets all counts to zero.
    pub(super) fn reset_counts(&self) -> Result<()> {
        self.counts.upload(bytemuck::bytes_of(&RasterCounts::default()))
    }

    /// What the raster passes have counted.
    pub(super) fn counts(&self) -> Result<RasterCounts> {
        Ok(self.counts.download(1)?[0])
    }

    /// Whether a submission of `raster` that started with the given counts finished all it had; otherwise they are put
    /// back.
    pub(super) fn counts_since(&self, before: RasterCounts, raster: &RasterPass) -> Result<bool> {
        let after = self.counts()?;
        let done = after.unfinished == before.unfinished;
        if done {
            self.context.trace.count(raster.counting_pass(), &raster.named(after.since(before)));
        } else {
            self.counts.upload(bytemuck::bytes_of(&before))?;
        }
        Ok(done)
    }

    /// Adds a frame's counts to its statistics.
    pub(super) fn report(&self, stats: &mut FrameStats) -> Result<()> {
        let counts = self.counts()?;
        if counts == RasterCounts::default() {
            return Ok(());
        }
        for (what, amount) in self.raster.named(counts) {
            stats.profile.count(self.raster.counting_pass(), what, amount);
        }
        stats.rasterised_nodes += counts.drawn;
        stats.visited_pairs += counts.visited;
        stats.microbuffer_bytes += u64::from(self.micro_buffers.pixels) * self.info.bytes_per_pixel();
        Ok(())
    }
}

/// Dispatches that a chunk's raster passes most likely need: one has a bounded amount of work, and a round too many
/// costs next to nothing.
fn first_rounds(settings: &Settings, info: RasterInfo) -> u32 {
    let work = info.size * info.size;
    1 + work / if settings.technique == Technique::Classic { 256 } else { 512 }
}
