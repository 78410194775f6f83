//! Saved hierarchies, `.bsh`: relume's own format, so that a large scan is built once and loaded after that.
//!
//! Little-endian, without padding:
//!
//! | bytes | content |
//! | --- | --- |
//! | 9 | `RELUMEBSH` |
//! | 3 | zero |
//! | 4 | version, u32: 2 |
//! | 8 | number of nodes n, u64 |
//! | 4 | depth, u32 |
//! | 4 | radiance of the brightest point, f32 |
//! | 8 | number of points that the hierarchy was built from, u64 |
//! | 24 | origin x, y, z, f64: what to add to the centres, see [`crate::scene::Cloud::origin`] |
//! | 68 n | spheres, cones, skips, area vectors, colors, radiance vectors, areas, each as in [`Hierarchy`] |
//! | 4 | CRC-32 (IEEE) of all bytes before it |

use std::path::Path;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::checked::{self, CHECKSUM_BYTES, Reader};
use crate::preprocess::hierarchy::{Hierarchy, MAX_DEPTH};
use crate::{Error, Result};

const MAGIC: [u8; 9] = *b"RELUMEBSH";

/// Goes up with every change of the layout; files of other versions are refused, since they are quick to build again.
const VERSION: u32 = 2;

/// Bytes a node: 16 sphere, 8 cone, 4 skip, 12 area vector, 12 color, 12 radiance vector, 4 area.
const NODE_BYTES: u64 = 68;

// The arrays go to the file as they are in memory.
const _: () = assert!(cfg!(target_endian = "little"), "the .bsh format is written for little-endian machines");

/// What a saved hierarchy says about the cloud that it was built from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BshInfo {
    /// Number of points.
    pub points: u64,
    /// [`crate::scene::Cloud::origin`], metres.
    pub origin: DVec3,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Header {
    magic: [u8; 9],
    zero: [u8; 3],
    version: u32,
    nodes: u64,
    depth: u32,
    brightest_point: f32,
    points: u64,
    origin: [f64; 3],
}

/// Saves a hierarchy. An older file at `path` is replaced only when the new one is complete.
///
/// # Errors
///
/// [`Error::File`] when `path` cannot be written, or when the hierarchy does not pass [`Hierarchy::validate`]: such a
/// file could not be read again.
pub fn write(path: &Path, hierarchy: &Hierarchy, source: BshInfo) -> Result<()> {
    let invalid = |problem| Error::file(path, format!("would hold a broken hierarchy: {problem}"));
    hierarchy.validate().map_err(invalid)?;
    let header = Header {
        magic: MAGIC,
        zero: [0; 3],
        version: VERSION,
        nodes: hierarchy.len() as u64,
        depth: hierarchy.depth,
        brightest_point: hierarchy.brightest_point,
        points: source.points,
        origin: source.origin.to_array(),
    };
    let arrays: [&[u8]; 8] = [
        bytemuck::bytes_of(&header),
        bytemuck::cast_slice(&hierarchy.spheres),
        bytemuck::cast_slice(&hierarchy.cones),
        bytemuck::cast_slice(&hierarchy.skips),
        bytemuck::cast_slice(&hierarchy.area_vectors),
        bytemuck::cast_slice(&hierarchy.colors),
        bytemuck::cast_slice(&hierarchy.radiance_vectors),
        bytemuck::cast_slice(&hierarchy.areas),
    ];
    checked::write(path, &arrays)
}

/// Loads a hierarchy. It holds no more memory than the file is long, and a hierarchy that comes back is sound in the
/// sense of [`Hierarchy::validate`].
///
/// # Errors
///
/// [`Error::File`] when `path` cannot be read, is no `.bsh` file, has another version, is shorter or longer than its
/// header says, or is damaged.
pub fn read(path: &Path) -> Result<Hierarchy> {
    read_with_info(path).map(|(hierarchy, _)| hierarchy)
}

/// [`read`], with what the file says about the cloud.
///
/// # Errors
///
/// As [`read`].
pub fn read_with_info(path: &Path) -> Result<(Hierarchy, BshInfo)> {
    let mut file = Reader::open(path)?;

    // The header, and whether the file is as long as it says, before anything is allocated on its word.
    let header = read_header(path, &mut file)?;

    // The arrays and the checksum.
    let hierarchy = read_arrays(&header, &mut file)?;
    if !file.ends_intact()? {
        return Err(Error::file(path, "is damaged: its checksum does not match its content; build it again"));
    }

    // A file that was damaged before it was written, or made by someone else.
    let info = BshInfo { points: header.points, origin: header.origin.into() };
    let origin = if info.origin.is_finite() { Ok(()) } else { Err("the origin is not finite".to_owned()) };
    hierarchy
        .validate()
        .and(origin)
        .map_err(|problem| Error::file(path, format!("holds a broken hierarchy: {problem}; build it again")))?;
    Ok((hierarchy, info))
}

/// The header of a file that has room for what it promises.
fn read_header(path: &Path, file: &mut Reader) -> Result<Header> {
    let wrong = |problem: String| Err(Error::file(path, problem));
    let Some(header) = file.header::<Header>()?.filter(|header| header.magic == MAGIC) else {
        return wrong("is not a saved hierarchy: it does not begin with RELUMEBSH".into());
    };
    let (length, header_bytes) = (file.length, size_of::<Header>() as u64);
    let version = header.version;
    if version != VERSION {
        return wrong(format!(
            "has version {version} of the format, this program reads version {VERSION}; build it again"
        ));
    }
    let (nodes, depth) = (header.nodes, header.depth);
    let expected = nodes.checked_mul(NODE_BYTES).and_then(|bytes| bytes.checked_add(header_bytes + CHECKSUM_BYTES));
    match expected {
        Some(expected) if expected == length => {}
        Some(expected) => {
            return wrong(format!(
                "is {length} bytes long and should be {expected} for its {nodes} nodes; copy or build it again"
            ));
        }
        None => return wrong(format!("claims {nodes} nodes, which no file can hold; build it again")),
    }
    if nodes == 0 || nodes > u64::from(u32::MAX) || !(1..=MAX_DEPTH).contains(&depth) {
        return wrong(format!("claims {nodes} nodes with paths of {depth}; build it again"));
    }
    Ok(header)
}

/// The hierarchy as the file has it.
fn read_arrays(header: &Header, file: &mut Reader) -> Result<Hierarchy> {
    let nodes = header.nodes as usize;
    Ok(Hierarchy {
        spheres: file.array(nodes)?,
        cones: file.array(nodes)?,
        skips: file.array(nodes)?,
        area_vectors: file.array(nodes)?,
        colors: file.array(nodes)?,
        radiance_vectors: file.array(nodes)?,
        areas: file.array(nodes)?,
        depth: header.depth,
        brightest_point: header.brightest_point,
    })
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::PathBuf;

    use super::*;
    use crate::preprocess::hierarchy::{BuildOptions, PackedCone, build};
    use crate::scene::Cloud;
    use glam::Vec3;
    use tempfile::TempDir;

    const INFO: BshInfo = BshInfo { points: 40, origin: DVec3::new(4.5e6, -1.0, 0.25) };

    fn some_hierarchy() -> Hierarchy {
        let along = |i: u32| Vec3::new(i as f32, (i * i % 7) as f32, 0.5);
        let cloud = Cloud {
            positions: (0..40).map(along).collect(),
            colors: (0..40).map(|i| along(i) * 0.1).collect(),
            normals: vec![Vec3::Y; 40],
            spacing: vec![0.25; 40],
            ..Cloud::default()
        };
        build(&cloud, &BuildOptions::default()).expect("the cloud is usable").0
    }

    /// A saved hierarchy: where, and its bytes.
    fn saved() -> (TempDir, PathBuf, Vec<u8>) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("room.bsh");
        write(&path, &some_hierarchy(), INFO).expect("the folder is writable");
        let bytes = fs::read(&path).expect("it was written");
        (folder, path, bytes)
    }

    /// Makes `bytes` a file with a checksum that is right for them, and reads it; the message of the failure.
    fn refusal(path: &Path, mut bytes: Vec<u8>) -> String {
        let end = bytes.len() - CHECKSUM_BYTES as usize;
        let checksum = crc32fast::hash(&bytes[..end]);
        bytes[end..].copy_from_slice(&checksum.to_le_bytes());
        fs::write(path, bytes).expect("the folder is writable");
        message(path)
    }

    fn message(path: &Path) -> String {
        let message = read(path).expect_err("the file is broken").to_string();
        assert!(message.starts_with(&path.display().to_string()) && !message.contains('\n'), "{message}");
        message
    }

    fn put<const N: usize>(bytes: &[u8], at: usize, value: [u8; N]) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        bytes[at..at + N].copy_from_slice(&value);
        bytes
    }

    #[test]
    fn what_is_read_is_what_was_written() {
        let (_folder, path, bytes) = saved();
        let (hierarchy, info) = read_with_info(&path).expect("it is sound");
        assert_eq!((hierarchy, info), (some_hierarchy(), INFO));
        assert_eq!(bytes.len() as u64, 64 + NODE_BYTES * some_hierarchy().len() as u64 + CHECKSUM_BYTES);
        assert_eq!(bytes[..16], *b"RELUMEBSH\0\0\0\x02\0\0\0");
    }

    #[test]
    fn a_flipped_bit_anywhere_is_noticed() {
        let (_folder, path, bytes) = saved();
        for at in 0..bytes.len() {
            fs::write(&path, put(&bytes, at, [bytes[at] ^ 1 << (at % 8)])).expect("the folder is writable");
            message(&path);
        }
        fs::write(&path, put(&bytes, 300, [bytes[300] ^ 4])).expect("the folder is writable");
        assert!(message(&path).contains("checksum"));
    }

    #[test]
    fn a_file_of_any_other_length_is_noticed() {
        let (_folder, path, bytes) = saved();
        for length in 0..bytes.len() {
            fs::write(&path, &bytes[..length]).expect("the folder is writable");
            let message = message(&path);
            let expected = if length < 64 { "does not begin with RELUMEBSH" } else { "bytes long and should be" };
            assert!(message.contains(expected), "{message}");
        }
        fs::write(&path, [&bytes[..], &[0]].concat()).expect("the folder is writable");
        assert!(message(&path).contains("bytes long and should be"));
    }

    #[test]
    fn headers_that_make_no_sense_are_refused_before_anything_is_allocated() {
        let (_folder, path, bytes) = saved();
        assert!(refusal(&path, put(&bytes, 0, *b"PLY")).contains("does not begin with RELUMEBSH"));
        for version in [1, 3] {
            let message = refusal(&path, put(&bytes, 12, u32::to_le_bytes(version)));
            let expected = format!("version {version} of the format, this program reads version 2; build it again");
            assert!(message.contains(&expected), "{message}");
        }
        for nodes in [0, 1 << 20, 1 << 40] {
            assert!(refusal(&path, put(&bytes, 16, u64::to_le_bytes(nodes))).contains("bytes long and should be"));
        }
        assert!(refusal(&path, put(&bytes, 16, u64::MAX.to_le_bytes())).contains("which no file can hold"));
        for depth in [0, 65, u32::MAX] {
            assert!(refusal(&path, put(&bytes, 24, depth.to_le_bytes())).contains("with paths of"));
        }
        let empty = put(&bytes[..68], 16, 0u64.to_le_bytes());
        assert!(refusal(&path, empty).contains("claims 0 nodes"));
    }

    #[test]
    fn content_that_a_traversal_would_trip_over_is_refused() {
        let (_folder, path, bytes) = saved();
        let nodes = some_hierarchy().len();
        let skips = 64 + 24 * nodes;
        assert!(refusal(&path, put(&bytes, 24, 3u32.to_le_bytes())).contains("the stated depth is 3"));
        assert!(refusal(&path, put(&bytes, 28, f32::NAN.to_le_bytes())).contains("the brightest point"));
        assert!(refusal(&path, put(&bytes, 40, f64::NAN.to_le_bytes())).contains("the origin"));
        assert!(refusal(&path, put(&bytes, 64, f32::NAN.to_le_bytes())).contains("centre of node 0"));
        assert!(refusal(&path, put(&bytes, skips, u32::MAX.to_le_bytes())).contains("the root ends at"));
        assert!(refusal(&path, put(&bytes, skips + 4, 0u32.to_le_bytes())).contains("broken hierarchy"));
    }

    #[test]
    fn a_broken_hierarchy_is_not_written_and_an_older_file_stays() {
        let (folder, path, bytes) = saved();
        let broken = Hierarchy { cones: vec![PackedCone::ANY], ..some_hierarchy() };
        let message = write(&path, &broken, INFO).expect_err("it is broken").to_string();
        assert!(message.contains("broken hierarchy: there are 1 cones"), "{message}");
        assert_eq!(fs::read(&path).expect("it is still there"), bytes);
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
    }

    #[test]
    fn a_missing_file_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        assert!(message(&folder.path().join("none.bsh")).contains("cannot be read"));
        assert!(message(folder.path()).contains("cannot be read") || cfg!(not(unix)));
    }
}
