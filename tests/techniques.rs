//! The three techniques find the same cut for every pixel and make the same image, to the byte.

mod common;

use common::{Device, ball, box_cloud, build, random_cloud, settings};
use glam::{Vec3, vec3};
use relume::frames::{CutPair, Renderer, Settings, Technique};
use relume::preprocess::hierarchy::Hierarchy;
use relume::scene::Camera;

fn camera() -> Camera {
    Camera { from: vec3(0.3, 0.25, 0.9), at: Vec3::ZERO, fov_y: 0.7 }
}

fn cut(device: &Device, hierarchy: &Hierarchy, settings: Settings) -> Vec<CutPair> {
    let mut renderer = Renderer::new(&device.0, hierarchy, &ball(0.2), None, settings).expect("a renderer");
    renderer.cut(&camera()).expect("a cut")
}

#[test]
fn all_techniques_rasterise_the_same_pairs() {
    let device = Device::new();
    for hierarchy in [
        build(&box_cloud(vec3(1.0, 0.8, 1.2), 20_000, |p, n| p.abs() + n * 0.1 + 0.2)),
        build(&random_cloud(5_000, 7)),
    ] {
        let classic = cut(&device, &hierarchy, Settings { technique: Technique::Classic, ..settings() });
        assert!(classic.len() > 10_000);
        for technique in [Technique::Mipmapped, Technique::Hybrid] {
            let other = cut(&device, &hierarchy, Settings { technique, ..settings() });
            assert_eq!(classic.len(), other.len(), "{technique}");
            assert!(classic == other, "{technique} rasterises other pairs than classic");
        }
    }
}
