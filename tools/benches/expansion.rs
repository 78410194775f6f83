//! Time of the steps of the dynamic range expansion.
//!
//! `cargo bench --bench expansion` prints each step's share once, then lets criterion measure.

use std::f32::consts::TAU;
use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{Vec2, Vec3};
use relume::preprocess::expansion::Transfer;
use relume::preprocess::expansion::patchmatch::{Options, search};
use relume::preprocess::expansion::poisson::{DEFAULT_NEIGHBOURS, Problem, solve};
use relume::preprocess::expansion::pyramid::Pyramid;

/// Numbers from 0 to 1, the same every time (Knuth's linear congruential generator).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }
}

/// 458 x 458 scattered points on a floor, of which all but four rows at each edge are unknown, 202,500: the hardest
/// case for an iterative solver, because what is known is far from most of them.
fn poisson(criterion: &mut Criterion) {
    const SIDE: usize = 458;
    let mut random = Random(2019);
    let mut place = |at: usize| 0.01 * (at as f32 + random.next());
    let positions: Vec<Vec3> = (0..SIDE * SIDE).map(|at| Vec3::new(place(at % SIDE), 0.0, place(at / SIDE))).collect();
    let inside = |at: usize| (4..SIDE - 4).contains(&at);
    let unknown: Vec<bool> = (0..SIDE * SIDE).map(|at| inside(at % SIDE) && inside(at / SIDE)).collect();
    let low: Vec<Vec3> = positions.iter().map(|p| Vec3::splat((9.0 * p.x).sin() * (7.0 * p.z).cos())).collect();
    let high: Vec<Vec3> = positions.iter().map(|p| *p + 2.0).collect();
    let problem =
        Problem { positions: &positions, low: &low, unknown: &unknown, silent: &[], neighbours: DEFAULT_NEIGHBOURS };

    let mut group = criterion.benchmark_group("poisson");
    group.sample_size(10);
    for (name, transfer) in [("luminance", Transfer::Luminance), ("rgb", Transfer::Rgb)] {
        let mut solution = high.clone();
        let Ok(report) = solve(&problem, transfer, &mut solution, &|_| {}) else { return };
        let (iterations, residual) = (report.iterations, report.residual);
        println!("{name}: {} unknowns, {iterations} iterations, residual {residual:.1e}", report.unknowns);
        report.seconds.iter().for_each(|(step, seconds)| println!("  {step:20}{:8.1} ms", seconds * 1e3));
        group.bench_function(format!("{name}, {} unknowns", report.unknowns), |bencher| {
            bencher.iter(|| black_box(solve(black_box(&problem), transfer, &mut solution, &|_| {})));
        });
    }
    group.finish();
}

/// Every pixel of a face of 256 x 256 in a photo of 640 x 480 that shows the same waves, turned and enlarged.
fn patchmatch(criterion: &mut Criterion) {
    const SIDE: u32 = 256;
    let mut random = Random(2010);
    let mut wave = |n: u32| {
        let length = 7.0 * 20.0_f32.powf(n as f32 / 39.0);
        (Vec2::from_angle(random.next() * TAU) * (TAU / length), random.next() * TAU)
    };
    let waves: Vec<(Vec2, f32)> = (0..40).map(&mut wave).collect();
    let color = |place: Vec2| {
        let of_channel = |shift: f32| waves.iter().map(|(k, phase)| (phase + shift + k.dot(place)).sin()).sum::<f32>();
        Vec3::new(of_channel(0.0), of_channel(0.3), of_channel(0.9)) * 0.04 + 0.5
    };
    let place = |x: u32, y: u32| Vec2::new(x as f32, y as f32);
    let face = Pyramid::new(SIDE, SIDE, 5, |x, y| (color(place(x, y)), 1.0));
    let turned = |place: Vec2| Vec2::from_angle(0.4).rotate(place) * 0.6;
    let photo = Pyramid::new(640, 480, 5, |x, y| (color(turned(place(x, y))), 1.0));
    let wanted = vec![true; (SIDE * SIDE) as usize];
    let run = || search((&face, 0, (SIDE, SIDE)), &photo, black_box(&wanted), &Options::default());

    let (start, field) = (Instant::now(), run());
    let (seconds, pixels) = (start.elapsed().as_secs_f64(), f64::from(SIDE * SIDE));
    println!(
        "patchmatch: {:.3} Mpixel/s, {} patches a pixel",
        1e-6 * pixels / seconds,
        field.compared / wanted.len() as u64
    );
    let mut group = criterion.benchmark_group("patchmatch");
    group.sample_size(10);
    group.throughput(Throughput::Elements(wanted.len() as u64));
    group.bench_function("256x256 in 640x480", |bencher| bencher.iter(|| black_box(run())));
    group.finish();
}

criterion_group!(benches, poisson, patchmatch);
criterion_main!(benches);
