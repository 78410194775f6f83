//! From a photo to a cloud, in a room whose light is known.

use glam::Vec3;
use relume::compare::luminance;
use relume::preprocess::expansion::{Expansion, Inputs, Options, Origin, Places, Strategy, Transfer, expand};
use relume::scene::{Cloud, Picture};

use super::room::Scan;
use super::{bits, median, on_threads, rms};

fn run(cloud: &Cloud, photo: Option<&Picture>, options: &Options) -> Expansion {
    expand(Inputs { cloud, photo, network: None }, options, &|_, _| ()).unwrap()
}

/// Root of the mean squared difference of luminance to the truth, over all points.
fn error(scan: &Scan, colors: &[Vec3]) -> f64 {
    rms(colors.iter().zip(&scan.truth.colors).map(|(a, b)| luminance(*a) - luminance(*b)))
}

/// What holds of every expansion: all is finite, counts add up, and well-exposed points are what they were, bit by bit.
#[track_caller]
fn check(scan: &Scan, expansion: &Expansion) {
    let over = scan.over_exposed();
    assert_eq!((expansion.colors.len(), expansion.origins.len()), (over.len(), over.len()));
    assert!(expansion.colors.iter().all(|color| color.is_finite() && color.min_element() >= 0.0));
    for (n, &over) in over.iter().enumerate() {
        assert_eq!(expansion.origins[n] == Origin::Kept, !over);
        if !over {
            assert_eq!(bits(&expansion.colors[n..=n]), bits(&scan.low.colors[n..=n]), "point {n} was well exposed");
        }
    }
    let report = &expansion.report;
    let count = |wanted: Origin| expansion.origins.iter().filter(|origin| **origin == wanted).count();
    assert_eq!((report.points, report.over_exposed), (over.len(), over.iter().filter(|over| **over).count()));
    assert_eq!((count(Origin::Solved), count(Origin::Filled)), (report.solved, report.filled));
    assert!(report.residual < 1e-6, "{}", report.residual);
}

#[test]
fn lamp_and_window_get_their_own_light() {
    let scan = Scan::new(60_000);
    let [lamp, window] = scan.lamp_and_window();
    assert!(lamp.len() > 30 && window.len() > 500, "{} {}", lamp.len(), window.len());
    let photo = scan.photo_of_lights();
    let options = Options { shot_size: 256, ..Options::default() };
    let expansion = run(&scan.low, Some(&photo), &options);
    check(&scan, &expansion);
    let report = &expansion.report;
    eprintln!("{:?}", report.seconds);
    assert!(report.registration.is_some(), "the photo was not found: {:?}", report.warnings);
    let alpha = report.alpha.unwrap() / scan.alpha;
    eprintln!("alpha {alpha}, by histograms {}", report.exposure.as_ref().unwrap().alpha / scan.alpha);
    assert!((alpha - 1.0).abs() < 0.05, "alpha is {alpha} times the true one");
    for (name, points) in [("lamp", lamp), ("window", window)] {
        let ratio = |&n: &usize| luminance(expansion.colors[n]) / luminance(scan.truth.colors[n]);
        let ratio = median(points.iter().map(ratio).collect());
        eprintln!("{name}: {ratio}");
        assert!((ratio - 1.0).abs() < 0.2, "the {name} has {ratio} of its light");
    }
    let (before, after) = (error(&scan, &scan.low.colors), error(&scan, &expansion.colors));
    eprintln!("error {before}, then {after}");
    assert!(after < 0.25 * before, "the error was {before} and is {after}");
    assert_eq!(report.shots.len(), 3);
    assert!(report.median_cost.is_some() && report.compared > 0);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
}

#[test]
fn threads_change_nothing_and_luminance_keeps_proportions() {
    let scan = Scan::new(15_000);
    let photo = scan.photo_of_lights();
    let options =
        Options { shot_size: 64, transfer: Transfer::Luminance, places: Places::Auto(2), ..Options::default() };
    let work = |threads| on_threads(threads, || run(&scan.low, Some(&photo), &options));
    let (one, two) = (work(1), work(2));
    assert_eq!(bits(&one.colors), bits(&two.colors));
    assert_eq!(one.origins, two.origins);
    assert_eq!((one.report.alpha, one.report.compared), (two.report.alpha, two.report.compared));
    check(&scan, &one);
    let mut brighter = 0;
    for (color, low) in one.colors.iter().zip(&scan.low.colors) {
        let gain = luminance(*color) / luminance(*low);
        brighter += usize::from(gain > 1.5);
        assert!(color.abs_diff_eq(*low * gain, 1e-4 * color.max_element()), "{low} became {color}");
    }
    assert!(brighter > 100, "{brighter} points are brighter");
}

#[test]
fn a_photo_of_the_floor_has_no_likeness_of_lights() {
    let scan = Scan::new(30_000);
    let options = Options { shot_size: 128, ..Options::default() };
    let expansion = run(&scan.low, Some(&scan.photo_of_floor()), &options);
    check(&scan, &expansion);
    let warnings = expansion.report.warnings.join("\n");
    assert!(warnings.contains("no likeness in the photo"), "{warnings:?}");
    assert!(warnings.contains("no more range than the cloud"), "{warnings:?}");
    let most = expansion.colors.iter().map(|&c| luminance(c)).fold(0.0, f32::max);
    assert!(most < 3.0, "a light of {most} comes from nowhere");
}

/// Every strategy but PatchMatch without a photo, and one on the points with it.
#[test]
fn every_strategy_brightens_the_lights_and_nothing_else() {
    let scan = Scan::new(15_000);
    let photo = scan.photo_of_lights();
    let over = scan.over_exposed();
    let mean = |colors: &[Vec3]| {
        let of_lights: Vec<f32> = (0..over.len()).filter(|&n| over[n]).map(|n| luminance(colors[n])).collect();
        of_lights.iter().sum::<f32>() / of_lights.len() as f32
    };
    let before = mean(&scan.low.colors);
    let without = Strategy::ALL.into_iter().filter(|strategy| *strategy != Strategy::PatchMatch);
    for (strategy, photo) in without.map(|strategy| (strategy, None)).chain([(Strategy::LandisPoints, Some(&photo))]) {
        let options = Options { strategy, shot_size: 64, places: Places::Auto(1), ..Options::default() };
        let expansion = run(&scan.low, photo, &options);
        check(&scan, &expansion);
        let after = mean(&expansion.colors);
        assert!(after > 1.2 * before, "{strategy:?}: from {before} to {after}");
        assert_eq!(expansion.report.alpha.is_some(), photo.is_some());
        assert_eq!(expansion.report.shots.is_empty(), !strategy.takes_shots());
        if !strategy.knows_colors() {
            for (color, low) in expansion.colors.iter().zip(&scan.low.colors) {
                let gain = luminance(*color) / luminance(*low);
                assert!(color.abs_diff_eq(*low * gain, 1e-4 * color.max_element()), "{strategy:?}: {low}, {color}");
            }
        }
        if let Some(photo) = photo {
            // The brightest in the photo is the brightest in the cloud.
            let most = photo.rgb.iter().map(|&c| luminance(c)).fold(0.0, f32::max) * expansion.report.alpha.unwrap();
            let brightest = expansion.colors.iter().map(|&c| luminance(c)).fold(0.0, f32::max);
            assert!((brightest / most - 1.0).abs() < 1e-3, "{brightest} for {most}");
        }
    }
}

/// Shots where somebody says, pictures of each, and steps in the order in which they are heard of.
#[test]
fn places_pictures_and_progress() {
    let scan = Scan::new(15_000);
    let places = vec![Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.5, 1.5, 1.0)];
    let options = Options {
        strategy: Strategy::Landis,
        shot_size: 64,
        places: Places::At(places.clone()),
        pictures: true,
        ..Options::default()
    };
    let steps = std::sync::Mutex::new(Vec::new());
    let inputs = Inputs { cloud: &scan.low, photo: None, network: None };
    let expansion = expand(inputs, &options, &|step, share| steps.lock().unwrap().push((step, share))).unwrap();
    assert_eq!(expansion.report.shots, places);
    assert_eq!(expansion.pictures.len(), 2);
    for pictures in &expansion.pictures {
        assert_eq!((pictures.width, pictures.height), (3 * 64, 2 * 64));
        assert_eq!((pictures.points.len(), pictures.expanded.rgb.len()), (6 * 64 * 64, 6 * 64 * 64));
        assert!(pictures.matched.is_none());
        assert!(pictures.expanded.rgb.iter().any(|&c| luminance(c) > 2.0), "no light is in the picture");
    }
    let steps = steps.into_inner().unwrap();
    assert!(steps.iter().all(|(_, share)| (0.0..=1.0).contains(share)));
    for name in ["shots", "expansion", "projection", "poisson"] {
        assert!(steps.contains(&(name, 1.0)), "{name} is not in {steps:?}");
        assert!(expansion.report.seconds.iter().any(|(step, seconds)| *step == name && *seconds >= 0.0));
    }
}
