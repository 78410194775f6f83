//! Nothing fails for size and nothing shows it: overflow and splitting, small budgets and image regions change no byte.

mod common;

use common::{Device, ball, box_cloud, build, settings};
use glam::{Vec3, vec3};
use relume::Error;
use relume::frames::{Frame, Renderer, Settings, Technique};
use relume::preprocess::hierarchy::Hierarchy;
use relume::scene::Camera;

fn camera() -> Camera {
    Camera { from: vec3(0.3, 0.25, 0.9), at: Vec3::ZERO, fov_y: 0.6 }
}

fn room() -> Hierarchy {
    build(&box_cloud(vec3(1.0, 0.8, 1.2), 20_000, |p, n| p.abs() + n * 0.1 + 0.2))
}

fn try_render(device: &Device, hierarchy: &Hierarchy, settings: Settings) -> relume::Result<Frame> {
    let mut renderer = Renderer::new(&device.0, hierarchy, &ball(0.2), None, settings)?;
    renderer.render(&camera(), &mut |_, _| {})
}

fn render(device: &Device, hierarchy: &Hierarchy, settings: Settings) -> Frame {
    try_render(device, hierarchy, settings).expect("a frame")
}

/// Everything that an image shows, to the byte.
fn same(a: &Frame, b: &Frame) -> bool {
    a.rgba == b.rgba && a.position == b.position && a.normal == b.normal && a.albedo == b.albedo
}

/// Most nodes in the cut of one pixel: what must fit, since a batch is split down to single pixels.
fn largest_cut(device: &Device, hierarchy: &Hierarchy, settings: Settings) -> u32 {
    let mut renderer = Renderer::new(&device.0, hierarchy, &ball(0.2), None, settings).expect("a renderer");
    let pairs = renderer.cut(&camera()).expect("a cut");
    pairs.chunk_by(|a, b| a.pixel == b.pixel).map(<[_]>::len).max().expect("covered pixels") as u32
}

#[test]
fn splitting_changes_no_byte() {
    let device = Device::new();
    let hierarchy = room();
    for technique in [Technique::Mipmapped, Technique::Hybrid] {
        let settings = Settings { technique, width: 24, height: 20, ..settings() };
        let whole = render(&device, &hierarchy, settings);
        assert_eq!(whole.stats.splits, 0, "{technique}");
        let least = largest_cut(&device, &hierarchy, settings);
        for pairs in [least, least * 4, least * 12] {
            let part = render(&device, &hierarchy, Settings { pair_capacity: Some(pairs), ..settings });
            println!("{technique} {pairs}: {} splits, {} batches", part.stats.splits, part.stats.batches);
            assert!(part.stats.splits > 0, "{technique}: nothing is split at {pairs} pairs");
            assert!(part.stats.batches > whole.stats.batches, "{technique}: {} batches", part.stats.batches);
            assert!(part.stats.peak_feedback_bytes <= 3 * u64::from(pairs) * 8, "{technique} at {pairs} pairs");
            assert_eq!(part.stats.rasterised_nodes, whole.stats.rasterised_nodes, "{technique} at {pairs} pairs");
            assert!(same(&whole, &part), "{technique} makes another image with {pairs} pairs");
        }
        // One pair fewer and a single pixel's cut has no room: said, with the number, and nothing is dropped.
        match try_render(&device, &hierarchy, Settings { pair_capacity: Some(least - 1), ..settings }) {
            Err(Error::Limit(message)) => {
                println!("{technique}: {message}");
                assert!(message.contains(&(least - 1).to_string()), "{message}");
            }
            other => panic!("{technique}: {} pairs are too few, but: {:?}", least - 1, other.map(|f| f.stats)),
        }
    }
}

#[test]
fn a_small_budget_holds_and_changes_no_byte() {
    let hierarchy = room();
    for technique in Technique::ALL {
        let settings = Settings { technique, width: 256, height: 256, microbuffer: 32, ..settings() };
        let frame = |mebibytes: u64| {
            // A context counts over its whole life, so each measurement has its own.
            let device = Device::new();
            let budget = mebibytes << 20;
            let frame = render(&device, &hierarchy, Settings { memory_budget: budget, ..settings });
            let peak = frame.stats.device_bytes_peak;
            println!(
                "{technique} {mebibytes} MiB: peak {:.1}, {} batches",
                peak as f64 / 1048576.0,
                frame.stats.batches
            );
            assert!(peak <= budget, "{technique}: {peak} bytes at the peak of a budget of {budget}");
            assert_eq!(peak, device.0.bytes_peak());
            frame
        };
        let large = frame(512);
        let small = frame(48);
        assert!(small.stats.device_bytes_peak < large.stats.device_bytes_peak);
        assert!(same(&large, &small), "{technique} makes another image under a small budget");
        assert_eq!(large.stats.rasterised_nodes, small.stats.rasterised_nodes, "{technique}");
    }
}

#[test]
fn a_budget_that_is_too_small_says_what_is_needed() {
    let device = Device::new();
    match try_render(&device, &room(), Settings { memory_budget: 2 << 20, ..settings() }) {
        Err(Error::Limit(message)) => {
            println!("{message}");
            assert!(message.contains("2 MiB"), "{message}");
            let needed: u64 = message.rsplit(' ').find_map(|word| word.parse().ok()).expect("the number that it needs");
            render(&device, &room(), Settings { memory_budget: needed << 20, ..settings() });
        }
        other => panic!("2 MiB are too few, but: {:?}", other.map(|f| f.stats)),
    }
}

/// Pixels that differ, and by how much at most, relative to the brightest pixel.
fn difference(a: &Frame, b: &Frame) -> (usize, f32) {
    let brightest = a.rgba.iter().flatten().copied().fold(0.0, f32::max);
    let of = |(a, b): (&[f32; 4], &[f32; 4])| (0..4).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max) / brightest;
    let list: Vec<f32> = a.rgba.iter().zip(&b.rgba).map(of).collect();
    (list.iter().filter(|d| **d > 0.0).count(), list.into_iter().fold(0.0, f32::max))
}

/// Largest difference between an image in one region and in many, as a part of the brightest pixel: positions are
/// interpolated from another corner, which moves them by an ulp, and now and then a node from the front layer of a
/// micro-pixel to the back one. Measured 5.8e-4.
const SEAM: f32 = 2e-3;

#[test]
fn image_regions_meet_without_a_seam() {
    let hierarchy = room();
    for technique in Technique::ALL {
        let settings = Settings { technique, width: 300, height: 200, microbuffer: 8, ..settings() };
        let frame = |budget: u64| render(&Device::new(), &hierarchy, Settings { memory_budget: budget, ..settings });
        let one = frame(512 << 20);
        // Two rows of regions, then many small ones.
        for mebibytes in [15, 10] {
            let many = frame(mebibytes << 20);
            let (pixels, most) = difference(&one, &many);
            println!("{technique} {mebibytes} MiB: {pixels} pixels differ, by {most} at most");
            assert!(many.stats.batches > one.stats.batches, "{technique}: there is one region at {mebibytes} MiB");
            // Positions are interpolated with coordinates that count from the region's corner, which rounds them
            // otherwise; a node at the threshold may then be taken where its children were.
            assert!(most < SEAM, "{technique} {mebibytes} MiB: {pixels} pixels differ, by {most} at most");
            assert_eq!(one.stats.covered_pixels, many.stats.covered_pixels, "{technique}");
        }
    }
}

#[test]
fn twice_the_same_run_twice_the_same_bytes() {
    let hierarchy = room();
    let device = Device::new();
    for technique in Technique::ALL {
        let settings = Settings { technique, ..settings() };
        let mut renderer = Renderer::new(&device.0, &hierarchy, &ball(0.2), None, settings).expect("a renderer");
        let first = renderer.render(&camera(), &mut |_, _| {}).expect("a frame");
        for run in 1..=3 {
            let again = renderer.render(&camera(), &mut |_, _| {}).expect("a frame");
            assert!(same(&first, &again), "{technique}: run {run} of one renderer differs");
            assert!(same(&first, &render(&device, &hierarchy, settings)), "{technique}: renderer {run} differs");
        }
        // Another view in between leaves nothing behind.
        let other = Camera { from: vec3(-0.5, 0.1, -0.6), ..camera() };
        let elsewhere = renderer.render(&other, &mut |_, _| {}).expect("a frame");
        assert!(!same(&first, &elsewhere));
        let back = renderer.render(&camera(), &mut |_, _| {}).expect("a frame");
        assert!(same(&first, &back), "{technique}: the view before shows in the next");
    }
}
