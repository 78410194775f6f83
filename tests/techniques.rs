//! The three techniques find the same cut for every pixel and make the same image, to the byte.

mod common;

use common::{Device, ball, box_cloud, build, random_cloud, settings};
use glam::{Vec3, vec3};
use relume::frames::{CutPair, Renderer, Settings, Technique};
use relume::passes::sin2_of_share;
use relume::preprocess::hierarchy::Hierarchy;
use relume::reference::cut::of_pixel;
use relume::scene::Camera;

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
