//! `relume expand`: an HDR cloud from one of low dynamic range and a photo.

mod report;

use std::path::PathBuf;
use std::sync::Mutex;
use std::time::Instant;

use clap::ValueEnum;
use glam::{DVec3, Vec3};

use super::output::say;
use super::{progress, render, values};
use crate::formats::cloud::{CloudOptions, load_with_source};
use crate::formats::expanded::{self, Expanded};
use crate::formats::image::read_photo;
use crate::preprocess::expansion::network::Network;
use crate::preprocess::expansion::{Expansion, Inputs, Options, Origin, Places, ShotsBy, Strategy, Transfer, expand};
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Cloud: .ply, .pcd, .las or .laz
    cloud: PathBuf,
    /// HDR photo of any part of the place, uncalibrated: .exr or .hdr
    #[arg(long, value_name = "FILE")]
    photo: Option<PathBuf>,
    /// Where the expanded cloud goes: all properties of the input, float red green blue, and a flag for each point
    #[arg(short, long, value_name = "OUT.ply")]
    out: PathBuf,
    /// How over-exposed areas are expanded [default: patchmatch, or network without a photo]
    #[arg(long, value_enum)]
    strategy: Option<StrategyName>,
    /// Network of your own: 1x3xHxW sRGB in, linear HDR out
    #[arg(long, value_name = "FILE.onnx")]
    model: Option<PathBuf>,
    /// What is transferred to the points
    #[arg(long, value_enum, default_value_t = TransferName::Rgb)]
    transfer: TransferName,
    /// Places of the shots: auto:N, X,Y,Z;X,Y,Z, or a file with X,Y,Z in each line
    #[arg(long, value_name = "PLACES", default_value = "auto:3", allow_hyphen_values = true)]
    shots: String,
    /// Pixels along a side of a shot's faces
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(32..=4096))]
    shot_size: u32,
    /// How shots are rendered
    #[arg(long, value_enum, default_value_t = ShotsByName::Splats)]
    shots_by: ShotsByName,
    /// Points of a larger luminance are over-exposed (t_l); 1 is the LDR white
    #[arg(long, value_name = "T", default_value = "0.9", value_parser = values::share)]
    threshold: f64,
    /// Matches of a larger squared difference are no matches (t_h)
    #[arg(long, value_name = "T", default_value = "1", value_parser = values::positive)]
    match_threshold: f64,
    /// Folder of a report: one page with all pictures and numbers
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Seed of all random guesses
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// The file's up axis
    #[arg(long, value_enum, default_value_t = render::UpAxis::Y, allow_hyphen_values = true)]
    up: render::UpAxis,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum StrategyName {
    /// By what looks alike in the photo
    Patchmatch,
    /// Landis' inverse tone mapping of the shots
    Landis,
    /// Banterle's inverse tone mapping of the shots
    Banterle,
    /// Landis' inverse tone mapping of the points
    LandisPoints,
    /// Banterle's inverse tone mapping of the points
    BanterlePoints,
    /// A neural network on the shots
    Network,
}

impl StrategyName {
    fn strategy(self) -> Strategy {
        match self {
            Self::Patchmatch => Strategy::PatchMatch,
            Self::Landis => Strategy::Landis,
            Self::Banterle => Strategy::Banterle,
            Self::LandisPoints => Strategy::LandisPoints,
            Self::BanterlePoints => Strategy::BanterlePoints,
            Self::Network => Strategy::Network,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum ShotsByName {
    /// Points as discs in their tangent planes
    Splats,
    /// Points of a pixel each, and pyramids that make a surface of them
    Points,
}

impl From<ShotsByName> for ShotsBy {
    fn from(name: ShotsByName) -> Self {
        match name {
            ShotsByName::Splats => Self::Splats,
            ShotsByName::Points => Self::Points,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum TransferName {
    /// Colour and all
    Rgb,
    /// Luminance alone: points keep the proportions of their LDR colours
    Luminance,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let start = Instant::now();
    values::check_output(&args.out, &["ply"])?;
    let strategy = match (args.strategy, &args.photo) {
        (Some(name), _) => name.strategy(),
        (None, Some(_)) => Strategy::PatchMatch,
        (None, None) => Strategy::Network,
    };
    if args.model.is_some() && strategy != Strategy::Network {
        return Err(Error::Argument(format!("--model is for --strategy network, not {}", strategy.name())));
    }
    let places = places(&args.shots)?;
    let photo = args.photo.as_ref().map(|path| read_photo(path)).transpose()?;
    let network = args.model.as_ref().map(|path| Network::read(path)).transpose()?;
    let bar = progress::spinner("reading the cloud");
    let reading = Instant::now();
    let options = CloudOptions { up: args.up.into(), orient_towards: None };
    let (cloud, source) = load_with_source(&args.cloud, &options)?;
    let reading = reading.elapsed().as_secs_f64();
    bar.finish_and_clear();

    let inputs = Inputs { cloud: &cloud, photo: photo.as_ref(), network: network.as_ref() };
    let options = Options {
        strategy,
        transfer: match args.transfer {
            TransferName::Rgb => Transfer::Rgb,
            TransferName::Luminance => Transfer::Luminance,
        },
        places: match places {
            ShotPlaces::Auto(count) => Places::Auto(count),
            ShotPlaces::At(places) => Places::At(places.into_iter().map(|at| (at - cloud.origin).as_vec3()).collect()),
        },
        shot_size: args.shot_size,
        shots_by: args.shots_by.into(),
        threshold: args.threshold as f32,
        match_threshold: args.match_threshold as f32,
        seed: args.seed,
        pictures: args.report.is_some(),
        ..Options::default()
    };
    let mut expansion = with_progress(inputs, &options).map_err(|error| named(error, args))?;
    expansion.report.seconds.insert(0, ("reading", reading));

    let bar = progress::spinner("writing");
    let writing = Instant::now();
    let flags: Vec<u8> = expansion.origins.iter().map(|&origin| origin as u8).collect();
    expanded::write(&args.out, &Expanded { source: &source, colors: &expansion.colors, flags: &flags })?;
    expansion.report.seconds.push(("writing", writing.elapsed().as_secs_f64()));
    bar.finish_and_clear();
    if let Some(folder) = &args.report {
        report::write(folder, inputs, &options, &expansion, start.elapsed().as_secs_f64())?;
    }
    tell(args, strategy, &expansion, cloud.origin, start.elapsed().as_secs_f64())
}

/// Errors about the photo or the cloud name its file.
fn named(error: Error, args: &Args) -> Error {
    let Error::Argument(problem) = error else { return error };
    match &args.photo {
        Some(photo) if problem.starts_with("the photo") => Error::file(photo, problem),
        _ if problem.contains("points are over-exposed") => Error::file(&args.cloud, problem),
        _ => Error::Argument(problem),
    }
}

/// Runs an expansion with a bar a step.
pub(super) fn with_progress(inputs: Inputs, options: &Options) -> Result<Expansion> {
    let current = Mutex::new(("", progress::bar("expanding", 1000)));
    let result = expand(inputs, options, &|step, share| {
        if let Ok(mut current) = current.lock() {
            if current.0 != step {
                current.1.finish_and_clear();
                *current = (step, progress::bar(step, 1000));
            }
            current.1.set_position((share * 1000.0) as u64);
        }
    });
    if let Ok(current) = current.lock() {
        current.1.finish_and_clear();
    }
    result
}

/// What `--shots` says, in the coordinates of the turned file.
enum ShotPlaces {
    Auto(usize),
    At(Vec<DVec3>),
}

fn places(text: &str) -> Result<ShotPlaces> {
    const MOST: usize = 64;
    let wrong = |problem: String| Error::Argument(format!("--shots {text}: {problem}"));
    let checked = |places: Vec<DVec3>| match places.len() {
        1..=MOST => Ok(ShotPlaces::At(places)),
        count => Err(wrong(format!("{count} places; give 1 to {MOST}"))),
    };
    if let Some(count) = text.strip_prefix("auto:") {
        return match count.parse() {
            Ok(count) if (1..=MOST).contains(&count) => Ok(ShotPlaces::Auto(count)),
            _ => Err(wrong(format!("{count:?} is not a number of shots, 1 to {MOST}"))),
        };
    }
    let vectors = |parts: Vec<&str>| parts.into_iter().map(values::vector).collect::<Result<Vec<_>, _>>();
    if let Ok(places) = vectors(text.split(';').collect()) {
        return checked(places);
    }
    let path = std::path::Path::new(text);
    if !path.is_file() {
        return Err(wrong("is neither auto:N, nor X,Y,Z;X,Y,Z, nor a file".into()));
    }
    let content = std::fs::read_to_string(path).map_err(|e| Error::file(path, format!("cannot be read: {e}")))?;
    let lines: Vec<&str> = content.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#')).collect();
    checked(vectors(lines).map_err(|problem| Error::file(path, problem))?)
}

fn tell(args: &Args, strategy: Strategy, expansion: &Expansion, origin: DVec3, seconds: f64) -> Result<()> {
    let report = &expansion.report;
    for warning in &report.warnings {
        eprintln!("relume: {warning}");
    }
    if report.over_exposed == 0 {
        say!(
            "{}: no point of {} is over-exposed (luminance above {}): its colours are copied as they are",
            args.out.display(),
            report.points,
            args.threshold
        )?;
        return Ok(());
    }
    if args.photo.is_none() {
        say!(
            "without --photo nothing tells how bright the lights are: {}",
            match strategy {
                Strategy::Network => "the network guesses".to_owned(),
                _ => format!("{} times white is assumed for the brightest", Options::default().maximum),
            }
        )?;
    }
    if let (Some(exposure), Some(alpha)) = (&report.exposure, report.alpha) {
        let found = match &report.registration {
            Some(found) => format!(
                "then {alpha:.3} by {:.0} % of the photo's surfaces, found in the cloud ({:+.1} %)",
                100.0 * found.agreement,
                100.0 * (alpha / exposure.alpha - 1.0)
            ),
            None => "the photo was not found in the cloud".into(),
        };
        say!("exposure: {:.3} by histograms (distance {:.4}); {found}", exposure.alpha, exposure.distance)?;
    }
    for shot in &report.shots {
        let at = shot.as_dvec3() + origin;
        say!("shot from {:.2},{:.2},{:.2}", at.x, at.y, at.z)?;
    }
    let count = |wanted: Origin| expansion.origins.iter().filter(|origin| **origin == wanted).count();
    say!(
        "{} of {} points are over-exposed: {} projected, {} solved, {} filled; {:.1} % seen in no shot",
        report.over_exposed,
        report.points,
        count(Origin::Projected),
        report.solved,
        report.filled,
        100.0 * report.unseen as f64 / report.over_exposed as f64
    )?;
    let brightest = expansion.colors.iter().copied().fold(Vec3::ZERO, Vec3::max).max_element();
    say!("{}: {}, brightest {brightest:.1} times white, {seconds:.1} s", args.out.display(), strategy.name())
}
