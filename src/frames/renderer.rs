//! Renders frames: regions of the image, batches of tiles, chunks of micro-buffers, each as large as the budget allows.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use ash::vk;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::batch::Coverage;
use super::feedback::Feedback;
use super::pixels::{PixelPasses, Shot, stop_sin2};
use super::plan::Plan;
use super::region::{Bounds, Region, read_image};
use super::scene::GpuScene;
use super::shared::Shared;
use super::tile_map::pixel_place;
use super::{Frame, FrameStats, MaterialChoice, Paper, Settings, Technique, feedback};
use crate::gpu::pipeline::Sampler;
use crate::gpu::{Bindings, Buffer, Context, Recorder, Use};
use crate::passes::bin::CutLists;
use crate::passes::convolve::{ConvolvePass, GpuFarField};
use crate::passes::gbuffer::{GBuffer, GBufferPass, Rect, View};
use crate::passes::rasterise::RasterInfo;
use crate::passes::receivers::{ReceiverPass, Receivers};
use crate::passes::trace::TracePass;
use crate::passes::{CutRules, GpuHierarchy, Receiver, Traversal, sin2_of_share};
use crate::preprocess::hierarchy::{Hierarchy, NodeRadiance};
use crate::scene::{Camera, FarField, Object, Vertex};
use crate::{Error, Result};

/// What one turn of the traversal works on.
pub(super) struct Batch {
    /// Where it starts.
    pub(super) receivers: Vec<Receiver>,
    /// Its covered pixels.
    pub(super) pixels: Vec<u32>,
    /// The same on the device.
    pub(super) entries: Buffer,
    /// GGX alphas of narrow lobes, by pixel.
    pub(super) alphas: Option<Buffer>,
}

/// How a batch's traversal ended.
pub(super) enum Outcome {
    /// The lists are complete.
    Done,
    /// Something did not fit; the batch is void.
    Overflowed,
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
    pub(super) settings: Settings,
    /// Image size that the plan is for.
    made_for: [u32; 2],
    plan: Plan,
    pub(super) hierarchy: Arc<GpuHierarchy>,
    bounds: Bounds,
    /// The object's vertices, for where it is in the image.
    positions: Vec<Vec3>,
    pub(super) far_field: Arc<GpuFarField>,
    gbuffer: GBufferPass,
    receivers: ReceiverPass,
    /// Technique `shared`, which leaves to the others what it cannot do.
    shared: Option<Shared>,
    /// None for classic, whose raster passes walk the hierarchy themselves.
    traverser: Option<Feedback>,
    /// Lights pixels one by one.
    pub(super) pixels: PixelPasses,
    /// Lights what narrow lobes reflect.
    lobes: Option<PixelPasses>,
    nearest: Sampler,
    /// Ends a frame early once it is true.
    stop: Option<Arc<AtomicBool>>,
}

/// Buffers of narrow lobes.
pub(super) const LOBE_INFO: RasterInfo =
    RasterInfo { size: 16, walk: true, paper: Paper::NONE, shared: false, lobe: true };

/// Sums of coverage that fixed-point sums hold before they run over, in micro-pixels.
const COVERAGE_LIMIT: f32 = 63.0;

impl Renderer {
    /// Larger images than this take no more memory, except for the image.
    pub const LARGEST_REGION: u32 = 1056;

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
        settings.check()?;
        let scene = GpuScene::new(context, hierarchy, far_field, settings.paper)?;
        Self::with_scene(context, &scene, object, settings)
    }

    /// As [`Renderer::new`], with a scene that is on the device already.
    ///
    /// # Errors
    /// As [`Renderer::new`], and [`Error::Argument`] where the scene was uploaded for other ways of the paper.
    pub fn with_scene(context: &Arc<Context>, scene: &GpuScene, object: &Object, settings: Settings) -> Result<Self> {
        settings.check()?;
        if scene.paper.one_node() != settings.paper.one_node() {
            return Err(Error::Argument("the scene was uploaded for other ways of the paper".into()));
        }
        let feedback = settings.technique != Technique::Classic;
        let hybrid = matches!(settings.technique, Technique::Hybrid | Technique::Shared);
        if let (true, Some(why)) = (feedback, context.why_no_feedback()) {
            return Err(Error::Device(why));
        }
        let (hierarchy, far_field) = (scene.hierarchy.clone(), scene.far_field.clone());
        let before = context.bytes_now();
        let gbuffer = GBufferPass::new(context, object)?;
        let info =
            RasterInfo { size: settings.microbuffer, walk: !feedback, paper: settings.paper, ..RasterInfo::default() };
        let (far, sharp) = (far_field.height > 0, settings.sharp_alpha() > 0.0);
        let pixel_convolve = ConvolvePass::new(context, info, settings.material, far, sharp)?;
        let scene_bytes = scene.bytes + context.bytes_now() - before;
        let bytes_per_pair = feedback::bytes_per_pair(hybrid);
        let plan = Plan::new(context, &settings, info, scene_bytes, bytes_per_pair)?;
        let rules = CutRules { paper: settings.paper, shared: false };
        let traverser = feedback.then(|| Feedback::new(context, hybrid, rules, &hierarchy, plan.pairs)).transpose()?;
        let shared = plan.tiles.map(|plan| Shared::new(context, &settings, &hierarchy, far, plan)).transpose()?;
        let image_pixels = settings.width.next_multiple_of(16) * settings.height.next_multiple_of(16);
        let pixels = PixelPasses::new(context, &settings, info, pixel_convolve, plan.micro_pixels.min(image_pixels))?;
        let lobes = sharp
            .then(|| {
                let convolve = ConvolvePass::new(context, LOBE_INFO, settings.material, far, sharp)?;
                PixelPasses::new(context, &settings, LOBE_INFO, convolve, plan.lobe_pixels.min(image_pixels))
            })
            .transpose()?;
        Ok(Self {
            context: context.clone(),
            positions: object.vertices.iter().map(|vertex| vertex.position).collect(),
            bounds: Bounds::of(&object.vertices),
            receivers: ReceiverPass::new(context)?,
            nearest: Sampler::new(context, vk::Filter::NEAREST, vk::SamplerAddressMode::CLAMP_TO_EDGE)?,
            made_for: [settings.width, settings.height],
            settings,
            plan,
            hierarchy,
            far_field,
            gbuffer,
            shared,
            traverser,
            pixels,
            lobes,
            stop: None,
        })
    }

    /// Moves the object: the same vertices, in their order, at other places of world space
    /// ([`Object::transformed_vertices`]).
    ///
    /// # Errors
    /// [`Error::Argument`] for another number of vertices; Vulkan's own errors.
    pub fn place(&mut self, vertices: &[Vertex]) -> Result<()> {
        if vertices.len() != self.positions.len() {
            return Err(Error::Argument("an object that moves keeps its vertices".into()));
        }
        self.gbuffer.place(vertices)?;
        self.positions.clear();
        self.positions.extend(vertices.iter().map(|vertex| vertex.position));
        self.bounds = Bounds::of(vertices);
        Ok(())
    }

    /// Changes the image's size, pixels; it may not grow beyond what the renderer was made for, unless that was
    /// [`Renderer::LARGEST_REGION`] or more along both sides. What it was made for also says how many tiles there are.
    ///
    /// # Errors
    /// [`Error::Argument`] for a size of zero, [`Error::Limit`] for one that is too large.
    pub fn resize(&mut self, width: u32, height: u32) -> Result<()> {
        Settings { width, height, ..self.settings }.check()?;
        let clip = |length: u32| length.min(Self::LARGEST_REGION);
        if clip(width) > clip(self.made_for[0]) || clip(height) > clip(self.made_for[1]) {
            let [most_width, most_height] = self.made_for;
            return Err(Error::Limit(format!(
                "the renderer was made for images of {most_width} x {most_height}, not {width} x {height}"
            )));
        }
        (self.settings.width, self.settings.height) = (width, height);
        Ok(())
    }

    /// Changes an albedo, which no pass depends on but through a constant; false where another renderer is needed, and
    /// nothing is changed then.
    pub fn set_material(&mut self, material: MaterialChoice) -> bool {
        let fits = material.same_passes(self.settings.material);
        if fits {
            self.settings.material = material;
        }
        fits
    }

    /// Puts another far field of the same size in the place of its own: the next frame of a stream of probes.
    ///
    /// # Errors
    /// [`Error::Argument`] for another size, or where it was made without.
    pub fn set_far_field(&mut self, far_field: &FarField) -> Result<()> {
        self.far_field.update(far_field)
    }

    /// Gives all nodes of the cloud other radiance, or that which they were made with ([`GpuScene::relight`]).
    ///
    /// # Errors
    /// [`Error::Argument`] for another number of nodes; Vulkan's own errors.
    pub fn relight(&self, hierarchy: &Hierarchy, radiance: Option<&NodeRadiance>) -> Result<()> {
        self.hierarchy.relight(hierarchy, radiance)
    }

    /// Settings of its frames.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Frames end with [`Error::Stopped`] soon after `stop` becomes true; never by themselves for `None`.
    pub fn stop_when(&mut self, stop: Option<Arc<AtomicBool>>) {
        self.stop = stop;
    }

    /// An error once the frame is to end.
    pub(super) fn check_stop(&self) -> Result<()> {
        match &self.stop {
            Some(stop) if stop.load(Ordering::Relaxed) => Err(Error::Stopped),
            _ => Ok(()),
        }
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
            let lobes = self.lobes.as_ref().map_or(Ok(false), |lobes| lobes.convolve.overflowed())?;
            match self.pixels.convolve.overflowed()? || lobes {
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

    /// Every [node, pixel] pair that a frame's raster passes cover something with, sorted: for tests and for looking at
    /// cuts.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn cut(&mut self, camera: &Camera) -> Result<Vec<CutPair>> {
        let trace = TracePass::new(&self.context, self.pixels.info, 512)?;
        let width = self.settings.width;
        let mut pairs = Vec::new();
        let mut stats = FrameStats::default();
        for rect in self.regions(camera) {
            let region = self.prepare_region(camera, rect, &mut stats)?;
            let coverage = Coverage(region.receivers.read_coverage()?);
            let tiles = coverage.tiles();
            self.each_batch(&region, &coverage, tiles, &mut stats, |renderer, batch, _| {
                let bindings = renderer.pixels.bindings(renderer.node_bindings(&region), batch);
                let shot = Shot { renderer, region: &region, camera, coverage_limit: COVERAGE_LIMIT };
                let total = batch.pixels.len() as u32;
                for first in (0..total).step_by(trace.chunk as usize) {
                    let count = trace.chunk.min(total - first);
                    let constants = shot.gather(renderer.settings.microbuffer, first, count);
                    let traced = trace.run(&bindings, constants)?;
                    let at = |slot| region.pixel_of(slot, width);
                    pairs.extend(traced.into_iter().map(|[slot, node]| CutPair { pixel: at(slot), node }));
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
        for rect in self.regions(camera) {
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
        let _span = self.context.trace.span("frame");
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
        self.pixels.reset_counts()?;
        if let Some(lobes) = &self.lobes {
            lobes.reset_counts()?;
        }
        for rect in self.regions(camera) {
            let started = Instant::now();
            let _span = self.context.trace.span("region");
            let region = self.prepare_region(camera, rect, &mut stats)?;
            let coverage = Coverage(region.receivers.read_coverage()?);
            let tiles: Vec<Receiver> = coverage.tiles().into_iter().filter(|tile| region.is_core(*tile)).collect();
            let covered = coverage.count(&tiles);
            let (done_before, total) = (stats.covered_pixels, stats.covered_pixels + covered);
            stats.covered_pixels = total;
            let left = match self.shared.take() {
                None => tiles.clone(),
                Some(mut shared) => {
                    let shot = Shot { renderer: self, region: &region, camera, coverage_limit };
                    let left = shared.light(shot, &coverage, &mut stats);
                    self.shared = Some(shared);
                    left?
                }
            };
            let rest = coverage.count(&left);
            stats.per_pixel += rest;
            let mut done = covered - rest;
            self.each_batch(&region, &coverage, left, &mut stats, |renderer, batch, stats| {
                let shot = Shot { renderer, region: &region, camera, coverage_limit };
                renderer.pixels.shade(shot, batch, stats, &mut |part| progress(done_before + done + part, total))?;
                done += coverage.count(&batch.receivers);
                Ok(())
            })?;
            if let Some(lobes) = &self.lobes {
                let span = self.context.trace.span("lobes");
                let batch = self.lobe_batch(&region, &coverage, &tiles)?;
                let shot = Shot { renderer: self, region: &region, camera, coverage_limit };
                stats.lobes += batch.pixels.len() as u64;
                span.count("pixels", batch.pixels.len() as u64);
                lobes.shade(shot, &batch, &mut stats, &mut |_| {})?;
            }
            wall += started.elapsed();
            let _span = self.context.trace.span("readback");
            region.collect(&mut frame)?;
        }
        self.pixels.report(&mut stats)?;
        if let Some(lobes) = &self.lobes {
            lobes.report(&mut stats)?;
        }
        stats.device_bytes_peak = self.context.bytes_peak();
        stats.wall_ms = wall.as_secs_f64() * 1e3;
        tracing::debug!("frame with readback took {:.1} ms", start.elapsed().as_secs_f64() * 1e3);
        frame.stats = stats;
        Ok(frame)
    }

    /// Rectangles that cover the part of the image that shows the object; their corners are those of tiles.
    fn regions(&self, camera: &Camera) -> Vec<Rect> {
        let [low, high] = self.shown(camera);
        let side = self.plan.region;
        let mut list = Vec::new();
        for y in (low[1]..high[1]).step_by(side as usize) {
            for x in (low[0]..high[0]).step_by(side as usize) {
                list.push(Rect { x, y, width: side.min(high[0] - x), height: side.min(high[1] - y) });
            }
        }
        list
    }

    /// Corners of the part of the image that shows the object: the first on a tile's corner, the second behind the last
    /// pixel.
    fn shown(&self, camera: &Camera) -> [[u32; 2]; 2] {
        let Settings { width, height, .. } = self.settings;
        if self.bounds.hold(camera) {
            return [[0; 2], [width, height]];
        }
        let (near, far) = self.bounds.depth_range(camera);
        let clip_from_world = camera.clip_from_world(width as f32 / height as f32, near, far);
        let nothing = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        let (low, high) = self
            .positions
            .par_iter()
            .fold(
                || nothing,
                |(low, high), position| {
                    let at = clip_from_world * position.extend(1.0);
                    let at = Vec2::new(at.x, at.y) / at.w;
                    (low.min(at), high.max(at))
                },
            )
            .reduce(|| nothing, |a, b| (a.0.min(b.0), a.1.max(b.1)));
        // A pixel more on each side, for rounding.
        let pixel =
            |v: f32, size: u32, more: f32| ((0.5 * v + 0.5) * size as f32 + more).clamp(0.0, size as f32) as u32;
        let corner = |v: Vec2, more: f32| [pixel(v.x, width, more), pixel(v.y, height, more)];
        [corner(low, -1.0).map(|v| v / 16 * 16), corner(high, 2.0)]
    }

    /// A rectangle and the tiles around it.
    fn with_neighbours(&self, core: Rect) -> Rect {
        let (x, y) = (core.x.saturating_sub(16), core.y.saturating_sub(16));
        let width = (core.x + core.width + 16).min(self.settings.width) - x;
        let height = (core.y + core.height + 16).min(self.settings.height) - y;
        Rect { x, y, width, height }
    }

    /// G-buffer and receivers of a region.
    fn prepare_region(&self, camera: &Camera, core: Rect, stats: &mut FrameStats) -> Result<Region> {
        let rect = if self.shared.is_some() { self.with_neighbours(core) } else { core };
        let receivers = Receivers::new(&self.context, rect.width, rect.height)?;
        let bytes = u64::from(rect.width) * u64::from(rect.height) * 16;
        let output = |name| Buffer::with_texels(&self.context, name, bytes, vk::Format::R32G32B32A32_SFLOAT);
        let region = Region {
            rect,
            core,
            gbuffer: GBuffer::new(&self.context, rect.width, rect.height)?,
            lists: CutLists::new(&self.context, receivers.pixels, self.plan.nodes())?,
            output: output("output")?,
            lobe_output: self.lobes.as_ref().map(|_| output("lobe output")).transpose()?,
            receivers,
        };
        let (near, far) = self.bounds.depth_range(camera);
        let view = View {
            width: self.settings.width,
            height: self.settings.height,
            region: rect,
            near,
            far,
            sharp_alpha: self.settings.sharp_alpha(),
        };
        let mut recorder = Recorder::new(&self.context)?;
        recorder.pass("clear output", |device, commands| {
            for output in [Some(&region.output), region.lobe_output.as_ref()].into_iter().flatten() {
                // SAFETY: the buffer is live and was made as a copy target.
                unsafe { device.cmd_fill_buffer(commands, output.handle, 0, vk::WHOLE_SIZE, 0) };
            }
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
        mut tiles: Vec<Receiver>,
        stats: &mut FrameStats,
        mut finish: impl FnMut(&mut Self, &Batch, &mut FrameStats) -> Result<()>,
    ) -> Result<()> {
        let switch = self.settings.switch / f64::from(self.settings.microbuffer * self.settings.microbuffer);
        let constants = Traversal {
            pixels: region.receivers.pixels,
            stop_sin2: self.stop_sin2(),
            switch_sin2: sin2_of_share(switch),
            capacity: 0,
            list_capacity: 0,
        };
        // Tiles that wait, the next one last, and batches that are ready because they were split.
        tiles.reverse();
        let mut ready: Vec<Vec<Receiver>> = Vec::new();
        loop {
            self.check_stop()?;
            let receivers = match ready.pop() {
                Some(batch) => batch,
                None if tiles.is_empty() => return Ok(()),
                None => {
                    let wanted = self.traverser.as_ref().map_or(tiles.len(), Feedback::batch_tiles);
                    let mut batch = tiles.split_off(tiles.len().saturating_sub(wanted));
                    batch.reverse();
                    batch
                }
            };
            let span = self.context.trace.span("batch");
            let batch = self.batch(coverage, receivers)?;
            span.count("receivers", batch.receivers.len() as u64);
            span.count("pixels", batch.pixels.len() as u64);
            let outcome = match &mut self.traverser {
                None => Outcome::Done,
                Some(traverser) => traverser.cut(&self.hierarchy, region, &batch.receivers, constants, stats)?,
            };
            match outcome {
                Outcome::Done => {
                    stats.batches += 1;
                    finish(self, &batch, stats)?;
                }
                Outcome::Overflowed => {
                    stats.splits += 1;
                    let parts = coverage.split(&batch.receivers);
                    if parts.is_empty() {
                        return Err(Error::Limit(format!(
                            "the pairs of a single pixel do not fit {} of them; raise the memory budget",
                            self.plan.pairs
                        )));
                    }
                    ready.extend(parts.into_iter().rev());
                }
            }
        }
    }

    fn batch(&self, coverage: &Coverage, receivers: Vec<Receiver>) -> Result<Batch> {
        let pixels: Vec<u32> = receivers.iter().flat_map(|r| coverage.pixels(*r)).collect();
        let entries = Buffer::from_slice(&self.context, "entries", &pixels)?;
        Ok(Batch { receivers, pixels, entries, alphas: None })
    }

    /// The pixels below `tiles` whose lobes are narrow enough for buffers of their own.
    fn lobe_batch(&self, region: &Region, coverage: &Coverage, tiles: &[Receiver]) -> Result<Batch> {
        // Where a roughness is below zero.
        let roughness: Option<Vec<[half::f16; 4]>> = match self.settings.material {
            MaterialChoice::File => Some(read_image(&region.gbuffer.emissive_roughness)?),
            _ => None,
        };
        let alpha_of = |pixel: u32| match &roughness {
            None => Some(self.settings.material.parameter()),
            Some(texels) => {
                let (x, y) = pixel_place(pixel, region.receivers.tiles_x);
                let roughness = texels[(y * region.rect.width + x) as usize][3].to_f32();
                (roughness < 0.0).then_some((roughness * roughness).max(1e-3))
            }
        };
        let (pixels, alphas): (Vec<u32>, Vec<f32>) = tiles
            .iter()
            .flat_map(|tile| coverage.pixels(*tile))
            .filter_map(|pixel| alpha_of(pixel).map(|alpha| (pixel, alpha)))
            .unzip();
        Ok(Batch {
            receivers: Vec::new(),
            entries: Buffer::from_slice(&self.context, "lobe entries", &pixels)?,
            alphas: Some(Buffer::texels_from_slice(&self.context, "lobe alphas", &alphas, vk::Format::R32_SFLOAT)?),
            pixels,
        })
    }

    /// Nodes, receivers and lists.
    pub(super) fn node_bindings<'a>(&'a self, region: &'a Region) -> Bindings<'a> {
        region.lists.bindings(region.receivers.bindings(self.hierarchy.bindings()))
    }

    fn stop_sin2(&self) -> f32 {
        stop_sin2(&self.settings, self.settings.microbuffer)
    }

    /// The G-buffer's materials and the output, of narrow lobes or of all else.
    pub(super) fn surface_bindings<'a>(&'a self, region: &'a Region, lobes: bool) -> Bindings<'a> {
        let output = region.lobe_output.as_ref().filter(|_| lobes).unwrap_or(&region.output);
        Bindings::new()
            .buffer("output_image", output)
            .sampled("normal_map", &region.gbuffer.normal, self.nearest.handle)
            .sampled("base_metallic_map", &region.gbuffer.base_metallic, self.nearest.handle)
            .sampled("emissive_roughness_map", &region.gbuffer.emissive_roughness, self.nearest.handle)
    }
}
