//! `relume bench microbuffers`: error and time over the size of micro-buffers.

use std::path::PathBuf;

use glam::Vec3;
use serde::Serialize;

use crate::Result;
use crate::cli::output::say;
use crate::cli::stage::{self, Stage};
use crate::cli::{progress, render, values};
use crate::compare::{Axis, Metrics, Plot, Series, compare};
use crate::frames::{MaterialChoice, Paper, Settings, Technique};
use crate::gpu::{Context, ContextOptions};
use crate::reference::bake::BakeOptions;
use crate::reference::rooms::toy_room;
use crate::reference::shapes::sphere;
use crate::scene::Camera;

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Args {
    /// Sizes 8, 16 and 24, two materials
    #[arg(long)]
    quick: bool,
    /// The numbers
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
    /// Error over size; time goes to FILE-time.svg beside it
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
}

const POINTS: usize = 300_000;
const SIDE: u32 = 128;
const MATERIALS: [(&str, MaterialChoice); 4] = [
    ("diffuse 0.7", MaterialChoice::Diffuse(0.7)),
    ("metal 1", MaterialChoice::Metal(1.0)),
    ("metal 0.5", MaterialChoice::Metal(0.5)),
    ("metal 0.25", MaterialChoice::Metal(0.25)),
];
const WAYS: [(&str, Paper); 2] =
    [("ours", Paper { image: false, coverage: false, weights: false, cut: false }), ("paper", Paper::ALL)];

/// One frame against the truth.
#[derive(Serialize)]
struct Point {
    material: &'static str,
    way: &'static str,
    microbuffer: u32,
    relative_rms_luminance: f64,
    bias: f64,
    ssim: f64,
    flip: f64,
    wall_ms: f64,
    rasterised_per_pixel: f64,
}

/// Contents of `--json`.
#[derive(Serialize)]
struct Report {
    device: String,
    technique: Technique,
    scene: String,
    truth: String,
    points: Vec<Point>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    if let Some(json) = &args.json {
        values::check_output(json, &["json"])?;
    }
    let time_plot = args.plot.as_ref().map(|path| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        path.with_file_name(format!("{stem}-time.svg"))
    });
    for path in args.plot.iter().chain(&time_plot) {
        values::check_output(path, &["svg"])?;
    }
    let (sizes, materials, samples): (&[u32], _, _) = match args.quick {
        true => (&[8, 16, 24], &[MATERIALS[0], MATERIALS[3]][..], 256),
        false => (&[8, 12, 16, 24, 32, 48, 64], &MATERIALS[..], 1024),
    };
    let context = Context::new(&ContextOptions::default())?;
    let technique = stage::per_pixel(&context);
    let options = BakeOptions { texel: 0.03, direct_samples: 48, bounced_samples: 512, ..BakeOptions::default() };
    let stage = Stage::new(toy_room(), POINTS, &options)?;
    let object = stage::placed(sphere(0.35, 48), Vec3::Y);
    let camera = Camera { from: Vec3::new(0.5, 1.35, 1.75), at: Vec3::Y, fov_y: 30.0_f32.to_radians() };
    let mut report = Report {
        device: context.capabilities.name.clone(),
        technique,
        scene: format!("toy room of {} points, sphere, whole view, {SIDE}x{SIDE}", stage.build.points),
        truth: format!(
            "path-traced in the room itself, {samples} samples of the BRDF and as many of the lamps a pixel"
        ),
        points: Vec::new(),
    };
    say!("{}\n{}, {technique}; truth {}", report.scene, report.device, report.truth)?;
    say!("time: one frame, G-buffer to image, after a warm-up\n")?;
    say!(
        "{:<12} {:<6} {:>5} {:>13} {:>8} {:>7} {:>7} {:>9} {:>12}",
        "material",
        "way",
        "size",
        "relative RMS",
        "bias",
        "SSIM",
        "FLIP",
        "ms",
        "nodes/pixel"
    )?;
    for &(name, material) in materials {
        let base = Settings { technique, material, width: SIDE, height: SIDE, ..Settings::default() };
        let mut truth = None;
        for (way, paper) in WAYS {
            for &microbuffer in sizes {
                let settings = Settings { microbuffer, paper, ..base };
                let frame = stage::render(&context, &stage.hierarchy, &object, &camera, settings)?;
                let image = stage::image_of(&frame)?;
                let truth = match &truth {
                    Some(truth) => truth,
                    None => truth.insert(stage.truth(&frame, &camera, material, samples)?),
                };
                let Metrics { relative_rms_luminance, bias, ssim, flip, .. } = compare(&image, truth)?;
                let (wall_ms, covered) = (frame.stats.wall_ms, frame.stats.covered_pixels.max(1) as f64);
                let rasterised_per_pixel = frame.stats.rasterised_nodes as f64 / covered;
                say!(
                    "{name:<12} {way:<6} {microbuffer:>5} {relative_rms_luminance:>13.4} {bias:>+8.4} {ssim:>7.4} \
                     {flip:>7.4} {wall_ms:>9.1} {rasterised_per_pixel:>12.0}"
                )?;
                report.points.push(Point {
                    material: name,
                    way,
                    microbuffer,
                    relative_rms_luminance,
                    bias,
                    ssim,
                    flip,
                    wall_ms,
                    rasterised_per_pixel,
                });
                // What is done stays, should a later frame fail.
                if let Some(json) = &args.json {
                    render::write_json(json, &report)?;
                }
            }
        }
    }
    if let (Some(error), Some(time)) = (&args.plot, &time_plot) {
        let bar = progress::spinner("drawing");
        plot(&report, "Error over the size of micro-buffers", "relative RMS of luminance", |p| {
            p.relative_rms_luminance
        })
        .write(error)?;
        plot(&report, "Time over the size of micro-buffers", "milliseconds a frame", |p| p.wall_ms).write(time)?;
        bar.finish_and_clear();
    }
    Ok(())
}

/// A curve for each material and way.
fn plot(report: &Report, title: &str, y: &str, value: fn(&Point) -> f64) -> Plot {
    let mut series: Vec<Series> = Vec::new();
    for point in &report.points {
        let name = format!("{}, {}", point.material, point.way);
        let at = (f64::from(point.microbuffer), value(point));
        match series.iter_mut().find(|series| series.name == name) {
            Some(series) => series.points.push(at),
            None => series.push(Series { name, points: vec![at] }),
        }
    }
    Plot {
        title: format!("{title} ({}, {})", report.technique, report.device),
        x: Axis { title: "micro-pixels along a side".into(), logarithmic: false },
        y: Axis { title: y.into(), logarithmic: true },
        series,
    }
}
