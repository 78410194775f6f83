//! Light probes that are played in the window.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

use glam::{Vec3, vec3};
use relume::formats::image::{ExrImage, read_rgba_exr};

use crate::place::{Display, Place, refused, said};

/// Bright on one side and blue above, so that every turn of it is another light.
fn day(u: f32, v: f32) -> Vec3 {
    vec3(1.2 + (std::f32::consts::TAU * u).cos(), 1.0, 1.5 - v)
}

fn place() -> Place {
    let place = Place::new();
    place.probe("day.exr", day);
    place
}

/// Plays a script in a small window; it must end well.
fn play(place: &Place, display: &Display, arguments: &[&str], script: &str) -> String {
    let all = [arguments, &["--object", "ball.obj", "--size", "160x120"]].concat();
    said(&place.command(&display.name, &all, script).output().expect("relume runs"))
}

fn render(place: &Place, arguments: &[&str]) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relume"));
    said(&command.current_dir(place.folder()).arg("render").args(arguments).output().expect("relume runs"));
}

fn read(place: &Place, name: &str) -> ExrImage {
    read_rgba_exr(&place.path(name)).expect("an EXR")
}

/// The frame that a line of the command `rate` ends with.
fn frame(said: &str) -> u64 {
    let number = said.trim_end().rsplit("frame ").next().and_then(|number| number.parse().ok());
    number.unwrap_or_else(|| panic!("no frame in {said:?}"))
}

#[test]
fn a_turning_panorama_plays_by_itself_and_stands_still_in_a_pause() {
    let Some(display) = Display::open() else { return };
    let place = place();
    let script = "wait-frame 3\nremember\nwait-change\nremember\nwait-change\npause\nwait-still\nremember\n\
        wait 0.4\nexpect-same\nscreenshot still\nrate\nsave s.toml\nplay\nwait-change\nquit\n";
    let said = play(&place, &display, &["--probes", "day.exr", "--turn", "90", "--validation"], script);
    let number = frame(&said).to_string();
    assert!(place.path("ball.prt").is_file(), "the transfer is kept beside the object");
    // The paused picture is what `render` makes of that frame.
    render(&place, &["--scene", "s.toml", "--frames", &number, "--out", "rendered.exr"]);
    let (seen, rendered) = (read(&place, "still.exr"), read(&place, "rendered.exr"));
    assert!(seen.rgb == rendered.rgb, "frame {number}");
    render(&place, &["--scene", "s.toml", "--frames", "0", "--out", "first.exr"]);
    assert!(seen.rgb != read(&place, "first.exr").rgb);
    render(&place, &["--scene", "s.toml", "--backdrop", "none", "--out", "object.exr"]);
    let object = read(&place, "object.exr").alpha.iter().filter(|alpha| **alpha > 0.5).count();
    assert!((200..19_000).contains(&object), "{object} pixels show the object");
}

#[test]
fn the_light_beyond_a_scan_follows_the_probes() {
    let Some(display) = Display::open() else { return };
    let place = place();
    // The far field changes in place while it plays, and with it what the scan's holes show and the shadow.
    let script = "pause\nwait-still\nscreenshot before\nplay\nwait-frame 6\npause\nwait-still\n\
        screenshot after\nsave s.toml\nrate\nquit\n";
    let probes = ["--cloud", "open.bsh", "--probes", "day.exr", "--turn", "150", "--rate", "10", "--late", "wait"];
    let number = frame(&play(&place, &display, &probes, script)).to_string();
    let (before, after) = (read(&place, "before.exr"), read(&place, "after.exr"));
    let lit = |name: &str, number: &str, more: &[&str]| {
        render(&place, &[&["--scene", "s.toml", "--frames", number, "--out", name], more].concat());
        read(&place, name)
    };
    assert!(after.rgb == lit("rendered.exr", &number, &[]).rgb, "frame {number}");
    let mask = lit("mask.exr", &number, &["--backdrop", "none"]).alpha;
    let differ = |i: &usize| mask[*i] > 0.5 && before.rgb[*i].distance(after.rgb[*i]) > 0.005;
    let changed = (0..mask.len()).filter(differ).count();
    assert!(changed > 50, "the object is lit through the hole: {changed}");
    // The same scan does not light it where only the probes do.
    let script = "wait-still\nscreenshot alone\nquit\n";
    play(&place, &display, &["--scene", "s.toml", "--technique", "probes"], script);
    let alone = read(&place, "alone.exr");
    assert!(alone.rgb == lit("probes.exr", "0", &["--technique", "probes"]).rgb && alone.rgb != before.rgb);
}

#[test]
fn folders_play_over_damaged_frames_and_bad_ones_change_nothing() {
    let Some(display) = Display::open() else { return };
    let place = place();
    for folder in ["frames", "empty", "broken"] {
        std::fs::create_dir(place.path(folder)).expect("a folder");
    }
    for number in 0..6 {
        place.probe(&format!("frames/{number}.exr"), |u, v| day(u, v) * (1 + number) as f32);
    }
    std::fs::write(place.path("frames/3.exr"), "no picture").expect("a file");
    std::fs::write(place.path("broken/0.exr"), "no picture").expect("a file");
    let script = "wait-frame 1\npause\nwait-still\nremember\ndrop empty\nwait-status empty\ndrop broken\n\
        wait-status broken\nwait-still\nexpect-same\n\
        drop frames\nwait-status frame 3 is left out\nwait-frame 5\nremember\nwait-change\npause\nwait-still\nrate\n\
        save folder.toml\ndrop day.exr\nwait-still\nremember\nwait 0.2\nexpect-same\nsave day.toml\nplay\n\
        expect-status no light probes\nquit\n";
    let said = play(&place, &display, &["--probes", "day.exr", "--turn", "30", "--late", "wait"], script);
    assert!(frame(&said) < 6 && frame(&said) != 3, "{said}");
    let text = |name: &str| std::fs::read_to_string(place.path(name)).expect("a scene");
    assert!(text("folder.toml").contains("path = \"frames\"") && !text("folder.toml").contains("environment"));
    assert!(text("day.toml").contains("environment = \"day.exr\"") && !text("day.toml").contains("[probes]"));
    // A probe that does not change is a far field like another.
    let script = "wait-still\nremember\nplay\nwait 0.2\nwait-still\nexpect-same\nscreenshot probe\nquit\n";
    play(&place, &display, &["--probes", "day.exr"], script);
    play(&place, &display, &["--environment", "day.exr"], "wait-still\nscreenshot field\nquit\n");
    assert!(read(&place, "probe.exr").rgb == read(&place, "field.exr").rgb);
}

#[test]
fn a_hundred_frames_are_silent_in_windows_of_any_size() {
    let Some(display) = Display::open() else { return };
    let place = place();
    place.probe("night.exr", |_, v| Vec3::splat(0.2 * v));
    let script = "wait-frame 10\nresize 200x90\ndrag 20,20 60,40 6\nwait-frame 30\nminimise\nwait 0.3\nrestore\n\
        resize 90x160\nwait-frame 60\nlose renderer\nresize 180x140\nwait-frame 80\nscreenshot playing\n\
        wait-frame 100\nremember\nwait-change\nquit\n";
    for scan in [&[][..], &["--cloud", "open.bsh"]] {
        let probes = ["--probes", "day.exr", "--turn", "90", "--cross-fade", "night.exr", "--validation"];
        play(&place, &display, &[scan, &probes].concat(), script);
        let picture = image::open(place.path("playing.png")).expect("a picture");
        assert_eq!((picture.width(), picture.height()), (180, 140));
    }
}

/// A number that a line of a file in /proc has behind a name.
fn known(path: &Path, name: &str) -> u64 {
    let text = std::fs::read_to_string(path).expect("a file of the system");
    let line = text.lines().find_map(|line| line.strip_prefix(name)).expect("a line of that name");
    line.split_whitespace().next().and_then(|number| number.parse().ok()).expect("a number")
}

/// The viewer on a script whose command `rate` is heard as it comes.
struct Heard {
    child: Child,
    lines: std::io::Lines<BufReader<ChildStdout>>,
}

impl Heard {
    fn line(&mut self) {
        self.lines.next().expect("a line").expect("text");
    }

    /// Resident memory, KiB.
    fn memory(&self) -> u64 {
        known(&Path::new("/proc").join(self.child.id().to_string()).join("status"), "VmRSS:")
    }

    /// Times that the thread which renders has slept.
    fn naps(&self) -> u64 {
        let tasks = Path::new("/proc").join(self.child.id().to_string()).join("task");
        let named = |task: &std::path::PathBuf| {
            std::fs::read_to_string(task.join("comm")).is_ok_and(|name| name.trim_end() == "renderer")
        };
        let tasks = std::fs::read_dir(tasks).expect("threads").map(|task| task.expect("a thread").path());
        known(&tasks.into_iter().find(named).expect("the renderer").join("status"), "voluntary_ctxt_switches:")
    }
}

/// Starts to play a script.
fn hear(place: &Place, display: &Display, arguments: &[&str], script: &str) -> Heard {
    let all = [arguments, &["--object", "ball.obj", "--size", "160x120"]].concat();
    let mut command = place.command(&display.name, &all, script);
    let mut child = command.stdout(Stdio::piped()).spawn().expect("relume runs");
    let lines = BufReader::new(child.stdout.take().expect("a pipe")).lines();
    Heard { child, lines }
}

#[test]
fn memory_does_not_grow() {
    let Some(display) = Display::open() else { return };
    let place = place();
    // 6 MiB a panorama.
    place.probe_of(1024, "large.exr", day);
    let script = "wait-frame 10\nrate\nwait-frame 60\nrate\nwait-frame 110\nrate\nquit\n";
    let arguments = ["--probes", "large.exr", "--turn", "90", "--late", "wait"];
    let mut heard = hear(&place, &display, &arguments, script);
    let [_, half, whole] = [0; 3].map(|_| {
        heard.line();
        heard.memory()
    });
    assert!(heard.child.wait().expect("relume ends").success());
    assert!(whole < half + 24 * 1024, "{half} KiB after 60 frames, {whole} KiB after 110");
}

#[test]
fn a_pause_is_quiet() {
    let Some(display) = Display::open() else { return };
    let place = place();
    let script = "wait-frame 5\npause\nwait-still\nwait 0.3\nrate\nwait 1\nrate\nplay\nwait-change\nquit\n";
    let mut heard = hear(&place, &display, &["--probes", "day.exr", "--turn", "90"], script);
    let [before, after] = [0; 2].map(|_| {
        heard.line();
        heard.naps()
    });
    assert!(heard.child.wait().expect("relume ends").success());
    assert!(after < before + 5, "it woke up {} times in a second", after - before);
}

#[test]
fn a_scene_keeps_its_probes() {
    let Some(display) = Display::open() else { return };
    let place = place();
    let arguments = ["--probes", "day.exr", "--mapping", "angular", "--turn", "-7.5", "--rate", "12", "--late", "wait"];
    let more = ["--cross-fade", "day.exr", "--technique", "probes"];
    play(&place, &display, &[&arguments[..], &more].concat(), "wait-frame 2\nsave s.toml\npause\nsave p.toml\nquit\n");
    let text = std::fs::read_to_string(place.path("s.toml")).expect("a scene");
    for part in ["path = \"day.exr\"", "angular", "-7.5", "12", "wait", "cross_fade", "technique = \"probes\""] {
        assert!(text.contains(part), "{part} in {text}");
    }
    // It plays, or does not, as it did.
    play(&place, &display, &["--scene", "s.toml"], "wait-frame 2\nquit\n");
    play(&place, &display, &["--scene", "p.toml"], "wait-still\nremember\nwait 0.3\nexpect-same\nquit\n");
    std::fs::write(place.path("both.toml"), text.replace("[probes]", "environment = \"day.exr\"\n[probes]"))
        .expect("a file");
    let both = place.command("", &["--scene", "both.toml"], "quit").output().expect("relume runs");
    refused(&both, &["both.toml"]);
}
