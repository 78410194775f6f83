//! Clouds in every format.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::{Arc, Mutex};

use glam::{DVec3, Vec3};
use pcd_rs::{DataKind, DynRecord, DynWriter, Field, Schema, ValueKind, ViewPoint, WriterInit};
use relume::formats::cloud::{CloudOptions, Up, load};
use relume::formats::color::{decode_srgb, decode_srgb8, encode_srgb, encode_srgb8};
use relume::formats::{las, pcd, ply};
use relume::scene::Cloud;

use crate::{Random, assert_says, put, temp};

#[test]
fn srgb_round_trip() {
    for code in 0..=255u8 {
        let linear = decode_srgb(f32::from(code) / 255.0);
        assert_eq!(encode_srgb8(linear), code);
        assert!((encode_srgb(linear) - f32::from(code) / 255.0).abs() < 1e-6);
    }
    assert!((decode_srgb(0.5) - 0.214_041).abs() < 1e-5);
    assert_eq!(encode_srgb8(f32::NAN), 0);
    assert_eq!(encode_srgb8(7.0), 255);
}

#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Encoding {
    Ascii,
    Little,
    Big,
}

/// A PLY file of one vertex element; `columns` are (name, type, values).
pub(crate) fn ply_file(encoding: Encoding, columns: &[(&str, &str, &[f64])]) -> Vec<u8> {
    let count = columns[0].2.len();
    let format = match encoding {
        Encoding::Ascii => "ascii",
        Encoding::Little => "binary_little_endian",
        Encoding::Big => "binary_big_endian",
    };
    let mut header = format!("ply\nformat {format} 1.0\ncomment made by a test\nelement vertex {count}\n");
    for (name, kind, _) in columns {
        writeln!(header, "property {kind} {name}").unwrap();
    }
    let mut bytes = (header + "end_header\n").into_bytes();
    for row in 0..count {
        let mut words = Vec::new();
        for (_, kind, values) in columns {
            let value = values[row];
            if encoding == Encoding::Ascii {
                words.push(value.to_string());
                continue;
            }
            let mut number = match *kind {
                "uchar" => vec![value as u8],
                "short" => (value as i16).to_le_bytes().to_vec(),
                "ushort" => (value as u16).to_le_bytes().to_vec(),
                "int" => (value as i32).to_le_bytes().to_vec(),
                "float" => (value as f32).to_le_bytes().to_vec(),
                "double" => value.to_le_bytes().to_vec(),
                other => panic!("no type {other}"),
            };
            if encoding == Encoding::Big {
                number.reverse();
            }
            bytes.extend(number);
        }
        if encoding == Encoding::Ascii {
            bytes.extend((words.join(" ") + "\n").as_bytes());
        }
    }
    bytes
}

const X: [f64; 3] = [1.0, -2.0, 3.0];
const Y: [f64; 3] = [4.0, 5.0, -6.0];
const Z: [f64; 3] = [7.0, 8.0, 9.0];

#[test]
fn ply_in_any_order_type_and_encoding() {
    let dir = temp();
    for encoding in [Encoding::Ascii, Encoding::Little, Encoding::Big] {
        for position in ["float", "double", "int", "short"] {
            for (color, values) in [
                ("uchar", [[10.0, 20.0, 30.0], [0.0, 128.0, 255.0], [255.0, 1.0, 2.0]]),
                ("ushort", [[100.0, 20_000.0, 30.0], [0.0, 128.0, 65_535.0], [255.0, 1.0, 2.0]]),
                ("float", [[0.5, 1.5, 30.0], [0.0, 100.0, 0.25], [8.0, 1.0, 2.0]]),
                ("double", [[0.5, 1.5, 30.0], [0.0, 100.0, 0.25], [8.0, 1.0, 2.0]]),
            ] {
                let all: Vec<(&str, &str, &[f64])> = vec![
                    ("x", position, &X),
                    ("y", position, &Y),
                    ("z", position, &Z),
                    ("nx", "float", &[0.0, 2.0, 0.0]),
                    ("ny", "float", &[1.0, 0.0, 0.0]),
                    ("nz", "float", &[0.0, 0.0, -3.0]),
                    ("red", color, &values[0]),
                    ("green", color, &values[1]),
                    ("blue", color, &values[2]),
                    ("quality", "double", &[1e300, -1.0, 0.0]),
                ];
                // Rotations of the list and their reverses: every property comes first and last once.
                for turn in 0..all.len() {
                    for reverse in [false, true] {
                        let mut columns = all.clone();
                        columns.rotate_left(turn);
                        if reverse {
                            columns.reverse();
                        }
                        let path = put(&dir, "cloud.ply", ply_file(encoding, &columns));
                        let cloud = ply::read_cloud(&path).unwrap();
                        for i in 0..3 {
                            assert_eq!(cloud.positions[i].as_dvec3(), DVec3::new(X[i], Y[i], Z[i]));
                            let decode = |v: f64| match color {
                                "uchar" => decode_srgb(v as f32 / 255.0),
                                "ushort" => decode_srgb(v as f32 / 65_535.0),
                                _ => v as f32,
                            };
                            assert_eq!(cloud.colors[i], Vec3::from(values.map(|channel| decode(channel[i]))));
                        }
                        assert_eq!(cloud.normals, [Vec3::Y, Vec3::X, Vec3::NEG_Z]);
                        assert_eq!((cloud.origin, cloud.viewpoint), (DVec3::ZERO, None));
                    }
                }
            }
        }
    }
}

#[test]
fn ply_colour_names() {
    let dir = temp();
    for names in [["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["Red", "Green", "Blue"]] {
        let mut columns: Vec<(&str, &str, &[f64])> = vec![("x", "float", &X), ("y", "float", &Y), ("z", "float", &Z)];
        columns.extend(names.map(|name| (name, "uchar", &[64.0, 128.0, 255.0] as &[f64])));
        let cloud = ply::read_cloud(&put(&dir, "a.PLY", ply_file(Encoding::Little, &columns))).unwrap();
        assert_eq!(cloud.colors[1], decode_srgb8([128; 3]));
    }
}

#[test]
fn ply_passes_over_lists_and_other_elements() {
    let dir = temp();
    let header = "element camera 2\r\nproperty list uchar short lens\r\nproperty int id\r\nobj_info x\r\n\
        element vertex 2\r\nproperty float x\r\nproperty list uint double weights\r\nproperty float y\r\n\
        property uchar red\r\nproperty uchar green\r\nproperty uchar blue\r\nproperty float z\r\n\
        element face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n";
    let ascii = format!(
        "ply\r\nformat ascii 1.0\r\n{header}3 1 2 3 7\r\n0 8\r\n\r\n1 2 0.5 .5 2 255 0 0 3\r\n4 0 5. 0 255 0 6e0\r\n3 0 1 0"
    );
    let mut binary = format!("ply\r\nformat binary_little_endian 1.0\r\n{header}").into_bytes();
    binary.extend([3, 1, 0, 2, 0, 3, 0, 7, 0, 0, 0, 0, 8, 0, 0, 0]);
    for (x, weights, y, color, z) in
        [(1f32, vec![0.5f64, 0.5], 2f32, [255, 0, 0], 3f32), (4.0, vec![], 5.0, [0, 255, 0], 6.0)]
    {
        binary.extend(x.to_le_bytes());
        binary.extend((weights.len() as u32).to_le_bytes());
        weights.iter().for_each(|w| binary.extend(w.to_le_bytes()));
        binary.extend(y.to_le_bytes());
        binary.extend(color);
        binary.extend(z.to_le_bytes());
    }
    // The face list, cut short: nothing after the vertices is of interest.
    binary.push(3);
    for bytes in [ascii.into_bytes(), binary] {
        let cloud = ply::read_cloud(&put(&dir, "cloud.ply", bytes)).unwrap();
        assert_eq!(cloud.positions, [Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 5.0, 6.0)]);
        assert_eq!(cloud.colors, [Vec3::X, Vec3::Y]);
    }
}

/// What was logged.
#[derive(Clone, Default)]
pub(crate) struct Log(pub(crate) Arc<Mutex<Vec<u8>>>);

impl std::io::Write for Log {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn invalid_points_are_dropped_and_negative_colours_clamped() {
    let dir = temp();
    let text = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
        property float red\nproperty float green\nproperty float blue\nend_header\n\
        0 0 0 -1 2 3\nnan 0 0 1 1 1\n0 -inf 0 1 1 1\n0 0 0 1 NaN 1\n1e30 0 0 1 1 1\n1 1 1 5 5 5\n";
    let path = put(&dir, "cloud.ply", text);
    let log = Log::default();
    let writer = log.clone();
    let subscriber = tracing_subscriber::fmt().with_writer(move || writer.clone()).finish();
    let cloud = tracing::subscriber::with_default(subscriber, || ply::read_cloud(&path)).unwrap();
    let text = String::from_utf8(log.0.lock().unwrap().clone()).unwrap();
    assert_says(&text, &["WARN", "cloud.ply: dropped 4 of 6 points"]);
    assert_eq!(cloud.positions, [Vec3::ZERO, Vec3::ONE]);
    assert_eq!(cloud.colors, [Vec3::new(0.0, 2.0, 3.0), Vec3::splat(5.0)]);
}

#[test]
fn large_coordinates_are_moved_before_they_are_rounded() {
    let dir = temp();
    let x: Vec<f64> = (0..100).map(|i| 4_500_000.0 + f64::from(i) * 0.001).collect();
    let zero = vec![0.0; 100];
    let columns: Vec<(&str, &str, &[f64])> = vec![
        ("x", "double", &x),
        ("y", "double", &zero),
        ("z", "double", &zero),
        ("r", "float", &zero),
        ("g", "float", &zero),
        ("b", "float", &zero),
    ];
    for encoding in [Encoding::Ascii, Encoding::Little] {
        let cloud = ply::read_cloud(&put(&dir, "cloud.ply", ply_file(encoding, &columns))).unwrap();
        assert_eq!(cloud.origin, DVec3::new(4_500_000.0, 0.0, 0.0));
        for (position, x) in cloud.positions.iter().zip(&x) {
            assert!((f64::from(position.x) + cloud.origin.x - x).abs() < 1e-8);
        }
    }
}

#[test]
fn written_ply_reads_back_to_the_bit() {
    let dir = temp();
    let mut random = Random(1);
    let mut vector = || Vec3::new(random.next(), random.next(), random.next()) * 100.0;
    let mut cloud = Cloud::default();
    for _ in 0..1000 {
        cloud.positions.push(vector());
        cloud.colors.push(vector());
        // Unitised twice, so that a third time changes nothing.
        cloud.normals.push((vector() - 50.0).normalize().normalize());
    }
    let path = dir.path().join("out.ply");
    ply::write_cloud(&path, &cloud).unwrap();
    let back = ply::read_cloud(&path).unwrap();
    assert_eq!((&back.positions, &back.colors), (&cloud.positions, &cloud.colors));
    assert!(back.normals.iter().zip(&cloud.normals).all(|(a, b)| (a - b).length() < 1e-6));
    // And as somebody else reads it.
    let parser = ply_rs_bw::parser::Parser::<ply_rs_bw::ply::DefaultElement>::new();
    let file = parser.read_ply(&mut std::fs::File::open(&path).unwrap()).unwrap();
    let first = &file.payload["vertex"][0];
    assert_eq!(first["nx"], ply_rs_bw::ply::Property::Float(cloud.normals[0].x));
    assert_eq!(first["blue"], ply_rs_bw::ply::Property::Float(cloud.colors[0].z));
    cloud.normals.clear();
    ply::write_cloud(&path, &cloud).unwrap();
    assert!(ply::read_cloud(&path).unwrap().normals.is_empty());
}

/// A packed colour with full alpha: its bits are a NaN.
pub(crate) fn packed(rgb: [u8; 3]) -> u32 {
    u32::from_be_bytes([255, rgb[0], rgb[1], rgb[2]])
}

pub(crate) fn pcd_file(
    path: &Path,
    data_kind: DataKind,
    schema: &[(&str, ValueKind, u64)],
    records: Vec<Vec<Field>>,
    (width, height): (u64, u64),
    viewpoint: ViewPoint,
) {
    let schema = Some(Schema::from_iter(schema.iter().copied()));
    let init = WriterInit { width, height, viewpoint, data_kind, schema, version: None };
    let mut writer: DynWriter<_> = init.create(path).unwrap();
    for record in records {
        writer.push(&DynRecord(record)).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn pcd_in_three_encodings() {
    let dir = temp();
    for data in [DataKind::Ascii, DataKind::Binary, DataKind::BinaryCompressed] {
        for float in [false, true] {
            // Text has no way to keep the bits of a NaN: PCL writes such colours as integers.
            if float && data == DataKind::Ascii {
                continue;
            }
            let kind = if float { ValueKind::F32 } else { ValueKind::U32 };
            let schema = [
                ("normal_x", ValueKind::F32, 1),
                ("x", ValueKind::F32, 1),
                ("spare", ValueKind::U16, 3),
                ("y", ValueKind::F64, 1),
                ("rgb", kind, 1),
                ("z", ValueKind::F32, 1),
                ("normal_y", ValueKind::F32, 1),
                ("normal_z", ValueKind::F32, 1),
            ];
            let records = (0..500u16).map(|i| {
                let bits = packed([i as u8, 20, 30]);
                let color = if float { Field::F32(vec![f32::from_bits(bits)]) } else { Field::U32(vec![bits]) };
                vec![
                    Field::F32(vec![if i == 7 { f32::NAN } else { 0.0 }]),
                    Field::F32(vec![f32::from(i)]),
                    Field::U16(vec![i, 0, 9]),
                    Field::F64(vec![f64::from(i) * 0.5]),
                    color,
                    Field::F32(vec![-1.0]),
                    Field::F32(vec![2.0]),
                    Field::F32(vec![0.0]),
                ]
            });
            let path = dir.path().join("cloud.pcd");
            pcd_file(&path, data, &schema, records.collect(), (500, 1), ViewPoint::default());
            let cloud = pcd::read(&path).unwrap();
            assert_eq!(cloud.len(), 500);
            assert_eq!(cloud.positions[300], Vec3::new(300.0, 150.0, -1.0));
            assert_eq!(cloud.colors[300], decode_srgb8([44, 20, 30]));
            assert_eq!((cloud.normals[6], cloud.normals[7]), (Vec3::Y, Vec3::ZERO));
            assert_eq!(cloud.viewpoint, None);
            // The unusable normal is estimated like a missing one.
            let complete = load(&path, &CloudOptions::default()).unwrap();
            assert!((complete.normals[7].length() - 1.0).abs() < 1e-5);
        }
    }
}

#[test]
fn pcd_gaps_and_viewpoints() {
    let dir = temp();
    let path = dir.path().join("kinect.pcd");
    let schema =
        [("x", ValueKind::F32, 1), ("y", ValueKind::F32, 1), ("z", ValueKind::F32, 1), ("rgba", ValueKind::U32, 1)];
    let records = || {
        (0..40u8).map(|i| {
            let x = if i % 3 == 0 { f32::NAN } else { f32::from(i % 8) };
            let [x, y, z] = [x, f32::from(i / 8), 2.0].map(|v| Field::F32(vec![v]));
            vec![x, y, z, Field::U32(vec![packed([i; 3])])]
        })
    };
    let moved = ViewPoint { tx: 1.0, ty: 2.0, tz: 3.0, ..ViewPoint::default() };
    for (size, viewpoint, expected) in [
        ((8, 5), ViewPoint::default(), Some(Vec3::ZERO)),
        ((40, 1), ViewPoint::default(), None),
        ((40, 1), moved.clone(), Some(Vec3::new(1.0, 2.0, 3.0))),
        ((8, 5), moved, Some(Vec3::new(1.0, 2.0, 3.0))),
    ] {
        pcd_file(&path, DataKind::BinaryCompressed, &schema, records().collect(), size, viewpoint);
        let cloud = load(&path, &CloudOptions::default()).unwrap();
        assert_eq!((cloud.len(), cloud.viewpoint), (26, expected));
        if let Some(from) = expected {
            // All points lie in z = 2.
            let side = Vec3::new(0.0, 0.0, (from.z - 2.0).signum());
            assert!(cloud.normals.iter().all(|n| n.dot(side) > 0.999));
        }
    }
}

/// A file of `count` points, each as `fill` leaves it.
pub(crate) fn las_file(path: &Path, format: u8, count: u32, fill: impl Fn(u32, &mut ::las::Point)) {
    let mut builder = ::las::Builder::from((1, 4));
    builder.point_format = ::las::point::Format::new(format).unwrap();
    let plain = builder.point_format;
    builder.point_format.is_compressed = path.extension().unwrap() == "laz";
    let transform = |offset| ::las::Transform { scale: 0.001, offset };
    builder.transforms = ::las::Vector { x: transform(600_000.0), y: transform(4_000_000.0), z: transform(0.0) };
    let mut writer = ::las::Writer::from_path(path, builder.into_header().unwrap()).unwrap();
    for i in 0..count {
        let mut point = ::las::Point { gps_time: plain.has_gps_time.then_some(1.0), ..Default::default() };
        fill(i, &mut point);
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
}

#[test]
fn las_and_laz() {
    let dir = temp();
    let at = |i: u32| DVec3::new(636_000.0 + f64::from(i) * 0.25, 4_849_000.0 + f64::from(i % 100), f64::from(i % 7));
    for name in ["scan.las", "scan.laz", "scan.LAZ"] {
        for format in [2, 3, 7] {
            if name == "scan.LAZ" && format != 3 {
                continue;
            }
            for scale in [1, 257] {
                let points: Vec<_> =
                    (0..1000).map(|i| (at(i), [(i % 256) as u16 * scale, 17 * scale, 255 * scale])).collect();
                let path = dir.path().join(name.to_lowercase());
                las_file(&path, format, 1000, |i, point| {
                    let (position, [red, green, blue]) = points[i as usize];
                    (point.x, point.y, point.z) = position.into();
                    point.color = Some(::las::Color::new(red, green, blue));
                });
                let path = if name == "scan.LAZ" { put(&dir, name, std::fs::read(path).unwrap()) } else { path };
                let cloud = las::read(&path).unwrap();
                assert_eq!(cloud.len(), 1000);
                assert_eq!(cloud.origin, cloud.origin.round());
                for (i, (position, [red, ..])) in points.iter().enumerate() {
                    let error = cloud.positions[i].as_dvec3() + cloud.origin - position;
                    assert!(error.abs().max_element() < 1e-4, "{error}");
                    let expected = decode_srgb8([(red / scale) as u8, 17, 255]);
                    assert!((cloud.colors[i] - expected).abs().max_element() < 1e-6);
                }
                // Z up: what was above (z) is now y, and what was north (y) points to -z.
                let turned = load(&path, &CloudOptions { up: Up::Z, ..Default::default() }).unwrap();
                let p = cloud.positions[123];
                assert_eq!(turned.positions[123], Vec3::new(p.x, p.z, -p.y));
                assert_eq!(turned.origin, DVec3::new(cloud.origin.x, cloud.origin.z, -cloud.origin.y));
            }
        }
    }
}

#[test]
fn one_point_is_a_cloud() {
    let dir = temp();
    for count in [1, 2, 50] {
        let (one, zero) = (vec![5.0; count], vec![0.0; count]);
        let columns: Vec<(&str, &str, &[f64])> = vec![
            ("x", "float", &one),
            ("y", "float", &zero),
            ("z", "float", &zero),
            ("red", "uchar", &zero),
            ("green", "uchar", &zero),
            ("blue", "uchar", &zero),
        ];
        let path = put(&dir, "one.ply", ply_file(Encoding::Little, &columns));
        let towards = Vec3::new(5.0, 0.0, 9.0);
        let cloud =
            load(&path, &CloudOptions { orient_towards: Some(towards.as_dvec3()), ..Default::default() }).unwrap();
        assert_eq!(cloud.positions, vec![Vec3::new(5.0, 0.0, 0.0); count]);
        assert_eq!(cloud.normals, vec![Vec3::Z; count]);
        let area: f32 = cloud.spacing.iter().map(|s| s * s).sum();
        assert!((area / 1e-6 - 1.0).abs() < 1e-4);
    }
}
