//! `relume view`: the desktop viewer.

use std::path::PathBuf;

use super::lamp_flags::LampArgs;
use super::probe_flags::ProbeArgs;
use super::render::{self, UpAxis};
use super::values;
use crate::frames::Method;
use crate::gpu::ContextOptions;
use crate::gpu::reload::Reload;
use crate::probes::Late;
use crate::viewer::state::ProbeChoice;
use crate::viewer::{self, ViewState};
use crate::{Error, Result};

/// Where a scene without a file is saved.
const SCENE: &str = "scene.toml";
/// Size of the window where nothing else is said, pixels.
const SIZE: [u32; 2] = [1280, 720];

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Cloud (.ply, .pcd, .las, .laz) or saved hierarchy (.bsh)
    #[arg(long, value_name = "FILE")]
    cloud: Option<PathBuf>,
    /// Object: .gltf, .glb, .obj or .ply
    #[arg(long, value_name = "FILE")]
    object: Option<PathBuf>,
    /// Scene to open; the flags beside it win
    #[arg(long, value_name = "FILE.toml")]
    scene: Option<PathBuf>,
    /// The cloud's up axis [default: y]
    #[arg(long, value_enum, allow_hyphen_values = true)]
    up: Option<UpAxis>,
    /// Far field where no point covers: lat-long .exr or .hdr [default: black]
    #[arg(long, value_name = "FILE", conflicts_with = "probes")]
    environment: Option<PathBuf>,
    #[command(flatten)]
    probes: ProbeArgs,
    /// Frames for which there was no time: drop, or wait, which shows them all the same
    #[arg(long, value_name = "HOW", default_value = "drop", requires = "probes")]
    late: Late,
    #[command(flatten)]
    lamps: LampArgs,
    /// Bounces of the lamps' light in the scan, at most 8 [default: 2]
    #[arg(long, value_name = "N", value_parser = values::bounces)]
    bounces: Option<u32>,
    /// classic, mipmapped, hybrid or shared; probes, which lights by the probes alone; or lamps, which shows the scan in
    /// their light without the object [default: by the panel's quality; probes without a cloud]
    #[arg(long)]
    technique: Option<Method>,
    /// Size of the window [default: 1280x720, or the scene's]
    #[arg(long, value_name = "WxH", value_parser = values::size, allow_hyphen_values = true)]
    size: Option<(u32, u32)>,
    /// Part of the device's name [default: the best]
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// Run with the validation layer; its messages are errors
    #[arg(long)]
    validation: bool,
    /// Close after so many frames
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    /// Play inputs from a file, a command a line
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut state = args.scene.as_deref().map(ViewState::read).transpose()?.unwrap_or_default();
    for (own, flag) in [
        (&mut state.cloud, &args.cloud),
        (&mut state.object, &args.object),
        (&mut state.environment, &args.environment),
    ] {
        if flag.is_some() {
            own.clone_from(flag);
        }
    }
    state.up = args.up.map_or(state.up, Into::into);
    state.technique = args.technique.or(state.technique);
    if args.environment.is_some() {
        state.probes = None;
    }
    match &args.probes.probes {
        Some(path) => {
            (state.environment, state.probes) = (None, Some(args.probes.choice(path, args.late)));
            state.playing = true;
        }
        None if args.probes.turn != 0.0 || args.probes.cross_fade.is_some() => {
            return Err(Error::Argument("--turn and --cross-fade need --probes PATTERN".into()));
        }
        None => {}
    }
    args.lamps.replace(&mut state.lamps, args.bounces);
    state.lamps.settings().check()?;
    if state.lamps.lamps.is_empty() && (args.lamps.any_setting() || args.bounces.is_some()) {
        let flags = "--vpls, --interleave, --ism-size, --ism-fill, --scan-light and --bounces";
        return Err(Error::Argument(format!("{flags} need --lamp LAMP")));
    }
    // Before a window opens, what cannot be opened is found.
    state.probes.as_ref().map(ProbeChoice::open).transpose()?;
    for path in [&state.cloud, &state.object, &state.environment].into_iter().flatten() {
        std::fs::File::open(path).map_err(|e| Error::file(path, format!("cannot be read: {e}")))?;
    }
    viewer::run(viewer::Options {
        size: args.size.map(|(width, height)| [width, height]).or(state.size).unwrap_or(SIZE),
        state,
        scene_path: args.scene.clone().unwrap_or_else(|| SCENE.into()),
        context: ContextOptions { device: args.device.clone(), validation: args.validation },
        frames: args.frames,
        script: args.script.clone(),
        write_frame: render::write_frame,
        reload: reload(),
    })
}

/// The shaders of the source tree that this was built from.
#[cfg(feature = "hot-reload")]
fn reload() -> Option<Reload> {
    let source = std::env::var_os("RELUME_GLSL")
        .map_or_else(|| concat!(env!("CARGO_MANIFEST_DIR"), "/glsl").into(), PathBuf::from);
    Some(Reload::new(source, crate::gpu::compile::compile))
}

/// Shaders cannot change without a compiler.
#[cfg(not(feature = "hot-reload"))]
fn reload() -> Option<Reload> {
    None
}
