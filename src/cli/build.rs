//! `relume build`: the hierarchy of a cloud, saved.

use std::path::PathBuf;

use super::output::say;
use super::{progress, render, values};
use crate::Result;
use crate::formats::bsh;
use crate::preprocess::hierarchy::{self, BuildOptions, ColorRule};

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Cloud: .ply, .pcd, .las or .laz
    cloud: PathBuf,
    /// Where the hierarchy goes
    #[arg(short, long, value_name = "OUT.bsh")]
    out: PathBuf,
    /// The file's up axis
    #[arg(long, value_enum, default_value_t = render::UpAxis::Y, allow_hyphen_values = true)]
    up: render::UpAxis,
    /// Where estimated normals look, when the file does not know where the scanner stood [default: the middle]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    towards: Option<glam::DVec3>,
    /// Colour threshold of the pruning, t_c; 0 prunes nothing
    #[arg(long, value_name = "T", value_parser = values::not_negative, allow_hyphen_values = true, default_value = "0.01")]
    prune_color: f64,
    /// Normal threshold of the pruning, t_n
    #[arg(long, value_name = "T", value_parser = values::cosine, allow_hyphen_values = true, default_value = "0.98")]
    prune_normal: f64,
    /// Measure colours absolutely, as the paper does, and not relative to their own brightness
    #[arg(long)]
    prune_absolute: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    values::check_output(&args.out, &["bsh"])?;
    let bar = progress::spinner("reading the cloud");
    let cloud = render::load_cloud(&args.cloud, args.up, args.towards)?;
    bar.set_message("building");
    let options = BuildOptions {
        color_threshold: args.prune_color as f32,
        normal_threshold: args.prune_normal as f32,
        color_rule: if args.prune_absolute { ColorRule::Absolute } else { ColorRule::Relative },
        ..BuildOptions::default()
    };
    let (built, report) = hierarchy::build(&cloud, &options)?;
    bsh::write(&args.out, &built, bsh::BshInfo { points: cloud.len() as u64, origin: cloud.origin })?;
    bar.finish_and_clear();
    say!(
        "{} points, {} nodes ({} before pruning), depth {}; {}",
        report.points,
        report.nodes_after,
        report.nodes_before,
        report.depth,
        report.seconds.iter().map(|(step, s)| format!("{step} {s:.2} s")).collect::<Vec<_>>().join(", ")
    )?;
    say!("{}", args.out.display())?;
    Ok(())
}
