//! The viewer in a real window, on a display without a screen (Xvfb), driven by scripts and by a synthetic mouse.

#[path = "../common/mod.rs"]
mod common;
mod lamps;
mod place;
mod probes;

use std::fmt::Write as _;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use common::{ball, box_cloud, build};
use glam::{Vec3, vec3};
use place::{Display, Place, refused, said};
use relume::formats::image::read_rgba_exr;
use tempfile::TempDir;

#[test]
fn every_way_to_move_changes_the_picture() {
    let Some(display) = Display::open() else { return };
    let mut script = "wait-still\n".to_owned();
    for motion in [
        "drag 20,20 60,40 6",
        "drag 20,20 40,20 4 middle",
        "drag 20,20 30,24 4 right",
        "drag 20,100 30,90 3 left shift",
        "wheel 2",
        "fly w 0.1",
        "double-click 30,100",
    ] {
        writeln!(script, "remember\n{motion}\nwait-still\nexpect-changed").expect("text");
    }
    Place::new().plays(&display, &[], &(script + "quit\n"));
}

#[test]
fn the_object_is_moved_turned_and_scaled() {
    let Some(display) = Display::open() else { return };
    let place = Place::new();
    // From above, where the ceiling is seen from behind: it must not be shown, or it hides the object.
    let scene = "cloud = \"room.bsh\"\nobject = \"ball.obj\"\n[display]\npoints = \"none\"\n";
    std::fs::write(place.path("none.toml"), scene).expect("a file");
    let mut script = "wait-still\ndrag 20,20 20,60 5\nwait-still\nsave before.toml\n".to_owned();
    for motion in ["drag 80,60 90,60 5", "drag 90,60 110,60 5 left ctrl", "drag 90,60 90,54 5 left ctrl shift"] {
        writeln!(script, "{motion}\nwait-still").expect("text");
    }
    let arguments = ["--scene", "none.toml", "--size", "160x120"];
    said(
        &place.command(&display.name, &arguments, &(script + "save after.toml\nquit\n")).output().expect("relume runs"),
    );
    let scene = |name| relume::formats::scene_file::read(&place.path(name)).expect("a scene");
    let (before, after) = (scene("before.toml"), scene("after.toml"));
    assert_eq!(before.camera, after.camera, "the object was dragged, not the camera");
    assert_ne!(before.placement.at, after.placement.at);
    let base = after.placement.at.expect("a place")[1] - 0.25;
    assert!((base + 1.0).abs() < 0.05, "it stands on the floor of the box: {base}");
    assert_ne!(after.placement.turn, Some(0.0));
    assert!(after.placement.scale.is_some_and(|scale| scale > 1.0), "{:?}", after.placement);
}

#[test]
fn a_mouse_that_is_no_script_orbits_too() {
    let Some(display) = Display::open() else { return };
    if Command::new("xdotool").arg("version").output().is_err() {
        eprintln!("skipped: xdotool is not installed; tools/setup installs it");
        return;
    }
    let place = Place::new();
    let scene = ["--cloud", "room.bsh", "--object", "ball.obj", "--size", "160x120"];
    let script = "wait-still\nremember\nrate\nwait-change\nwait-still\nexpect-changed\nquit\n";
    let mut child = place.command(&display.name, &scene, script).stdout(Stdio::piped()).spawn().expect("relume runs");
    let mut line = String::new();
    BufReader::new(child.stdout.take().expect("a pipe")).read_line(&mut line).expect("a line");
    assert!(line.contains("pictures a second"), "{line}");
    let mouse = "mousemove 20 20 mousedown 1 mousemove 40 30 mousemove 70 40 mouseup 1";
    let moved = Command::new("xdotool").env("DISPLAY", &display.name).args(mouse.split(' ')).status();
    assert!(moved.expect("xdotool runs").success());
    assert!(child.wait().expect("relume ends").success());
}

#[test]
fn windows_of_any_size_and_lost_devices_are_survived() {
    let Some(display) = Display::open() else { return };
    let mut script = "wait-still\n".to_owned();
    for size in ["200x90", "90x200", "300x300", "64x64", "400x100", "161x121", "97x89", "640x360", "128x128", "180x140"]
    {
        writeln!(script, "resize {size}\nframes 2").expect("text");
    }
    script += "wait-still\nscreenshot resized\nminimise\nwait 0.1\nrestore\nframes 2\n";
    script += "lose window\nframes 3\nremember\nlose renderer\nwait-status lost\ndrag 10,10 50,20 4\n";
    script += "wait-still\nexpect-changed\nquit\n";
    let place = Place::new();
    place.plays(&display, &["--validation"], &script);
    let picture = image::open(place.path("resized.png")).expect("a picture");
    assert_eq!((picture.width(), picture.height()), (180, 140));
}

#[test]
fn dropped_files_open_and_bad_ones_change_nothing() {
    let Some(display) = Display::open() else { return };
    let place = Place::new();
    std::fs::write(place.path("notes.txt"), "no scene").expect("a file");
    std::fs::write(place.path("broken.glb"), "no object").expect("a file");
    std::fs::write(place.path("wrong.toml"), "clowd = 1").expect("a file");
    let script = "frames 3\ndrop room.bsh\ndrop small.obj\nwait-still\nremember\n\
        drop notes.txt\nexpect-status notes.txt\ndrop broken.glb\nwait-status broken.glb\n\
        drop none.ply\nwait-status none.ply\ndrop wrong.toml\nexpect-status clowd\nwait-still\nexpect-same\n\
        drop other.ply\nwait-still\nexpect-changed\nremember\n\
        drop ball.obj\nwait-still\nexpect-changed\nsave all.toml\nexpect-status saved\n\
        capture\nwait-status RenderDoc\nquit\n";
    said(&place.command(&display.name, &["--size", "160x120"], script).output().expect("relume runs"));
    let scene = std::fs::read_to_string(place.path("all.toml")).expect("a scene");
    assert!(scene.contains("other.ply") && scene.contains("ball.obj"), "{scene}");
}

#[test]
fn three_hundred_frames_are_silent() {
    let Some(display) = Display::open() else { return };
    let place = Place::new();
    let scene = ["--cloud", "room.bsh", "--object", "ball.obj", "--size", "160x120"];
    let arguments = [&scene[..], &["--validation", "--frames", "300"]].concat();
    said(&place.command(&display.name, &arguments, "drag 10,10 100,50 200\n").output().expect("relume runs"));
}

#[test]
fn a_saved_scene_renders_as_it_was_seen() {
    let Some(display) = Display::open() else { return };
    let place = Place::new();
    let script =
        "wait-still\ndrag 80,60 95,66 5\ndrag 20,20 40,30 5\nwheel 1\nwait-still\nscreenshot seen\nsave s.toml\n";
    place.plays(&display, &[], &format!("{script}quit\n"));
    let again = "wait-still\nscreenshot again\nquit\n";
    said(&place.command(&display.name, &["--scene", "s.toml"], again).output().expect("relume runs"));
    let render = Command::new(env!("CARGO_BIN_EXE_relume"))
        .current_dir(place.folder())
        .args(["render", "--scene", "s.toml", "--out", "rendered.exr"])
        .output()
        .expect("relume runs");
    said(&render);
    let read = |name: &str| read_rgba_exr(&place.path(name)).expect("an EXR");
    let (seen, again, rendered) = (read("seen.exr"), read("again.exr"), read("rendered.exr"));
    assert_eq!((seen.width, seen.height), (160, 120));
    assert!(seen.alpha.iter().filter(|alpha| **alpha > 0.5).count() > 200);
    assert!(seen.alpha == rendered.alpha, "the object is at the same pixels");
    assert!(seen.rgb == rendered.rgb, "and looks the same");
    assert!(seen.rgb == again.rgb, "also when the scene is opened");
}

#[test]
fn what_cannot_be_shown_is_refused_in_one_line() {
    let place = Place::new();
    let run = |display: &str, arguments: &[&str], script: &str| {
        place.command(display, arguments, script).output().expect("relume runs")
    };
    std::fs::write(place.path("unknown.toml"), "cloud = \"room.bsh\"\ncolour = 1\n").expect("a file");
    std::fs::write(place.path("number.toml"), "[camera]\nfov = \"wide\"\n").expect("a file");
    std::fs::write(place.path("no.toml"), "cloud = [").expect("a file");
    refused(&run("", &[], "quit"), &["display"]);
    refused(&run(":none", &[], "quit"), &["display"]);
    refused(&run("", &["--cloud", "none.ply"], "quit"), &["none.ply", "cannot be read"]);
    refused(&run("", &["--scene", "none.toml"], "quit"), &["none.toml"]);
    refused(&run("", &["--scene", "unknown.toml"], "quit"), &["unknown.toml", "line 2", "colour"]);
    refused(&run("", &["--scene", "number.toml"], "quit"), &["number.toml", "fov"]);
    refused(&run("", &["--scene", "no.toml"], "quit"), &["no.toml", "line 1"]);
    refused(&run("", &["--frames", "0"], "quit"), &["--frames"]);
    refused(&run("", &[], "wait-still\ndance\n"), &["script", "line 2", "dance"]);
    refused(&run("", &["--probes", "none.exr"], "quit"), &["none.exr"]);
    refused(&run("", &["--probes", "a.exr", "--environment", "b.exr"], "quit"), &["--environment", "--probes"]);
    refused(&run("", &["--turn", "-9"], "quit"), &["--turn", "--probes"]);
    refused(&run("", &["--late", "wait"], "quit"), &["--probes"]);
    let render = Command::new(env!("CARGO_BIN_EXE_relume"))
        .current_dir(place.folder())
        .args(["render", "--scene", "unknown.toml", "--out", "x.png"])
        .output()
        .expect("relume runs");
    refused(&render, &["unknown.toml", "colour"]);
    let Some(display) = Display::open() else { return };
    refused(&run(&display.name, &["--size", "80x80"], "expect-status nothing\n"), &["script", "line 1", "nothing"]);
    refused(&run(&display.name, &["--device", "toaster"], "wait 5\n"), &["toaster"]);
}

#[test]
fn a_renderer_that_changes_renders_as_a_new_one_does() {
    use relume::Error;
    use relume::frames::{GpuScene, MaterialChoice, Paper, Renderer, Settings, Technique};
    use relume::scene::{Camera, Placement};
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;

    let device = common::Device::new();
    let hierarchy = build(&box_cloud(Vec3::ONE, 2000, |p, _| vec3(0.5, 0.4, 0.3) * (1.2 + p.y)));
    let scene = GpuScene::new(&device.0, &hierarchy, None, Paper::NONE).expect("a scene");
    let object = ball(0.2);
    let moved = Placement { at: Some(vec3(0.2, -0.3, 0.1).into()), scale: 1.4, turn: 30.0, ..Placement::default() };
    let world = moved.world_from_object(glam::DVec3::ZERO);
    let camera = Camera::framing(vec3(0.2, -0.3, 0.1), 0.4);
    for technique in [Technique::Shared, Technique::Classic] {
        let first = Settings { technique, microbuffer: 12, width: 96, height: 64, ..Settings::default() };
        let first = Settings { material: MaterialChoice::Diffuse(0.1), ..first };
        let material = MaterialChoice::Diffuse(0.8);
        let placed = object.clone().transformed(world);
        let settings = Settings { material, ..first };
        let mut new = Renderer::new(&device.0, &hierarchy, &placed, None, settings).expect("a renderer");
        new.resize(56, 40).expect("a size");
        let expected = new.render(&camera, &mut |_, _| {}).expect("a frame");
        let mut renderer = Renderer::with_scene(&device.0, &scene, &object, first).expect("a renderer");
        let whole = renderer.render(&camera, &mut |_, _| {}).expect("a frame");
        assert_eq!(whole.rgba.len(), 96 * 64);
        renderer.place(&object.transformed_vertices(world)).expect("a place");
        renderer.resize(56, 40).expect("a size");
        assert!(renderer.set_material(material) && !renderer.set_material(MaterialChoice::File));
        let stop = Arc::new(AtomicBool::new(true));
        renderer.stop_when(Some(stop));
        assert!(matches!(renderer.render(&camera, &mut |_, _| {}), Err(Error::Stopped)));
        renderer.stop_when(None);
        let frame = renderer.render(&camera, &mut |_, _| {}).expect("a frame");
        let differ = |(a, b): &(&[f32; 4], &[f32; 4])| a != b;
        assert_eq!(frame.rgba.iter().zip(&expected.rgba).filter(differ).count(), 0, "{technique}");
        assert!(frame.stats.covered_pixels > 100);
        assert!(renderer.place(&object.vertices[1..]).is_err() && renderer.resize(97, 20).is_err());
    }
}

#[cfg(feature = "hot-reload")]
#[test]
fn a_shader_that_breaks_in_the_window_keeps_the_old_one() {
    let Some(display) = Display::open() else { return };
    let place = Place::new();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("glsl");
    let copied = Command::new("cp").arg("-r").arg(&source).arg(place.path("glsl")).status();
    assert!(copied.expect("cp runs").success());
    let scene = ["--cloud", "room.bsh", "--object", "ball.obj", "--size", "160x120"];
    let script = "wait-still\nremember\nrate\nwait-status the old shaders stay\ndrag 20,20 60,40 6\nwait-still\n\
        expect-changed\nrate\nwait-status compiled anew\nwait-still\nquit\n";
    let mut command = place.command(&display.name, &scene, script);
    let mut child = command.env("RELUME_GLSL", place.path("glsl")).stdout(Stdio::piped()).spawn().expect("relume runs");
    let mut lines = BufReader::new(child.stdout.take().expect("a pipe")).lines();
    let file = place.path("glsl/tile_convolve/tile_convolve.comp");
    let good = std::fs::read_to_string(&file).expect("a shader");
    lines.next().expect("a line").expect("text");
    std::fs::write(&file, good.replace("void main()", "void main(")).expect("a shader");
    lines.next().expect("a line").expect("text");
    std::fs::write(&file, good).expect("a shader");
    assert!(child.wait().expect("relume ends").success());
}

/// A compiler that knows the built-in shaders, and files that say they are broken or are another shader.
fn compile(root: &Path, file: &Path) -> Option<Result<Vec<u8>, String>> {
    let text = std::fs::read_to_string(file).expect("a shader");
    let name = file.strip_prefix(root).expect("below the root").to_string_lossy().into_owned();
    if text == "broken" {
        return Some(Err(format!("{name}:1: error: broken")));
    }
    let name = if text.is_empty() { name } else { text };
    let words = relume::gpu::shaders::spirv(&name).expect("a shader");
    Some(Ok(words.iter().flat_map(|word| word.to_le_bytes()).collect()))
}

#[test]
fn a_broken_shader_keeps_the_old_one() {
    use relume::gpu::reload::Reload;
    use relume::gpu::shaders;

    let folder = TempDir::new().expect("a folder");
    let (name, other) = ("refine/refine.comp", "bin/place.comp");
    let file = folder.path().join(name);
    std::fs::create_dir(folder.path().join("refine")).expect("a folder");
    std::fs::write(&file, "").expect("a shader");
    let mut reload = Reload::new(folder.path().to_owned(), compile);
    assert!(!reload.changed());
    let built_in = shaders::spirv(name).expect("a shader");

    std::fs::write(&file, "broken").expect("a shader");
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(2);
    std::fs::File::open(&file).and_then(|file| file.set_modified(later)).expect("a time");
    assert!(reload.changed() && !reload.changed());
    let error = reload.compile().expect_err("a broken shader");
    assert!(error.contains("refine.comp:1"), "{error}");
    assert_eq!(shaders::spirv(name).expect("a shader"), built_in);

    std::fs::write(&file, other).expect("a shader");
    let before = reload.compile().expect("a shader that compiles");
    assert_eq!(shaders::spirv(name).expect("a shader"), shaders::spirv(other).expect("a shader"));
    assert_ne!(shaders::spirv(name).expect("a shader"), built_in);
    shaders::replace(before);
    assert_eq!(shaders::spirv(name).expect("a shader"), built_in, "and back");
}
