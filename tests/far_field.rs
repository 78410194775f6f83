//! Probes beyond a scan: what no node covers is lit by the current one.

mod common;

use common::{Device, ball, box_cloud, build, settings};
use glam::{Affine3A, Vec3, vec3};
use relume::frames::{Frame, GpuScene, MaterialChoice, Renderer, Settings, Technique};
use relume::passes::Paper;
use relume::preprocess::hierarchy::Hierarchy;
use relume::scene::{Camera, Cloud, FarField, Object};

/// A room of 4 x 2.8 x 4 m around the origin, of which `keep` says what stays.
fn room(color: f32, keep: impl Fn(Vec3) -> bool) -> Hierarchy {
    let whole = box_cloud(vec3(2.0, 1.4, 2.0), 60_000, |_, _| Vec3::splat(color));
    let kept: Vec<usize> = (0..whole.len()).filter(|i| keep(whole.positions[*i])).collect();
    build(&Cloud {
        positions: kept.iter().map(|i| whole.positions[*i]).collect(),
        colors: kept.iter().map(|i| whole.colors[*i]).collect(),
        normals: kept.iter().map(|i| whole.normals[*i]).collect(),
        spacing: kept.iter().map(|i| whole.spacing[*i]).collect(),
        ..Cloud::default()
    })
}

fn sky(radiance: impl Fn(Vec3) -> Vec3) -> FarField {
    let (width, height) = (64, 32);
    let texel = |i: u32| {
        let (phi, theta) = (
            std::f32::consts::TAU * ((i % width) as f32 + 0.5) / width as f32 - std::f32::consts::PI,
            std::f32::consts::PI * ((i / width) as f32 + 0.5) / height as f32,
        );
        radiance(vec3(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos()))
    };
    FarField { width, height, radiance: (0..width * height).map(texel).collect() }
}

fn object() -> Object {
    ball(0.3).transformed(Affine3A::from_translation(vec3(0.2, -0.3, 0.1)))
}

fn camera() -> Camera {
    Camera { from: vec3(0.8, 0.4, 1.6), at: vec3(0.2, -0.3, 0.1), fov_y: 0.6 }
}

fn with(technique: Technique) -> Settings {
    Settings { technique, microbuffer: 24, material: MaterialChoice::Diffuse(0.7), ..settings() }
}

/// Mean colours of the covered pixels whose normals point up, and down.
fn above_and_below(frame: &Frame) -> [Vec3; 2] {
    let mean = |picks: &dyn Fn(f32) -> bool| {
        let picked: Vec<Vec3> = (0..frame.rgba.len())
            .filter(|at| frame.rgba[*at][3] > 0.0 && picks(frame.normal[*at][1]))
            .map(|at| Vec3::new(frame.rgba[at][0], frame.rgba[at][1], frame.rgba[at][2]))
            .collect();
        assert!(picked.len() > 20);
        picked.iter().sum::<Vec3>() / picked.len() as f32
    };
    [mean(&|y| y > 0.7), mean(&|y| y < -0.2)]
}

#[test]
fn a_furnace_is_white_when_half_of_it_is_cloud_and_half_is_probe() {
    let device = Device::new();
    let white = sky(|_| Vec3::ONE);
    for (what, hierarchy) in [
        ("no ceiling", room(1.0, |p| p.y < 1.39)),
        ("one half", room(1.0, |p| p.x < 0.0)),
        ("a hole in the wall", room(1.0, |p| !(p.z < -1.99 && p.x.abs() < 0.8 && p.y.abs() < 0.6))),
    ] {
        for technique in Technique::ALL {
            let mut renderer =
                Renderer::new(&device.0, &hierarchy, &object(), Some(&white), with(technique)).expect("a renderer");
            let frame = renderer.render(&camera(), &mut |_, _| {}).expect("a frame");
            let covered: Vec<f32> = frame.rgba.iter().filter(|p| p[3] > 0.0).map(|p| p[1]).collect();
            let mean = covered.iter().sum::<f32>() / covered.len() as f32;
            let (low, high) = covered.iter().fold((f32::MAX, 0.0_f32), |(low, high), v| (low.min(*v), high.max(*v)));
            println!("{what}, {technique}: {low} to {high}, mean {mean}");
            assert!((mean / 0.7 - 1.0).abs() < 0.005, "{what}, {technique}: mean {mean}");
            assert!(low > 0.7 * 0.97 && high < 0.7 * 1.03, "{what}, {technique}: {low} to {high}");
        }
    }
}

#[test]
fn light_through_a_missing_ceiling_changes_with_the_stream() {
    let device = Device::new();
    let hierarchy = room(0.05, |p| p.y < 1.39);
    let (red, blue) = (sky(|w| vec3(w.y.max(0.0), 0.0, 0.0)), sky(|w| vec3(0.0, 0.0, 2.0 * w.y.max(0.0))));
    for technique in [Technique::Shared, Technique::Hybrid] {
        let scene = GpuScene::new(&device.0, &hierarchy, Some(&red), Paper::NONE).expect("a scene");
        let mut renderer = Renderer::with_scene(&device.0, &scene, &object(), with(technique)).expect("a renderer");
        let mut frame = || renderer.render(&camera(), &mut |_, _| {}).expect("a frame");
        let first = frame();
        let [above, below] = above_and_below(&first);
        assert!(above.x > 0.15 && above.x > 3.0 * above.z, "{technique}: the red sky lights the top: {above}");
        assert!(below.x < 0.05, "{technique}: the floor hides the sky: {below}");
        scene.set_far_field(&blue).expect("the next probe");
        let [above, below] = above_and_below(&frame());
        assert!(above.z > 0.3 && above.z > 3.0 * above.x, "{technique}: the blue sky lights the top: {above}");
        assert!(below.z < 0.06, "{technique}: {below}");
        scene.set_far_field(&red).expect("the next probe");
        assert_eq!(frame().rgba, first.rgba, "{technique}: the same light makes the same picture");
    }
}

#[test]
fn a_far_field_of_another_size_is_refused() {
    let device = Device::new();
    let hierarchy = room(0.5, |_| true);
    let scene = GpuScene::new(&device.0, &hierarchy, Some(&sky(|_| Vec3::ONE)), Paper::NONE).expect("a scene");
    let other = FarField { width: 4, height: 2, radiance: vec![Vec3::ONE; 8] };
    assert!(scene.set_far_field(&other).expect_err("another size").to_string().contains("4 x 2"));
    let none = GpuScene::new(&device.0, &hierarchy, None, Paper::NONE).expect("a scene");
    assert!(none.set_far_field(&other).is_err());
}
