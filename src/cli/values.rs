//! Values of flags.

use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};

use crate::frames::{MaterialChoice, Paper};
use crate::preprocess::panorama_room::PanoramaRoom;
use crate::preprocess::transfer::TransferOptions;
use crate::{Error, Result};

/// Places beyond this many metres are refused, as in clouds: their squares must fit f32.
const FARTHEST: f64 = 1e12;

/// What f32 holds with room for a few multiplications.
const LARGEST: f64 = 1e9;

/// Most pixels of an image. A pixel takes about a hundred bytes of the computer's memory until its file is written.
const MOST_PIXELS: u64 = 1 << 26;

/// `X,Y,Z`, metres, none of them beyond 1e12.
pub(super) fn vector(text: &str) -> Result<DVec3, String> {
    let wrong = || format!("{text:?} is not X,Y,Z with three numbers from -1e12 to 1e12");
    let numbers: Vec<f64> =
        text.split(',').map(|part| part.trim().parse()).collect::<Result<_, _>>().map_err(|_| wrong())?;
    match numbers[..] {
        [x, y, z] if numbers.iter().all(|n| n.abs() <= FARTHEST) => Ok(DVec3::new(x, y, z)),
        _ => Err(wrong()),
    }
}

/// `X,Y,Z` as [`vector`], but not zero.
pub(super) fn direction(text: &str) -> Result<DVec3, String> {
    let direction = vector(text)?;
    if direction.length() > 1e-9 { Ok(direction) } else { Err(format!("{text:?} is no direction: its length is zero")) }
}

/// `WxH` with both at least 1, and no more pixels than memory could hold.
pub(super) fn size(text: &str) -> Result<(u32, u32), String> {
    let wrong = || format!("{text:?} is not a size, WxH with both from 1 to 32768");
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(wrong)?;
    let parse = |side: &str| side.parse::<u32>().ok().filter(|n| (1..=32_768).contains(n)).ok_or_else(wrong);
    let (width, height) = (parse(width)?, parse(height)?);
    if u64::from(width) * u64::from(height) > MOST_PIXELS {
        return Err(format!("{text:?} is more than {MOST_PIXELS} pixels, as many as 8192x8192 has"));
    }
    Ok((width, height))
}

/// `WxHxD`, metres, each in [`PanoramaRoom::SIDES`].
pub(super) fn box_size(text: &str) -> Result<Vec3, String> {
    let (low, high) = (PanoramaRoom::SIDES.start(), PanoramaRoom::SIDES.end());
    let wrong = || format!("{text:?} is not a box, WxHxD with three numbers of metres from {low} to {high}");
    let side = |part: &str| part.parse().ok().filter(|side| PanoramaRoom::SIDES.contains(side));
    let sides: Vec<f32> = text.split(['x', 'X']).map(side).collect::<Option<_>>().ok_or_else(wrong)?;
    <[f32; 3]>::try_from(sides).map(Vec3::from).map_err(|_| wrong())
}

/// A number of points in [`PanoramaRoom::POINTS`].
pub(super) fn room_points(text: &str) -> Result<usize, String> {
    let (low, high) = (PanoramaRoom::POINTS.start(), PanoramaRoom::POINTS.end());
    let number = text.parse().ok().filter(|points| PanoramaRoom::POINTS.contains(points));
    number.ok_or(format!("{text:?} is not a number of points, from {low} to {high}"))
}

/// A number above 0.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    number(text, 1.0 / LARGEST, LARGEST).ok_or(format!("{text:?} is not a number above 0, from 1e-9 to 1e9"))
}

/// A number of at least 0.
pub(super) fn not_negative(text: &str) -> Result<f64, String> {
    number(text, 0.0, LARGEST).ok_or(format!("{text:?} is not a number from 0 to 1e9"))
}

/// A number above 0 and at most 1.
pub(super) fn share(text: &str) -> Result<f64, String> {
    number(text, f64::MIN_POSITIVE, 1.0).ok_or(format!("{text:?} is not a number above 0 and at most 1"))
}

/// The cosine of an angle.
pub(super) fn cosine(text: &str) -> Result<f64, String> {
    number(text, -1.0, 1.0).ok_or(format!("{text:?} is not a number from -1 to 1"))
}

/// A number from `low` to `high`. NaN is neither.
fn number(text: &str, low: f64, high: f64) -> Option<f64> {
    text.parse().ok().filter(|n| (low..=high).contains(n))
}

/// A finite number.
pub(super) fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|n: &f64| n.is_finite()).ok_or(format!("{text:?} is not a finite number"))
}

/// A vertical field of view in degrees.
pub(super) fn field_of_view(text: &str) -> Result<f64, String> {
    number(text, 0.1, 170.0).ok_or(format!("{text:?} is not a field of view, 0.1 to 170 degrees"))
}

/// An even micro-buffer size.
pub(super) fn microbuffer(text: &str) -> Result<u32, String> {
    text.parse()
        .ok()
        .filter(|n| crate::frames::Settings::MICROBUFFER.contains(n) && n % 2 == 0)
        .ok_or(format!("{text:?} is not an even size from 8 to 64"))
}

/// Bands of spherical harmonics.
pub(super) fn order(text: &str) -> Result<usize, String> {
    let range = TransferOptions::ORDER;
    text.parse().ok().filter(|n| range.contains(n)).ok_or(format!("{text:?} is not an order of 1 to {}", range.end()))
}

/// Directions of a transfer.
pub(super) fn directions(text: &str) -> Result<u32, String> {
    let range = TransferOptions::SAMPLES;
    let wrong = || format!("{text:?} is not a number of directions from {} to {}", range.start(), range.end());
    text.parse().ok().filter(|n| range.contains(n)).ok_or_else(wrong)
}

/// Bounces of a transfer.
pub(super) fn bounces(text: &str) -> Result<u32, String> {
    let range = TransferOptions::BOUNCES;
    text.parse()
        .ok()
        .filter(|n| range.contains(n))
        .ok_or(format!("{text:?} is not a number of bounces up to {}", range.end()))
}

/// A window against the ringing of spherical harmonics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Window {
    /// All bands as they are
    None,
    /// Higher bands fade
    Hanning,
}

/// `file`, `diffuse:ALBEDO` or `metal:ALPHA`.
pub(super) fn material(text: &str) -> Result<MaterialChoice, String> {
    text.parse()
}

/// Comma-separated parts of the paper's method, or `all`.
pub(super) fn paper(text: &str) -> Result<Paper, String> {
    let mut paper = Paper::default();
    for part in text.split(',') {
        match part {
            "image" => paper.image = true,
            "coverage" => paper.coverage = true,
            "weights" => paper.weights = true,
            "cut" => paper.cut = true,
            "all" => paper = Paper::ALL,
            other => return Err(format!("{other:?} is no part; there are image, coverage, weights, cut and all")),
        }
    }
    Ok(paper)
}

/// What a file will be written to, found out before any work is done.
pub(super) fn check_output(path: &Path, extensions: &[&str]) -> Result<()> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if !extensions.contains(&extension.as_str()) {
        let known = extensions.iter().map(|e| format!(".{e}")).collect::<Vec<_>>().join(" or ");
        return Err(Error::file(path, format!("cannot be written: its name must end in {known}")));
    }
    let folder = match path.parent() {
        Some(parent) if parent != Path::new("") => parent.to_owned(),
        _ => PathBuf::from("."),
    };
    if !folder.is_dir() {
        return Err(Error::file(path, format!("cannot be written: there is no folder {}", folder.display())));
    }
    if path.is_dir() {
        return Err(Error::file(path, "cannot be written: it is a folder"));
    }
    // Whether the folder takes a new file is only known by trying.
    let probe = folder.join(format!(".relume-probe-{}", std::process::id()));
    match std::fs::File::create(&probe) {
        Ok(_) => {
            // The probe exists, since it was just made.
            let _ = std::fs::remove_file(&probe);
            Ok(())
        }
        Err(error) => Err(Error::file(path, format!("cannot be written: {error}"))),
    }
}
