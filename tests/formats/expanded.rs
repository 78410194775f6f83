//! Expanded clouds: what comes out of a file that goes through `load_with_source` and `expanded::write`.

use std::path::Path;

use glam::Vec3;
use pcd_rs::{DataKind, Field, ValueKind, ViewPoint};
use relume::Error;
use relume::formats::cloud::{CloudOptions, Up, load, load_with_source};
use relume::formats::expanded::{self, Expanded};
use relume::scene::Cloud;

use crate::clouds::{Encoding, Log, las_file, packed, pcd_file, ply_file};
use crate::{assert_says, problem, put, temp};

/// A PLY file as this test reads it, with a parser of its own.
struct Written {
    header: Vec<String>,
    /// Type and name of each property.
    properties: Vec<String>,
    body: Vec<u8>,
}

impl Written {
    fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
        let header: Vec<String> = String::from_utf8_lossy(&bytes[..end]).lines().map(str::to_owned).collect();
        assert_eq!(header[..2], ["ply", "format binary_little_endian 1.0"]);
        let properties = header.iter().filter_map(|line| line.strip_prefix("property ")).map(str::to_owned).collect();
        Self { header, properties, body: bytes[end + 11..].to_vec() }
    }

    fn rows(&self) -> Vec<&[u8]> {
        let size = |property: &String| match property.split(' ').next().unwrap() {
            "char" | "uchar" => 1,
            "short" | "ushort" => 2,
            "int" | "uint" | "float" => 4,
            "double" => 8,
            other => panic!("no type {other}"),
        };
        let stride = self.properties.iter().map(size).sum();
        let rows: Vec<&[u8]> = self.body.chunks_exact(stride).collect();
        assert_eq!(rows.len() * stride, self.body.len());
        rows
    }
}

fn new_colors(points: usize) -> (Vec<Vec3>, Vec<u8>) {
    let colors = (0..points).map(|i| Vec3::new(i as f32 * 0.25, 700.5, 1e-3 * i as f32)).collect();
    (colors, (0..points).map(|i| (i % 4) as u8).collect())
}

/// Expands `input` into `output` with [`new_colors`].
fn expand(input: &Path, output: &Path, options: &CloudOptions) -> Cloud {
    let (mut cloud, source) = load_with_source(input, options).unwrap();
    let plain = load(input, options).unwrap();
    assert_same(&cloud, &plain);
    assert_eq!((source.len(), source.is_empty()), (cloud.len(), false));
    let (colors, flags) = new_colors(cloud.len());
    expanded::write(output, &Expanded { source: &source, colors: &colors, flags: &flags }).unwrap();
    cloud.colors = colors;
    cloud
}

#[track_caller]
fn assert_same(a: &Cloud, b: &Cloud) {
    assert_eq!((&a.positions, &a.colors), (&b.positions, &b.colors));
    assert_eq!((&a.normals, &a.spacing), (&b.normals, &b.spacing));
    assert_eq!((a.origin, a.viewpoint), (b.origin, b.viewpoint));
}

/// What is logged meanwhile.
fn logged(run: impl FnOnce()) -> String {
    let log = Log::default();
    let writer = log.clone();
    let subscriber = tracing_subscriber::fmt().with_writer(move || writer.clone()).finish();
    tracing::subscriber::with_default(subscriber, run);
    String::from_utf8(log.0.lock().unwrap().clone()).unwrap()
}

/// Little-endian bytes of what a test expects in a row.
macro_rules! row {
    ($($value:expr),* $(,)?) => { [$($value.to_le_bytes().to_vec()),*].concat() };
}

#[test]
fn ply_keeps_order_types_and_bits() {
    let dir = temp();
    let (x, y, z) = ([0.1, f64::NAN, -7.3e5], [4.0, 5.0, 1.0 / 3.0], [7.0, 8.0, 9.0]);
    let columns: Vec<(&str, &str, &[f64])> = vec![
        ("Quality", "double", &[0.1, 0.2, f64::MIN_POSITIVE]),
        ("blue", "uchar", &[30.0, 0.0, 2.0]),
        ("z", "double", &z),
        ("label", "short", &[-3.0, 7.0, -30_000.0]),
        ("green", "uchar", &[20.0, 0.0, 1.0]),
        ("y", "double", &y),
        ("nx", "float", &[0.0, 0.0, 1.5]),
        ("ny", "float", &[1.0, 0.0, 0.0]),
        ("nz", "float", &[0.0, 0.0, 0.0]),
        ("alpha", "uchar", &[255.0, 255.0, 128.0]),
        ("red", "uchar", &[10.0, 0.0, 0.0]),
        ("x", "double", &x),
        ("two words", "int", &[-1.0, 0.0, 2_000_000_000.0]),
        ("r", "ushort", &[65_535.0, 0.0, 1.0]),
    ];
    for encoding in [Encoding::Ascii, Encoding::Little, Encoding::Big] {
        let input = put(&dir, "in.ply", ply_file(encoding, &columns));
        let output = dir.path().join("out.ply");
        let cloud = expand(&input, &output, &CloudOptions::default());
        let written = Written::read(&output);
        let expected = [
            "double Quality",
            "float blue",
            "double z",
            "short label",
            "float green",
            "double y",
            "float nx",
            "float ny",
            "float nz",
            "uchar alpha",
            "float red",
            "double x",
            "int two words",
            "ushort r",
            "uchar expansion",
        ];
        assert_eq!(written.properties, expected, "{encoding:?}");
        let first = row![
            0.1f64, 0f32, 7f64, -3i16, 700.5f32, 4f64, 0f32, 1f32, 0f32, 255u8, 0f32, 0.1f64, -1i32, 65_535u16, 0u8
        ];
        let second = row![
            f64::MIN_POSITIVE,
            1e-3f32,
            9f64,
            -30_000i16,
            700.5f32,
            1.0 / 3.0f64,
            1.5f32,
            0f32,
            0f32,
            128u8,
            0.25f32,
            -7.3e5f64,
            2_000_000_000i32,
            1u16,
            1u8
        ];
        assert_eq!(written.rows(), [first, second], "{encoding:?}");
        assert!(written.header.contains(&"comment made by a test".to_owned()));
        assert!(written.header.contains(&"comment expansion: 0 kept, 1 projected, 2 solved, 3 filled".to_owned()));
        assert_same(&load(&output, &CloudOptions::default()).unwrap(), &cloud);
        // Once more, over itself: nothing but colours and flags may change.
        let (cloud, source) = load_with_source(&output, &CloudOptions::default()).unwrap();
        let again = Expanded { source: &source, colors: &cloud.colors, flags: &[0, 1] };
        expanded::write(&output, &again).unwrap();
        let rewritten = Written::read(&output);
        assert_eq!((&rewritten.header, &rewritten.body), (&written.header, &written.body));
    }
}

#[test]
fn all_colour_names_are_replaced_in_place() {
    let dir = temp();
    let (zero, code) = ([0.0, 1.0], [64.0, 128.0]);
    let xyz: [(&str, &str, &[f64]); 3] = [("x", "float", &zero), ("y", "float", &zero), ("z", "float", &zero)];
    let run = |colors: &[&str], kind: &'static str, expected: &[&str], warnings: &[&str]| {
        let mut columns = xyz.to_vec();
        columns.splice(1..1, colors.iter().map(|&name| (name, kind, &code as &[f64])));
        let input = put(&dir, "in.ply", ply_file(Encoding::Little, &columns));
        let output = dir.path().join("out.ply");
        let mut cloud = Cloud::default();
        let log = logged(|| cloud = expand(&input, &output, &CloudOptions::default()));
        let properties = Written::read(&output).properties;
        let expected = [&["float x"], expected, &["float y", "float z"]].concat();
        assert_eq!(properties[..expected.len()], expected);
        assert_eq!(properties.iter().filter(|p| p.ends_with("expansion")).count(), 1);
        assert_says(&log, warnings);
        assert_eq!(log.contains("WARN"), !warnings.is_empty(), "{log}");
        assert_same(&load(&output, &CloudOptions::default()).unwrap(), &cloud);
    };
    let rgb = ["float red", "float green", "float blue"];
    run(&["r", "g", "b"], "uchar", &rgb, &[]);
    run(&["diffuse_red", "diffuse_green", "diffuse_blue"], "ushort", &rgb, &[]);
    run(&["RED", "Green", "blue"], "float", &rgb, &[]);
    run(&["rgb"], "int", &rgb, &[]);
    run(&["rgba"], "float", &rgb, &[]);
    // An older flag of another type gives way to the new one, where it stands.
    run(
        &["red", "Expansion", "green", "blue"],
        "float",
        &["float red", "uchar expansion", "float green", "float blue"],
        &[],
    );
    // What would be read in the place of the new colours, or beside them under the same name, has to go.
    let second = "a second set of colours 'rgba', a second set of colours 'red'";
    run(&["rgb", "rgba", "red"], "int", &rgb, &["out.ply: not all of", "in.ply", second]);
    run(&["r", "g", "b", "red"], "uchar", &rgb, &["a second set of colours 'red'"]);
    run(
        &["red", "green", "blue", "r", "g", "b"],
        "uchar",
        &["float red", "float green", "float blue", "uchar r", "uchar g", "uchar b"],
        &[],
    );
}

#[test]
fn headers_keep_their_comments_and_lists_are_named() {
    let dir = temp();
    let mut text =
        b"ply\r\ncomment caf\xe9 \r\nformat ascii 1.0\r\ncomment viewpoint 1 2 -3.5\r\nobj_info num_cols 7\r\n\
        comment viewpoint of the camera\r\nelement vertex 2\r\nproperty float x\r\nproperty list uchar int near\r\n\
        property float y\r\nproperty float z\r\nproperty uchar red\r\nproperty uchar green\r\nproperty uchar blue\r\n\
        element edge 0\r\nproperty int a\r\nelement face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n"
            .to_vec();
    text.extend(b"0 2 5 6 0 0 1 2 3\r\n1 0 0 0 1 2 3\r\n3 0 1 0\r\n");
    let input = put(&dir, "in.ply", text);
    let output = dir.path().join("out.ply");
    let mut cloud = Cloud::default();
    let log = logged(|| cloud = expand(&input, &output, &CloudOptions::default()));
    assert_says(&log, &["WARN", "list property 'near', element 'face'"]);
    assert!(!log.contains("edge"), "{log}");
    assert_eq!(cloud.viewpoint, Some(Vec3::new(1.0, 2.0, -3.5)));
    assert_same(&load(&output, &CloudOptions::default()).unwrap(), &cloud);
    let bytes = std::fs::read(&output).unwrap();
    let start = b"ply\nformat binary_little_endian 1.0\ncomment caf\xe9\nobj_info num_cols 7\n\
        comment viewpoint of the camera\ncomment expansion: 0 kept, 1 projected, 2 solved, 3 filled\n\
        comment viewpoint 1 2 -3.5\nelement vertex 2\nproperty float x\nproperty float y\n";
    assert_eq!(String::from_utf8_lossy(&bytes[..start.len()]), String::from_utf8_lossy(start));
    assert!(bytes.starts_with(start));
    // A fixed viewpoint turns with the cloud.
    let turned = CloudOptions { up: Up::Z, ..CloudOptions::default() };
    let cloud = expand(&input, &output, &turned);
    assert_eq!(cloud.viewpoint, Some(Vec3::new(1.0, -3.5, -2.0)));
    assert_same(&load(&output, &turned).unwrap(), &cloud);
    assert_eq!(Written::read(&output).rows()[1][..12], row![1f32, 0f32, 0f32]);
}

#[test]
fn pcd_fields_padding_and_gaps() {
    let dir = temp();
    let schema = [
        ("x", ValueKind::F32, 1),
        ("_", ValueKind::U8, 2),
        ("hist", ValueKind::I16, 3),
        ("y", ValueKind::F64, 1),
        ("rgba", ValueKind::U32, 1),
        ("z", ValueKind::F32, 1),
        ("stamp", ValueKind::U64, 1),
        ("ring", ValueKind::U16, 1),
    ];
    for data in [DataKind::Ascii, DataKind::Binary, DataKind::BinaryCompressed] {
        let records = (0..30u8).map(|i| {
            let gap = i % 3 == 0;
            vec![
                Field::F32(vec![if gap { f32::NAN } else { f32::from(i) }]),
                Field::U8(vec![9, 9]),
                Field::I16(vec![i16::from(i), -5, 300]),
                Field::F64(vec![0.1 * f64::from(i)]),
                Field::U32(vec![packed([i, 2, 3])]),
                Field::F32(vec![2.0]),
                Field::U64(vec![(1 << 40) + u64::from(i)]),
                Field::U16(vec![u16::from(i) * 1000]),
            ]
        });
        let input = dir.path().join("in.pcd");
        pcd_file(&input, data, &schema, records.collect(), (6, 5), ViewPoint { tz: 0.1, ..ViewPoint::default() });
        let output = dir.path().join("out.ply");
        let mut cloud = Cloud::default();
        let log = logged(|| cloud = expand(&input, &output, &CloudOptions::default()));
        assert_says(&log, &["the digits of 'stamp' beyond those of a double"]);
        assert_eq!(cloud.len(), 20);
        let written = Written::read(&output);
        let expected = [
            "float x",
            "short hist_0",
            "short hist_1",
            "short hist_2",
            "double y",
            "float red",
            "float green",
            "float blue",
            "float z",
            "double stamp",
            "ushort ring",
            "uchar expansion",
        ];
        assert_eq!(written.properties, expected);
        for (row, i) in written.rows().into_iter().zip((0..30u8).filter(|i| i % 3 != 0)) {
            let point = cloud.positions.iter().position(|p| p.x == f32::from(i)).unwrap();
            let (colors, flags) = new_colors(20);
            let expected = row![
                f32::from(i),
                i16::from(i),
                -5i16,
                300i16,
                0.1 * f64::from(i),
                colors[point].x,
                colors[point].y,
                colors[point].z,
                2f32,
                ((1u64 << 40) + u64::from(i)) as f64,
                u16::from(i) * 1000,
                flags[point]
            ];
            assert_eq!(row, expected, "{data:?} {i}");
        }
        // The scanner's place is kept too: without it the normals would be turned another way.
        assert_eq!(cloud.viewpoint, Some(Vec3::new(0.0, 0.0, 0.1)));
        assert_same(&load(&output, &CloudOptions::default()).unwrap(), &cloud);
    }
}

#[test]
fn las_keeps_coordinates_to_the_bit_and_its_columns() {
    let dir = temp();
    for name in ["in.las", "in.laz"] {
        for format in [2u8, 3, 7, 8] {
            let input = dir.path().join(name);
            las_file(&input, format, 300, |i, point| {
                (point.x, point.y, point.z) = (636_000.0 + f64::from(i) * 0.25, 4_849_000.0 + f64::from(i % 100), 0.5);
                point.color = Some(::las::Color::new(i as u16, 700, 65_535));
                point.intensity = 7 * i as u16;
                (point.return_number, point.number_of_returns) = (2, 5);
                point.classification = ::las::point::Classification::Building;
                point.scan_direction = ::las::point::ScanDirection::LeftToRight;
                (point.is_key_point, point.user_data, point.point_source_id) = (true, 42, 4242);
                point.scan_angle = -12.0;
                point.gps_time = point.gps_time.map(|_| f64::from(i) + 0.125);
                point.nir = (format == 8).then_some(99);
                point.scanner_channel = if format >= 6 { 3 } else { 0 };
            });
            let options = CloudOptions { up: Up::Z, ..CloudOptions::default() };
            let output = dir.path().join("out.ply");
            let mut cloud = Cloud::default();
            let log = logged(|| cloud = expand(&input, &output, &options));
            assert_eq!(log, "");
            assert_same(&load(&output, &options).unwrap(), &cloud);
            let written = Written::read(&output);
            let extended = format >= 6;
            let mut expected = vec![
                "double x",
                "double y",
                "double z",
                "ushort intensity",
                "uchar return_number",
                "uchar number_of_returns",
                "uchar scan_direction",
                "uchar edge_of_flight_line",
                "uchar classification",
                "uchar classification_flags",
                "float scan_angle",
                "uchar user_data",
                "ushort point_source_id",
            ];
            expected.extend(extended.then_some("uchar scanner_channel"));
            expected.extend((format != 2).then_some("double gps_time"));
            expected.extend(["float red", "float green", "float blue"]);
            expected.extend((format == 8).then_some("ushort nir"));
            expected.push("uchar expansion");
            assert_eq!(written.properties, expected);
            let (colors, flags) = new_colors(300);
            let mut reader = ::las::Reader::from_path(&input).unwrap();
            let points: Vec<::las::Point> = reader.read_all().unwrap().points().map(Result::unwrap).collect();
            for (i, (row, point)) in written.rows().into_iter().zip(points).enumerate() {
                let mut expected = row![point.x, point.y, point.z, point.intensity, 2u8, 5u8, 1u8, 0u8, 6u8, 2u8];
                expected.extend(row![point.scan_angle, 42u8, 4242u16]);
                expected.extend(point.gps_time.filter(|_| extended).iter().flat_map(|_| [3u8]));
                expected.extend(point.gps_time.iter().flat_map(|time| time.to_le_bytes()));
                expected.extend(row![colors[i].x, colors[i].y, colors[i].z]);
                expected.extend(point.nir.iter().flat_map(|nir| nir.to_le_bytes()));
                expected.push(flags[i]);
                assert_eq!(row, expected, "{name} {format} {i}");
            }
        }
    }
}

#[test]
fn many_points_are_the_same_whatever_the_threads() {
    let dir = temp();
    // More than one batch, and a last piece that is not full.
    let count = (1 << 18) + 5_000;
    let x: Vec<f64> = (0..count).map(f64::from).collect();
    let columns: Vec<(&str, &str, &[f64])> =
        ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue"].map(|name| (name, "float", x.as_slice())).to_vec();
    let input = put(&dir, "in.ply", ply_file(Encoding::Little, &columns));
    let (cloud, source) = load_with_source(&input, &CloudOptions::default()).unwrap();
    let (colors, flags) = new_colors(cloud.len());
    let run = |threads: usize| {
        let output = dir.path().join(format!("out{threads}.ply"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| expanded::write(&output, &Expanded { source: &source, colors: &colors, flags: &flags }))
            .unwrap();
        std::fs::read(output).unwrap()
    };
    let one = run(1);
    assert_eq!(one, run(3));
    let written = Written::read(&dir.path().join("out1.ply"));
    for i in [0, 4095, 4096, (1 << 18) - 1, 1 << 18, count as usize - 1] {
        let v = i as f32;
        let expected = row![v, v, v, v, v, v, colors[i].x, colors[i].y, colors[i].z, flags[i]];
        assert_eq!(written.rows()[i], expected);
    }
}

#[test]
fn what_cannot_be_written_leaves_nothing_behind() {
    let dir = temp();
    let one = [1.0, 2.0];
    let columns: Vec<(&str, &str, &[f64])> =
        ["x", "y", "z", "red", "green", "blue"].map(|name| (name, "float", &one as &[f64])).to_vec();
    let input = put(&dir, "in.ply", ply_file(Encoding::Little, &columns));
    let (_, source) = load_with_source(&input, &CloudOptions::default()).unwrap();
    let output = put(&dir, "out.ply", "older");
    let white = [Vec3::ONE; 2];
    let refused =
        |colors: &[Vec3], flags: &[u8]| match expanded::write(&output, &Expanded { source: &source, colors, flags })
            .err()
            .unwrap()
        {
            Error::Argument(problem) => problem,
            other => panic!("expected Error::Argument, got {other:?}"),
        };
    assert_says(&refused(&white[..1], &[0, 0]), &["2 points has 1 colours"]);
    assert_says(&refused(&white, &[0, 0, 0]), &["2 points has 3 flags"]);
    assert_says(&refused(&white, &[0, 4]), &["flag 4", "0 to 3"]);
    for bad in [f32::NAN, f32::INFINITY, -1.0, 2e15] {
        assert_says(&refused(&[Vec3::ONE, Vec3::new(0.0, bad, 0.0)], &[0, 0]), &["point 1", "colour"]);
    }
    assert_eq!(std::fs::read(&output).unwrap(), b"older");
    let good = Expanded { source: &source, colors: &white, flags: &[0, 3] };
    let nowhere = dir.path().join("none").join("out.ply");
    assert_says(&problem(expanded::write(&nowhere, &good), &nowhere), &["cannot be written"]);
    let folder = dir.path().join("folder.ply");
    std::fs::create_dir(&folder).unwrap();
    assert_says(&problem(expanded::write(&folder, &good), &folder), &["cannot be written"]);
    // A disk that is full.
    if Path::new("/dev/full").exists() {
        let full = dir.path().join(format!(".full.ply.{}.part", std::process::id()));
        std::os::unix::fs::symlink("/dev/full", &full).unwrap();
        let path = dir.path().join("full.ply");
        assert_says(&problem(expanded::write(&path, &good), &path), &["cannot be written"]);
    }
    let mut left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["folder.ply", "in.ply", "out.ply"]);
}
