//! Comparison of images: every number and picture must react to a perturbed image, and only inside of the mask.

use glam::Vec3;
use image::{Rgba, RgbaImage};
use relume::compare::{
    Axis, Image, Metrics, Plot, Series, Tile, compare, contact_sheet, difference_map, luminance, to_srgb8,
};

/// A smooth picture with an edge, masked to a disc.
fn picture(width: u32, height: u32) -> Image {
    let place = |n: u32| (f64::from(n % width) / f64::from(width), f64::from(n / width) / f64::from(height));
    let color = |n| {
        let (x, y) = place(n);
        let step = if x + y > 1.1 { 0.3 } else { 0.0 };
        Vec3::new(0.2 + 0.5 * x as f32, 0.4 + step, 0.1 + y as f32)
    };
    let inside = |n| {
        let (x, y) = place(n);
        f32::from(u8::from((x - 0.5).hypot(y - 0.5) < 0.45))
    };
    let (rgb, alpha) = ((0..width * height).map(color).collect(), (0..width * height).map(inside).collect());
    Image::new(width, height, rgb, alpha).expect("sizes fit")
}

fn changed(image: &Image, change: impl Fn(usize, Vec3) -> Vec3) -> Image {
    let rgb = image.rgb.iter().enumerate().map(|(n, &color)| change(n, color)).collect();
    Image { rgb, ..image.clone() }
}

fn metrics(a: &Image, b: &Image) -> Metrics {
    compare(a, b).expect("comparable")
}

#[test]
fn equal_images_do_not_differ() {
    let image = picture(64, 48);
    let found = metrics(&image, &image);
    assert_eq!((found.relative_rms_luminance, found.rgb_rms, found.bias, found.flip), (0.0, 0.0, 0.0, 0.0));
    assert!((found.ssim - 1.0).abs() < 1e-9, "{}", found.ssim);
    assert_eq!(found.pixels, image.alpha.iter().filter(|&&alpha| alpha > 0.5).count());
}

#[test]
fn a_brighter_image_is_off_by_what_it_is_brighter() {
    let truth = picture(64, 48);
    let found = metrics(&changed(&truth, |_, color| color * 1.1), &truth);
    assert!((found.bias - 0.1).abs() < 1e-5, "{found:?}");
    // not less than the bias: squares weigh bright pixels more
    assert!((0.1..0.12).contains(&found.relative_rms_luminance), "{found:?}");
    assert!(found.rgb_rms > 0.03 && found.flip > 0.01 && found.ssim < 0.9999, "{found:?}");
    // B is the truth: the other way around, the error is relative to the brighter one
    let reversed = metrics(&truth, &changed(&truth, |_, color| color * 1.1));
    assert!((reversed.bias + 0.1 / 1.1).abs() < 1e-5, "{reversed:?}");
}

#[test]
fn every_number_reacts_to_noise_on_a_few_pixels() {
    let truth = picture(64, 48);
    let noisy = changed(&truth, |n, color| if n % 29 == 0 { color * 3.0 } else { color });
    let found = metrics(&noisy, &truth);
    assert!(found.relative_rms_luminance > 0.2 && found.rgb_rms > 0.1 && found.bias > 0.02, "{found:?}");
    assert!(found.ssim < 0.9 && found.flip > 0.02, "{found:?}");
    let tinted = changed(&truth, |_, color| {
        let (red, blue) = (color.x + 0.1, color.z - 0.1 * 0.2126 / 0.0722);
        Vec3::new(red, color.y, blue)
    });
    let found = metrics(&tinted, &truth);
    assert!(found.relative_rms_luminance < 1e-6, "equal in luminance: {found:?}");
    assert!(found.rgb_rms > 0.1 && found.flip > 0.02, "different in colour: {found:?}");
}

#[test]
fn what_lies_outside_of_the_mask_does_not_count() {
    let truth = picture(64, 48);
    let outside = |n: usize| truth.alpha[n] <= 0.5;
    let elsewhere = changed(&truth, |n, color| if outside(n) { Vec3::splat(f32::NAN) } else { color });
    assert_eq!(metrics(&elsewhere, &truth), metrics(&truth, &truth));
    assert_eq!(metrics(&truth, &elsewhere), metrics(&truth, &truth));
    let map = difference_map(&elsewhere, &truth, None).expect("comparable");
    assert_eq!(map, difference_map(&truth, &truth, None).expect("comparable"));
    // the mask is A's
    let narrow = Image {
        alpha: truth.alpha.iter().enumerate().map(|(n, a)| if n < 1000 { *a } else { 0.0 }).collect(),
        ..truth.clone()
    };
    assert!(metrics(&narrow, &truth).pixels < metrics(&truth, &narrow).pixels);
}

#[test]
fn tiny_images_are_compared_too() {
    for (width, height) in [(1, 1), (1, 7), (3, 2), (8, 8), (11, 1)] {
        let pixels = (width * height) as usize;
        let truth = Image::opaque(width, height, vec![Vec3::splat(0.5); pixels]).expect("sizes fit");
        let same = metrics(&truth, &truth);
        assert!(same.flip == 0.0 && (same.ssim - 1.0).abs() < 1e-9, "{same:?}");
        let brighter = metrics(&changed(&truth, |_, color| color * 1.5), &truth);
        assert!(
            brighter.flip > 0.01 && brighter.ssim < 0.999 && brighter.bias > 0.49,
            "{width}x{height}: {brighter:?}"
        );
        difference_map(&truth, &truth, None).expect("any size");
    }
}

#[test]
fn unusable_images_are_named() {
    let truth = picture(16, 12);
    let message = |a: &Image, b: &Image| compare(a, b).expect_err("not comparable").to_string();
    let sizes = message(&picture(8, 12), &truth);
    assert!(sizes.contains("A is 8x12") && sizes.contains("B is 16x12"), "{sizes}");
    let broken = changed(&truth, |n, color| if n == 16 * 6 + 8 { Vec3::new(0.0, f32::INFINITY, 0.0) } else { color });
    assert_eq!(message(&broken, &truth), "A is not finite at pixel (8, 6)");
    assert_eq!(message(&truth, &broken), "B is not finite at pixel (8, 6)");
    assert!(message(&truth, &changed(&truth, |_, _| Vec3::ZERO)).contains("black"));
    let transparent = Image { alpha: vec![0.5; truth.rgb.len()], ..truth.clone() };
    assert!(message(&transparent, &truth).contains("mask is empty"));
    assert!(Image::opaque(3, 3, vec![Vec3::ONE; 8]).is_err());
    assert!(Image::opaque(0, 0, Vec::new()).is_err());
    assert!(Image::opaque(u32::MAX, u32::MAX, Vec::new()).is_err());
    assert!(difference_map(&truth, &truth, Some(0.0)).is_err());
    assert!(difference_map(&broken, &truth, None).is_err());
}

#[test]
fn the_map_is_blue_where_dark_and_red_where_bright() {
    let truth = Image::opaque(90, 100, vec![Vec3::splat(0.5); 9000]).expect("sizes fit");
    let other = changed(&truth, |n, color| match n % 90 {
        0..30 => color * 0.5,
        30..60 => color,
        _ => color * 1.5,
    });
    let map = difference_map(&other, &truth, Some(0.5)).expect("comparable");
    let [dark, equal, bright] = [10, 45, 80].map(|x| *map.get_pixel(x, 50));
    assert!(dark[2] > dark[0] + 60, "{dark:?}");
    assert!(equal.0[..3].iter().all(|&channel| channel > 235), "{equal:?}");
    assert!(bright[0] > bright[2] + 60, "{bright:?}");
    // the bar repeats both ends
    let column: Vec<_> = (0..map.height()).map(|y| *map.get_pixel(90 + 12, y)).collect();
    assert!(column.contains(&dark) && column.contains(&bright));
}

#[test]
fn tone_mapping_is_exposure_and_srgb_alone() {
    let image = Image::opaque(3, 1, vec![Vec3::splat(0.5), Vec3::new(4.0, -1.0, f32::NAN), Vec3::splat(0.214_041_14)])
        .expect("sizes fit");
    let shown = to_srgb8(&image, 0.0).expect("sound");
    assert_eq!(shown.get_pixel(0, 0), &Rgba([188, 188, 188, 255]));
    assert_eq!(shown.get_pixel(1, 0), &Rgba([255, 0, 0, 255]));
    assert_eq!(shown.get_pixel(2, 0), &Rgba([128, 128, 128, 255]));
    assert_eq!(to_srgb8(&image, 1.0).expect("sound").get_pixel(0, 0), &Rgba([255, 255, 255, 255]));
    assert!((luminance(Vec3::ONE) - 1.0).abs() < 1e-6);
}

#[test]
fn a_sheet_holds_its_tiles_and_words() {
    let tile = |color: [u8; 4], title: &str| Tile {
        image: RgbaImage::from_pixel(40, 30, Rgba(color)),
        title: title.into(),
        caption: "0.023 diffuse, 0.049 at alpha 0.5".into(),
    };
    let tiles = [tile([255, 0, 0, 255], "one"), tile([0, 255, 0, 255], "two"), tile([0, 0, 255, 128], "three")];
    let sheet = contact_sheet("A sheet", 2, &tiles).expect("three tiles");
    let count = |color: [u8; 4]| sheet.pixels().filter(|pixel| pixel.0 == color).count();
    // 40 pixels are enlarged seven times, to 280
    assert_eq!(count([255, 0, 0, 255]), 280 * 210);
    assert_eq!(count([0, 255, 0, 255]), 280 * 210);
    assert!(count([240, 240, 240, 255]) > 300, "titles");
    assert!(count([180, 180, 180, 255]) > 300, "captions");
    assert!(sheet.pixels().all(|pixel| pixel[3] == 255));
    assert_ne!(
        sheet,
        contact_sheet("A sheet", 2, &[tiles[0].clone(), tiles[1].clone(), tiles[0].clone()]).expect("tiles")
    );
    assert!(contact_sheet("empty", 2, &[]).is_err());
    assert!(contact_sheet("no columns", 0, &tiles).is_err());
    let nothing = Tile { image: RgbaImage::new(0, 4), title: String::new(), caption: String::new() };
    assert!(contact_sheet("nothing", 1, &[nothing]).is_err());
}

fn plot(logarithmic: bool, points: Vec<(f64, f64)>) -> Plot {
    let axis = |title: &str| Axis { title: title.into(), logarithmic };
    let other = Series { name: "other <method>".into(), points: vec![(1.0, 3.0), (100.0, 4.0)] };
    let series = vec![Series { name: "classic".into(), points }, other];
    Plot { title: "Error over samples".into(), x: axis("samples"), y: axis("error"), series }
}

#[test]
fn plots_are_svg_with_axes_and_legend() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("plot.svg");
    for logarithmic in [false, true] {
        plot(logarithmic, vec![(1.0, 10.0), (10.0, 1.0), (100.0, 0.1)]).write(&path).expect("drawn");
        let svg = std::fs::read_to_string(&path).expect("written");
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        for word in ["Error over samples", "samples", "error", "classic", "other &lt;method&gt;"] {
            assert!(svg.contains(word), "{word} is missing");
        }
    }
    plot(true, vec![(2.0, 3.0), (4.0, 8.0)]).write(&path).expect("drawn");
    let svg = std::fs::read_to_string(&path).expect("written");
    let ticks = svg.lines().filter(|line| ["1", "2", "10"].contains(&line.trim())).count();
    assert!(ticks >= 3, "a range without a power of ten has ticks too");
    for extreme in [1e-90, 1e-30, 1e16, 1e99] {
        plot(true, vec![(extreme, extreme)]).write(&path).expect("drawn");
        plot(false, vec![(extreme, -extreme), (extreme * (1.0 + 3e-16), 1.0)]).write(&path).expect("drawn");
        let alone = plot(false, vec![(extreme, extreme), (extreme * (1.0 + 3e-16), extreme)]);
        Plot { series: vec![alone.series[0].clone()], ..alone }.write(&path).expect("drawn");
    }
    assert!(plot(true, vec![(1e-310, 1.0)]).write(&path).is_err());
    assert!(plot(false, vec![(1e308, 1.0)]).write(&path).is_err());
    let old = std::fs::read(&path).expect("written");
    assert!(plot(true, vec![(0.0, 1.0)]).write(&path).is_err(), "no logarithm of 0");
    assert!(plot(false, vec![(f64::NAN, 1.0)]).write(&path).is_err());
    let empty = Plot { series: Vec::new(), ..plot(false, Vec::new()) };
    assert!(empty.write(&path).is_err_and(|e| e.to_string().contains("no points")));
    assert_eq!(std::fs::read(&path).expect("still there"), old);
    plot(false, vec![(2.0, 2.0)]).write(&folder.path().join("missing/plot.svg")).expect_err("no such folder");
}
