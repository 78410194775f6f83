//! Expanded clouds: PLY files that keep every property of the file that they were made from, with new colours and with
//! what each point's colour came from.

use std::io::Write;
use std::path::Path;

use glam::Vec3;
use rayon::prelude::*;

use super::points::BRIGHTEST;
use super::source::Source;
use super::table::{ColorFields, Field, Kind};
use super::whole;
use crate::{Error, Result};

/// Name of the property that says what a point's colour came from.
pub const FLAG_PROPERTY: &str = "expansion";

/// What the values of [`FLAG_PROPERTY`] mean, from 0.
pub const FLAG_MEANINGS: [&str; 4] = ["kept", "projected", "solved", "filled"];

/// Rows that are laid out before they are written.
const BATCH: usize = 1 << 18;

/// Rows of one piece of parallel work.
const PIECE: usize = 1 << 12;

/// What goes into one file.
#[derive(Clone, Copy)]
pub struct Expanded<'a> {
    /// The file that the cloud was read from.
    pub source: &'a Source,
    /// Linear radiance of each point, 1.0 being the white of the LDR cloud.
    pub colors: &'a [Vec3],
    /// Index into [`FLAG_MEANINGS`] for each point.
    pub flags: &'a [u8],
}

/// Writes a binary little-endian PLY with one element `vertex`: the properties of the source in their order, each
/// number with its type and its bits as it was (coordinates of the file: neither turned nor moved), points alone that
/// the cloud kept. In the place of the colours there are float red, green, blue, and `uchar expansion` is added at the
/// end, or replaced where the source has it. Header comments stay; a known viewpoint becomes one.
///
/// Left out, with a warning: list properties, other elements (faces would need the dropped points) and a second set of
/// colours. 64-bit integers, which PLY lacks, become doubles, with a warning too.
///
/// # Errors
/// [`Error::Argument`] where there are more or fewer colours or flags than points, a colour is negative, not finite or
/// beyond 1e15, or a flag has no meaning. [`Error::File`] when the file cannot be written; an older file at `path` then
/// stays as it was.
pub fn write(path: &Path, expanded: &Expanded) -> Result<()> {
    expanded.check()?;
    let Layout { columns, lost } = Layout::new(expanded.source);
    if !lost.is_empty() {
        tracing::warn!(
            "{}: not all of {} is in it: {}",
            path.display(),
            expanded.source.path.display(),
            lost.join(", ")
        );
    }
    let header = header(expanded.source, &columns);
    let stride: usize = columns.iter().map(|column| column.kind.size()).sum();
    whole::write(path, |out| {
        let mut write = || {
            out.write_all(&header)?;
            let mut rows = Vec::new();
            for start in (0..expanded.source.len()).step_by(BATCH) {
                rows.resize(BATCH.min(expanded.source.len() - start) * stride, 0);
                rows.par_chunks_mut(PIECE * stride).enumerate().for_each(|(piece, rows)| {
                    for (row, bytes) in rows.chunks_exact_mut(stride).enumerate() {
                        expanded.lay_out(start + piece * PIECE + row, &columns, bytes);
                    }
                });
                out.write_all(&rows)?;
            }
            Ok(())
        };
        write().map_err(|e: std::io::Error| Error::file(path, format!("cannot be written: {e}")))
    })
}

impl Expanded<'_> {
    fn check(&self) -> Result<()> {
        let points = self.source.len();
        for (what, held) in [("colours", self.colors.len()), ("flags", self.flags.len())] {
            if held != points {
                return Err(Error::Argument(format!("an expanded cloud of {points} points has {held} {what}")));
            }
        }
        let usable = |color: &Vec3| color.to_array().iter().all(|channel| (0.0..=BRIGHTEST).contains(channel));
        if let Some(point) = self.colors.iter().position(|color| !usable(color)) {
            let color = self.colors[point];
            return Err(Error::Argument(format!("point {point} of an expanded cloud has the colour {color}")));
        }
        if let Some(flag) = self.flags.iter().find(|&&flag| usize::from(flag) >= FLAG_MEANINGS.len()) {
            return Err(Error::Argument(format!("an expanded cloud has a flag {flag}; there are 0 to 3")));
        }
        Ok(())
    }

    /// One point as the file has it.
    fn lay_out(&self, point: usize, columns: &[Column], mut bytes: &mut [u8]) {
        let table = &self.source.table;
        for column in columns {
            let bits = match column.content {
                Content::Stored { field, n } => match (field.kind, table.bits(field, self.source.kept[point], n)) {
                    (kind @ (Kind::I64 | Kind::U64), bits) => kind.value(bits).to_bits(),
                    (_, bits) => bits,
                },
                Content::Color(channel) => u64::from(self.colors[point][channel].to_bits()),
                Content::Flag => u64::from(self.flags[point]),
            };
            let (number, rest) = bytes.split_at_mut(column.kind.size());
            number.copy_from_slice(&bits.to_le_bytes()[..number.len()]);
            bytes = rest;
        }
    }
}

/// One property.
struct Column<'a> {
    name: String,
    kind: Kind,
    content: Content<'a>,
}

enum Content<'a> {
    /// Number `n` of a field of the source.
    Stored {
        field: &'a Field,
        n: usize,
    },
    /// A channel of the new colours.
    Color(usize),
    Flag,
}

/// All properties, and what of the source they lack.
struct Layout<'a> {
    columns: Vec<Column<'a>>,
    lost: Vec<String>,
}

impl<'a> Layout<'a> {
    fn new(source: &'a Source) -> Self {
        let mut layout = Self { columns: Vec::new(), lost: source.left_out.clone() };
        let colors = source.table.color_fields();
        for (index, field) in source.table.fields().iter().enumerate() {
            let named = |names: &[&str]| names.iter().any(|name| field.name.eq_ignore_ascii_case(name));
            match colors {
                Some(ColorFields::Packed(packed)) if packed == index => (0..3).for_each(|c| layout.add_color(c)),
                Some(ColorFields::Channels(channels)) if channels.contains(&index) => {
                    channels.iter().position(|&channel| channel == index).into_iter().for_each(|c| layout.add_color(c));
                }
                // Readers, ours too, would take them for the new colours.
                _ if named(&["red", "green", "blue", "rgb", "rgba"]) => {
                    layout.lost.push(format!("a second set of colours '{}'", field.name));
                }
                _ if named(&[FLAG_PROPERTY]) => layout.add_flag(),
                // Padding, as the Point Cloud Library writes it.
                _ if named(&["_"]) => {}
                _ => layout.keep(field),
            }
        }
        layout.add_flag();
        layout
    }

    fn add_color(&mut self, channel: usize) {
        let name = ["red", "green", "blue"][channel].to_owned();
        self.columns.push(Column { name, kind: Kind::F32, content: Content::Color(channel) });
    }

    /// Adds the flag unless it is there.
    fn add_flag(&mut self) {
        if !self.columns.iter().any(|column| matches!(column.content, Content::Flag)) {
            self.columns.push(Column { name: FLAG_PROPERTY.into(), kind: Kind::U8, content: Content::Flag });
        }
    }

    fn keep(&mut self, field: &'a Field) {
        let kind = match field.kind {
            Kind::I64 | Kind::U64 => {
                self.lost.push(format!("the digits of '{}' beyond those of a double", field.name));
                Kind::F64
            }
            kind => kind,
        };
        for n in 0..field.count {
            let name = if field.count == 1 { field.name.clone() } else { format!("{}_{n}", field.name) };
            self.columns.push(Column { name, kind, content: Content::Stored { field, n } });
        }
    }
}

fn header(source: &Source, columns: &[Column]) -> Vec<u8> {
    let meanings: Vec<String> = FLAG_MEANINGS.iter().enumerate().map(|(n, meaning)| format!("{n} {meaning}")).collect();
    let about_flags = format!("comment {FLAG_PROPERTY}: {}", meanings.join(", "));
    let mut header = b"ply\nformat binary_little_endian 1.0\n".to_vec();
    // A cloud that is expanded again says it once.
    for line in source.comments.iter().filter(|line| line.as_slice() != about_flags.as_bytes()) {
        header.extend_from_slice(line);
        header.push(b'\n');
    }
    let mut text = about_flags + "\n";
    if let Some(from) = source.viewpoint {
        text += &format!("comment viewpoint {} {} {}\n", from.x, from.y, from.z);
    }
    text += &format!("element vertex {}\n", source.len());
    for column in columns {
        text += &format!("property {} {}\n", ply_name(column.kind), column.name);
    }
    header.extend_from_slice((text + "end_header\n").as_bytes());
    header
}

/// A type's name in a PLY header; 64-bit integers, which PLY lacks, are written as doubles.
fn ply_name(kind: Kind) -> &'static str {
    match kind {
        Kind::I8 => "char",
        Kind::U8 => "uchar",
        Kind::I16 => "short",
        Kind::U16 => "ushort",
        Kind::I32 => "int",
        Kind::U32 => "uint",
        Kind::F32 => "float",
        Kind::F64 | Kind::I64 | Kind::U64 => "double",
    }
}
