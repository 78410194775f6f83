//! `relume bake`: a cloud made from a panorama.

use std::path::PathBuf;

use glam::Vec3;

use super::output::say;
use super::{progress, values};
use crate::formats::{image, ply};
use crate::preprocess::panorama_room::{PanoramaRoom, panorama_room};
use crate::{Error, Result};

/// Seed of the points' places: the same room comes out the same.
const SEED: u64 = 1;

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Lat-long panorama of linear radiance, .exr or .hdr; its middle looks along -Z
    #[arg(long, value_name = "FILE")]
    panorama: PathBuf,
    /// Width (x), height (y) and depth (z) of the room in metres, 0.01 to 10000 each; it stands on y = 0 about x = z = 0
    #[arg(long = "box", value_name = "WxHxD", value_parser = values::box_size, allow_hyphen_values = true)]
    size: Vec3,
    /// Height above the floor that the panorama was taken at, metres [default: half of the room's height]
    #[arg(long, value_name = "M", value_parser = values::positive, allow_hyphen_values = true)]
    eye_height: Option<f64>,
    /// About how many points, 6 to 33554432
    #[arg(long, value_name = "N", value_parser = values::room_points, allow_hyphen_values = true, default_value = "800000")]
    points: usize,
    /// Where the cloud goes
    #[arg(short, long, value_name = "CLOUD.ply")]
    out: PathBuf,
}

pub(super) fn run(args: &Args) -> Result<()> {
    values::check_output(&args.out, &["ply"])?;
    let eye_height = args.eye_height.map_or(0.5 * args.size.y, |height| height as f32);
    if eye_height >= args.size.y {
        let height = args.size.y;
        return Err(Error::Argument(format!(
            "--eye-height: {eye_height} m is not below the room's height of {height} m"
        )));
    }
    let bar = progress::spinner("reading the panorama");
    let panorama = image::read_far_field(&args.panorama)?;
    bar.set_message("projecting");
    let options = PanoramaRoom { size: args.size, eye_height, points: args.points, seed: SEED };
    let cloud = panorama_room(&panorama, &options)?;
    bar.set_message("writing");
    ply::write_cloud(&args.out, &cloud)?;
    bar.finish_and_clear();
    let spacing = cloud.spacing.iter().fold(0.0_f32, |most, &spacing| most.max(spacing));
    let (points, millimetres) = (cloud.len(), 1000.0 * spacing);
    say!("{points} points, {millimetres:.1} mm apart, in a room of {} m: {}", sides(args.size), args.out.display())
}

fn sides(size: Vec3) -> String {
    size.to_array().map(|side| side.to_string()).join(" x ")
}
