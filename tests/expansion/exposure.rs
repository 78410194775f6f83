//! The exposure that brings a photo's histogram to the cloud's.

use glam::Vec3;
use relume::formats::cloud::{CloudOptions, load};
use relume::formats::image::read_photo;
use relume::preprocess::expansion::exposure::{BINS, Exposure, Histogram, match_histograms};
use relume::scene::Picture;

use super::{Random, on_threads, shared};

#[test]
fn the_least_distance_is_found_on_real_photos() {
    let Some(folder) = shared("the_least_distance_is_found_on_real_photos") else { return };
    let folder = folder.join("reference/toyroom");
    let cloud = load(&folder.join("cloud_ldr.ply"), &CloudOptions::default()).unwrap();
    for (name, expected) in [("photo_both_hdr.exr", 1.49), ("photo_hdr.exr", 1.77)] {
        let photo = read_photo(&folder.join(name)).unwrap();
        let found = match_histograms(&photo, &cloud.colors).unwrap();
        assert!((found.alpha / expected - 1.0).abs() < 0.01, "{name}: {} for {expected}", found.alpha);
        check_curve(&found);
    }
}

/// Colours whose logarithms are distributed normally, about 0.1, and one in fifty is a light.
fn colors(count: usize, random: &mut Random) -> Vec<Vec3> {
    let mut color = || {
        // Sum of twelve uniform numbers: the variance is 1.
        let normal = (0..12).map(|_| random.next()).sum::<f32>() - 6.0;
        let light = if random.next() < 0.02 { 20.0 } else { 1.0 };
        Vec3::new(1.0, 0.9, 0.8) * 0.1 * light * (0.6 * normal).exp()
    };
    (0..count).map(|_| color()).collect()
}

#[test]
fn exposures_of_the_clouds_own_distribution_are_found() {
    let mut random = Random(7);
    let (of_photo, of_cloud) = (colors(320 * 240, &mut random), colors(60_000, &mut random));
    for n in 0..10 {
        let alpha = 0.25 * 32.0_f32.powf(n as f32 / 9.0);
        let cloud: Vec<Vec3> = of_cloud.iter().map(|c| c.min(Vec3::ONE)).collect();
        let photo = Picture { width: 320, height: 240, rgb: of_photo.iter().map(|c| *c / alpha).collect() };
        let found = match_histograms(&photo, &cloud).unwrap();
        assert!((found.alpha / alpha - 1.0).abs() < 0.02, "{} for {alpha}", found.alpha);
        check_curve(&found);
    }
}

/// What was tried is in order, and nothing of it is better than what was taken.
#[track_caller]
fn check_curve(found: &Exposure) {
    assert!(found.curve.windows(2).all(|pair| pair[0].0 < pair[1].0));
    assert!(found.curve.contains(&(found.alpha, found.distance)));
    assert!(found.curve.iter().all(|(_, distance)| distance.is_finite() && *distance >= found.distance));
}

#[test]
fn threads_change_nothing() {
    let mut random = Random(3);
    let photo = Picture { width: 100, height: 100, rgb: colors(10_000, &mut random) };
    let cloud = colors(5_000, &mut random);
    let run = |threads| on_threads(threads, || match_histograms(&photo, &cloud).unwrap());
    assert_eq!(run(1), run(2));
}

#[test]
fn a_black_photo_has_no_exposure() {
    let cloud = [Vec3::splat(0.3); 10];
    assert_eq!(match_histograms(&Picture::black(8, 8), &cloud), None);
    assert_eq!(match_histograms(&Picture::black(0, 0), &cloud), None);
    // One pixel of light is enough, however weak or strong.
    for light in [1e-6, 1.0, 1e6] {
        let mut photo = Picture::black(8, 8);
        photo.rgb[9] = Vec3::splat(light);
        let found = match_histograms(&photo, &cloud).unwrap();
        assert!(found.alpha.is_finite() && found.alpha > 0.0, "{light}: {}", found.alpha);
    }
}

#[test]
fn the_distance_is_a_metric() {
    let bin = |n: usize| (n as f32 + 0.5) / BINS as f32;
    let of = |values: &[f32]| Histogram::new(values, 1.0);
    let mut random = Random(5);
    let mut sample = || of(&(0..100).map(|_| random.next()).collect::<Vec<_>>());
    let (a, b, c) = (sample(), sample(), sample());
    assert_eq!(a.distance(&a), 0.0);
    assert!(a.distance(&b) > 0.0 && (a.distance(&b) - b.distance(&a)).abs() < 1e-12);
    assert!(a.distance(&c) <= a.distance(&b) + b.distance(&c) + 1e-12);
    // A shift costs its length, whatever the histogram.
    for shift in [1, 5, 60] {
        let values: Vec<f32> = (0..60).map(bin).collect();
        let shifted: Vec<f32> = (0..60).map(|n| bin(n + shift)).collect();
        let distance = of(&values).distance(&of(&shifted));
        assert!((distance - shift as f64 / BINS as f64).abs() < 1e-12, "{shift}: {distance}");
    }
    // Black against white is the whole range.
    assert!((of(&[0.0]).distance(&of(&[1.0])) - 127.0 / 128.0).abs() < 1e-12);
}

#[test]
fn histograms_hold_everything() {
    let values = [-1.0, 0.0, 0.1, 0.5, 1.0, 1e30, f32::INFINITY];
    let histogram = Histogram::new(&values, 1.0);
    assert!((histogram.0.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    assert!((histogram.0[0] - 2.0 / 7.0).abs() < 1e-12 && (histogram.0[BINS - 1] - 3.0 / 7.0).abs() < 1e-12);
    assert!((histogram.0[64] - 1.0 / 7.0).abs() < 1e-12);
    assert_eq!(Histogram::new(&[0.2, 0.4], 2.0), Histogram::new(&[0.4, 0.8], 1.0));
    assert_eq!(Histogram::new(&[], 1.0).0, [0.0; BINS]);
}
