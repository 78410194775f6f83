//! Traces and captures, as a person takes them.

#[path = "common/mod.rs"]
mod common;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

use relume::gpu::{Context, ContextOptions, Profile, Recorder};
use relume::trace::Trace;
use serde_json::Value;
use tempfile::TempDir;

const RELUME: &str = env!("CARGO_BIN_EXE_relume");

/// Microseconds of a nanosecond, which is what times are rounded to, and a little.
const ROUNDING: f64 = 1.5e-3;

fn run(command: &mut Command) -> Output {
    command.output().expect("the command runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// One line that holds `expected`, and exit code 2.
fn refused(command: &mut Command, expected: &str) {
    let output = run(command);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains(expected), "{message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("a file")).expect("JSON")
}

/// A box of points, and a ball in it, as files.
fn write_scene(folder: &Path) {
    let half = glam::Vec3::new(2.0, 1.5, 2.5);
    let cloud = common::box_cloud(half, 4000, |p, _| glam::Vec3::splat(if p.y >= half.y { 1.0 } else { 0.4 }));
    let mut ply = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n\
         property float ny\nproperty float nz\nproperty float red\nproperty float green\nproperty float blue\nend_header\n",
        cloud.len()
    );
    for i in 0..cloud.len() {
        let numbers =
            [cloud.positions[i], cloud.normals[i], cloud.colors[i]].map(|v| format!("{} {} {}", v.x, v.y, v.z));
        ply += &format!("{}\n", numbers.join(" "));
    }
    std::fs::write(folder.join("box.ply"), ply).expect("a cloud");
    let ball = common::ball(0.5);
    let mut obj = String::new();
    for vertex in &ball.vertices {
        let (p, n) = (vertex.position, vertex.normal);
        obj += &format!("v {} {} {}\nvn {} {} {}\n", p.x, p.y, p.z, n.x, n.y, n.z);
    }
    for triangle in ball.indices.chunks_exact(3) {
        let [a, b, c] = [triangle[0] + 1, triangle[1] + 1, triangle[2] + 1];
        obj += &format!("f {a}//{a} {b}//{b} {c}//{c}\n");
    }
    std::fs::write(folder.join("ball.obj"), obj).expect("an object");
}

fn render(folder: &Path) -> Command {
    let mut command = Command::new(RELUME);
    command.current_dir(folder).args(["render", "--cloud", "box.ply", "--object", "ball.obj", "--out", "image.exr"]);
    command.args(["--size", "64x64"]);
    command
}

/// A complete event.
#[derive(Clone, Debug)]
struct Event {
    name: String,
    thread: (u64, u64),
    begin: f64,
    end: f64,
    counts: Value,
}

/// The events of a trace, in the file's order.
fn events(trace: &Value) -> Vec<Event> {
    let list = trace["traceEvents"].as_array().expect("a list of events");
    let complete = list.iter().filter(|event| event["ph"] == "X");
    complete
        .map(|event| {
            let number = |key: &str| event[key].as_f64().expect("a number");
            let (begin, length) = (number("ts"), number("dur"));
            assert!(begin >= 0.0 && length >= 0.0, "{event}");
            Event {
                name: event["name"].as_str().expect("a name").into(),
                thread: (event["pid"].as_u64().expect("a process"), event["tid"].as_u64().expect("a thread")),
                begin,
                end: begin + length,
                counts: event["args"].clone(),
            }
        })
        .collect()
}

/// The process of that name.
fn process(trace: &Value, starts: &str) -> u64 {
    let list = trace["traceEvents"].as_array().expect("a list of events");
    let named = list.iter().find(|event| {
        event["name"] == "process_name" && event["args"]["name"].as_str().is_some_and(|name| name.starts_with(starts))
    });
    named.expect("a process of that name")["pid"].as_u64().expect("a number")
}

fn named<'a>(events: &'a [Event], name: &str) -> &'a Event {
    events.iter().find(|event| event.name == name).unwrap_or_else(|| panic!("no {name}"))
}

fn holds(outer: &Event, inner: &Event) -> bool {
    inner.begin >= outer.begin - ROUNDING && inner.end <= outer.end + ROUNDING
}

/// Checks that a trace is one, and returns its passes.
fn check_trace(trace: &Value) -> Vec<Event> {
    let all = events(trace);
    let (cpu, gpu) = (process(trace, "CPU"), process(trace, "GPU "));
    let (cpu, gpu): (Vec<Event>, Vec<Event>) =
        all.into_iter().filter(|e| [cpu, gpu].contains(&e.thread.0)).partition(|e| e.thread.0 == cpu);
    // Passes follow one another.
    for pair in gpu.windows(2) {
        assert!(pair[1].begin >= pair[0].end - ROUNDING, "{pair:?}");
    }
    // Spans lie in one another or apart.
    for (i, a) in cpu.iter().enumerate() {
        for b in cpu[i + 1..].iter().filter(|b| b.thread == a.thread) {
            let apart = b.begin >= a.end - ROUNDING || a.begin >= b.end - ROUNDING;
            assert!(apart || holds(a, b) || holds(b, a), "{a:?} and {b:?}");
        }
    }
    let submissions: BTreeMap<u64, &Event> = cpu
        .iter()
        .filter(|event| event.name == "submission")
        .map(|event| (event.counts["submission"].as_u64().expect("a number"), event))
        .collect();
    for pass in &gpu {
        let own = submissions[&pass.counts["submission"].as_u64().expect("a number")];
        assert!(holds(own, pass), "{pass:?} is not in {own:?}");
    }
    gpu
}

#[test]
fn a_trace_has_every_pass_of_the_statistics_in_order() {
    let folder = TempDir::new().expect("a folder");
    write_scene(folder.path());
    let feedback = ["clear output", "gbuffer", "receivers", "clear lists", "clear counts"];
    let pixels = ["clear", "visibility", "coverage", "convolve"];
    let order = |technique: &str| -> Vec<String> {
        let own: &[&str] = match technique {
            "classic" => &[],
            "mipmapped" => &["traverse (mipmapped)", "prepare", "bin"],
            "hybrid" => &["traverse (hybrid)", "prepare", "refine", "bin"],
            _ => &["traverse (shared)", "prepare", "refine", "clear", "visibility", "coverage", "tile radiance"],
        };
        let (first, last): (&[&str], &[&str]) = match technique {
            "classic" => (&feedback[..3], &pixels),
            "shared" => (&["clear output", "gbuffer", "receivers", "clear counts"], &["tile convolve"]),
            _ => (&feedback, &pixels),
        };
        [first, own, last].concat().iter().map(|name| (*name).to_owned()).collect()
    };
    for technique in ["classic", "mipmapped", "hybrid", "shared"] {
        let output = run(render(folder.path()).args(["--technique", technique, "--material", "diffuse:0.7"]).args([
            "--stats",
            "stats.json",
            "--trace",
            "trace.json",
        ]));
        assert!(output.status.success(), "{technique}: {}", text(&output.stderr));
        let (stats, trace) = (json(&folder.path().join("stats.json")), json(&folder.path().join("trace.json")));
        let passes = check_trace(&trace);
        let clock = trace["otherData"]["gpu_clock"].as_str().expect("how the clocks were brought together");
        assert!(clock.starts_with("calibrated") || clock.starts_with("anchored"), "{clock}");

        let all = events(&trace);
        let frame = named(&all, "frame");
        for step in ["object", "device", "cloud", "hierarchy", "upload and pipelines", "frame", "writing"] {
            named(&all, step);
        }
        let of_stats = stats["passes"].as_object().expect("passes");
        let frame_passes: Vec<&Event> = passes.iter().filter(|pass| of_stats.contains_key(&pass.name)).collect();
        for (name, pass) in of_stats {
            let runs: Vec<&&Event> = frame_passes.iter().filter(|event| event.name == *name).collect();
            assert_eq!(Some(runs.len() as u64), pass["runs"].as_u64(), "{technique}: {name}");
            let length: f64 = runs.iter().map(|event| event.end - event.begin).sum();
            let expected = pass["gpu_ms"].as_f64().expect("a number") * 1e3;
            assert!((length - expected).abs() <= ROUNDING * runs.len() as f64, "{name}: {length} and {expected}");
            for (what, amount) in
                pass.as_object().expect("a pass").iter().filter(|(key, _)| *key != "runs" && *key != "gpu_ms")
            {
                let counted: u64 = runs.iter().filter_map(|event| event.counts[what].as_u64()).sum();
                assert_eq!(Some(counted), amount.as_u64(), "{technique}: {what} of {name}");
            }
        }
        assert!(frame_passes.iter().all(|pass| holds(frame, pass)), "{technique}");
        let mut seen: Vec<String> = Vec::new();
        for pass in frame_passes {
            if !seen.contains(&pass.name) {
                seen.push(pass.name.clone());
            }
        }
        let wanted = order(technique);
        assert_eq!(seen.len(), of_stats.len(), "{technique}");
        if technique == "shared" {
            // What it leaves to hybrid comes after its own passes.
            seen.truncate(wanted.len());
        }
        assert_eq!(seen, wanted, "{technique}");
    }
}

#[test]
fn every_pass_of_a_long_submission_is_timed() {
    let trace = Trace::new();
    let options = ContextOptions { device: None, validation: true };
    let context = common::Device(Context::traced(&options, trace.clone()).expect("a device with validation"));
    let mut profile = Profile::default();
    let mut recorder = Recorder::new(&context.0).expect("a recorder");
    for _ in 0..750 {
        recorder.pass("one", |_, _| ());
        recorder.count("things", 2);
        recorder.pass("two", |_, _| ());
    }
    recorder.finish(&mut profile).expect("a submission");
    assert_eq!(profile.passes["one"].runs + profile.passes["two"].runs, 1500);
    assert_eq!(profile.passes["one"].counts["things"], 1500);
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("trace.json");
    trace.write(&path).expect("a trace");
    let passes = check_trace(&json(&path));
    assert_eq!(passes.len(), 1500);
    assert!(passes.iter().enumerate().all(|(i, pass)| pass.name == ["one", "two"][i % 2]));
    let length: f64 = passes.iter().map(|pass| pass.end - pass.begin).sum();
    assert!((length - profile.total_ms() * 1e3).abs() < 1500.0 * ROUNDING, "{length}");
}

#[test]
fn a_trace_that_cannot_be_written_is_refused_before_anything_is_read() {
    let folder = TempDir::new().expect("a folder");
    refused(render(folder.path()).args(["--trace", "no/trace.json"]), "there is no folder no");
    refused(render(folder.path()).args(["--trace", "trace.txt"]), ".json");
    refused(render(folder.path()).args(["--trace", "a.json", "--stats", "a.json"]), "the same file");
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
}

#[test]
fn a_capture_without_renderdoc_is_one_line_that_says_how() {
    let folder = TempDir::new().expect("a folder");
    refused(render(folder.path()).arg("--capture"), "renderdoccmd capture");
}

#[test]
fn a_capture_lists_its_passes() {
    if Command::new("renderdoccmd").arg("version").output().is_err() {
        eprintln!("a_capture_lists_its_passes: skipped, because renderdoccmd is not installed (tools/setup)");
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tools/capture");
    let output = run(Command::new(script).current_dir(folder.path()).env("RELUME", RELUME).args(["-o", "hybrid.rdc"]));
    assert!(output.status.success(), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    let labels: Vec<&str> = said.lines().filter_map(|line| line.split("  ").next()).collect();
    let mut from = 0;
    for pass in ["gbuffer", "receivers", "traverse (hybrid)", "refine", "bin", "visibility", "coverage", "convolve"] {
        let at = labels[from..].iter().position(|label| *label == pass);
        from += at.unwrap_or_else(|| panic!("{pass} is not in its place among\n{said}"));
    }
    assert!(said.lines().any(|line| line.starts_with("traverse (hybrid)") && line.contains("draws")), "{said}");
    assert!(folder.path().join("hybrid.rdc").metadata().expect("a capture").len() > 10_000);

    // A trace under RenderDoc, and a program that fails under it.
    write_scene(folder.path());
    let scene = ["--cloud", "box.ply", "--object", "ball.obj", "--size", "32x32", "--technique", "shared"];
    let with_trace = run(Command::new(script)
        .current_dir(folder.path())
        .env("RELUME", RELUME)
        .args(["-o", "shared.rdc"])
        .args(scene)
        .args(["--trace", "trace.json"]));
    assert!(text(&with_trace.stdout).contains("traverse (shared)"), "{}", text(&with_trace.stderr));
    check_trace(&json(&folder.path().join("trace.json")));
    let failed = run(Command::new(script)
        .current_dir(folder.path())
        .env("RELUME", RELUME)
        .args(["--cloud", "none.ply", "--object", "none.obj"]));
    assert!(!failed.status.success() && text(&failed.stderr).contains("none.obj"), "{}", text(&failed.stderr));
}
