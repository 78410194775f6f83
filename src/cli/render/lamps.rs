//! Lamps that are not in the scan: their light on it, for an object in it, or the lit scan alone.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use serde::Serialize;

use super::load::{self, Scan};
use super::stats::Clock;
use super::{Args, write_json};
use crate::cli::output::say;
use crate::cli::progress;
use crate::formats::image::{self, ExrGroup, ExrLayers};
use crate::frames::Method;
use crate::frames::lamps::{LampFrame, LampRenderer, LampSettings, LampSurface, ObjectLight};
use crate::gpu::recorder::PassProfile;
use crate::gpu::{Context, Profile};
use crate::preprocess::point_chunks::PointChunks;
use crate::scene::{Camera, Lamp, Object};
use crate::{Error, Result};

/// Settings by the flags.
fn settings(args: &Args) -> LampSettings {
    args.lamps.settings(args.size, args.harmonics.bounces, args.memory_budget << 20)
}

/// The lamps where the scan is.
fn lamps(args: &Args, scan: &Scan) -> Vec<Lamp> {
    args.lamps.lamps.iter().map(|lamp| lamp.relative_to(scan.origin)).collect()
}

/// Says so where lamps light nothing at all.
fn warn_if_dark(lit: bool) {
    if !lit {
        tracing::warn!("no light of the lamps reaches the scan: is one inside a wall, or nothing before it?");
    }
}

/// Adds the lamps' light to what the scan sends the object, and renders it for the backdrop if that is the scan. Returns what
/// comes to the object straight from the lamps.
pub(super) fn light_scan(
    args: &Args,
    context: &Arc<Context>,
    scan: &mut Scan,
    (object, camera): (&Object, &Camera),
    profile: &mut Profile,
) -> Result<ObjectLight> {
    let share = args.lamps.scan_light.unwrap_or(1.0) as f32;
    let lamps = lamps(args, scan);
    let Scan { hierarchy: Some(hierarchy), chunks: Some(chunks), .. } = scan else { return Ok(ObjectLight::default()) };
    let bar = progress::spinner("lighting the scan");
    let mut renderer = LampRenderer::new(context, chunks, settings(args))?;
    renderer.set_object(Some((object, args.material)))?;
    renderer.choose_leaves(hierarchy)?;
    let (radiance, light) = renderer.relight(hierarchy, &lamps, share)?;
    *hierarchy = std::mem::take(hierarchy).with_radiance(radiance);
    profile.add(&light.profile);
    warn_if_dark(light.radiance.iter().any(|radiance| *radiance != Vec3::ZERO));
    let direct = renderer.light_object(camera, &lamps)?;
    profile.add(&direct.profile);
    if args.backdrop.shows_points() {
        let frame = renderer.render(camera, &lamps)?;
        profile.add(&frame.profile);
        scan.lit = Some((frame, share));
    }
    bar.finish_and_clear();
    Ok(direct)
}

/// A view of the whole scan where no camera is given.
fn camera(args: &Args, scan: &Scan, chunks: &PointChunks) -> Result<Camera> {
    let (low, high) = chunks.bounds().unwrap_or((Vec3::splat(-1.0), Vec3::ONE));
    load::camera(args, (low, high), scan.origin)
}

/// `--technique lamps`: the scan alone in the light of the lamps.
pub(super) fn run(args: &Args, context: &Arc<Context>, path: &Path, mut clock: Clock, start: Instant) -> Result<()> {
    let mut scan = load::scan(args, path, None, false, &mut clock)?;
    let chunks = scan.chunks.take().unwrap_or_default();
    let camera = camera(args, &scan, &chunks)?;
    let lamps = lamps(args, &scan);
    let settings = settings(args);
    let share = args.lamps.scan_light.unwrap_or(0.0) as f32;
    let bar = progress::spinner("lighting");
    let mut renderer = clock.time("upload and pipelines", || LampRenderer::new(context, &chunks, settings.clone()))?;
    let frame = renderer.render(&camera, &lamps)?;
    let (surface, irradiance) = (renderer.surface()?, renderer.irradiance()?);
    bar.finish_and_clear();
    let messages = context.validation.messages();
    if let Some(first) = messages.first() {
        return Err(Error::Device(format!("{} validation messages, the first: {first}", messages.len())));
    }
    warn_if_dark(frame.is_lit());
    clock.time("writing", || write(args, &camera, share, (&frame, &surface, &irradiance)))?;
    if let Some(path) = &args.stats {
        let report = Report {
            device: &context.capabilities.name,
            driver: &context.capabilities.driver,
            technique: Method::Lamps,
            width: frame.width,
            height: frame.height,
            points: chunks.points.len(),
            lamps: args.lamps.lamps.iter().map(Lamp::to_string).collect(),
            bounces: settings.bounces,
            vpls: settings.vpls,
            interleave: settings.interleave,
            ism_size: settings.ism_size,
            ism_fill: settings.ism_fill,
            scan_light: share,
            memory_budget_bytes: settings.memory_budget,
            device_bytes_peak: context.bytes_peak(),
            frame_wall_ms: frame.wall_ms,
            total_wall_s: start.elapsed().as_secs_f64(),
            loading_s: clock.steps(),
            passes: &frame.profile.passes,
        };
        write_json(path, &report)?;
    }
    let (out, device) = (args.out.display(), &context.capabilities.name);
    say!("{out}: the scan lit by {} in {:.0} ms on {device}", count(lamps.len(), "lamp"), frame.wall_ms)
}

fn count(number: usize, what: &str) -> String {
    if number == 1 { format!("1 {what}") } else { format!("{number} {what}s") }
}

/// Contents of `--stats`.
#[derive(Serialize)]
struct Report<'a> {
    device: &'a str,
    driver: &'a str,
    technique: Method,
    width: u32,
    height: u32,
    points: usize,
    lamps: Vec<String>,
    bounces: u32,
    vpls: u32,
    interleave: u32,
    ism_size: u32,
    ism_fill: u32,
    scan_light: f32,
    memory_budget_bytes: u64,
    device_bytes_peak: u64,
    frame_wall_ms: f64,
    total_wall_s: f64,
    loading_s: &'a [(&'static str, f64)],
    passes: &'a BTreeMap<&'static str, PassProfile>,
}

/// An EXR with the light by its ways as layers, or a PNG.
fn write(
    args: &Args,
    camera: &Camera,
    share: f32,
    (frame, surface, [direct, bounced]): (&LampFrame, &LampSurface, &[Vec<[f32; 4]>; 2]),
) -> Result<()> {
    let three = |values: &[[f32; 4]]| values.iter().map(|v| Vec3::new(v[0], v[1], v[2])).collect::<Vec<_>>();
    let (width, height) = (frame.width, frame.height);
    let (lit, own) = (three(&frame.color_depth), three(&surface.color_depth));
    let rgb: Vec<Vec3> = lit.iter().zip(&own).map(|(lit, own)| *lit + *own * share).collect();
    let depth: Vec<f32> = frame.color_depth.iter().map(|v| v[3]).collect();
    let alpha: Vec<f32> = depth.iter().map(|depth| if *depth > 0.0 { 1.0 } else { 0.0 }).collect();
    if args.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        let scale = (args.exposure as f32).exp2();
        let encode = |(color, alpha): (&Vec3, &f32)| {
            let [r, g, b] = args.backdrop.tone.encode(*color * scale);
            [r, g, b, (alpha * 255.0) as u8]
        };
        let bytes: Vec<u8> = rgb.iter().zip(&alpha).flat_map(encode).collect();
        return image::write_png(&args.out, width, height, &bytes);
    }
    let (_, _, forward) = camera.basis();
    let position: Vec<Vec3> = (0..width * height)
        .zip(&depth)
        .map(|(at, depth)| {
            let ray = camera.ray_direction(at % width, at / width, width, height);
            if *depth > 0.0 { camera.from + ray * (depth / ray.dot(forward)) } else { Vec3::ZERO }
        })
        .collect();
    let (normal, direct, bounced) = (three(&surface.normal), three(direct), three(bounced));
    let groups = [
        ("albedo", ExrGroup::Color(&own)),
        ("N", ExrGroup::Vector(&normal)),
        ("Z", ExrGroup::Scalar(&depth)),
        ("P", ExrGroup::Vector(&position)),
        // Irradiance straight from the lamps, and after all bounces.
        ("direct", ExrGroup::Color(&direct)),
        ("bounced", ExrGroup::Color(&bounced)),
    ];
    let layers = ExrLayers { width, height, rgb: &rgb, alpha: Some(&alpha), groups: &groups };
    image::write_exr(&args.out, &layers)
}

/// What `--lamp` and technique `lamps` ask for besides each other.
pub(super) fn check(args: &Args, method: Method) -> Result<()> {
    let refuse = |problem: &str| Err(Error::Argument(problem.into()));
    let lit = !args.lamps.lamps.is_empty();
    if method == Method::Lamps {
        let far = args.environment.is_some() || args.probes.probes.is_some();
        return match () {
            () if !lit => refuse("technique lamps needs --lamp LAMP"),
            () if args.object.is_some() => refuse("technique lamps shows the scan alone, without --object"),
            () if far || args.backdrop.any() => {
                refuse("technique lamps shows the scan alone, without --environment, --probes and --backdrop")
            }
            () => Ok(()),
        };
    }
    if args.object.is_none() {
        return refuse("--object FILE is missing, without which only technique lamps renders");
    }
    if lit && method == Method::Probes {
        return refuse("--lamp lights a cloud, which technique probes has none of");
    }
    if !lit && args.lamps.any_setting() {
        return refuse(
            "--vpls, --interleave, --ism-size, --ism-fill, --surfaces, --brush, --albedo-from and --scan-light need --lamp LAMP",
        );
    }
    Ok(())
}
