//! Renders frames: regions of the image, batches of tiles, chunks of micro-buffers, each as large as the budget allows.

use std::sync::Arc;
use std::time::Instant;

use ash::vk;
use glam::Vec3;

use super::batch::Coverage;
use super::classic::Classic;
use super::feedback::Feedback;
use super::plan::Plan;
use super::{Frame, FrameStats, Settings, Technique, classic, feedback};
use crate::gpu::pipeline::{DescriptorSet, Sampler};
use crate::gpu::{Buffer, Context, Recorder, Use};
use crate::passes::bin::CutLists;
use crate::passes::convolve::{ConvolvePass, GpuFarField};
use crate::passes::gbuffer::{GBuffer, GBufferPass, Rect, View};
use crate::passes::rasterise::{MicroBuffers, RasterInfo, RasterPass};
use crate::passes::receivers::{ReceiverPass, Receivers};
use crate::passes::{Gather, GpuHierarchy, Receiver, Traversal, sin2_of_share};
use crate::preprocess::hierarchy::Hierarchy;
use crate::reference::cut;
use crate::scene::{Camera, FarField, Object};
use crate::{Error, Result};

/// The images and buffers of one image region.
pub(super) struct Region {
    rect: Rect,
    gbuffer: GBuffer,
    pub(super) receivers: Receivers,
    pub(super) lists: CutLists,
    output: Buffer,
}

/// What one turn of the traversal works on.
pub(super) struct Batch {
    /// Where it starts.
    pub(super) receivers: Vec<Receiver>,
    /// Entries of the raster passes: blocks, or pixels for classic.
    pub(super) entries: Vec<u32>,
    /// The same on the device.
    pub(super) entry_buffer: Buffer,
}

/// How a batch's traversal ended.
pub(super) enum Outcome {
    /// The lists are complete.
    Done,
    /// Something did not fit; the batch is void.
    Overflowed,
    /// Not even one pixel fits.
    TooSmall {
        /// Nodes that it needs.
        needed: u64,
        /// Nodes that there is room for.
        capacity: u32,
    },
}

enum Traverser {
    Classic(Classic),
    Feedback(Feedback),
}

/// One node that one pixel rasterises.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CutPair {
    /// Pixel, row by row from the upper left.
    pub pixel: u32,
    /// Node of the hierarchy.
    pub node: u32,
}

/// A scene on the device, ready to render frames of one size with one technique.
pub struct Renderer {
    context: Arc<Context>,
    settings: Settings,
    plan: Plan,
    hierarchy: GpuHierarchy,
    /// Centre and radius of the object's bounds.
    bounds: (Vec3, f32),
    far_field: GpuFarField,
    gbuffer: GBufferPass,
    receivers: ReceiverPass,
    traverser: Traverser,
    raster_info: RasterInfo,
    raster: RasterPass,
    micro_buffers: MicroBuffers,
    raster_counts: Buffer,
    convolve: ConvolvePass,
    nearest: Sampler,
}

/// Chunks of one submission: enough to hide its cost, few enough for progress to move.
const CHUNKS_PER_SUBMISSION: usize = 16;

/// Sums of coverage that fixed-point sums hold before they run over, in micro-pixels.
const COVERAGE_LIMIT: f32 = 63.0;

impl Renderer {
    /// Uploads a scene, the object in world space, and makes everything that frames need.
    ///
    /// # Errors
    /// [`Error::Argument`] for settings that make no sense, [`Error::Device`] where the technique needs what the device
    /// lacks, [`Error::Limit`] where the scene does not fit the device or the budget.
    pub fn new(
        context: &Arc<Context>,
        hierarchy: &Hierarchy,
        object: &Object,
        far_field: Option<&FarField>,
        settings: Settings,
    ) -> Result<Self> {
        check(&settings)?;
        let feedback = settings.technique != Technique::Classic;
        if let (true, Some(why)) = (feedback, context.why_no_feedback()) {
            return Err(Error::Device(why));
        }
        let before = context.bytes_now();
        let hierarchy = GpuHierarchy::new(context, hierarchy)?;
        let gbuffer = GBufferPass::new(context, object)?;
        let far_field = GpuFarField::new(context, far_field)?;
        let raster_info = RasterInfo {
            size: settings.microbuffer,
            pixels_per_entry: if feedback { 4 } else { 1 },
            paper: settings.paper,
        };
        let convolve = ConvolvePass::new(context, raster_info, settings.material)?;
        let scene_bytes = context.bytes_now() - before;
        let bytes_per_pair =
            if feedback { feedback::bytes_per_pair(settings.technique) } else { classic::BYTES_PER_NODE };
        let plan = Plan::new(context, &settings, raster_info, scene_bytes, bytes_per_pair)?;
        let traverser = if feedback {
            Traverser::Feedback(Feedback::new(context, &settings, &hierarchy, plan.pairs)?)
        } else {
            Traverser::Classic(Classic::new(context, &settings, plan.pairs)?)
        };
        let image_pixels = settings.width.next_multiple_of(16) * settings.height.next_multiple_of(16);
        let (low, high) = object.bounds();
        Ok(Self {
            context: context.clone(),
            bounds: (0.5 * (low + high), 0.5 * (high - low).length()),
            receivers: ReceiverPass::new(context)?,
            raster: RasterPass::new(context, raster_info)?,
            micro_buffers: MicroBuffers::new(context, raster_info, plan.micro_pixels.min(image_pixels))?,
            raster_counts: Buffer::new(context, "raster counts", 16)?,
            nearest: Sampler::new(context, vk::Filter::NEAREST, vk::SamplerAddressMode::CLAMP_TO_EDGE)?,
            settings,
            plan,
            hierarchy,
            far_field,
            gbuffer,
            traverser,
            raster_info,
            convolve,
        })
    }

    /// Renders one frame; `progress` hears how many of how many pixels are done.
    ///
    /// # Errors
    /// [`Error::Limit`] where not even one pixel fits the budget; Vulkan's own errors.
    pub fn render(&mut self, camera: &Camera, progress: &mut dyn FnMut(u64, u64)) -> Result<Frame> {
        // Sums that run over are found and the frame is done again with coarser ones, never shown.
        let mut limit = COVERAGE_LIMIT;
        loop {
            let frame = self.render_once(camera, limit, progress)?;
            match self.convolve.overflowed()? {
                false => return Ok(frame),
                true if limit < 1e6 => limit *= 16.0,
                true => {
                    return Err(Error::Limit(format!(
                        "a micro-pixel is covered more than {limit} times over, which its sums do not hold"
                    )));
                }
            }
        }
    }

    /// Every [node, pixel] pair that a frame rasterises, sorted: for tests and for looking at cuts. `hierarchy` is the
    /// one that the renderer was made with. A receiver's list holds nodes that only some of its pixels see; here, as in
    /// the raster passes, each pixel leaves out what covers nothing of its own hemisphere.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn cut(&mut self, camera: &Camera, hierarchy: &Hierarchy) -> Result<Vec<CutPair>> {
        let mut pairs = Vec::new();
        let mut stats = FrameStats::default();
        let width = self.settings.width;
        for rect in self.regions() {
            let region = self.prepare_region(camera, rect, &mut stats)?;
            let coverage = Coverage(region.receivers.read_coverage()?);
            self.each_batch(&region, &coverage, &mut stats, |_, batch, _| {
                let lists: Vec<[u32; 2]> =
                    region.lists.lists.download(Receiver::slots(region.receivers.pixels) as usize)?;
                let nodes: Vec<u32> = region.lists.nodes.download((region.lists.nodes.size / 4) as usize)?;
                let slots = region.receivers.pixels as usize;
                let positions: Vec<[f32; 4]> = region.receivers.spheres.download(slots)?;
                let normals: Vec<[f32; 4]> = region.receivers.cones.download(slots)?;
                let three = |v: [f32; 4]| Vec3::new(v[0], v[1], v[2]);
                for pixel in batch.receivers.iter().flat_map(|r| coverage.pixels(*r)) {
                    let at = region.pixel_of(pixel, width);
                    let (position, normal) = (three(positions[pixel as usize]), three(normals[pixel as usize]));
                    for level in 0..=Receiver::TILE_LEVEL {
                        let receiver = Receiver::new(level, pixel >> (2 * level));
                        let [offset, length] = lists[receiver.slot(region.receivers.pixels) as usize];
                        let list = &nodes[offset as usize..(offset + length) as usize];
                        let seen = list.iter().filter(|n| cut::covers(hierarchy, **n as usize, position, normal));
                        pairs.extend(seen.map(|node| CutPair { pixel: at, node: *node }));
                    }
                }
                Ok(())
            })?;
        }
        pairs.sort_unstable();
        Ok(pairs)
    }

    /// Position and normal of every pixel as the traversal sees them, w of the position 1 where covered; row by row.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn receivers(&mut self, camera: &Camera) -> Result<Vec<([f32; 4], [f32; 4])>> {
        let (width, height) = (self.settings.width, self.settings.height);
        let mut all = vec![([0.0; 4], [0.0; 4]); (width * height) as usize];
        let mut stats = FrameStats::default();
        for rect in self.regions() {
            let region = self.prepare_region(camera, rect, &mut stats)?;
            let positions: Vec<[f32; 4]> = read_image(&region.gbuffer.position)?;
            let normals: Vec<[f32; 4]> = read_image(&region.gbuffer.normal)?;
            for (i, pair) in positions.into_iter().zip(normals).enumerate() {
                all[region.rect.index(i as u32, width)] = pair;
            }
        }
        Ok(all)
    }

    fn render_once(
        &mut self,
        camera: &Camera,
        coverage_limit: f32,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<Frame> {
        let start = Instant::now();
        let Settings { width, height, .. } = self.settings;
        let count = width as usize * height as usize;
        let mut frame = Frame {
            width,
            height,
            rgba: vec![[0.0; 4]; count],
            position: vec![[0.0; 4]; count],
            normal: vec![[0.0; 4]; count],
            albedo: vec![[0.0; 4]; count],
            stats: FrameStats::default(),
        };
        let mut stats = FrameStats::default();
        let mut wall = std::time::Duration::ZERO;
        self.raster_counts.upload(&[0; 16])?;
        for rect in self.regions() {
            let started = Instant::now();
            let region = self.prepare_region(camera, rect, &mut stats)?;
            let coverage = Coverage(region.receivers.read_coverage()?);
            let covered = coverage.count(&coverage.tiles());
            let (done_before, total) = (stats.covered_pixels, stats.covered_pixels + covered);
            stats.covered_pixels = total;
            let mut done = 0;
            self.each_batch(&region, &coverage, &mut stats, |renderer, batch, stats| {
                renderer.shade(&region, batch, camera, coverage_limit, stats, &mut |part| {
                    progress(done_before + done + part, total);
                })?;
                done += coverage.count(&batch.receivers);
                Ok(())
            })?;
            wall += started.elapsed();
            self.collect(&region, &mut frame)?;
        }
        let counts: Vec<u64> = self.raster_counts.download(2)?;
        let raster = if self.raster_info.paper.one_node() { "splat" } else { "visibility" };
        stats.profile.count(raster, "pairs_in", counts[0]);
        stats.profile.count(raster, "rasterised_nodes", counts[1]);
        stats.rasterised_nodes = counts[1];
        stats.microbuffer_bytes =
            u64::from(self.micro_buffers.pixels) * self.raster_info.bytes_per_pixel();
        stats.device_bytes_peak = self.context.bytes_peak();
        stats.wall_ms = wall.as_secs_f64() * 1e3;
        tracing::debug!("frame with readback took {:.1} ms", start.elapsed().as_secs_f64() * 1e3);
        frame.stats = stats;
        Ok(frame)
    }

    /// Rectangles that cover the image.
    fn regions(&self) -> Vec<Rect> {
        let Settings { width, height, .. } = self.settings;
        let side = self.plan.region;
        let mut list = Vec::new();
        for y in (0..height).step_by(side as usize) {
            for x in (0..width).step_by(side as usize) {
                list.push(Rect { x, y, width: side.min(width - x), height: side.min(height - y) });
            }
        }
        list
    }

    /// G-buffer and receivers of a region.
    fn prepare_region(&self, camera: &Camera, rect: Rect, stats: &mut FrameStats) -> Result<Region> {
        let receivers = Receivers::new(&self.context, rect.width, rect.height)?;
        let region = Region {
            rect,
            gbuffer: GBuffer::new(&self.context, rect.width, rect.height)?,
            lists: CutLists::new(&self.context, receivers.pixels, self.plan.pairs)?,
            output: Buffer::new(&self.context, "output", u64::from(rect.width) * u64::from(rect.height) * 16)?,
            receivers,
        };
        let (centre, radius) = self.bounds;
        let distance = camera.from.distance(centre);
        let far = (distance + radius) * 1.01 + 1e-6;
        let view = View {
            width: self.settings.width,
            height: self.settings.height,
            region: rect,
            near: ((distance - radius) * 0.99).max(far * 1e-4),
            far,
        };
        let mut recorder = Recorder::new(&self.context)?;
        recorder.pass("clear output", |device, commands| {
            // SAFETY: the buffer is live and was made as a copy target.
            unsafe { device.cmd_fill_buffer(commands, region.output.handle, 0, vk::WHOLE_SIZE, 0) };
        });
        recorder.barrier(&[Use::CopyTarget], &[Use::ComputeWrite]);
        // What the camera sees of the object.
        self.gbuffer.record(&mut recorder, &region.gbuffer, camera, view);
        // Receivers of five levels over it.
        let set = self.receivers.record(&mut recorder, &region.gbuffer, &region.receivers, &self.nearest)?;
        recorder.finish(&mut stats.profile)?;
        drop(set);
        Ok(region)
    }

    /// Finds the cut of all covered pixels batch by batch, splitting what overflows, and hands each batch on.
    fn each_batch(
        &mut self,
        region: &Region,
        coverage: &Coverage,
        stats: &mut FrameStats,
        mut finish: impl FnMut(&mut Self, &Batch, &mut FrameStats) -> Result<()>,
    ) -> Result<()> {
        let share = self.settings.stop / f64::from(self.settings.microbuffer * self.settings.microbuffer);
        let switch = self.settings.switch / f64::from(self.settings.microbuffer * self.settings.microbuffer);
        let constants = Traversal {
            pixels: region.receivers.pixels,
            stop_sin2: sin2_of_share(share),
            switch_sin2: sin2_of_share(switch),
            capacity: 0,
        };
        // Tiles that wait, the next one last, and batches that are ready because they were split.
        let mut tiles = coverage.tiles();
        tiles.reverse();
        let mut ready: Vec<Vec<Receiver>> = Vec::new();
        loop {
            let receivers = match ready.pop() {
                Some(batch) => batch,
                None if tiles.is_empty() => return Ok(()),
                None => {
                    let wanted = match &self.traverser {
                        Traverser::Feedback(feedback) => feedback.batch_tiles(),
                        Traverser::Classic(classic) => (classic.batch_pixels() / 256).max(1),
                    };
                    let mut batch = tiles.split_off(tiles.len().saturating_sub(wanted));
                    batch.reverse();
                    batch
                }
            };
            if let Traverser::Classic(classic) = &self.traverser
                && coverage.count(&receivers) > classic.batch_pixels() as u64
            {
                ready.extend(coverage.split(&receivers).into_iter().rev());
                continue;
            }
            let batch = self.batch(coverage, receivers)?;
            let outcome = match &mut self.traverser {
                Traverser::Classic(classic) => classic.cut(&self.hierarchy, region, &batch, constants, stats)?,
                Traverser::Feedback(feedback) => feedback.cut(&self.hierarchy, region, &batch, constants, stats)?,
            };
            match outcome {
                Outcome::Done => {
                    stats.batches += 1;
                    finish(self, &batch, stats)?;
                }
                Outcome::Overflowed => {
                    stats.splits += 1;
                    let parts = match &self.traverser {
                        // Its lists have grown; the batch is cut to their size when it comes up again.
                        Traverser::Classic(_) => vec![batch.receivers],
                        Traverser::Feedback(_) => coverage.split(&batch.receivers),
                    };
                    if parts.is_empty() {
                        return Err(Error::Limit(format!(
                            "the pairs of a single pixel do not fit {} of them; raise the memory budget",
                            self.plan.pairs
                        )));
                    }
                    ready.extend(parts.into_iter().rev());
                }
                Outcome::TooSmall { needed, capacity } => {
                    return Err(Error::Limit(format!(
                        "a pixel's cut has {needed} nodes, but there is room for {capacity}; raise the memory budget"
                    )));
                }
            }
        }
    }

    fn batch(&self, coverage: &Coverage, receivers: Vec<Receiver>) -> Result<Batch> {
        let entries = match &self.traverser {
            Traverser::Classic(_) => receivers.iter().flat_map(|r| coverage.pixels(*r)).collect(),
            Traverser::Feedback(_) => coverage.blocks(&receivers),
        };
        let entry_buffer = Buffer::from_slice(&self.context, "entries", &entries)?;
        Ok(Batch { receivers, entries, entry_buffer })
    }

    /// Micro-buffers and image of a batch, chunk by chunk: the passes after the traversal, in order.
    fn shade(
        &self,
        region: &Region,
        batch: &Batch,
        camera: &Camera,
        coverage_limit: f32,
        stats: &mut FrameStats,
        progress: &mut dyn FnMut(u64),
    ) -> Result<()> {
        let per_entry = self.raster_info.pixels_per_entry;
        let chunk = (self.micro_buffers.pixels / per_entry).max(1);
        let (raster_sets, convolve_set) = self.bind_shading(region, batch)?;
        let brightest = self.hierarchy.brightest.max(f32::MIN_POSITIVE);
        let total = batch.entries.len() as u32;
        let starts: Vec<u32> = (0..total).step_by(chunk as usize).collect();
        for group in starts.chunks(CHUNKS_PER_SUBMISSION) {
            let mut recorder = Recorder::new(&self.context)?;
            for first in group {
                let constants = Gather {
                    pixels: region.receivers.pixels,
                    first_entry: *first,
                    entry_count: chunk.min(total - first),
                    // Sums of 32 bits hold `coverage_limit` micro-pixels of the brightest colour, and one to spare.
                    color_scale: (4_294_967_296.0 / (f64::from(coverage_limit + 1.0) * f64::from(brightest))) as f32,
                    eye: camera.from.into(),
                    coverage_limit,
                    width: region.rect.width,
                    height: region.rect.height,
                    tiles_x: region.receivers.tiles_x,
                    material_parameter: self.settings.material.parameter(),
                    far_field_height: self.far_field.height,
                    store_columns: self.micro_buffers.columns(),
                };
                // Empty micro-buffers.
                self.micro_buffers.clear(&mut recorder, constants.entry_count * per_entry);
                // The cut's nodes in them.
                self.raster.record(&mut recorder, &raster_sets, constants)?;
                // Times the BRDF.
                self.convolve.record(&mut recorder, &convolve_set, constants)?;
            }
            recorder.finish(&mut stats.profile)?;
            let done = group.last().map_or(0, |first| (first + chunk).min(total));
            progress(u64::from(done) * u64::from(per_entry));
        }
        Ok(())
    }

    fn bind_shading(&self, region: &Region, batch: &Batch) -> Result<(Vec<DescriptorSet>, DescriptorSet)> {
        let nodes = region.receivers.bindings(self.hierarchy.bindings());
        let bindings = self
            .micro_buffers
            .bindings(region.lists.bindings(nodes))
            .buffer("Entries", &batch.entry_buffer)
            .buffer("RasterCounts", &self.raster_counts)
            .buffer("OutputImage", &region.output)
            .sampled("normal_map", &region.gbuffer.normal, self.nearest.handle)
            .sampled("base_metallic_map", &region.gbuffer.base_metallic, self.nearest.handle)
            .sampled("emissive_roughness_map", &region.gbuffer.emissive_roughness, self.nearest.handle);
        Ok((self.raster.bind(&bindings)?, self.convolve.bind(bindings, &self.far_field)?))
    }

    /// Reads a finished region into the frame.
    fn collect(&self, region: &Region, frame: &mut Frame) -> Result<()> {
        let pixels = region.rect.width as usize * region.rect.height as usize;
        let output: Vec<[f32; 4]> = region.output.download(pixels)?;
        let position: Vec<[f32; 4]> = read_image(&region.gbuffer.position)?;
        let normal: Vec<[f32; 4]> = read_image(&region.gbuffer.normal)?;
        let albedo: Vec<[half::f16; 4]> = read_image(&region.gbuffer.base_metallic)?;
        for i in 0..pixels {
            let at = region.rect.index(i as u32, frame.width);
            frame.rgba[at] = output[i];
            frame.position[at] = position[i];
            frame.normal[at] = normal[i];
            frame.albedo[at] = albedo[i].map(half::f16::to_f32);
        }
        Ok(())
    }
}

impl Rect {
    /// Index in an image of the given width of the rectangle's `i`th pixel.
    fn index(&self, i: u32, width: u32) -> usize {
        ((self.y + i / self.width) * width + self.x + i % self.width) as usize
    }
}

impl Region {
    /// Index in the image of a pixel slot.
    fn pixel_of(&self, slot: u32, width: u32) -> u32 {
        let (tile, code) = (slot / 256, slot % 256);
        let even_bits = |bits: u32| (0..4).map(|i| (bits >> (2 * i) & 1) << i).sum::<u32>();
        let x = self.rect.x + tile % self.receivers.tiles_x * 16 + even_bits(code);
        let y = self.rect.y + tile / self.receivers.tiles_x * 16 + even_bits(code >> 1);
        y * width + x
    }
}

fn read_image<T: bytemuck::Pod>(image: &crate::gpu::Image) -> Result<Vec<T>> {
    Ok(bytemuck::pod_collect_to_vec(&image.download(Use::SampledRead, size_of::<T>())?))
}

fn check(settings: &Settings) -> Result<()> {
    let Settings { width, height, microbuffer, .. } = *settings;
    if width == 0 || height == 0 {
        return Err(Error::Argument(format!("the image is {width} x {height}; both sides must be at least 1")));
    }
    if width > 32_768 || height > 32_768 {
        return Err(Error::Limit(format!("the image is {width} x {height}; a side has at most 32768 pixels")));
    }
    if !Settings::MICROBUFFER.contains(&microbuffer) || microbuffer % 2 == 1 {
        return Err(Error::Argument(format!("a micro-buffer of {microbuffer} is not an even size from 8 to 64")));
    }
    if !(settings.stop > 0.0 && settings.switch >= settings.stop) {
        return Err(Error::Argument(format!(
            "the thresholds are {} and {} micro-pixels; they must be positive and the second not below the first",
            settings.stop, settings.switch
        )));
    }
    Ok(())
}
