//! `relume compare`: how far an image is from a reference.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{render, values};
use crate::compare::{self, Image, Metrics, difference_map};
use crate::formats::image;
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Image to judge, .exr; where its alpha is above 0.5 it counts
    #[arg(value_name = "A.exr")]
    a: PathBuf,
    /// Reference, .exr
    #[arg(value_name = "B.exr")]
    b: PathBuf,
    /// The numbers
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
    /// Where A is darker (blue) or brighter (red) than B, relative to B's mean luminance
    #[arg(long, value_name = "FILE.png")]
    map: Option<PathBuf>,
}

/// Contents of `--json`; the names are those of the table.
#[derive(Serialize)]
struct Report<'a> {
    a: &'a Path,
    b: &'a Path,
    relative_rms_luminance: f64,
    rgb_rms: f64,
    bias: f64,
    ssim: f64,
    flip: f64,
    pixels: usize,
}

pub(super) fn run(args: &Args) -> Result<()> {
    if let Some(json) = &args.json {
        values::check_output(json, &["json"])?;
    }
    if let Some(map) = &args.map {
        values::check_output(map, &["png"])?;
    }
    let (a, b) = (read(&args.a)?, read(&args.b)?);
    let about = |error| match error {
        Error::Argument(problem) => {
            Error::Argument(format!("A = {}, B = {}: {problem}", args.a.display(), args.b.display()))
        }
        other => other,
    };
    let metrics = compare::compare(&a, &b).map_err(about)?;
    if let Some(path) = &args.map {
        let map = difference_map(&a, &b, None).map_err(about)?;
        image::write_png(path, map.width(), map.height(), map.as_raw())?;
    }
    if let Some(path) = &args.json {
        let Metrics { relative_rms_luminance, rgb_rms, bias, ssim, flip, pixels } = metrics;
        let report = Report { a: &args.a, b: &args.b, relative_rms_luminance, rgb_rms, bias, ssim, flip, pixels };
        render::write_json(path, &report)?;
    }
    print!("{}", table(&metrics));
    Ok(())
}

fn read(path: &Path) -> Result<Image> {
    let read = image::read_rgba_exr(path)?;
    Image::new(read.width, read.height, read.rgb, read.alpha)
        .map_err(|error| Error::file(path, format!("cannot be compared: {error}")))
}

/// A line a number: its name, its value, what it means.
fn table(metrics: &Metrics) -> String {
    let line = |name: &str, value: String, meaning: &str| format!("{name:<24}{value:>11}   {meaning}\n");
    [
        line(
            "relative_rms_luminance",
            format!("{:.5}", metrics.relative_rms_luminance),
            "RMS of luminance A - B, over the mean luminance of B",
        ),
        line("rgb_rms", format!("{:.5}", metrics.rgb_rms), "RMS of A - B over channels, radiance"),
        line("bias", format!("{:+.5}", metrics.bias), "mean luminance of A over that of B, less 1"),
        line("ssim", format!("{:.5}", metrics.ssim), "structural similarity, 1 is equal"),
        line("flip", format!("{:.5}", metrics.flip), "FLIP, 0 is equal"),
        line("pixels", metrics.pixels.to_string(), "in A's mask"),
    ]
    .concat()
}
