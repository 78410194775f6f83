//! `relume bench probes`: projection, streams and transfer at the sizes of Hajisharif et al. 2012, Tables 1 and 2.

use std::f32::consts::{PI, TAU};
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use glam::{Affine3A, Vec3};
use rayon::prelude::*;
use serde::Serialize;

use super::median;
use crate::cli::output::say;
use crate::cli::{progress, render, values};
use crate::formats::image::{ExrLayers, read_far_field, write_exr};
use crate::frames::MaterialChoice;
use crate::frames::probes::{ProbeRenderer, ProbeSettings, Projection, Reflection};
use crate::gpu::{Context, ContextOptions, Profile};
use crate::passes::probe_light::ProbeLight;
use crate::preprocess::transfer::{self, Transfer, TransferOptions};
use crate::probes::{ProbeSequence, ProbeStream, SequenceOptions, StreamOptions};
use crate::reference::shapes;
use crate::scene::{Camera, FarField, Object};
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Args {
    /// Smaller transfers and fewer frames
    #[arg(long)]
    quick: bool,
    /// Object whose transfer is measured too
    #[arg(long, value_name = "FILE")]
    object: Option<PathBuf>,
    /// The numbers
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
    /// Part of the device's name [default: the best]
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
}

/// Sizes of Table 2, and the frames a second there, on a GTX 580.
const SIZES: [([u32; 2], f64); 6] = [
    ([1628, 814], 9.0),
    ([814, 407], 24.0),
    ([407, 203], 40.0),
    ([203, 101], 44.0),
    ([101, 50], 55.0),
    ([50, 25], 64.0),
];
/// Bands of Table 2.
const ORDER: usize = 4;
/// Projections of which the median is taken.
const REPEATS: usize = 15;
/// Frames of the stream.
const FRAMES: u64 = 40;
/// Size of the pictures of the object.
const PICTURE: [u32; 2] = [512, 512];

/// A projection.
#[derive(Serialize)]
struct ProjectionRow {
    width: u32,
    height: u32,
    order: usize,
    /// From texels on the device to coefficients.
    project_ms: f64,
    /// The same with a thread for each pair of pixels.
    thread_a_pixel_ms: f64,
    /// With the upload.
    upload_and_project_ms: f64,
    paper_frames_a_second: Option<f64>,
}

/// A transfer.
#[derive(Serialize)]
struct TransferRow {
    object: String,
    vertices: usize,
    triangles: usize,
    directions: u32,
    without_visibility_s: f64,
    with_visibility_s: f64,
    paper_s: Option<f64>,
}

/// A stream of frames of the largest size from disk.
#[derive(Serialize)]
struct StreamRow {
    frames: u64,
    decode_frames_a_second: f64,
    decode_and_project_frames_a_second: f64,
    decode_to_screen_frames_a_second: f64,
    peak_frames_in_memory: usize,
}

/// What the object takes of a frame.
#[derive(Clone, Serialize)]
struct ObjectRow {
    material: String,
    vertices: usize,
    vertex_irradiance_ms: f64,
    gbuffer_ms: f64,
    shade_ms: f64,
    frame_ms: f64,
}

/// Contents of `--json`.
#[derive(Serialize)]
struct Report<'a> {
    device: &'a str,
    projections: Vec<ProjectionRow>,
    transfers: Vec<TransferRow>,
    stream: StreamRow,
    objects: Vec<ObjectRow>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    if let Some(json) = &args.json {
        values::check_output(json, &["json"])?;
    }
    let context = Context::new(&ContextOptions { device: args.device.clone(), validation: false })?;
    say!("{}", context.capabilities.name)?;
    let projections = projections(&context)?;
    let (transfers, lit) = transfers(args)?;
    let objects =
        lit.iter().map(|(object, transfer)| objects(&context, object, transfer)).collect::<Result<Vec<_>>>()?;
    let objects = objects.concat();
    print_objects(&objects)?;
    let (object, transfer) = &lit[0];
    let stream = stream(&context, args, object, transfer)?;
    let Some(path) = &args.json else { return Ok(()) };
    let device = &context.capabilities.name;
    render::write_json(path, &Report { device, projections, transfers, stream, objects })
}

/// Light that has all frequencies.
fn probe([width, height]: [u32; 2]) -> FarField {
    let texel = |at: u32| {
        let (phi, theta) = (TAU * (at % width) as f32 / width as f32, PI * ((at / width) as f32 + 0.5) / height as f32);
        let lamp = if (phi - 2.0).hypot(theta - 1.0) < 0.1 { 30.0 } else { 0.0 };
        Vec3::new(1.0 + phi.sin(), 0.5 + (7.0 * theta).cos().abs(), 0.7) + lamp
    };
    FarField { width, height, radiance: (0..width * height).into_par_iter().map(texel).collect() }
}

fn projections(context: &Arc<Context>) -> Result<Vec<ProjectionRow>> {
    let bar = progress::bar("projecting", SIZES.len() as u64 + 2);
    let mut rows = Vec::new();
    let orders = [3, 5].map(|order| (SIZES[0].0, order, None));
    for (size, order, paper) in SIZES.map(|(size, paper)| (size, ORDER, Some(paper))).into_iter().chain(orders) {
        let panorama = probe(size);
        let mut profile = Profile::default();
        let mut lights = [None, Some(1)]
            .into_iter()
            .map(|rows| ProbeLight::new(context, Projection { order, rows, ..Projection::default() }, false))
            .collect::<Result<Vec<_>>>()?;
        let mut times = [const { Vec::new() }; 3];
        for repeat in 0..=REPEATS {
            let mut clock = Instant::now();
            lights[0].set(&panorama, 0.0, &mut profile)?;
            let mut taken = [lap(&mut clock), 0.0, 0.0];
            lights[0].project_again(&mut profile)?;
            taken[1] = lap(&mut clock);
            if repeat == 0 {
                lights[1].set(&panorama, 0.0, &mut profile)?;
                continue;
            }
            lights[1].project_again(&mut profile)?;
            taken[2] = lap(&mut clock);
            times.iter_mut().zip(taken).for_each(|(times, taken)| times.push(taken));
        }
        let [upload_and_project_ms, project_ms, thread_a_pixel_ms] = times.map(median);
        let ([width, height], paper_frames_a_second) = (size, paper);
        let row = ProjectionRow {
            width,
            height,
            order,
            project_ms,
            thread_a_pixel_ms,
            upload_and_project_ms,
            paper_frames_a_second,
        };
        rows.push(row);
        bar.inc(1);
    }
    bar.finish_and_clear();
    say!("\nProjection, medians of {REPEATS}; frames a second\n")?;
    let head = ["size", "order", "projected", "a thread a pixel", "with upload", "paper, GTX 580"];
    let [a, b, c, d, e, f] = head;
    say!("{a:>10}  {b:>5}  {c:>10}  {d:>16}  {e:>11}  {f:>14}")?;
    for row in &rows {
        let rate = |ms: f64| 1e3 / ms;
        let paper = row.paper_frames_a_second.map_or(String::new(), |rate| rate.to_string());
        say!(
            "{:>10}  {:>5}  {:>10.0}  {:>16.0}  {:>11.0}  {paper:>14}",
            format!("{}x{}", row.width, row.height),
            row.order,
            rate(row.project_ms),
            rate(row.thread_a_pixel_ms),
            rate(row.upload_and_project_ms)
        )?;
    }
    Ok(rows)
}

/// An object and its transfer.
type Transferred = (Object, Transfer);

/// Objects and their transfers, the smallest first, and what making them took.
fn transfers(args: &Args) -> Result<(Vec<TransferRow>, Vec<Transferred>)> {
    // The bunny's and the dragon's numbers of vertices in the paper, and its times.
    let small = ("bumpy ball".to_owned(), shapes::bumpy_ball((118, 60), (13, 13)), Some(430.2));
    let large = ("bumpy ball".to_owned(), shapes::bumpy_ball((333, 163), (10, 15)), Some(22_560.0));
    let mut list = vec![small];
    if !args.quick {
        list.push(large);
    }
    if let Some(path) = &args.object {
        list.push((path.display().to_string(), crate::formats::object::load(path)?, None));
    }
    let mut rows = Vec::new();
    let mut lit = Vec::new();
    for (name, object, paper_s) in list {
        let bar = progress::bar("transfer", 1000);
        let options = TransferOptions { order: ORDER, ..TransferOptions::default() };
        let mut clock = Instant::now();
        transfer::compute(&object, &TransferOptions { visibility: false, ..options }, &|_| {})?;
        let without_visibility_s = lap(&mut clock) / 1e3;
        let found = transfer::compute(&object, &options, &|share| bar.set_position((share * 1000.0) as u64))?;
        let with_visibility_s = lap(&mut clock) / 1e3;
        bar.finish_and_clear();
        rows.push(TransferRow {
            object: name,
            vertices: object.vertices.len(),
            triangles: object.indices.len() / 3,
            directions: found.samples,
            without_visibility_s,
            with_visibility_s,
            paper_s,
        });
        lit.push((object, found));
    }
    say!("\nTransfer, seconds\n")?;
    say!(
        "{:>9}  {:>9}  {:>10}  {:>18}  {:>15}  {:>14}",
        "vertices",
        "triangles",
        "directions",
        "without visibility",
        "with visibility",
        "paper, 2012"
    )?;
    for row in &rows {
        say!(
            "{:>9}  {:>9}  {:>10}  {:>18.3}  {:>15.2}  {:>14}",
            row.vertices,
            row.triangles,
            row.directions,
            row.without_visibility_s,
            row.with_visibility_s,
            row.paper_s.map_or(String::new(), |s| format!("{s:.0}"))
        )?;
    }
    Ok((rows, lit))
}

fn renderer(
    context: &Arc<Context>,
    object: &Object,
    transfer: &Transfer,
    material: MaterialChoice,
) -> Result<(ProbeRenderer, Camera)> {
    let [width, height] = PICTURE;
    let settings = ProbeSettings { width, height, material, reflection: Reflection::default(), ..Default::default() };
    let renderer = ProbeRenderer::new(context, object, Affine3A::IDENTITY, Some(transfer), settings)?;
    let (low, high) = object.bounds();
    Ok((renderer, Camera::framing(0.5 * (low + high), 0.4 * (high - low).length())))
}

fn objects(context: &Arc<Context>, object: &Object, transfer: &Transfer) -> Result<Vec<ObjectRow>> {
    let panorama = probe(SIZES[1].0);
    let mut rows = Vec::new();
    for material in [MaterialChoice::Diffuse(0.7), MaterialChoice::File, MaterialChoice::Metal(0.25)] {
        let (mut renderer, camera) = renderer(context, object, transfer, material)?;
        let mut times = [const { Vec::new() }; 4];
        for repeat in 0..=REPEATS {
            renderer.light(&panorama, &mut Profile::default())?;
            let frame = renderer.render(&camera)?;
            let pass = |name| frame.stats.profile.passes.get(name).map_or(0.0, |pass| pass.gpu_ms);
            let taken = [pass("vertex irradiance"), pass("gbuffer"), pass("probe shade"), frame.stats.wall_ms];
            if repeat > 0 {
                times.iter_mut().zip(taken).for_each(|(times, taken)| times.push(taken));
            }
        }
        let [vertex_irradiance_ms, gbuffer_ms, shade_ms, frame_ms] = times.map(median);
        let (material, vertices) = (material.to_string(), object.vertices.len());
        rows.push(ObjectRow { material, vertices, vertex_irradiance_ms, gbuffer_ms, shade_ms, frame_ms });
    }
    Ok(rows)
}

fn print_objects(rows: &[ObjectRow]) -> Result<()> {
    let [width, height] = PICTURE;
    say!("\nThe object in a frame of {width}x{height}, ms\n")?;
    say!(
        "{:>12}  {:>8}  {:>17}  {:>8}  {:>6}  {:>6}",
        "material",
        "vertices",
        "vertex irradiance",
        "G-buffer",
        "shade",
        "frame"
    )?;
    for row in rows {
        say!(
            "{:>12}  {:>8}  {:>17.2}  {:>8.2}  {:>6.2}  {:>6.1}",
            row.material,
            row.vertices,
            row.vertex_irradiance_ms,
            row.gbuffer_ms,
            row.shade_ms,
            row.frame_ms
        )?;
    }
    Ok(())
}

/// A folder of frames that goes with this.
struct Frames(PathBuf);

impl Frames {
    fn new(count: u64) -> Result<Self> {
        let folder = std::env::temp_dir().join(format!("relume-probes-{}", std::process::id()));
        std::fs::create_dir_all(&folder).map_err(|e| Error::file(&folder, format!("cannot be made: {e}")))?;
        let frames = Self(folder);
        let bar = progress::bar("writing frames", count);
        let mut panorama = probe(SIZES[0].0);
        for number in 0..count {
            panorama.radiance.chunks_exact_mut(SIZES[0].0[0] as usize).for_each(|row| row.rotate_right(3));
            let (width, height, rgb) = (panorama.width, panorama.height, &panorama.radiance[..]);
            let path = frames.0.join(format!("probe.{number:04}.exr"));
            write_exr(&path, &ExrLayers { width, height, rgb, alpha: None, groups: &[] })?;
            bar.inc(1);
        }
        bar.finish_and_clear();
        // What only the first reading of a file takes is not the decoder's.
        read_far_field(&frames.0.join("probe.0000.exr"))?;
        Ok(frames)
    }
}

impl Drop for Frames {
    fn drop(&mut self) {
        // It lies where the system cleans up.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn stream(context: &Arc<Context>, args: &Args, object: &Object, transfer: &Transfer) -> Result<StreamRow> {
    let count = if args.quick { FRAMES / 4 } else { FRAMES };
    let folder = Frames::new(count)?;
    let range: RangeInclusive<u64> = 0..=count - 1;
    let start = || -> Result<ProbeStream> {
        let sequence = ProbeSequence::open(&folder.0.join("probe.####.exr"), &SequenceOptions::default())?;
        ProbeStream::start(Arc::new(sequence), range.clone(), StreamOptions::default())
    };
    let rate = |clock: Instant| count as f64 / clock.elapsed().as_secs_f64();
    let clock = Instant::now();
    let mut frames = start()?;
    while frames.next().is_some() {}
    let decode_frames_a_second = rate(clock);
    let (mut light, mut profile) = (ProbeLight::new(context, Projection::default(), false)?, Profile::default());
    let clock = Instant::now();
    for frame in start()? {
        light.set(&frame.panorama, 0.0, &mut profile)?;
    }
    let decode_and_project_frames_a_second = rate(clock);
    let (mut renderer, camera) = renderer(context, object, transfer, MaterialChoice::Diffuse(0.7))?;
    let clock = Instant::now();
    let mut frames = start()?;
    for frame in frames.by_ref() {
        renderer.light(&frame.panorama, &mut profile)?;
        renderer.render(&camera)?;
    }
    let row = StreamRow {
        frames: count,
        decode_frames_a_second,
        decode_and_project_frames_a_second,
        decode_to_screen_frames_a_second: rate(clock),
        peak_frames_in_memory: frames.stats().peak_alive,
    };
    let [width, height] = SIZES[0].0;
    say!("\n{count} frames of {width}x{height} from disk, EXR of 32-bit floats; frames a second\n")?;
    say!("{:>8}  {:>18}  {:>16}", "decoded", "and projected", "and on screen")?;
    say!(
        "{:>8.1}  {:>18.1}  {:>16.1}",
        row.decode_frames_a_second,
        row.decode_and_project_frames_a_second,
        row.decode_to_screen_frames_a_second
    )?;
    Ok(row)
}

/// Milliseconds since the clock was set, which is set again.
fn lap(clock: &mut Instant) -> f64 {
    let taken = clock.elapsed().as_secs_f64() * 1e3;
    *clock = Instant::now();
    taken
}
