//! `relume bench truth`: error against time for every technique and size, by images of an independent path tracer.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec3;
use serde::Serialize;

use crate::cli::output::say;
use crate::cli::{progress, render, stage, values};
use crate::compare::{Axis, Image, Metrics, Plot, Series, compare};
use crate::formats::cloud::{self, CloudOptions};
use crate::formats::{image, object};
use crate::frames::{MaterialChoice, Paper, Settings, Technique};
use crate::gpu::{Context, ContextOptions};
use crate::preprocess::hierarchy::{self, BuildOptions, Hierarchy};
use crate::scene::{Camera, Object};
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Args {
    /// Folder with toyroom/cloud_hdr.ply and sphere/ (sphere.ply, relight.json, images of it)
    #[arg(value_name = "DIR")]
    references: PathBuf,
    /// Sizes 16 and 24, diffuse and one metal, whole view
    #[arg(long)]
    quick: bool,
    /// This material alone: diffuse, ggx_a0.25, ggx_a1, ggx_a0.5 or ggx_a0.0625
    #[arg(long, value_name = "NAME", value_parser = MATERIALS.map(|(name, _)| name))]
    material: Option<String>,
    /// This view alone: whole or closeup
    #[arg(long, value_name = "NAME", value_parser = VIEWS)]
    view: Option<String>,
    /// Side of the image that is timed, pixels; errors are those at the references' own size
    #[arg(long, value_name = "PIXELS", default_value_t = 256, value_parser = clap::value_parser!(u32).range(16..=2048))]
    viewport: u32,
    /// The numbers
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
    /// Error over time of the whole view, a plot a material: FILE-MATERIAL.svg
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
}

/// Name in the references' file names, and what it is.
const MATERIALS: [(&str, MaterialChoice); 5] = [
    ("diffuse", MaterialChoice::Diffuse(0.7)),
    ("ggx_a0.25", MaterialChoice::Metal(0.25)),
    ("ggx_a1", MaterialChoice::Metal(1.0)),
    ("ggx_a0.5", MaterialChoice::Metal(0.5)),
    ("ggx_a0.0625", MaterialChoice::Metal(0.0625)),
];
const VIEWS: [&str; 2] = ["whole", "closeup"];
/// A timed frame under this is rendered again: its time is the median of [`RUNS`].
const SHORT_MS: f64 = 1000.0;
const RUNS: usize = 3;

/// One way of lighting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Way {
    name: &'static str,
    technique: Technique,
    paper: Paper,
    sharp: bool,
}

/// One frame against its reference, and the time of a larger one.
#[derive(Serialize)]
struct Point {
    view: &'static str,
    material: &'static str,
    way: &'static str,
    microbuffer: u32,
    relative_rms_luminance: f64,
    bias: f64,
    flip: f64,
    wall_ms: f64,
}

/// The object lit by a panorama at infinity, against the room.
#[derive(Serialize)]
struct Environment {
    view: &'static str,
    material: &'static str,
    relative_rms_luminance: f64,
}

/// Contents of `--json`.
#[derive(Serialize)]
struct Report {
    device: String,
    viewport: u32,
    how: &'static str,
    environment: Vec<Environment>,
    points: Vec<Point>,
}

const HOW: &str = "error: relative RMS of luminance at the size of the references; time: G-buffer to image at the \
                   viewport after a warm-up frame, the median of 3 frames below 1 s, one frame above";

/// What is rendered.
struct Scene {
    context: Arc<Context>,
    hierarchy: Hierarchy,
    object: Object,
    cameras: Vec<(&'static str, Camera)>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    if let Some(json) = &args.json {
        values::check_output(json, &["json"])?;
    }
    if let Some(plot) = &args.plot {
        values::check_output(plot, &["svg"])?;
    }
    let scene = Scene::load(args)?;
    let ways = ways(&scene.context);
    let (sizes, materials, views): (&[u32], _, _) = match args.quick {
        true => (&[16, 24], &MATERIALS[..2], &VIEWS[..1]),
        false => (&[8, 16, 24, 32, 48, 64], &MATERIALS[..], &VIEWS[..]),
    };
    let only = |wanted: &Option<String>, name: &str| wanted.as_ref().is_none_or(|wanted| wanted == name);
    let materials: Vec<_> = materials.iter().copied().filter(|(name, _)| only(&args.material, name)).collect();
    let views: Vec<_> = views.iter().copied().filter(|name| only(&args.view, name)).collect();
    let mut report = Report {
        device: scene.context.capabilities.name.clone(),
        viewport: args.viewport,
        how: HOW,
        environment: Vec::new(),
        points: Vec::new(),
    };
    say!("{}; {HOW}; viewport {}\n", report.device, args.viewport)?;
    say!(
        "{:<8} {:<12} {:<16} {:>5} {:>13} {:>8} {:>7} {:>9}",
        "view",
        "material",
        "way",
        "size",
        "relative RMS",
        "bias",
        "FLIP",
        "ms"
    )?;
    let total = views.len() * materials.len() * ways.len() * sizes.len();
    let bar = progress::bar("against the truth", total as u64);
    for &view in &views {
        for &(name, material) in &materials {
            let truth = scene.reference(args, view, name, "room")?;
            let environment = compare(&scene.reference(args, view, name, "env")?, &truth)?.relative_rms_luminance;
            report.environment.push(Environment { view, material: name, relative_rms_luminance: environment });
            say!("{view:<8} {name:<12} {:<16} {:>5} {environment:>13.4}", "environment map", "-")?;
            for &way in &ways {
                for &microbuffer in sizes {
                    let point = scene.measure(args, (view, name, material), way, microbuffer, &truth)?;
                    let Point { relative_rms_luminance, bias, flip, wall_ms, .. } = point;
                    say!(
                        "{view:<8} {name:<12} {:<16} {microbuffer:>5} {relative_rms_luminance:>13.4} {bias:>+8.4} \
                         {flip:>7.4} {wall_ms:>9.1}",
                        way.name
                    )?;
                    report.points.push(point);
                    bar.inc(1);
                    // What is done stays, should a later frame fail.
                    if let Some(json) = &args.json {
                        render::write_json(json, &report)?;
                    }
                }
            }
        }
    }
    bar.finish_and_clear();
    if let Some(path) = &args.plot {
        for (name, _) in &materials {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            report.plot(name).write(&path.with_file_name(format!("{stem}-{name}.svg")))?;
        }
    }
    Ok(())
}

/// Every technique that the device has, the best of them without buffers for narrow lobes, and the paper's variant.
fn ways(context: &Context) -> Vec<Way> {
    let techniques = stage::techniques(context);
    let way = |technique: Technique| Way { name: technique.name(), technique, paper: Paper::NONE, sharp: true };
    let mut ways: Vec<Way> = techniques.iter().map(|technique| way(*technique)).collect();
    let plain = |technique: &Technique| *technique != Technique::Shared;
    if let Some(technique) = techniques.iter().copied().rfind(plain) {
        ways.push(Way { name: "no sharp lobes", sharp: false, ..way(technique) });
        ways.push(Way { name: "paper", paper: Paper::ALL, sharp: false, ..way(technique) });
    }
    ways
}

impl Scene {
    fn load(args: &Args) -> Result<Self> {
        let bar = progress::spinner("reading");
        let context = Context::new(&ContextOptions::default())?;
        let cloud = cloud::load(&args.references.join("toyroom/cloud_hdr.ply"), &CloudOptions::default())?;
        let (hierarchy, _) = hierarchy::build(&cloud, &BuildOptions::default())?;
        let object = object::load(&args.references.join("sphere/sphere.ply"))?;
        let cameras = cameras(&args.references.join("sphere/relight.json"))?;
        bar.finish_and_clear();
        Ok(Self { context, hierarchy, object, cameras })
    }

    fn reference(&self, args: &Args, view: &str, material: &str, light: &str) -> Result<Image> {
        let path = args.references.join(format!("sphere/sphere_{view}_{material}_{light}_128.exr"));
        let read = image::read_rgba_exr(&path)?;
        Image::new(read.width, read.height, read.rgb, read.alpha)
    }

    fn measure(
        &self,
        args: &Args,
        (view, name, material): (&'static str, &'static str, MaterialChoice),
        way: Way,
        microbuffer: u32,
        truth: &Image,
    ) -> Result<Point> {
        let camera = self.cameras.iter().find(|(known, _)| *known == view).map(|(_, camera)| *camera);
        let camera = camera.ok_or_else(|| Error::Argument(format!("no camera for the view {view}")))?;
        let settings = |width, height| Settings {
            technique: way.technique,
            paper: way.paper,
            sharp: way.sharp,
            material,
            microbuffer,
            width,
            height,
            ..Settings::default()
        };
        let frame = |settings: Settings| stage::render(&self.context, &self.hierarchy, &self.object, &camera, settings);
        let image = stage::image_of(&frame(settings(truth.width, truth.height))?)?;
        let Metrics { relative_rms_luminance, bias, flip, .. } = compare(&image, truth)?;
        let mut times = Vec::new();
        while times.is_empty() || (times.len() < RUNS && times[0] < SHORT_MS) {
            times.push(frame(settings(args.viewport, args.viewport))?.stats.wall_ms);
        }
        times.sort_by(f64::total_cmp);
        let wall_ms = times[times.len() / 2];
        Ok(Point { view, material: name, way: way.name, microbuffer, relative_rms_luminance, bias, flip, wall_ms })
    }
}

/// The cameras of `relight.json` by view.
fn cameras(path: &Path) -> Result<Vec<(&'static str, Camera)>> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::file(path, format!("cannot be read: {e}")))?;
    let json: serde_json::Value =
        serde_json::from_str(&text).map_err(|e| Error::file(path, format!("no JSON: {e}")))?;
    let camera = |view: &'static str| {
        let camera = &json["cameras"][format!("sphere_{view}")];
        let vector = |key: &str| {
            let number = |i: usize| camera[key][i].as_f64().map(|v| v as f32);
            Some(Vec3::new(number(0)?, number(1)?, number(2)?))
        };
        let (from, at, fov) = (vector("origin")?, vector("target")?, camera["vfov_deg"].as_f64()?);
        Some((view, Camera { from, at, fov_y: fov.to_radians() as f32 }))
    };
    VIEWS
        .into_iter()
        .map(|view| {
            let problem = format!("has no camera sphere_{view} with origin, target and vfov_deg");
            camera(view).ok_or_else(|| Error::file(path, problem))
        })
        .collect()
}

impl Report {
    /// Error over time of a material in the whole view: a curve a way, over sizes.
    fn plot(&self, material: &str) -> Plot {
        let mut series: Vec<Series> = Vec::new();
        let mine = |point: &&Point| point.material == material && point.view == VIEWS[0];
        for point in self.points.iter().filter(mine) {
            let at = (point.wall_ms, point.relative_rms_luminance);
            match series.iter_mut().find(|series| series.name == point.way) {
                Some(series) => series.points.push(at),
                None => series.push(Series { name: point.way.into(), points: vec![at] }),
            }
        }
        let times = || self.points.iter().filter(mine).map(|point| point.wall_ms);
        let (least, most) = (times().fold(f64::INFINITY, f64::min), times().fold(0.0, f64::max));
        let environment = self.environment.iter().find(|e| e.material == material && e.view == VIEWS[0]);
        if let Some(Environment { relative_rms_luminance: error, .. }) = environment {
            series.push(Series { name: "environment map".into(), points: vec![(least, *error), (most, *error)] });
        }
        Plot {
            title: format!("Error over time, {material}, sizes 8 to 64 ({0}x{0}, {1})", self.viewport, self.device),
            x: Axis { title: "milliseconds a frame".into(), logarithmic: true },
            y: Axis { title: "relative RMS of luminance".into(), logarithmic: true },
            series,
        }
    }
}
