//! `render --lamp` as a person runs it.

mod common;

use std::path::{Path, PathBuf};

use common::commands::{refused, succeeds};
use relume::formats::image::read_rgba_exr;
use relume::reference::path_tracer::PathTracer;
use relume::reference::rooms::cornell_box;
use tempfile::TempDir;

const SPOT: &str = "spot at=0,1.9,0.4 to=0.1,0,-0.2 power=40 angle=80";
const CAMERA: [&str; 6] = ["--camera-from", "0,1,3.7", "--camera-at", "0,1,0", "--size", "96x72"];

/// A box as a scan without normals, a cube, and clouds that are hardly any.
struct Place {
    folder: TempDir,
}

impl Place {
    fn new() -> Self {
        let place = Self { folder: TempDir::new().expect("a folder") };
        let cloud = PathTracer::new(cornell_box()).expect("a room").albedo_cloud(30_000, 1);
        let line = |k: usize| {
            let [r, g, b] = (cloud.colors[k] * 255.0).to_array().map(|c| c as u8);
            let p = cloud.positions[k];
            format!("{} {} {} {r} {g} {b}\n", p.x, p.y, p.z)
        };
        write_cloud(&place.path("box.ply"), (0..cloud.len()).map(line));
        write_cloud(&place.path("one.ply"), ["0 0 0 200 200 200\n".to_owned()].into_iter());
        let side =
            |x: i32| (0..30).map(move |y| format!("{} {} 0 200 200 200\n", 0.1 * f64::from(x), 0.1 * f64::from(y)));
        write_cloud(&place.path("few.ply"), (0..3).flat_map(side));
        let corner = |k: u32| {
            let axis = |bit: u32| if k >> bit & 1 == 1 { 0.15 } else { -0.15 };
            format!("v {} {} {}\n", axis(0), axis(1), axis(2))
        };
        let cube: String = (0..8).map(corner).collect();
        let faces =
            ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"].map(|f| format!("f {f}\n")).concat();
        std::fs::write(place.path("cube.obj"), cube + &faces).expect("an object");
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    /// The scan alone.
    fn alone(&self, cloud: &str, out: &str, more: &[&str]) -> Vec<String> {
        let fixed = ["render", "--technique", "lamps", "--cloud", &self.text(cloud), "--out", &self.text(out)];
        fixed.iter().chain(&CAMERA).chain(more).map(ToString::to_string).collect()
    }

    /// The cube in it.
    fn with_cube(&self, out: &str, more: &[&str]) -> Vec<String> {
        let (cloud, object) = (self.text("box.ply"), self.text("cube.obj"));
        let fixed =
            ["render", "--cloud", &cloud, "--object", &object, "--object-at", "0,1.2,0.2", "--out", &self.text(out)];
        fixed.iter().chain(&CAMERA).chain(more).map(ToString::to_string).collect()
    }
}

fn write_cloud(path: &Path, lines: impl Iterator<Item = String>) {
    let lines: Vec<String> = lines.collect();
    let head = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        lines.len()
    );
    std::fs::write(path, head + &lines.concat()).expect("a cloud");
}

fn strings(arguments: &[String]) -> Vec<&str> {
    arguments.iter().map(String::as_str).collect()
}

/// Sum of all channels; none is NaN or infinite.
fn brightness(path: &Path) -> f64 {
    let image = read_rgba_exr(path).expect("an image");
    assert!(image.rgb.iter().all(|color| color.is_finite()), "{} has no number", path.display());
    image.rgb.iter().map(|color| f64::from(color.element_sum())).sum()
}

#[test]
fn a_scan_alone_is_lit_and_bounces_add_light() {
    let place = Place::new();
    let mut last = 0.0;
    for bounces in ["0", "1", "3"] {
        let more = ["--lamp", SPOT, "--bounces", bounces, "--vpls", "64", "--towards", "0,1,0", "--validation"];
        let said = succeeds(&strings(&place.alone("box.ply", "lit.exr", &more)));
        assert!(said.contains("lit by 1 lamp"), "{said}");
        let value = brightness(&place.path("lit.exr"));
        assert!(value > 1.02 * last, "{value} with {bounces} bounces after {last}");
        last = value;
    }
    // What reflects half of the light, or all red things of it, is between.
    let all = ["--lamp", SPOT, "--bounces", "3", "--vpls", "64", "--towards", "0,1,0"];
    let with = |more: &[&str]| {
        succeeds(&strings(&place.alone("box.ply", "lit.exr", &[&all[..], more].concat())));
        brightness(&place.path("lit.exr"))
    };
    let half = with(&["--surfaces", "diffuse=0.5"]);
    let red = with(&["--brush", "from=0.3,0,0 to=1,0.2,0.2 diffuse=0 specular=0.3 shininess=20"]);
    let [dim, grey] = ["constant:0.1", "constant:0.5"].map(|from| with(&["--albedo-from", from]));
    assert!(half < 0.5 * last && red < 0.98 * last && red > half, "{half}, {red} and {last}");
    // Light that is reflected twice or more grows with the square of the albedo, and more.
    assert!(grey > 5.1 * dim && grey < 10.0 * dim, "{grey} and {dim}");
    let (stats, lamp) = (place.text("s.json"), ["--lamp", SPOT, "--lamp", "point at=0,1,0.5 power=3 color=0,0,1"]);
    let more =
        [&lamp[..], &["--stats", &stats, "--scan-light", "0.5", "--interleave", "4", "--ism-size", "16"]].concat();
    succeeds(&strings(&place.alone("box.ply", "lit.png", &more)));
    let text = std::fs::read_to_string(&stats).expect("stats");
    let report: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!((&report["technique"], &report["interleave"]), (&"lamps".into(), &4.into()));
    assert!(report["lamps"].as_array().is_some_and(|lamps| lamps.len() == 2));
    assert!(report["passes"]["gather lights"]["runs"].as_u64() == Some(2), "{text}");
}

#[test]
fn an_object_and_the_scan_behind_it_take_part_in_the_light() {
    let place = Place::new();
    // The object alone, and what is around it.
    let render = |out: &str, more: &[&str]| {
        succeeds(&strings(&place.with_cube(out, more)));
        let object = brightness(&place.path(out));
        succeeds(&strings(&place.with_cube(out, &[more, &["--backdrop", "points"]].concat())));
        (object, brightness(&place.path(out)) - object)
    };
    let dark = render("dark.exr", &["--lamp", "point at=0,50,0 power=1e-6", "--scan-light", "0"]);
    let own = render("own.exr", &[]);
    let lamp = render("lamp.exr", &["--lamp", SPOT, "--scan-light", "0"]);
    let both = render("both.exr", &["--lamp", SPOT]);
    assert!(dark.0 < 1e-3 * own.0 && dark.1 < 1e-3 * own.1, "{dark:?} of {own:?}");
    assert!(lamp.0 > 0.05 * own.0 && lamp.1 > 0.05 * own.1, "{lamp:?}");
    // Light adds up; the technique is not quite linear in it.
    for (sum, parts) in [(both.0, own.0 + lamp.0), (both.1, own.1 + lamp.1)] {
        assert!((sum / parts - 1.0).abs() < 0.03, "{sum} instead of {parts}");
    }
}

#[test]
fn odd_input_gives_clear_pictures_or_clear_lines() {
    let place = Place::new();
    // Within a block, before nothing, a point that no normal is known of, hardly any points, more lights than points: no
    // NaN, and a word where it is dark.
    for (cloud, lamp, vpls, dark) in [
        ("box.ply", "point at=-0.34,0.5,-0.36 power=5", "64", false),
        ("box.ply", "spot at=0,1,5 to=0,1,9 power=5 angle=40", "64", true),
        ("one.ply", "spot at=0,1,3 to=0,0,0 power=5 angle=60", "256", true),
        ("few.ply", "spot at=0.1,1,3 to=0.1,1,0 power=5 angle=80", "4096", false),
        ("few.ply", "sun direction=0,0,-1 power=1e9", "16", false),
    ] {
        let more = ["--lamp", lamp, "--vpls", vpls, "--validation"];
        let said = succeeds(&strings(&place.alone(cloud, "odd.exr", &more)));
        assert!(brightness(&place.path("odd.exr")) >= 0.0);
        assert_eq!(said.contains("no light of the lamps"), dark, "{cloud}, {lamp}: {said}");
    }
    let alone = |more: &[&str]| place.alone("box.ply", "no.exr", more);
    let spot = "spot at=0,1,0 to=0,0,0 power=1";
    for (arguments, expected) in [
        (alone(&[]), "technique lamps needs --lamp"),
        (alone(&["--lamp", &format!("{spot} angle=0")]), "0.1 to 170"),
        (alone(&["--lamp", &format!("{spot} angle=180")]), "0.1 to 170"),
        (alone(&["--lamp", "point at=0,0,0 power=0"]), "power of 0"),
        (alone(&["--lamp", "lantern"]), "begins with spot, point or sun"),
        (alone(&["--lamp", SPOT, "--vpls", "100"]), "multiple of 16"),
        (alone(&["--lamp", SPOT, "--bounces", "9"]), "at most 8"),
        (alone(&["--lamp", SPOT, "--interleave", "3"]), "1, 2 or 4"),
        (alone(&["--lamp", SPOT, "--ism-size", "33"]), "power of two"),
        (alone(&["--lamp", SPOT, "--vpls", "16384", "--ism-size", "256", "--memory-budget", "64"]), "MiB"),
        (alone(&["--lamp", SPOT, "--backdrop", "points"]), "the scan alone"),
        (alone(&["--lamp", SPOT, "--object", &place.text("cube.obj")]), "without --object"),
        (alone(&[&["--lamp", SPOT][..]; 65].concat()), "65 views"),
        (alone(&["--lamp", SPOT, "--albedo-from", "light"]), "colour or constant:V"),
        (alone(&["--lamp", SPOT, "--brush", "from=0,0,0"]), "needs from"),
        (alone(&["--lamp", SPOT, "--surfaces", "specular=0.5"]), "more light"),
        (place.with_cube("no.exr", &["--vpls", "64"]), "need --lamp"),
        (place.with_cube("no.exr", &["--lamp", SPOT, "--technique", "probes"]), "lights a cloud"),
    ] {
        refused(&strings(&arguments), expected);
        assert!(!place.path("no.exr").exists(), "{arguments:?}");
    }
    let alone = ["render", "--cloud", &place.text("box.ply"), "--out", &place.text("no.exr")];
    refused(&alone, "--object FILE is missing");
}
