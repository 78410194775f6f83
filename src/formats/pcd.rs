//! PCD (Point Cloud Library): depth cameras. pcd-rs reads the header; the body is read here, because its reader trusts
//! the header's numbers.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use pcd_rs::{DataKind, PcdMeta, ValueKind, ViewPoint};

use super::points::Points;
use super::source::Scan;
use super::table::{Field, Kind, Table};
use super::{excerpt, read_bytes};
use crate::scene::Cloud;
use crate::{Error, Result};

/// Reads a cloud from an ASCII, binary or binary_compressed file: x, y, z, colours packed as rgb or rgba (or three
/// columns), normal_x, normal_y, normal_z where there are any (zero where unusable). NaN points of an organised cloud
/// (height above 1) are gaps and are dropped in silence. The viewpoint is known for organised clouds, and for others
/// where it is not the default. Neither turned nor completed: see [`super::cloud::load`].
///
/// # Errors
/// [`Error::File`] where the file is no PCD, is damaged or cut short, or holds no valid point or no colours.
pub fn read(path: &Path) -> Result<Cloud> {
    read_scan(path)?.into_cloud(path)
}

/// The points and all columns.
pub(super) fn read_scan(path: &Path) -> Result<Scan> {
    let bytes = Arc::new(read_bytes(path)?);
    let mut body = bytes.as_slice();
    let meta =
        PcdMeta::from_reader(&mut body).map_err(|e| Error::file(path, format!("is not a readable PCD file: {e}")))?;
    let table = match meta.data {
        DataKind::Binary => {
            let start = bytes.len() - body.len();
            Layout::rows(path, &meta)?.table(path, Arc::clone(&bytes), start)?
        }
        DataKind::BinaryCompressed => read_compressed(path, &meta, body)?,
        DataKind::Ascii => read_ascii(path, &meta, body)?,
    };
    let mut points = Points::from_table(path, &table)?;
    let organised = meta.height > 1;
    points.gaps_are_normal = organised;
    if organised || meta.viewpoint != ViewPoint::default() {
        points.viewpoint = Some(DVec3::new(meta.viewpoint.tx, meta.viewpoint.ty, meta.viewpoint.tz));
    }
    Ok(Scan { points, table, comments: Vec::new(), left_out: Vec::new() })
}

/// Where the fields lie in the body.
struct Layout {
    fields: Vec<Field>,
    rows: usize,
    /// Bytes of the whole body.
    size: usize,
}

impl Layout {
    /// Row by row.
    fn rows(path: &Path, meta: &PcdMeta) -> Result<Self> {
        let overflow = || Error::file(path, "has a header that promises more than any file can hold");
        let rows = usize::try_from(meta.num_points).map_err(|_| overflow())?;
        let mut fields = Vec::new();
        let mut offset = 0usize;
        for field in &meta.field_defs {
            let kind = kind_of(field.kind);
            let count = usize::try_from(field.count).map_err(|_| overflow())?;
            fields.push(Field { name: field.name.clone(), kind, count, offset, stride: 0 });
            let bytes = count.checked_mul(kind.size());
            offset = bytes.and_then(|b| b.checked_add(offset)).ok_or_else(overflow)?;
        }
        fields.iter_mut().for_each(|field| field.stride = offset);
        let size = offset.checked_mul(rows).ok_or_else(overflow)?;
        Ok(Self { fields, rows, size })
    }

    /// Field by field, as in a compressed body.
    fn columns(path: &Path, meta: &PcdMeta) -> Result<Self> {
        let mut layout = Self::rows(path, meta)?;
        for field in &mut layout.fields {
            // No overflow: the sum over all fields was `size`.
            field.offset *= layout.rows;
            field.stride = field.count * field.kind.size();
        }
        Ok(layout)
    }

    /// The columns in the body, which begins at byte `start`.
    fn table(self, path: &Path, bytes: Arc<Vec<u8>>, start: usize) -> Result<Table> {
        let Self { mut fields, rows, size } = self;
        let held = bytes.len() - start;
        let too_short = || {
            Error::file(
                path,
                format!("is cut short: its header promises {rows} points ({size} bytes), it holds {held} bytes"),
            )
        };
        if held < size {
            return Err(too_short());
        }
        fields.iter_mut().for_each(|field| field.offset += start);
        Table::new(rows, fields, bytes, false).ok_or_else(too_short)
    }
}

fn kind_of(kind: ValueKind) -> Kind {
    match kind {
        ValueKind::U8 => Kind::U8,
        ValueKind::U16 => Kind::U16,
        ValueKind::U32 => Kind::U32,
        ValueKind::U64 => Kind::U64,
        ValueKind::I8 => Kind::I8,
        ValueKind::I16 => Kind::I16,
        ValueKind::I32 => Kind::I32,
        ValueKind::I64 => Kind::I64,
        ValueKind::F32 => Kind::F32,
        ValueKind::F64 => Kind::F64,
    }
}

/// A compressed body: both sizes as u32, then LZF.
fn read_compressed(path: &Path, meta: &PcdMeta, body: &[u8]) -> Result<Table> {
    let layout = Layout::columns(path, meta)?;
    let word = |at: usize| body.get(at..at + 4).and_then(|b| b.try_into().ok()).map(|b| u32::from_le_bytes(b) as usize);
    let (Some(packed), Some(unpacked)) = (word(0), word(4)) else {
        return Err(Error::file(path, "is cut short: it ends before its compressed data"));
    };
    let data = body.get(8..).and_then(|d| d.get(..packed)).ok_or_else(|| {
        let held = body.len() - 8;
        Error::file(path, format!("is cut short: it promises {packed} bytes of compressed data, it holds {held}"))
    })?;
    if unpacked != layout.size {
        let Layout { rows, size, .. } = layout;
        let problem = format!("is damaged: {rows} points need {size} bytes, its compressed data claims {unpacked}");
        return Err(Error::file(path, problem));
    }
    let columns = lzf_decompress(data, unpacked).ok_or_else(|| Error::file(path, "has damaged compressed data"))?;
    layout.table(path, Arc::new(columns), 0)
}

/// LZF (Marc Lehmann): runs of literals, and copies of what was written before. `None` where the input is damaged or
/// does not come out at `size` bytes.
fn lzf_decompress(mut input: &[u8], size: usize) -> Option<Vec<u8>> {
    // Three bytes of input make at most 264 of output, so that a false size cannot reserve more than that.
    let mut output = Vec::with_capacity(size.min(input.len().saturating_mul(88)));
    while let Some((&control, rest)) = input.split_first() {
        input = rest;
        if control < 32 {
            // 000LLLLL: L + 1 literal bytes.
            let (literals, rest) = input.split_at_checked(usize::from(control) + 1)?;
            output.extend_from_slice(literals);
            input = rest;
        } else {
            // LLLooooo oooooooo: L + 2 bytes from o + 1 bytes back; L = 7 is followed by a byte to add to it.
            let mut length = usize::from(control >> 5) + 2;
            if length == 9 {
                let (&more, rest) = input.split_first()?;
                (length, input) = (length + usize::from(more), rest);
            }
            let (&low, rest) = input.split_first()?;
            input = rest;
            let back = (usize::from(control & 31) << 8 | usize::from(low)) + 1;
            let from = output.len().checked_sub(back)?;
            for at in from..from + length {
                // The copy may overlap what it writes: that is how runs are made.
                output.push(output[at]);
            }
        }
        if output.len() > size {
            return None;
        }
    }
    (output.len() == size).then_some(output)
}

/// One point a line. Numbers go into the same bytes as in a binary file.
fn read_ascii(path: &Path, meta: &PcdMeta, body: &[u8]) -> Result<Table> {
    let layout = Layout::rows(path, meta)?;
    let text = String::from_utf8_lossy(body);
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let mut bytes = Vec::new();
    for row in 0..layout.rows {
        let Some(line) = lines.next() else {
            let rows = layout.rows;
            return Err(Error::file(path, format!("is cut short: its header promises {rows} points, it holds {row}")));
        };
        let mut words = line.split_ascii_whitespace();
        for field in &meta.field_defs {
            let kind = kind_of(field.kind);
            for _ in 0..field.count {
                let number = words.next().and_then(|word| kind.parse(word)).ok_or_else(|| {
                    Error::file(path, format!("point {} is not understood: '{}'", row + 1, excerpt(line)))
                })?;
                bytes.extend_from_slice(&number.to_le_bytes()[..kind.size()]);
            }
        }
    }
    layout.table(path, Arc::new(bytes), 0)
}
