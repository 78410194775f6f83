//! A light probe on the device: its texels, their pyramid, and its projection to spherical harmonics (Hajisharif et al.
//! 2012, 3.4 to 3.6).

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use ash::vk;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;

use crate::gpu::pipeline::DescriptorSet;
use crate::gpu::{Bindings, Buffer, ComputePipeline, Constant, Context, Profile, Recorder, Use};
use crate::scene::FarField;
use crate::scene::harmonics::{MOST_COEFFICIENTS, MOST_ORDER, band, hanning};
use crate::{Error, Result};

/// Push constants (`glsl/shared/probe.glsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ProbeConstants {
    /// Width of the level that is read, texels.
    pub width: u32,
    /// Its height.
    pub height: u32,
    /// Its first texel.
    pub first: u32,
    /// Width of the level that is written, texels.
    pub target_width: u32,
    /// Its height.
    pub target_height: u32,
    /// Its first texel.
    pub target_first: u32,
    /// Pairs of rows that an invocation adds up.
    pub rows: u32,
    /// Partial sums.
    pub groups: u32,
    /// Alpha of Eq. 13.
    pub keep: f32,
}

/// How a probe is projected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Bands: 1 to 5.
    pub order: usize,
    /// Against ringing, bands are weighed by a Hanning window.
    pub hanning: bool,
    /// The first level of the pyramid that is not wider than this is projected; the probe itself where `None` (3.4).
    pub width: Option<u32>,
    /// Pairs of rows that an invocation adds up before it shares its sums; by what is quick on the device where `None`.
    /// One is next to the paper's way, a thread for each pixel.
    pub rows: Option<u32>,
}

impl Default for Projection {
    fn default() -> Self {
        Self { order: 4, hanning: false, width: None, rows: None }
    }
}

/// Invocations of a workgroup of `project.comp`.
const GROUP: u32 = 32;
/// A software device has few cores, which like long loops: so many workgroups are enough to share out.
const SOFTWARE_GROUPS: u32 = 8;
/// Others have thousands of lanes to fill.
const ROWS: u32 = 8;

/// One level of the pyramid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Level {
    width: u32,
    height: u32,
    first: u32,
}

/// What depends on the size of the panorama.
struct Images {
    size: [u32; 2],
    levels: Vec<Level>,
    /// The level that is projected.
    projected: Level,
    rows: u32,
    groups: u32,
    staging: Buffer,
    texels: Buffer,
    level_table: Buffer,
    _tables: [Buffer; 3],
    pyramid_set: DescriptorSet,
    project_set: DescriptorSet,
    finish_set: DescriptorSet,
}

/// The passes, and the probe that they have worked on.
pub struct ProbeLight {
    context: Arc<Context>,
    projection: Projection,
    /// All levels are wanted, for reflections.
    whole_pyramid: bool,
    pyramid: ComputePipeline,
    project: ComputePipeline,
    finish: ComputePipeline,
    window: Buffer,
    light: Buffer,
    images: Option<Images>,
    /// Something is there that Eq. 13 may mix with.
    lit: bool,
}

impl ProbeLight {
    /// Makes the pipelines; `whole_pyramid` where [`ProbeLight::bindings`] are to have all levels.
    ///
    /// # Errors
    /// [`Error::Argument`] for an order that there is not; Vulkan's own errors.
    pub fn new(context: &Arc<Context>, projection: Projection, whole_pyramid: bool) -> Result<Self> {
        let Projection { order, hanning: windowed, .. } = projection;
        if !(1..=MOST_ORDER).contains(&order) {
            return Err(Error::Argument(format!("order {order} of spherical harmonics; there are 1 to {MOST_ORDER}")));
        }
        let constants = [Constant::new(0, order as u32)];
        let weight = |k| if windowed { hanning(band(k), order) as f32 } else { 1.0 };
        let window: Vec<f32> = (0..MOST_COEFFICIENTS).map(weight).collect();
        let pipeline = |shader, constants: &[Constant]| ComputePipeline::new(context, shader, constants);
        let light = Buffer::new(context, "probe light", (MOST_COEFFICIENTS * 16) as u64)?;
        light.upload(&[0; MOST_COEFFICIENTS * 16])?;
        Ok(Self {
            context: context.clone(),
            projection,
            whole_pyramid,
            pyramid: pipeline("probe_light/pyramid.comp", &[])?,
            project: pipeline("probe_light/project.comp", &constants)?,
            finish: pipeline("probe_light/finish.comp", &constants)?,
            window: Buffer::texels_from_slice(context, "probe window", &window, vk::Format::R32_SFLOAT)?,
            light,
            images: None,
            lit: false,
        })
    }

    /// Bands of the light.
    pub fn order(&self) -> usize {
        self.projection.order
    }

    /// Uploads a panorama, makes the levels that are wanted and projects it; mixed with `keep` times what was there
    /// before (Eq. 13), which makes a sequence smoother the larger it is. A panorama that does not fit the device is
    /// halved until it does.
    ///
    /// # Errors
    /// Vulkan's own errors.
    pub fn set(&mut self, panorama: &FarField, keep: f32, profile: &mut Profile) -> Result<()> {
        self.upload(panorama)?;
        self.record(keep, true, profile)
    }

    /// Projects the panorama that is there once more, without uploading it: for benchmarks.
    ///
    /// # Errors
    /// Vulkan's own errors.
    pub fn project_again(&mut self, profile: &mut Profile) -> Result<()> {
        self.record(0.0, false, profile)
    }

    fn upload(&mut self, panorama: &FarField) -> Result<()> {
        let mut smaller: Option<FarField> = None;
        while let Some(half) = self.too_large(smaller.as_ref().unwrap_or(panorama)) {
            smaller = Some(half);
        }
        let panorama = smaller.as_ref().unwrap_or(panorama);
        let size = [panorama.width, panorama.height];
        if self.images.as_ref().is_none_or(|images| images.size != size) {
            // Memory of the old ones is free before the new ones take theirs.
            self.images = None;
            self.images = Some(self.images(size)?);
        }
        let Some(images) = &mut self.images else { return Ok(()) };
        let staging: &mut [[f32; 4]] = bytemuck::cast_slice_mut(images.staging.mapped_mut()?);
        const RUN: usize = 1 << 14;
        staging.par_chunks_mut(RUN).zip(panorama.radiance.par_chunks(RUN)).for_each(|(to, from)| {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = [from.x, from.y, from.z, 1.0]);
        });
        Ok(())
    }

    /// The panorama at half its size, where it does not fit a buffer of the device.
    fn too_large(&self, panorama: &FarField) -> Option<FarField> {
        let texels = levels([panorama.width, panorama.height]).1;
        let capabilities = &self.context.capabilities;
        let most = (capabilities.max_storage_range / 16).min(u64::from(capabilities.max_texels));
        if u64::from(texels) <= most { None } else { panorama.half() }
    }

    fn images(&self, size: [u32; 2]) -> Result<Images> {
        let context = &self.context;
        let (mut levels, _) = levels(size);
        let wanted = |level: &Level| self.projection.width.is_none_or(|width| level.width <= width);
        let at = levels.iter().position(wanted).unwrap_or(levels.len() - 1);
        let projected = levels[at];
        if !self.whole_pyramid {
            levels.truncate(at + 1);
        }
        let count: u32 = levels.iter().map(|level| level.width * level.height).sum();
        let four = vk::Format::R32G32B32A32_SFLOAT;
        let texels = Buffer::with_texels(context, "probe", u64::from(count) * 16, four)?;
        let staging = Buffer::staging_to_device(context, u64::from(size[0]) * u64::from(size[1]) * 16)?;
        let table: Vec<[u32; 4]> = levels.iter().map(|level| [level.width, level.height, level.first, 0]).collect();
        let level_table = Buffer::from_slice(context, "probe levels", &table)?;
        let row_table =
            Buffer::texels_from_slice(context, "probe rows", &rows(projected.width, projected.height), four)?;
        let column_table =
            Buffer::texels_from_slice(context, "probe columns", &columns(projected.width), vk::Format::R32G32_SFLOAT)?;
        let software = context.capabilities.kind == vk::PhysicalDeviceType::CPU;
        let (across, pairs) = (projected.width.div_ceil(GROUP), projected.height.div_ceil(2));
        let quick = if software { pairs.div_ceil((SOFTWARE_GROUPS / across).max(1)) } else { ROWS };
        let per_invocation = self.projection.rows.unwrap_or(quick).max(1);
        let groups = across * pairs.div_ceil(per_invocation);
        let coefficients = (self.projection.order * self.projection.order) as u64;
        let partials = Buffer::new(context, "probe partial sums", u64::from(groups) * coefficients * 16)?;
        let bindings = Bindings::new()
            .buffer("probe_texels", &texels)
            .buffer("probe_texels_out", &texels)
            .buffer("probe_rows", &row_table)
            .buffer("probe_columns", &column_table)
            .buffer("ProbePartials", &partials)
            .buffer("probe_window", &self.window)
            .buffer("ProbeLight", &self.light);
        Ok(Images {
            size,
            pyramid_set: self.pyramid.bind(&bindings)?,
            project_set: self.project.bind(&bindings)?,
            finish_set: self.finish.bind(&bindings)?,
            levels,
            projected,
            rows: per_invocation,
            groups,
            staging,
            texels,
            level_table,
            _tables: [row_table, column_table, partials],
        })
    }

    fn record(&mut self, keep: f32, upload: bool, profile: &mut Profile) -> Result<()> {
        let Some(images) = &self.images else {
            return Err(Error::Argument("there is no probe to be projected".into()));
        };
        let mut recorder = Recorder::new(&self.context)?;
        if upload {
            let bytes = u64::from(images.size[0]) * u64::from(images.size[1]) * 16;
            recorder.pass("probe upload", |device, commands| {
                let region = vk::BufferCopy::default().size(bytes);
                // SAFETY: both buffers are live and large enough for the region.
                unsafe { device.cmd_copy_buffer(commands, images.staging.handle, images.texels.handle, &[region]) };
            });
            recorder.count("bytes", bytes);
            recorder.barrier(&[Use::CopyTarget], &[Use::ComputeWrite]);
        }
        let Level { width, height, first } = images.projected;
        let constants = ProbeConstants {
            width,
            height,
            first,
            rows: images.rows,
            groups: images.groups,
            keep: 0.0,
            ..Default::default()
        };
        for pair in images.levels.windows(2).filter(|_| upload) {
            let [from, to] = [pair[0], pair[1]];
            let constants = ProbeConstants {
                width: from.width,
                height: from.height,
                first: from.first,
                target_width: to.width,
                target_height: to.height,
                target_first: to.first,
                ..constants
            };
            let count = to.width * to.height;
            recorder.pass("probe pyramid", |_, commands| {
                self.pyramid.dispatch(commands, &images.pyramid_set, &constants, count)
            })?;
            recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeWrite]);
        }
        recorder.pass("probe projection", |_, commands| {
            self.project.dispatch(commands, &images.project_set, &constants, images.groups * GROUP)
        })?;
        recorder.count("texels", u64::from(width) * u64::from(height));
        recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeWrite]);
        let finish = ProbeConstants { keep: if self.lit { keep } else { 0.0 }, ..constants };
        let functions = (self.projection.order * self.projection.order) as u32;
        recorder.pass("probe harmonics", |_, commands| {
            self.finish.dispatch(commands, &images.finish_set, &finish, functions * self.finish.workgroup)
        })?;
        recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeWrite, Use::SampledRead, Use::CopySource]);
        recorder.finish(profile)?;
        self.lit = true;
        Ok(())
    }

    /// Coefficients of the light, linear radiance, in the order of [`crate::scene::harmonics`].
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn coefficients(&self) -> Result<Vec<Vec3>> {
        let all: Vec<[f32; 4]> = self.light.download(self.projection.order * self.projection.order)?;
        Ok(all.into_iter().map(|[r, g, b, _]| Vec3::new(r, g, b)).collect())
    }

    /// Texels of a level of the pyramid: width, height, radiance row by row.
    ///
    /// # Errors
    /// [`Error::Argument`] where there is no such level; Vulkan's own errors.
    pub fn level(&self, level: usize) -> Result<FarField> {
        let images = self.images.as_ref();
        let Some((images, place)) = images.and_then(|images| Some((images, images.levels.get(level)?))) else {
            return Err(Error::Argument(format!("the probe has no level {level}")));
        };
        let count = place.width as usize * place.height as usize;
        let texels: Vec<[f32; 4]> = images.texels.download_at(u64::from(place.first) * 16, count)?;
        let radiance = texels.into_iter().map(|[r, g, b, _]| Vec3::new(r, g, b)).collect();
        Ok(FarField { width: place.width, height: place.height, radiance })
    }

    /// Width and height of the level that is projected; none before the first probe.
    pub fn projected_size(&self) -> Option<[u32; 2]> {
        self.images.as_ref().map(|images| [images.projected.width, images.projected.height])
    }

    /// The light's coefficients under the name that shaders use: one buffer for as long as this lives.
    pub fn light_bindings(&self) -> Bindings<'_> {
        Bindings::new().buffer("ProbeLight", &self.light)
    }

    /// Texels and levels under the names that shaders use; `None` before the first probe, and others after one of another
    /// size.
    pub fn lookup_bindings(&self) -> Option<Bindings<'_>> {
        let images = self.images.as_ref()?;
        Some(Bindings::new().buffer("probe_texels", &images.texels).buffer("ProbeLevels", &images.level_table))
    }
}

/// Levels down to a single row or column, finest first, and the texels of all.
fn levels([mut width, mut height]: [u32; 2]) -> (Vec<Level>, u32) {
    let (mut list, mut first) = (Vec::new(), 0);
    loop {
        list.push(Level { width, height, first });
        first += width * height;
        if width.min(height) < 2 {
            return (list, first);
        }
        (width, height) = (width / 2, height / 2);
    }
}

/// Cosine and sine of the angle from +Y at the middle of each row of the northern half, and the solid angle of its texels;
/// half of that for a row on the equator, which is its own mirror image.
fn rows(width: u32, height: u32) -> Vec<[f32; 4]> {
    let edge = |row: u32| (PI * f64::from(row) / f64::from(height)).cos();
    (0..height.div_ceil(2))
        .map(|row| {
            let (sine, cosine) = (PI * (f64::from(row) + 0.5) / f64::from(height)).sin_cos();
            let share = if 2 * row + 1 == height { 0.5 } else { 1.0 };
            [cosine as f32, sine as f32, (share * TAU / f64::from(width) * (edge(row) - edge(row + 1))) as f32, 0.0]
        })
        .collect()
}

/// Sine and cosine of the azimuth at the middle of each column, from +Z towards +X.
fn columns(width: u32) -> Vec<[f32; 2]> {
    (0..width)
        .map(|column| {
            // Columns count from -Z on, which is in the middle, towards +X.
            let along = TAU * ((f64::from(column) + 0.5) / f64::from(width) - 0.5);
            [along.sin() as f32, -along.cos() as f32]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_cover_the_sphere() {
        for height in [1, 2, 7, 814] {
            let sum: f64 = rows(10, height).iter().map(|row| 20.0 * f64::from(row[2])).sum();
            assert!((sum - 4.0 * PI).abs() < 1e-5, "{height}: {sum}");
        }
    }

    #[test]
    fn levels_have_the_sizes_of_the_papers_table_2() {
        let sizes: Vec<[u32; 2]> = levels([1628, 814]).0.iter().map(|level| [level.width, level.height]).collect();
        assert_eq!(sizes[..6], [[1628, 814], [814, 407], [407, 203], [203, 101], [101, 50], [50, 25]]);
        assert_eq!(levels([1, 1]).1, 1);
    }
}
