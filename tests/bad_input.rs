//! Bad input on the command line: every case ends with exit code 2 and one line on standard error that names the file or
//! the flag, prints nothing else, and leaves the folder as it was. At the end the edge cases that are good input, and
//! must work. What is wrong inside files is tested in full by `formats`; here is one of each kind, through the binary.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use glam::Vec3;
use relume::formats::image::{ExrLayers, read_rgba_exr, write_exr};
use serde_json::json;
use tempfile::TempDir;

/// A folder with good input, which the cases spoil: `cloud.ply`, `cube.obj`, `sky.exr`.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        let place = Self(TempDir::new().unwrap());
        place.put("cloud.ply", ply(&points(200, Vec3::ZERO.as_dvec3().to_array(), 2.0)));
        place.put("cube.obj", CUBE);
        place.exr("sky.exr", 8, 4, 1.0);
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).unwrap();
    }

    fn exr(&self, name: &str, width: u32, height: u32, value: f32) {
        let rgb = vec![Vec3::splat(value); (width * height) as usize];
        write_exr(&self.path(name), &ExrLayers { width, height, rgb: &rgb, alpha: None, groups: &[] }).unwrap();
    }

    fn run(&self, arguments: &[impl AsRef<OsStr>]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_relume")).current_dir(self.0.path()).args(arguments).output().unwrap()
    }

    /// Runs what must be refused, and gives the line that says why.
    #[track_caller]
    fn refuses(&self, arguments: &[impl AsRef<OsStr>], parts: &[&str]) -> String {
        let before = contents(self.0.path());
        let output = self.run(arguments);
        let line = refusal(&output);
        assert_eq!(contents(self.0.path()), before, "the folder has changed; {line}");
        for part in parts {
            assert!(line.contains(part), "{line:?} does not say {part:?}");
        }
        line
    }

    /// The same for `relume render` with good input and `flags`, which come first and may name other files.
    #[track_caller]
    fn render_refuses(&self, flags: &str, parts: &[&str]) {
        self.refuses(&self.render(flags), parts);
    }

    /// The same for `relume build` of a file `name` that is `bytes`.
    #[track_caller]
    fn cloud_refuses(&self, name: &str, bytes: impl AsRef<[u8]>, parts: &[&str]) {
        self.put(name, bytes);
        self.refuses(&["build", name, "--out", "out.bsh"], &[&[name], parts].concat());
    }

    /// The same for `relume render` of an object `name` that is `bytes`.
    #[track_caller]
    fn object_refuses(&self, name: &str, bytes: impl AsRef<[u8]>, parts: &[&str]) {
        self.put(name, bytes);
        self.render_refuses(&format!("--object {name}"), &[&[name], parts].concat());
    }

    /// Arguments of `relume render`: `flags`, and what they leave out of a small picture.
    fn render(&self, flags: &str) -> Vec<String> {
        let mut arguments: Vec<String> =
            ["render"].into_iter().chain(flags.split_whitespace()).map(str::to_owned).collect();
        let defaults = [
            ("--cloud", "cloud.ply"),
            ("--object", "cube.obj"),
            ("--size", "16x12"),
            ("--microbuffer", "8"),
            ("--out", "out.exr"),
        ];
        for (flag, value) in defaults {
            if !arguments.iter().any(|argument| argument == flag) {
                arguments.extend([flag.to_owned(), value.to_owned()]);
            }
        }
        arguments
    }

    /// Runs what must work, and gives the colours of the picture, all of them finite.
    #[track_caller]
    fn renders(&self, flags: &str) -> Vec<Vec3> {
        let output = self.run(&self.render(flags));
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{flags}: {said}");
        let image = read_rgba_exr(&self.path("out.exr")).unwrap();
        assert!(image.rgb.iter().all(|c| c.is_finite()), "{flags}: not finite");
        assert!(image.alpha.contains(&1.0), "{flags}: the object is not seen");
        image.rgb
    }
}

/// The one line of a refusal.
#[track_caller]
fn refusal(output: &Output) -> String {
    let said = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(output.stdout.is_empty(), "printed {:?}", String::from_utf8_lossy(&output.stdout));
    let line = said.strip_suffix('\n').unwrap_or_else(|| panic!("no whole line: {said:?}"));
    assert!(line.starts_with("relume: ") && !line.contains(char::is_control), "not one plain line: {said:?}");
    line.to_owned()
}

/// Everything in a folder, by name.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            all.extend(contents(&path));
            all.insert(path, Vec::new());
        } else {
            // What is no file has no content: a pipe would not end.
            let bytes = if path.is_file() { fs::read(&path).unwrap() } else { Vec::new() };
            all.insert(path, bytes);
        }
    }
    all
}

type Point = ([f64; 3], [f64; 3]);

/// Points on the faces of a cube of `half` metres around `centre`, on a lattice.
fn points(count: usize, centre: [f64; 3], half: f64) -> Vec<Point> {
    let point = |i: usize| {
        let (axis, side) = (i % 3, if i.is_multiple_of(2) { half } else { -half });
        let (u, v) = ((i * 7 % 29) as f64 / 14.5 - 1.0, (i * 11 % 31) as f64 / 15.5 - 1.0);
        let mut p = centre;
        p[axis] += side;
        p[(axis + 1) % 3] += half * u;
        p[(axis + 2) % 3] += half * v;
        (p, [0.9, 0.5, 0.2])
    };
    (0..count).map(point).collect()
}

fn ply(points: &[Point]) -> String {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", points.len());
    for name in ["x", "y", "z", "red", "green", "blue"] {
        writeln!(text, "property double {name}").unwrap();
    }
    text += "end_header\n";
    for ([x, y, z], [r, g, b]) in points {
        writeln!(text, "{x} {y} {z} {r} {g} {b}").unwrap();
    }
    text
}

fn pcd(fields: &str, promised: usize, rows: &str) -> String {
    let count = fields.split(' ').count();
    let all = |word: &str| vec![word; count].join(" ");
    format!(
        "VERSION 0.7\nFIELDS {fields}\nSIZE {}\nTYPE {}\nCOUNT {}\nWIDTH {promised}\nHEIGHT 1\nPOINTS {promised}\nDATA ascii\n{rows}",
        all("4"),
        all("F"),
        all("1")
    )
}

fn las(format: u8, compressed: bool) -> Vec<u8> {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format::new(format).unwrap();
    builder.point_format.is_compressed = compressed;
    let mut writer = las::Writer::new(std::io::Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
    for i in 0..50 {
        let mut point = las::Point { x: f64::from(i), ..Default::default() };
        point.color = (format == 2).then(|| las::Color::new(1, 2, 3));
        writer.write_point(point).unwrap();
    }
    writer.into_inner().unwrap().into_inner()
}

const CUBE: &str = "\
v -.5 -.5 -.5\nv -.5 -.5 .5\nv -.5 .5 -.5\nv -.5 .5 .5\nv .5 -.5 -.5\nv .5 -.5 .5\nv .5 .5 -.5\nv .5 .5 .5\n\
f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n";

/// A glTF document whose only buffer is the file `name`.
fn gltf(name: &str) -> String {
    json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 36, "uri": name}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    })
    .to_string()
}

#[test]
fn commands_and_flags() {
    let place = Place::new();
    place.refuses(&[] as &[&str], &["a command is missing", "--help"]);
    place.refuses(&["bench"], &["--help"]);
    place.refuses(&["paint"], &["'paint'"]);
    place.refuses(&["render"], &["--out"]);
    place.refuses(&["render", "--out", "x.png"], &["--object FILE is missing"]);
    place.refuses(&["build", "cloud.ply"], &["--out"]);
    place.refuses(&["build", "cloud.ply", "--out"], &["--out"]);
    place.refuses(&["info", "--loud"], &["'--loud'"]);
    place.render_refuses("--size 16x16 --size 16x16", &["--size"]);
}

#[test]
fn values_of_flags() {
    let place = Place::new();
    for size in ["0x0", "0x16", "16x0", "16", "16x", "axb", "-1x5", "16x16x16", "1e2x4", "32769x1", "99999999999x1"] {
        place.render_refuses(&format!("--size {size}"), &["--size", size, "1 to 32768"]);
    }
    // A picture of a billion pixels would not fit memory.
    place.render_refuses("--size 32768x32768", &["--size", "pixels"]);
    for microbuffer in ["7", "9", "66", "0", "-8", "x"] {
        place.render_refuses(&format!("--microbuffer {microbuffer}"), &["--microbuffer", "8 to 64"]);
    }
    place.render_refuses("--quality best", &["--quality", "draft, normal and high"]);
    place.render_refuses("--technique fast", &["--technique", "classic, mipmapped, hybrid, shared, probes and lamps"]);
    for material in ["gold", "diffuse", "diffuse:", "diffuse:2", "diffuse:-1", "metal:0", "metal:NaN", "metal:2"] {
        place.render_refuses(&format!("--material {material}"), &["--material", material]);
    }
    place.render_refuses("--paper image,rain", &["--paper", "\"rain\""]);
    for fov in ["0", "200", "-30", "NaN", "wide"] {
        place.render_refuses(&format!("--fov {fov}"), &["--fov", fov]);
    }
    for flag in ["--camera-from", "--camera-at", "--object-at", "--towards"] {
        for vector in ["NaN,0,0", "0,inf,0", "1,2", "1,2,3,4", "a,b,c", "1e13,0,0", "-1,-2"] {
            place.render_refuses(&format!("{flag} {vector}"), &[flag, vector]);
        }
    }
    for scale in ["-2", "0", "NaN", "inf", "1e30"] {
        place.render_refuses(&format!("--object-scale {scale}"), &["--object-scale", scale]);
    }
    place.render_refuses("--object-turn -inf", &["--object-turn"]);
    for value in ["0", "-1", "NaN", "1e300"] {
        place.render_refuses(&format!("--stop {value}"), &["--stop"]);
    }
    place.render_refuses("--stop 8 --switch 4", &["8 and 4"]);
    for budget in ["0", "-5", "much", "99999999999999999999"] {
        place.render_refuses(&format!("--memory-budget {budget}"), &["--memory-budget"]);
    }
    place.render_refuses("--up x", &["--up"]);
    place.refuses(&["build", "cloud.ply", "--out", "out.bsh", "--prune-color", "NaN"], &["--prune-color"]);
    place.refuses(&["build", "cloud.ply", "--out", "out.bsh", "--prune-normal", "-2"], &["--prune-normal"]);
}

#[test]
fn places_that_leave_nothing_to_see() {
    let place = Place::new();
    let same = "the same point";
    place.render_refuses("--camera-from 1,2,3 --camera-at 1,2,3", &["--camera-from", "--camera-at", same]);
    place.render_refuses("--camera-from 0,0,0", &["--camera-from", "--camera-at", same]);
    place.render_refuses("--object-at 1e12,0,0", &["too small", "--camera-from"]);
}

#[test]
fn devices_and_budgets() {
    let place = Place::new();
    place.render_refuses("--device toaster", &["\"toaster\"", "there are: "]);
    place.render_refuses("--memory-budget 1", &["memory budget of 1 MiB", "needs about"]);
}

#[test]
fn a_system_without_a_driver() {
    let place = Place::new();
    let before = contents(place.0.path());
    // The loader looks for drivers in these files alone.
    let output = Command::new(env!("CARGO_BIN_EXE_relume"))
        .current_dir(place.0.path())
        .args(place.render(""))
        .envs([("VK_ICD_FILENAMES", "none.json"), ("VK_DRIVER_FILES", "none.json")])
        .output()
        .unwrap();
    assert!(refusal(&output).contains("driver") || refusal(&output).contains("no Vulkan device"), "{output:?}");
    assert_eq!(contents(place.0.path()), before);
}

#[test]
fn missing_files_and_what_is_no_file() {
    let place = Place::new();
    fs::create_dir(place.path("folder")).unwrap();
    for name in ["none.ply", "none.pcd", "none.las", "none.laz", "none.bsh", "folder/none.ply"] {
        place.render_refuses(&format!("--cloud {name}"), &[name, "cannot be read"]);
    }
    for name in ["none.gltf", "none.glb", "none.obj", "none.ply"] {
        place.render_refuses(&format!("--object {name}"), &[name, "cannot be read"]);
    }
    for name in ["none.exr", "none.hdr"] {
        place.render_refuses(&format!("--environment {name}"), &[name, "cannot be read"]);
    }
    for extension in ["ply", "pcd", "las", "laz", "bsh"] {
        let name = format!("folder.{extension}");
        fs::create_dir(place.path(&name)).unwrap();
        place.render_refuses(&format!("--cloud {name}"), &[&name, "it is a folder"]);
    }
    place.render_refuses("--object folder.ply", &["folder.ply", "it is a folder"]);
    fs::create_dir(place.path("folder.exr")).unwrap();
    place.render_refuses("--environment folder.exr", &["folder.exr", "it is a folder"]);
    for (flag, name) in [("--cloud", "a.xyz"), ("--cloud", "cloud"), ("--object", "a.fbx"), ("--environment", "a.jpg")]
    {
        place.put(name, "some bytes");
        place.render_refuses(&format!("{flag} {name}"), &[name, "expected ."]);
    }
}

#[cfg(unix)]
#[test]
fn devices_and_strange_names() {
    use std::os::unix::ffi::OsStrExt;
    let place = Place::new();
    // Neither ends.
    for name in ["zero.ply", "zero.las", "zero.bsh"] {
        std::os::unix::fs::symlink("/dev/zero", place.path(name)).unwrap();
        place.render_refuses(&format!("--cloud {name}"), &[name, "no regular file"]);
    }
    let pipe = Command::new("mkfifo").arg(place.path("pipe.ply")).status();
    if pipe.is_ok_and(|status| status.success()) {
        place.render_refuses("--cloud pipe.ply", &["pipe.ply", "no regular file"]);
    }
    place.refuses(&["build", "two\nlines\u{1b}[31m.ply", "--out", "out.bsh"], &["two?lines?[31m.ply"]);
    let no_text = OsStr::from_bytes(b"\xff.ply");
    place.refuses(&[OsStr::new("build"), no_text, OsStr::new("--out"), OsStr::new("out.bsh")], &["cannot be read"]);
    place.refuses(&[OsStr::new("render"), OsStr::new("--size"), no_text], &["UTF-8"]);
}

#[test]
fn clouds_in_ply() {
    let place = Place::new();
    let good = ply(&points(200, [0.0; 3], 2.0));
    place.cloud_refuses("empty.ply", "", &["not a"]);
    place.cloud_refuses("magic.ply", good.replacen("ply", "plz", 1), &["not a"]);
    place.cloud_refuses("cut.ply", &good[..good.len() / 2], &[]);
    place.cloud_refuses("more.ply", good.replacen("vertex 200", "vertex 201", 1), &["cut short", "201"]);
    place.cloud_refuses("much_more.ply", good.replacen("vertex 200", "vertex 99999999999999", 1), &["cut short"]);
    place.cloud_refuses("grey.ply", good.replace("red", "intensity"), &["has no colours", "intensity"]);
    place.cloud_refuses("none.ply", ply(&[]), &["holds no points"]);
    let color = [0.5; 3];
    let bad = [([f64::NAN; 3], color), ([0.0, f64::INFINITY, 0.0], color), ([0.0; 3], [f64::NAN; 3])];
    place.cloud_refuses("nan.ply", ply(&bad), &["holds 3 points, but none with finite position and colour"]);
    let beyond = [([1e13, 0.0, 0.0], color), ([0.0; 3], [1e30; 3])];
    place.cloud_refuses("beyond.ply", ply(&beyond), &["holds 2 points, but none"]);
    // A line that binary data would break is not repeated as it is.
    place.cloud_refuses("binary.ply", good.replacen("0.9", "\u{1b}[2J\u{7}", 1), &["row"]);
}

#[test]
fn clouds_in_pcd() {
    let place = Place::new();
    let fields = "x y z rgb";
    place.cloud_refuses("empty.pcd", "", &["not a readable PCD"]);
    place.cloud_refuses("magic.pcd", "point cloud\n", &["not a readable PCD"]);
    place.cloud_refuses("cut.pcd", pcd(fields, 3, "1 2 3 4\n1 2"), &["point 2"]);
    place.cloud_refuses("more.pcd", pcd(fields, 3, "1 2 3 4\n"), &["cut short", "promises 3 points, it holds 1"]);
    place.cloud_refuses("grey.pcd", pcd("x y z intensity", 1, "1 2 3 4\n"), &["has no colours"]);
    place.cloud_refuses("none.pcd", pcd(fields, 0, ""), &["holds no points"]);
    place.cloud_refuses("nan.pcd", pcd(fields, 1, "nan inf 3 4\n"), &["none with finite position"]);
}

#[test]
fn clouds_in_las_and_laz() {
    let place = Place::new();
    for compressed in [false, true] {
        let extension = if compressed { "laz" } else { "las" };
        let name = |what: &str| format!("{what}.{extension}");
        let good = las(2, compressed);
        place.cloud_refuses(&name("empty"), "", &["not a readable LAS"]);
        place.cloud_refuses(&name("magic"), [&b"SAL"[..], &good[3..]].concat(), &["not a readable LAS"]);
        place.cloud_refuses(&name("cut"), &good[..good.len() * 2 / 3], &[]);
        place.cloud_refuses(&name("grey"), las(0, compressed), &["has no colours"]);
        // The number of points in the header.
        let mut more = good.clone();
        more[107..111].copy_from_slice(&u32::MAX.to_le_bytes());
        place.cloud_refuses(&name("more"), more, &["4294967295 points"]);
    }
}

#[test]
fn saved_hierarchies() {
    let place = Place::new();
    let built = place.run(&["build", "cloud.ply", "--out", "good.bsh"]);
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let good = fs::read(place.path("good.bsh")).unwrap();
    let refuses = |name: &str, bytes: &[u8], part: &str| {
        place.put(name, bytes);
        place.render_refuses(&format!("--cloud {name}"), &[name, part]);
    };
    refuses("empty.bsh", b"", "not a saved hierarchy");
    refuses("magic.bsh", &[b"x", &good[1..]].concat(), "not a saved hierarchy");
    refuses("cut.bsh", &good[..good.len() / 2], "bytes long and should be");
    let mut flipped = good.clone();
    flipped[good.len() / 2] ^= 1;
    refuses("flipped.bsh", &flipped, "checksum");
    let mut more = good.clone();
    more[16..24].copy_from_slice(&u64::MAX.to_le_bytes());
    refuses("more.bsh", &more, "no file can hold");
    // A hierarchy is no cloud to build one from.
    place.refuses(&["build", "good.bsh", "--out", "out.bsh"], &["good.bsh", "expected .ply"]);
}

#[test]
fn objects() {
    let place = Place::new();
    place.object_refuses("empty.obj", "", &["no triangle"]);
    place.object_refuses("range.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", &["not a readable OBJ"]);
    place.object_refuses("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", &["no triangle"]);
    place.object_refuses("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", &["no triangle with an area"]);
    place.object_refuses("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", &["not finite"]);
    place.object_refuses("beyond.obj", "v 0 0 1e30\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", &["beyond"]);
    // A scan is no mesh.
    place.render_refuses("--object cloud.ply", &["cloud.ply", "face"]);
    let mesh = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n";
    place.object_refuses("range.ply", format!("{mesh}3 0 1 3\n"), &["vertex index 3"]);
    place.object_refuses("negative.ply", format!("{mesh}3 0 1 -1\n"), &["vertex index"]);
    place.object_refuses("cut.ply", mesh, &["cut short"]);
}

#[test]
fn objects_in_gltf() {
    let place = Place::new();
    let triangle: Vec<u8> = [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().flat_map(|v| v.to_le_bytes()).collect();
    place.put("good.bin", &triangle);
    place.put("short.bin", &triangle[..20]);
    place.put("good.gltf", gltf("good.bin"));
    place.renders("--object good.gltf --camera-from 0.2,0.2,3 --camera-at 0.2,0.2,0");
    fs::remove_file(place.path("out.exr")).unwrap();

    let good = gltf("good.bin");
    place.object_refuses("empty.gltf", "", &["not a readable glTF"]);
    place.object_refuses("cut.gltf", &good[..good.len() / 2], &["not a readable glTF"]);
    place.object_refuses("gone.gltf", gltf("gone.bin"), &["'gone.bin'", "cannot be read"]);
    place.object_refuses("short.gltf", gltf("short.bin"), &["buffer 0", "36"]);
    place.object_refuses("count.gltf", good.replace("\"count\":3", "\"count\":4"), &["accessor 0", "beyond"]);
    place.object_refuses("nothing.gltf", good.replace("\"nodes\":[0]", "\"nodes\":[]"), &["no triangle"]);
    for bytes in [&b""[..], b"glTF", b"glTF\x02\0\0\0\xff\xff\xff\xff", &[0; 64]] {
        place.object_refuses("bad.glb", bytes, &["not a readable glTF"]);
    }
}

#[test]
fn environments() {
    let place = Place::new();
    let refuses = |name: &str, bytes: &[u8], part: &str| {
        place.put(name, bytes);
        place.render_refuses(&format!("--environment {name}"), &[name, part]);
    };
    let good = fs::read(place.path("sky.exr")).unwrap();
    refuses("empty.exr", b"", "not a readable EXR");
    refuses("magic.exr", &[b"x", &good[1..]].concat(), "not a readable EXR");
    refuses("cut.exr", &good[..good.len() / 2], "not a readable EXR");
    refuses("empty.hdr", b"", "not a readable Radiance");
    let header = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n";
    refuses("cut.hdr", format!("{header}-Y 4 +X 8\n\u{2}").as_bytes(), "not a readable Radiance");
    refuses("more.hdr", format!("{header}-Y 99999 +X 99999\n1").as_bytes(), "promises 99999x99999");
}

#[test]
fn outputs() {
    let place = Place::new();
    fs::create_dir(place.path("folder.exr")).unwrap();
    fs::create_dir(place.path("folder.bsh")).unwrap();
    place.render_refuses("--out gone/out.exr", &["gone/out.exr", "there is no folder gone"]);
    place.render_refuses("--out cube.obj/out.exr", &["cube.obj/out.exr", "there is no folder"]);
    place.render_refuses("--out folder.exr", &["folder.exr", "it is a folder"]);
    for name in ["out", "out.jpg", ".exr", "folder.exr/.."] {
        place.render_refuses(&format!("--out {name}"), &[name, "must end in .exr or .png"]);
    }
    place.render_refuses("--stats gone/a.json", &["gone/a.json", "there is no folder gone"]);
    place.render_refuses("--stats a.txt", &["a.txt", "must end in .json"]);
    place.refuses(&["build", "cloud.ply", "--out", "folder.bsh"], &["folder.bsh", "it is a folder"]);
    place.refuses(&["build", "cloud.ply", "--out", "gone/a.bsh"], &["gone/a.bsh", "there is no folder"]);
    place.refuses(&["build", "cloud.ply", "--out", "a.ply"], &["a.ply", "must end in .bsh"]);
    // Where the system makes no files, root or not.
    if cfg!(target_os = "linux") {
        place.render_refuses("--out /proc/out.exr", &["/proc/out.exr", "cannot be written"]);
    }
}

#[test]
fn comparisons() {
    let place = Place::new();
    place.exr("a.exr", 16, 16, 1.0);
    place.exr("small.exr", 16, 8, 1.0);
    place.exr("nan.exr", 16, 16, f32::NAN);
    place.put("bad.exr", "no picture");
    place.put("picture.png", "no picture");
    fs::create_dir(place.path("folder.exr")).unwrap();
    place.refuses(&["compare", "a.exr"], &["B.exr"]);
    place.refuses(&["compare", "a.exr", "small.exr"], &["a.exr", "small.exr", "16"]);
    place.refuses(&["compare", "a.exr", "nan.exr"], &["nan.exr"]);
    for name in ["bad.exr", "picture.png", "gone.exr", "folder.exr"] {
        place.refuses(&["compare", "a.exr", name], &[name]);
        place.refuses(&["compare", name, "a.exr"], &[name]);
    }
    place.refuses(&["compare", "a.exr", "a.exr", "--json", "gone/a.json"], &["gone/a.json", "there is no folder"]);
    place.refuses(&["compare", "a.exr", "a.exr", "--json", "a.txt"], &["a.txt", "must end in .json"]);
    place.refuses(&["compare", "a.exr", "a.exr", "--map", "gone/a.png"], &["gone/a.png", "there is no folder"]);
    place.refuses(&["compare", "a.exr", "small.exr", "--json", "a.json", "--map", "a.png"], &["small.exr"]);
}

#[test]
fn demonstrations_and_measurements() {
    let place = Place::new();
    place.refuses(&["demo", "--out", "cube.obj"], &["cube.obj", "cannot be"]);
    place.refuses(&["demo", "--out", "cube.obj/in"], &["cube.obj/in", "cannot be"]);
    place.refuses(&["demo", "--size", "5"], &["--size"]);
    place.refuses(&["bench", "pbgi", "--json", "gone/a.json"], &["gone/a.json", "there is no folder"]);
    place.refuses(&["bench", "teapots"], &["'teapots'"]);
}

#[cfg(unix)]
#[test]
fn a_folder_that_may_not_be_written() {
    use std::os::unix::fs::PermissionsExt;
    let place = Place::new();
    let folder = place.path("locked");
    fs::create_dir(&folder).unwrap();
    fs::set_permissions(&folder, fs::Permissions::from_mode(0o555)).unwrap();
    // Root may write everywhere.
    if fs::write(folder.join("probe"), "").is_ok() {
        eprintln!("skipped: this user may write into a folder without write permission");
        return;
    }
    place.render_refuses("--out locked/out.exr", &["locked/out.exr", "cannot be written"]);
}

/// A disk that is full halfway is a limit on the size of files here.
#[cfg(unix)]
#[test]
fn a_disk_that_fills_up_leaves_no_half_file() {
    let place = Place::new();
    place.put("cloud.ply", ply(&points(2000, [0.0; 3], 2.0)));
    place.put("out.bsh", "an older file");
    let before = contents(place.0.path());
    let output = Command::new("sh")
        .current_dir(place.0.path())
        .args([
            "-c",
            "trap '' XFSZ; ulimit -f 4; exec \"$0\" build cloud.ply --out out.bsh",
            env!("CARGO_BIN_EXE_relume"),
        ])
        .output()
        .unwrap();
    assert!(refusal(&output).contains("out.bsh: cannot be written"), "{output:?}");
    assert_eq!(contents(place.0.path()), before);
}

/// A warning may come before the error that ends a run, on a line of its own; the last line is the error.
#[test]
fn a_warning_before_an_error() {
    let place = Place::new();
    let mut some = points(50, [0.0; 3], 2.0);
    some[7].0[1] = f64::NAN;
    place.put("cloud.ply", ply(&some));
    let output = place.run(&place.render("--camera-from 1,1,1 --camera-at 1,1,1"));
    let said = String::from_utf8(output.stderr).unwrap();
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!((output.status.code(), lines.len()), (Some(2), 2), "{said}");
    assert!(lines[0].contains("WARN") && lines[0].contains("dropped 1 of 50 points"), "{said}");
    assert!(lines[1].starts_with("relume: --camera-from"), "{said}");
    assert!(!said.contains('\u{1b}'), "colours in a file: {said:?}");
}

#[cfg(target_os = "linux")]
#[test]
fn nobody_listens() {
    let place = Place::new();
    let relume = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relume"));
        command.current_dir(place.0.path()).args(["build", "cloud.ply", "--out", "out.bsh"]);
        command
    };
    // A reader that goes away: the work is done all the same.
    let mut child = relume().stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    assert!(place.path("out.bsh").exists());
    // A full disk behind standard output is said.
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = relume().stdout(full()).output().unwrap();
    assert!(refusal(&output).contains("standard output"), "{output:?}");
    // And with nowhere to say anything, the exit code remains.
    let status = relume().arg("--nonsense").stdout(full()).stderr(full()).status().unwrap();
    assert_eq!(status.code(), Some(2));
}

#[test]
fn help_and_version() {
    let place = Place::new();
    for arguments in
        [&["--help"][..], &["help"], &["--version"], &["render", "--help"], &["build", "--help"], &["info", "-h"]]
    {
        let output = place.run(arguments);
        assert!(output.status.success() && output.stderr.is_empty() && !output.stdout.is_empty(), "{arguments:?}");
    }
}

#[test]
fn values_may_begin_with_a_minus_sign() {
    let place = Place::new();
    let plain = place.renders("--camera-from -1,0.5,3 --camera-at -0.1,0,0 --object-at -0.1,0,0 --object-turn -30");
    let joined = place.renders("--camera-from=-1,0.5,3 --camera-at=-0.1,0,0 --object-at=-0.1,0,0 --object-turn=330");
    assert_eq!(plain.len(), joined.len());
    assert!(plain.iter().zip(&joined).all(|(a, b)| a.abs_diff_eq(*b, 1e-3)), "-30 degrees are 330");
}

#[test]
fn few_points() {
    let place = Place::new();
    let one = ([0.0, 0.0, 2.0], [0.9, 0.5, 0.2]);
    let line: Vec<Point> = (0..100).map(|i| ([f64::from(i) * 0.01, 1.0, 0.0], one.1)).collect();
    let two = [one, ([1e11, 0.0, 0.0], one.1)];
    // Directly on the object's surface and in its middle.
    let touching = [([0.0, 0.5, 0.0], one.1), ([0.0; 3], one.1)];
    for (name, points) in
        [("one", &[one][..]), ("same", &[one; 300]), ("line", &line), ("two", &two), ("touching", &touching)]
    {
        place.put("cloud.ply", ply(points));
        for technique in ["classic", "mipmapped", "hybrid", "shared"] {
            eprintln!("{name}, {technique}");
            place.renders(&format!("--technique {technique}"));
        }
    }
}

#[test]
fn a_billion_metres_away() {
    let place = Place::new();
    let here = place.renders("--material diffuse:0.7");
    place.put("cloud.ply", ply(&points(200, [1e9, 1e9, -1e9], 2.0)));
    let there = place.renders("--material diffuse:0.7 --object-at 1e9,1e9,-1e9");
    let worst = here.iter().zip(&there).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f32::max);
    // The same points to within 0.1 micrometres, but in other cells of the Morton lattice.
    assert!(worst < 0.02, "off by {worst}");
    assert!(here.iter().any(|c| c.max_element() > 0.1), "nothing is lit");
    // The cloud there and the object here: light from a speck at the horizon.
    place.renders("");
}

#[test]
fn extremes() {
    let place = Place::new();
    place.renders("--size 1x1");
    place.renders("--fov 170 --camera-from 0,0,0.9 --camera-at 0,0,0");
    place.renders("--fov 0.1");
    // Straight down, where +Y gives no up.
    place.renders("--camera-from 0,3,0 --camera-at 0,0,0");
    // From inside the object, and at its surface.
    place.run(&place.render("--camera-from 0,0,0 --camera-at 0,0,1"));
    place.renders("--object-turn 1e300");
    let scaled: Vec<Point> = points(200, [0.0; 3], 2e-5);
    place.put("cloud.ply", ply(&scaled));
    place.renders("--object-scale 1e-5");
    let scaled: Vec<Point> = points(200, [0.0; 3], 2e8);
    place.put("cloud.ply", ply(&scaled));
    place.renders("--object-scale 1e8");
    let bright: Vec<Point> = points(200, [0.0; 3], 2.0).into_iter().map(|(p, _)| (p, [1e15, 0.0, 1e-30])).collect();
    place.put("cloud.ply", ply(&bright));
    place.renders("");
}
