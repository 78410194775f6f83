//! `relume bench points`: Table 1 of Bouchiba et al. 2018 over clouds of different sizes, and both geometry passes.

use std::path::PathBuf;
use std::sync::Arc;

use glam::Vec3;
use serde::Serialize;

use super::median;
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

/// Frames of which the median is taken, after one that warms up; three times as many for what follows the geometry pass.
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
    let bar = progress::bar("measuring", 2 * sizes.len() as u64);
    let clouds = sizes.iter().map(|points| scan(&toy_room(), *points)).collect::<Result<Vec<_>>>()?;
    let mut rows = Vec::new();
    for cloud in &clouds {
        rows.push(measure(&context, cloud, args.size)?);
        bar.inc(1);
    }
    for (row, (ours, screen)) in rows.iter_mut().zip(measure_screen(&context, &clouds, args.size)?) {
        (row.ours_ms, row.screen_ms) = (ours, screen);
    }
    bar.finish_and_clear();
    say!(
        "{:>9}  {:>17}  {:>17}  {:>12} {:>12} {:>7}  {:>7}  {:>11}",
        "points",
        "raster (Mpts/s)",
        "atomics (Mpts/s)",
        "HPR fixed 15",
        "HPR fixed 25",
        "ours",
        "25/ours",
        "screen part"
    )?;
    for row in &rows {
        let rate = |ms: f64| format!("{ms:.2} ({:.1})", row.points as f64 / ms / 1e3);
        say!(
            "{:>9}  {:>17}  {:>17}  {:>12.2} {:>12.2} {:>7.2}  {:>7.1}  {:>11.2}",
            row.points,
            rate(row.raster_ms),
            rate(row.atomics_ms),
            row.fixed_15_ms,
            row.fixed_25_ms,
            row.ours_ms,
            row.fixed_25_ms / row.ours_ms,
            row.screen_ms
        )?;
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

const CAMERA: Camera =
    Camera { from: Vec3::new(0.8, 1.5, 2.2), at: Vec3::new(-0.2, 0.9, -1.0), fov_y: std::f32::consts::FRAC_PI_3 };

/// Points and images of any size that is measured fit this.
const BUDGET: u64 = 2 << 30;

fn geometry(name: &str) -> bool {
    name == "points" || name == "clear points"
}

/// Milliseconds of the passes of a frame that `picks` chooses.
fn time(profile: &Profile, picks: impl Fn(&str) -> bool) -> f64 {
    profile.passes.iter().filter(|(name, _)| picks(name)).map(|(_, pass)| pass.gpu_ms).sum()
}

/// Geometry passes and fixed neighbourhoods of one cloud.
fn measure(context: &Arc<Context>, chunks: &Arc<PointChunks>, (width, height): (u32, u32)) -> Result<Row> {
    let settings = PointSettings { width, height, memory_budget: BUDGET, ..PointSettings::default() };
    let passes = |settings: PointSettings, picks: &dyn Fn(&str) -> bool| -> Result<f64> {
        let mut renderer = PointRenderer::new(context, chunks, settings)?;
        let mut times = Vec::new();
        for frame in 0..=FRAMES {
            let mut profile = Profile::default();
            renderer.classify(&CAMERA, &mut profile)?;
            if frame > 0 {
                times.push(time(&profile, picks));
            }
        }
        Ok(median(times))
    };
    let draw = |way| passes(PointSettings { geometry: Some(way), ..settings }, &geometry);
    let fixed = |radius| {
        let settings = PointSettings { hidden: HiddenPoints::Fixed(radius), ..settings };
        passes(settings, &|name| name == "hidden points")
    };
    Ok(Row {
        points: chunks.points.len(),
        raster_ms: draw(PointGeometry::Raster)?,
        atomics_ms: draw(PointGeometry::Atomics)?,
        fixed_15_ms: fixed(15)?,
        fixed_25_ms: fixed(25)?,
        ours_ms: 0.0,
        screen_ms: 0.0,
    })
}

/// Our hidden point removal and everything after the geometry pass, of all clouds in turn: how busy the machine is
/// changes more slowly than that.
fn measure_screen(
    context: &Arc<Context>,
    clouds: &[Arc<PointChunks>],
    (width, height): (u32, u32),
) -> Result<Vec<(f64, f64)>> {
    let settings = PointSettings { width, height, memory_budget: BUDGET, ..PointSettings::default() };
    let mut renderers =
        clouds.iter().map(|chunks| PointRenderer::new(context, chunks, settings)).collect::<Result<Vec<_>>>()?;
    let mut times = vec![(Vec::new(), Vec::new()); clouds.len()];
    for frame in 0..=3 * FRAMES {
        for (renderer, (ours, screen)) in renderers.iter_mut().zip(&mut times) {
            let mut profile = Profile::default();
            renderer.draw(&CAMERA, &mut profile)?;
            if frame > 0 {
                ours.push(time(&profile, |name| name == "hidden points" || name == "point pyramid"));
                screen.push(time(&profile, |name| !geometry(name)));
            }
        }
    }
    Ok(times.into_iter().map(|(ours, screen)| (median(ours), median(screen))).collect())
}
