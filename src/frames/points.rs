//! The cloud on the screen: raw points, or the surface that the pyramidal operators make of them (Bouchiba et al. 2018).

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Instant;

use glam::{Affine3A, Vec3};

use crate::gpu::{Context, Profile, Recorder};
use crate::passes::contact_shadow::{ContactShadowPass, ShadowSetup};
use crate::passes::point_operators::{PointImages, PointOperators};
use crate::passes::points::{PointBuffer, PointRun, PointView, PointsPass, TARGET_BYTES_PER_PIXEL};
use crate::preprocess::directional_light;
use crate::preprocess::distance_field::DistanceField;
use crate::preprocess::point_chunks::{CHUNK, Chunk, PackedPoint, PointChunks};
use crate::scene::{Camera, FarField};
use crate::{Error, Result};

pub use crate::passes::point_operators::HiddenPoints;
pub use crate::passes::points::PointGeometry;

/// What is shown of a cloud.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PointDisplay {
    /// Points, a pixel each, hidden ones too.
    Raw,
    /// The surface in the points' colours.
    #[default]
    Filled,
    /// Its normals as colours.
    Normals,
    /// The surface in grey, lit from the eye.
    Headlight,
    /// In the points' colours with darkened edges (Boucheny 2009).
    EyeDome,
}

impl PointDisplay {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Raw, Self::Filled, Self::Normals, Self::Headlight, Self::EyeDome];

    /// The name it has everywhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Filled => "filled",
            Self::Normals => "normals",
            Self::Headlight => "headlight",
            Self::EyeDome => "eye-dome",
        }
    }

    /// Whether it has colours, which lamps can change.
    pub fn shows_light(self) -> bool {
        matches!(self, Self::Raw | Self::Filled | Self::EyeDome)
    }

    /// As `point_shade.comp` knows it.
    fn code(self) -> u32 {
        self as u32
    }
}

impl fmt::Display for PointDisplay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for PointDisplay {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|d| d.name() == text).ok_or_else(|| {
            format!("{text:?} is no way to show points; there are raw, filled, normals, headlight and eye-dome")
        })
    }
}

/// Everything that the picture of a cloud depends on besides cloud and camera.
#[derive(Clone, Copy, Debug)]
pub struct PointSettings {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// What is shown.
    pub display: PointDisplay,
    /// How points are drawn; by what is quicker where `None`.
    pub geometry: Option<PointGeometry>,
    /// How hidden points are found.
    pub hidden: HiddenPoints,
    /// s_0 of the paper, metres; the cloud's own where `None`.
    pub spacing: Option<f32>,
    /// Most points to draw; fewer are drawn as a thinner cloud.
    pub most_points: Option<u64>,
    /// Most bytes of device objects.
    pub memory_budget: u64,
}

impl Default for PointSettings {
    fn default() -> Self {
        Self {
            width: 512,
            height: 512,
            display: PointDisplay::default(),
            geometry: None,
            hidden: HiddenPoints::default(),
            spacing: None,
            most_points: None,
            memory_budget: super::Settings::DEFAULT_BUDGET,
        }
    }
}

/// A picture of a cloud, row by row from the top.
#[derive(Clone, Debug, Default)]
pub struct PointFrame {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Linear colour, and depth along the view in metres; 0 where nothing is.
    pub color_depth: Vec<[f32; 4]>,
    /// World normals, w 1 where there is one.
    pub normal: Vec<[f32; 4]>,
    /// Share of the light that the object's contact shadow leaves, by channel; empty without one.
    pub shadow: Vec<[f32; 4]>,
    /// Light of lamps that are not in the scan.
    pub lit: Option<LitBy>,
    /// Points drawn, those outside of the view left out as whole chunks.
    pub drawn: u64,
    /// Times and counts by pass.
    pub profile: Profile,
    /// Wall time, milliseconds.
    pub wall_ms: f64,
}

/// Light that lamps add to a picture of points.
#[derive(Clone, Debug, Default)]
pub struct LitBy {
    /// Radiance, a pixel; no contact shadow takes of it, since lamps cast shadows of their own.
    pub radiance: Vec<[f32; 4]>,
    /// Share of the picture's own light that stays.
    pub share: f32,
}

/// What draws points faster on every device that was measured: 10 to 12 times on lavapipe, over 100 times on a large GPU,
/// whose rasteriser has one pixel a point to work on.
const QUICKER: PointGeometry = PointGeometry::Atomics;
/// Points of one buffer: 64 MiB.
pub(super) const BUFFER_POINTS: usize = 64 * CHUNK;

/// A cloud on the device, ready to be drawn at one size.
pub struct PointRenderer {
    context: Arc<Context>,
    settings: PointSettings,
    chunks: Arc<PointChunks>,
    points: PointsPass,
    /// One for each run of [`BUFFER_POINTS`] points; a single one that is filled again and again where not all fit.
    buffers: Vec<PointBuffer>,
    images: PointImages,
    operators: PointOperators,
    shadow: Option<ContactShadowPass>,
    lights: Option<PointLights>,
    /// What was drawn last.
    view: Option<PointView>,
    /// Where the object stands that casts its shadow, and in which light.
    setup: Option<ShadowSetup>,
    /// The shadow of what was drawn last is that of another place or light.
    stale: bool,
}

/// What the points light a caster with: its middle, how far points are from there that count, and their light by
/// direction.
type PointLights = (Vec3, f32, Vec<(Vec3, Option<Vec3>)>);

/// What casts a contact shadow on the scan.
#[derive(Clone, Copy, Debug)]
pub struct ShadowCaster<'a> {
    /// Distances to the object's surface.
    pub field: &'a DistanceField,
    /// Where the object stands; scales alike along all axes.
    pub world_from_object: Affine3A,
    /// Light from beyond the scan.
    pub far_field: Option<&'a FarField>,
}

impl PointRenderer {
    /// Uploads the cloud, or what fits the budget of it, and makes everything that pictures need.
    ///
    /// # Errors
    /// [`Error::Argument`] for settings that make no sense, [`Error::Limit`] where an image of that size does not fit
    /// the budget.
    pub fn new(context: &Arc<Context>, chunks: &Arc<PointChunks>, settings: PointSettings) -> Result<Self> {
        let (width, height) = (settings.width, settings.height);
        check_size(width, height)?;
        let spacing = settings.spacing.unwrap_or(chunks.spacing);
        if !(spacing.is_finite() && spacing > 0.0) {
            return Err(Error::Argument(format!("a spacing of {spacing} metres between points; it is above zero")));
        }
        let pixels = u64::from(width) * u64::from(height);
        let image_bytes = PointImages::bytes(width, height) + pixels * TARGET_BYTES_PER_PIXEL;
        let point_bytes = size_of::<PackedPoint>() as u64;
        let least = image_bytes + CHUNK as u64 * point_bytes + STAGING;
        if least > settings.memory_budget {
            return Err(Error::Limit(format!(
                "a memory budget of {} MiB is too small for points at {width}x{height}: they need about {} MiB",
                settings.memory_budget >> 20,
                least.div_ceil(1 << 20)
            )));
        }
        let points = PointsPass::new(context, settings.geometry.unwrap_or(QUICKER), width, height)?;
        let free = (settings.memory_budget - image_bytes - STAGING) / point_bytes;
        let total = chunks.points.len();
        let buffers = if total == 0 {
            vec![points.buffer(1)?]
        } else if total as u64 <= free {
            chunks
                .points
                .chunks(BUFFER_POINTS)
                .map(|part| {
                    let buffer = points.buffer(part.len())?;
                    buffer.upload(part)?;
                    Ok(buffer)
                })
                .collect::<Result<Vec<_>>>()?
        } else {
            vec![points.buffer((free as usize / CHUNK * CHUNK).min(BUFFER_POINTS))?]
        };
        Self::with_buffers(context, chunks, PointSettings { spacing: Some(spacing), ..settings }, points, buffers)
    }

    /// Draws the same points at another size, from the same memory.
    ///
    /// # Errors
    /// [`Error::Argument`] for a size without pixels, [`Error::Limit`] where it does not fit the device.
    pub fn beside(&self, width: u32, height: u32) -> Result<Self> {
        check_size(width, height)?;
        let settings = PointSettings { width, height, ..self.settings };
        let points = PointsPass::new(&self.context, settings.geometry.unwrap_or(QUICKER), width, height)?;
        let buffers = self.buffers.iter().map(|buffer| points.share(buffer)).collect::<Result<Vec<_>>>()?;
        Self::with_buffers(&self.context, &self.chunks, settings, points, buffers)
    }

    fn with_buffers(
        context: &Arc<Context>,
        chunks: &Arc<PointChunks>,
        settings: PointSettings,
        points: PointsPass,
        buffers: Vec<PointBuffer>,
    ) -> Result<Self> {
        let images = PointImages::new(context, settings.width, settings.height)?;
        let operators = PointOperators::new(context, &points, &images, settings.hidden)?;
        Ok(Self {
            context: context.clone(),
            settings,
            chunks: chunks.clone(),
            points,
            buffers,
            images,
            operators,
            shadow: None,
            lights: None,
            view: None,
            setup: None,
            stale: false,
        })
    }

    /// The points on the device, [`BUFFER_POINTS`] a buffer; `None` where not all fit it at once.
    pub(super) fn resident_buffers(&self) -> Option<&[PointBuffer]> {
        self.resident().then_some(&self.buffers[..])
    }

    /// Lets an object cast its shadow from now on; nothing does for `None`.
    ///
    /// # Errors
    /// [`Error::Limit`] where it does not fit the device.
    pub fn cast_shadow(&mut self, caster: Option<ShadowCaster<'_>>) -> Result<()> {
        self.shadow = None;
        let Some(caster) = caster else { return Ok(()) };
        let pass = ContactShadowPass::new(&self.context, &self.images, caster.field)?;
        (self.shadow, self.setup) = (Some(pass), None);
        self.move_shadow(caster)
    }

    /// Moves the object that casts its shadow already, or changes the light from beyond the scan.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn move_shadow(
        &mut self,
        ShadowCaster { field, world_from_object, far_field }: ShadowCaster<'_>,
    ) -> Result<()> {
        let Some(pass) = &self.shadow else { return Ok(()) };
        let (low, high) = (field.low, field.high());
        let scale = world_from_object.matrix3.x_axis.length();
        let centre = world_from_object.transform_point3(0.5 * (low + high));
        let radius = 0.5 * (high - low).length() * scale;
        let known = self.lights.take().filter(|(place, nearest, _)| (*place, *nearest) == (centre, 0.5 * radius));
        let (_, _, of_points) = self.lights.insert(known.unwrap_or_else(|| {
            (centre, 0.5 * radius, directional_light::of_points(&self.chunks, centre, 0.5 * radius))
        }));
        let lights = directional_light::beyond(of_points, far_field);
        let setup = ShadowSetup { object_from_world: world_from_object.inverse(), centre, radius, lights };
        // In a closed room the light from beyond it changes nothing.
        if self.setup.as_ref() != Some(&setup) {
            pass.place(&setup)?;
            (self.setup, self.stale) = (Some(setup), true);
        }
        Ok(())
    }

    /// Renders pictures of another size from now on.
    ///
    /// # Errors
    /// [`Error::Argument`] for a size without pixels, [`Error::Limit`] where it does not fit the device.
    pub fn resize(&mut self, width: u32, height: u32) -> Result<()> {
        check_size(width, height)?;
        if (width, height) == (self.settings.width, self.settings.height) {
            return Ok(());
        }
        self.images = PointImages::new(&self.context, width, height)?;
        self.points.resize(&mut self.buffers, width, height)?;
        self.operators.bind(&self.points, &self.images)?;
        if let Some(pass) = &mut self.shadow {
            pass.bind(&self.images)?;
        }
        (self.settings.width, self.settings.height) = (width, height);
        self.view = None;
        Ok(())
    }

    /// Shows something else from now on.
    pub fn show(&mut self, display: PointDisplay, most_points: Option<u64>) {
        self.settings.display = display;
        self.settings.most_points = most_points;
    }

    /// Renders a picture.
    ///
    /// # Errors
    /// Vulkan's own errors.
    pub fn render(&mut self, camera: &Camera) -> Result<PointFrame> {
        let start = Instant::now();
        let mut profile = Profile::default();
        let drawn = self.draw(camera, &mut profile)?;
        let pixels = self.settings.width as usize * self.settings.height as usize;
        Ok(PointFrame {
            lit: None,
            width: self.settings.width,
            height: self.settings.height,
            color_depth: self.images.shaded.download(pixels)?,
            normal: self.images.shaded_normals.download(pixels)?,
            shadow: self.shadow.as_ref().map_or(Ok(Vec::new()), |pass| pass.shadow.download(pixels))?,
            drawn,
            profile,
            wall_ms: start.elapsed().as_secs_f64() * 1e3,
        })
    }

    /// Makes the shadow of the picture that was rendered last anew, after [`Self::move_shadow`]: all else of it stays.
    ///
    /// # Errors
    /// Vulkan's own errors.
    pub fn shade_again(&mut self, frame: &mut PointFrame) -> Result<()> {
        frame.profile = Profile::default();
        let (Some(pass), Some(view), true) = (&self.shadow, self.view, self.stale) else { return Ok(()) };
        let mut recorder = Recorder::new(&self.context)?;
        pass.record(&mut recorder, view)?;
        recorder.finish(&mut frame.profile)?;
        frame.shadow = pass.shadow.download(self.settings.width as usize * self.settings.height as usize)?;
        self.stale = false;
        Ok(())
    }

    /// What was drawn last, before hidden points were removed and after the surface was filled
    /// ([`PointImages::points`], [`PointImages::surface`]).
    pub fn images(&self) -> &PointImages {
        &self.images
    }

    /// All passes of a picture; gives the number of points drawn.
    ///
    /// # Errors
    /// Vulkan's own errors.
    pub fn draw(&mut self, camera: &Camera, profile: &mut Profile) -> Result<u64> {
        let PointSettings { width, height, display, spacing, .. } = self.settings;
        let view = PointView::new(camera, width, height, spacing.unwrap_or(self.chunks.spacing));
        let levels = self.images.levels.levels.len() as u32;
        let view = PointView { display: display.code(), levels, ..view };
        let (drawn, view) = self.draw_points(view, profile)?;
        profile.count("points", "points", drawn);
        let mut recorder = Recorder::new(&self.context)?;
        self.operators.remove_hidden(&mut recorder, &self.points, &self.images.levels, view)?;
        if display != PointDisplay::Raw {
            self.operators.fill(&mut recorder, &self.images.levels, view)?;
        }
        self.operators.shade(&mut recorder, view)?;
        if let Some(pass) = &self.shadow {
            pass.record(&mut recorder, view)?;
        }
        recorder.finish(profile)?;
        (self.view, self.stale) = (Some(view), false);
        Ok(drawn)
    }

    /// The visibility mask alone: [`PointImages::surface`] has it then.
    ///
    /// # Errors
    /// Vulkan's own errors.
    pub fn classify(&mut self, camera: &Camera, profile: &mut Profile) -> Result<()> {
        let PointSettings { width, height, spacing, .. } = self.settings;
        let view = PointView::new(camera, width, height, spacing.unwrap_or(self.chunks.spacing));
        let view = PointView { levels: self.images.levels.levels.len() as u32, ..view };
        let (_, view) = self.draw_points(view, profile)?;
        let mut recorder = Recorder::new(&self.context)?;
        self.operators.remove_hidden(&mut recorder, &self.points, &self.images.levels, view)?;
        recorder.finish(profile)
    }

    /// The geometry pass; gives the number of points drawn, and the view with their spacing, which is larger than the
    /// cloud's where not all are.
    fn draw_points(&self, view: PointView, profile: &mut Profile) -> Result<(u64, PointView)> {
        let visible: Vec<&Chunk> = self.chunks.chunks.iter().filter(|chunk| sees(view, chunk)).collect();
        let total: u64 = visible.iter().map(|chunk| chunk.count as u64).sum();
        let share = match self.settings.most_points {
            Some(most) if most < total => most as f64 / total as f64,
            _ => 1.0,
        };
        let run = |chunk: &Chunk, first: usize| PointRun {
            first: first as u32,
            count: (chunk.count as f64 * share).ceil() as u32,
        };
        let mut drawn = 0;
        let mut clear = true;
        let mut record = |buffer: &PointBuffer, runs: &[PointRun]| {
            drawn += runs.iter().map(|run| u64::from(run.count)).sum::<u64>();
            let mut recorder = Recorder::new(&self.context)?;
            self.points.record(&mut recorder, buffer, runs, view, clear)?;
            clear = false;
            recorder.finish(profile)
        };
        if self.resident() {
            for (index, buffer) in self.buffers.iter().enumerate() {
                let here = |chunk: &&&Chunk| chunk.first / BUFFER_POINTS == index;
                let runs: Vec<PointRun> =
                    visible.iter().filter(here).map(|chunk| run(chunk, chunk.first % BUFFER_POINTS)).collect();
                record(buffer, &runs)?;
            }
        } else {
            let buffer = &self.buffers[0];
            let fits = buffer.capacity() / CHUNK;
            // One group at least, which clears the targets.
            for group in (0..visible.len().max(1)).step_by(fits).map(|k| &visible[k..visible.len().min(k + fits)]) {
                let mut points: Vec<PackedPoint> = Vec::with_capacity(fits * CHUNK);
                let mut runs = Vec::new();
                for chunk in group {
                    let PointRun { count, first } = run(chunk, points.len());
                    points.extend(&self.chunks.points[chunk.first..chunk.first + count as usize]);
                    runs.push(PointRun { first, count });
                }
                buffer.upload(&points)?;
                record(buffer, &runs)?;
            }
        }
        Ok((drawn, PointView { spacing: view.spacing / (share as f32).sqrt(), ..view }))
    }

    /// Whether all points are on the device.
    fn resident(&self) -> bool {
        let capacity: usize = self.buffers.iter().map(PointBuffer::capacity).sum();
        capacity >= self.chunks.points.len()
    }
}

fn check_size(width: u32, height: u32) -> Result<()> {
    if width == 0 || height == 0 || width.max(height) > MOST_PIXELS_A_SIDE {
        return Err(Error::Argument(format!(
            "an image of {width}x{height}; a side has 1 to {MOST_PIXELS_A_SIDE} pixels"
        )));
    }
    Ok(())
}

/// Longest side of an image, pixels.
const MOST_PIXELS_A_SIDE: u32 = 16_384;
/// Uploads and downloads go through staging buffers of this size.
const STAGING: u64 = 8 << 20;

/// Whether a chunk's box may reach into the view's pyramid: on the inner side of the near plane and of all four sides.
fn sees(view: PointView, chunk: &Chunk) -> bool {
    let [eye, right, down, forward] = [view.eye, view.right, view.down, view.forward].map(Vec3::from);
    let (centre, half) = (0.5 * (chunk.low + chunk.high) - eye, 0.5 * (chunk.high - chunk.low));
    // The corner that lies farthest along an axis.
    let farthest = |axis: Vec3| centre.dot(axis) + half.dot(axis.abs());
    let (x, y) = (0.5 * view.width as f32 / view.focal, 0.5 * view.height as f32 / view.focal);
    farthest(forward) >= view.near
        && [forward * x - right, forward * x + right, forward * y - down, forward * y + down]
            .into_iter()
            .all(|inwards| farthest(inwards) >= 0.0)
}
