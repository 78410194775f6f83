//! Saved transfer, `.prt`: relume's own format, so that an object's transfer is computed once and loaded after that.
//!
//! Little-endian, without padding:
//!
//! | bytes | content |
//! | --- | --- |
//! | 9 | `RELUMEPRT` |
//! | 3 | zero |
//! | 4 | version, u32: 1 |
//! | 4 | order n, u32: 1 to 5 |
//! | 4 | directions sampled a vertex, u32 |
//! | 4 | bounces, u32 |
//! | 4 | visibility, u32: 0 or 1 |
//! | 4 | channels c, u32: 1, or 3 with bounces |
//! | 4 | zero |
//! | 8 | number of vertices v, u64 |
//! | 8 | [`key`] of the object, u64 |
//! | 4 v c n^2 | coefficients, f32, as in [`Transfer::coefficients`] |
//! | 4 | CRC-32 (IEEE) of all bytes before it |

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use bytemuck::{Pod, Zeroable};

use super::check_regular;
use super::checked::{self, CHECKSUM_BYTES, Reader};
use crate::preprocess::transfer::{Transfer, TransferOptions, compute};
use crate::scene::Object;
use crate::{Error, Result};

const MAGIC: [u8; 9] = *b"RELUMEPRT";

/// Goes up with every change of the layout, of the key and of what coefficients mean; files of other versions are
/// refused, since they are quick to compute again.
const VERSION: u32 = 1;

// The coefficients go to the file as they are in memory.
const _: () = assert!(cfg!(target_endian = "little"), "the .prt format is written for little-endian machines");

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Header {
    magic: [u8; 9],
    zero: [u8; 3],
    version: u32,
    order: u32,
    samples: u32,
    bounces: u32,
    visibility: u32,
    channels: u32,
    zero_too: u32,
    vertices: u64,
    key: u64,
}

/// Where a transfer came from.
#[derive(Debug)]
pub enum Source {
    /// The file had it.
    Read,
    /// It was computed, and saved where a path was given.
    Computed,
    /// It was computed, but the file could not be written.
    ComputedUnsaved(Error),
}

/// The transfer of `object`: from the file at `path` where that has it, or else computed and saved there. A saved
/// transfer of another object or other options, of another version or damaged, is replaced; any other file is left
/// alone.
///
/// # Errors
/// [`Error::File`] where `path` is something else than a saved transfer or cannot be read; those of [`compute`].
pub fn load_or_compute(
    path: Option<&Path>,
    object: &Object,
    options: &TransferOptions,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<(Transfer, Source)> {
    options.check()?;
    let Some(path) = path else { return Ok((compute(object, options, progress)?, Source::Computed)) };
    let key = key(object, options.bounces);
    if is_saved_transfer(path)?
        && let Ok((transfer, saved_key)) = read(path)
        && saved_key == key
        && fits(&transfer, object, options)
    {
        return Ok((transfer, Source::Read));
    }
    let transfer = compute(object, options, progress)?;
    let source = match write(path, &transfer, key) {
        Ok(()) => Source::Computed,
        Err(error) => Source::ComputedUnsaved(error),
    };
    Ok((transfer, source))
}

/// True for a file that begins as saved transfers do, false where there is none.
///
/// # Errors
/// [`Error::File`] for anything else: it must not be overwritten.
pub fn is_saved_transfer(path: &Path) -> Result<bool> {
    // A link that leads nowhere is something too.
    match std::fs::symlink_metadata(path) {
        // No folder, no file; that it cannot be written either will be told then.
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => return Ok(false),
        _ => check_regular(path)?,
    }
    let unreadable = |e: io::Error| Error::file(path, format!("cannot be read: {e}"));
    let mut begin = Vec::new();
    File::open(path).map_err(unreadable)?.take(MAGIC.len() as u64).read_to_end(&mut begin).map_err(unreadable)?;
    if begin == MAGIC { Ok(true) } else { Err(foreign(path)) }
}

fn foreign(path: &Path) -> Error {
    Error::file(path, "is not a saved transfer: it does not begin with RELUMEPRT")
}

/// Whether a transfer is what `options` ask for.
fn fits(transfer: &Transfer, object: &Object, options: &TransferOptions) -> bool {
    let has = (transfer.order, transfer.samples, transfer.bounces, transfer.visibility, transfer.vertices);
    has == (options.order, options.samples_used(), options.bounces, options.visibility, object.vertices.len())
}

/// Saves a transfer of the object with this [`key`]. An older file at `path` is replaced only when the new one is
/// complete.
///
/// # Errors
/// [`Error::File`] when `path` cannot be written, or when the transfer is not sound: such a file could not be read
/// again.
pub fn write(path: &Path, transfer: &Transfer, key: u64) -> Result<()> {
    check_sound(transfer).map_err(|problem| Error::file(path, format!("would hold a broken transfer: {problem}")))?;
    let header = Header {
        magic: MAGIC,
        zero: [0; 3],
        version: VERSION,
        order: transfer.order as u32,
        samples: transfer.samples,
        bounces: transfer.bounces,
        visibility: u32::from(transfer.visibility),
        channels: transfer.channels as u32,
        zero_too: 0,
        vertices: transfer.vertices as u64,
        key,
    };
    checked::write(path, &[bytemuck::bytes_of(&header), bytemuck::cast_slice(&transfer.coefficients)])
}

/// Loads a transfer and the [`key`] of its object. It holds no more memory than the file is long.
///
/// # Errors
/// [`Error::File`] when `path` cannot be read, is no `.prt` file, has another version, is shorter or longer than its
/// header says, or is damaged.
pub fn read(path: &Path) -> Result<(Transfer, u64)> {
    let mut file = Reader::open(path)?;

    // The header, and whether the file is as long as it says, before anything is allocated on its word.
    let header = read_header(path, &mut file)?;

    // The coefficients, and the checksum of all.
    let coefficients: Vec<f32> = file.array(numbers(&header).unwrap_or(0) as usize)?;
    if !file.ends_intact()? {
        return Err(Error::file(path, "is damaged: its checksum does not match its content; compute it again"));
    }

    // A file that was damaged before it was written, or made by someone else.
    let transfer = Transfer {
        order: header.order as usize,
        samples: header.samples,
        bounces: header.bounces,
        visibility: header.visibility != 0,
        channels: header.channels as usize,
        vertices: header.vertices as usize,
        coefficients,
    };
    check_sound(&transfer)
        .map_err(|problem| Error::file(path, format!("holds a broken transfer: {problem}; compute it again")))?;
    Ok((transfer, header.key))
}

/// The header of a file that has room for what it promises.
fn read_header(path: &Path, file: &mut Reader) -> Result<Header> {
    let wrong = |problem: String| Err(Error::file(path, problem));
    let Some(header) = file.header::<Header>()?.filter(|header| header.magic == MAGIC) else {
        return Err(foreign(path));
    };
    let (length, header_bytes) = (file.length, size_of::<Header>() as u64);
    let version = header.version;
    if version != VERSION {
        return wrong(format!(
            "has version {version} of the format, this program reads version {VERSION}; compute it again"
        ));
    }
    let (vertices, order, channels) = (header.vertices, header.order, header.channels);
    if !TransferOptions::ORDER.contains(&(order as usize)) || ![1, 3].contains(&channels) || header.visibility > 1 {
        let visibility = header.visibility;
        return wrong(format!(
            "claims order {order}, {channels} channels and visibility {visibility}; compute it again"
        ));
    }
    let expected = numbers(&header)
        .and_then(|numbers| numbers.checked_mul(size_of::<f32>() as u64))
        .and_then(|bytes| bytes.checked_add(header_bytes + CHECKSUM_BYTES));
    match expected {
        Some(expected) if expected == length => Ok(header),
        Some(expected) => wrong(format!(
            "is {length} bytes long and should be {expected} for its {vertices} vertices; copy or compute it again"
        )),
        None => wrong(format!("claims {vertices} vertices, which no file can hold; compute it again")),
    }
}

/// How many coefficients a header promises.
fn numbers(header: &Header) -> Option<u64> {
    header.vertices.checked_mul(u64::from(header.channels * header.order * header.order))
}

/// What is wrong with a transfer, if anything.
fn check_sound(transfer: &Transfer) -> Result<(), String> {
    let Transfer { order, bounces, visibility, channels, vertices, coefficients, .. } = transfer;
    if !TransferOptions::ORDER.contains(order) {
        return Err(format!("its order is {order}"));
    }
    if *channels != if *bounces == 0 { 1 } else { 3 } || (*bounces > 0 && !visibility) {
        return Err(format!("it has {channels} channels for {bounces} bounces, visibility {visibility}"));
    }
    if vertices.checked_mul(channels * order * order) != Some(coefficients.len()) {
        return Err(format!("there are {} coefficients for {vertices} vertices", coefficients.len()));
    }
    match coefficients.iter().position(|coefficient| !coefficient.is_finite()) {
        Some(at) => Err(format!("coefficient {at} is not finite")),
        None => Ok(()),
    }
}

/// A number that stands for everything of an object that its transfer depends on: positions, normals and triangles,
/// and with bounces also texture coordinates, albedos and textures. The same on every machine.
pub fn key(object: &Object, bounces: u32) -> u64 {
    let mut hash = Hash::default();
    hash.put_all(object.vertices.len(), object.vertices.iter().flat_map(|v| [v.position, v.normal]).flat_map(bits));
    hash.put_all(object.indices.len(), object.indices.iter().copied());
    if bounces == 0 {
        return hash.state;
    }
    hash.put_all(object.vertices.len(), object.vertices.iter().flat_map(|v| v.uv.to_array().map(f32::to_bits)));
    let primitives = object.primitives.iter().flat_map(|p| [p.indices.start, p.indices.end, p.material as u32]);
    hash.put_all(object.primitives.len(), primitives);
    // The materials' albedos, and the textures that these use; other textures may change.
    let texture = |texture: Option<crate::scene::TextureRef>| texture.map_or(u32::MAX, |t| t.texture as u32);
    let materials = object.materials.iter().flat_map(|m| {
        let textures = [texture(m.base_color_texture), texture(m.metallic_roughness_texture)];
        bits(m.base_color).into_iter().chain([m.metallic.to_bits()]).chain(textures)
    });
    hash.put_all(object.materials.len(), materials);
    for (index, texture) in object.textures.iter().enumerate() {
        let index = Some(crate::scene::TextureRef { texture: index });
        if object.materials.iter().any(|m| m.base_color_texture == index || m.metallic_roughness_texture == index) {
            hash.put_all(texture.rgba.len(), [texture.width, texture.height, u32::from(texture.srgb)].into_iter());
            let words =
                texture.rgba.chunks(4).map(|bytes| bytes.iter().fold(0, |word, &byte| word << 8 | u32::from(byte)));
            hash.put_all(texture.rgba.len(), words);
        }
    }
    hash.state
}

fn bits(vector: glam::Vec3) -> [u32; 3] {
    vector.to_array().map(f32::to_bits)
}

/// A chain of SplitMix64's finaliser (Steele et al. 2014). No CRC: two with other starts would collide together.
#[derive(Default)]
struct Hash {
    state: u64,
}

impl Hash {
    fn put(&mut self, value: u64) {
        let value = (self.state ^ value).wrapping_add(0x9e37_79b9_7f4a_7c15);
        let value = (value ^ (value >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let value = (value ^ (value >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        self.state = value ^ (value >> 31);
    }

    /// The length too, so that a list's end is not the next one's beginning.
    fn put_all(&mut self, length: usize, words: impl Iterator<Item = u32>) {
        self.put(length as u64);
        words.for_each(|word| self.put(u64::from(word)));
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::PathBuf;

    use super::*;
    use tempfile::TempDir;

    const KEY: u64 = 0x0123_4567_89ab_cdef;

    fn some_transfer() -> Transfer {
        let coefficients = (0..5 * 3 * 4).map(|n| n as f32 * 0.25 - 3.0).collect();
        Transfer { order: 2, samples: 102, bounces: 1, visibility: true, channels: 3, vertices: 5, coefficients }
    }

    /// A saved transfer: where, and its bytes.
    fn saved() -> (TempDir, PathBuf, Vec<u8>) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("vase.prt");
        write(&path, &some_transfer(), KEY).expect("the folder is writable");
        let bytes = fs::read(&path).expect("it was written");
        (folder, path, bytes)
    }

    fn message(path: &Path, bytes: &[u8]) -> String {
        fs::write(path, bytes).expect("the folder is writable");
        let message = read(path).expect_err("the file is broken").to_string();
        assert!(message.starts_with(&path.display().to_string()) && !message.contains('\n'), "{message}");
        message
    }

    /// What is said of the file with other bytes in one place and a checksum that is right for them.
    fn refusal<const N: usize>(path: &Path, bytes: &[u8], at: usize, value: [u8; N]) -> String {
        let mut bytes = bytes.to_vec();
        bytes[at..at + N].copy_from_slice(&value);
        let end = bytes.len() - CHECKSUM_BYTES as usize;
        let checksum = crc32fast::hash(&bytes[..end]);
        bytes[end..].copy_from_slice(&checksum.to_le_bytes());
        message(path, &bytes)
    }

    #[test]
    fn what_is_read_is_what_was_written() {
        let (_folder, path, bytes) = saved();
        assert_eq!(read(&path).expect("it is sound"), (some_transfer(), KEY));
        assert_eq!(bytes.len(), 56 + 4 * 60 + 4);
        assert_eq!(bytes[..20], *b"RELUMEPRT\0\0\0\x01\0\0\0\x02\0\0\0");
    }

    #[test]
    fn a_flipped_bit_and_any_other_length_are_noticed() {
        let (_folder, path, bytes) = saved();
        for at in 0..bytes.len() {
            let mut flipped = bytes.clone();
            flipped[at] ^= 1 << (at % 8);
            message(&path, &flipped);
            let expected = if at < 56 { "does not begin with RELUMEPRT" } else { "bytes long and should be" };
            assert!(message(&path, &bytes[..at]).contains(expected));
        }
        assert!(message(&path, &[&bytes[..], &[0]].concat()).contains("bytes long and should be"));
        let mut flipped = bytes;
        flipped[99] ^= 1;
        assert!(message(&path, &flipped).contains("checksum"));
    }

    #[test]
    fn headers_and_values_that_make_no_sense_are_refused() {
        let (_folder, path, bytes) = saved();
        assert!(refusal(&path, &bytes, 0, *b"PLY").contains("does not begin with RELUMEPRT"));
        assert!(refusal(&path, &bytes, 12, 7_u32.to_le_bytes()).contains("version 7"));
        for order in [0, 6, u32::MAX] {
            assert!(refusal(&path, &bytes, 16, order.to_le_bytes()).contains("claims order"));
        }
        assert!(refusal(&path, &bytes, 24, 0_u32.to_le_bytes()).contains("3 channels for 0 bounces"));
        assert!(refusal(&path, &bytes, 28, 0_u32.to_le_bytes()).contains("visibility false"));
        assert!(refusal(&path, &bytes, 28, 2_u32.to_le_bytes()).contains("visibility 2"));
        assert!(refusal(&path, &bytes, 32, 2_u32.to_le_bytes()).contains("2 channels"));
        assert!(refusal(&path, &bytes, 40, (1_u64 << 40).to_le_bytes()).contains("bytes long and should be"));
        assert!(refusal(&path, &bytes, 40, u64::MAX.to_le_bytes()).contains("which no file can hold"));
        assert!(refusal(&path, &bytes, 60, f32::NAN.to_le_bytes()).contains("coefficient 1 is not finite"));
    }

    #[test]
    fn a_broken_transfer_is_not_written_and_an_older_file_stays() {
        let (folder, path, bytes) = saved();
        let broken = Transfer { vertices: 6, ..some_transfer() };
        let message = write(&path, &broken, KEY).expect_err("it is broken").to_string();
        assert!(message.contains("60 coefficients for 6 vertices"), "{message}");
        assert_eq!(fs::read(&path).expect("it is still there"), bytes);
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
    }
}
