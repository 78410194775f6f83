//! A cloud in the light of lamps that are not in the scan: direct light and several bounces of it by virtual point lights
//! with imperfect shadow maps (Preiner 2010).

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use ash::vk;
use glam::Vec3;

use super::lamp_frames::take_silhouettes;
use super::points::{BUFFER_POINTS, PointDisplay, PointRenderer, PointSettings};
use super::region::Bounds;
use crate::gpu::{Buffer, Context, Profile, Recorder};
use crate::passes::convolve::MaterialChoice;
use crate::passes::gbuffer::{GBufferPass, Rect, View};
use crate::passes::ism::IsmPass;
use crate::passes::lamp_cloud::LampCloudPass;
use crate::passes::lamp_light::LampLightPass;
use crate::passes::lamp_object::{LampObjectPass, LampObjectTargets};
use crate::passes::lamp_view::{LampPass, LampView, LampViewPass};
use crate::passes::points::PointView;
use crate::passes::surfel_view::SurfelViewPass;
use crate::passes::vpl::{LitPoints, VplBuffers, VplPass};
use crate::preprocess::hierarchy::{Hierarchy, NodeRadiance};
use crate::preprocess::point_chunks::{PackedPoint, PackedSurfel, PointChunks, packed_leaves};
use crate::scene::{Camera, Lamp, Object, Vertex};
use crate::{Error, Result};

pub use super::lamp_frames::{LampFrame, LampSurface, ObjectLight, PointLight};
pub use super::lamp_settings::LampSettings;
pub use crate::scene::surfaces::{AlbedoFrom, Brush, Surfaces};

/// An object that stands in the lamps' light.
struct LitObject {
    gbuffer: GBufferPass,
    targets: LampObjectTargets,
    bounds: Bounds,
    material: MaterialChoice,
}

/// Where a picture's light is wanted.
#[derive(Clone, Copy)]
enum Wanted<'a> {
    /// At the pixels of a camera.
    Picture(&'a Camera),
    /// At the chosen points.
    Chosen,
}

/// Points on the device with their normals.
#[derive(Default)]
struct Chosen {
    buffers: Vec<(Buffer, Buffer)>,
    count: u32,
}

impl Chosen {
    fn points(&self) -> Vec<LitPoints<'_>> {
        let most = BUFFER_POINTS as u32;
        let part = |(index, (points, surfels))| {
            let base = index * most;
            LitPoints { points, surfels, base, count: most.min(self.count - base) }
        };
        (0..).zip(self.buffers.iter().map(|(points, surfels)| (points, surfels))).map(part).collect()
    }
}

/// A cloud on the device, ready to be lit.
pub struct LampRenderer {
    context: Arc<Context>,
    settings: LampSettings,
    /// The camera's view, whose memory has the points.
    camera: PointRenderer,
    /// One view of a lamp after the other.
    lamp: PointRenderer,
    surfels: Arc<Vec<Buffer>>,
    count: u32,
    /// Bounding sphere of the cloud.
    bounds: (Vec3, f32),
    /// Surface of the cloud, square metres.
    area: f32,
    /// Typical distance between its points, metres.
    spacing: f32,
    lights: VplBuffers,
    chosen: Arc<Chosen>,
    object: Option<LitObject>,
    passes: Option<Passes>,
    /// Lamps whose views are in the atlas.
    drawn: Option<Vec<Lamp>>,
    /// The first lights of these, and their maps, are in the buffers.
    mapped: bool,
    stop: Option<Arc<AtomicBool>>,
}

/// What depends on the number of views.
struct Passes {
    side: u32,
    lamp_surface: SurfelViewPass,
    camera_surface: SurfelViewPass,
    views: LampViewPass,
    ism: IsmPass,
    vpl: VplPass,
    light: LampLightPass,
    /// Where points were chosen.
    cloud: Option<LampCloudPass>,
    /// Where there is an object.
    object: Option<LampObjectPass>,
}

impl LampRenderer {
    /// Uploads the cloud and makes everything that pictures need.
    ///
    /// # Errors
    /// [`Error::Argument`] for settings that make no sense or a cloud without normals, [`Error::Limit`] where not all
    /// fits the budget or the device.
    pub fn new(context: &Arc<Context>, chunks: &Arc<PointChunks>, settings: LampSettings) -> Result<Self> {
        settings.check()?;
        settings.check_budget()?;
        let LampSettings { width, height, memory_budget, light_size, vpls, .. } = settings;
        if chunks.surfels.len() != chunks.points.len() {
            return Err(Error::Argument("lamps need a cloud with normals, and this one has none".into()));
        }
        let memory_budget = memory_budget - settings.bytes();
        let points = PointSettings {
            width,
            height,
            memory_budget,
            most_points: settings.most_points,
            ..PointSettings::default()
        };
        let camera = PointRenderer::new(context, chunks, points)?;
        if camera.resident_buffers().is_none() {
            return Err(Error::Limit(format!(
                "{} points do not fit a memory budget of {} MiB, and lamps need all of them at once",
                chunks.points.len(),
                settings.memory_budget >> 20
            )));
        }
        let lamp = camera.beside(light_size, light_size)?;
        let surfels = if chunks.surfels.is_empty() {
            vec![Buffer::with_texels(context, "surfels", 16, vk::Format::R32G32_UINT)?]
        } else {
            let upload = |part: &[_]| Buffer::texels_from_slice(context, "surfels", part, vk::Format::R32G32_UINT);
            chunks.surfels.chunks(BUFFER_POINTS).map(upload).collect::<Result<_>>()?
        };
        let bounds =
            chunks.bounds().map_or((Vec3::ZERO, 1.0), |(low, high)| (0.5 * (low + high), 0.5 * (high - low).length()));
        let area = chunks.surfels.iter().map(|surfel| f64::from(f32::from_bits(surfel[1])).powi(2)).sum::<f64>() as f32;
        let lights = VplBuffers::new(context, vpls)?;
        Ok(Self {
            context: context.clone(),
            settings,
            camera,
            lamp,
            surfels: Arc::new(surfels),
            count: chunks.points.len() as u32,
            bounds,
            area,
            spacing: chunks.spacing,
            lights,
            chosen: Arc::default(),
            object: None,
            passes: None,
            drawn: None,
            mapped: false,
            stop: None,
        })
    }

    /// Lights the same points, the chosen ones too, with other settings and no object, from the
    /// same memory.
    ///
    /// # Errors
    /// As [`LampRenderer::new`].
    pub fn beside(&self, settings: LampSettings) -> Result<Self> {
        settings.check()?;
        settings.check_budget()?;
        let mut camera = self.camera.beside(settings.width, settings.height)?;
        camera.show(PointDisplay::default(), settings.most_points);
        let lamp = camera.beside(settings.light_size, settings.light_size)?;
        Ok(Self {
            context: self.context.clone(),
            lights: VplBuffers::new(&self.context, settings.vpls)?,
            settings,
            camera,
            lamp,
            surfels: self.surfels.clone(),
            chosen: self.chosen.clone(),
            object: None,
            passes: None,
            drawn: None,
            mapped: false,
            stop: None,
            ..*self
        })
    }

    /// Settings of its pictures.
    pub fn settings(&self) -> &LampSettings {
        &self.settings
    }

    /// Pictures and light end with [`Error::Stopped`] soon after `stop` becomes true; never by themselves for `None`.
    pub fn stop_when(&mut self, stop: Option<Arc<AtomicBool>>) {
        self.stop = stop;
    }

    fn check_stop(&self) -> Result<()> {
        match &self.stop {
            Some(stop) if stop.load(Ordering::Relaxed) => Err(Error::Stopped),
            _ => Ok(()),
        }
    }

    /// Renders pictures of another size from now on.
    ///
    /// # Errors
    /// [`Error::Argument`] for a size without pixels, [`Error::Limit`] where it does not fit the budget or the device.
    pub fn resize(&mut self, width: u32, height: u32) -> Result<()> {
        if (width, height) == (self.settings.width, self.settings.height) {
            return Ok(());
        }
        let settings = LampSettings { width, height, ..self.settings.clone() };
        settings.check_budget()?;
        self.camera.resize(width, height)?;
        self.settings = settings;
        // A picture of the old size is of no use where the new one does not fit.
        let Some(mut passes) = self.passes.take() else { return Ok(()) };
        let points = self.lit_points();
        passes.camera_surface.bind(self.camera.images(), &points)?;
        passes.light.bind((&passes.camera_surface, width, height), &self.lights, (&passes.views, &passes.ism))?;
        if let Some(object) = self.object.as_mut().filter(|object| !object.targets.hold(region(&self.settings))) {
            let size = region(&self.settings);
            object.targets = LampObjectTargets::new(&self.context, self.settings.light_size, size)?;
            let pass = LampObjectPass::new(&self.context, &passes.views, &object.targets, object.material)?;
            passes.object = Some(pass);
        }
        self.passes = Some(passes);
        Ok(())
    }

    /// Puts an object, in world space, into the light, or takes it away: it casts shadows, and
    /// [`LampRenderer::light_object`] lights it.
    ///
    /// # Errors
    /// When it does not fit the device.
    pub fn set_object(&mut self, object: Option<(&Object, MaterialChoice)>) -> Result<()> {
        (self.passes, self.object) = (None, None);
        let Some((object, material)) = object else { return Ok(()) };
        self.object = Some(LitObject {
            gbuffer: GBufferPass::new(&self.context, object)?,
            targets: LampObjectTargets::new(&self.context, self.settings.light_size, region(&self.settings))?,
            bounds: Bounds::of(&object.vertices),
            material,
        });
        Ok(())
    }

    /// Moves the object: the same vertices, in their order, at other places of world space.
    ///
    /// # Errors
    /// [`Error::Argument`] for another number of vertices or without an object; Vulkan's own errors.
    pub fn place_object(&mut self, vertices: &[Vertex]) -> Result<()> {
        let Some(object) = &mut self.object else {
            return Err(Error::Argument("there is no object in the lamps' light".into()));
        };
        object.gbuffer.place(vertices)?;
        object.bounds = Bounds::of(vertices);
        self.drawn = None;
        Ok(())
    }

    /// Makes the object of something else.
    ///
    /// # Errors
    /// When a pipeline for it cannot be made.
    pub fn set_material(&mut self, material: MaterialChoice) -> Result<()> {
        let Some(object) = self.object.as_mut().filter(|object| object.material != material) else { return Ok(()) };
        object.material = material;
        let Some(passes) = &mut self.passes else { return Ok(()) };
        if !passes.object.as_mut().is_some_and(|pass| pass.set_material(material)) {
            passes.object = Some(LampObjectPass::new(&self.context, &passes.views, &object.targets, material)?);
        }
        Ok(())
    }

    /// Light that comes to the object straight from the lamps, past the cloud and the object's own parts, as the camera
    /// sees it. What the cloud reflects on it is not among it ([`LampRenderer::relight`]).
    ///
    /// # Errors
    /// [`Error::Limit`] for more lamps than fit, and Vulkan's own errors.
    pub fn light_object(&mut self, camera: &Camera, lamps: &[Lamp]) -> Result<ObjectLight> {
        let start = Instant::now();
        let mut profile = Profile::default();
        let pass = self.draw_views(lamps, &mut profile)?;
        let LampSettings { width, height, .. } = self.settings;
        let mut radiance = vec![[0.0; 4]; width as usize * height as usize];
        let passes = self.passes.as_ref().and_then(|passes| passes.object.as_ref());
        let (Some(object), Some(light)) = (&self.object, passes) else { return Ok(ObjectLight::default()) };
        let pass = pass.seen_by(camera, width, height);
        let (near, far) = object.bounds.depth_range(camera);
        let size = region(&self.settings);
        for y in (0..height).step_by(OBJECT_REGION as usize) {
            for x in (0..width).step_by(OBJECT_REGION as usize) {
                let region = Rect { x, y, width: size.0, height: size.1 };
                let view = View { width, height, region, near, far, sharp_alpha: 0.0 };
                let mut recorder = Recorder::new(&self.context)?;
                object.gbuffer.record(&mut recorder, &object.targets.camera, camera, view);
                light.shade(&mut recorder, pass, region)?;
                recorder.finish(&mut profile)?;
                for (row, part) in (y..height).zip(light.radiance(region)?.chunks(size.0 as usize)) {
                    let (first, count) = ((row * width + x) as usize, size.0.min(width - x) as usize);
                    radiance[first..first + count].copy_from_slice(&part[..count]);
                }
            }
        }
        Ok(ObjectLight { radiance, profile, wall_ms: start.elapsed().as_secs_f64() * 1e3 })
    }

    /// Chooses the points that [`LampRenderer::light`] lights: those of the cloud, or means of them, with their normals.
    ///
    /// # Errors
    /// [`Error::Argument`] for other numbers of surfels than of points, [`Error::Limit`] where they do not fit the device.
    pub fn choose(&mut self, points: &[PackedPoint], surfels: &[PackedSurfel]) -> Result<()> {
        if points.len() != surfels.len() || u32::try_from(points.len()).is_err() {
            return Err(Error::Argument(format!("{} points to light with {} normals", points.len(), surfels.len())));
        }
        self.passes = None;
        let mut chosen = Chosen { count: points.len() as u32, ..Chosen::default() };
        for (points, surfels) in points.chunks(BUFFER_POINTS).zip(surfels.chunks(BUFFER_POINTS)) {
            let texels = Buffer::texels_from_slice(&self.context, "lit points", points, vk::Format::R32G32B32A32_UINT)?;
            let normals = Buffer::texels_from_slice(&self.context, "lit surfels", surfels, vk::Format::R32G32_UINT)?;
            chosen.buffers.push((texels, normals));
        }
        self.chosen = Arc::new(chosen);
        Ok(())
    }

    /// Chooses the leaves of a hierarchy over the cloud.
    ///
    /// # Errors
    /// [`Error::Limit`] where they do not fit the device.
    pub fn choose_leaves(&mut self, hierarchy: &Hierarchy) -> Result<()> {
        let (points, surfels) = packed_leaves(hierarchy);
        self.choose(&points, &surfels)
    }

    /// The radiance of all nodes of the hierarchy whose leaves were chosen, where `share` of the cloud's own light is left
    /// and the lamps' is added; and what the light of the leaves took.
    ///
    /// # Errors
    /// [`Error::Argument`] for another hierarchy, [`Error::Limit`] for more lamps than fit, and Vulkan's own errors.
    pub fn relight(&mut self, hierarchy: &Hierarchy, lamps: &[Lamp], share: f32) -> Result<(NodeRadiance, PointLight)> {
        let light = self.light(lamps)?;
        Ok((hierarchy.refit(share, &light.radiance)?, light))
    }

    /// Lights the chosen points.
    ///
    /// # Errors
    /// [`Error::Limit`] for more lamps than fit, and Vulkan's own errors.
    pub fn light(&mut self, lamps: &[Lamp]) -> Result<PointLight> {
        let start = Instant::now();
        let mut profile = Profile::default();
        self.draw(Wanted::Chosen, lamps, &mut profile)?;
        let cloud = self.passes.as_ref().and_then(|passes| passes.cloud.as_ref());
        let radiance = cloud.map_or(Ok(Vec::new()), |cloud| cloud.radiance(&self.chosen.points()))?;
        let radiance = radiance.into_iter().map(|[r, g, b, _]| Vec3::new(r, g, b)).collect();
        Ok(PointLight { radiance, profile, wall_ms: start.elapsed().as_secs_f64() * 1e3 })
    }

    /// Renders a picture in the light of these lamps.
    ///
    /// # Errors
    /// [`Error::Limit`] for more lamps than fit, and Vulkan's own errors.
    pub fn render(&mut self, camera: &Camera, lamps: &[Lamp]) -> Result<LampFrame> {
        let start = Instant::now();
        let mut profile = Profile::default();
        self.draw(Wanted::Picture(camera), lamps, &mut profile)?;
        let LampSettings { width, height, .. } = self.settings;
        let pixels = width as usize * height as usize;
        let (color_depth, own) = match &self.passes {
            Some(Passes { light, camera_surface, .. }) => {
                (light.images.lit.download(pixels)?, camera_surface.surface().download(pixels)?)
            }
            None => Default::default(),
        };
        let wall_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(LampFrame { width, height, color_depth, own, profile, wall_ms })
    }

    /// What the last picture shows.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn surface(&self) -> Result<LampSurface> {
        let pixels = self.settings.width as usize * self.settings.height as usize;
        let Some(passes) = &self.passes else { return Ok(LampSurface::default()) };
        let mut color_depth: Vec<[f32; 4]> = self.camera.images().shaded.download(pixels)?;
        take_silhouettes(&mut color_depth, &passes.camera_surface.surface().download::<[f32; 4]>(pixels)?);
        Ok(LampSurface { color_depth, normal: passes.camera_surface.normals().download(pixels)? })
    }

    /// Irradiance of the last picture, straight from the lamps and after all bounces, a pixel.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn irradiance(&self) -> Result<[Vec<[f32; 4]>; 2]> {
        let pixels = self.settings.width as usize * self.settings.height as usize;
        let Some(passes) = &self.passes else { return Ok([Vec::new(), Vec::new()]) };
        Ok([passes.light.images.direct.download(pixels)?, passes.light.images.bounced.download(pixels)?])
    }

    /// The light G-buffers, unless they are there, and where they are important (4.1, 4.2); and what all passes have in
    /// common.
    fn draw_views(&mut self, lamps: &[Lamp], profile: &mut Profile) -> Result<LampPass> {
        let LampSettings { vpls, light_size, ism_size, ism_points, interleave, .. } = self.settings;
        let views: Vec<LampView> =
            lamps.iter().flat_map(|lamp| LampView::of_lamp(lamp, self.bounds, light_size)).collect();
        self.prepare(views.len())?;
        let Some(passes) = &self.passes else { return Ok(LampPass::default()) };
        let pass = LampPass {
            vpls,
            views: views.len() as u32,
            light_size,
            side: passes.side,
            ism_size,
            interleave,
            points: self.count,
            spread: (vpls as f32 / rounds(self.count, vpls, ism_points) as f32).sqrt(),
            ..LampPass::default()
        };
        if self.drawn.as_deref() == Some(lamps) {
            return Ok(pass);
        }
        (self.drawn, self.mapped) = (None, false);
        passes.views.set_up(&views, self.settings.materials(), self.area / vpls as f32, light_size)?;
        let mut recorder = Recorder::new(&self.context)?;
        passes.views.clear(&mut recorder);
        recorder.finish(profile)?;
        for (view, number) in views.iter().zip(0..) {
            self.check_stop()?;
            self.lamp.draw(&view.camera, profile)?;
            let mut recorder = Recorder::new(&self.context)?;
            let seen = PointView::new(&view.camera, light_size, light_size, self.spacing);
            let pass = LampPass { view: number, ..pass };
            passes.lamp_surface.record(&mut recorder, (&self.lit_points(), self.share()), seen)?;
            passes.views.copy(&mut recorder, pass)?;
            if let (Some(object), Some(lit)) = (&self.object, &passes.object) {
                let region = Rect { x: 0, y: 0, width: light_size, height: light_size };
                let (near, far) = object.bounds.depth_range(&view.camera);
                let seen = View { width: light_size, height: light_size, region, near, far, sharp_alpha: 0.0 };
                object.gbuffer.record(&mut recorder, &object.targets.lamp, &view.camera, seen);
                lit.occlude(&mut recorder, pass)?;
            }
            recorder.finish(profile)?;
        }
        let mut recorder = Recorder::new(&self.context)?;
        passes.views.pyramid(&mut recorder, pass)?;
        recorder.finish(profile)?;
        self.drawn = Some(lamps.to_vec());
        Ok(pass)
    }

    /// All passes of a picture.
    fn draw(&mut self, wanted: Wanted<'_>, lamps: &[Lamp], profile: &mut Profile) -> Result<()> {
        let common = self.draw_views(lamps, profile)?;
        let LampSettings { width, height, bounces, vpls, ism_points, .. } = self.settings;
        let rounds = rounds(self.count, vpls, ism_points);
        // Of more bounces than one the buffers have the last lights only.
        let known = self.mapped && bounces <= 1;
        let Some(passes) = &self.passes else { return Ok(()) };
        let pass = match wanted {
            Wanted::Picture(camera) => common.seen_by(camera, width, height),
            Wanted::Chosen => common,
        };
        // The camera G-buffer (4.1) and direct light.
        if let Wanted::Picture(camera) = wanted {
            self.camera.draw(camera, profile)?;
        }
        let (points, chosen) = (self.lit_points(), self.chosen.points());
        let mut recorder = Recorder::new(&self.context)?;
        match (wanted, &passes.cloud) {
            (Wanted::Picture(camera), _) => {
                let seen = PointView::new(camera, width, height, self.spacing);
                passes.camera_surface.record(&mut recorder, (&points, self.share()), seen)?;
                passes.light.direct(&mut recorder, pass)?;
            }
            (Wanted::Chosen, Some(cloud)) => cloud.direct(&mut recorder, &chosen, pass)?,
            (Wanted::Chosen, None) => {}
        }
        // The first lights (4.2), and bounce by bounce their maps (4.3), their light (4.4) and the next (4.5).
        if !known {
            passes.vpl.place(&mut recorder, pass)?;
        }
        for bounce in 0..bounces {
            let (pass, now) = (LampPass { bounce, ..pass }, (bounce % 2) as usize);
            if !known {
                passes.ism.record(&mut recorder, &points, (pass, rounds), now)?;
            }
            match (wanted, &passes.cloud) {
                (Wanted::Picture(_), _) => passes.light.gather(&mut recorder, pass, now)?,
                (Wanted::Chosen, Some(cloud)) => cloud.gather(&mut recorder, &chosen, pass, now)?,
                (Wanted::Chosen, None) => {}
            }
            if bounce + 1 < bounces {
                passes.vpl.redistribute(&mut recorder, &points, (pass, rounds), now)?;
            }
            recorder.finish(profile)?;
            self.check_stop()?;
            recorder = Recorder::new(&self.context)?;
        }
        if let Wanted::Picture(_) = wanted {
            passes.light.compose(&mut recorder, pass)?;
        }
        recorder.finish(profile)?;
        self.mapped = true;
        Ok(())
    }

    /// Makes what the number of views asks for, unless it is there.
    fn prepare(&mut self, views: usize) -> Result<()> {
        if views > LampSettings::MOST_VIEWS {
            let most = LampSettings::MOST_VIEWS;
            return Err(Error::Limit(format!("lamps with {views} views; at most {most}, of which a point takes six")));
        }
        let side = (views.max(1) as f64).sqrt().ceil() as u32;
        let side = side.next_power_of_two();
        if self.passes.as_ref().is_some_and(|passes| passes.side == side) {
            return Ok(());
        }
        (self.passes, self.drawn) = (None, None);
        let LampSettings { vpls, light_size, ism_size, ism_fill, .. } = self.settings;
        let (context, lights, glossy) = (&self.context, &self.lights, self.settings.glossy());
        let points = self.lit_points();
        let lamp_surface = SurfelViewPass::new(context, self.lamp.images(), &points)?;
        let camera_surface = SurfelViewPass::new(context, self.camera.images(), &points)?;
        let views = LampViewPass::new(context, &lamp_surface, light_size, side)?;
        let ism = IsmPass::new(context, lights, &views, &points, (vpls, ism_size, ism_fill))?;
        let vpl = VplPass::new(context, (lights, vpls), (&views, &ism), &points, glossy)?;
        let LampSettings { width, height, .. } = self.settings;
        let surface = (&camera_surface, width, height);
        let light = LampLightPass::new(context, surface, lights, (&views, &ism), glossy)?;
        let chosen = self.chosen.points();
        let cloud = (!chosen.is_empty())
            .then(|| LampCloudPass::new(context, &chosen, lights, (&views, &ism), glossy))
            .transpose()?;
        let object = |object: &LitObject| LampObjectPass::new(context, &views, &object.targets, object.material);
        let object = self.object.as_ref().map(object).transpose()?;
        self.passes = Some(Passes { side, lamp_surface, camera_surface, views, ism, vpl, light, cloud, object });
        Ok(())
    }

    /// Share of the points that views are made of.
    fn share(&self) -> f32 {
        self.settings.most_points.map_or(1.0, |most| (most as f32 / self.count.max(1) as f32).min(1.0))
    }

    /// The points with their normals, by buffer.
    fn lit_points(&self) -> Vec<LitPoints<'_>> {
        let buffers = self.camera.resident_buffers().unwrap_or_default();
        let most = BUFFER_POINTS as u32;
        let part = |(index, (points, surfels)): (u32, (_, _))| {
            let points: &crate::passes::points::PointBuffer = points;
            let base = index * most;
            LitPoints { points: points.buffer(), surfels, base, count: most.min(self.count - base) }
        };
        (0..).zip(buffers.iter().zip(self.surfels.iter())).map(part).collect()
    }
}

/// Largest side of the parts of the camera's image that an object is lit in, pixels.
const OBJECT_REGION: u32 = 1024;

/// Size of the parts that an object is lit in.
fn region(settings: &LampSettings) -> (u32, u32) {
    (settings.width.min(OBJECT_REGION), settings.height.min(OBJECT_REGION))
}

/// Rounds of all points over all maps that give every map enough of them; more than a few are no gain.
fn rounds(points: u32, maps: u32, wanted: u32) -> u32 {
    const MOST: u64 = 16;
    let all = u64::from(maps) * u64::from(wanted);
    all.div_ceil(u64::from(points.max(1))).clamp(1, MOST) as u32
}
