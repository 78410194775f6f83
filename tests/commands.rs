//! `compare` and `demo` as a person runs them.

use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use glam::Vec3;
use relume::compare::{Image, compare};
use relume::formats::image::{ExrLayers, read_rgba_exr, write_exr};
use tempfile::TempDir;

const SIDE: u32 = 24;

fn relume(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_relume")).args(arguments).output().expect("relume runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// One line that holds `expected`, and exit code 2.
fn refused(arguments: &[&str], expected: &str) {
    let output = relume(arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert!(message.contains(expected), "{arguments:?}: {message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{arguments:?}: {message}");
}

/// A ramp times `factor`; transparent in its left third, where it is much brighter.
fn write_ramp(path: &Path, side: u32, factor: f32) {
    let masked = |n: u32| n % side < side / 3;
    let value = |n: u32| {
        let ramp = 0.1 + (n % side) as f32 / side as f32 + 0.3 * (n / side) as f32 / side as f32;
        Vec3::new(ramp, 0.5 * ramp, 0.2) * factor + if masked(n) { 100.0 * factor * factor } else { 0.0 }
    };
    let rgb: Vec<Vec3> = (0..side * side).map(value).collect();
    let alpha: Vec<f32> = (0..side * side).map(|n| f32::from(u8::from(!masked(n)))).collect();
    let layers = ExrLayers { width: side, height: side, rgb: &rgb, alpha: Some(&alpha), groups: &[] };
    write_exr(path, &layers).expect("an EXR");
}

fn read(path: &Path) -> Image {
    let read = read_rgba_exr(path).expect("an EXR");
    Image::new(read.width, read.height, read.rgb, read.alpha).expect("an image")
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).expect("a file")).expect("JSON")
}

#[test]
fn compare_prints_the_numbers_of_the_json() {
    let folder = TempDir::new().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let (a, b, report, map) = (path("a.exr"), path("b.exr"), path("r.json"), path("map.png"));
    write_ramp(&a, SIDE, 1.1);
    write_ramp(&b, SIDE, 1.0);
    let [a_text, b_text, report_text, map_text] =
        [&a, &b, &report, &map].map(|path| path.to_str().expect("UTF-8").to_owned());
    let output = relume(&["compare", &a_text, &b_text, "--json", &report_text, "--map", &map_text]);
    assert!(output.status.success(), "{}", text(&output.stderr));

    let (table, report) = (text(&output.stdout), json(&report));
    let metrics = compare(&read(&a), &read(&b)).expect("metrics");
    let number = |name: &str| report[name].as_f64().expect(name);
    assert!((number("bias") - 0.1).abs() < 1e-5, "ten percent brighter inside of the mask: {}", number("bias"));
    // Parsing a number may round its last digit.
    for (name, value) in [
        ("relative_rms_luminance", metrics.relative_rms_luminance),
        ("rgb_rms", metrics.rgb_rms),
        ("ssim", metrics.ssim),
        ("flip", metrics.flip),
    ] {
        assert!((number(name) - value).abs() < 1e-12, "{name}: {} and {value}", number(name));
    }
    assert_eq!(report["pixels"].as_u64(), Some(u64::from(SIDE * (SIDE - SIDE / 3))));
    for name in ["relative_rms_luminance", "rgb_rms", "bias", "ssim", "flip", "pixels"] {
        let line = table.lines().find(|line| line.starts_with(name)).expect(name);
        let shown: f64 = line.split_whitespace().nth(1).and_then(|word| word.parse().ok()).expect(name);
        assert!((shown - number(name)).abs() <= 1e-5, "{line}: {}", number(name));
    }
    let map = image::open(&map).expect("a map").into_rgba8();
    assert!(map.width() > SIDE && map.height() >= SIDE);
    // All brighter: red where masked in, ground elsewhere.
    let [inside, outside] = [map.get_pixel(SIDE - 1, 3), map.get_pixel(1, 3)];
    assert!(inside[0] > inside[2] + 20 && outside[0].abs_diff(outside[2]) < 4, "{inside:?} {outside:?}");
}

#[test]
fn compare_refuses_what_it_cannot_do_and_leaves_nothing() {
    let folder = TempDir::new().expect("a folder");
    let path = |name: &str| folder.path().join(name).to_str().expect("UTF-8").to_owned();
    let (a, small, text_file) = (path("a.exr"), path("small.exr"), path("text.exr"));
    write_ramp(Path::new(&a), SIDE, 1.0);
    write_ramp(Path::new(&small), 6, 1.0);
    std::fs::write(&text_file, "no image").expect("a file");
    let report = path("r.json");
    refused(&["compare", &a, &small, "--json", &report], "differ in size");
    refused(&["compare", &a, &text_file, "--json", &report], "text.exr");
    refused(&["compare", &path("none.exr"), &a], "none.exr");
    refused(&["compare", &a, &a, "--map", &path("map.jpg")], "map.jpg");
    refused(&["compare", &a, &a, "--json", &path("no/r.json")], "no folder");
    refused(&["compare", &a], "B.exr");
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 3, "nothing but the inputs");
}

#[test]
fn demo_leaves_all_pictures() {
    let folder = TempDir::new().expect("a folder");
    let out = folder.path().join("new").join("folder");
    let output = relume(&["demo", "--out", out.to_str().expect("UTF-8"), "--size", "64"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    let names: Vec<String> = std::fs::read_dir(&out)
        .expect("the folder was made")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    let mut expected = vec!["backdrop.exr", "backdrop.png", "classic-half.exr", "classic-half.png", "contact.png"];
    if names.iter().any(|name| name == "hybrid-file.exr") {
        expected.extend(["hybrid-file.png", "hybrid-half.exr", "mipmapped-half.png", "hybrid-metal-truth.exr"]);
        expected.extend(["hybrid-diffuse-error.png", "paper-metal-error.png", "paper-diffuse.exr"]);
        assert_eq!(said.matches("equal to the byte").count(), 2, "{said}");
    }
    for name in expected {
        assert!(names.iter().any(|n| n == name), "{name} among {names:?}");
    }
    for name in &names {
        assert!(!name.starts_with('.'), "{name} is a left-over");
        let path = out.join(name);
        if name.ends_with(".png") {
            let picture = image::open(&path).expect(name).into_rgba8();
            assert!(picture.pixels().any(|p| p != picture.get_pixel(0, 0)), "{name} is empty");
            assert!(said.contains(name.trim_end_matches(".png")), "{name} is not mentioned in\n{said}");
        }
    }
    // The object is there and lit, and the truth is near it.
    let lit =
        read(&out.join(names.iter().find(|n| n.ends_with("-diffuse.exr") && !n.starts_with("paper")).expect("a name")));
    let truth = read(
        &out.join(names.iter().find(|n| n.ends_with("-diffuse-truth.exr") && !n.starts_with("paper")).expect("a name")),
    );
    let metrics = compare(&lit, &truth).expect("metrics");
    assert!(metrics.pixels > 100 && metrics.relative_rms_luminance < 0.15, "{metrics:?}");
}

#[test]
fn demo_refuses_a_folder_that_it_cannot_make() {
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("file");
    std::fs::write(&file, "").expect("a file");
    refused(&["demo", "--out", file.join("below").to_str().expect("UTF-8")], "below");
    refused(&["demo", "--out", file.to_str().expect("UTF-8")], "file");
    refused(&["demo", "--size", "0"], "--size");
}

#[test]
fn bench_checks_its_outputs_before_it_works() {
    refused(&["bench", "pbgi", "--json", "numbers.txt"], ".json");
    refused(&["bench", "microbuffers", "--plot", "no/plot.svg"], "no folder");
}
