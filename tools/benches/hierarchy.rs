//! Time and memory of the hierarchy builder on a generated room of three million points. The points come in random
//! order, which is harder than a scan, whose neighbours in the file are neighbours in space.
//!
//! `cargo bench --bench hierarchy` prints each step's share and the memory once, then lets criterion measure.

use std::fs;
use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use glam::{Vec2, Vec3};
use relume::preprocess::hierarchy::{BuildOptions, build};
use relume::scene::Cloud;

/// Points of the room.
const POINTS: usize = 3_000_000;

/// Width, height and depth of the room, metres.
const SIZE: Vec3 = Vec3::new(8.0, 3.0, 6.0);

/// Numbers from 0 to 1, the same every time (Knuth's linear congruential generator).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }

    /// Each coordinate from -1 to 1.
    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }
}

/// Six walls with tiles, three balls, a lamp on the ceiling; 3 mm of noise.
fn room() -> Cloud {
    let mut random = Random(2019);
    let mut cloud = Cloud::default();
    let area = 2.0 * (SIZE.x * SIZE.y + SIZE.y * SIZE.z + SIZE.z * SIZE.x);
    let spacing = (area / POINTS as f32).sqrt();
    while cloud.len() < POINTS {
        let on_ball = random.next() < 0.1;
        let (position, normal) = if on_ball { ball(&mut random) } else { wall(&mut random) };
        cloud.positions.push(position + 0.003 * random.vector());
        cloud.normals.push((normal + 0.05 * random.vector()).normalize());
        cloud.colors.push(color(position) * (1.0 + 0.005 * random.next()));
        cloud.spacing.push(spacing * (0.8 + 0.4 * random.next()));
    }
    cloud
}

/// A point of the walls, uniform by area, and the normal into the room.
fn wall(random: &mut Random) -> (Vec3, Vec3) {
    let areas = [SIZE.y * SIZE.z, SIZE.z * SIZE.x, SIZE.x * SIZE.y];
    let mut pick = random.next() * areas.iter().sum::<f32>();
    let mut axis = 0;
    while axis < 2 && pick > areas[axis] {
        pick -= areas[axis];
        axis += 1;
    }
    let far = random.next() < 0.5;
    let mut position = SIZE * Vec3::new(random.next(), random.next(), random.next());
    position[axis] = if far { SIZE[axis] } else { 0.0 };
    let mut normal = Vec3::ZERO;
    normal[axis] = if far { -1.0 } else { 1.0 };
    (position, normal)
}

/// A point of one of three balls, and its normal.
fn ball(random: &mut Random) -> (Vec3, Vec3) {
    let center = Vec3::new(2.0 + 2.0 * (random.next() * 3.0).floor(), 0.5, 3.0);
    let normal = random.vector().normalize_or(Vec3::Y);
    (center + 0.5 * normal, normal)
}

/// Tiles of 80 cm, and a lamp in the middle of the ceiling.
fn color(position: Vec3) -> Vec3 {
    if position.y > 2.9 && Vec2::new(position.x, position.z).distance(Vec2::new(4.0, 3.0)) < 0.3 {
        return Vec3::splat(60.0);
    }
    let tile = (position / 0.8).floor();
    Vec3::new(0.6, 0.5, 0.4) + 0.15 * Vec3::new(tile.x.sin(), tile.y.sin(), (tile.x + tile.z).sin())
}

/// A line of /proc/self/status in bytes; none where there is no such thing.
fn memory(line: &str) -> Option<usize> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let kibibytes = status.lines().find_map(|l| l.strip_prefix(line))?.split_whitespace().nth(1)?;
    Some(kibibytes.parse::<usize>().ok()? * 1024)
}

/// One build with its report, and the most memory that it took beyond the cloud.
fn describe(name: &str, cloud: &Cloud, options: &BuildOptions) {
    // Resets the peak to what is used now; refused in some containers, where the peak is then that of all so far.
    let reset = fs::write("/proc/self/clear_refs", "5").is_ok();
    let before = memory("VmRSS");
    let Ok((hierarchy, report)) = build(cloud, options) else { return };
    let peak = memory("VmHWM");

    let total: f64 = report.seconds.iter().map(|(_, seconds)| seconds).sum();
    println!("{name}: {} nodes of {}, depth {}", hierarchy.len(), report.nodes_before, report.depth);
    for (step, seconds) in &report.seconds {
        println!("  {step:22}{:8.1} ms {:5.1} %", seconds * 1e3, seconds / total * 100.0);
    }
    println!("  {:22}{:8.1} ms", "all", total * 1e3);
    let per_point = |bytes: usize| bytes as f64 / report.points as f64;
    println!("  estimated peak        {:8.1} bytes a point", per_point(report.peak_bytes_estimate));
    if let (true, Some(before), Some(peak)) = (reset, before, peak) {
        println!("  measured peak         {:8.1} bytes a point", per_point(peak.saturating_sub(before)));
    }
}

fn hierarchy(criterion: &mut Criterion) {
    let cloud = room();
    for (name, options) in [("unpruned", BuildOptions::unpruned()), ("pruned", BuildOptions::default())] {
        describe(name, &cloud, &options);
        let mut group = criterion.benchmark_group("hierarchy");
        group.sample_size(10);
        group.bench_function(format!("{name}, {POINTS} points"), |bencher| {
            bencher.iter(|| black_box(build(black_box(&cloud), &options)));
        });
        group.finish();
    }
}

criterion_group!(benches, hierarchy);
criterion_main!(benches);
