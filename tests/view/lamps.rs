//! Lamps that are added, moved and removed in the window.

use std::process::Command;

use glam::Vec3;
use relume::formats::image::{ExrImage, read_rgba_exr};
use relume::formats::scene_file;

use crate::place::{Display, Place, refused, said};

/// At the floor, beside the ball.
const LAMP: &str = "spot at=0.2,0.7,0.6 to=0.1,-0.6,0 power=6 angle=70";
const CAMERA: &str = "[camera]\nfrom = [0.3, 0.3, 1.3]\nat = [0, -0.1, 0]\nfov = 60\n";

/// Light of few lights, which is quick.
const FEW: &str = "vpls = 32\ninterleave = 2\nism_size = 16\n";

fn place(more: &str) -> Place {
    let place = Place::new();
    let files = "cloud = \"room.bsh\"\nobject = \"ball.obj\"\n";
    std::fs::write(place.path("s.toml"), format!("{files}{CAMERA}{more}")).expect("a scene");
    place
}

fn play(place: &Place, display: &Display, arguments: &[&str], script: &str) -> String {
    let all = [arguments, &["--size", "160x120"]].concat();
    said(&place.command(&display.name, &all, script).output().expect("relume runs"))
}

fn read(place: &Place, name: &str) -> ExrImage {
    read_rgba_exr(&place.path(name)).expect("an EXR")
}

/// Pixels of the object and of the scan, by which one is seen, that differ between two pictures.
fn changed(place: &Place, a: &str, b: &str) -> [usize; 2] {
    let object = read(place, "object.exr").alpha;
    let (a, b) = (read(place, a), read(place, b));
    let mut counts = [0, 0];
    for (i, (a, b)) in a.rgb.iter().zip(&b.rgb).enumerate() {
        counts[usize::from(object[i] < 0.5)] += usize::from(a.distance(*b) > 0.01 * (a.length() + 0.01));
    }
    counts
}

fn render(place: &Place, arguments: &[&str]) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relume"));
    said(&command.current_dir(place.folder()).arg("render").args(arguments).output().expect("relume runs"));
}

#[test]
fn a_lamp_lights_object_and_scan_and_leaves_no_trace() {
    let Some(display) = Display::open() else { return };
    let place = place(&format!("[lamps]\n{FEW}"));
    let script = format!(
        "wait-still\nremember\nscreenshot dark\nlamp add {LAMP}\nwait-still\nexpect-changed\nscreenshot lit\n\
        lamp move 1 to -0.4,-0.3,-0.5\nlamp move 1 at -0.8,0.5,0.3\nwait-still\nscreenshot moved\nsave lit.toml\n\
        lamp remove 1\nwait-still\nexpect-same\nscreenshot after\nquit\n"
    );
    play(&place, &display, &["--scene", "s.toml", "--validation"], &script);
    render(&place, &["--scene", "s.toml", "--size", "160x120", "--backdrop", "none", "--out", "object.exr"]);
    for (a, b) in [("dark.exr", "lit.exr"), ("lit.exr", "moved.exr")] {
        let [object, scan] = changed(&place, a, b);
        assert!(object > 200 && scan > 2000, "{a} and {b}: {object} pixels of the object, {scan} of the scan");
    }
    assert!(read(&place, "after.exr").rgb == read(&place, "dark.exr").rgb, "a lamp that is gone leaves nothing");
    let sum = |name| read(&place, name).rgb.iter().sum::<Vec3>();
    assert!(sum("lit.exr").cmpgt(sum("dark.exr")).all());
    // What was saved is rendered as it was seen, and opens as it was.
    render(&place, &["--scene", "lit.toml", "--out", "rendered.exr"]);
    assert!(read(&place, "rendered.exr").rgb == read(&place, "moved.exr").rgb, "not what render makes of it");
    play(&place, &display, &["--scene", "lit.toml"], "wait-still\nscreenshot again\nsave again.toml\nquit\n");
    assert!(read(&place, "again.exr").rgb == read(&place, "moved.exr").rgb);
    let scene = |name: &str| scene_file::read(&place.path(name)).expect("a scene");
    assert_eq!(scene("lit.toml"), scene("again.toml"));
}

#[test]
fn the_mouse_moves_what_a_lamp_lights_and_the_lamp() {
    let Some(display) = Display::open() else { return };
    let place = place(&format!("[lamps]\nlist = [\"{LAMP}\", \"point at=0,0.5,0 power=1\"]\n{FEW}"));
    let script = "wait-still\nsave before.toml\nremember\ndrag 80,60 40,70 5 left alt\nwait-still\nexpect-changed\n\
        save aimed.toml\nremember\ndrag 60,60 80,50 5 left alt shift\nwait-still\nexpect-changed\nsave moved.toml\n\
        lamp new spot\nwait-still\ndrag 20,20 30,20 3\nwait-still\nsave new.toml\nlamp remove 3\nlamp remove 2\nquit\n";
    play(&place, &display, &["--scene", "s.toml"], script);
    let lamps = |name: &str| scene_file::read(&place.path(name)).expect("a scene").lamps.list;
    let parts = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
    let [before, aimed, moved] = ["before.toml", "aimed.toml", "moved.toml"].map(|name| parts(&lamps(name)[0]));
    assert!(before[1] == aimed[1] && before[2] != aimed[2], "{aimed:?}");
    assert!(aimed[1] != moved[1] && aimed[2] == moved[2], "{moved:?}");
    let aim: Vec<f64> = aimed[2][3..].split(',').map(|part| part.parse().expect("a number")).collect();
    let walls = [aim[0].abs() - 1.5, aim[1].abs() - 1.0, aim[2].abs() - 1.5].map(f64::abs);
    assert!(walls.into_iter().any(|distance| distance < 0.05), "{aim:?} is on no wall of the box");
    assert!(lamps("before.toml")[1] == lamps("moved.toml")[1], "the other lamp stays");
    let camera = scene_file::read(&place.path("before.toml")).expect("a scene").camera;
    let [x, y, z] = camera.from.expect("an eye");
    assert!(lamps("new.toml")[2].contains(&format!("at={x},{y},{z} ")), "at the eye: {:?}", lamps("new.toml"));
}

#[test]
fn lamps_change_while_pictures_are_rendered() {
    let Some(display) = Display::open() else { return };
    let place = place("");
    let mut script = format!("lamp add {LAMP}\n");
    for step in 0..12 {
        let x = 0.1 * f64::from(step - 6);
        script += &format!("lamp move 1 at {x},0.6,0.4\nwait 0.0{}\n", step % 8 + 1);
    }
    script += "wait-still\ndrag 80,60 60,70 10 left alt\nlamp add point at=-0.5,0.5,0.5 power=2\n\
        drag 20,20 40,30 5\nlamp add sun direction=0.1,-1,0.2 power=1\nresize 200x90\nlamp move 2 at 0.5,0.5,0.5\n\
        drag 80,50 90,50 5\nlamp remove 1\nlose renderer\nlamp move 1 at 0.2,0.6,0.5\nwait-still\ndrop small.obj\n\
        lamp move 1 at 0.2,0.5,0.6\nwait-still\nremember\nresize 120x120\nwait-still\ndrop other.ply\nlamp remove 2\n\
        wait-still\nlamp remove 1\nwait-still\nquit\n";
    play(&place, &display, &["--scene", "s.toml", "--validation", "--vpls", "64", "--lamp", LAMP], &script);
}

#[test]
fn the_scan_alone_is_seen_in_the_light_of_lamps() {
    let Some(display) = Display::open() else { return };
    let place = place(&format!("[lamps]\nlist = [\"{LAMP}\"]\n{FEW}[render]\ntechnique = \"lamps\"\n"));
    let script = "wait-still\nscreenshot alone\nsave a.toml\nquit\n";
    play(&place, &display, &["--scene", "s.toml"], script);
    render(&place, &["--scene", "a.toml", "--out", "rendered.exr"]);
    assert!(read(&place, "alone.exr").rgb == read(&place, "rendered.exr").rgb);
    // It needs no object, and finds a view of the scan by itself.
    let alone = ["--cloud", "room.bsh", "--technique", "lamps", "--lamp", LAMP, "--vpls", "32"];
    play(
        &place,
        &display,
        &alone,
        "wait-still\nremember\nlamp move 1 to 0.9,-0.2,0\nwait-still\nexpect-changed\nquit\n",
    );
}

#[test]
fn lamps_that_cannot_be_are_refused_in_one_line() {
    let place = place("[lamps]\nlist = [\"spot at=0,0,0 to=0,0,0 power=1 angle=30\"]\n");
    let run = |arguments: &[&str], script: &str| place.command("", arguments, script).output().expect("relume runs");
    refused(&run(&["--scene", "s.toml"], "quit"), &["s.toml", "lamps.list, entry 1", "same place"]);
    refused(&run(&["--vpls", "32"], "quit"), &["--vpls", "--lamp"]);
    refused(&run(&["--bounces", "1"], "quit"), &["--bounces", "--lamp"]);
    refused(&run(&["--lamp", LAMP, "--vpls", "17"], "quit"), &["17", "multiple of 16"]);
    refused(&run(&[], "lamp add lantern"), &["line 1", "lantern"]);
    let Some(display) = Display::open() else { return };
    let output = place.command(&display.name, &["--size", "80x80"], "lamp remove 1\n").output().expect("relume runs");
    refused(&output, &["line 1", "no lamp 1"]);
}
