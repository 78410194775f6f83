//! `relume demo`: a room and an object in code, lit by every technique and beside the truth.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use image::RgbaImage;
use rayon::prelude::*;

use super::evaluate::scenes;
use super::stage::{self, Stage};
use super::{expand, render, values};
use crate::cli::output::say;
use crate::compare::{self, Image, Tile, contact_sheet, difference_map, luminance, to_srgb8};
use crate::formats::image::{ExrLayers, write_exr, write_png};
use crate::formats::tone::ToneCurve;
use crate::frames::composite::{Backdrop, compose};
use crate::frames::{Frame, MaterialChoice, Paper, Settings, Technique};
use crate::gpu::{Context, ContextOptions};
use crate::preprocess::expansion;
use crate::preprocess::hierarchy::{self, BuildOptions, Hierarchy};
use crate::reference::bake::{BakeOptions, BakedRoom};
use crate::reference::rooms::{Rectangle, Room, toy_room};
use crate::reference::shapes::trophy;
use crate::scene::{Camera, Cloud, Object};
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder of the pictures; made where it is missing
    #[arg(long, value_name = "DIR", default_value = "relume-demo")]
    out: PathBuf,
    /// Side of the large picture, pixels; comparisons have half of it, those with the paper's way a quarter
    #[arg(long, value_name = "PIXELS", default_value_t = 512, value_parser = clap::value_parser!(u32).range(64..=2048))]
    size: u32,
}

/// Points of the scan.
const POINTS: usize = 305_000;
const MICROBUFFER: u32 = 24;
/// Pictures in a row of the contact sheet.
const COLUMNS: usize = 5;
/// Samples a pixel of the truth, of the BRDF and of the lamps each: noise of about 1 %.
const TRUTH_SAMPLES: u32 = 256;
/// Where exposure puts the geometric mean of the backdrop: below middle grey, so that a bright object does not clip.
const GREY: f32 = 0.15;
/// Where the object stands: its own origin is in its middle.
const PLACE: Vec3 = Vec3::new(0.0, 1.0, 0.0);
/// Pixels along a side of the shots for the expansion.
const SHOT_SIZE: u32 = 512;
/// What the truth is known for: name, material, and where the colours of its error maps end.
const TRUTHS: [(&str, MaterialChoice, f32); 2] =
    [("diffuse", MaterialChoice::Diffuse(0.7), 0.2), ("metal", MaterialChoice::Metal(0.25), 0.5)];

/// All that the pictures have in common.
struct Demo {
    context: Arc<Context>,
    stage: Stage,
    object: Object,
    camera: Camera,
    out: PathBuf,
    /// Pixels along a side of the smallest pictures; the others have twice and four times as many.
    quarter: u32,
    /// The room without the object, from large to small.
    backdrops: [Image; 3],
    /// Exposure of all pictures.
    stops: f32,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let start = Instant::now();
    std::fs::create_dir_all(&args.out).map_err(|e| Error::file(&args.out, format!("cannot be made: {e}")))?;
    values::check_output(&args.out.join("contact.png"), &["png"])?;
    let context = Context::new(&ContextOptions::default())?;
    say!("device: {}", context.capabilities.name)?;
    let techniques = stage::techniques(&context);
    let demo = Demo::new(context, args)?;

    let best = techniques.last().copied().unwrap_or(Technique::Classic);
    let mut tiles = demo.large(best)?;
    tiles.extend(demo.by_technique(&techniques)?);
    for (name, material, range) in TRUTHS {
        tiles.extend(demo.beside_the_truth(best, name, material, range)?);
    }
    tiles.extend(demo.in_low_range(best)?);
    let title = format!(
        "relume demo: {} points, {} nodes, {MICROBUFFER}x{MICROBUFFER} micro-buffers, {}",
        demo.stage.build.points, demo.stage.build.nodes_after, demo.context.capabilities.name
    );
    let sheet = contact_sheet(&title, COLUMNS, &tiles)?;
    demo.write("contact.png", &sheet)?;
    say!(
        "{}: the contact sheet of all pictures; {:.1} s in all",
        args.out.join("contact.png").display(),
        start.elapsed().as_secs_f64()
    )?;
    Ok(())
}

/// The toy room with a post below the object; narrower than its plinth, so that no lit pixel touches the scan.
fn room_with_post(object: &Object) -> Room {
    let top = object.bounds().0.y;
    let side = 0.3;
    let low = Vec3::new(PLACE.x - 0.5 * side, 0.0, PLACE.z - 0.5 * side);
    let (x, y, z) = (Vec3::X * side, Vec3::Y * top, Vec3::Z * side);
    let mut room = toy_room();
    let faces = [(low, z, y), (low + x, y, z), (low + y, z, x), (low, y, x), (low + z, x, y)];
    room.surfaces.extend(faces.map(|(corner, u, v)| Rectangle::new(corner, u, v, Vec3::splat(0.6))));
    room
}

/// What the camera sees of the room, four rays a pixel.
fn trace_backdrop(baked: &BakedRoom, camera: &Camera, size: u32) -> Result<Image> {
    let pixel = |n: u32| {
        let (x, y) = (n % size, n / size);
        let corner = |k: u32| camera.ray_direction(2 * x + k % 2, 2 * y + k / 2, 2 * size, 2 * size);
        (0..4).map(|k| baked.trace(camera.from, corner(k))).sum::<Vec3>() / 4.0
    };
    Image::opaque(size, size, (0..size * size).into_par_iter().map(pixel).collect())
}

/// An opaque image with half as many pixels a side.
fn halved(image: &Image) -> Result<Image> {
    let (width, height) = (image.width / 2, image.height / 2);
    let mean = |n: u32| {
        let at = (2 * (n / width) * image.width + 2 * (n % width)) as usize;
        let row = image.width as usize;
        [at, at + 1, at + row, at + row + 1].iter().map(|n| image.rgb[*n]).sum::<Vec3>() / 4.0
    };
    Image::opaque(width, height, (0..width * height).map(mean).collect())
}

/// Stops that bring the geometric mean of luminance to [`GREY`].
fn exposure(image: &Image) -> f32 {
    let mean = image.rgb.iter().map(|c| luminance(*c).max(1e-4).log2()).sum::<f32>() / image.rgb.len() as f32;
    GREY.log2() - mean
}

/// A line about a step.
fn tell(seconds: f64, what: &str) -> Result<()> {
    say!("{seconds:>7.2} s  {what}")
}

impl Demo {
    fn new(context: Arc<Context>, args: &Args) -> Result<Self> {
        let object = stage::placed(trophy(), PLACE);
        let options = BakeOptions { texel: 0.03, direct_samples: 48, bounced_samples: 512, ..BakeOptions::default() };
        let stage = Stage::new(room_with_post(&object), POINTS, &options)?;
        tell(stage.bake_s, "baked the room's light by path tracing")?;
        tell(stage.scan_s, &format!("scanned it into {} points", stage.build.points))?;
        tell(stage.build_s, &format!("built a hierarchy of {} nodes", stage.build.nodes_after))?;
        // Window and lamp lie on the eye's side of the object and show in its metal; the red wall is behind it.
        let camera = Camera { from: Vec3::new(1.2, 1.3, -1.6), at: PLACE, fov_y: 37.0_f32.to_radians() };
        let quarter = args.size / 4;
        let start = Instant::now();
        let large = trace_backdrop(&stage.baked, &camera, 4 * quarter)?;
        let stops = exposure(&large);
        let half = halved(&large)?;
        let backdrops = [large, half.clone(), halved(&half)?];
        let demo = Self { context, stage, object, camera, out: args.out.clone(), quarter, backdrops, stops };
        let (rgb, side) = (&demo.backdrops[0].rgb, 4 * quarter);
        let layers = ExrLayers { width: side, height: side, rgb, alpha: None, groups: &[] };
        write_exr(&demo.out.join("backdrop.exr"), &layers)?;
        demo.write("backdrop.png", &to_srgb8(&demo.backdrops[0], stops)?)?;
        tell(
            start.elapsed().as_secs_f64(),
            "backdrop.exr, .png: the room as the path tracer sees it, without the object",
        )?;
        Ok(demo)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.out.join(name)
    }

    fn write(&self, name: &str, picture: &RgbaImage) -> Result<()> {
        write_png(&self.path(name), picture.width(), picture.height(), picture.as_raw())
    }

    /// Lights the object; writes `NAME.exr` and, over the backdrop, `NAME.png`.
    fn lit(&self, name: &str, side: u32, what: (Technique, MaterialChoice, Paper)) -> Result<(Frame, RgbaImage)> {
        self.lit_in(&self.stage.hierarchy, name, side, what)
    }

    /// The same in another hierarchy.
    fn lit_in(
        &self,
        hierarchy: &Hierarchy,
        name: &str,
        side: u32,
        (technique, material, paper): (Technique, MaterialChoice, Paper),
    ) -> Result<(Frame, RgbaImage)> {
        let settings = Settings {
            technique,
            material,
            paper,
            width: side,
            height: side,
            microbuffer: MICROBUFFER,
            ..Settings::default()
        };
        let frame = stage::render(&self.context, hierarchy, &self.object, &self.camera, settings)?;
        let composite = compose(&frame, &self.camera, Backdrop::default());
        let path = self.path(&format!("{name}.exr"));
        render::write_frame(&path, &frame, &self.camera, &composite, 0.0, ToneCurve::Srgb)?;
        let picture = self.in_the_room(&stage::image_of(&frame)?)?;
        self.write(&format!("{name}.png"), &picture)?;
        let rendered =
            format!("{name}.exr, .png: {side}x{side}, {technique}, {} pixels lit", frame.stats.covered_pixels);
        tell(frame.stats.wall_ms / 1e3, &rendered)?;
        Ok((frame, picture))
    }

    /// An image of the object over the backdrop, exposed.
    fn in_the_room(&self, image: &Image) -> Result<RgbaImage> {
        to_srgb8(&self.over(image)?, self.stops)
    }

    fn over(&self, image: &Image) -> Result<Image> {
        let same = |backdrop: &&Image| backdrop.width == image.width;
        let backdrop = self.backdrops.iter().find(same).map_or(&[][..], |backdrop| &backdrop.rgb);
        let behind = |n: usize| backdrop.get(n).copied().unwrap_or_default();
        let over = |n: usize| if image.alpha[n] > 0.5 { image.rgb[n] } else { behind(n) };
        Image::opaque(image.width, image.height, (0..image.rgb.len()).map(over).collect())
    }

    /// The large picture: the object's own materials in the room.
    fn large(&self, technique: Technique) -> Result<Vec<Tile>> {
        let file = (technique, MaterialChoice::File, Paper::default());
        let (frame, _) = self.lit(&format!("{technique}-file"), 4 * self.quarter, file)?;
        let shown = halved(&self.over(&stage::image_of(&frame)?)?)?;
        let room = to_srgb8(&self.backdrops[1], self.stops)?;
        Ok(vec![
            Tile {
                image: to_srgb8(&shown, self.stops)?,
                title: format!("{technique}, its own materials"),
                caption: format!("{technique}-file.png, {:.2} s", frame.stats.wall_ms / 1e3),
            },
            Tile { image: room, title: "the room alone".into(), caption: "backdrop.png, path-traced".into() },
        ])
    }

    /// Ours beside the truth with a map of its error; the paper's way, which takes longer, in a quarter of the pixels.
    fn beside_the_truth(
        &self,
        technique: Technique,
        name: &str,
        material: MaterialChoice,
        range: f32,
    ) -> Result<Vec<Tile>> {
        let mut tiles = Vec::new();
        for (way, prefix, side, paper) in [
            ("ours", technique.name(), 2 * self.quarter, Paper::default()),
            ("paper all", "paper", self.quarter, Paper::ALL),
        ] {
            let technique = if paper == Paper::NONE { technique } else { stage::per_pixel(&self.context) };
            let (frame, picture) = self.lit(&format!("{prefix}-{name}"), side, (technique, material, paper))?;
            let truth = self.truth(&format!("{prefix}-{name}-truth"), &frame, material)?;
            let image = stage::image_of(&frame)?;
            let metrics = compare::compare(&image, &truth)?;
            let map = difference_map(&image, &truth, Some(range))?;
            self.write(&format!("{prefix}-{name}-error.png"), &map)?;
            let numbers = format!("relative RMS {:.3}, bias {:+.3}", metrics.relative_rms_luminance, metrics.bias);
            say!("{:>9}  {prefix}-{name}-error.png: {numbers}", "")?;
            if way == "ours" {
                let caption = "path-traced; the object casts no shadow".into();
                tiles.push(Tile { image: self.in_the_room(&truth)?, title: format!("{name}: truth"), caption });
            }
            let time = format!("{side}x{side}, {:.2} s", frame.stats.wall_ms / 1e3);
            tiles.push(Tile { image: picture, title: format!("{name}: {way}"), caption: time });
            tiles.push(Tile { image: map, title: format!("{name}: error of {way}"), caption: numbers });
        }
        Ok(tiles)
    }

    /// The truth at a frame's pixels, written as EXR and, over the backdrop, as PNG.
    fn truth(&self, name: &str, frame: &Frame, material: MaterialChoice) -> Result<Image> {
        let start = Instant::now();
        let truth = self.stage.truth(frame, &self.camera, material, TRUTH_SAMPLES)?;
        let (width, height) = (truth.width, truth.height);
        let layers = ExrLayers { width, height, rgb: &truth.rgb, alpha: Some(&truth.alpha), groups: &[] };
        write_exr(&self.path(&format!("{name}.exr")), &layers)?;
        self.write(&format!("{name}.png"), &self.in_the_room(&truth)?)?;
        tell(
            start.elapsed().as_secs_f64(),
            &format!("{name}.exr, .png: path-traced, {TRUTH_SAMPLES} samples a pixel"),
        )?;
        Ok(truth)
    }

    /// The scan with the range of a camera of 8 bits, and expanded from one HDR photo of a part of the room; the object
    /// lit by both and by the true scan.
    fn in_low_range(&self, technique: Technique) -> Result<Vec<Tile>> {
        let start = Instant::now();
        let truth = &self.stage.cloud;
        let alpha = scenes::exposure(truth);
        let low = scenes::low(truth, alpha);
        let photo = scenes::photo(&self.stage.baked, &scenes::TOY_ROOM_PHOTO);
        let picture = Image::opaque(photo.width, photo.height, photo.rgb.clone())?;
        self.write("photo.png", &to_srgb8(&picture, self.stops)?)?;
        let options = expansion::Options { shot_size: SHOT_SIZE, ..expansion::Options::default() };
        let inputs = expansion::Inputs { cloud: &low, photo: Some(&photo), network: None };
        let expanded = expand::with_progress(inputs, &options)?;
        let found = expanded.report.alpha.unwrap_or_default();
        let over = expanded.report.over_exposed;
        tell(
            start.elapsed().as_secs_f64(),
            &format!("expanded {over} over-exposed points from photo.png; exposure {found:.3}, truth {alpha:.3}"),
        )?;
        let side = 2 * self.quarter;
        let lit_by = |name: &str, colors: &[Vec3]| {
            let scaled = colors.iter().map(|color| *color / alpha).collect();
            let cloud = Cloud { colors: scaled, ..truth.clone() };
            let (hierarchy, _) = hierarchy::build(&cloud, &BuildOptions::default())?;
            self.lit_in(&hierarchy, name, side, (technique, MaterialChoice::Diffuse(0.7), Paper::default()))
        };
        let true_colors: Vec<Vec3> = truth.colors.iter().map(|color| *color * alpha).collect();
        let (reference, reference_picture) = lit_by("range-true", &true_colors)?;
        let reference = stage::image_of(&reference)?;
        let mut tiles = Vec::new();
        for (name, title, colors) in [
            ("range-low", "low dynamic range scan", &low.colors),
            ("range-expanded", "the same scan, expanded", &expanded.colors),
        ] {
            let (frame, picture) = lit_by(name, colors)?;
            let metrics = compare::compare(&stage::image_of(&frame)?, &reference)?;
            let caption = format!("RMS {:.4}, bias {:+.3}", metrics.relative_rms_luminance, metrics.bias);
            say!("{:>9}  {name}: {caption} against range-true", "")?;
            tiles.push(Tile { image: picture, title: title.into(), caption });
        }
        let caption = "what both are compared with".into();
        tiles.push(Tile { image: reference_picture, title: "the true scan".into(), caption });
        let picture = to_srgb8(&picture, self.stops)?;
        let (width, height) = (side, side * photo.height / photo.width);
        let picture = image::imageops::resize(&picture, width, height, image::imageops::FilterType::Triangle);
        let caption = "photo.png, all that is known of the lights".into();
        tiles.push(Tile { image: picture, title: "HDR photo".into(), caption });
        Ok(tiles)
    }

    /// The same picture by each technique, at equal size, with times against classic's.
    fn by_technique(&self, techniques: &[Technique]) -> Result<Vec<Tile>> {
        let mut tiles = Vec::new();
        let mut first: Option<Frame> = None;
        for &technique in techniques {
            let name = format!("{technique}-half");
            let file = (technique, MaterialChoice::File, Paper::default());
            let (frame, picture) = self.lit(&name, 2 * self.quarter, file)?;
            let mut caption = format!("{:.2} s", frame.stats.wall_ms / 1e3);
            if let Some(classic) = &first {
                let same = if classic.rgba == frame.rgba {
                    "equal to the byte".into()
                } else {
                    let metrics = compare::compare(&stage::image_of(&frame)?, &stage::image_of(classic)?)?;
                    format!("differs by {:.3} (relative RMS)", metrics.relative_rms_luminance)
                };
                caption = format!("{caption}, {:.2} of classic; {same}", frame.stats.wall_ms / classic.stats.wall_ms);
                say!("{:>9}  {technique}: {caption}", "")?;
            }
            tiles.push(Tile { image: picture, title: technique.to_string(), caption });
            first.get_or_insert(frame);
        }
        Ok(tiles)
    }
}
