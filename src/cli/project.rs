//! `relume project`: a light probe in spherical harmonics.

use std::path::PathBuf;

use serde::Serialize;

use super::output::say;
use super::render::write_json;
use super::values::{self, Window};
use crate::Result;
use crate::formats::image::read_photo;
use crate::gpu::{Context, ContextOptions, Profile};
use crate::passes::probe_light::{ProbeLight, Projection};
use crate::probes::{Mapping, unwrap};
use crate::scene::harmonics::band;

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Probe: .exr or .hdr
    #[arg(long, value_name = "FILE")]
    probe: PathBuf,
    /// What its picture shows: lat-long, mirror-ball or angular
    #[arg(long, value_name = "MAPPING", default_value = "lat-long")]
    mapping: Mapping,
    /// Bands, 1 to 5
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = values::order)]
    order: usize,
    /// Against ringing
    #[arg(long, value_enum, default_value_t = Window::None)]
    window: Window,
    /// Halve the probe until it is at most so wide before it is projected
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(1..))]
    probe_width: Option<u32>,
    /// Coefficients as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Part of the device's name [default: the best]
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
}

/// Contents of `--json`.
#[derive(Serialize)]
struct Report<'a> {
    device: &'a str,
    width: u32,
    height: u32,
    order: usize,
    window: &'a str,
    coefficients: Vec<Coefficient>,
}

/// One basis function's.
#[derive(Serialize)]
struct Coefficient {
    l: usize,
    m: isize,
    rgb: [f32; 3],
}

pub(super) fn run(args: &Args) -> Result<()> {
    if let Some(json) = &args.json {
        values::check_output(json, &["json"])?;
    }
    let panorama = unwrap(&read_photo(&args.probe)?, args.mapping, None);
    let context = Context::new(&ContextOptions { device: args.device.clone(), validation: false })?;
    let hanning = args.window == Window::Hanning;
    let projection = Projection { order: args.order, hanning, width: args.probe_width, rows: None };
    let mut light = ProbeLight::new(&context, projection, false)?;
    light.set(&panorama, 0.0, &mut Profile::default())?;
    let coefficients: Vec<Coefficient> = light
        .coefficients()?
        .into_iter()
        .enumerate()
        .map(|(k, rgb)| {
            let l = band(k);
            Coefficient { l, m: k as isize - (l * l + l) as isize, rgb: rgb.into() }
        })
        .collect();
    say!("{:>2} {:>3} {:>14} {:>14} {:>14}", "l", "m", "red", "green", "blue")?;
    for Coefficient { l, m, rgb: [r, g, b] } in &coefficients {
        say!("{l:>2} {m:>3} {r:>14.6} {g:>14.6} {b:>14.6}")?;
    }
    let Some(json) = &args.json else { return Ok(()) };
    let [width, height] = light.projected_size().unwrap_or_default();
    let window = if hanning { "hanning" } else { "none" };
    let device = &context.capabilities.name;
    write_json(json, &Report { device, width, height, order: args.order, window, coefficients })
}
