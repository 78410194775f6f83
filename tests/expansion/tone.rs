//! Landis' and Banterle's operators.

use glam::{Vec3, vec3};
use relume::compare::luminance;
use relume::formats::image::read_photo;
use relume::preprocess::expansion::tone::{Banterle, Landis, banterle, inverse_reinhard, landis};

use super::{on_threads, rms, shared};

const LANDIS: Landis = Landis { alpha: 2.0, threshold: 0.5, maximum: 10.0 };

#[test]
fn landis_agrees_with_its_authors_code() {
    let Some(folder) = shared("landis_agrees_with_its_authors_code") else { return };
    let folder = folder.join("reference/tone-expansion");
    let coded = image::open(folder.join("input.png")).unwrap().to_rgb8();
    let linear = |value: u8| (f32::from(value) / 255.0).powf(2.2);
    let input: Vec<f32> = coded.pixels().map(|p| luminance(Vec3::from(p.0.map(linear)))).collect();
    for (name, alpha, threshold, maximum) in [
        ("landis_a2.2_t0.5_m5000.exr", 2.2, 0.5, 5000.0),
        ("landis_a2_t0.5_m10.exr", 2.0, 0.5, 10.0),
        ("landis_a2_t0.9_m10.exr", 2.0, 0.9, 10.0),
    ] {
        let expected: Vec<f32> = read_photo(&folder.join(name)).unwrap().rgb.into_iter().map(luminance).collect();
        let expanded = landis(&input, Landis { alpha, threshold, maximum });
        assert_eq!(expanded.len(), expected.len());
        let error = rms(expanded.iter().zip(&expected).map(|(a, b)| a - b)) / rms(expected.iter().copied());
        assert!(error < 0.01, "{name}: {error}");
        // The bright ones must not hide the others.
        let error = rms(expanded.iter().zip(&expected).map(|(a, b)| a / b - 1.0));
        assert!(error < 0.01, "{name}: {error} relative to each pixel");
    }
}

#[test]
fn landis_has_a_closed_form_on_a_ramp() {
    let ramp: Vec<f32> = (0..=1000).map(|n| n as f32 / 1000.0).collect();
    let expanded = landis(&ramp, LANDIS);
    for (&from, &to) in ramp.iter().zip(&expanded) {
        if from < 0.5 {
            assert_eq!(from.to_bits(), to.to_bits());
        } else {
            // w = (2 L - 1)^2, and L (1 + 9 w).
            let expected = from * (1.0 + 9.0 * (2.0 * from - 1.0).powi(2));
            assert!((to - expected).abs() < 1e-5 * expected, "{from}: {to} for {expected}");
        }
    }
    assert_eq!(expanded[1000], 10.0);
    assert!(expanded.windows(2).all(|pair| pair[0] < pair[1]));
}

#[test]
fn landis_of_few_or_dark_samples() {
    assert!(landis(&[], LANDIS).is_empty());
    assert_eq!(landis(&[0.0, 0.0], LANDIS), [0.0, 0.0]);
    assert_eq!(landis(&[0.8], LANDIS), [8.0]);
    // All are the threshold: no ramp, and each is the brightest.
    assert_eq!(landis(&[0.5, 0.5], LANDIS), [5.0, 5.0]);
}

#[test]
fn the_inverted_operator_is_reinhards() {
    for (maximum, white) in [(10.0_f32, 10.0_f32), (50.0, 50.0), (10.0, 3.0), (2.0, 1.5)] {
        assert_eq!(inverse_reinhard(0.0, maximum, white), 0.0);
        let brightest = inverse_reinhard(1.0, maximum, white);
        assert!((brightest / maximum - 1.0).abs() < 1e-4, "white becomes {brightest}, not {maximum}");
        let mut before = 0.0;
        for n in 1..=1000 {
            let coded = n as f32 / 1000.0;
            let expanded = inverse_reinhard(coded, maximum, white);
            assert!(expanded > before, "{coded}: {expanded} after {before}");
            before = expanded;
            // Reinhard et al. 2002, Eq. 4; its white is the scene luminance that becomes 1.
            let scene = f64::from(expanded) / f64::from(maximum) * f64::from(white);
            let forward = scene * (1.0 + scene / f64::from(white * white)) / (1.0 + scene);
            assert!((forward - f64::from(coded)).abs() < 1e-4, "{coded} came back as {forward}");
        }
    }
}

const LAMP: Vec3 = vec3(12.0, 12.0, 0.0);

/// A black wall of 64 x 64 samples with a lamp in one corner, and two grey patches, one beside it, one far away; and the
/// indices of all.
fn wall() -> (Vec<Vec3>, Vec<f32>, Vec<u32>) {
    let at: Vec<Vec3> = (0..64 * 64).map(|n| vec3((n % 64) as f32, (n / 64) as f32, 0.0)).collect();
    let is_grey = |p: &Vec3| [vec3(18.0, 12.0, 0.0), vec3(32.0, 32.0, 0.0)].iter().any(|q| p.distance(*q) < 2.0);
    let value = |p: &Vec3| if p.distance(LAMP) < 4.0 { 1.0 } else { 0.3 * f32::from(u8::from(is_grey(p))) };
    let luminances = at.iter().map(value).collect();
    (at, luminances, (0..64 * 64).collect())
}

#[test]
fn the_expand_map_is_one_in_lights_and_zero_far_away() {
    let (at, luminances, all) = wall();
    let options = Banterle { lights: 64, reach: 0.1, ..Banterle::with_maximum(20.0) };
    let expanded = banterle(&at, &luminances, &all, options);
    let inverse = |n: usize| inverse_reinhard(luminances[n], options.maximum, options.white);
    let mut largest = 0.0_f32;
    for n in 0..at.len() {
        let (low, high) = (luminances[n].min(inverse(n)), luminances[n].max(inverse(n)));
        assert!((low * 0.9999..=high * 1.0001).contains(&expanded[n]), "{}: {low} {} {high}", at[n], expanded[n]);
        if luminances[n] == 1.0 {
            largest = largest.max((expanded[n] - 1.0) / (inverse(n) - 1.0));
        }
    }
    assert!((largest - 1.0).abs() < 1e-4, "the map's largest share is {largest}");
    // The middle has more lights around it than the rim has.
    let share = |x: usize, y: usize| {
        let n = y * 64 + x;
        (expanded[n] - luminances[n]) / (inverse(n) - luminances[n])
    };
    assert!(share(12, 12) > share(15, 12) && share(15, 12) > share(18, 12));
    assert!(share(18, 12) > 0.05, "beside the lamp it is {}", share(18, 12));
    // Out there only the patch's own light is left.
    assert!(share(32, 32) < 0.02, "far away it is {}", share(32, 32));
}

#[test]
fn banterle_gives_what_is_wanted_on_any_number_of_threads() {
    let (at, luminances, all) = wall();
    let options = Banterle::with_maximum(20.0);
    let one = on_threads(1, || banterle(&at, &luminances, &all, options));
    assert_eq!(one, on_threads(2, || banterle(&at, &luminances, &all, options)));
    // In the order that was asked for; all hold the strongest light.
    let some = [12 * 64 + 12, 12 * 64 + 13, 3];
    let few = banterle(&at, &luminances, &some, options);
    assert_eq!(few.len(), 3);
    assert_eq!(few[2], luminances[3]);
    assert!(few[0] > 1.0 && few[1] > 1.0);
}

#[test]
fn banterle_of_few_or_dark_samples() {
    let options = Banterle::with_maximum(10.0);
    assert!(banterle(&[], &[], &[], options).is_empty());
    assert_eq!(banterle(&[Vec3::ZERO, Vec3::X], &[0.0, 0.0], &[0, 1], options), [0.0, 0.0]);
    for luminances in [vec![1.0], vec![1.0; 5], vec![0.3]] {
        let (at, all) = (vec![Vec3::ONE; luminances.len()], (0..luminances.len() as u32).collect::<Vec<_>>());
        let expanded = banterle(&at, &luminances, &all, options);
        assert!(expanded.iter().all(|v| v.is_finite() && *v >= 0.0), "{luminances:?}: {expanded:?}");
    }
}
