//! `render --probes`, `project` and `transfer` as a person runs them.

mod common;

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use common::commands::{refused, succeeds};
use glam::Vec3;
use relume::formats::image::{ExrImage, ExrLayers, read_rgba_exr, write_exr};
use tempfile::TempDir;

/// A place with two probes, and an object.
struct Place {
    folder: TempDir,
}

impl Place {
    fn new() -> Self {
        let place = Self { folder: TempDir::new().expect("a folder") };
        write_probe(&place.path("day.exr"), |u, v| Vec3::new(1.0 + (std::f32::consts::TAU * u).cos(), 0.5, 1.0 - v));
        write_probe(&place.path("night.exr"), |u, v| {
            if (u - 0.2).hypot(v - 0.3) < 0.1 { Vec3::splat(20.0) } else { Vec3::ZERO }
        });
        // A table: a top over a foot, so that something is in shadow.
        let quad = |y: f32, half: f32| {
            format!("v {half} {y} {half}\nv {half} {y} -{half}\nv -{half} {y} -{half}\nv -{half} {y} {half}\n")
        };
        let text = quad(0.5, 1.0) + &quad(0.0, 0.9) + "f 1 2 3\nf 1 3 4\nf 5 6 7\nf 5 7 8\n";
        std::fs::write(place.path("table.obj"), text).expect("an object");
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    /// Arguments of a rendering of the table by probes.
    fn render(&self, probes: &str, out: &str, more: &[&str]) -> Vec<String> {
        let (probes, object, out) = (self.text(probes), self.text("table.obj"), self.text(out));
        let own = ["render", "--technique", "probes", "--probes", &probes, "--object", &object, "--size", "96x64"];
        let tail = ["--camera-from", "0,1,4", "--camera-at", "0,0.2,0", "--out", &out];
        own.into_iter().chain(tail).chain(more.iter().copied()).map(str::to_owned).collect()
    }
}

fn strings(arguments: &[String]) -> Vec<&str> {
    arguments.iter().map(String::as_str).collect()
}

fn write_probe(path: &Path, radiance: impl Fn(f32, f32) -> Vec3) {
    let (width, height) = (128_u32, 64_u32);
    let texel = |i: u32| radiance((i % width) as f32 / width as f32, ((i / width) as f32 + 0.5) / height as f32);
    let rgb: Vec<Vec3> = (0..width * height).map(texel).collect();
    write_exr(path, &ExrLayers { width, height, rgb: &rgb, alpha: None, groups: &[] }).expect("an EXR");
}

fn read(path: &Path) -> ExrImage {
    read_rgba_exr(path).unwrap_or_else(|error| panic!("{error}"))
}

fn mean(image: &ExrImage) -> Vec3 {
    let covered: f32 = image.alpha.iter().sum();
    image.rgb.iter().zip(&image.alpha).map(|(c, a)| *c * *a).sum::<Vec3>() / covered.max(1.0)
}

#[test]
fn project_prints_the_coefficients_of_its_json() {
    let place = Place::new();
    let (probe, json) = (place.text("day.exr"), place.text("c.json"));
    let printed = succeeds(&["project", "--probe", &probe, "--order", "3", "--json", &json]);
    let text = std::fs::read_to_string(&json).expect("written");
    let report: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let list = report["coefficients"].as_array().expect("a list");
    assert_eq!(list.len(), 9);
    assert_eq!(printed.lines().count(), 10);
    // Green is 0.5 everywhere.
    let expected = 0.5 * (4.0 * std::f64::consts::PI).sqrt();
    assert!((list[0]["rgb"][1].as_f64().expect("a number") - expected).abs() < 1e-3);
    assert!(printed.lines().nth(1).is_some_and(|line| line.contains(&format!("{expected:.3}"))), "{printed}");
    let windowed = succeeds(&["project", "--probe", &probe, "--order", "3", "--window", "hanning"]);
    assert_ne!(windowed, printed);
    refused(&["project", "--probe", &probe, "--order", "6"], "order");
    refused(&["project", "--probe", &place.text("none.exr")], "none.exr");
}

#[test]
fn a_transfer_is_made_once_and_shadows_what_it_should() {
    let place = Place::new();
    let prt = place.text("table.prt");
    let object = place.text("table.obj");
    succeeds(&["transfer", "--object", &object, "--samples", "400", "-o", &prt]);
    let made = std::fs::metadata(&prt).and_then(|data| data.modified()).expect("a time");
    let bytes = std::fs::read(&prt).expect("a transfer");
    succeeds(&strings(&place.render("day.exr", "with.exr", &["--samples", "400", "--validation"])));
    let after = std::fs::metadata(&prt).and_then(|data| data.modified()).expect("a time");
    assert_eq!(after, made, "it is read, not made again");
    // Another number of directions is another transfer.
    succeeds(&strings(&place.render("day.exr", "more.exr", &["--samples", "900"])));
    assert_ne!(std::fs::read(&prt).expect("a transfer"), bytes);
    succeeds(&strings(&place.render("day.exr", "without.exr", &["--transfer", "none"])));
    let [with, without] = ["with.exr", "without.exr"].map(|name| mean(&read(&place.path(name))));
    assert!(with.y < 0.95 * without.y, "the top shadows the foot: {with} and {without}");
    // What is no transfer is not overwritten.
    std::fs::write(place.path("notes.prt"), "mine").expect("a file");
    let notes = place.text("notes.prt");
    refused(&strings(&place.render("day.exr", "x.exr", &["--transfer", &notes])), "notes.prt");
    assert_eq!(std::fs::read(place.path("notes.prt")).expect("a file"), b"mine");
}

#[test]
fn light_turns_and_fades_over_a_sequence() {
    let place = Place::new();
    let fade = place.text("night.exr");
    let more = ["--frames", "0..4", "--turn", "90", "--rate", "2", "--cross-fade", &fade, "--transfer", "none"];
    succeeds(&strings(&place.render("day.exr", "f.###.exr", &more)));
    let frames: Vec<Vec3> = (0..5).map(|n| mean(&read(&place.path(&format!("f.{n:03}.exr"))))).collect();
    assert!(frames.windows(2).all(|pair| pair[0] != pair[1]));
    // Green is the same all around by day, and fades evenly to what the night has.
    let middle = 0.5 * (frames[0].y + frames[4].y);
    assert!((frames[2].y - middle).abs() < 0.1 * (frames[0].y - frames[4].y).abs(), "{frames:?}");
    // A turned panorama is the same as the first frame's by a quarter of its columns.
    let turned: Vec<String> =
        place.render("day.exr", "t.png", &["--frames", "1", "--turn", "360", "--rate", "1", "--transfer", "none"]);
    succeeds(&strings(&turned));
    let plain = place.render("day.exr", "p.png", &["--transfer", "none"]);
    succeeds(&strings(&plain));
    assert_eq!(std::fs::read(place.path("t.png")).expect("a PNG"), std::fs::read(place.path("p.png")).expect("a PNG"));
}

/// Frames 0 to 59 of a sequence; the temporal filter makes each depend on all before it.
fn long(place: &Place, out: &str) -> Vec<String> {
    let fade = place.text("night.exr");
    let more = ["--frames", "0..59", "--turn", "30", "--cross-fade", &fade, "--temporal", "0.5", "--samples", "100"];
    place.render("day.exr", out, &more)
}

#[test]
fn a_sequence_that_was_killed_goes_on_where_it_stopped() {
    let place = Place::new();
    succeeds(&strings(&long(&place, "whole.####.exr")));
    let arguments = long(&place, "cut.####.exr");
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_relume"))
        .args(&arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("relume runs");
    let start = Instant::now();
    while !place.path("cut.0007.exr").exists() && start.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().expect("it runs still");
    child.wait().expect("it ends");
    let there: Vec<u32> = (0..60).filter(|n| place.path(&format!("cut.{n:04}.exr")).exists()).collect();
    assert!((8..60).contains(&there.len()), "{there:?}");
    // None of them is cut short.
    there.iter().for_each(|n| drop(read(&place.path(&format!("cut.{n:04}.exr")))));
    let first = std::fs::metadata(place.path("cut.0000.exr")).and_then(|data| data.modified()).expect("a time");
    let said = succeeds(&strings(&arguments));
    let again = std::fs::metadata(place.path("cut.0000.exr")).and_then(|data| data.modified()).expect("a time");
    assert_eq!(first, again, "frames that are there are kept");
    let new = 60 - there.len();
    assert!((new - 1..=new + 1).any(|n| said.contains(&format!("{n} of them new"))), "{said}");
    for number in 0..60 {
        let [whole, cut] = ["whole", "cut"].map(|name| read(&place.path(&format!("{name}.{number:04}.exr"))));
        assert!(whole.rgb == cut.rgb, "frame {number}");
    }
    let left: Vec<String> = std::fs::read_dir(place.folder.path())
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with('.'))
        .collect();
    assert!(left.is_empty(), "{left:?}");
    // Another command's frames are not taken for its own.
    let other = long(&place, "cut.####.exr").into_iter().map(|a| if a == "0.5" { "0".into() } else { a });
    let said = succeeds(&strings(&other.collect::<Vec<_>>()));
    assert!(said.contains("60 of them new"), "{said}");
}

#[cfg(target_os = "linux")]
#[test]
fn memory_is_flat_once_the_ring_is_full() {
    let place = Place::new();
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_relume"))
        .args(long(&place, "f.####.exr"))
        .stdout(Stdio::null())
        .spawn()
        .expect("relume runs");
    // Pages in memory, by the last frame that was there.
    let mut pages = vec![0_u64; 61];
    while child.try_wait().expect("it can be asked").is_none() {
        let frame = (0..60).take_while(|n| place.path(&format!("f.{n:04}.exr")).exists()).count();
        let text = std::fs::read_to_string(format!("/proc/{}/statm", child.id())).unwrap_or_default();
        let resident = text.split(' ').nth(1).and_then(|pages| pages.parse().ok()).unwrap_or(0);
        pages[frame] = pages[frame].max(resident);
        std::thread::sleep(Duration::from_millis(1));
    }
    let most = |from: usize, to: usize| pages[from..to].iter().copied().max().unwrap_or(0);
    let (early, late) = (most(8, 20), most(40, 60));
    assert!(early > 0 && late > 0, "{pages:?}");
    // 40 panoramas would be 1,000 pages.
    assert!(late < early + 500, "from {early} to {late} pages of memory");
}

#[test]
fn damaged_and_missing_frames_are_left_out_with_a_line() {
    let place = Place::new();
    for n in [0, 1, 2, 4] {
        std::fs::copy(place.path("day.exr"), place.path(&format!("p.{n}.exr"))).expect("a copy");
    }
    let bytes = std::fs::read(place.path("p.1.exr")).expect("a probe");
    std::fs::write(place.path("p.1.exr"), &bytes[..bytes.len() / 2]).expect("cut short");
    let said = succeeds(&strings(&place.render("p.#.exr", "f.#.exr", &["--transfer", "none"])));
    assert!(said.contains("p.1.exr") && said.contains("frame 3"), "{said}");
    let there: Vec<u32> = (0..5).filter(|n| place.path(&format!("f.{n}.exr")).exists()).collect();
    assert_eq!(there, [0, 2, 4]);
    // Of a single frame that is damaged there is no picture.
    refused(&strings(&place.render("p.#.exr", "one.exr", &["--frames", "1", "--transfer", "none"])), "p.1.exr");
    assert!(!place.path("one.exr").exists());
}

#[test]
fn what_does_not_go_together_is_refused() {
    let place = Place::new();
    let render = |out: &str, more: &[&str]| place.render("day.exr", out, more);
    refused(&strings(&render("f.exr", &["--frames", "0..3"])), "####");
    refused(&strings(&render("f.#.exr", &[])), "--frames");
    refused(&strings(&render("f.#.#.exr", &["--frames", "0..3"])), "two runs");
    refused(&strings(&render("f.exr", &["--frames", "3..1"])), "3..1");
    refused(&strings(&render("f.exr", &["--order", "0"])), "order");
    refused(&strings(&render("f.exr", &["--temporal", "-1"])), "-1");
    refused(&strings(&render("f.exr", &["--turn", "nan"])), "nan");
    refused(&strings(&render("f.exr", &["--reflection", "mirror:3"])), "mirror:3");
    refused(&strings(&render("f.exr", &["--mapping", "cube"])), "cube");
    refused(&strings(&render("f.exr", &["--backdrop", "points"])), "--cloud");
    refused(&strings(&place.render("gone.####.exr", "f.exr", &[])), "gone.####.exr");
    let object = place.text("table.obj");
    let out = place.text("f.exr");
    refused(&["render", "--object", &object, "--out", &out], "--probes");
    refused(&["render", "--technique", "hybrid", "--object", &object, "--out", &out], "--cloud");
    assert!(!place.path("f.exr").exists());
}
