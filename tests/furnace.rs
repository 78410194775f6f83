//! Scenes whose light is known: white all round, half of it, and one bright patch.

mod common;

use common::{Device, ball, box_cloud, build, settings};
use glam::{Vec3, vec3};
use relume::frames::{Frame, MaterialChoice, Paper, Renderer, Settings, Technique};
use relume::preprocess::hierarchy::Hierarchy;
use relume::scene::Camera;

const HALF: Vec3 = Vec3::new(1.0, 0.8, 1.2);

/// How far a diffuse pixel may be from its albedo in a white furnace, relative: measured 2e-4, which is how exactly the
/// micro-pixels' areas add up.
const DIFFUSE: f32 = 1e-3;
/// How far a pixel may be from the half space's answer: measured -0.012
/// and +0.005 (the ball has an extent, and a node at the edge mixes black and white).
const HALF_SPACE: f32 = 0.02;
/// How far a pixel may be from the patch's answer, relative: measured -0.031 and +0.013.
const PATCH: f32 = 0.04;
/// The same for a lamp with sides: measured -0.001 and +0.014.
const LAMP: f32 = 0.025;

fn camera() -> Camera {
    Camera { from: vec3(0.3, 0.25, 0.9), at: Vec3::ZERO, fov_y: 0.55 }
}

fn furnace(material: MaterialChoice) -> Settings {
    Settings { microbuffer: 24, material, ..settings() }
}

fn render(device: &Device, hierarchy: &Hierarchy, settings: Settings) -> Frame {
    let mut renderer = Renderer::new(&device.0, hierarchy, &ball(0.2), None, settings).expect("a renderer");
    renderer.render(&camera(), &mut |_, _| {}).expect("a frame")
}

/// Every covered pixel: normal, position and radiance (grey).
fn covered(frame: &Frame) -> Vec<(Vec3, Vec3, f32)> {
    let mut list = Vec::new();
    for i in 0..frame.rgba.len() {
        let [r, g, b, a] = frame.rgba[i];
        if a > 0.0 {
            assert!(r == g && g == b, "a grey scene is coloured: {:?}", frame.rgba[i]);
            let [x, y, z, _] = frame.normal[i];
            let [px, py, pz, _] = frame.position[i];
            list.push((vec3(x, y, z), vec3(px, py, pz), r));
        }
    }
    assert!(list.len() > 500, "the object covers {} pixels", list.len());
    list
}

fn range(values: &[f32]) -> (f32, f32, f32) {
    let low = values.iter().copied().fold(f32::MAX, f32::min);
    let high = values.iter().copied().fold(f32::MIN, f32::max);
    (low, values.iter().sum::<f32>() / values.len() as f32, high)
}

fn radiances(frame: &Frame) -> Vec<f32> {
    covered(frame).into_iter().map(|(_, _, value)| value).collect()
}

/// Fails where a value lies outside `tolerance` around `wanted`, relative to it.
fn all_within(what: &str, values: &[f32], wanted: f32, tolerance: f32) {
    let (low, mean, high) = range(values);
    println!("{what}: {low} to {high}, mean {mean}");
    let bound = tolerance * wanted;
    assert!(low >= wanted - bound && high <= wanted + bound, "{what}: {low} to {high}, not {wanted} +- {bound}");
}

fn white(count: usize) -> Hierarchy {
    build(&box_cloud(HALF, count, |_, _| Vec3::ONE))
}

#[test]
fn white_all_round_gives_the_albedo() {
    let device = Device::new();
    // Sparse, so that single points are as large as four micro-pixels and more, and dense.
    for (count, white) in [20_000, 60_000].map(|count| (count, white(count))) {
        for technique in Technique::ALL {
            let settings = Settings { technique, ..furnace(MaterialChoice::Diffuse(0.7)) };
            let values = radiances(&render(&device, &white, settings));
            all_within(&format!("{technique}, {count} points"), &values, 0.7, DIFFUSE);
        }
        for microbuffer in [8, 16, 32] {
            let settings = Settings { microbuffer, ..furnace(MaterialChoice::Diffuse(0.7)) };
            let values = radiances(&render(&device, &white, settings));
            all_within(&format!("{microbuffer}, {count} points"), &values, 0.7, 0.01);
        }
    }
}

#[test]
fn the_papers_weights_are_too_bright_by_five_in_a_hundred() {
    let device = Device::new();
    let white = white(20_000);
    let too_bright = std::f32::consts::PI / 3.0;
    let weights = Paper { weights: true, ..Paper::default() };
    for paper in [weights, Paper { coverage: true, ..weights }] {
        let settings = Settings { paper, ..furnace(MaterialChoice::Diffuse(0.7)) };
        let values = radiances(&render(&device, &white, settings));
        all_within(&format!("{paper:?}"), &values, 0.7 * too_bright, 0.005);
    }
}

#[test]
fn white_all_round_a_metal_gives_its_directional_albedo() {
    let device = Device::new();
    let white = white(20_000);
    // A lobe is evaluated at up to 25 points of a micro-pixel: the narrower it is, the less exactly they add up.
    for (alpha, tolerance) in [(1.0, 0.006), (0.5, 0.005), (0.25, 0.03)] {
        let frame = render(&device, &white, furnace(MaterialChoice::Metal(alpha)));
        let shares: Vec<f32> = covered(&frame)
            .into_iter()
            .map(|(n, p, value)| value / metal_albedo(n.dot((camera().from - p).normalize()), alpha))
            .collect();
        all_within(&format!("metal of alpha {alpha}"), &shares, 1.0, tolerance);
    }
}

/// A ball so small that where on it a pixel lies hardly matters.
fn render_small(device: &Device, hierarchy: &Hierarchy, settings: Settings) -> Frame {
    let camera = Camera { from: camera().from * 0.1, ..camera() };
    let mut renderer = Renderer::new(&device.0, hierarchy, &ball(0.02), None, settings).expect("a renderer");
    renderer.render(&camera, &mut |_, _| {}).expect("a frame")
}

#[test]
fn a_bright_half_gives_half_of_one_and_the_cosine() {
    let device = Device::new();
    let upper = build(&box_cloud(HALF, 60_000, |p, _| if p.y > 0.0 { Vec3::ONE } else { Vec3::ZERO }));
    let frame = render_small(&device, &upper, furnace(MaterialChoice::Diffuse(1.0)));
    let errors: Vec<f32> = covered(&frame).into_iter().map(|(n, _, e)| 1.0 + e - 0.5 * (1.0 + n.y)).collect();
    all_within("half", &errors, 1.0, HALF_SPACE);
    let (_, mean, _) = range(&errors);
    assert!((mean - 1.0).abs() < 0.005, "{mean}");
}

/// Irradiance over pi from a polygon of radiance 1, all of it above the horizon (Lambert 1760): the edges' angles
/// times the cosines of their planes' normals.
fn polygon(p: Vec3, n: Vec3, corners: &[Vec3]) -> f32 {
    let mut sum = 0.0;
    for (i, corner) in corners.iter().enumerate() {
        let (a, b) = ((corner - p).normalize(), (corners[(i + 1) % corners.len()] - p).normalize());
        sum += a.angle_between(b) * n.dot(a.cross(b).normalize());
    }
    sum.abs() / std::f32::consts::TAU
}

#[test]
fn a_bright_patch_gives_its_form_factor() {
    let device = Device::new();
    let in_patch = |p: Vec3, n: Vec3| n.y < -0.5 && p.x.abs() < 0.15 && p.z.abs() < 0.15;
    let cloud = box_cloud(HALF, 60_000, |p, n| if in_patch(p, n) { Vec3::splat(10.0) } else { Vec3::ZERO });
    // The patch ends where its points' cells do.
    let lit = || (0..cloud.len()).filter(|i| cloud.colors[*i].x > 0.0);
    let reach = |axis: usize| lit().map(|i| cloud.positions[i][axis] + 0.5 * cloud.spacing[i]).fold(0.0, f32::max);
    let (x, z) = (reach(0), reach(2));
    let corners = [(x, z), (-x, z), (-x, -z), (x, -z)].map(|(x, z)| vec3(x, HALF.y, z));
    let frame = render(&device, &build(&cloud), furnace(MaterialChoice::Diffuse(1.0)));
    let above = |n: Vec3, p: Vec3| corners.iter().all(|c| n.dot((c - p).normalize()) > 0.25);
    let shares: Vec<f32> = covered(&frame)
        .into_iter()
        .filter(|(n, p, _)| above(*n, *p))
        .map(|(n, p, e)| e / (10.0 * polygon(p, n, &corners)))
        .collect();
    assert!(shares.len() > 80, "{} pixels see the whole patch", shares.len());
    all_within("patch", &shares, 1.0, PATCH);
    let (_, mean, _) = range(&shares);
    assert!((mean - 1.0).abs() < 0.01, "{mean}");
}

/// A block that hangs from the ceiling of a black room: its underside sends 50, its sides are black. The ceiling goes on
/// behind it, so near that both belong to one front layer.
fn block_lamp() -> (relume::scene::Cloud, [Vec3; 4]) {
    const HALF_SIDE: f32 = 0.15;
    const TALL: f32 = 0.06;
    const SPACING: f32 = 0.015;
    let mut cloud = box_cloud(HALF, 20_000, |_, _| Vec3::ZERO);
    let mut add = |position: Vec3, normal: Vec3, color: f32| {
        cloud.positions.push(position);
        cloud.normals.push(normal);
        cloud.colors.push(Vec3::splat(color));
        cloud.spacing.push(SPACING);
    };
    let columns = (2.0 * HALF_SIDE / SPACING).round() as u32;
    let rows = (TALL / SPACING).round() as u32;
    let along = |i: u32| (i as f32 + 0.5) * SPACING - HALF_SIDE;
    for i in 0..columns {
        for k in 0..columns {
            add(vec3(along(i), HALF.y - TALL, along(k)), -Vec3::Y, 50.0);
        }
        for k in 0..rows {
            let y = HALF.y - (k as f32 + 0.5) * SPACING;
            for side in [-1.0, 1.0] {
                add(vec3(side * HALF_SIDE, y, along(i)), Vec3::X * side, 0.0);
                add(vec3(along(i), y, side * HALF_SIDE), Vec3::Z * side, 0.0);
            }
        }
    }
    let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
    (cloud, corners.map(|(x, z)| vec3(x * HALF_SIDE, HALF.y - TALL, z * HALF_SIDE)))
}

#[test]
fn a_lamp_with_dark_sides_keeps_its_light() {
    let device = Device::new();
    let (cloud, corners) = block_lamp();
    let lamp = build(&cloud);
    for microbuffer in [16, 24, 48] {
        let settings = Settings { microbuffer, ..furnace(MaterialChoice::Diffuse(1.0)) };
        let frame = render(&device, &lamp, settings);
        let above = |n: Vec3, p: Vec3| corners.iter().all(|c| n.dot((c - p).normalize()) > 0.25);
        let shares: Vec<f32> = covered(&frame)
            .into_iter()
            .filter(|(n, p, _)| above(*n, *p))
            .map(|(n, p, e)| e / (50.0 * polygon(p, n, &corners)))
            .collect();
        assert!(shares.len() > 80, "{} pixels see the whole lamp", shares.len());
        all_within(&format!("lamp, {microbuffer}"), &shares, 1.0, LAMP);
        let (_, mean, _) = range(&shares);
        assert!((mean - 1.0).abs() < 0.004, "{microbuffer}: {mean}");
    }
}

/// What a GGX metal with F = 1 reflects of white light all round: its directional albedo, by quadrature over the disc.
fn metal_albedo(view_cosine: f32, alpha: f32) -> f32 {
    const STEPS: u32 = 400;
    let (o, alpha2) = (f64::from(view_cosine), f64::from(alpha * alpha));
    let view = glam::dvec3((1.0 - o * o).max(0.0).sqrt(), 0.0, o);
    let masking = |c: f64| 2.0 * c / (c + (alpha2 + (1.0 - alpha2) * c * c).sqrt());
    let mut sum = 0.0;
    for i in 0..STEPS * STEPS {
        let at = [i % STEPS, i / STEPS].map(|k| (f64::from(k) + 0.5) * 2.0 / f64::from(STEPS) - 1.0);
        let rest = 1.0 - at[0] * at[0] - at[1] * at[1];
        if rest <= 0.0 {
            continue;
        }
        let light = glam::dvec3(at[0], at[1], rest.sqrt());
        let h = (light + view).normalize().z;
        let t = h * h * (alpha2 - 1.0) + 1.0;
        sum += alpha2 / (std::f64::consts::PI * t * t) * masking(light.z) * masking(o) / (4.0 * light.z * o);
    }
    (sum * 4.0 / f64::from(STEPS * STEPS)) as f32
}
