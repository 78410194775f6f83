//! `relume render`: an object in the light of a cloud.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::{Affine3A, DVec3, Vec3};
use serde::Serialize;

use super::backdrop::{Around, BackdropArgs};
use super::output::say;
use super::{progress, values};
use crate::formats::cloud::{CloudOptions, Up};
use crate::formats::image::{ExrGroup, ExrLayers};
use crate::formats::tone::ToneCurve;
use crate::formats::{bsh, cloud, image, object, whole};
use crate::frames::composite::Composite;
use crate::frames::{Frame, MaterialChoice, Paper, Quality, Renderer, Settings, Technique};
use crate::gpu::recorder::PassProfile;
use crate::gpu::{Capture, Context, ContextOptions};
use crate::preprocess::hierarchy::{self, BuildOptions, Hierarchy};
use crate::preprocess::point_chunks::PointChunks;
use crate::scene::{Camera, Cloud, Object, Placement};
use crate::trace::Trace;
use crate::{Error, Result};

/// Up axis of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum UpAxis {
    /// +Y
    Y,
    /// +Z, turned to +Y
    Z,
    /// -Y, as in scans of depth cameras, turned to +Y
    #[value(name = "-y")]
    MinusY,
}

impl From<UpAxis> for Up {
    fn from(axis: UpAxis) -> Self {
        match axis {
            UpAxis::Y => Self::Y,
            UpAxis::Z => Self::Z,
            UpAxis::MinusY => Self::MinusY,
        }
    }
}

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Scene, whose values stand for flags that are not given
    #[arg(long, value_name = "FILE.toml")]
    scene: Option<PathBuf>,
    /// Cloud (.ply, .pcd, .las, .laz) or saved hierarchy (.bsh)
    #[arg(long, value_name = "FILE")]
    cloud: PathBuf,
    /// Object: .gltf, .glb, .obj or .ply
    #[arg(long, value_name = "FILE")]
    object: PathBuf,
    /// Where the object's origin goes, in the cloud's coordinates [default: where the file puts it]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    object_at: Option<DVec3>,
    /// Scale about the object's own origin
    #[arg(long, value_name = "S", value_parser = values::positive, allow_hyphen_values = true, default_value = "1")]
    object_scale: f64,
    /// Turn about the object's own +Y and origin, degrees
    #[arg(long, value_name = "DEG", value_parser = values::finite, default_value = "0", allow_hyphen_values = true)]
    object_turn: f64,
    /// Where the object's +Y points, for surfaces that are not level
    #[arg(long, value_name = "X,Y,Z", value_parser = values::direction, allow_hyphen_values = true, default_value = "0,1,0")]
    object_up: DVec3,
    /// The cloud's up axis
    #[arg(long, value_enum, default_value_t = UpAxis::Y, allow_hyphen_values = true)]
    up: UpAxis,
    /// Where estimated normals look, when the cloud does not know where the scanner stood [default: the object]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    towards: Option<DVec3>,
    /// Eye [default: the object is framed]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    camera_from: Option<DVec3>,
    /// Point in the middle of the image [default: the object's middle]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    camera_at: Option<DVec3>,
    /// Vertical field of view, degrees [default: 30]
    #[arg(long, value_name = "DEG", value_parser = values::field_of_view, allow_hyphen_values = true)]
    fov: Option<f64>,
    /// Image size
    #[arg(long, value_name = "WxH", value_parser = values::size, allow_hyphen_values = true, default_value = "512x512")]
    size: (u32, u32),
    /// Technique, sizes and thresholds together: draft, normal or high
    #[arg(long, default_value = "normal")]
    quality: Quality,
    /// classic, mipmapped, hybrid or shared [default: by --quality; hybrid with --paper; classic where the device lacks
    /// what the others need]
    #[arg(long)]
    technique: Option<Technique>,
    /// Micro-pixels along a side: even, 8 to 64 [default: by --quality]
    #[arg(long, value_name = "N", value_parser = values::microbuffer, allow_hyphen_values = true)]
    microbuffer: Option<u32>,
    /// Follow the paper to the letter in these parts: image, coverage, weights, cut, or all
    #[arg(long, value_name = "PARTS", value_parser = values::paper)]
    paper: Option<Paper>,
    /// Solid angle at which nodes are rasterised, in micro-pixels [default: by --quality]
    #[arg(long, value_name = "OMEGAS", value_parser = values::positive, allow_hyphen_values = true)]
    stop: Option<f64>,
    /// Solid angle at which hybrid leaves the geometry shader, in micro-pixels
    #[arg(long, value_name = "OMEGAS", value_parser = values::positive, allow_hyphen_values = true, default_value = "32")]
    switch: f64,
    /// Do without buffers of their own for lobes that are narrower than a few micro-pixels
    #[arg(long)]
    no_sharp: bool,
    /// Far field where no point covers: lat-long .exr or .hdr [default: black]
    #[arg(long, value_name = "FILE")]
    environment: Option<PathBuf>,
    /// file, diffuse:ALBEDO or metal:ALPHA
    #[arg(long, value_parser = values::material, default_value = "file")]
    material: MaterialChoice,
    /// Most device memory, MiB
    #[arg(long, value_name = "MIB", default_value_t = Settings::DEFAULT_BUDGET >> 20,
          allow_negative_numbers = true, value_parser = clap::value_parser!(u64).range(1..=1 << 24))]
    memory_budget: u64,
    /// Part of the device's name [default: the best]
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// Run with the validation layer; its messages are errors
    #[arg(long)]
    validation: bool,
    /// Image: .exr (linear, with layers) or .png
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Exposure of a PNG in stops
    #[arg(long, value_name = "STOPS", value_parser = values::finite, default_value = "0", allow_hyphen_values = true)]
    exposure: f64,
    #[command(flatten)]
    backdrop: BackdropArgs,
    /// Times and counts
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
    /// Time line of the CPU and the GPU, for Perfetto and chrome://tracing
    #[arg(long, value_name = "FILE.json")]
    trace: Option<PathBuf>,
    /// Capture the frame for RenderDoc, which relume must have been started under (tools/capture does)
    #[arg(long)]
    capture: bool,
}

/// Contents of `--stats`.
#[derive(Serialize)]
struct Stats<'a> {
    device: &'a str,
    driver: &'a str,
    technique: Technique,
    width: u32,
    height: u32,
    microbuffer: u32,
    paper: Paper,
    material: MaterialChoice,
    covered_pixels: u64,
    shared_tiles: u64,
    per_pixel: u64,
    sharp_lobes: u64,
    points: Option<usize>,
    nodes_before_pruning: Option<usize>,
    nodes: usize,
    visited_pairs: u64,
    rasterised_nodes: u64,
    pairs_per_covered_pixel: f64,
    tiles: u64,
    splits: u64,
    peak_feedback_bytes: u64,
    microbuffer_bytes: u64,
    memory_budget_bytes: u64,
    device_bytes_peak: u64,
    frame_wall_ms: f64,
    total_wall_s: f64,
    loading_s: &'a [(&'static str, f64)],
    passes: &'a std::collections::BTreeMap<&'static str, PassProfile>,
}

/// Seconds of named steps, which are spans of the trace.
struct Clock {
    steps: Vec<(&'static str, f64)>,
    trace: Trace,
}

impl Clock {
    fn time<T>(&mut self, step: &'static str, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let start = Instant::now();
        let _span = self.trace.span(step);
        let result = work();
        self.steps.push((step, start.elapsed().as_secs_f64()));
        result
    }
}

/// A hierarchy and where it comes from.
struct LoadedHierarchy {
    hierarchy: Hierarchy,
    points: Option<usize>,
    nodes_before: Option<usize>,
    origin: DVec3,
    /// The scan for the backdrop, if it is asked for.
    chunks: Option<Arc<PointChunks>>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let start = Instant::now();
    values::check_output(&args.out, &["exr", "png"])?;
    args.backdrop.check(args.environment.is_some())?;
    if let Some(stats) = &args.stats {
        values::check_output(stats, &["json"])?;
    }
    if let Some(trace) = &args.trace {
        values::check_output(trace, &["json"])?;
        if args.stats.as_ref() == Some(trace) {
            return Err(Error::Argument("--stats and --trace name the same file".into()));
        }
    }
    let mut capture = args.capture.then(Capture::attach).transpose()?;
    let trace = if args.trace.is_some() { Trace::new() } else { Trace::default() };
    let mut clock = Clock { steps: Vec::new(), trace: trace.clone() };
    let bar = progress::spinner("reading");
    let object = clock.time("object", || object::load(&args.object))?;
    let far_field =
        args.environment.as_ref().map(|path| clock.time("far field", || image::read_far_field(path))).transpose()?;
    let context = clock.time("device", || {
        let options = ContextOptions { device: args.device.clone(), validation: args.validation };
        Context::traced(&options, trace.clone())
    })?;
    let technique = pick_technique(args, &context);

    // The object's place is in the file's coordinates, which a cloud with large ones is not kept in: the cloud comes
    // first, and its normals look at the object.
    let loaded = load_hierarchy(args, &object, &mut clock)?;
    let place = placement(args, loaded.origin);
    let object = object.transformed(place);
    let camera = camera(args, &object, loaded.origin)?;
    let quality = args.quality.settings();
    let settings = Settings {
        technique,
        width: args.size.0,
        height: args.size.1,
        microbuffer: args.microbuffer.unwrap_or(quality.microbuffer),
        paper: args.paper.unwrap_or_default(),
        material: args.material,
        stop: args.stop.unwrap_or(quality.stop),
        switch: args.switch,
        sharp: quality.sharp && !args.no_sharp,
        parallax: quality.parallax,
        memory_budget: args.memory_budget << 20,
        pair_capacity: None,
    };
    let mut renderer = clock.time("upload and pipelines", || {
        Renderer::new(&context, &loaded.hierarchy, &object, far_field.as_ref(), settings)
    })?;
    bar.finish_and_clear();
    let bar = progress::bar("lighting", 1);
    let mut light = || {
        renderer.render(&camera, &mut |done, total| {
            bar.set_length(total);
            bar.set_position(done);
        })
    };
    let (frame, captured) = match &mut capture {
        None => (light()?, None),
        Some(capture) => capture.frame(light).map(|(frame, file)| (frame, Some(file)))?,
    };
    bar.finish_and_clear();
    // Its memory is the backdrop's now.
    drop(renderer);
    let around = Around { points: loaded.chunks.clone(), far_field: far_field.as_ref(), object: &object };
    let points = clock.time("backdrop", || args.backdrop.render_points(&context, &around, &camera, &settings))?;
    let composite = args.backdrop.compose(&frame, &camera, points.as_ref(), &around);
    if frame.stats.covered_pixels == 0 {
        tracing::warn!("the camera does not see the object");
    }
    let messages = context.validation.messages();
    if let Some(first) = messages.first() {
        return Err(Error::Device(format!("{} validation messages, the first: {first}", messages.len())));
    }

    let span = trace.span("writing");
    write_frame(&args.out, &frame, &camera, &composite, args.exposure as f32, args.backdrop.tone)?;
    drop(span);
    if let Some(path) = &args.stats {
        let stats = &frame.stats;
        let mut profile = stats.profile.clone();
        if let Some(points) = &points {
            profile.add(&points.profile);
        }
        let passes = profile.passes;
        let report = Stats {
            device: &context.capabilities.name,
            driver: &context.capabilities.driver,
            technique,
            width: frame.width,
            height: frame.height,
            microbuffer: settings.microbuffer,
            paper: settings.paper,
            material: settings.material,
            covered_pixels: stats.covered_pixels,
            shared_tiles: stats.tiles,
            per_pixel: stats.per_pixel,
            sharp_lobes: stats.lobes,
            points: loaded.points,
            nodes_before_pruning: loaded.nodes_before,
            nodes: loaded.hierarchy.len(),
            visited_pairs: stats.visited_pairs,
            rasterised_nodes: stats.rasterised_nodes,
            pairs_per_covered_pixel: stats.visited_pairs as f64 / stats.covered_pixels.max(1) as f64,
            tiles: stats.batches,
            splits: stats.splits,
            peak_feedback_bytes: stats.peak_feedback_bytes,
            microbuffer_bytes: stats.microbuffer_bytes,
            memory_budget_bytes: settings.memory_budget,
            device_bytes_peak: stats.device_bytes_peak,
            frame_wall_ms: stats.wall_ms,
            total_wall_s: start.elapsed().as_secs_f64(),
            loading_s: &clock.steps,
            passes: &passes,
        };
        write_json(path, &report)?;
    }
    if let Some(path) = &args.trace {
        trace.write(path)?;
    }
    if let Some(file) = captured {
        say!("capture: {}", file.display())?;
    }
    say!(
        "{}: {} pixels lit by {} in {:.0} ms on {}",
        args.out.display(),
        frame.stats.covered_pixels,
        technique,
        frame.stats.wall_ms,
        context.capabilities.name
    )?;
    Ok(())
}

/// What was asked for; else what the quality has, or classic with one line about why.
fn pick_technique(args: &Args, context: &Context) -> Technique {
    args.technique.unwrap_or_else(|| match context.why_no_feedback() {
        None if args.paper.is_some() => Technique::Hybrid,
        None => args.quality.settings().technique,
        Some(why) => {
            tracing::warn!("{why}");
            Technique::Classic
        }
    })
}

/// The object's transform into the space of a cloud whose `origin` was subtracted.
fn placement(args: &Args, origin: DVec3) -> Affine3A {
    let Args { object_at: at, object_scale: scale, object_turn: turn, object_up: up, .. } = *args;
    Placement { at, scale, turn, up }.world_from_object(origin)
}

fn camera(args: &Args, object: &Object, origin: DVec3) -> Result<Camera> {
    let (low, high) = object.bounds();
    let framing = Camera::framing(0.5 * (low + high), 0.5 * (high - low).length());
    let camera = Camera {
        from: args.camera_from.map_or(framing.from, |p| (p - origin).as_vec3()),
        at: args.camera_at.map_or(framing.at, |p| (p - origin).as_vec3()),
        fov_y: args.fov.map_or(framing.fov_y, |degrees| degrees.to_radians() as f32),
    };
    if camera.from.distance(camera.at) <= 1e-6 * (1.0 + camera.at.length()) {
        let problem = if args.camera_from.is_some() && args.camera_at.is_some() {
            "--camera-from and --camera-at are the same point"
        } else if args.camera_from.is_some() || args.camera_at.is_some() {
            "--camera-from and --camera-at are the same point, one of them being the default; give both"
        } else {
            "the object is too small for its distance from the origin to be framed; give --camera-from and --camera-at"
        };
        return Err(Error::Argument(problem.into()));
    }
    Ok(camera)
}

fn load_hierarchy(args: &Args, object: &Object, clock: &mut Clock) -> Result<LoadedHierarchy> {
    let saved = args.cloud.extension().is_some_and(|e| e.eq_ignore_ascii_case("bsh"));
    if saved {
        let (hierarchy, info) = clock.time("hierarchy file", || bsh::read_with_info(&args.cloud))?;
        let points = usize::try_from(info.points).ok();
        let chunks = args.backdrop.shows_points().then(|| PointChunks::of_hierarchy(&hierarchy)).transpose()?;
        return Ok(LoadedHierarchy {
            hierarchy,
            points,
            nodes_before: None,
            origin: info.origin,
            chunks: chunks.map(Arc::new),
        });
    }
    // The object's middle, without its place, which f32 may not hold: the cloud's origin is not known yet.
    let turned = object.clone().transformed(placement(args, args.object_at.unwrap_or_default()));
    let (low, high) = turned.bounds();
    let middle = (0.5 * (low + high)).as_dvec3() + args.object_at.unwrap_or_default();
    let towards = args.towards.unwrap_or(middle);
    let cloud = clock.time("cloud", || load_cloud(&args.cloud, args.up, Some(towards)))?;
    let (hierarchy, report) = clock.time("hierarchy", || hierarchy::build(&cloud, &BuildOptions::default()))?;
    let chunks = args.backdrop.shows_points().then(|| PointChunks::new(&cloud)).transpose()?;
    Ok(LoadedHierarchy {
        hierarchy,
        chunks: chunks.map(Arc::new),
        points: Some(report.points),
        nodes_before: Some(report.nodes_before),
        origin: cloud.origin,
    })
}

/// Reads a cloud; `towards` is where estimated normals look if the file does not know better.
pub(super) fn load_cloud(path: &Path, up: UpAxis, towards: Option<DVec3>) -> Result<Cloud> {
    cloud::load(path, &CloudOptions { up: up.into(), orient_towards: towards })
}

/// Writes an EXR with layers or a PNG, by the name's ending.
pub(super) fn write_frame(
    path: &Path,
    frame: &Frame,
    camera: &Camera,
    composite: &Composite,
    stops: f32,
    tone: ToneCurve,
) -> Result<()> {
    let three = |values: &[[f32; 4]]| values.iter().map(|v| Vec3::new(v[0], v[1], v[2])).collect::<Vec<_>>();
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        let scale = stops.exp2();
        let bytes: Vec<u8> = composite
            .rgb
            .iter()
            .zip(&composite.alpha)
            .flat_map(|(c, a)| {
                let [r, g, b] = tone.encode(*c * scale);
                [r, g, b, (a * 255.0).round() as u8]
            })
            .collect();
        return image::write_png(path, frame.width, frame.height, &bytes);
    }
    let alpha: Vec<f32> = frame.rgba.iter().map(|v| v[3]).collect();
    let position = three(&frame.position);
    let (_, _, forward) = camera.basis();
    let depth: Vec<f32> = position
        .iter()
        .zip(&alpha)
        .map(|(p, a)| if *a > 0.0 { (*p - camera.from).dot(forward) } else { 0.0 })
        .collect();
    let (albedo, normal, object) = (three(&frame.albedo), three(&frame.normal), three(&frame.rgba));
    let mut groups = vec![
        ("albedo", ExrGroup::Color(&albedo)),
        ("N", ExrGroup::Vector(&normal)),
        ("Z", ExrGroup::Scalar(&depth)),
        ("P", ExrGroup::Vector(&position)),
    ];
    if !composite.backdrop.is_empty() {
        // The lit object alone, where it is seen, and what is around and behind it.
        groups.extend([
            ("object", ExrGroup::Color(&object)),
            ("object.A", ExrGroup::Scalar(&composite.object)),
            ("backdrop", ExrGroup::Color(&composite.backdrop)),
        ]);
    }
    let (width, height) = (frame.width, frame.height);
    let (rgb, alpha) = (&composite.rgb, Some(&composite.alpha[..]));
    image::write_exr(path, &ExrLayers { width, height, rgb, alpha, groups: &groups })
}

/// Writes a report as JSON.
pub(super) fn write_json(path: &Path, report: &impl Serialize) -> Result<()> {
    whole::write(path, |file| {
        serde_json::to_writer_pretty(file, report).map_err(|e| Error::file(path, format!("cannot be written: {e}")))
    })
}
