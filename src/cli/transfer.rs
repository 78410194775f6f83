//! `relume transfer`: what distant light does at the vertices of an object, computed once and saved.

use std::path::PathBuf;
use std::time::Instant;

use super::output::say;
use super::{progress, values};
use crate::formats::{object, prt};
use crate::preprocess::transfer::{TransferOptions, compute};
use crate::{Error, Result};

/// Steps of the progress bar.
const STEPS: u64 = 1000;

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Object: .gltf, .glb, .obj or .ply
    #[arg(long, value_name = "FILE")]
    object: PathBuf,
    /// Bands of the spherical harmonics, 1 to 5
    #[arg(long, value_name = "N", default_value_t = TransferOptions::default().order)]
    order: usize,
    /// About how many directions a vertex over the whole sphere, 1 to 1000000
    #[arg(long, value_name = "N", default_value_t = TransferOptions::default().samples)]
    samples: u32,
    /// How often the object reflects light onto itself, 0 to 64
    #[arg(long, value_name = "N", default_value_t = 0)]
    bounces: u32,
    /// Leave out the object's shadows on itself
    #[arg(long, conflicts_with = "bounces")]
    no_visibility: bool,
    /// Where the transfer goes
    #[arg(short, long, value_name = "OUT.prt")]
    out: PathBuf,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let options = TransferOptions {
        order: args.order,
        samples: args.samples,
        bounces: args.bounces,
        visibility: !args.no_visibility,
    };
    options.check()?;
    values::check_output(&args.out, &["prt"])?;
    // Some other file of that name was not meant.
    prt::is_saved_transfer(&args.out)?;
    let spinner = progress::spinner("reading the object");
    let object = object::load(&args.object)?;
    spinner.finish_and_clear();
    let bar = progress::bar("tracing", STEPS);
    let start = Instant::now();
    // Threads come by in any order: the bar never goes back.
    let show = |share: f32| bar.set_position(bar.position().max((share * STEPS as f32) as u64));
    let transfer = compute(&object, &options, &show)?;
    let seconds = start.elapsed().as_secs_f64();
    bar.finish_and_clear();
    prt::write(&args.out, &transfer, prt::key(&object, options.bounces))?;
    // Half of all directions are above a horizon, and each bounce traces them again.
    let rays = transfer.vertices as u64 * u64::from(transfer.samples) / 2 * u64::from(1 + transfer.bounces);
    let bytes = std::fs::metadata(&args.out).map_err(|e| Error::file(&args.out, format!("cannot be read: {e}")))?.len();
    let (vertices, triangles) = (transfer.vertices, object.indices.len() / 3);
    say!(
        "{vertices} vertices, {triangles} triangles, about {rays} rays, {seconds:.2} s, {bytes} bytes: {}",
        args.out.display()
    )
}
