//! Bad clouds: every message is one line that names the file and says what is wrong.

use relume::formats::cloud::{CloudOptions, load};
use relume::scene::Cloud;

use crate::clouds::{Encoding, ply_file};
use crate::{assert_says, problem, put, temp};

fn read(path: &std::path::Path) -> relume::Result<Cloud> {
    load(path, &CloudOptions::default())
}

/// What is wrong with a file of this name and content.
#[track_caller]
fn refused(name: &str, bytes: impl AsRef<[u8]>) -> String {
    let dir = temp();
    let path = put(&dir, name, bytes);
    problem(read(&path), &path)
}

const XYZ: &str = "property float x\nproperty float y\nproperty float z\n";
const RGB: &str = "property uchar red\nproperty uchar green\nproperty uchar blue\n";

fn ply(encoding: &str, count: &str, properties: &str, body: &str) -> String {
    format!("ply\nformat {encoding} 1.0\nelement vertex {count}\n{properties}end_header\n{body}")
}

#[test]
fn unknown_extensions_and_missing_files() {
    for name in ["cloud.xyz", "cloud", "cloud.ply.bak"] {
        assert_says(&refused(name, "x"), &["expected .ply, .pcd, .las or .laz"]);
    }
    let dir = temp();
    for name in ["none.ply", "none.pcd", "none.las", "none.laz"] {
        let path = dir.path().join(name);
        assert_says(&problem(read(&path), &path), &["cannot be read"]);
    }
    std::fs::create_dir(dir.path().join("folder.ply")).unwrap();
    let path = dir.path().join("folder.ply");
    assert_says(&problem(read(&path), &path), &["cannot be read"]);
}

#[test]
fn ply_headers() {
    for bytes in ["", "plx\n", "\u{0}\u{1}\u{2}\n\n", "ply"] {
        assert_says(&refused("a.ply", bytes), &["not a PLY file"]);
    }
    assert_says(&refused("a.ply", "ply\nformat ascii 1.0\nelement vertex 1\n"), &["no 'end_header'"]);
    assert_says(&refused("a.ply", "ply\nelement vertex 1\nend_header\n"), &["no 'format' line"]);
    for line in [
        "format utf8 1.0",
        "element vertex -1",
        "element vertex many",
        "property float x",
        "element vertex 1\nproperty real x",
        "element vertex 1\nproperty list real int x",
        "nonsense",
    ] {
        assert_says(&refused("a.ply", format!("ply\n{line}\nend_header\n")), &["header line", "is not understood"]);
    }
    assert_says(
        &refused("a.ply", "ply\nformat ascii 1.0\nelement face 0\nend_header\n"),
        &["no element 'vertex' (it has: face)"],
    );
}

#[test]
fn ply_properties() {
    let problem =
        refused("a.ply", ply("ascii", "1", "property float x\nproperty float y\nproperty int w\n", "1 2 3\n"));
    assert_says(&problem, &["expected x, y, z", "(x, y, w)"]);
    let problem = refused("a.ply", ply("ascii", "1", &format!("{XYZ}property float intensity\n"), "1 2 3 4\n"));
    assert_says(&problem, &["no colours", "expected red, green, blue", "x, y, z, intensity"]);
}

#[test]
fn ply_files_that_promise_more_than_they_hold() {
    let properties = format!("{XYZ}{RGB}");
    for (encoding, body, held) in [
        ("binary_little_endian", "\0".repeat(15 * 3 + 4), "it holds 3"),
        ("ascii", "1 2 3 4 5 6\n".repeat(3), "holds 3"),
    ] {
        let problem = refused("a.ply", ply(encoding, "5", &properties, &body));
        assert_says(&problem, &["cut short", "promises 5 of element 'vertex'", held]);
    }
    // Numbers that no memory could back must not be reserved for.
    for count in ["99999999999", "9223372036854775807", "18446744073709551615"] {
        for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
            assert_says(&refused("a.ply", ply(encoding, count, &properties, "123")), &["cut short", count]);
            let lists = format!("{properties}property list uint double w\n");
            assert_says(&refused("a.ply", ply(encoding, count, &lists, "123")), &["cut short", count]);
            let faces = format!("{properties}element none {count}\n");
            assert_says(&refused("a.ply", ply(encoding, "0", &faces, "")), &["holds no points"]);
        }
    }
    let mut list =
        ply("binary_little_endian", "1", &format!("{XYZ}{RGB}property list uint double w\n"), "").into_bytes();
    list.extend([0; 15]);
    list.extend([255; 40]);
    assert_says(&refused("a.ply", list), &["cut short", "it holds 0"]);
}

#[test]
fn ply_rows() {
    let properties = format!("{XYZ}{RGB}");
    for row in ["1.5 2.5 3 4 5", "1 2 3 red 5 6", "1,2,3,4,5,6,7,8,9"] {
        assert_says(&refused("a.ply", ply("ascii", "1", &properties, row)), &["row 1 of element 'vertex'", row]);
    }
    assert_says(&refused("a.ply", ply("ascii", "0", &properties, "")), &["holds no points"]);
    let nan = refused("a.ply", ply("ascii", "2", &properties, "nan 0 0 1 1 1\n0 0 inf 1 1 1\n"));
    assert_says(&nan, &["holds 2 points, but none with finite position"]);
    let bad = [f64::NAN, f64::INFINITY];
    let columns: Vec<(&str, &str, &[f64])> =
        ["x", "y", "z", "r", "g", "b"].map(|name| (name, "double", &bad as &[f64])).to_vec();
    assert_says(&refused("a.ply", ply_file(Encoding::Big, &columns)), &["none with finite position"]);
}

fn pcd(fields: &str, points: &str, data: &str) -> Vec<u8> {
    let count = fields.split(' ').count();
    let repeated = |word: &str| vec![word; count].join(" ");
    format!(
        "VERSION 0.7\nFIELDS {fields}\nSIZE {}\nTYPE {}\nCOUNT {}\nWIDTH {points}\nHEIGHT 1\nPOINTS {points}\nDATA {data}\n",
        repeated("4"),
        repeated("F"),
        repeated("1")
    )
    .into_bytes()
}

#[test]
fn pcd_headers() {
    for bytes in ["", "not a pcd\n", "VERSION 0.7\nFIELDS x\n"] {
        assert_says(&refused("a.pcd", bytes), &["not a readable PCD file"]);
    }
    assert_says(&refused("a.pcd", pcd("x y z rgb", "1", "base64")), &["DATA line"]);
    assert_says(&refused("a.pcd", pcd("x y z rgb", "-1", "ascii")), &["not a readable PCD file"]);
    let missing = refused("a.pcd", [pcd("x y z intensity", "1", "ascii"), b"1 2 3 4\n".to_vec()].concat());
    assert_says(&missing, &["no colours", "packed rgb", "x, y, z, intensity"]);
}

#[test]
fn pcd_bodies() {
    let fields = "x y z rgb";
    assert_says(&refused("a.pcd", pcd(fields, "0", "ascii")), &["holds no points"]);
    let short = refused("a.pcd", [pcd(fields, "3", "ascii"), b"1 2 3 4\n".to_vec()].concat());
    assert_says(&short, &["cut short", "promises 3 points, it holds 1"]);
    let word = refused("a.pcd", [pcd(fields, "1", "ascii"), b"1 2 three 4\n".to_vec()].concat());
    assert_says(&word, &["point 1", "three"]);
    let short = refused("a.pcd", [pcd(fields, "3", "binary"), vec![0; 20]].concat());
    assert_says(&short, &["cut short", "3 points (48 bytes)", "holds 20 bytes"]);
    for points in ["99999999999", "18446744073709551615"] {
        for data in ["ascii", "binary", "binary_compressed"] {
            let huge = refused("a.pcd", [pcd(fields, points, data), vec![0; 20]].concat());
            assert!(
                ["cut short", "damaged", "promises more", "point 1 is not understood"]
                    .iter()
                    .any(|part| huge.contains(part)),
                "{huge}"
            );
        }
    }
    let compressed = |packed: u32, unpacked: u32, data: &[u8]| {
        [&pcd(fields, "1", "binary_compressed")[..], &packed.to_le_bytes(), &unpacked.to_le_bytes(), data].concat()
    };
    assert_says(&refused("a.pcd", pcd(fields, "1", "binary_compressed")), &["cut short"]);
    assert_says(&refused("a.pcd", compressed(100, 16, &[0; 9])), &["promises 100 bytes", "holds 9"]);
    assert_says(&refused("a.pcd", compressed(2, u32::MAX, &[0; 2])), &["1 points need 16 bytes", "claims 4294967295"]);
    // A literal run beyond the end, a copy from before the start, too much output, too little.
    for data in [&[31, 1][..], &[0x20, 5], &[0, 9, 0xe0, 200, 0], &[0, 9]] {
        assert_says(&refused("a.pcd", compressed(data.len() as u32, 16, data)), &["damaged compressed data"]);
    }
    let nan = refused("a.pcd", [pcd(fields, "1", "ascii"), b"nan 2 3 4\n".to_vec()].concat());
    assert_says(&nan, &["none with finite position"]);
}

fn las_bytes(format: u8, compressed: bool) -> Vec<u8> {
    let mut builder = ::las::Builder::from((1, 4));
    builder.point_format = ::las::point::Format::new(format).unwrap();
    builder.point_format.is_compressed = compressed;
    let mut writer = ::las::Writer::new(std::io::Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
    for i in 0..100 {
        let mut point = ::las::Point { x: f64::from(i), ..Default::default() };
        point.color = (format == 2).then(|| ::las::Color::new(i as u16, 2, 3));
        writer.write_point(point).unwrap();
    }
    writer.into_inner().unwrap().into_inner()
}

#[test]
fn las_files() {
    for name in ["a.las", "a.laz"] {
        for bytes in [&b""[..], b"LAS?", &[0; 400]] {
            assert_says(&refused(name, bytes), &["not a readable LAS file"]);
        }
        let compressed = name == "a.laz";
        assert_says(&refused(name, las_bytes(0, compressed)), &["no colours", "format 0"]);
        let whole = las_bytes(2, compressed);
        for cut in [100, 300, whole.len() / 2, whole.len() - 30] {
            refused(name, &whole[..cut]);
        }
    }
    let whole = las_bytes(2, false);
    assert_says(&refused("a.las", &whole[..whole.len() - 27]), &["promises 100 points"]);
}
