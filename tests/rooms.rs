//! Rooms, their baked light and what is gathered in it, held against known answers.

use std::f32::consts::PI;

use glam::Vec3;
use relume::compare::luminance;
use relume::reference::bake::{BakeOptions, BakedRoom, bake};
use relume::reference::gather::{Brdf, Receiver, gather, render_reference};
use relume::reference::rooms::{Rectangle, Room, hall, toy_room};

const DIFFUSE: Brdf = Brdf::Diffuse { albedo: Vec3::ONE };

fn coarse() -> BakeOptions {
    BakeOptions { texel: 0.1, direct_samples: 128, bounced_samples: 512, bounces: 12, seed: 7 }
}

fn baked(room: Room) -> BakedRoom {
    bake(room, &coarse(), &|_| ()).expect("the room is sound")
}

/// A closed cube of 2 m about 0, all faces alike.
fn cube(albedo: f32, emission: f32) -> Room {
    let low = Vec3::splat(-1.0);
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let faces = [(low, z, x), (low + y, x, z), (low, y, z), (low + x, z, y), (low, x, y), (low + z, y, x)];
    let face = |(corner, u, v)| Rectangle {
        emission: Vec3::splat(emission),
        ..Rectangle::new(corner, u, v, Vec3::splat(albedo))
    };
    Room { surfaces: faces.map(face).to_vec() }
}

/// A black floor of 4 m about 0 that faces up, and a lamp of radiance 1.
fn floor_and(corner: Vec3, edge_u: Vec3, edge_v: Vec3) -> Room {
    let floor = Rectangle::new(Vec3::new(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, Vec3::ONE);
    let lamp = Rectangle { emission: Vec3::ONE, ..Rectangle::new(corner, edge_u, edge_v, Vec3::ZERO) };
    Room { surfaces: vec![floor, lamp] }
}

/// Form factor from a point at 0 with normal +Y to a rectangle, by brute force.
fn form_factor(corner: Vec3, edge_u: Vec3, edge_v: Vec3) -> f32 {
    const N: u32 = 1000;
    let (normal, area) = (edge_u.cross(edge_v).normalize(), edge_u.cross(edge_v).length());
    let mut sum = 0.0_f64;
    for n in 0..N * N {
        let at = corner + edge_u * ((n % N) as f32 + 0.5) / N as f32 + edge_v * ((n / N) as f32 + 0.5) / N as f32;
        let (direction, distance) = at.normalize_and_length();
        sum += f64::from(direction.y.max(0.0) * (-direction.dot(normal)).max(0.0) / (distance * distance));
    }
    (sum / f64::from(N * N)) as f32 * area / PI
}

fn assert_near(what: &str, actual: f32, expected: f32, tolerance: f32) {
    assert!((actual - expected).abs() <= tolerance, "{what}: {actual}, expected {expected} within {tolerance}");
}

#[test]
fn white_furnace() {
    // emission 0.5 + 0.25 + 0.125 ... = 1, everywhere
    let room = baked(cube(0.5, 0.5));
    for (surface, u, v) in [(0, 0.5, 0.5), (1, 0.2, 0.9), (3, 0.5, 0.02), (5, 0.7, 0.4)] {
        assert_near("furnace", room.radiance_at(surface, u, v).x, 1.0, 0.02);
    }
    assert_near("furnace, traced", room.trace(Vec3::splat(0.3), Vec3::X).y, 1.0, 0.02);
    let receiver = Receiver { position: Vec3::ZERO, normal: Vec3::Y, view: Vec3::Y };
    assert_near("furnace, diffuse object", gather(&room, &receiver, DIFFUSE, 256, 1).z, 1.0, 0.02);
    let path_traced = room.tracer().radiance(Vec3::ZERO, Vec3::new(0.6, 0.0, 0.8), 4096, 1);
    assert_near("furnace, path traced", path_traced.x, 1.0, 0.02);
}

#[test]
fn what_a_lamp_emits_is_absorbed() {
    let mut room = cube(0.6, 0.0);
    room.surfaces[2].albedo = Vec3::new(0.9, 0.2, 0.5);
    room.surfaces[0].emission = Vec3::new(2.0, 1.0, 3.0);
    let room = baked(room);
    let (mut emitted, mut absorbed) = (Vec3::ZERO, Vec3::ZERO);
    const N: u32 = 40;
    for (index, surface) in room.room().surfaces.iter().enumerate() {
        emitted += surface.emission * PI * surface.area();
        for n in 0..N * N {
            let (u, v) = (((n % N) as f32 + 0.5) / N as f32, ((n / N) as f32 + 0.5) / N as f32);
            let reflected = room.radiance_at(index, u, v) - surface.emission;
            let irradiance = reflected * PI / surface.albedo;
            absorbed += irradiance * (1.0 - surface.albedo) * surface.area() / (N * N) as f32;
        }
    }
    for channel in 0..3 {
        let (emitted, absorbed) = (emitted[channel], absorbed[channel]);
        assert_near("absorbed power", absorbed / emitted, 1.0, 0.01);
    }
}

#[test]
fn one_lamp_has_its_form_factor() {
    // a point under the middle of a parallel square of 2 m at 1 m: four corners of X = Y = 1 (Howell's B-3)
    let (corner, u, v) = (Vec3::new(-1.0, 1.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0);
    let root = 2.0_f32.sqrt();
    let analytic = 4.0 * (2.0 / root * (1.0 / root).atan()) / (2.0 * PI);
    assert_near("quadrature", form_factor(corner, u, v), analytic, 1e-4);
    let upright = (Vec3::new(0.5, 0.0, -1.0), Vec3::Z * 2.0, Vec3::Y * 1.5);
    for (name, (corner, u, v)) in [("parallel", (corner, u, v)), ("perpendicular", upright)] {
        let expected = form_factor(corner, u, v);
        let room = baked(floor_and(corner, u, v));
        let receiver = Receiver { position: Vec3::ZERO, normal: Vec3::Y, view: Vec3::Y };
        assert_near(name, gather(&room, &receiver, DIFFUSE, 2048, 3).x, expected, 0.01 * expected);
        assert_near(name, room.radiance_at(0, 0.5, 0.5).x, expected, 0.02 * expected);
    }
}

#[test]
fn metal_in_constant_light_has_its_directional_albedo() {
    let room = baked(cube(0.0, 1.0));
    for alpha in [0.0625_f32, 0.25, 0.5, 1.0] {
        for angle in [0.0_f32, 0.7, 1.3] {
            let (normal, view) = (Vec3::Y, Vec3::new(angle.sin(), angle.cos(), 0.0));
            let receiver = Receiver { position: Vec3::ZERO, normal, view };
            let actual = gather(&room, &receiver, Brdf::Metal { alpha }, 4096, 5).x;
            assert_near(&format!("alpha {alpha}, {angle}"), actual, directional_albedo(view, alpha), 0.01);
        }
    }
}

/// Sum over the hemisphere of D G1 G1 / (4 n.v), written the textbook way with tangents.
fn directional_albedo(view: Vec3, alpha: f32) -> f32 {
    const N: u32 = 1500;
    let g1 = |w: Vec3| 2.0 / (1.0 + (1.0 + alpha * alpha * (1.0 / (w.y * w.y) - 1.0)).sqrt());
    let mut sum = 0.0_f64;
    for n in 0..N * N {
        let height = ((n / N) as f32 + 0.5) / N as f32;
        let (sin, cos) = (2.0 * PI * ((n % N) as f32 + 0.5) / N as f32).sin_cos();
        let radius = (1.0 - height * height).sqrt();
        let light = Vec3::new(radius * cos, height, radius * sin);
        let h = (light + view).normalize().y;
        let tan2 = 1.0 / (h * h) - 1.0;
        let d = 1.0 / (PI * alpha * alpha * h.powi(4) * (1.0 + tan2 / (alpha * alpha)).powi(2));
        sum += f64::from(d * g1(light) * g1(view) / (4.0 * view.y));
    }
    (sum / f64::from(N * N)) as f32 * 2.0 * PI
}

#[test]
fn baked_light_agrees_with_the_path_tracer() {
    let room = bake(toy_room(), &BakeOptions { texel: 0.05, ..coarse() }, &|_| ()).expect("the room is sound");
    let origin = Vec3::new(0.1, 1.3, 0.2);
    let (mut baked_sum, mut traced_sum) = (Vec3::ZERO, Vec3::ZERO);
    for n in 0..40_u8 {
        let (sin, cos) = (0.61 * f32::from(n)).sin_cos();
        let direction = Vec3::new(cos, 0.07 * f32::from(n % 23) - 0.8, sin).normalize();
        let (baked, traced) = (room.trace(origin, direction), room.tracer().radiance(origin, direction, 4000, 9));
        // lamps are equal and would outshine the rest
        if luminance(baked) < 2.0 {
            baked_sum += baked;
            traced_sum += traced;
            assert_near(&format!("direction {n}"), luminance(baked) / luminance(traced), 1.0, 0.1);
        }
    }
    assert!((baked_sum / traced_sum - 1.0).abs().max_element() < 0.02, "{baked_sum} and {traced_sum}");
}

#[test]
fn a_scan_is_even_and_shows_no_hidden_surface() {
    let room = baked(toy_room());
    let cloud = room.sample_cloud(20_000, 3);
    assert!(cloud.len().abs_diff(20_000) < 200, "{} points", cloud.len());
    assert!(cloud.normals.iter().all(|n| n.is_normalized()));
    assert!(cloud.colors.iter().all(|c| c.is_finite() && c.min_element() >= 0.0));
    let lamp = room.room().surfaces.iter().map(|s| luminance(s.emission)).fold(0.0, f32::max);
    assert!(cloud.colors.iter().any(|&c| luminance(c) >= lamp), "the lamp is in the scan");
    // the floor under the blue block
    let under = |p: &Vec3| p.y < 1e-3 && (p.x + 1.6).abs() < 0.32 && (p.z - 0.95).abs() < 0.49;
    assert_eq!(cloud.positions.iter().filter(|p| under(p)).count(), 0);
    let spacing = cloud.spacing[0];
    for (index, p) in cloud.positions.iter().enumerate().step_by(97) {
        let others = cloud.positions.iter().enumerate().filter(|(other, _)| *other != index);
        let nearest = others.map(|(_, q)| q.distance(*p)).fold(f32::INFINITY, f32::min);
        assert!(nearest < 1.6 * spacing, "a hole of {nearest} m at {p}");
    }
}

#[test]
fn threads_change_nothing() {
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
        pool.install(|| {
            let options = BakeOptions { texel: 0.2, direct_samples: 16, bounced_samples: 64, bounces: 3, seed: 1 };
            let room = bake(toy_room(), &options, &|_| ()).expect("the room is sound");
            let cloud = room.sample_cloud(5000, 2);
            let receivers = cloud
                .positions
                .iter()
                .zip(&cloud.normals)
                .map(|(&p, &n)| Receiver::seen_from(p + n + Vec3::X * 0.1, p, n));
            let receivers: Vec<_> = receivers.collect();
            let lit =
                render_reference(&room, &receivers, Brdf::Metal { alpha: 0.3 }, 8, &|_| ()).expect("unit vectors");
            (cloud.positions, cloud.colors, lit)
        })
    };
    assert!(on(1) == on(2));
}

#[test]
fn progress_ends_at_one_and_bad_input_is_named() {
    let last = std::sync::Mutex::new(0.0_f32);
    let progress = |done: f32| *last.lock().expect("no panic before") = done;
    bake(cube(0.5, 1.0), &BakeOptions { texel: 0.5, ..coarse() }, &progress).expect("the room is sound");
    assert_eq!(*last.lock().expect("no panic before"), 1.0);

    let error = |room: Room, options: BakeOptions| match bake(room, &options, &|_| ()) {
        Ok(_) => panic!("should not bake"),
        Err(error) => error.to_string(),
    };
    let mut flat = cube(0.5, 1.0);
    flat.surfaces[4].edge_u = flat.surfaces[4].edge_v;
    assert!(error(flat, coarse()).contains("surface 4 has no area"));
    assert!(error(cube(1.5, 1.0), coarse()).contains("albedo"));
    assert!(error(cube(0.5, f32::NAN), coarse()).contains("emission"));
    assert!(error(cube(0.5, 1.0), BakeOptions { texel: 0.0, ..coarse() }).contains("texel"));
    assert!(error(cube(0.5, 1.0), BakeOptions { texel: 1e-5, ..coarse() }).contains("limit"));
    let room = baked(cube(0.5, 1.0));
    let blind = Receiver { position: Vec3::ZERO, normal: Vec3::ZERO, view: Vec3::Y };
    let result = render_reference(&room, &[blind], DIFFUSE, 1, &|_| ());
    assert!(result.is_err_and(|e| e.to_string().contains("receiver 0")));
    assert!(baked(Room::default()).sample_cloud(100, 1).is_empty());
}

#[test]
fn the_hall_is_sound() {
    let room = hall();
    room.check().expect("sound");
    assert!(room.surfaces.len() > 500);
    let options = BakeOptions { texel: 0.4, direct_samples: 16, bounced_samples: 32, bounces: 2, seed: 1 };
    let cloud = bake(room, &options, &|_| ()).expect("sound").sample_cloud(20_000, 1);
    let inside = |p: &Vec3| p.x.abs() < 6.01 && p.y > -0.01 && p.y < 6.51 && p.z.abs() < 10.41;
    assert!(cloud.positions.iter().all(inside));
    let dark = cloud.colors.iter().filter(|c| luminance(**c) < 1e-3).count();
    assert!(dark * 1000 < cloud.len(), "{dark} of {} points are black", cloud.len());
}
