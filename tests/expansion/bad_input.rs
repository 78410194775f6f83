//! What `relume expand` refuses: exit code 2, one line that says why, and a folder that is as it was. At the end what
//! sounds bad and must work.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};

use glam::{Vec3, Vec3Swizzles};
use relume::formats::cloud::{CloudOptions, load};
use relume::formats::image::{ExrLayers, read_photo, write_exr, write_png};
use tempfile::TempDir;

use super::Random;

/// A folder with `cloud.ply`, a room of four metres with a lamp, and `photo.exr`.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        let place = Self(TempDir::new().unwrap());
        place.cloud("cloud.ply", |p| if p.y > 1.9 && p.xz().length() < 0.8 { 255 } else { 90 });
        place.photo("photo.exr", 64, 48, |x, y| if x / 8 == 4 && y / 8 == 2 { 20.0 } else { 0.3 });
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn photo(&self, name: &str, width: u32, height: u32, value: impl Fn(u32, u32) -> f32) {
        let rgb: Vec<Vec3> = (0..width * height).map(|n| Vec3::splat(value(n % width, n / width))).collect();
        write_exr(&self.path(name), &ExrLayers { width, height, rgb: &rgb, alpha: None, groups: &[] }).unwrap();
    }

    /// Points on the inside of a cube, grey by their place, and in a small box of dark points around (1, 1, 1).
    fn cloud(&self, name: &str, grey: impl Fn(Vec3) -> u8) {
        let mut random = Random(6);
        let mut points = Vec::new();
        for n in 0..4000 {
            let (axis, side) = (n % 3, if n / 3 % 2 == 0 { 1.0 } else { -1.0 });
            let mut position = random.vector() * 2.0 - 1.0;
            position[axis] = side;
            let (position, is_box) = if n < 3000 { (2.0 * position, false) } else { (1.0 + 0.05 * position, true) };
            points.push((position, Vec3::AXES[axis] * -side, if is_box { grey(Vec3::ZERO) } else { grey(position) }));
        }
        let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", points.len());
        for name in ["x", "y", "z", "nx", "ny", "nz"] {
            writeln!(text, "property float {name}").unwrap();
        }
        text += "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
        for (p, n, grey) in points {
            writeln!(text, "{} {} {} {} {} {} {grey} {grey} {grey}", p.x, p.y, p.z, n.x, n.y, n.z).unwrap();
        }
        fs::write(self.path(name), text).unwrap();
    }

    fn contents(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let files = fs::read_dir(self.0.path()).unwrap().map(|entry| entry.unwrap().path());
        files.map(|path| (path.clone(), fs::read(&path).unwrap_or_default())).collect()
    }

    fn run(&self, arguments: &str) -> Output {
        let relume = env!("CARGO_BIN_EXE_relume");
        let arguments = ["expand", "-o", "out.ply", "--shot-size", "64"].into_iter().chain(arguments.split(' '));
        Command::new(relume).current_dir(self.0.path()).args(arguments).output().unwrap()
    }

    #[track_caller]
    fn refuses(&self, arguments: &str, parts: &[&str]) {
        let before = self.contents();
        let output = self.run(arguments);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
        assert!(output.stdout.is_empty(), "{arguments}: printed {:?}", String::from_utf8_lossy(&output.stdout));
        let line = said.strip_suffix('\n').unwrap();
        assert!(line.starts_with("relume: ") && !line.contains(char::is_control), "not one plain line: {said:?}");
        parts.iter().for_each(|part| assert!(line.contains(part), "{arguments}: {line:?} does not say {part:?}"));
        assert!(self.contents() == before, "{arguments}: the folder has changed; {line}");
    }

    /// Runs what must work; (standard output, standard error).
    #[track_caller]
    fn works(&self, arguments: &str) -> (String, String) {
        let output = self.run(arguments);
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        assert!(output.status.success(), "{arguments}: {}", text(&output.stderr));
        (text(&output.stdout), text(&output.stderr))
    }
}

#[test]
fn photos() {
    let place = Place::new();
    write_png(&place.path("photo.png"), 64, 48, &[200; 64 * 48 * 4]).unwrap();
    place.photo("tiny.exr", 5, 5, |x, _| x as f32);
    place.photo("low.exr", 64, 6, |_, _| 1.0);
    place.photo("black.exr", 64, 48, |_, _| 0.0);
    place.photo("nothing.exr", 64, 48, |_, _| f32::NAN);
    fs::write(place.path("text.exr"), "a photo").unwrap();
    place.refuses("cloud.ply --photo photo.png", &["photo.png: ", "HDR photo", ".exr or .hdr"]);
    place.refuses("cloud.ply --photo tiny.exr", &["tiny.exr: ", "5x5", "7x7"]);
    place.refuses("cloud.ply --photo low.exr", &["low.exr: ", "64x6", "7x7"]);
    place.refuses("cloud.ply --photo tiny.exr --strategy landis-points", &["tiny.exr: ", "5x5"]);
    place.refuses("cloud.ply --photo black.exr", &["black.exr: ", "black"]);
    place.refuses("cloud.ply --photo black.exr --strategy landis", &["black.exr: ", "black"]);
    place.refuses("cloud.ply --photo text.exr", &["text.exr: "]);
    place.refuses("cloud.ply --photo missing.exr", &["missing.exr: "]);
    place.refuses("cloud.ply --strategy patchmatch", &["patchmatch needs an HDR photo"]);
    // A warning goes before, so it is not one line.
    let output = place.run("cloud.ply --photo nothing.exr");
    assert_eq!(output.status.code(), Some(2));
    assert!(!place.path("out.ply").exists());
}

#[test]
fn clouds() {
    let place = Place::new();
    place.cloud("white.ply", |_| 255);
    place.refuses("white.ply --photo photo.exr", &["white.ply: ", "all 4000 points are over-exposed", "0.9"]);
    place.refuses("white.ply --strategy landis-points", &["white.ply: ", "over-exposed"]);
    place.refuses("missing.ply --photo photo.exr", &["missing.ply: "]);
}

#[test]
fn shots() {
    let place = Place::new();
    // Inside of the small box.
    let line = &["sees any of the", "over-exposed points", "inside of something"];
    place.refuses("cloud.ply --strategy landis --shots 1,1,1", line);
    place.refuses("cloud.ply --strategy network --shots 1,1,1;1,1.01,1", line);
    for wrong in ["nonsense", "1,2", "1,2,x", "1,2,3;", "auto:0", "auto:65", "auto:x", "auto:", "nan,0,0", ""] {
        place.refuses(&format!("cloud.ply --photo photo.exr --shots {wrong}"), &["--shots", wrong]);
    }
    fs::write(place.path("places.txt"), "0,0,0\n# a remark\nhere\n").unwrap();
    place.refuses("cloud.ply --photo photo.exr --shots places.txt", &["places.txt: ", "here"]);
    fs::write(place.path("places.txt"), "# nothing\n").unwrap();
    place.refuses("cloud.ply --photo photo.exr --shots places.txt", &["places.txt", "0 places"]);
}

#[test]
fn models() {
    let place = Place::new();
    fs::write(place.path("gray.onnx"), onnx(1)).unwrap();
    fs::write(place.path("color.onnx"), onnx(3)).unwrap();
    fs::write(place.path("text.onnx"), "a network").unwrap();
    let network = "cloud.ply --strategy network";
    place.refuses(&format!("{network} --model gray.onnx"), &["gray.onnx: ", "1x1x", "1x3xHxW"]);
    place.refuses(&format!("{network} --model text.onnx"), &["text.onnx: ", "ONNX"]);
    place.refuses(&format!("{network} --model missing.onnx"), &["missing.onnx: "]);
    place.refuses("cloud.ply --photo photo.exr --model color.onnx", &["--model", "network", "patchmatch"]);
    place.refuses("cloud.ply --strategy landis --model color.onnx", &["--model", "network", "landis"]);
    // One that changes nothing fits.
    place.works(&format!("{network} --model color.onnx"));
}

/// A network whose output is its input, of that many channels: protocol buffers, field numbers as in onnx.proto.
fn onnx(channels: u8) -> Vec<u8> {
    let bytes = |field: u8, content: &[u8]| [&[field << 3 | 2, content.len() as u8], content].concat();
    let number = |field: u8, value: u8| vec![field << 3, value];
    let open = |name: &str| bytes(1, &bytes(2, name.as_bytes()));
    let dims = [bytes(1, &number(1, 1)), bytes(1, &number(1, channels)), open("height"), open("width")].concat();
    let tensor = [number(1, 1), bytes(2, &dims)].concat();
    let value = |name: &str| [bytes(1, name.as_bytes()), bytes(2, &bytes(1, &tensor))].concat();
    let node = [bytes(1, b"in"), bytes(2, b"out"), bytes(4, b"Identity")].concat();
    let graph = [bytes(1, &node), bytes(2, b"graph"), bytes(11, &value("in")), bytes(12, &value("out"))].concat();
    [number(1, 8), bytes(7, &graph), bytes(8, &number(2, 13))].concat()
}

#[test]
fn pixels_that_are_no_numbers_are_black() {
    let place = Place::new();
    let lamp = |x: u32, y: u32| if x / 8 == 4 && y / 8 == 2 { 20.0 } else { 0.3 };
    place.photo("nan.exr", 64, 48, |x, y| if y == 40 && x < 5 { f32::NAN } else { lamp(x, y) });
    let (_, said) = place.works("cloud.ply --photo nan.exr");
    assert!(said.contains("nan.exr: 5 pixels are not finite: taken as black"), "{said}");
    let cloud = load(&place.path("out.ply"), &CloudOptions::default()).unwrap();
    assert!(cloud.colors.iter().all(|color| color.is_finite()));
    place.photo("zero.exr", 64, 48, |x, y| if y == 40 && x < 5 { 0.0 } else { lamp(x, y) });
    assert_eq!(read_photo(&place.path("nan.exr")).unwrap(), read_photo(&place.path("zero.exr")).unwrap());
}

#[test]
fn a_cloud_with_nothing_over_exposed_is_copied() {
    let place = Place::new();
    place.cloud("dim.ply", |p| (100.0 + 20.0 * p.x) as u8);
    for arguments in ["dim.ply --photo photo.exr", "dim.ply", "dim.ply --strategy landis-points"] {
        let (said, _) = place.works(arguments);
        assert!(said.contains("no point of 4000 is over-exposed") && said.contains("copied"), "{said}");
        let load = |name: &str| load(&place.path(name), &CloudOptions::default()).unwrap();
        let (before, after) = (load("dim.ply"), load("out.ply"));
        assert_eq!((&before.positions, &before.normals), (&after.positions, &after.normals));
        for (a, b) in before.colors.iter().zip(&after.colors) {
            assert!(a.abs_diff_eq(*b, 1e-6), "{a} {b}");
        }
        fs::remove_file(place.path("out.ply")).unwrap();
    }
}

#[test]
fn shots_from_far_away() {
    let place = Place::new();
    // The whole room is one pixel from there; whatever comes of it is finite.
    let output = place.run("cloud.ply --strategy landis --shots 1000,0,0");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    match output.status.code() {
        Some(0) => {
            let cloud = load(&place.path("out.ply"), &CloudOptions::default()).unwrap();
            assert!(cloud.colors.iter().all(|color| color.is_finite() && color.max_element() < 20.0));
        }
        code => assert!(code == Some(2) && said.contains("over-exposed points"), "{said}"),
    }
}
