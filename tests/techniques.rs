//! The three techniques with a micro-buffer a pixel find the same cut for every pixel and make the same image, to the
//! byte. The fourth is in `shared.rs`.

mod common;

use common::{Device, ball, box_cloud, build, random_cloud, settings};
use glam::{Vec3, vec3};
use relume::frames::{CutPair, Frame, MaterialChoice, Paper, Renderer, Settings, Technique};
use relume::passes::sin2_of_share;
use relume::preprocess::hierarchy::Hierarchy;
use relume::reference::cut::of_pixel;
use relume::scene::{Camera, Cloud, FarField};

fn camera() -> Camera {
    Camera { from: vec3(0.3, 0.25, 0.9), at: Vec3::ZERO, fov_y: 0.7 }
}

fn cut(device: &Device, hierarchy: &Hierarchy, settings: Settings) -> Vec<CutPair> {
    let mut renderer = Renderer::new(&device.0, hierarchy, &ball(0.2), None, settings).expect("a renderer");
    renderer.cut(&camera()).expect("a cut")
}

fn reference(device: &Device, hierarchy: &Hierarchy) -> Vec<CutPair> {
    let settings = settings();
    let stop_sin2 = sin2_of_share(settings.stop / f64::from(settings.microbuffer * settings.microbuffer));
    let mut renderer = Renderer::new(&device.0, hierarchy, &ball(0.2), None, settings).expect("a renderer");
    let pixels = renderer.receivers(&camera()).expect("receivers");
    let mut pairs = Vec::new();
    for (pixel, ([x, y, z, covered], [nx, ny, nz, _])) in pixels.into_iter().enumerate() {
        if covered > 0.0 {
            let (nodes, _) = of_pixel(hierarchy, vec3(x, y, z), vec3(nx, ny, nz), stop_sin2);
            pairs.extend(nodes.into_iter().map(|node| CutPair { pixel: pixel as u32, node }));
        }
    }
    pairs
}

#[test]
fn all_techniques_rasterise_the_same_pairs() {
    let device = Device::new();
    for hierarchy in
        [build(&box_cloud(vec3(1.0, 0.8, 1.2), 20_000, |p, n| p.abs() + n * 0.1 + 0.2)), build(&random_cloud(5_000, 7))]
    {
        let classic = cut(&device, &hierarchy, Settings { technique: Technique::Classic, ..settings() });
        assert!(classic.len() > 10_000);
        assert!(classic == reference(&device, &hierarchy), "classic rasterises other pairs than the reference");
        for technique in [Technique::Mipmapped, Technique::Hybrid] {
            let other = cut(&device, &hierarchy, Settings { technique, ..settings() });
            assert_eq!(classic.len(), other.len(), "{technique}");
            assert!(classic == other, "{technique} rasterises other pairs than classic");
        }
    }
}

#[test]
fn all_techniques_make_the_same_image() {
    let device = Device::new();
    let hierarchy = build(&box_cloud(vec3(1.0, 0.8, 1.2), 20_000, |p, n| p.abs() + n * 0.1 + 0.2));
    let render = |settings: Settings| {
        let mut renderer = Renderer::new(&device.0, &hierarchy, &ball(0.2), None, settings).expect("a renderer");
        renderer.render(&camera(), &mut |_, _| {}).expect("a frame")
    };
    let classic = render(Settings { technique: Technique::Classic, ..settings() });
    for technique in [Technique::Mipmapped, Technique::Hybrid] {
        let other = render(Settings { technique, ..settings() });
        assert_eq!(classic.stats.rasterised_nodes, other.stats.rasterised_nodes, "{technique}");
        assert!(classic.rgba == other.rgba, "{technique} makes another image than classic");
    }
}

#[test]
fn every_paper_option_works_under_every_technique_of_the_paper() {
    let device = Device::new();
    let hierarchy = build(&box_cloud(vec3(1.0, 0.8, 1.2), 6_000, |p, n| p.abs() + n * 0.1 + 0.2));
    let none = Paper::default();
    let options = [
        ("image", Paper { image: true, ..none }),
        ("coverage", Paper { coverage: true, ..none }),
        ("weights", Paper { weights: true, ..none }),
        ("cut", Paper { cut: true, ..none }),
        ("all", Paper::ALL),
    ];
    let render = |settings: Settings| {
        let mut renderer = Renderer::new(&device.0, &hierarchy, &ball(0.2), None, settings).expect("a renderer");
        renderer.render(&camera(), &mut |_, _| {}).expect("a frame")
    };
    for technique in [Technique::Classic, Technique::Mipmapped, Technique::Hybrid] {
        let settings = Settings { technique, ..settings() };
        let default = render(settings);
        for (name, paper) in options {
            let frame = render(Settings { paper, ..settings });
            assert!(frame.rgba.iter().flatten().all(|v| v.is_finite() && *v >= 0.0), "{technique}, {name}");
            assert_eq!(frame.stats.covered_pixels, default.stats.covered_pixels, "{technique}, {name}");
            let covered = |f: &Frame| f.rgba.iter().filter(|p| p[3] > 0.0).map(|p| p[1]).collect::<Vec<_>>();
            let (a, b) = (covered(&default), covered(&frame));
            let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
            let ratio = mean(&b) / mean(&a);
            println!("{technique}, {name}: mean {ratio} of the default's, same {}", a == b);
            // The paper's rule for the cut concerns coarse receivers; classic has none.
            let unchanged = name == "cut" && technique == Technique::Classic;
            assert!((a == b) == unchanged, "{technique}, {name}");
            // One node a micro-pixel leaves holes between nodes that are smaller than it: 0.86 was measured.
            assert!((0.8..1.15).contains(&ratio), "{technique}, {name}: {ratio} of the default's brightness");
        }
    }
}

#[test]
fn a_far_field_shows_through_holes_and_nowhere_else() {
    let device = Device::new();
    // The lower half of a black room is missing; a far field of radiance 1 is everywhere behind it.
    let mut cloud = box_cloud(vec3(1.0, 0.8, 1.2), 20_000, |_, _| Vec3::ZERO);
    let whole = build(&cloud);
    let keep: Vec<bool> = cloud.positions.iter().map(|p| p.y > 0.0).collect();
    let kept = |i: &usize| keep[*i];
    cloud = Cloud {
        positions: (0..keep.len()).filter(kept).map(|i| cloud.positions[i]).collect(),
        normals: (0..keep.len()).filter(kept).map(|i| cloud.normals[i]).collect(),
        colors: (0..keep.len()).filter(kept).map(|i| cloud.colors[i]).collect(),
        spacing: (0..keep.len()).filter(kept).map(|i| cloud.spacing[i]).collect(),
        ..cloud
    };
    let half = build(&cloud);
    let far = FarField { width: 16, height: 8, radiance: vec![Vec3::ONE; 128] };
    for technique in Technique::ALL {
        let settings = Settings { technique, microbuffer: 24, material: MaterialChoice::Diffuse(1.0), ..settings() };
        let render = |hierarchy: &Hierarchy, far: Option<&FarField>| {
            // So small that all of it is in the plane where the hole ends.
            let camera = Camera { from: camera().from * 0.1, ..camera() };
            let mut renderer = Renderer::new(&device.0, hierarchy, &ball(0.02), far, settings).expect("a renderer");
            renderer.render(&camera, &mut |_, _| {}).expect("a frame")
        };
        let values = |frame: &Frame| -> Vec<(f32, f32)> {
            let pixels = frame.rgba.iter().zip(&frame.normal);
            pixels.filter(|(p, _)| p[3] > 0.0).map(|(p, n)| (p[0], n[1])).collect()
        };
        let most = |list: &[(f32, f32)], wanted: &dyn Fn(f32) -> f32| {
            list.iter().map(|(value, n)| (value - wanted(*n)).abs()).fold(0.0, f32::max)
        };
        let hole = most(&values(&render(&half, Some(&far))), &|n| 0.5 * (1.0 - n));
        let closed = most(&values(&render(&whole, Some(&far))), &|_| 0.0);
        let nothing = most(&values(&render(&half, None)), &|_| 0.0);
        println!("{technique}: through the hole {hole} off, closed {closed}, without far field {nothing}");
        // A micro-pixel at the hole's edge that a node covers in part counts as covered: 0.052 was measured.
        assert!(hole < 0.07, "{technique}: {hole}");
        assert!(closed < 0.01, "{technique}: {closed}");
        assert!(nothing == 0.0, "{technique}: {nothing}");
    }
}

#[test]
fn the_smallest_and_the_largest_micro_buffers_work() {
    let device = Device::new();
    let hierarchy = build(&box_cloud(vec3(1.0, 0.8, 1.2), 20_000, |p, n| p.abs() + n * 0.1 + 0.2));
    for microbuffer in [8, 64] {
        let render = |technique| {
            let settings = Settings { technique, microbuffer, width: 24, height: 20, ..settings() };
            let mut renderer = Renderer::new(&device.0, &hierarchy, &ball(0.2), None, settings).expect("a renderer");
            renderer.render(&camera(), &mut |_, _| {}).expect("a frame")
        };
        let classic = render(Technique::Classic);
        assert!(classic.rgba.iter().flatten().all(|v| v.is_finite()), "{microbuffer}");
        assert!(classic.rgba.iter().filter(|p| p[3] > 0.0).all(|p| p[1] > 0.1), "{microbuffer}: a black pixel");
        for technique in [Technique::Mipmapped, Technique::Hybrid] {
            assert!(classic.rgba == render(technique).rgba, "{technique} at {microbuffer}");
        }
    }
    for microbuffer in [6, 17, 66] {
        let made = Renderer::new(&device.0, &hierarchy, &ball(0.2), None, Settings { microbuffer, ..settings() });
        assert!(matches!(made, Err(relume::Error::Argument(_))), "{microbuffer}");
    }
}
