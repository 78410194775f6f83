//! `relume demo`: a room and an object in code, lit by every technique and beside the truth.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use image::RgbaImage;
use rayon::prelude::*;

use super::stage::{self, Stage};
use super::{render, values};
use crate::compare::{self, Image, Metrics, Tile, contact_sheet, difference_map, luminance, to_srgb8};
use crate::formats::image::{ExrLayers, write_exr, write_png};
use crate::frames::{Frame, MaterialChoice, Paper, Settings, Technique};
use crate::gpu::{Context, ContextOptions};
use crate::reference::bake::{BakeOptions, BakedRoom};
use crate::reference::rooms::{Rectangle, Room, toy_room};
use crate::reference::shapes::trophy;
use crate::scene::{Camera, Object};
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder of the pictures; made where it is missing
    #[arg(long, value_name = "DIR", default_value = "relume-demo")]
    out: PathBuf,
    /// Side of the large pictures, pixels; comparisons have half of it
    #[arg(long, value_name = "PIXELS", default_value_t = 512, value_parser = clap::value_parser!(u32).range(32..=2048))]
    size: u32,
}

/// Points of the scan.
const POINTS: usize = 305_000;
const MICROBUFFER: u32 = 24;
/// Samples a pixel of the truth, of the BRDF and of the lamps each: noise of about 1 %.
const TRUTH_SAMPLES: u32 = 256;
/// Where the object stands: its own origin is in its middle.
const PLACE: Vec3 = Vec3::new(0.0, 1.0, 0.0);
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
    /// Pixels along a side of comparisons; large pictures have twice as many.
    half: u32,
    /// The room without the object, large and halved.
    backdrop: Image,
    half_backdrop: Image,
    /// Exposure of all pictures.
    stops: f32,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let start = Instant::now();
    std::fs::create_dir_all(&args.out).map_err(|e| Error::file(&args.out, format!("cannot be made: {e}")))?;
    values::check_output(&args.out.join("contact.png"), &["png"])?;
    let context = Context::new(&ContextOptions::default())?;
    println!("device: {}", context.capabilities.name);
    let techniques = stage::techniques(&context);
    let demo = Demo::new(context, args)?;

    let mut tiles = demo.large(*techniques.last().unwrap_or(&Technique::Classic))?;
    for (name, material, range) in TRUTHS {
        tiles.extend(demo.beside_the_truth(*techniques.last().unwrap_or(&Technique::Classic), name, material, range)?);
    }
    tiles.extend(demo.by_technique(&techniques)?);
    let title = format!(
        "relume demo: {} points, {} nodes, {MICROBUFFER}x{MICROBUFFER} micro-buffers, {}",
        demo.stage.build.points, demo.stage.build.nodes_after, demo.context.capabilities.name
    );
    let sheet = contact_sheet(&title, 5, &tiles)?;
    demo.write("contact.png", &sheet)?;
    println!(
        "{}: the contact sheet of all pictures; {:.1} s in all",
        args.out.join("contact.png").display(),
        start.elapsed().as_secs_f64()
    );
    Ok(())
}

/// The toy room with a pedestal below the object.
fn room_with_pedestal(object: &Object) -> Room {
    let top = object.bounds().0.y;
    let (low, side) = (Vec3::new(PLACE.x - 0.32, 0.0, PLACE.z - 0.32), 0.64);
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

/// The same with half as many pixels a side; alpha is rounded, as masks are.
fn halved(image: &Image) -> Result<Image> {
    let (width, height) = (image.width / 2, image.height / 2);
    let mean = |n: u32| {
        let at = (2 * (n / width) * image.width + 2 * (n % width)) as usize;
        let row = image.width as usize;
        [at, at + 1, at + row, at + row + 1].iter().map(|n| image.rgb[*n]).sum::<Vec3>() / 4.0
    };
    Image::opaque(width, height, (0..width * height).map(mean).collect())
}

/// Stops that bring the mean logarithm of luminance to that of middle grey.
fn exposure(image: &Image) -> f32 {
    let mean = image.rgb.iter().map(|c| luminance(*c).max(1e-4).log2()).sum::<f32>() / image.rgb.len() as f32;
    0.18_f32.log2() - mean
}

/// A line about a step.
fn say(seconds: f64, what: &str) {
    println!("{seconds:>7.2} s  {what}");
}

fn caption(metrics: &Metrics) -> String {
    format!("relative RMS {:.3}, bias {:+.3}", metrics.relative_rms_luminance, metrics.bias)
}

impl Demo {
    fn new(context: Arc<Context>, args: &Args) -> Result<Self> {
        let object = stage::placed(trophy(), PLACE);
        let options = BakeOptions { texel: 0.03, direct_samples: 48, bounced_samples: 512, ..BakeOptions::default() };
        let stage = Stage::new(room_with_pedestal(&object), POINTS, &options)?;
        say(stage.bake_s, "baked the room's light by path tracing");
        say(stage.scan_s, &format!("scanned it into {} points", stage.build.points));
        say(stage.build_s, &format!("built a hierarchy of {} nodes", stage.build.nodes_after));
        // Lamp and window lie behind the eye, one on either side: both show in the metal.
        let camera = Camera { from: Vec3::new(1.45, 1.3, -1.0), at: PLACE, fov_y: 40.0_f32.to_radians() };
        let half = args.size / 2;
        let start = Instant::now();
        let backdrop = trace_backdrop(&stage.baked, &camera, 2 * half)?;
        let half_backdrop = halved(&backdrop)?;
        let stops = exposure(&backdrop);
        let demo = Self { context, stage, object, camera, out: args.out.clone(), half, backdrop, half_backdrop, stops };
        let (rgb, side) = (&demo.backdrop.rgb, demo.backdrop.width);
        let layers = ExrLayers { width: side, height: side, rgb, alpha: None, groups: &[] };
        write_exr(&demo.out.join("backdrop.exr"), &layers)?;
        demo.write("backdrop.png", &to_srgb8(&demo.backdrop, stops)?)?;
        say(start.elapsed().as_secs_f64(), "backdrop.exr, .png: the room as the path tracer sees it, without the object");
        Ok(demo)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.out.join(name)
    }

    fn write(&self, name: &str, picture: &RgbaImage) -> Result<()> {
        write_png(&self.path(name), picture.width(), picture.height(), picture.as_raw())
    }

    /// Lights the object; writes `NAME.exr` and, over the backdrop, `NAME.png`.
    fn lit(
        &self,
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
        let frame = stage::render(&self.context, &self.stage.hierarchy, &self.object, &self.camera, settings)?;
        render::write_frame(Path::new(&self.path(&format!("{name}.exr"))), &frame, &self.camera, 0.0)?;
        let picture = self.in_the_room(&stage::image_of(&frame)?)?;
        self.write(&format!("{name}.png"), &picture)?;
        let rendered = format!("{name}.exr, .png: {side}x{side}, {technique}, {} pixels lit", frame.stats.covered_pixels);
        say(frame.stats.wall_ms / 1e3, &rendered);
        Ok((frame, picture))
    }

    /// An image of the object over the backdrop, exposed.
    fn in_the_room(&self, image: &Image) -> Result<RgbaImage> {
        to_srgb8(&self.over(image)?, self.stops)
    }

    fn over(&self, image: &Image) -> Result<Image> {
        let backdrop = if image.width == self.backdrop.width { &self.backdrop } else { &self.half_backdrop };
        let over = |n: usize| if image.alpha[n] > 0.5 { image.rgb[n] } else { backdrop.rgb[n] };
        Image::opaque(image.width, image.height, (0..image.rgb.len()).map(over).collect())
    }

    /// The large pictures: the object's own materials, then others.
    fn large(&self, technique: Technique) -> Result<Vec<Tile>> {
        let mut tiles = Vec::new();
        let variants = [
            ("file", MaterialChoice::File, "its own materials"),
            ("diffuse", MaterialChoice::Diffuse(0.7), "diffuse, albedo 0.7"),
            ("metal", MaterialChoice::Metal(0.25), "metal, GGX alpha 0.25"),
        ];
        for (name, material, title) in variants {
            let name = format!("{technique}-{name}");
            let (frame, _) = self.lit(&name, 2 * self.half, (technique, material, Paper::default()))?;
            let shown = halved(&self.over(&stage::image_of(&frame)?)?)?;
            tiles.push(Tile {
                image: to_srgb8(&shown, self.stops)?,
                title: title.into(),
                caption: format!("{name}.png, {:.2} s; path-traced backdrop", frame.stats.wall_ms / 1e3),
            });
        }
        tiles.push(Tile {
            image: to_srgb8(&self.half_backdrop, self.stops)?,
            title: "the room alone".into(),
            caption: "backdrop.png, path-traced".into(),
        });
        // What every pixel's micro-buffer is turned to.
        let (normal, side) = (self.normals(technique)?, self.half);
        tiles.push(Tile {
            image: RgbaImage::from_raw(side, side, normal).unwrap_or_default(),
            title: "normals".into(),
            caption: "layer N of the .exr".into(),
        });
        Ok(tiles)
    }

    /// The object's normals as colours, half size.
    fn normals(&self, technique: Technique) -> Result<Vec<u8>> {
        let settings = Settings { technique, width: self.half, height: self.half, ..Settings::default() };
        let mut renderer = crate::frames::Renderer::new(
            &self.context,
            &self.stage.hierarchy,
            &self.object,
            None,
            settings,
        )?;
        let color = |(position, normal): ([f32; 4], [f32; 4])| {
            let byte = |v: f32| (127.5 * (v + 1.0)).round() as u8;
            [byte(normal[0]), byte(normal[1]), byte(normal[2]), if position[3] > 0.0 { 255 } else { 0 }]
        };
        Ok(renderer.receivers(&self.camera)?.into_iter().flat_map(color).collect())
    }

    /// Ours and the paper's way beside the truth, with maps of their errors.
    fn beside_the_truth(
        &self,
        technique: Technique,
        name: &str,
        material: MaterialChoice,
        range: f32,
    ) -> Result<Vec<Tile>> {
        let (frame, picture) = self.lit(&format!("half-{name}"), self.half, (technique, material, Paper::default()))?;
        let (paper_frame, paper_picture) =
            self.lit(&format!("paper-{name}"), self.half, (technique, material, Paper::ALL))?;
        let start = Instant::now();
        let truth = self.stage.truth(&frame, &self.camera, material, TRUTH_SAMPLES)?;
        let layers = ExrLayers {
            width: truth.width,
            height: truth.height,
            rgb: &truth.rgb,
            alpha: Some(&truth.alpha),
            groups: &[],
        };
        write_exr(&self.path(&format!("truth-{name}.exr")), &layers)?;
        let truth_picture = self.in_the_room(&truth)?;
        self.write(&format!("truth-{name}.png"), &truth_picture)?;
        let seconds = start.elapsed().as_secs_f64();
        say(seconds, &format!("truth-{name}.exr, .png: path-traced, {TRUTH_SAMPLES} samples a pixel"));

        let tile = |image, title: String, caption: String| Tile { image, title, caption };
        let mut tiles = vec![tile(truth_picture, format!("{name}: truth"), "path-traced; the object casts no shadow".into())];
        let both = [("ours", "error", &frame, picture), ("paper all", "paper-error", &paper_frame, paper_picture)];
        for (way, file, frame, picture) in both {
            let image = stage::image_of(frame)?;
            let metrics = compare::compare(&image, &truth)?;
            let map = difference_map(&image, &truth, Some(range))?;
            self.write(&format!("{file}-{name}.png"), &map)?;
            println!("{:>9}  {file}-{name}.png: {name}, {way}: {}", "", caption(&metrics));
            tiles.push(tile(picture, format!("{name}: {way}"), format!("{:.2} s", frame.stats.wall_ms / 1e3)));
            tiles.push(tile(map, format!("{name}: error of {way}"), caption(&metrics)));
        }
        Ok(tiles)
    }

    /// The same picture by each technique, at equal size, with times against classic's.
    fn by_technique(&self, techniques: &[Technique]) -> Result<Vec<Tile>> {
        let mut tiles = Vec::new();
        let mut first: Option<Frame> = None;
        for &technique in techniques {
            let name = format!("{technique}-half");
            let (frame, picture) =
                self.lit(&name, self.half, (technique, MaterialChoice::File, Paper::default()))?;
            let mut caption = format!("{:.2} s", frame.stats.wall_ms / 1e3);
            if let Some(classic) = &first {
                let same = if classic.rgba == frame.rgba { "equal to the byte" } else { "NOT equal" };
                caption = format!("{caption}, {:.2} of classic; {same}", frame.stats.wall_ms / classic.stats.wall_ms);
                println!("{:>9}  {technique}: {caption}", "");
            }
            tiles.push(Tile { image: picture, title: technique.to_string(), caption });
            first.get_or_insert(frame);
        }
        Ok(tiles)
    }
}
