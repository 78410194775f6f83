//! Technique `probes`: an object lit by a sequence of light probes, through spherical harmonics and precomputed radiance
//! transfer (Hajisharif et al. 2012).

use std::sync::Arc;
use std::time::Instant;

use ash::vk;
use glam::{Affine3A, DMat3, Vec3};

use super::region::{Bounds, read_image};
use super::{Frame, FrameStats, MaterialChoice, Settings};
use crate::gpu::pipeline::DescriptorSet;
use crate::gpu::{Buffer, Context, Profile, Recorder};
use crate::passes::gbuffer::{self, GBuffer, Rect, View};
use crate::passes::probe_light::ProbeLight;
use crate::passes::probe_object::ProbeObject;
use crate::preprocess::transfer::Transfer;
use crate::scene::{Camera, FarField, Object, Vertex};
use crate::{Error, Result};

pub use crate::passes::probe_light::Projection;
pub use crate::passes::probe_object::Reflection;

/// Everything that frames depend on besides object, probes and camera.
#[derive(Clone, Copy, Debug)]
pub struct ProbeSettings {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// How probes are projected.
    pub projection: Projection,
    /// Alpha of the temporal filter (Eq. 13); 0 for none.
    pub temporal: f32,
    /// What the object is made of.
    pub material: MaterialChoice,
    /// What it mirrors.
    pub reflection: Reflection,
    /// Most bytes of device objects at once.
    pub memory_budget: u64,
}

impl Default for ProbeSettings {
    fn default() -> Self {
        let Settings { width, height, material, memory_budget, .. } = Settings::default();
        Self {
            width,
            height,
            projection: Projection::default(),
            temporal: 0.0,
            material,
            reflection: Reflection::default(),
            memory_budget,
        }
    }
}

/// Bytes that a pixel of a region takes: G-buffer, image, and what is read of them at once.
const BYTES_PER_PIXEL: u64 = gbuffer::BYTES_PER_PIXEL + gbuffer::IRRADIANCE_BYTES_PER_PIXEL + 16 + 16;
/// Smallest region: a strip of an image of the largest width.
const LEAST_PIXELS: u64 = 1 << 16;

/// An object, its transfer and the current probe on the device.
pub struct ProbeRenderer {
    context: Arc<Context>,
    settings: ProbeSettings,
    light: ProbeLight,
    object: ProbeObject,
    bounds: Bounds,
    vertices: usize,
    /// Images of a region, kept from frame to frame.
    target: Option<Target>,
    /// The probe or the object's axes have changed since the irradiance of the vertices was computed.
    stale: bool,
}

struct Target {
    width: u32,
    height: u32,
    gbuffer: GBuffer,
    output: Buffer,
}

impl ProbeRenderer {
    /// Uploads an object, which is in world space; its transfer is that of its own space, out of which
    /// `world_from_object` brought it by rotation, even scale and translation. Without a transfer nothing hides the probe.
    ///
    /// # Errors
    /// [`Error::Argument`] for settings that make no sense and for another object's transfer, [`Error::Limit`] where
    /// something does not fit the device.
    pub fn new(
        context: &Arc<Context>,
        object: &Object,
        world_from_object: Affine3A,
        transfer: Option<&Transfer>,
        settings: ProbeSettings,
    ) -> Result<Self> {
        check(&settings)?;
        let levels = settings.reflection.needs_levels(settings.material);
        let light = ProbeLight::new(context, settings.projection, levels)?;
        let surface = (settings.material, settings.reflection);
        let lit = ProbeObject::new(context, object, transfer, &light, surface)?;
        lit.turn(axes(world_from_object))?;
        Ok(Self {
            context: context.clone(),
            settings,
            light,
            object: lit,
            bounds: Bounds::of(&object.vertices),
            vertices: object.vertices.len(),
            target: None,
            stale: true,
        })
    }

    /// Settings of its frames.
    pub fn settings(&self) -> &ProbeSettings {
        &self.settings
    }

    /// Moves the object: the same vertices, in their order, at other places of world space.
    ///
    /// # Errors
    /// [`Error::Argument`] for another number of vertices; Vulkan's own errors.
    pub fn place(&mut self, vertices: &[Vertex], world_from_object: Affine3A) -> Result<()> {
        if vertices.len() != self.vertices {
            return Err(Error::Argument("an object that moves keeps its vertices".into()));
        }
        self.object.place(vertices, axes(world_from_object))?;
        self.bounds = Bounds::of(vertices);
        self.stale = true;
        Ok(())
    }

    /// Changes the image's size, pixels.
    ///
    /// # Errors
    /// [`Error::Argument`] for a size of zero, [`Error::Limit`] for one that is too large.
    pub fn resize(&mut self, width: u32, height: u32) -> Result<()> {
        let settings = ProbeSettings { width, height, ..self.settings };
        check(&settings)?;
        self.settings = settings;
        Ok(())
    }

    /// Changes an albedo; false, and nothing changes, where another renderer is needed.
    pub fn set_material(&mut self, material: MaterialChoice) -> bool {
        let fits = self.object.set_material(material);
        if fits {
            self.settings.material = material;
        }
        fits
    }

    /// Lights the object by the next probe of the sequence from now on.
    ///
    /// # Errors
    /// Vulkan's own errors.
    pub fn light(&mut self, probe: &FarField, profile: &mut Profile) -> Result<()> {
        let _span = self.context.trace.span("probe");
        self.light.set(probe, self.settings.temporal, profile)?;
        self.stale = true;
        Ok(())
    }

    /// The light's coefficients, in the order of [`crate::scene::harmonics`].
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn coefficients(&self) -> Result<Vec<Vec3>> {
        self.light.coefficients()
    }

    /// Width and height of what was projected; none before the first probe.
    pub fn projected_size(&self) -> Option<[u32; 2]> {
        self.light.projected_size()
    }

    /// Renders a frame.
    ///
    /// # Errors
    /// [`Error::Argument`] before the first probe, [`Error::Limit`] where the budget is too small; Vulkan's own errors.
    pub fn render(&mut self, camera: &Camera) -> Result<Frame> {
        let start = Instant::now();
        let _span = self.context.trace.span("frame");
        let ProbeSettings { width, height, .. } = self.settings;
        let count = width as usize * height as usize;
        let mut frame = Frame {
            width,
            height,
            rgba: Vec::with_capacity(count),
            position: Vec::with_capacity(count),
            normal: Vec::with_capacity(count),
            albedo: Vec::with_capacity(count),
            stats: FrameStats::default(),
        };
        let rows = self.rows()?;
        for y in (0..height).step_by(rows as usize) {
            let region = Rect { x: 0, y, width, height: rows.min(height - y) };
            self.render_region(camera, region, &mut frame)?;
        }
        frame.stats.covered_pixels = frame.rgba.iter().filter(|pixel| pixel[3] > 0.0).count() as u64;
        frame.stats.device_bytes_peak = self.context.bytes_peak();
        frame.stats.wall_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(frame)
    }

    /// Rows of the image that fit the budget at once.
    fn rows(&self) -> Result<u32> {
        let ProbeSettings { width, height, memory_budget, .. } = self.settings;
        let kept = self
            .target
            .as_ref()
            .map_or(0, |target| u64::from(target.width) * u64::from(target.height) * (BYTES_PER_PIXEL - 16));
        let others = self.context.bytes_now().saturating_sub(kept);
        let least = others + LEAST_PIXELS.min(u64::from(width) * u64::from(height)) * BYTES_PER_PIXEL;
        if least > memory_budget {
            return Err(Error::Limit(format!(
                "a memory budget of {} MiB is too small for probes at {width}x{height}: they need about {} MiB",
                memory_budget >> 20,
                least.div_ceil(1 << 20)
            )));
        }
        let pixels = (memory_budget - others) / BYTES_PER_PIXEL;
        Ok((pixels / u64::from(width)).clamp(1, u64::from(height)) as u32)
    }

    /// One strip of the image, added to the frame.
    fn render_region(&mut self, camera: &Camera, region: Rect, frame: &mut Frame) -> Result<()> {
        let fits = |target: &Target| target.width == region.width && target.height == region.height;
        if !self.target.as_ref().is_some_and(fits) {
            // Memory of the old images is free before the new ones take theirs.
            self.target = None;
        }
        let target = match self.target.take() {
            Some(target) => target,
            None => self.new_target(region)?,
        };
        let set = self.object.bind(&self.light, &target.gbuffer, &target.output)?;
        let result = self.record_region(camera, region, &target, &set, frame);
        self.target = Some(target);
        result
    }

    fn new_target(&self, region: Rect) -> Result<Target> {
        let Rect { width, height, .. } = region;
        let bytes = u64::from(width) * u64::from(height) * 16;
        let format = vk::Format::R32G32B32A32_SFLOAT;
        Ok(Target {
            width,
            height,
            gbuffer: GBuffer::with_irradiance(&self.context, width, height)?,
            output: Buffer::with_texels(&self.context, "output", bytes, format)?,
        })
    }

    fn record_region(
        &mut self,
        camera: &Camera,
        region: Rect,
        target: &Target,
        set: &DescriptorSet,
        frame: &mut Frame,
    ) -> Result<()> {
        let (near, far) = self.bounds.depth_range(camera);
        let ProbeSettings { width, height, .. } = self.settings;
        let view = View { width, height, region, near, far, sharp_alpha: 0.0 };
        let mut recorder = Recorder::new(&self.context)?;
        if self.stale {
            // What the vertices get of the probe (Eq. 14).
            self.object.record_light(&mut recorder)?;
        }
        // What the camera sees of the object, and what that reflects.
        self.object.record(&mut recorder, &target.gbuffer, set, camera, view)?;
        recorder.finish(&mut frame.stats.profile)?;
        self.stale = false;
        let _span = self.context.trace.span("readback");
        let pixels = region.width as usize * region.height as usize;
        frame.rgba.extend(target.output.download::<[f32; 4]>(pixels)?);
        frame.position.extend(read_image::<[f32; 4]>(&target.gbuffer.position)?);
        frame.normal.extend(read_image::<[f32; 4]>(&target.gbuffer.normal)?);
        let albedo: Vec<[half::f16; 4]> = read_image(&target.gbuffer.base_metallic)?;
        frame.albedo.extend(albedo.into_iter().map(|texel| texel.map(half::f16::to_f32)));
        Ok(())
    }
}

/// The rotation of a transform that also scales evenly.
fn axes(transform: Affine3A) -> DMat3 {
    let matrix = glam::Mat3::from(transform.matrix3).as_dmat3();
    DMat3::from_cols(matrix.x_axis.normalize(), matrix.y_axis.normalize(), matrix.z_axis.normalize())
}

fn check(settings: &ProbeSettings) -> Result<()> {
    let ProbeSettings { width, height, temporal, .. } = *settings;
    if width == 0 || height == 0 {
        return Err(Error::Argument(format!("the image is {width} x {height}; both sides must be at least 1")));
    }
    if width > 32_768 || height > 32_768 {
        return Err(Error::Limit(format!("the image is {width} x {height}; a side has at most 32768 pixels")));
    }
    if !(temporal.is_finite() && temporal >= 0.0) {
        return Err(Error::Argument(format!("a temporal filter of {temporal}; it is a number of at least 0")));
    }
    Ok(())
}
