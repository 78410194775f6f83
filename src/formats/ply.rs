//! PLY (Greg Turk, 1994): clouds in and out; [`super::object`] reads meshes through the same parser. The parser is our
//! own: the crates at hand refuse `nan` in ASCII files, merge properties of the same name and look every value up by
//! its name.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::points::Points;
use super::source::Scan;
use super::table::{Field, Kind, Table, bits};
use super::{excerpt, read_bytes, whole};
use crate::scene::Cloud;
use crate::{Error, Result};

/// Reads the `vertex` element as a cloud: x, y, z of any type; colours red, green, blue (or r, g, b; diffuse_*) as
/// sRGB where they are integers and as linear radiance where they are floating point; normals nx, ny, nz where there
/// are any (zero where unusable); the scanner's place where there is a line `comment viewpoint X Y Z`. Other properties
/// and elements are passed over. Neither turned nor completed: see [`super::cloud::load`].
///
/// # Errors
/// [`Error::File`] where the file is no PLY, ends early, or holds no valid point or no colours.
pub fn read_cloud(path: &Path) -> Result<Cloud> {
    read_scan(path)?.into_cloud(path)
}

/// The points and all scalar properties of `vertex`.
pub(super) fn read_scan(path: &Path) -> Result<Scan> {
    let (header, [Rows { table, .. }]) = read(path, [("vertex", "")])?;
    let mut points = Points::from_table(path, &table)?;
    points.viewpoint = header.viewpoint;
    let mut left_out = Vec::new();
    for element in &header.elements {
        if element.name == "vertex" {
            let lists = element.properties.iter().filter(|p| p.length.is_some());
            left_out.extend(lists.map(|p| format!("list property '{}'", p.name)));
        } else if element.count > 0 {
            left_out.push(format!("element '{}'", element.name));
        }
    }
    Ok(Scan { points, table, comments: header.comments, left_out })
}

/// Writes a cloud as binary little-endian PLY: float x y z, nx ny nz (where there are normals) and red green blue
/// (linear radiance). Coordinates are those of [`Cloud::positions`]: the origin is not added.
///
/// # Errors
/// [`Error::File`] when the file cannot be written; an older file at `path` then stays as it was.
pub fn write_cloud(path: &Path, cloud: &Cloud) -> Result<()> {
    let with_normals = cloud.normals.len() == cloud.len();
    whole::write(path, |out| {
        let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", cloud.len());
        let groups = if with_normals { "x y z nx ny nz red green blue" } else { "x y z red green blue" };
        for name in groups.split(' ') {
            header += &format!("property float {name}\n");
        }
        header += "end_header\n";
        let mut write = || {
            out.write_all(header.as_bytes())?;
            for (i, position) in cloud.positions.iter().enumerate() {
                let normal = with_normals.then(|| cloud.normals[i]);
                for vector in [Some(*position), normal, Some(cloud.colors[i])].into_iter().flatten() {
                    for value in vector.to_array() {
                        out.write_all(&value.to_le_bytes())?;
                    }
                }
            }
            Ok(())
        };
        write().map_err(|e: std::io::Error| Error::file(path, format!("cannot be written: {e}")))
    })
}

/// One element's scalar properties and one of its lists.
pub(super) struct Rows {
    pub(super) table: Table,
    /// Number of rows.
    pub(super) rows: usize,
    /// Row r's list is `list[ends[r - 1]..ends[r]]`; both are empty where the element has no such property. What is
    /// no index (negative, or too large) is `u32::MAX`.
    pub(super) list: Vec<u32>,
    pub(super) ends: Vec<usize>,
}

/// Reads the elements of these names, with each the list property whose name starts with the second string (none
/// where it is empty).
///
/// # Errors
/// [`Error::File`] where the file is no PLY, an element is missing, or the file holds less than its header promises.
pub(super) fn read_elements<const N: usize>(path: &Path, wanted: [(&str, &str); N]) -> Result<[Rows; N]> {
    Ok(read(path, wanted)?.1)
}

fn read<const N: usize>(path: &Path, wanted: [(&str, &str); N]) -> Result<(Header, [Rows; N])> {
    let file = Arc::new(read_bytes(path)?);
    let (header, mut body) = parse_header(path, &file)?;
    let mut found: [Option<Rows>; N] = [const { None }; N];
    for element in &header.elements {
        let slot = wanted.iter().position(|(name, _)| *name == element.name);
        let list_name = slot.map_or("", |slot| wanted[slot].1);
        let rows = element.read(path, &file, &mut body, (header.encoding, list_name))?;
        if let Some(slot) = slot {
            found[slot] = Some(rows);
        }
        if found.iter().all(Option::is_some) {
            break;
        }
    }
    let mut complete = Vec::with_capacity(N);
    for (rows, (name, _)) in found.into_iter().zip(wanted) {
        let names: Vec<&str> = header.elements.iter().map(|e| e.name.as_str()).collect();
        let missing = || Error::file(path, format!("has no element '{name}' (it has: {})", names.join(", ")));
        complete.push(rows.ok_or_else(missing)?);
    }
    let complete = complete.try_into().map_err(|_| Error::file(path, "has elements missing"))?;
    Ok((header, complete))
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Ascii,
    Binary { big_endian: bool },
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    /// `comment` and `obj_info` lines as they stand, but for the viewpoint.
    comments: Vec<Vec<u8>>,
    viewpoint: Option<DVec3>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

struct Property {
    name: String,
    kind: Kind,
    /// Type of the list's length where the property is a list.
    length: Option<Kind>,
}

/// (header, what follows it).
fn parse_header<'a>(path: &Path, bytes: &'a [u8]) -> Result<(Header, &'a [u8])> {
    let mut rest = bytes;
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let (mut comments, mut viewpoint) = (Vec::new(), None);
    for number in 1.. {
        let Some(end) = rest.iter().position(|&b| b == b'\n') else {
            let what =
                if number == 1 { "is not a PLY file: it does not start with 'ply'" } else { "has no 'end_header'" };
            return Err(Error::file(path, what));
        };
        let raw = &rest[..end];
        let line = String::from_utf8_lossy(raw);
        rest = &rest[end + 1..];
        let words: Vec<&str> = line.split_whitespace().collect();
        let bad = || Error::file(path, format!("header line {number} is not understood: '{}'", excerpt(&line)));
        match words[..] {
            ["ply"] if number == 1 => {}
            _ if number == 1 => return Err(Error::file(path, "is not a PLY file: it does not start with 'ply'")),
            [] => {}
            ["comment", "viewpoint", x, y, z] if place([x, y, z]).is_some() => viewpoint = place([x, y, z]),
            ["comment", ..] | ["obj_info", ..] => comments.push(raw.trim_ascii_end().to_vec()),
            ["format", name, _] => encoding = Some(encoding_of(name).ok_or_else(bad)?),
            ["element", name, count] => {
                let count = count.parse().map_err(|_| bad())?;
                elements.push(Element { name: name.into(), count, properties: Vec::new() });
            }
            ["property", "list", length, kind, ..] if words.len() > 4 => {
                let (length, kind) = (kind_of(length).ok_or_else(bad)?, kind_of(kind).ok_or_else(bad)?);
                let property = Property { name: words[4..].join(" "), kind, length: Some(length) };
                elements.last_mut().ok_or_else(bad)?.properties.push(property);
            }
            ["property", kind, _, ..] => {
                let kind = kind_of(kind).ok_or_else(bad)?;
                let property = Property { name: words[2..].join(" "), kind, length: None };
                elements.last_mut().ok_or_else(bad)?.properties.push(property);
            }
            ["end_header"] => break,
            _ => return Err(bad()),
        }
    }
    let encoding = encoding.ok_or_else(|| Error::file(path, "has no 'format' line in its header"))?;
    Ok((Header { encoding, elements, comments, viewpoint }, rest))
}

/// A place of three finite numbers.
fn place(words: [&str; 3]) -> Option<DVec3> {
    let [Ok(x), Ok(y), Ok(z)] = words.map(str::parse) else { return None };
    Some(DVec3::new(x, y, z)).filter(|p| p.is_finite())
}

fn encoding_of(name: &str) -> Option<Encoding> {
    match name {
        "ascii" => Some(Encoding::Ascii),
        "binary_little_endian" => Some(Encoding::Binary { big_endian: false }),
        "binary_big_endian" => Some(Encoding::Binary { big_endian: true }),
        _ => None,
    }
}

/// A number's type by its name in a header.
fn kind_of(name: &str) -> Option<Kind> {
    Some(match name {
        "char" | "int8" => Kind::I8,
        "uchar" | "uint8" => Kind::U8,
        "short" | "int16" => Kind::I16,
        "ushort" | "uint16" => Kind::U16,
        "int" | "int32" => Kind::I32,
        "uint" | "uint32" => Kind::U32,
        "float" | "float32" => Kind::F32,
        "double" | "float64" => Kind::F64,
        _ => return None,
    })
}

impl Element {
    /// Takes this element off the front of `body`, the rest of `file`.
    fn read(
        &self,
        path: &Path,
        file: &Arc<Vec<u8>>,
        body: &mut &[u8],
        (encoding, list_name): (Encoding, &str),
    ) -> Result<Rows> {
        // Before anything is reserved: can the file back what its header promises?
        let smallest_row: usize = match encoding {
            // A digit and a separator.
            Encoding::Ascii => 2 * self.properties.len(),
            Encoding::Binary { .. } => self.properties.iter().map(|p| p.length.unwrap_or(p.kind).size()).sum(),
        };
        // The last separator of an ASCII file may be missing.
        let held = body.len() + usize::from(encoding == Encoding::Ascii);
        let Some(most) = held.checked_div(smallest_row) else {
            // Without properties there is nothing to read, however many rows are promised.
            return self.finish(path, 0, Scalars::own(Vec::new(), false), (Vec::new(), Vec::new()));
        };
        if self.count > most {
            return Err(self.too_short(path, most));
        }
        let fixed = self.properties.iter().all(|p| p.length.is_none());
        match encoding {
            Encoding::Binary { big_endian } if fixed => {
                let start = file.len() - body.len();
                *body = &body[self.count * smallest_row..];
                let scalars = Scalars { bytes: Arc::clone(file), start, big_endian };
                self.finish(path, self.count, scalars, (Vec::new(), Vec::new()))
            }
            Encoding::Binary { big_endian } => self.read_binary(path, body, big_endian, list_name),
            Encoding::Ascii => self.read_ascii(path, body, list_name),
        }
    }

    /// Rows with lists have no fixed size: walk them, keeping the scalars side by side.
    fn read_binary(&self, path: &Path, body: &mut &[u8], big_endian: bool, wanted: &str) -> Result<Rows> {
        let (mut scalars, mut list, mut ends) = (Vec::new(), Vec::new(), Vec::new());
        for row in 0..self.count {
            let mut take = |count: usize| match body.split_at_checked(count) {
                Some((taken, rest)) => {
                    *body = rest;
                    Ok(taken)
                }
                None => Err(self.too_short(path, row)),
            };
            for property in &self.properties {
                let size = property.kind.size();
                let Some(length) = property.length else {
                    scalars.extend_from_slice(take(size)?);
                    continue;
                };
                let length = length.value(bits(take(length.size())?, big_endian));
                // A negative length becomes 0 and one too large to exist fails to be taken.
                let values = take((length as usize).saturating_mul(size))?;
                if is_wanted(property, wanted) {
                    list.extend(values.chunks_exact(size).map(|v| to_index(property.kind.value(bits(v, big_endian)))));
                    ends.push(list.len());
                }
            }
        }
        self.finish(path, self.count, Scalars::own(scalars, big_endian), (list, ends))
    }

    /// One row a line. Numbers go into the same little-endian bytes as in a binary file.
    fn read_ascii(&self, path: &Path, body: &mut &[u8], wanted: &str) -> Result<Rows> {
        let (mut scalars, mut list, mut ends) = (Vec::new(), Vec::new(), Vec::new());
        let mut row = 0;
        while row < self.count {
            if body.is_empty() {
                return Err(self.too_short(path, row));
            }
            let end = body.iter().position(|&b| b == b'\n').unwrap_or(body.len());
            let line = std::str::from_utf8(&body[..end]).unwrap_or("\u{fffd}");
            *body = body.get(end + 1..).unwrap_or_default();
            let mut words = line.split_ascii_whitespace().peekable();
            if words.peek().is_none() {
                continue;
            }
            let bad = || {
                let (row, name, line) = (row + 1, &self.name, excerpt(line));
                Error::file(path, format!("row {row} of element '{name}' is not understood: '{line}'"))
            };
            let mut number = |kind: Kind| words.next().and_then(|word| kind.parse(word)).ok_or_else(bad);
            for property in &self.properties {
                let size = property.kind.size();
                let Some(length) = property.length else {
                    scalars.extend_from_slice(&number(property.kind)?.to_le_bytes()[..size]);
                    continue;
                };
                for _ in 0..length.value(number(length)?) as usize {
                    let value = number(property.kind)?;
                    if is_wanted(property, wanted) {
                        list.push(to_index(property.kind.value(value)));
                    }
                }
                if is_wanted(property, wanted) {
                    ends.push(list.len());
                }
            }
            row += 1;
        }
        self.finish(path, self.count, Scalars::own(scalars, false), (list, ends))
    }

    fn finish(&self, path: &Path, rows: usize, scalars: Scalars, (list, ends): (Vec<u32>, Vec<usize>)) -> Result<Rows> {
        let Scalars { bytes, start, big_endian } = scalars;
        let stored = || self.properties.iter().filter(|p| p.length.is_none());
        let stride = stored().map(|p| p.kind.size()).sum();
        let mut offset = start;
        let fields = stored()
            .map(|p| {
                offset += p.kind.size();
                Field { name: p.name.clone(), kind: p.kind, count: 1, offset: offset - p.kind.size(), stride }
            })
            .collect();
        let table = Table::new(rows, fields, bytes, big_endian).ok_or_else(|| self.too_short(path, 0))?;
        Ok(Rows { table, rows, list, ends })
    }

    fn too_short(&self, path: &Path, held: usize) -> Error {
        let Self { name, count, .. } = self;
        Error::file(path, format!("is cut short: its header promises {count} of element '{name}', it holds {held}"))
    }
}

/// Where the numbers of an element lie, row by row.
struct Scalars {
    bytes: Arc<Vec<u8>>,
    /// Where row 0 begins.
    start: usize,
    big_endian: bool,
}

impl Scalars {
    fn own(bytes: Vec<u8>, big_endian: bool) -> Self {
        Self { bytes: Arc::new(bytes), start: 0, big_endian }
    }
}

fn is_wanted(property: &Property, wanted: &str) -> bool {
    !wanted.is_empty() && property.name.starts_with(wanted)
}

fn to_index(value: f64) -> u32 {
    if value >= 0.0 && value < f64::from(u32::MAX) { value as u32 } else { u32::MAX }
}
