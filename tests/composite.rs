//! The object in the scan: which is in front, the object's shadow, and `render --backdrop`.

mod common;

use std::sync::Arc;

use assert_cmd::Command;
use common::{Device, Random, ball};
use glam::{Affine3A, Vec3, vec3};
use relume::formats::image;
use relume::frames::composite::{Backdrop, compose};
use relume::frames::points::{PointDisplay, PointFrame, PointRenderer, PointSettings, ShadowCaster};
use relume::frames::{Frame, MaterialChoice, Renderer, Settings};
use relume::preprocess::distance_field::DistanceField;
use relume::preprocess::point_chunks::PointChunks;
use relume::scene::{Camera, Cloud, FarField, Object};

const SIZE: u32 = 128;

fn ball_at(radius: f32, at: Vec3) -> Object {
    ball(radius).transformed(Affine3A::from_translation(at))
}

/// Points on a grid over a rectangle.
fn sheet(cloud: &mut Cloud, corner: Vec3, u: Vec3, v: Vec3, spacing: f32, color: Vec3) {
    let (columns, rows) = ((u.length() / spacing) as usize, (v.length() / spacing) as usize);
    let mut random = Random(3);
    for k in 0..columns * rows {
        let (a, b) = ((k % columns) as f32 + random.next(), (k / columns) as f32 + random.next());
        cloud.positions.push(corner + u * (a / columns as f32) + v * (b / rows as f32));
        cloud.normals.push(u.cross(v).normalize());
        cloud.colors.push(color);
        cloud.spacing.push(spacing);
    }
}

fn points(device: &Device, cloud: &Cloud, camera: &Camera, shadow: Option<(&Object, Affine3A)>) -> PointFrame {
    let chunks = Arc::new(PointChunks::new(cloud).expect("few points"));
    let settings = PointSettings { width: SIZE, height: SIZE, ..PointSettings::default() };
    let mut renderer = PointRenderer::new(&device.0, &chunks, settings).expect("a renderer");
    let field = shadow.map(|(object, world_from_object)| (DistanceField::new(object), world_from_object));
    let caster = field.as_ref().map(|(field, world_from_object)| ShadowCaster {
        field,
        world_from_object: *world_from_object,
        far_field: None,
    });
    renderer.cast_shadow(caster).expect("a shadow");
    renderer.render(camera).expect("a picture")
}

/// A ball that stands half behind a wall of points, which ends in the middle of the picture.
fn half_hidden(device: &Device) -> (Frame, PointFrame, Camera, Cloud) {
    let mut cloud = Cloud::default();
    sheet(&mut cloud, vec3(-3.0, -3.0, 0.8), Vec3::X * 3.0, Vec3::Y * 6.0, 0.02, vec3(0.1, 0.2, 0.9));
    sheet(&mut cloud, vec3(-3.0, -3.0, -2.0), Vec3::X * 6.0, Vec3::Y * 6.0, 0.02, vec3(0.2, 0.8, 0.2));
    let camera = Camera { from: vec3(0.0, 0.0, 4.0), at: Vec3::ZERO, fov_y: 30_f32.to_radians() };
    let settings = Settings { material: MaterialChoice::Diffuse(0.7), width: SIZE, height: SIZE, ..common::settings() };
    let hierarchy = common::build(&cloud);
    let mut renderer =
        Renderer::new(&device.0, &hierarchy, &ball_at(0.5, Vec3::ZERO), None, settings).expect("a renderer");
    let frame = renderer.render(&camera, &mut |_, _| {}).expect("a frame");
    let scan = points(device, &cloud, &camera, None);
    (frame, scan, camera, cloud)
}

#[test]
fn what_is_nearer_hides_what_is_behind() {
    let device = Device::new();
    let (frame, scan, camera, _) = half_hidden(&device);
    let backdrop = Backdrop { points: Some(&scan), environment: None, tolerance: 0.02 };
    let composite = compose(&frame, &camera, backdrop);
    let (mut ball_left, mut ball_right, mut wall, mut behind) = (0, 0, 0, 0);
    for (at, rgb) in composite.rgb.iter().enumerate() {
        let x = at as u32 % SIZE;
        let is = |r: f32, g: f32, b: f32| (*rgb - vec3(r, g, b)).abs().max_element() < 0.02;
        let object = composite.object[at] > 0.0;
        ball_left += u32::from(object && x + 2 < SIZE / 2);
        ball_right += u32::from(object && x > SIZE / 2);
        wall += u32::from(x + 2 < SIZE / 2 && is(0.1, 0.2, 0.9));
        behind += u32::from(x > SIZE / 2 + 1 && !object && is(0.2, 0.8, 0.2));
    }
    let half_ball = frame.rgba.iter().filter(|c| c[3] > 0.0).count() as u32 / 2;
    // The wall's points end up to a spacing short of its edge.
    assert!(ball_left * 100 < half_ball, "the wall hides the ball's left half: {ball_left} of {half_ball} pixels");
    assert!(ball_right.abs_diff(half_ball) < half_ball / 8, "{ball_right} of {half_ball} pixels of the right half");
    assert!(wall > SIZE * SIZE * 47 / 100, "{wall} pixels of wall");
    assert!(behind > (SIZE * SIZE / 2 - half_ball) * 9 / 10, "{behind} pixels of ground");
    // Without a backdrop the picture is the object's, and transparent around it.
    let alone = compose(&frame, &camera, Backdrop::default());
    assert!(alone.backdrop.is_empty());
    assert!(alone.alpha.iter().zip(&frame.rgba).all(|(a, c)| *a == c[3]));
    // The far field fills what is left.
    let far_field = FarField { width: 1, height: 1, radiance: vec![vec3(3.0, 2.0, 1.0)] };
    let environment = compose(&frame, &camera, Backdrop { environment: Some(&far_field), ..Backdrop::default() });
    assert_eq!(environment.rgb[0], vec3(3.0, 2.0, 1.0));
    assert!(environment.alpha.iter().all(|a| *a == 1.0));
}

/// Share of a white hemisphere that a ball leaves open above a point of a floor, by rays.
fn open_share(place: Vec3, centre: Vec3, radius: f32) -> f32 {
    let mut random = Random(11);
    let count = 4000;
    let open = (0..count).filter(|_| {
        let (a, b) = (random.next(), std::f32::consts::TAU * random.next());
        let direction = vec3(a.sqrt() * b.cos(), (1.0 - a).sqrt(), a.sqrt() * b.sin());
        let to = centre - place;
        let along = to.dot(direction);
        along < 0.0 || to.length_squared() - along * along > radius * radius
    });
    open.count() as f32 / count as f32
}

#[test]
fn the_contact_shadow_is_what_the_ball_takes_of_a_white_surround() {
    let device = Device::new();
    let mut cloud = Cloud::default();
    let white = Vec3::ONE;
    for (corner, u, v) in [
        (vec3(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0),
        (vec3(-2.0, 4.0, -2.0), Vec3::X * 4.0, Vec3::Z * 4.0),
        (vec3(-2.0, 0.0, -2.0), Vec3::X * 4.0, Vec3::Y * 4.0),
        (vec3(-2.0, 0.0, 2.0), Vec3::Y * 4.0, Vec3::X * 4.0),
        (vec3(-2.0, 0.0, -2.0), Vec3::Y * 4.0, Vec3::Z * 4.0),
        (vec3(2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::Y * 4.0),
    ] {
        sheet(&mut cloud, corner, u, v, 0.02, white);
    }
    let (radius, centre) = (0.3, vec3(0.0, 0.3, 0.0));
    let camera = Camera { from: vec3(0.0, 1.2, 1.9), at: vec3(0.0, 0.1, 0.0), fov_y: 50_f32.to_radians() };
    // The field is the object's own: a ball of half the size around the origin.
    let world_from_object =
        Affine3A::from_scale_rotation_translation(Vec3::splat(2.0), glam::Quat::from_rotation_y(0.7), centre);
    let frame = points(&device, &cloud, &camera, Some((&ball(0.5 * radius), world_from_object)));
    let (_, _, forward) = camera.basis();
    let (mut sum2, mut count, mut darkest) = (0.0_f32, 0, 1.0_f32);
    for (at, left) in frame.shadow.iter().enumerate().step_by(7) {
        let (x, y) = (at as u32 % SIZE, at as u32 / SIZE);
        let direction = camera.ray_direction(x, y, SIZE, SIZE);
        let place = camera.from + direction * (frame.color_depth[at][3] / direction.dot(forward));
        let away = place.distance(vec3(0.0, 0.0, 0.0));
        // The floor, close enough for a shadow and not right under the ball.
        if place.y.abs() > 0.01 || !(0.1..0.7).contains(&away) {
            continue;
        }
        let expected = open_share(vec3(place.x, 0.0, place.z), centre, radius);
        sum2 += (left[0] - expected).powi(2);
        count += 1;
        darkest = darkest.min(left[0]);
        assert!((left[0] - left[1]).abs() < 1e-3 && (left[0] - left[2]).abs() < 1e-3, "white light stays white");
    }
    let rms = (sum2 / count as f32).sqrt();
    println!("RMS {rms:.3} over {count} pixels, darkest {darkest:.2}");
    assert!(count > 150 && rms < 0.08, "RMS {rms:.3} over {count} pixels");
    assert!(darkest < 0.45, "{darkest}");
    let without = points(&device, &cloud, &camera, None);
    assert!(without.shadow.is_empty());
    assert_eq!(without.color_depth, frame.color_depth, "the shadow changes nothing else");
}

#[test]
fn render_puts_the_object_into_the_scan() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let mut ply = String::from(
        "ply\nformat ascii 1.0\nelement vertex 4900\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
    );
    for k in 0..4900 {
        ply += &format!("{} 0 {} 200 120 60\n", (k % 70) as f32 / 35.0 - 1.0, (k / 70) as f32 / 35.0 - 1.0);
    }
    std::fs::write(path("floor.ply"), ply).expect("a cloud");
    std::fs::write(path("box.obj"), "v -0.2 0 0\nv 0.2 0 0\nv 0.2 0.4 0\nv -0.2 0.4 0\nf 1 2 3 4\n")
        .expect("an object");
    let render = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relume"));
        command.arg("render").arg("--cloud").arg(path("floor.ply")).arg("--object").arg(path("box.obj"));
        command.args(["--size", "64x48", "--camera-from", "0,0.8,1.6", "--camera-at", "0,0.2,0", "--fov", "50"]);
        command.args(arguments).assert()
    };
    let out = path("points.exr");
    let out = out.to_str().expect("a name");
    render(&["--backdrop", "points", "--out", out, "--stats", path("s.json").to_str().expect("a name")]).success();
    let picture = image::read_rgba_exr(&path("points.exr")).expect("an image");
    let floor = picture.rgb[44 * 64 + 4];
    assert!(floor.x > 2.0 * floor.y && floor.y > floor.z, "the floor's colour: {floor}");
    let layers = exr::meta::MetaData::read_from_file(path("points.exr"), false).expect("a header");
    let names: Vec<String> = layers.headers[0].channels.list.iter().map(|c| c.name.to_string()).collect();
    for name in ["R", "object.R", "object.A", "backdrop.B", "Z"] {
        assert!(names.iter().any(|n| n == name), "{name} in {names:?}");
    }
    let stats = std::fs::read_to_string(path("s.json")).expect("a report");
    for pass in ["points", "hidden points", "pull", "push", "point normals", "shade points", "contact shadow"] {
        assert!(stats.contains(&format!("\"{pass}\"")), "{pass}");
    }
    render(&["--backdrop", "points", "--no-contact-shadow", "--out", path("plain.exr").to_str().expect("a name")])
        .success();
    let plain = image::read_rgba_exr(&path("plain.exr")).expect("an image");
    let darker = picture.rgb.iter().zip(&plain.rgb).filter(|(a, b)| a.x < 0.9 * b.x).count();
    assert!(darker > 10, "{darker} pixels are in the shadow");
    for display in PointDisplay::ALL {
        for tone in ["srgb", "filmic", "agx"] {
            let png = path(&format!("{display}-{tone}.png"));
            render(&[
                "--backdrop",
                "points",
                "--points",
                display.name(),
                "--tone",
                tone,
                "--out",
                png.to_str().expect("a name"),
            ])
            .success();
        }
    }
    for (arguments, said) in [
        (&["--backdrop", "environment"][..], "--environment"),
        (&["--backdrop", "points", "--points", "shiny"], "eye-dome"),
        (&["--backdrop", "points", "--spacing", "0"], "--spacing"),
        (&["--tone", "sepia"], "agx"),
        (&["--backdrop", "points", "--memory-budget", "2"], "MiB"),
    ] {
        let mut all = arguments.to_vec();
        let bad = path("bad.png");
        all.extend(["--out", bad.to_str().expect("a name")]);
        let assert = render(&all).code(2);
        let error = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
        assert!(error.contains(said), "{arguments:?}: {error}");
        assert!(!bad.exists());
    }
}
