//! `relume bake`: rooms from panoramas, as a library and on the command line.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::process::{Command, Output};

use glam::{DVec3, Vec3, vec3};
use relume::Error;
use relume::formats::cloud::{CloudOptions, load};
use relume::formats::image::{ExrLayers, write_exr};
use relume::preprocess::panorama_room::{PanoramaRoom, panorama_room};
use relume::scene::{Cloud, FarField};
use tempfile::TempDir;

const ROOM: PanoramaRoom = PanoramaRoom { size: vec3(6.0, 3.0, 5.0), eye_height: 1.2, points: 60_000, seed: 1 };

/// A panorama of `2 height x height` texels.
fn panorama(height: u32, radiance: impl Fn(u32, u32) -> Vec3) -> FarField {
    let width = 2 * height;
    FarField { width, height, radiance: (0..width * height).map(|i| radiance(i % width, i / width)).collect() }
}

/// Radiance times solid angle, summed over all texels.
fn energy(panorama: &FarField) -> DVec3 {
    let row_angle = PI / f64::from(panorama.height);
    let texel = |i: usize| {
        let top = (i / panorama.width as usize) as f64 * row_angle;
        (top.cos() - (top + row_angle).cos()) * TAU / f64::from(panorama.width)
    };
    panorama.radiance.iter().enumerate().map(|(i, radiance)| radiance.as_dvec3() * texel(i)).sum()
}

/// The same over the points of a room as they are seen from its eye.
fn energy_seen(cloud: &Cloud, eye_height: f32) -> DVec3 {
    let eye = DVec3::new(0.0, eye_height.into(), 0.0);
    let seen = |i: usize| {
        let to_point = cloud.positions[i].as_dvec3() - eye;
        let cosine = -to_point.normalize().dot(cloud.normals[i].as_dvec3());
        cloud.colors[i].as_dvec3() * f64::from(cloud.spacing[i]).powi(2) * cosine / to_point.length_squared()
    };
    (0..cloud.len()).map(seen).sum()
}

#[track_caller]
fn assert_near(measured: DVec3, expected: DVec3) {
    let error = (measured / expected - 1.0).abs().max_element();
    assert!(error < 0.01, "{measured} for {expected}, off by {error}");
}

#[test]
fn a_room_has_its_area_inward_normals_and_even_points() {
    let sky = panorama(8, |_, _| Vec3::ONE);
    for (size, points) in [
        (ROOM.size, 60_000),
        (ROOM.size, 6),
        (vec3(1.0, 1.0, 1.0), 601),
        // A corridor whose ends are narrower than a cell, and a shaft.
        (vec3(0.01, 3.0, 900.0), 5_000),
        (vec3(0.5, 10_000.0, 0.02), 5_000),
    ] {
        let cloud = panorama_room(&sky, &PanoramaRoom { size, points, eye_height: 0.4 * size.y, seed: 1 }).unwrap();
        assert!((cloud.len() as f64 / points as f64 - 1.0).abs() < 0.03, "{} for {points}", cloud.len());
        assert_eq!(
            (cloud.normals.len(), cloud.spacing.len(), cloud.colors.len()),
            (cloud.len(), cloud.len(), cloud.len())
        );
        let area: f64 = cloud.spacing.iter().map(|&s| f64::from(s).powi(2)).sum();
        let expected = f64::from(2.0 * (size.x * size.y + size.y * size.z + size.z * size.x));
        assert!((area / expected - 1.0).abs() < 1e-4, "{area} for {expected}");
        let half = vec3(0.5 * size.x, 0.5 * size.y, 0.5 * size.z);
        for (position, normal) in cloud.positions.iter().zip(&cloud.normals) {
            let from_centre = *position - vec3(0.0, half.y, 0.0);
            assert!((from_centre.abs() - half).max_element() <= 1e-3 * half.max_element());
            let axis = [0, 1, 2].into_iter().find(|&axis| normal[axis] != 0.0).unwrap();
            assert_eq!(*normal, Vec3::AXES[axis] * -from_centre[axis].signum());
            assert!((from_centre[axis].abs() / half[axis] - 1.0).abs() < 1e-5);
        }
        assert!(cloud.colors.iter().all(|color| (*color - Vec3::ONE).abs().max_element() < 1e-5));
    }
    let cloud = panorama_room(&sky, &ROOM).unwrap();
    // Square cells of one size; points near their middles.
    assert!(cloud.spacing.iter().all(|s| (s / cloud.spacing[0] - 1.0).abs() < 0.02));
    let complete = relume::preprocess::spacing::estimate(&cloud.positions, 16).unwrap();
    let near = complete.iter().zip(&cloud.spacing).filter(|(a, b)| (*a / *b - 1.0).abs() < 0.5).count();
    assert!(near as f64 > 0.99 * cloud.len() as f64, "{near} of {}", cloud.len());
}

#[test]
fn directions_are_those_of_the_panorama() {
    let direction = vec3(0.3, -0.2, -0.9);
    // Where the panorama is bright is where the room is, from the eye.
    let sky = panorama(64, |x, y| {
        let (phi, theta) = ((f64::from(x) + 0.5) / 128.0 * TAU - PI, (f64::from(y) + 0.5) / 64.0 * PI);
        let texel = DVec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos()).as_vec3();
        Vec3::splat(1.0 + texel.dot(direction.normalize()))
    });
    let cloud = panorama_room(&sky, &ROOM).unwrap();
    for (position, color) in cloud.positions.iter().zip(&cloud.colors) {
        let expected = 1.0 + (*position - vec3(0.0, ROOM.eye_height, 0.0)).normalize().dot(direction.normalize());
        assert!((color.x - expected).abs() < 0.03, "{position}: {color} for {expected}");
    }
}

/// A dim sky with a sun of one texel at (x, y), fractions of the panorama, that has three quarters of all light.
fn sunny(height: u32, x: f64, y: f64) -> FarField {
    let dim = vec3(1.0, 0.5, 0.25);
    let (column, row) = ((x * 2.0 * f64::from(height)) as u32, (y * f64::from(height)) as u32);
    let texel = (PI / f64::from(height)).powi(2) * (y * PI).sin();
    let sun = dim * (3.0 * 4.0 * PI / texel) as f32;
    panorama(height, |x, y| if (x, y) == (column, row) { sun } else { dim })
}

const SUNS: [(f64, f64); 5] = [(0.1, 0.3), (0.5, 0.5), (0.83, 0.62), (0.999, 0.2), (0.25, 0.45)];

#[test]
fn energy_is_neither_lost_nor_doubled() {
    // Cells that are smaller than texels, and larger.
    for (height, points) in [(16, 60_000), (256, 400_000), (600, 800_000)] {
        for (x, y) in SUNS {
            let sky = sunny(height, x, y);
            let cloud = panorama_room(&sky, &PanoramaRoom { points, ..ROOM }).unwrap();
            assert_near(energy_seen(&cloud, ROOM.eye_height), energy(&sky));
        }
    }
}

#[test]
fn a_sun_far_smaller_than_a_cell_keeps_its_energy() {
    // From the middle of a cube all faces look the same, and so do their quarters.
    for points in [6, 24] {
        for (x, y) in SUNS {
            let sky = sunny(256, x, y);
            let cube = PanoramaRoom { size: Vec3::splat(2.0), eye_height: 1.0, points, seed: 1 };
            let cloud = panorama_room(&sky, &cube).unwrap();
            assert_eq!(cloud.len(), points);
            let sum: DVec3 = cloud.colors.iter().map(|color| color.as_dvec3()).sum();
            assert_near(sum * (4.0 * PI / points as f64), energy(&sky));
        }
    }
}

#[test]
fn the_same_whatever_the_threads_and_other_places_for_another_seed() {
    let sky = panorama(32, |x, y| vec3(x as f32, y as f32, 1.0));
    let run = |threads: usize, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| panorama_room(&sky, &PanoramaRoom { seed, ..ROOM })).unwrap()
    };
    let (one, three, other) = (run(1, 1), run(3, 1), run(3, 2));
    assert_eq!((&one.positions, &one.colors), (&three.positions, &three.colors));
    assert_ne!(one.positions, other.positions);
    assert_eq!(one.colors, other.colors);
}

#[test]
fn options_out_of_bounds() {
    let sky = panorama(2, |_, _| Vec3::ONE);
    let refused = |options: PanoramaRoom| panorama_room(&sky, &options).unwrap_err().to_string();
    for side in [0.0, -1.0, f32::NAN, f32::INFINITY, 0.001, 20_000.0] {
        let message = refused(PanoramaRoom { size: vec3(3.0, 3.0, side), ..ROOM });
        assert!(message.contains("0.01 to 10000 m on each side"), "{message}");
    }
    for eye_height in [0.0, -1.0, 3.0, f32::NAN] {
        assert!(refused(PanoramaRoom { eye_height, ..ROOM }).contains("above 0 and below its height of 3 m"));
    }
    for points in [0, 5, usize::MAX] {
        let error = panorama_room(&sky, &PanoramaRoom { points, ..ROOM }).unwrap_err();
        assert!(matches!(&error, Error::Limit(m) if m.contains("6 to 33554432 points")), "{error}");
    }
    let none = FarField { width: 0, height: 0, radiance: Vec::new() };
    assert!(panorama_room(&none, &ROOM).is_err());
    // As near to the floor as can be said.
    let cloud = panorama_room(&sky, &PanoramaRoom { eye_height: f32::MIN_POSITIVE, points: 600, ..ROOM }).unwrap();
    assert!(cloud.colors.iter().all(|color| color.is_finite()));
}

/// A folder with a panorama `sky.exr`.
fn place() -> TempDir {
    let dir = TempDir::new().unwrap();
    let rgb: Vec<Vec3> = (0..32).map(|i| Vec3::splat(i as f32)).collect();
    let layers = ExrLayers { width: 8, height: 4, rgb: &rgb, alpha: None, groups: &[] };
    write_exr(&dir.path().join("sky.exr"), &layers).unwrap();
    dir
}

fn bake(folder: &Path, flags: &str) -> Output {
    let arguments = ["bake"].into_iter().chain(flags.split_whitespace());
    Command::new(env!("CARGO_BIN_EXE_relume")).current_dir(folder).args(arguments).output().unwrap()
}

#[test]
fn a_panorama_becomes_a_cloud() {
    let dir = place();
    let output = bake(dir.path(), "--panorama sky.exr --box 4x2.5X3 --points 5000 -o room.ply");
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && output.stderr.is_empty(), "{text}");
    let cloud = load(&dir.path().join("room.ply"), &CloudOptions::default()).unwrap();
    assert_eq!(text.lines().count(), 1);
    assert!(text.contains(&format!("{} points", cloud.len())) && text.contains("4 x 2.5 x 3 m: room.ply"), "{text}");
    let top = cloud.positions.iter().fold(0.0_f32, |top, p| top.max(p.y));
    assert_eq!(top, 2.5);
    // The default eye sees the horizon, the middle of the panorama's rows, at half of the height.
    let brighter_below = cloud.positions.iter().zip(&cloud.colors).filter(|(p, _)| p.y == 0.0).map(|(_, c)| c.x);
    let darker_above = cloud.positions.iter().zip(&cloud.colors).filter(|(p, _)| p.y == 2.5).map(|(_, c)| c.x);
    assert!(brighter_below.fold(f32::INFINITY, f32::min) > darker_above.fold(0.0, f32::max));
}

#[test]
fn bad_input_is_one_line_and_leaves_nothing() {
    let dir = place();
    std::fs::write(dir.path().join("text.exr"), "no image").unwrap();
    std::fs::write(dir.path().join("photo.png"), "no image").unwrap();
    std::fs::create_dir(dir.path().join("folder.ply")).unwrap();
    let good = "--panorama sky.exr --box 4x3x5 --points 600 -o room.ply";
    let cases: &[(&str, &str, &[&str])] = &[
        ("sky.exr", "text.exr", &["text.exr", "not a readable EXR file"]),
        ("sky.exr", "photo.png", &["photo.png", "expected .exr or .hdr"]),
        ("sky.exr", "none.exr", &["none.exr", "cannot be read"]),
        ("4x3x5", "4x3", &["--box", "4x3", "WxHxD", "0.01 to 10000"]),
        ("4x3x5", "4x3x5x6", &["--box", "WxHxD"]),
        ("4x3x5", "0x3x5", &["--box", "0x3x5", "0.01 to 10000"]),
        ("4x3x5", "4x-3x5", &["--box", "4x-3x5"]),
        ("4x3x5", "-4x3x5", &["--box", "-4x3x5"]),
        ("4x3x5", "4x3xnan", &["--box", "4x3xnan"]),
        ("4x3x5", "4xinfx5", &["--box", "4xinfx5"]),
        ("4x3x5", "4x3x20000", &["--box", "10000"]),
        ("4x3x5", "4,3,5", &["--box", "WxHxD"]),
        ("600", "5", &["--points", "6 to 33554432"]),
        ("600", "33554433", &["--points", "33554433", "6 to 33554432"]),
        ("600", "-1", &["--points", "6 to 33554432"]),
        ("600", "1e5", &["--points", "1e5"]),
        ("600", "600 --eye-height 3", &["--eye-height", "not below the room's height of 3 m"]),
        ("600", "600 --eye-height 0", &["--eye-height", "above 0"]),
        ("600", "600 --eye-height nan", &["--eye-height", "nan"]),
        ("room.ply", "room.exr", &["room.exr", "must end in .ply"]),
        ("room.ply", "none/room.ply", &["none/room.ply", "no folder none"]),
        ("room.ply", "folder.ply", &["folder.ply", "is a folder"]),
        ("--panorama sky.exr", "", &["--panorama"]),
        ("--box 4x3x5", "", &["--box"]),
        ("-o room.ply", "", &["--out"]),
    ];
    for (from, to, parts) in cases {
        let output = bake(dir.path(), &good.replace(from, to));
        let line = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{to}: {line}");
        assert!(output.stdout.is_empty() && line.trim_end().lines().count() == 1, "{to}: {line}");
        for part in *parts {
            assert!(line.contains(part), "{line:?} does not say {part:?}");
        }
        let mut left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        left.sort();
        assert_eq!(left, ["folder.ply", "photo.png", "sky.exr", "text.exr"], "{to}");
    }
}
