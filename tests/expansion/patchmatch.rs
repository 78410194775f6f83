//! Nearest neighbour fields.

use std::f32::consts::TAU;

use glam::{UVec2, Vec2, Vec3, vec2};
use relume::preprocess::expansion::patchmatch::{Field, Match, Options, search};
use relume::preprocess::expansion::pyramid::Pyramid;
use relume::reference::patches;

use super::{Random, on_threads};

const SIDE: u32 = 256;
const LEVELS: usize = 5;
const ANGLE: f32 = 0.6;
const SCALE: f32 = 1.25;

/// Waves of many directions and lengths, three colours.
struct Texture(Vec<(Vec2, Vec3, Vec3)>);

impl Texture {
    fn new() -> Self {
        let mut random = Random(11);
        let mut wave = |n: u32| {
            let length = 7.0 * 20.0_f32.powf(n as f32 / 59.0);
            let phases = random.vector() * TAU;
            (Vec2::from_angle(random.next() * TAU) * (TAU / length), phases, random.vector() * 0.08)
        };
        Self((0..60).map(&mut wave).collect())
    }

    fn at(&self, place: Vec2) -> Vec3 {
        let value = |(k, phases, heights): &(Vec2, Vec3, Vec3)| (*phases + k.dot(place)).map(f32::sin) * *heights;
        self.0.iter().map(value).fold(Vec3::splat(0.5), |sum, value| sum + value)
    }
}

/// Where the pixel of the first image is in the second.
fn truth(pixel: Vec2) -> Vec2 {
    let middle = Vec2::splat(0.5 * SIDE as f32);
    middle + (Vec2::from_angle(ANGLE) * SCALE).rotate(pixel - middle) + vec2(30.0, 10.0)
}

/// The inverse.
fn source(pixel: Vec2) -> Vec2 {
    let middle = Vec2::splat(0.5 * SIDE as f32);
    middle + (Vec2::from_angle(-ANGLE) / SCALE).rotate(pixel - middle - vec2(30.0, 10.0))
}

/// A textured image, and a copy of it that is turned, enlarged and shifted.
fn pair() -> (Pyramid, Pyramid) {
    let texture = Texture::new();
    let place = |x: u32, y: u32| vec2(x as f32, y as f32);
    let first = Pyramid::new(SIDE, SIDE, LEVELS, |x, y| (texture.at(place(x, y)), 1.0));
    let second = Pyramid::new(SIDE, SIDE, LEVELS, |x, y| (texture.at(source(place(x, y))), 1.0));
    (first, second)
}

fn find((first, second): (&Pyramid, &Pyramid), wanted: &[bool], options: &Options) -> Field {
    let size = (first.levels[0].width, first.levels[0].height);
    search((first, 0, size), second, wanted, options)
}

/// All bits of a match.
fn key(found: &Match) -> [u32; 5] {
    [found.at.x, found.at.y, found.angle, found.log_scale, found.cost].map(f32::to_bits)
}

#[test]
fn a_turned_scaled_shifted_copy_is_found() {
    let (first, second) = pair();
    let wanted = vec![true; (SIDE * SIDE) as usize];
    let field = find((&first, &second), &wanted, &Options::default());
    assert_eq!((field.width, field.height, field.matches.len()), (SIDE, SIDE, wanted.len()));
    let inside = |p: Vec2| p.cmpge(Vec2::splat(16.0)).all() && p.cmple(Vec2::splat(SIDE as f32 - 17.0)).all();
    let (mut interior, mut near, mut alike) = (0, 0, 0);
    for (n, found) in field.matches.iter().enumerate() {
        let pixel = vec2((n as u32 % SIDE) as f32, (n as u32 / SIDE) as f32);
        if inside(pixel) && inside(truth(pixel)) {
            interior += 1;
            near += u32::from(found.at.distance(truth(pixel)) <= 1.0);
            alike += u32::from((found.angle - ANGLE).abs() < 0.1 && (found.log_scale - SCALE.log2()).abs() < 0.15);
        }
    }
    assert!(interior > 20_000, "{interior} pixels");
    let share = |count: u32| count as f32 / interior as f32;
    eprintln!("{:.2} % within a pixel, {:.2} % turned alike", 100.0 * share(near), 100.0 * share(alike));
    assert!(share(near) >= 0.95, "{:.2} % are within a pixel", 100.0 * share(near));
    assert!(share(alike) >= 0.95, "{:.2} % are turned and scaled alike", 100.0 * share(alike));
    // Each costs what its definition says.
    let mut random = Random(4);
    for _ in 0..500 {
        let pixel = UVec2::new((random.next() * SIDE as f32) as u32, (random.next() * SIDE as f32) as u32);
        let found = &field.matches[(pixel.y * SIDE + pixel.x) as usize];
        let expected = patches::difference(&first, &second, pixel, found);
        let error = (f64::from(found.cost) - expected).abs();
        assert!(error < 1e-3 * expected + 1e-5, "{pixel}: {} for {expected}", found.cost);
    }
}

/// A disc, and what lies around it is not asked for.
fn disc() -> Vec<bool> {
    let at = |n: u32| vec2((n % SIDE) as f32, (n / SIDE) as f32);
    (0..SIDE * SIDE).map(|n| at(n).distance(vec2(120.0, 130.0)) < 40.0).collect()
}

#[test]
fn threads_change_nothing_and_only_wanted_pixels_are_matched() {
    let (first, second) = pair();
    let wanted = disc();
    let options = Options { first_guesses: 64, ..Options::default() };
    let run = |threads| on_threads(threads, || find((&first, &second), &wanted, &options));
    let (one, two) = (run(1), run(2));
    assert_eq!(one.compared, two.compared);
    assert!(one.matches.iter().map(key).eq(two.matches.iter().map(key)));
    for (found, wanted) in one.matches.iter().zip(&wanted) {
        assert_eq!(found.cost.is_finite(), *wanted);
    }
    let other = find((&first, &second), &wanted, &Options { seed: 2, ..options });
    assert!(!one.matches.iter().map(key).eq(other.matches.iter().map(key)), "the seed is not used");
    let nothing = find((&first, &second), &vec![false; wanted.len()], &Options::default());
    assert_eq!(nothing.compared, 0);
    assert!(nothing.matches.iter().all(|found| found.cost == f32::INFINITY));
}

/// What is invalid costs nothing and says nothing; the definition knows that too.
#[test]
fn invalid_pixels_do_not_count() {
    let (_, second) = pair();
    let texture = Texture::new();
    let valid = |x: u32, _y: u32| if x % 64 < 20 { 0.0 } else { 1.0 };
    let color =
        |x: u32, y: u32| if valid(x, y) > 0.0 { texture.at(vec2(x as f32, y as f32)) } else { Vec3::splat(9.0) };
    let first = Pyramid::new(SIDE, SIDE, LEVELS, |x, y| (color(x, y), valid(x, y)));
    let wanted: Vec<bool> =
        disc().iter().enumerate().map(|(n, &disc)| disc && valid(n as u32 % SIDE, 0) > 0.0).collect();
    let field = find((&first, &second), &wanted, &Options { first_guesses: 64, ..Options::default() });
    let mut good = 0;
    for n in (0..wanted.len()).filter(|&n| wanted[n]) {
        let pixel = UVec2::new(n as u32 % SIDE, n as u32 / SIDE);
        let found = &field.matches[n];
        good += usize::from(found.at.distance(truth(pixel.as_vec2())) <= 2.0);
        if n.is_multiple_of(37) {
            let expected = patches::difference(&first, &second, pixel, found);
            assert!((f64::from(found.cost) - expected).abs() < 1e-3 * expected + 1e-5, "{pixel}: {}", found.cost);
        }
    }
    let count = wanted.iter().filter(|wanted| **wanted).count();
    assert!(good as f32 > 0.8 * count as f32, "{good} of {count}");
}

#[test]
fn flat_and_tiny_images() {
    let white = |width, height, levels| Pyramid::new(width, height, levels, |_, _| (Vec3::ONE, 1.0));
    for (first, second) in [
        (white(64, 64, 3), white(48, 64, 3)),
        (white(7, 7, 1), white(7, 7, 1)),
        (white(7, 7, 3), white(9, 7, 4)),
        (white(1, 1, 1), white(7, 7, 2)),
        (white(40, 1, 2), white(1, 40, 2)),
    ] {
        let size = first.levels[0].width * first.levels[0].height;
        let field = find((&first, &second), &vec![true; size as usize], &Options::default());
        let last = vec2(second.levels[0].width as f32, second.levels[0].height as f32) - 0.5;
        for found in &field.matches {
            assert!(found.cost.abs() < 1e-6, "white is white: {found:?}");
            assert!(found.at.cmpge(Vec2::splat(-0.5)).all() && found.at.cmple(last).all(), "{found:?}");
        }
    }
    // Nothing of the first is known.
    let unknown = Pyramid::new(32, 32, 2, |_, _| (Vec3::ZERO, 0.0));
    let field = find((&unknown, &white(32, 32, 2)), &vec![true; 32 * 32], &Options::default());
    assert!(field.matches.iter().all(|found| found.cost == f32::INFINITY));
}
