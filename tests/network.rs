//! Dynamic range by a network: what the built-in one does to lamps and to everything else, tiles, threads, and networks
//! that do not fit.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::fs;
use std::path::Path;
use std::sync::Mutex;

use glam::Vec3;
use relume::compare::luminance;
use relume::preprocess::expansion::network::Network;
use relume::scene::Picture;
use tempfile::TempDir;

/// A wall of changing brightness with clipped discs of radius 20, `shift` columns further left.
fn lamps(width: u32, height: u32, shift: u32) -> Picture {
    let mut picture = Picture::black(width, height);
    for (i, rgb) in picture.rgb.iter_mut().enumerate() {
        let (x, y) = ((i as u32 % width + shift) as f32, (i as u32 / width) as f32);
        let wall = 0.25 + 0.15 * (x / 23.0).sin() * (y / 17.0).cos();
        let near = Vec3::new(x.rem_euclid(130.0) - 65.0, y.rem_euclid(110.0) - 55.0, 0.0).length();
        *rgb = if near < 20.0 { Vec3::ONE } else { Vec3::new(1.0, 0.9, 0.8) * wall };
    }
    picture
}

fn expand(network: &Network, picture: &Picture) -> Picture {
    let expanded = network.expand(picture, None, &|_| ()).unwrap();
    assert_eq!(
        (expanded.width, expanded.height, expanded.rgb.len()),
        (picture.width, picture.height, picture.rgb.len())
    );
    assert!(expanded.rgb.iter().all(|rgb| rgb.is_finite() && rgb.min_element() >= 0.0));
    expanded
}

#[test]
fn lamps_get_brighter_and_the_rest_stays() {
    let picture = lamps(390, 220, 0);
    let expanded = expand(&Network::built_in().unwrap(), &picture);
    for (i, (before, after)) in picture.rgb.iter().zip(&expanded.rgb).enumerate() {
        if *before == Vec3::ONE {
            assert!(luminance(*after) > 1.3, "pixel {i}: {after}");
        } else {
            assert!(after.abs_diff_eq(*before, 0.02 * before.max_element()), "pixel {i}: {before} became {after}");
        }
    }
}

#[test]
fn pictures_of_any_size_work() {
    let network = Network::built_in().unwrap();
    for (width, height) in [(0, 0), (1, 1), (3, 40), (257, 5)] {
        expand(&network, &lamps(width, height, 0));
    }
    let white = Picture { width: 9, height: 9, rgb: vec![Vec3::ONE; 81] };
    assert!(expand(&network, &white).rgb.iter().all(|rgb| rgb.min_element() >= 1.0));
    expand(&network, &Picture::black(9, 9));
}

/// The same lamps in other tiles: no result may depend on where tiles begin.
#[test]
fn tiles_leave_no_seams() {
    let network = Network::built_in().unwrap();
    let (left, right) = (expand(&network, &lamps(640, 300, 0)), expand(&network, &lamps(560, 300, 80)));
    let mut worst = 0.0f32;
    // Away from the border where the second picture lacks what the first one shows.
    for (x, y) in (128..560).flat_map(|x| (0..300).map(move |y| (x, y))) {
        let (a, b) = (luminance(left.at(x + 80, y)), luminance(right.at(x, y)));
        worst = worst.max((a / b).ln().abs());
    }
    // A tile sees less of the surroundings than a larger picture has, which changes results by 0.009; tiles that count
    // as much at their borders as in their middle change them by 0.063.
    assert!(worst < 0.03, "tiles change results by {worst}");
}

#[test]
fn results_do_not_depend_on_threads() {
    let network = Network::built_in().unwrap();
    let picture = lamps(500, 300, 0);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| expand(&network, &picture))
    };
    let (one, two) = (run(1), run(2));
    let bits =
        |picture: &Picture| picture.rgb.iter().flat_map(|rgb| rgb.to_array().map(f32::to_bits)).collect::<Vec<_>>();
    assert!(bits(&one) == bits(&two));
}

#[test]
fn only_wanted_pixels_cost_time() {
    let network = Network::built_in().unwrap();
    let picture = lamps(700, 256, 0);
    let mut wanted = vec![false; picture.rgb.len()];
    wanted[55 * 700 + 65] = true;
    let steps = Mutex::new(Vec::new());
    let some = network.expand(&picture, Some(&wanted), &|share| steps.lock().unwrap().push(share)).unwrap();
    assert_eq!(*steps.lock().unwrap(), [1.0, 1.0], "one tile, and the end");
    let every = expand(&network, &picture);
    let difference = (some.at(65, 55) - every.at(65, 55)).length();
    assert!(difference < 1e-3, "a wanted pixel differs by {difference}");
    assert_eq!(some.at(455, 55), Vec3::ONE, "a lamp that nobody wants");

    let error = network.expand(&picture, Some(&wanted[1..]), &|_| ()).unwrap_err();
    assert_eq!(error.to_string(), "179199 flags for a picture of 700x256 pixels: one a pixel");
}

/// Whatever the scale of a network's output, and however it wants its tiles.
#[test]
fn results_are_in_the_scale_of_the_input() {
    let place = TempDir::new().unwrap();
    let free = [1, 3, -1, -1];
    let same = Model::of(&free, &["Identity"]).read(&place);
    // Identity takes an encoded picture for a linear one, so on a wall of one colour only the scale differs.
    let mut picture = lamps(300, 100, 0);
    picture.rgb.iter_mut().for_each(|rgb| *rgb = if *rgb == Vec3::ONE { *rgb } else { Vec3::splat(0.25) });
    let expanded = expand(&same, &picture);
    for (before, after) in picture.rgb.iter().zip(&expanded.rgb) {
        assert!(after.abs_diff_eq(*before, 1e-4), "{before} became {after}");
    }
    for (shape, op) in [(free, "Double"), ([1, 3, 40, 33], "Identity"), ([-1, -1, 8, 512], "Identity")] {
        let other = expand(&Model::of(&shape, &[op]).read(&place), &picture);
        for (a, b) in expanded.rgb.iter().zip(&other.rgb) {
            assert!(a.abs_diff_eq(*b, 1e-4), "{shape:?} {op}: {b} instead of {a}");
        }
    }
}

#[test]
fn what_is_no_number_stays_as_it_was() {
    let place = TempDir::new().unwrap();
    let picture = lamps(100, 100, 0);
    // NaN below 1, and -infinity at 1.
    let nothing = Model::of(&[1, 3, -1, -1], &["Log", "Log"]).read(&place);
    assert_eq!(expand(&nothing, &picture), picture);
    // NaN below 1, and 0 at 1, where the result must not be darker than the input.
    let dark = Model::of(&[1, 3, -1, -1], &["Log", "Sqrt"]).read(&place);
    assert_eq!(expand(&dark, &picture), picture);
}

#[test]
fn networks_that_do_not_fit_are_refused() {
    let place = TempDir::new().unwrap();
    let free: &[i64] = &[1, 3, -1, -1];
    let good = || Model::of(free, &["Identity"]);
    let cases = [
        (Model::of(&[1, 1, -1, -1], &["Identity"]).bytes(), "its input \"x0\" is 1x1x?x?; expected 1x3xHxW"),
        (Model::of(&[-1, 3], &["Identity"]).bytes(), "its input \"x0\" is ?x3; expected 1x3xHxW"),
        (Model::of(&[], &["Identity"]).bytes(), "its input \"x0\" is a single number; expected 1x3xHxW"),
        (Model::of(&[4, 3, 64, 64], &["Identity"]).bytes(), "its input \"x0\" is 4x3x64x64; expected 1x3xHxW"),
        (
            Model::of(&[1, 3, 4, 64], &["Identity"]).bytes(),
            "its input \"x0\" is 1x3x4x64; expected 1x3xHxW with H and W of 8 to 4096",
        ),
        (
            Model::of(&[1, 3, 1 << 40, 64], &["Identity"]).bytes(),
            "its input \"x0\" is 1x3x1099511627776x64; expected 1x3xHxW with H and W of 8 to 4096",
        ),
        (
            Model::of(free, &["GlobalAveragePool"]).bytes(),
            "its output is 1x3x1x1 (F32) for an input of 1x3x256x256; expected 1x3x256x256 (F32)",
        ),
        (
            Model { inputs: vec!["x0", "x9"], ..good() }.bytes(),
            "it has 2 inputs and 1 outputs; expected one 1x3xHxW picture each",
        ),
        (
            Model { outputs: vec!["x1", "x1"], ..good() }.bytes(),
            "it has 1 inputs and 2 outputs; expected one 1x3xHxW picture each",
        ),
        (Model { kind: 7, ..good() }.bytes(), "its input \"x0\" is INT64; expected FLOAT"),
        (Model { outputs: vec!["nowhere"], ..good() }.bytes(), "nothing makes its output \"nowhere\""),
        (Model { inputs: vec!["x7"], ..good() }.bytes(), "the ONNX runtime cannot use it: "),
        (Model::of(free, &["NoSuchOp"]).bytes(), "the ONNX runtime cannot use it: "),
        (b"A text file, and no network at all.\n".to_vec(), "not an ONNX file: "),
        (good().bytes()[..20].to_vec(), "not an ONNX file: "),
        (Vec::new(), "not an ONNX file: it holds no graph"),
    ];
    for (bytes, problem) in cases {
        let path = place.path().join("bad.onnx");
        fs::write(&path, bytes).unwrap();
        let line = refusal(&path);
        let said = line.strip_prefix(&format!("{}: ", path.display())).unwrap();
        // A problem that ends in a space is followed by the runtime's own words.
        assert!(
            said == problem || (problem.ends_with(' ') && said.starts_with(problem)),
            "{said:?} is not {problem:?}"
        );
    }
    assert!(refusal(&place.path().join("missing.onnx")).contains("missing.onnx: "));
    assert!(refusal(place.path()).starts_with(&format!("{}: ", place.path().display())));
}

/// Files with bytes changed at random are used or refused, and never end the program.
#[test]
fn damaged_files_are_refused() {
    let place = TempDir::new().unwrap();
    let path = place.path().join("damaged.onnx");
    let good = Model::of(&[1, 3, 16, 16], &["Log", "Double", "Sqrt"]).bytes();
    let mut state = 1u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for _ in 0..300 {
        let mut bytes = good.clone();
        for _ in 0..=random(2) {
            let at = random(bytes.len());
            bytes[at] = random(256) as u8;
        }
        fs::write(&path, bytes).unwrap();
        if let Err(error) = Network::read(&path) {
            assert!(!error.to_string().contains('\n'));
        }
    }
}

/// The one line that says why a file is no network.
#[track_caller]
fn refusal(path: &Path) -> String {
    let line = Network::read(path).err().unwrap().to_string();
    assert!(!line.contains('\n'), "{line}");
    line
}

/// A chain of nodes, x0 -> x1 -> ..., each with one input and one output.
struct Model<'a> {
    shape: &'a [i64],
    /// Type of the elements; 1 is float.
    kind: u64,
    ops: &'a [&'a str],
    inputs: Vec<&'a str>,
    outputs: Vec<&'a str>,
}

impl<'a> Model<'a> {
    /// `-1` in the shape stands for a dimension that is left open.
    fn of(shape: &'a [i64], ops: &'a [&'a str]) -> Self {
        let end = ["x0", "x1", "x2", "x3"][ops.len()];
        Self { shape, kind: 1, ops, inputs: vec!["x0"], outputs: vec![end] }
    }

    fn read(&self, place: &TempDir) -> Network {
        let path = place.path().join("good.onnx");
        fs::write(&path, self.bytes()).unwrap();
        Network::read(&path).unwrap()
    }

    /// The ONNX file: protocol buffers, field numbers as in onnx.proto.
    fn bytes(&self) -> Vec<u8> {
        let mut graph = Vec::new();
        for (i, &op) in self.ops.iter().enumerate() {
            let from = bytes(1, format!("x{i}").as_bytes());
            // `Double` stands for the sum of a value with itself.
            let (op, from) = if op == "Double" { ("Add", from.repeat(2)) } else { (op, from) };
            let node = [from, bytes(2, format!("x{}", i + 1).as_bytes()), bytes(4, op.as_bytes())].concat();
            graph.extend(bytes(1, &node));
        }
        graph.extend(bytes(2, b"graph"));
        let dims = self.shape.iter().enumerate().flat_map(|(axis, &size)| {
            bytes(1, &if size < 0 { bytes(2, format!("axis{axis}").as_bytes()) } else { number(1, size as u64) })
        });
        let tensor = [number(1, self.kind), bytes(2, &dims.collect::<Vec<u8>>())].concat();
        let value = |name: &str| [bytes(1, name.as_bytes()), bytes(2, &bytes(1, &tensor))].concat();
        graph.extend(self.inputs.iter().flat_map(|name| bytes(11, &value(name))));
        graph.extend(self.outputs.iter().flat_map(|name| bytes(12, &value(name))));
        [number(1, 8), bytes(7, &graph), bytes(8, &number(2, 13))].concat()
    }
}

fn varint(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value > 0x7f {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}

fn number(field: u64, value: u64) -> Vec<u8> {
    [varint(field << 3), varint(value)].concat()
}

fn bytes(field: u64, content: &[u8]) -> Vec<u8> {
    [varint(field << 3 | 2), varint(content.len() as u64), content.to_vec()].concat()
}
