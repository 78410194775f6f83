//! LAS and LAZ (ASPRS): aerial and terrestrial laser scans.

use std::path::Path;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use las::{Header, PointData, PointDataBuilder, Reader};
use rayon::prelude::*;

use super::check_regular;
use super::color::decode_srgb;
use super::points::Points;
use super::source::Scan;
use super::table::{Field, Kind, Table};
use crate::scene::Cloud;
use crate::{Error, Result};

/// Points that are decoded at a time, so that a header that promises too many cannot reserve more than this.
const BATCH: u64 = 1 << 16;

/// How much of a file is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// Coordinates and colours.
    Points,
    /// All columns too.
    Everything,
}

/// Reads all points of a .las or .laz file. Colours are sRGB of 16 bits, or of 8 bits where no value of the file is
/// above 255. Coordinates far from zero are moved: [`Cloud::origin`]. Neither turned (such files have Z up) nor
/// completed: see [`super::cloud::load`].
///
/// # Errors
/// [`Error::File`] where the file is no LAS, is damaged or cut short, or has no points or no colours.
pub fn read(path: &Path) -> Result<Cloud> {
    read_scan(path, Wanted::Points)?.into_cloud(path)
}

/// The points and, where wanted, all columns: coordinates as doubles, the rest as in the file.
pub(super) fn read_scan(path: &Path, wanted: Wanted) -> Result<Scan> {
    // The LAZ decoder asserts what a damaged file can break (sizes in its own records against the points').
    let Records { positions, codes, columns, left_out } = std::panic::catch_unwind(|| read_records(path, wanted))
        .unwrap_or_else(|_| Err(Error::file(path, "is damaged: its compressed points make no sense")))?;
    let brightest = codes.iter().map(|&(r, g, b)| r.max(g).max(b)).max().unwrap_or(0);
    let white = if brightest <= 255 { 255.0 } else { 65535.0 };
    let decode = |code: u16| decode_srgb(f32::from(code) / white);
    let colors = codes.par_iter().map(|&(r, g, b)| Vec3::new(decode(r), decode(g), decode(b))).collect();
    let rows = if wanted == Wanted::Everything { positions.len() } else { 0 };
    let table = Table::new(rows, columns.fields, Arc::new(columns.bytes), false)
        .ok_or_else(|| Error::file(path, "is damaged: its columns differ in length"))?;
    let points = Points { positions, colors, normals: Vec::new(), viewpoint: None, gaps_are_normal: false };
    Ok(Scan { points, table, comments: Vec::new(), left_out })
}

/// All points of a file.
struct Records {
    positions: Vec<DVec3>,
    /// 16-bit colour codes as the file has them.
    codes: Vec<(u16, u16, u16)>,
    /// Without rows where only points are wanted.
    columns: Columns,
    /// What the columns lack, in words.
    left_out: Vec<String>,
}

fn read_records(path: &Path, wanted: Wanted) -> Result<Records> {
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
    let (mut positions, mut codes, mut columns) = (Vec::new(), Vec::new(), Columns::new(header));
    while (positions.len() as u64) < promised {
        let batch = reader
            .read_points(BATCH.min(promised - positions.len() as u64))
            .map_err(|e| Error::file(path, format!("is damaged or cut short among its {promised} points: {e}")))?;
        let before = positions.len();
        positions.extend(batch.x().zip(batch.y()).zip(batch.z()).map(|((x, y), z)| DVec3::new(x, y, z)));
        codes.extend(batch.rgb().into_iter().flatten());
        if wanted == Wanted::Everything {
            columns.append(&batch);
        }
        if positions.len() == before || codes.len() != positions.len() {
            return Err(too_short(before as u64));
        }
    }
    let waveform = format.has_waveform.then(|| "waveforms".to_owned());
    let extra = (format.extra_bytes > 0).then(|| format!("{} extra bytes a point", format.extra_bytes));
    Ok(Records { positions, codes, columns, left_out: waveform.into_iter().chain(extra).collect() })
}

/// All columns but waveforms and extra bytes, row by row.
struct Columns {
    fields: Vec<Field>,
    stride: usize,
    bytes: Vec<u8>,
}

/// Name, type and little-endian bits of a column.
type Numbers<'a> = (&'static str, Kind, Box<dyn Iterator<Item = u64> + 'a>);

impl Columns {
    fn new(header: &Header) -> Self {
        let none = PointDataBuilder::new().for_header(header).build();
        let mut stride = 0;
        let mut fields: Vec<Field> = numbers(&none)
            .into_iter()
            .map(|(name, kind, _)| {
                stride += kind.size();
                Field { name: name.into(), kind, count: 1, offset: stride - kind.size(), stride: 0 }
            })
            .collect();
        fields.iter_mut().for_each(|field| field.stride = stride);
        Self { fields, stride, bytes: Vec::new() }
    }

    fn append(&mut self, batch: &PointData) {
        let start = self.bytes.len();
        self.bytes.resize(start + batch.len() * self.stride, 0);
        for (field, (_, kind, column)) in self.fields.iter().zip(numbers(batch)) {
            for (row, bits) in self.bytes[start..].chunks_exact_mut(self.stride).zip(column) {
                row[field.offset..field.offset + kind.size()].copy_from_slice(&bits.to_le_bytes()[..kind.size()]);
            }
        }
    }
}

/// The columns of some points, in the order of the specification.
fn numbers(batch: &PointData) -> Vec<Numbers<'_>> {
    fn column<'a>(name: &'static str, kind: Kind, bits: impl Iterator<Item = u64> + 'a) -> Numbers<'a> {
        (name, kind, Box::new(bits))
    }
    // Bits of the two or three bytes of flags, whose places the specification gives (LAS 1.4 R15, tables 8 and 16).
    let extended = batch.format().is_extended;
    let flags = move |plain: (usize, u8, u8), long: (usize, u8, u8)| {
        let (byte, shift, mask) = if extended { long } else { plain };
        batch.raw_bytes().chunks_exact(batch.record_len()).map(move |record| u64::from(record[byte] >> shift & mask))
    };
    let mut all = vec![
        column("x", Kind::F64, batch.x().map(f64::to_bits)),
        column("y", Kind::F64, batch.y().map(f64::to_bits)),
        column("z", Kind::F64, batch.z().map(f64::to_bits)),
        column("intensity", Kind::U16, batch.intensity().map(u64::from)),
        column("return_number", Kind::U8, batch.return_number().map(u64::from)),
        column("number_of_returns", Kind::U8, batch.number_of_returns().map(u64::from)),
        column("scan_direction", Kind::U8, flags((14, 6, 1), (15, 6, 1))),
        column("edge_of_flight_line", Kind::U8, flags((14, 7, 1), (15, 7, 1))),
        column("classification", Kind::U8, batch.classification().map(u64::from)),
        // Synthetic 1, key point 2, withheld 4, overlap 8.
        column("classification_flags", Kind::U8, flags((15, 5, 7), (15, 0, 15))),
        column("scan_angle", Kind::F32, batch.scan_angle_degrees().map(|angle| u64::from(angle.to_bits()))),
        column("user_data", Kind::U8, batch.user_data().map(u64::from)),
        column("point_source_id", Kind::U16, batch.point_source_id().map(u64::from)),
    ];
    if extended {
        all.push(column("scanner_channel", Kind::U8, flags((0, 0, 0), (15, 4, 3))));
    }
    if let Some(time) = batch.gps_time() {
        all.push(column("gps_time", Kind::F64, time.map(f64::to_bits)));
    }
    for (n, name) in ["red", "green", "blue"].into_iter().enumerate() {
        let codes = batch.rgb().into_iter().flatten();
        all.push(column(name, Kind::U16, codes.map(move |(r, g, b)| u64::from([r, g, b][n]))));
    }
    if let Some(infrared) = batch.nir() {
        all.push(column("nir", Kind::U16, infrared.map(u64::from)));
    }
    all
}
