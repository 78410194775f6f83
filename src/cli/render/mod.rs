//! `relume render`: an object in the light of a cloud, or of light probes, one picture or a sequence; or a cloud in the
//! light of lamps.

mod lamps;
mod lighting;
mod load;
mod sequence;
mod source;
mod stats;
mod studio;
mod write;

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Instant;

use glam::DVec3;

use super::backdrop::BackdropArgs;
use super::lamp_flags::LampArgs;
use super::output::say;
use super::probe_flags::ProbeArgs;
use super::{progress, values};
use crate::formats::cloud::Up;
use crate::formats::{image, object};
use crate::frames::probes::Reflection;
use crate::frames::{MaterialChoice, Method, Paper, Quality, Settings};
use crate::gpu::{Capture, Context, ContextOptions, Profile};
use crate::trace::Trace;
use crate::{Error, Result};
use lighting::Placed;
pub(super) use load::load_cloud;
use sequence::FrameNames;
use source::Source;
use stats::{Circumstances, Clock};
use studio::{Set, Studio};
pub(super) use write::{write_frame, write_json};

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
    /// Cloud (.ply, .pcd, .las, .laz) or saved hierarchy (.bsh); technique probes needs none
    #[arg(long, value_name = "FILE")]
    cloud: Option<PathBuf>,
    /// Object: .gltf, .glb, .obj or .ply; technique lamps has none
    #[arg(long, value_name = "FILE")]
    object: Option<PathBuf>,
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
    /// Eye [default: the object is framed, or the whole scan]
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
    /// classic, mipmapped, hybrid or shared; probes, which lights by the probes alone; or lamps, which shows the scan in
    /// their light without an object [default: by --quality; hybrid with --paper; classic where the device lacks what the
    /// others need; probes without a cloud]
    #[arg(long)]
    technique: Option<Method>,
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
    #[arg(long, value_name = "FILE", conflicts_with = "probes")]
    environment: Option<PathBuf>,
    #[command(flatten)]
    probes: ProbeArgs,
    /// Frames of the probes, the first and the last [default: the first; all where --out is a pattern]
    #[arg(long, value_name = "A..B", value_parser = sequence::frames)]
    frames: Option<RangeInclusive<u64>>,
    #[command(flatten)]
    lamps: LampArgs,
    #[command(flatten)]
    harmonics: HarmonicsArgs,
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
    /// Image: .exr (linear, with layers) or .png; a pattern such as 'frame.####.exr' for a sequence
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

/// What technique `probes` does.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct HarmonicsArgs {
    /// Technique probes: bands of the spherical harmonics, 1 to 5
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = values::order)]
    pub(super) order: usize,
    /// ... against ringing
    #[arg(long, value_enum, default_value_t = values::Window::None)]
    pub(super) window: values::Window,
    /// ... halve probes until they are at most so wide before they are projected
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) probe_width: Option<u32>,
    /// ... smooth over time: weight of the frames before against a frame's own
    #[arg(long, value_name = "ALPHA", value_parser = values::not_negative, default_value = "0", allow_hyphen_values = true)]
    temporal: f64,
    /// ... what surfaces mirror: none, lobes:SAMPLES, or mirror:SHARE for the paper's perfect mirror
    #[arg(long, value_name = "HOW", default_value = "lobes")]
    reflection: Reflection,
    /// ... the object's transfer: a .prt file, which is made where it is missing, or none for no shadows [default: beside
    /// the object]
    #[arg(long, value_name = "FILE.prt")]
    transfer: Option<PathBuf>,
    /// ... directions a vertex of a transfer that is made
    #[arg(long, value_name = "N", default_value_t = 2500, value_parser = values::directions)]
    samples: u32,
    /// ... bounces of light between parts of the object in a transfer that is made [default: 0]; with --lamp: bounces of
    /// the lamps' light in the scan, at most 8 [default: 2]
    #[arg(long, value_name = "N", value_parser = values::bounces)]
    bounces: Option<u32>,
}

/// Refuses what makes no sense before anything is read.
fn check(args: &Args, method: Method) -> Result<()> {
    let far = args.probes.probes.is_some() || args.environment.is_some();
    let refuse = |problem: String| Err(Error::Argument(problem));
    lamps::check(args, method)?;
    if args.cloud.is_none() && method != Method::Probes {
        return refuse(format!("technique {method} needs --cloud FILE"));
    }
    if method == Method::Probes && !far {
        return refuse("technique probes needs --probes PATTERN or --environment FILE".into());
    }
    if args.backdrop.shows_points() && args.cloud.is_none() {
        return refuse("--backdrop points needs --cloud FILE".into());
    }
    let moves = args.frames.is_some() || args.probes.cross_fade.is_some() || args.probes.turn != 0.0;
    if args.probes.probes.is_none() && moves {
        return refuse("--frames, --turn and --cross-fade need --probes PATTERN".into());
    }
    Ok(())
}

fn check_outputs(args: &Args) -> Result<()> {
    values::check_output(&args.out, &["exr", "png"])?;
    for file in [&args.stats, &args.trace].into_iter().flatten() {
        values::check_output(file, &["json"])?;
    }
    if args.trace.is_some() && args.stats == args.trace {
        return Err(Error::Argument("--stats and --trace name the same file".into()));
    }
    Ok(())
}

pub(super) fn run(args: &Args) -> Result<()> {
    let start = Instant::now();
    check_outputs(args)?;
    args.backdrop.check(args.environment.is_some() || args.probes.probes.is_some())?;
    let capture = args.capture.then(Capture::attach).transpose()?;
    let trace = if args.trace.is_some() { Trace::new() } else { Trace::default() };
    let mut clock = Clock::new(trace.clone());
    let bar = progress::spinner("reading");
    let context = clock.time("device", || {
        let options = ContextOptions { device: args.device.clone(), validation: args.validation };
        Context::traced(&options, trace.clone())
    })?;
    let method = lighting::pick(args, &context);
    check(args, method)?;
    let (path, cloud) = match (&args.object, &args.cloud) {
        (Some(object), _) => (object, args.cloud.as_deref()),
        (None, Some(cloud)) => return lamps::run(args, &context, cloud, clock, start),
        (None, None) => return Err(Error::Argument("there is neither --object nor --cloud".into())),
    };
    let names = FrameNames::new(&args.out)?;
    let object = clock.time("object", || object::load(path))?;
    let mut source = clock.time("far field", || match (&args.probes.probes, &args.environment) {
        (Some(path), _) => Source::open(args, path, &names),
        (None, Some(path)) => image::read_far_field(path).map(|far_field| Source::still(Some(far_field))),
        (None, None) => Ok(Source::still(None)),
    })?;
    // The object's place is in the file's coordinates, which a cloud with large ones is not kept in: the cloud comes
    // first, and its normals look at the object.
    let lights = method != Method::Probes;
    let cloud = cloud.filter(|_| lights || args.backdrop.shows_points());
    let scan = cloud.map(|path| load::scan(args, path, Some(&object), lights, &mut clock)).transpose()?;
    let mut scan = scan.unwrap_or_default();
    let world_from_object = load::placement(args, scan.origin);
    let placed = object.clone().transformed(world_from_object);
    let camera = load::camera(args, placed.bounds(), scan.origin)?;
    bar.finish_and_clear();
    let mut profile = Profile::default();
    let mut lit = None;
    if !args.lamps.lamps.is_empty() {
        let view = (&placed, &camera);
        lit = Some(clock.time("lamps", || lamps::light_scan(args, &context, &mut scan, view, &mut profile))?);
    }

    let single = source.frames.start() == source.frames.end();
    // In a sequence the scan's buffers stay beside the object's.
    let share = if single || !args.backdrop.shows_points() { 1 } else { 2 };
    let settings = settings(args, method);
    let settings = Settings { memory_budget: settings.memory_budget / share, ..settings };
    let bar = match single {
        true => progress::bar("lighting", 1),
        false => progress::bar("frames", source.frames.end() - source.frames.start() + 1),
    };
    let object = Placed { own: &object, object: &placed, world_from_object };
    let set = Set { args, context, method, settings, scan, object, lit, camera, names, single };
    let mut studio = Studio::new(set, capture);
    studio.totals.profile = profile;
    while let Some(next) = source.next()? {
        studio.light(next.far_field.as_deref(), &mut clock)?;
        if !next.rendered {
            studio.shoot(&next, &mut clock, &bar)?;
            if let Some(journal) = &mut source.journal {
                journal.add(next.number)?;
            }
        }
        if !single {
            bar.set_position(source.done());
        }
    }
    bar.finish_and_clear();
    let Studio { set: Set { context, settings, scan, .. }, totals, covered, captured, .. } = studio;
    let probes = source.stats();
    if let Some(journal) = source.journal.take() {
        journal.close();
    }
    if totals.frames > 0 && covered == 0 {
        tracing::warn!("the camera does not see the object");
    }
    if let Some(path) = &args.stats {
        let (context, settings, scan, clock) = (&*context, &settings, &scan, &clock);
        totals.write(path, &Circumstances { context, method, settings, scan, clock, start, probes })?;
    }
    if let Some(path) = &args.trace {
        trace.write(path)?;
    }
    if let Some(file) = captured {
        say!("capture: {}", file.display())?;
    }
    let (out, device, mean) = (args.out.display(), &context.capabilities.name, totals.mean_ms());
    if single {
        return say!("{out}: {covered} pixels lit by {method} in {mean:.0} ms on {device}");
    }
    let ((first, last), new) = (source.frames.into_inner(), totals.frames);
    say!("{out}: frames {first} to {last}, {new} of them new, lit by {method} in {mean:.0} ms each on {device}")
}

/// Settings of the techniques that gather the cloud's light; the others take what they have in common.
fn settings(args: &Args, method: Method) -> Settings {
    let quality = args.quality.settings();
    Settings {
        technique: if let Method::Cloud(technique) = method { technique } else { quality.technique },
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
    }
}
