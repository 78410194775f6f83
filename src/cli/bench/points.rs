//! `relume bench points`: Table 1 of Bouchiba et al. 2018 over clouds of different sizes, and both geometry passes.

use std::path::PathBuf;
use std::sync::Arc;

use glam::Vec3;
use serde::Serialize;

use crate::Result;
use crate::cli::output::say;
use crate::cli::{progress, render, values};
use crate::frames::points::{HiddenPoints, PointGeometry, PointRenderer, PointSettings};
use crate::gpu::{Context, ContextOptions, Profile};
use crate::preprocess::point_chunks::PointChunks;
use crate::reference::rooms::{Room, toy_room};
use crate::reference::sampling::Random;
use crate::scene::Camera;

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Args {
    /// Up to 1 million points
    #[arg(long)]
    quick: bool,
    /// Image size [default: the paper's]
    #[arg(long, value_name = "WxH", value_parser = values::size, allow_hyphen_values = true, default_value = "1248x768")]
    size: (u32, u32),
    /// The numbers
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
}

/// Frames of which the median is taken, after one that warms up.
const FRAMES: usize = 5;

/// One cloud.
#[derive(Serialize)]
struct Row {
    points: usize,
    raster_ms: f64,
    atomics_ms: f64,
    fixed_15_ms: f64,
    fixed_25_ms: f64,
    /// Point pyramid and hidden point removal.
    ours_ms: f64,
    /// Everything after the geometry pass.
    screen_ms: f64,
}

/// Contents of `--json`.
#[derive(Serialize)]
struct Report<'a> {
    device: &'a str,
    width: u32,
    height: u32,
    rows: &'a [Row],
}

pub(super) fn run(args: &Args) -> Result<()> {
    if let Some(json) = &args.json {
        values::check_output(json, &["json"])?;
    }
    let context = Context::new(&ContextOptions::default())?;
    let sizes: &[usize] = if args.quick { &[300_000, 1_000_000] } else { &[300_000, 1_000_000, 3_000_000, 10_000_000] };
    let (width, height) = args.size;
    say!("{}; {width}x{height}, the toy room; medians of {FRAMES} frames, ms\n", context.capabilities.name)?;
    say!(
        "{:>9}  {:>16}  {:>16}  {:>12} {:>12} {:>7}  {:>8}  {:>11}",
        "points",
        "raster (Mpts/s)",
        "atomics (Mpts/s)",
        "HPR fixed 15",
        "HPR fixed 25",
        "ours",
        "25/ours",
        "screen part"
    )?;
    let mut rows = Vec::new();
    for &points in sizes {
        let bar = progress::spinner("measuring");
        let row = measure(&context, &scan(&toy_room(), points)?, args.size)?;
        bar.finish_and_clear();
        let rate = |ms: f64| format!("{ms:.1} ({:.1})", row.points as f64 / ms / 1e3);
        say!(
            "{:>9}  {:>16}  {:>16}  {:>12.1} {:>12.1} {:>7.1}  {:>8.1}  {:>11.1}",
            row.points,
            rate(row.raster_ms),
            rate(row.atomics_ms),
            row.fixed_15_ms,
            row.fixed_25_ms,
            row.ours_ms,
            row.fixed_25_ms / row.ours_ms,
            row.screen_ms
        )?;
        rows.push(row);
    }
    if let Some(path) = &args.json {
        render::write_json(path, &Report { device: &context.capabilities.name, width, height, rows: &rows })?;
    }
    Ok(())
}

/// Points spread at random over all surfaces, in the colours of the surfaces.
fn scan(room: &Room, points: usize) -> Result<Arc<PointChunks>> {
    let area: f32 = room.surfaces.iter().map(|r| r.area()).sum();
    let mut random = Random::new(0, 1);
    let (mut positions, mut colors) = (Vec::with_capacity(points), Vec::with_capacity(points));
    for rectangle in &room.surfaces {
        for _ in 0..(rectangle.area() / area * points as f32).round() as usize {
            let [u, v] = random.square().to_array();
            positions.push(rectangle.at(u, v));
            colors.push(rectangle.albedo_at(u, v) + rectangle.emission);
        }
    }
    PointChunks::from_points(&positions, &colors, &[(area / points as f32).sqrt()]).map(Arc::new)
}

fn measure(context: &Arc<Context>, chunks: &Arc<PointChunks>, (width, height): (u32, u32)) -> Result<Row> {
    let camera = Camera { from: Vec3::new(0.8, 1.5, 2.2), at: Vec3::new(-0.2, 0.9, -1.0), fov_y: 60_f32.to_radians() };
    // Points and images of any size that is measured fit this.
    let settings = PointSettings { width, height, memory_budget: 2 << 30, ..PointSettings::default() };
    // Medians of the times of passes that `of` picks.
    let time = |settings: PointSettings, whole: bool, of: &[&dyn Fn(&str) -> bool]| -> Result<Vec<f64>> {
        let mut renderer = PointRenderer::new(context, chunks, settings)?;
        let mut times = vec![Vec::new(); of.len()];
        for frame in 0..=FRAMES {
            let mut profile = Profile::default();
            if whole {
                renderer.draw(&camera, &mut profile)?;
            } else {
                renderer.classify(&camera, &mut profile)?;
            }
            if frame > 0 {
                for (times, picks) in times.iter_mut().zip(of) {
                    times.push(
                        profile.passes.iter().filter(|(name, _)| picks(name)).map(|(_, p)| p.gpu_ms).sum::<f64>(),
                    );
                }
            }
        }
        Ok(times.into_iter().map(median).collect())
    };
    let geometry = |name: &str| name == "points" || name == "clear points";
    let screen = |name: &str| !geometry(name);
    let ours = |name: &str| name == "hidden points" || name == "point pyramid";
    let hidden = |name: &str| name == "hidden points";
    let raster = time(PointSettings { geometry: Some(PointGeometry::Raster), ..settings }, false, &[&geometry])?[0];
    let atomics = PointSettings { geometry: Some(PointGeometry::Atomics), ..settings };
    let whole = time(atomics, true, &[&geometry, &ours, &screen])?;
    let fixed = |radius| {
        Ok::<f64, crate::Error>(
            time(PointSettings { hidden: HiddenPoints::Fixed(radius), ..atomics }, false, &[&hidden])?[0],
        )
    };
    Ok(Row {
        points: chunks.points.len(),
        raster_ms: raster,
        atomics_ms: whole[0],
        fixed_15_ms: fixed(15)?,
        fixed_25_ms: fixed(25)?,
        ours_ms: whole[1],
        screen_ms: whole[2],
    })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
