//! Named columns of numbers in raw bytes: what the elements of a PLY file and the body of a PCD file both are, row by
//! row or column by column, in either byte order. ASCII files are brought into the same form first, so that what the
//! columns mean is decided in one place.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::color::decode_srgb;

/// How a number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Kind {
    /// Bytes of one number.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// Value of a number from its little-endian bytes, zero-extended to 64 bits.
    pub(super) fn value(self, bits: u64) -> f64 {
        match self {
            Self::I8 => f64::from(bits as u8 as i8),
            Self::U8 => f64::from(bits as u8),
            Self::I16 => f64::from(bits as u16 as i16),
            Self::U16 => f64::from(bits as u16),
            Self::I32 => f64::from(bits as u32 as i32),
            Self::U32 => f64::from(bits as u32),
            Self::I64 => bits as i64 as f64,
            Self::U64 => bits as f64,
            Self::F32 => f64::from(f32::from_bits(bits as u32)),
            Self::F64 => f64::from_bits(bits),
        }
    }

    /// Bits of a number in text; `None` where it is no number. Whole numbers may be spelt `255.0`; an f32 goes through
    /// f32 parsing, so that packed colours keep their bits.
    pub(super) fn parse(self, token: &str) -> Option<u64> {
        if self == Self::F32 {
            return token.parse::<f32>().ok().map(|v| u64::from(v.to_bits()));
        }
        let value = token.parse::<f64>().ok()?;
        Some(match self {
            Self::F64 => value.to_bits(),
            Self::U64 => token.parse::<u64>().unwrap_or(value as u64),
            // The casts saturate; what does not fit is out of the format's bounds anyway.
            Self::U8 => u64::from(value as u8),
            Self::U16 => u64::from(value as u16),
            Self::U32 => u64::from(value as u32),
            Self::I8 => u64::from(value as i8 as u8),
            Self::I16 => u64::from(value as i16 as u16),
            Self::I32 => u64::from(value as i32 as u32),
            Self::I64 | Self::F32 => token.parse::<i64>().unwrap_or(value as i64) as u64,
        })
    }
}

/// Number from up to eight bytes, zero-extended.
pub(super) fn bits(bytes: &[u8], big_endian: bool) -> u64 {
    let fold = |word: u64, &byte: &u8| word << 8 | u64::from(byte);
    if big_endian { bytes.iter().fold(0, fold) } else { bytes.iter().rev().fold(0, fold) }
}

/// Where one named column lies.
#[derive(Clone, Debug)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) kind: Kind,
    /// Numbers in a row, side by side; the first is what the cloud takes.
    pub(super) count: usize,
    /// Byte offset of row 0.
    pub(super) offset: usize,
    /// Bytes from one row to the next.
    pub(super) stride: usize,
}

/// Which fields hold the colours, by their index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ColorFields {
    /// 0xAARRGGBB in four bytes, whatever type the field claims to be.
    Packed(usize),
    /// Red, green and blue.
    Channels([usize; 3]),
}

/// Columns of equal length.
pub(super) struct Table {
    rows: usize,
    fields: Vec<Field>,
    /// The whole file where its numbers can be used as they lie in it.
    bytes: Arc<Vec<u8>>,
    big_endian: bool,
}

impl Table {
    /// `None` where a field reaches beyond `bytes`.
    pub(super) fn new(rows: usize, fields: Vec<Field>, bytes: Arc<Vec<u8>>, big_endian: bool) -> Option<Self> {
        for field in &fields {
            if rows > 0 {
                let last = (rows - 1).checked_mul(field.stride)?.checked_add(field.offset)?;
                bytes.get(last..last.checked_add(field.count.checked_mul(field.kind.size())?)?)?;
            }
        }
        Some(Self { rows, fields, bytes, big_endian })
    }

    /// All columns, in the file's order.
    pub(super) fn fields(&self) -> &[Field] {
        &self.fields
    }

    /// Little-endian bits of number `n` of a field in a row, zero-extended.
    pub(super) fn bits(&self, field: &Field, row: usize, n: usize) -> u64 {
        let at = field.offset + row * field.stride + n * field.kind.size();
        bits(&self.bytes[at..at + field.kind.size()], self.big_endian)
    }

    fn find(&self, name: &str) -> Option<usize> {
        self.fields.iter().position(|f| f.name.eq_ignore_ascii_case(name))
    }

    /// Names of all columns, for messages.
    pub(super) fn names(&self) -> String {
        let names: Vec<&str> = self.fields.iter().map(|f| f.name.as_str()).collect();
        if names.is_empty() { "none".into() } else { names.join(", ") }
    }

    /// The column of that name, whatever its case.
    pub(super) fn column(&self, name: &str) -> Option<Column<'_>> {
        self.find(name).map(|index| self.at(index))
    }

    fn at(&self, index: usize) -> Column<'_> {
        Column { table: self, field: &self.fields[index] }
    }

    /// Three columns, where all of them exist.
    pub(super) fn columns(&self, names: [&str; 3]) -> Option<[Column<'_>; 3]> {
        Some([self.column(names[0])?, self.column(names[1])?, self.column(names[2])?])
    }

    /// x, y, z of all rows.
    pub(super) fn positions(&self) -> Option<Vec<DVec3>> {
        let columns = self.columns(["x", "y", "z"])?;
        Some(self.map(|row| DVec3::from(columns.map(|c| c.value(row)))))
    }

    /// Normals of all rows, as the file has them.
    pub(super) fn normals(&self) -> Option<Vec<Vec3>> {
        let columns =
            self.columns(["nx", "ny", "nz"]).or_else(|| self.columns(["normal_x", "normal_y", "normal_z"]))?;
        Some(self.map(|row| DVec3::from(columns.map(|c| c.value(row))).as_vec3()))
    }

    /// Where the colours are: a packed column (`rgb`, `rgba` as PCL writes it), or three by any of their usual names.
    pub(super) fn color_fields(&self) -> Option<ColorFields> {
        if let Some(packed) = self.find("rgb").or_else(|| self.find("rgba")) {
            return (self.fields[packed].kind.size() == 4).then_some(ColorFields::Packed(packed));
        }
        [["red", "green", "blue"], ["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]]
            .iter()
            .find_map(|[r, g, b]| Some(ColorFields::Channels([self.find(r)?, self.find(g)?, self.find(b)?])))
    }

    /// Linear colours of all rows. Floating point is linear radiance; integers are sRGB, of 8 bits or as wide as the
    /// column.
    pub(super) fn colors(&self) -> Option<Vec<Vec3>> {
        let table: Vec<f32> = (0..256).map(|code| decode_srgb(code as f32 / 255.0)).collect();
        let code = |value: f64| table[value.clamp(0.0, 255.0) as usize];
        Some(match self.color_fields()? {
            ColorFields::Packed(index) => self.map(|row| {
                let word = self.bits(&self.fields[index], row, 0) as u32;
                let [_, r, g, b] = word.to_be_bytes();
                Vec3::new(code(f64::from(r)), code(f64::from(g)), code(f64::from(b)))
            }),
            ColorFields::Channels(indices) => self.map(|row| {
                Vec3::from(indices.map(|index| self.at(index)).map(|column| match column.field.kind {
                    Kind::F32 | Kind::F64 => column.value(row) as f32,
                    Kind::U16 => decode_srgb(column.value(row) as f32 / 65535.0),
                    _ => code(column.value(row)),
                }))
            }),
        })
    }

    fn map<T: Send>(&self, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
        (0..self.rows).into_par_iter().map(f).collect()
    }
}

/// One column.
#[derive(Clone, Copy)]
pub(super) struct Column<'a> {
    table: &'a Table,
    field: &'a Field,
}

impl Column<'_> {
    fn value(&self, row: usize) -> f64 {
        self.field.kind.value(self.table.bits(self.field, row, 0))
    }
}
