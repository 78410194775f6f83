//! `relume evaluate probes`: Figures 4, 5 and 8 of Hajisharif et al. 2012 as contact sheets, and the turning light.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Affine3A, Vec3};
use image::RgbaImage;

use crate::cli::output::say;
use crate::cli::{progress, values};
use crate::compare::{Tile, contact_sheet};
use crate::formats::image::{ExrLayers, read_far_field, write_exr, write_png};
use crate::formats::tone::ToneCurve;
use crate::formats::{object, whole};
use crate::frames::composite::{Backdrop, compose};
use crate::frames::probes::{ProbeRenderer, ProbeSettings, Projection};
use crate::gpu::{Context, ContextOptions, Profile};
use crate::preprocess::transfer::{self, Transfer, TransferOptions};
use crate::probes::{ProbeSequence, SequenceOptions};
use crate::reference::shapes;
use crate::scene::{Camera, FarField, Object};
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Args {
    /// Object, which is put on a ground [default: one built in code]
    #[arg(long, value_name = "FILE")]
    object: Option<PathBuf>,
    /// Lat-long probe, .exr or .hdr [default: one made in code]
    #[arg(long, value_name = "FILE")]
    probe: Option<PathBuf>,
    /// Folder for the sheets, which is made
    #[arg(long, value_name = "FOLDER", default_value = "relume-probes")]
    out: PathBuf,
    /// Size of a picture
    #[arg(long, value_name = "WxH", value_parser = values::size, allow_hyphen_values = true, default_value = "400x300")]
    size: (u32, u32),
    /// Bands, 1 to 5
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = values::order)]
    order: usize,
    /// Exposure in stops
    #[arg(long, value_name = "STOPS", value_parser = values::finite, default_value = "0", allow_hyphen_values = true)]
    exposure: f64,
    /// Degrees between the frames of the turning light
    #[arg(long, value_name = "DEG", value_parser = values::positive, default_value = "10")]
    step: f64,
}

/// Directions of Figure 8.
const DIRECTIONS: [u32; 3] = [100, 900, 2500];
/// Sizes of Figure 4, each half of the one before.
const SIZES: usize = 6;
/// Size of the probe that is made in code: that of the paper's largest.
const PROBE: [u32; 2] = [1628, 814];
/// Frames a second of the turning light.
const RATE: u16 = 12;

/// Everything that a picture needs but the transfer.
struct Scene {
    context: Arc<Context>,
    object: Object,
    probe: FarField,
    probe_path: PathBuf,
    camera: Camera,
    settings: ProbeSettings,
    exposure: f32,
    out: PathBuf,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let scene = Scene::new(args)?;
    let transfers = scene.transfers(args.order)?;
    let [few, some, full] = &transfers;
    let projection = scene.settings.projection;

    let tile = |title: &str, caption: String, transfer: Option<&Transfer>, projection: Projection| -> Result<Tile> {
        let image = scene.picture(transfer, projection)?;
        Ok(Tile { image, title: title.into(), caption })
    };
    let sheet = [
        tile("without visibility", "cosine alone".into(), None, projection)?,
        tile("with visibility", format!("{} directions", full.samples), Some(full), projection)?,
    ];
    scene.sheet("visibility.png", "Hajisharif 2012, Figure 5", 2, &sheet)?;

    let one = |transfer: &Transfer| {
        let off = rms(transfer, full) * 100.0;
        let caption = if off > 0.0 { format!("{off:.2} % from {}", full.samples) } else { "the most".into() };
        tile(&format!("{} directions", transfer.samples), caption, Some(transfer), projection)
    };
    let sheet = [one(few)?, one(some)?, one(full)?];
    scene.sheet("directions.png", "Hajisharif 2012, Figure 8", 3, &sheet)?;

    let mut first = None;
    let widths = (0..SIZES).map(|halvings| scene.probe.width >> halvings).filter(|width| *width >= 2);
    let sheet = widths
        .map(|width| {
            let projection = Projection { width: Some(width), ..projection };
            let mut renderer = scene.renderer(Some(full), projection)?;
            let image = scene.shot(&mut renderer, &scene.probe)?;
            let light = renderer.coefficients()?;
            let off = 100.0 * difference(&light, first.get_or_insert_with(|| light.clone()));
            let [width, height] = renderer.projected_size().unwrap_or_default();
            let caption = if off > 0.0 { format!("light {off:.2} % off") } else { "as it is".into() };
            Ok(Tile { image, title: format!("projected from {width}x{height}"), caption })
        })
        .collect::<Result<Vec<_>>>()?;
    scene.sheet("resolutions.png", "Hajisharif 2012, Figure 4", 3, &sheet)?;
    scene.turning(full, args.step)
}

impl Scene {
    fn new(args: &Args) -> Result<Self> {
        std::fs::create_dir_all(&args.out).map_err(|e| Error::file(&args.out, format!("cannot be made: {e}")))?;
        let mut object = match &args.object {
            Some(path) => object::load(path)?,
            None => shapes::trophy(),
        };
        let (low, high) = object.bounds();
        shapes::add_ground(&mut object, 5.0, 96);
        let (probe, probe_path) = match &args.probe {
            Some(path) => (read_far_field(path)?, path.clone()),
            None => {
                let (probe, path) = (evening(PROBE), args.out.join("probe.exr"));
                let (width, height, rgb) = (probe.width, probe.height, &probe.radiance[..]);
                write_exr(&path, &ExrLayers { width, height, rgb, alpha: None, groups: &[] })?;
                (probe, path)
            }
        };
        let camera = Camera::framing(0.5 * (low + high), 0.45 * (high - low).length());
        let (width, height) = args.size;
        let projection = Projection { order: args.order, ..Projection::default() };
        Ok(Self {
            context: Context::new(&ContextOptions::default())?,
            object,
            probe,
            probe_path,
            camera,
            settings: ProbeSettings { width, height, projection, ..ProbeSettings::default() },
            exposure: args.exposure as f32,
            out: args.out.clone(),
        })
    }

    fn transfers(&self, order: usize) -> Result<[Transfer; 3]> {
        let bar = progress::bar("transfer", 1000);
        let one = |samples| {
            let options = TransferOptions { order, samples, ..TransferOptions::default() };
            transfer::compute(&self.object, &options, &|share| bar.set_position((share * 1000.0) as u64))
        };
        let [a, b, c] = DIRECTIONS;
        let all = [one(a)?, one(b)?, one(c)?];
        bar.finish_and_clear();
        Ok(all)
    }

    fn renderer(&self, transfer: Option<&Transfer>, projection: Projection) -> Result<ProbeRenderer> {
        let settings = ProbeSettings { projection, ..self.settings };
        ProbeRenderer::new(&self.context, &self.object, Affine3A::IDENTITY, transfer, settings)
    }

    fn picture(&self, transfer: Option<&Transfer>, projection: Projection) -> Result<RgbaImage> {
        self.shot(&mut self.renderer(transfer, projection)?, &self.probe)
    }

    /// The object in the light of a probe, and the probe behind it.
    fn shot(&self, renderer: &mut ProbeRenderer, probe: &FarField) -> Result<RgbaImage> {
        renderer.light(probe, &mut Profile::default())?;
        let frame = renderer.render(&self.camera)?;
        let backdrop = Backdrop { environment: Some(probe), ..Backdrop::default() };
        let picture = compose(&frame, &self.camera, backdrop);
        let scale = self.exposure.exp2();
        let bytes = picture.rgb.iter().flat_map(|color| {
            let [r, g, b] = ToneCurve::Filmic.encode(*color * scale);
            [r, g, b, 255]
        });
        RgbaImage::from_raw(frame.width, frame.height, bytes.collect())
            .ok_or_else(|| Error::Argument("a picture without pixels".into()))
    }

    fn sheet(&self, name: &str, title: &str, columns: usize, tiles: &[Tile]) -> Result<()> {
        let sheet = contact_sheet(title, columns, tiles)?;
        let path = self.out.join(name);
        write_png(&path, sheet.width(), sheet.height(), &sheet)?;
        say!("{}", path.display())
    }

    /// A whole turn of the light as an animated PNG.
    fn turning(&self, transfer: &Transfer, step: f64) -> Result<()> {
        let count = (360.0 / step).ceil().clamp(1.0, 720.0) as u32;
        let rate = f64::from(RATE);
        let options = SequenceOptions { turn: 360.0 / f64::from(count) * rate, rate, ..SequenceOptions::default() };
        let sequence = ProbeSequence::open(&self.probe_path, &options)?;
        let mut renderer = self.renderer(Some(transfer), self.settings.projection)?;
        let bar = progress::bar("turning", u64::from(count));
        let frames = (0..count)
            .map(|number| {
                let frame = self.shot(&mut renderer, &sequence.frame(u64::from(number))?);
                bar.inc(1);
                frame
            })
            .collect::<Result<Vec<_>>>()?;
        bar.finish_and_clear();
        let path = self.out.join("turning.png");
        write_animation(&path, &frames)?;
        say!("{}", path.display())
    }
}

/// An animated PNG without end.
fn write_animation(path: &Path, frames: &[RgbaImage]) -> Result<()> {
    let Some(first) = frames.first() else { return Ok(()) };
    whole::write(path, |file| {
        let bad = |e: png::EncodingError| Error::file(path, format!("cannot be written: {e}"));
        let mut encoder = png::Encoder::new(file, first.width(), first.height());
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        encoder.set_animated(frames.len() as u32, 0).map_err(bad)?;
        encoder.set_frame_delay(1, RATE).map_err(bad)?;
        let mut writer = encoder.write_header().map_err(bad)?;
        for frame in frames {
            let rgb: Vec<u8> = frame.pixels().flat_map(|pixel| [pixel.0[0], pixel.0[1], pixel.0[2]]).collect();
            writer.write_image_data(&rgb).map_err(bad)?;
        }
        writer.finish().map_err(bad)
    })
}

/// Relative RMS difference of the light's coefficients.
fn difference(light: &[Vec3], other: &[Vec3]) -> f32 {
    let differences: f32 = light.iter().zip(other).map(|(a, b)| a.distance_squared(*b)).sum();
    (differences / other.iter().map(|b| b.length_squared()).sum::<f32>().max(1e-30)).sqrt()
}

/// Relative RMS difference of all coefficients of two transfers.
fn rms(transfer: &Transfer, other: &Transfer) -> f64 {
    let square = |v: f32| f64::from(v) * f64::from(v);
    let pairs = transfer.coefficients.iter().zip(&other.coefficients);
    let differences: f64 = pairs.map(|(a, b)| square(a - b)).sum();
    (differences / other.coefficients.iter().map(|b| square(*b)).sum::<f64>().max(1e-30)).sqrt()
}

/// A low sun between clouds over dark ground.
fn evening([width, height]: [u32; 2]) -> FarField {
    let texel = |at: u32| {
        let u = (at % width) as f32 / width as f32;
        let v = ((at / width) as f32 + 0.5) / height as f32;
        let (around, down) = (std::f32::consts::TAU * (u - 0.5), std::f32::consts::PI * v);
        let direction = Vec3::new(down.sin() * around.sin(), down.cos(), -down.sin() * around.cos());
        if direction.y < 0.0 {
            return Vec3::new(0.11, 0.09, 0.07);
        }
        let sun = direction.dot(Vec3::new(0.75, 0.45, 0.5).normalize());
        let clouds = 0.5 + 0.5 * (9.0 * around + 3.0 * (7.0 * down).sin()).sin() * (11.0 * down).cos();
        let sky = Vec3::new(0.25, 0.42, 0.75).lerp(Vec3::new(0.8, 0.55, 0.35), (1.0 - direction.y).powi(3));
        let glow = Vec3::new(1.0, 0.7, 0.4) * (2.0 * sun.max(0.0).powi(20));
        let disc = if sun > 0.995 { Vec3::new(120.0, 80.0, 45.0) } else { Vec3::ZERO };
        sky * (0.6 + 0.5 * clouds) + glow + disc
    };
    FarField { width, height, radiance: (0..width * height).map(texel).collect() }
}
