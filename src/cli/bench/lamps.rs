//! `relume bench lamps`: Figures 10 and 11 of Preiner 2010 as tables, frame time over bounces, lights, interleaving and
//! the size of shadow maps.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use serde::Serialize;

use super::lamp_bridge::{self, Bridge};
use super::median;
use crate::cli::output::say;
use crate::cli::{progress, render, values};
use crate::frames::lamps::{LampFrame, LampRenderer, LampSettings};
use crate::gpu::{Context, ContextOptions, Profile};
use crate::preprocess::point_chunks::PointChunks;
use crate::reference::path_tracer::PathTracer;
use crate::reference::rooms::cornell_box;
use crate::scene::{Camera, Lamp};
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Args {
    /// 1 million points alone
    #[arg(long)]
    quick: bool,
    /// Image size
    #[arg(long, value_name = "WxH", value_parser = values::size, allow_hyphen_values = true, default_value = "256x256")]
    size: (u32, u32),
    /// The numbers
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
}

/// Frames of which the median is taken, after one that warms up.
const FRAMES: usize = 5;
/// Points and images of any size that is measured fit this.
const BUDGET: u64 = 2 << 30;
/// Under the ceiling, past the tall block.
const LAMP: &str = "spot at=0,1.9,0.4 to=0.1,0,-0.2 power=40 angle=80";
const CAMERA: Camera = Camera { from: Vec3::new(0.0, 1.0, 3.7), at: Vec3::new(0.0, 1.0, 0.0), fov_y: 0.7 };

/// One way of rendering one cloud; times in milliseconds.
#[derive(Serialize)]
struct Row {
    points: usize,
    bounces: u32,
    vpls: u32,
    interleave: u32,
    ism_size: u32,
    /// Rounds of all points over all maps in a bounce.
    ism_rounds: u64,
    frame_ms: f64,
    /// The point passes of the camera's and the lamp's view.
    geometry_ms: f64,
    ism_ms: f64,
    gather_ms: f64,
    redistribute_ms: f64,
    /// Maps, gathering and redistribution of a bounce in multiples of the geometry passes.
    bounce_over_geometry: f64,
}

/// Contents of `--json`.
#[derive(Serialize)]
struct Report<'a> {
    device: &'a str,
    width: u32,
    height: u32,
    rows: &'a [Row],
    /// Lamps for an object.
    bridge: Bridge,
    atlases: &'a [Atlas],
}

/// Texels of the atlas that many lights or few share: the paper's maps take the same time then.
const ATLAS: u32 = 1 << 20;

/// What maps take in an atlas of one size, by the number of lights.
#[derive(Serialize)]
struct Atlas {
    points: usize,
    lights: Vec<u32>,
    ism_ms: Vec<f64>,
    /// The most over the least, less one.
    spread: f64,
}

impl Atlas {
    /// Of the rows of one cloud.
    fn of(rows: &[Row]) -> Self {
        let shared = |row: &&Row| row.vpls * row.ism_size * row.ism_size == ATLAS;
        let (lights, ism_ms): (Vec<u32>, Vec<f64>) =
            rows.iter().filter(shared).map(|row| (row.vpls, row.ism_ms)).unzip();
        let (least, most) =
            ism_ms.iter().fold((f64::INFINITY, 0.0_f64), |(least, most), ms| (least.min(*ms), most.max(*ms)));
        Self { points: rows[0].points, lights, ism_ms, spread: most / least - 1.0 }
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    if let Some(json) = &args.json {
        values::check_output(json, &["json"])?;
    }
    let context = Context::new(&ContextOptions::default())?;
    let (width, height) = args.size;
    say!("{}; {width}x{height}, the Cornell box, a spot; medians of {FRAMES} frames, ms\n", context.capabilities.name)?;
    let base = LampSettings { width, height, memory_budget: BUDGET, ..LampSettings::default() };
    // One thing after the other changes. A round over the points whatever the number of maps, as in the paper.
    let once = LampSettings { ism_points: 1, ..base.clone() };
    let mut wanted = Vec::new();
    wanted.extend([1, 2, 3, 4].map(|bounces| LampSettings { bounces, ..once.clone() }));
    wanted.push(LampSettings { vpls: 64, ..once.clone() });
    wanted.extend([1, 4].map(|interleave| LampSettings { interleave, ..once.clone() }));
    wanted.extend([16, 64].map(|ism_size| LampSettings { ism_size, ..once.clone() }));
    // With the maps of 64 texels before: an atlas of one size.
    wanted.extend([(1024, 32), (4096, 16)].map(|(vpls, ism_size)| LampSettings { vpls, ism_size, ..once.clone() }));
    wanted.push(base.clone());
    let sizes: &[usize] = if args.quick { &[1_000_000] } else { &[1_000_000, 5_000_000] };
    let bar = progress::bar("measuring", (sizes.len() * wanted.len()) as u64);
    let lamp: Lamp = LAMP.parse().map_err(Error::Argument)?;
    let mut rows = Vec::new();
    for points in sizes {
        let chunks = scan(*points)?;
        for settings in &wanted {
            rows.push(measure(&context, &chunks, settings, &lamp)?);
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    say!(
        "{:>8} {:>7} {:>6} {:>10} {:>8} {:>6}  {:>8} {:>8} {:>8} {:>8} {:>12}  {:>15}",
        "points",
        "bounces",
        "lights",
        "interleave",
        "map side",
        "rounds",
        "frame",
        "geometry",
        "maps",
        "gather",
        "redistribute",
        "bounce/geometry"
    )?;
    for row in &rows {
        say!(
            "{:>8} {:>7} {:>6} {:>10} {:>8} {:>6}  {:>8.1} {:>8.1} {:>8.1} {:>8.1} {:>12.1}  {:>15.1}",
            row.points,
            row.bounces,
            row.vpls,
            row.interleave,
            row.ism_size,
            row.ism_rounds,
            row.frame_ms,
            row.geometry_ms,
            row.ism_ms,
            row.gather_ms,
            row.redistribute_ms,
            row.bounce_over_geometry
        )?;
    }
    let atlases: Vec<Atlas> =
        sizes.iter().enumerate().map(|(n, _)| Atlas::of(&rows[n * wanted.len()..][..wanted.len()])).collect();
    for Atlas { points, lights, ism_ms, spread } in &atlases {
        let percent = 100.0 * spread;
        say!(
            "\n{points} points, one atlas shared by {lights:?} lights: maps in {ism_ms:.1?} ms, {percent:.0} % apart"
        )?;
    }
    let bridge = lamp_bridge::measure(&context, &lamp, base)?;
    bridge.print()?;
    if let Some(path) = &args.json {
        let device = &context.capabilities.name;
        render::write_json(path, &Report { device, width, height, rows: &rows, atlases: &atlases, bridge })?;
    }
    Ok(())
}

fn scan(points: usize) -> Result<Arc<PointChunks>> {
    PointChunks::new(&PathTracer::new(cornell_box())?.albedo_cloud(points, 1)).map(Arc::new)
}

/// Medians over frames.
fn measure(context: &Arc<Context>, chunks: &Arc<PointChunks>, settings: &LampSettings, lamp: &Lamp) -> Result<Row> {
    const MAPS: [&str; 3] = ["clear shadow maps", "shadow maps", "fill shadow maps"];
    const NEXT: [&str; 3] = ["clear candidates", "candidates", "next lights"];
    const LIGHT: [&str; 7] = [
        "clear lamp views",
        "lamp view",
        "importance",
        "place lights",
        "direct light",
        "gather lights",
        "compose light",
    ];
    let mut renderer = LampRenderer::new(context, chunks, settings.clone())?;
    let mut frames: Vec<LampFrame> = Vec::new();
    for frame in 0..=FRAMES {
        // A lamp that moves: what stays as it was is not done again.
        let moving = lamp.relative_to(DVec3::Y * (1e-4 * frame as f64));
        let frame_of = renderer.render(&CAMERA, &[moving])?;
        if frame > 0 {
            frames.push(frame_of);
        }
    }
    let time = |picks: &dyn Fn(&str) -> bool| {
        let of = |profile: &Profile| {
            profile.passes.iter().filter(|(name, _)| picks(name)).fold(0.0, |sum, (_, pass)| sum + pass.gpu_ms)
        };
        median(frames.iter().map(|frame| of(&frame.profile)).collect())
    };
    let geometry_ms = time(&|name| !MAPS.contains(&name) && !NEXT.contains(&name) && !LIGHT.contains(&name));
    let (ism_ms, gather_ms) = (time(&|name| MAPS.contains(&name)), time(&|name| name == "gather lights"));
    let redistribute_ms = time(&|name| NEXT.contains(&name));
    let bounces = f64::from(settings.bounces);
    // Lights are placed anew one time less than there are bounces.
    let bounce = (ism_ms + gather_ms) / bounces + redistribute_ms / (bounces - 1.0).max(1.0);
    let splats = frames[0].profile.passes.get("shadow maps").map_or(0, |pass| pass.runs);
    Ok(Row {
        points: chunks.points.len(),
        bounces: settings.bounces,
        vpls: settings.vpls,
        interleave: settings.interleave,
        ism_size: settings.ism_size,
        ism_rounds: splats / u64::from(settings.bounces),
        frame_ms: time(&|_| true),
        geometry_ms,
        ism_ms,
        gather_ms,
        redistribute_ms,
        bounce_over_geometry: bounce / geometry_ms,
    })
}
