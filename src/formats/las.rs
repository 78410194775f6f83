//! LAS and LAZ (ASPRS): aerial and terrestrial laser scans.

use std::path::Path;

use glam::{DVec3, Vec3};
use las::Reader;
use rayon::prelude::*;

use super::check_regular;
use super::color::decode_srgb;
use super::points::Points;
use crate::scene::Cloud;
use crate::{Error, Result};

/// Points that are decoded at a time, so that a header that promises too many cannot reserve more than this.
const BATCH: u64 = 1 << 16;

/// Reads all points of a .las or .laz file. Colours are sRGB of 16 bits, or of 8 bits where no value of the file is
/// above 255. Coordinates far from zero are moved: [`Cloud::origin`]. Neither turned (such files have Z up) nor
/// completed: see [`super::cloud::load`].
///
/// # Errors
/// [`Error::File`] where the file is no LAS, is damaged or cut short, or has no points or no colours.
pub fn read(path: &Path) -> Result<Cloud> {
    // The LAZ decoder asserts what a damaged file can break (sizes in its own records against the points').
    let (positions, codes) = std::panic::catch_unwind(|| read_points(path))
        .unwrap_or_else(|_| Err(Error::file(path, "is damaged: its compressed points make no sense")))?;
    let brightest = codes.iter().map(|&(r, g, b)| r.max(g).max(b)).max().unwrap_or(0);
    let white = if brightest <= 255 { 255.0 } else { 65535.0 };
    let decode = |code: u16| decode_srgb(f32::from(code) / white);
    let colors = codes.par_iter().map(|&(r, g, b)| Vec3::new(decode(r), decode(g), decode(b))).collect();
    Points { positions, colors, normals: Vec::new(), viewpoint: None, gaps_are_normal: false }.into_cloud(path)
}

/// 16-bit colour codes as the file has them.
type Codes = Vec<(u16, u16, u16)>;

/// All points: (coordinates, colours).
fn read_points(path: &Path) -> Result<(Vec<DVec3>, Codes)> {
    let bad = |e: las::Error| Error::file(path, format!("is not a readable LAS file: {e}"));
    check_regular(path)?;
    let held = std::fs::metadata(path).map_err(|e| Error::file(path, format!("cannot be read: {e}")))?.len();
    let mut reader = Reader::from_path(path).map_err(bad)?;
    let header = reader.header();
    let (promised, format) = (header.number_of_points(), *header.point_format());
    if !format.has_color {
        let problem =
            format!("has no colours: its points are of format {format}, which has none (2, 3, 5, 7, 8 and 10 have)");
        return Err(Error::file(path, problem));
    }
    let too_short =
        |held: u64| Error::file(path, format!("is cut short: its header promises {promised} points, it holds {held}"));
    if !format.is_compressed {
        let before = header.clone().into_raw().map_err(bad)?.offset_to_point_data;
        let most = held.saturating_sub(before.into()) / u64::from(format.len());
        if promised > most {
            return Err(too_short(most));
        }
    }
    let (mut positions, mut codes) = (Vec::new(), Vec::new());
    while (positions.len() as u64) < promised {
        let batch = reader
            .read_points(BATCH.min(promised - positions.len() as u64))
            .map_err(|e| Error::file(path, format!("is damaged or cut short among its {promised} points: {e}")))?;
        let before = positions.len();
        positions.extend(batch.x().zip(batch.y()).zip(batch.z()).map(|((x, y), z)| DVec3::new(x, y, z)));
        codes.extend(batch.rgb().into_iter().flatten());
        if positions.len() == before || codes.len() != positions.len() {
            return Err(too_short(before as u64));
        }
    }
    Ok((positions, codes))
}
