//! Clouds in the light of lamps against the path tracer: direct light, bounces, energy, shadows; and odd input.

mod common;

use std::f32::consts::PI;
use std::sync::{Arc, LazyLock};

use common::Device;
use glam::{Vec3, vec3};
use rayon::prelude::*;
use relume::compare::luminance;
use relume::frames::lamps::{LampFrame, LampRenderer, LampSettings, Surfaces};
use relume::gpu::Context;
use relume::preprocess::point_chunks::PointChunks;
use relume::reference::path_tracer::PathTracer;
use relume::reference::rooms::{Rectangle, Room, cornell_box};
use relume::scene::{Camera, Cloud, Lamp};

/// Side of the images, pixels.
const SIZE: usize = 128;
/// Means of so many blocks of pixels along a side are compared: edges are not smooth in either picture.
const BLOCKS: usize = 64;
/// From before the box into it, past the blocks: nothing is so near the lamp that the few pixels of its edges would decide.
const FRONT: &str = "spot at=0.9,1.7,2.4 to=-0.2,0.8,-0.6 power=40 angle=44";
/// From the middle of the ceiling down past the tall block.
const CEILING: &str = "spot at=0,1.9,0.4 to=0.1,0,-0.2 power=40 angle=80";

fn lamp(text: &str) -> Lamp {
    text.parse().expect("a lamp")
}

/// A room sampled to points.
struct Scene {
    tracer: PathTracer,
    chunks: Arc<PointChunks>,
}

impl Scene {
    fn new(room: Room, points: usize) -> Self {
        let tracer = PathTracer::new(room).expect("a room");
        let chunks = PointChunks::new(&tracer.albedo_cloud(points, 1)).expect("few points");
        Self { tracer, chunks: Arc::new(chunks) }
    }

    fn renderer(&self, context: &Arc<Context>, settings: LampSettings) -> LampRenderer {
        LampRenderer::new(context, &self.chunks, settings).expect("a renderer")
    }
}

/// The Cornell box with 300,000 points.
static BOX: LazyLock<Scene> = LazyLock::new(|| Scene::new(cornell_box(), 300_000));

fn camera() -> Camera {
    Camera { from: vec3(0.0, 1.0, 3.7), at: vec3(0.0, 1.0, 0.0), fov_y: 40_f32.to_radians() }
}

fn settings(bounces: u32, vpls: u32) -> LampSettings {
    let (width, height) = (SIZE as u32, SIZE as u32);
    LampSettings { width, height, bounces, vpls, interleave: 1, ..LampSettings::default() }
}

/// Radiance of every pixel by the number of bounces, from paths.
fn truth(size: usize, tracer: &PathTracer, lamps: &[Lamp], (bounces, paths): (usize, u32)) -> Vec<Vec<f32>> {
    let (camera, size) = (camera(), size as u32);
    let at = |k: u32| {
        let direction = camera.ray_direction(k % size, k / size, size, size);
        let Some(hit) = tracer.hit(camera.from, direction).filter(|hit| hit.front) else {
            return vec![0.0; bounces + 1];
        };
        let surface = &tracer.room().surfaces[hit.surface];
        let albedo = surface.albedo_at(hit.u, hit.v);
        let place = (surface.at(hit.u, hit.v), surface.normal());
        let irradiance = tracer.lamp_bounces(lamps, place, bounces, paths, u64::from(k));
        irradiance.into_iter().map(|irradiance| luminance(albedo * irradiance / PI)).collect()
    };
    (0..size * size).into_par_iter().map(at).collect()
}

/// Root mean square of the difference in luminance, and difference of the means, both over the mean of the truth.
#[derive(Debug)]
struct Difference {
    rms: f32,
    bias: f32,
}

/// Over blocks of pixels; of all light after up to `bounces` bounces, or of the bounced light alone.
fn difference(radiance: &[f32], truth: &[Vec<f32>], bounces: std::ops::RangeInclusive<usize>) -> Difference {
    let size = truth.len().isqrt();
    let mut blocks = vec![(0.0, 0.0); BLOCKS * BLOCKS];
    let share = (BLOCKS * BLOCKS) as f32 / truth.len() as f32;
    for (k, (value, expected)) in radiance.iter().zip(truth).enumerate() {
        let block = &mut blocks[k / size * BLOCKS / size * BLOCKS + k % size * BLOCKS / size];
        block.0 += value * share;
        block.1 += expected[bounces.clone()].iter().sum::<f32>() * share;
    }
    let total: f32 = blocks.iter().map(|block| block.1).sum();
    let squares: f32 = blocks.iter().map(|block| (block.0 - block.1).powi(2)).sum();
    let sum: f32 = blocks.iter().map(|block| block.0 - block.1).sum();
    Difference { rms: (squares * blocks.len() as f32).sqrt() / total, bias: sum / total }
}

fn radiance(frame: &LampFrame) -> Vec<f32> {
    frame.color_depth.iter().map(|[r, g, b, _]| luminance(vec3(*r, *g, *b))).collect()
}

fn mean(frame: &LampFrame) -> f32 {
    frame.color_depth.iter().map(|[r, g, b, _]| luminance(vec3(*r, *g, *b))).sum::<f32>()
        / frame.color_depth.len() as f32
}

#[test]
fn bounces_in_the_cornell_box_match_the_path_tracer() {
    const FINE: usize = 192;
    let device = Device::new();
    let scene = Scene::new(cornell_box(), 1_000_000);
    let spot = [lamp(FRONT)];
    let truth = truth(FINE, &scene.tracer, &spot, (3, 128));
    let render = |bounces| {
        let settings = LampSettings { width: FINE as u32, height: FINE as u32, ..settings(bounces, 1024) };
        radiance(&scene.renderer(&device.0, settings).render(&camera(), &spot).expect("a picture"))
    };
    let direct = render(0);
    println!("direct: {:?}", difference(&direct, &truth, 0..=0));
    for (bounces, most) in [(1, 0.08), (2, 0.08), (3, 0.08)] {
        let all = render(bounces as u32);
        let bounced: Vec<f32> = all.iter().zip(&direct).map(|(all, direct)| all - direct).collect();
        let (whole, alone) = (difference(&all, &truth, 0..=bounces), difference(&bounced, &truth, 1..=bounces));
        println!("{bounces} bounces: {whole:?}, bounced light alone {alone:?}");
        assert!(whole.rms < most && whole.bias.abs() < 0.05, "{bounces} bounces: {whole:?}");
        assert!(alone.rms < 0.17 && alone.bias.abs() < 0.06, "{bounces} bounces: {alone:?}");
    }
}

#[test]
fn more_lights_converge_and_the_mean_depends_on_no_setting() {
    let device = Device::new();
    let spot = [lamp(CEILING)];
    let truth = truth(SIZE, &BOX.tracer, &spot, (2, 128));
    let render =
        |settings: LampSettings| BOX.renderer(&device.0, settings).render(&camera(), &spot).expect("a picture");
    let direct = radiance(&render(settings(0, 64)));
    let mut last = f32::INFINITY;
    let mut means = Vec::new();
    for vpls in [64, 256, 1024, 4096] {
        let frame = render(settings(2, vpls));
        let bounced: Vec<f32> = radiance(&frame).iter().zip(&direct).map(|(all, direct)| all - direct).collect();
        let difference = difference(&bounced, &truth, 1..=2);
        println!("{vpls} lights: {difference:?}");
        assert!(difference.rms < last, "{vpls} lights: {difference:?} after {last}");
        last = difference.rms;
        means.push((format!("{vpls} lights"), mean(&frame)));
    }
    for interleave in [2, 4] {
        means.push((
            format!("interleaved {interleave}"),
            mean(&render(LampSettings { interleave, ..settings(2, 256) })),
        ));
    }
    for ism_size in [16, 64] {
        means.push((format!("maps of {ism_size}"), mean(&render(LampSettings { ism_size, ..settings(2, 256) }))));
    }
    println!("{means:?}");
    let wanted = means[2].1;
    for (what, mean) in means {
        assert!((mean / wanted - 1.0).abs() < 0.03, "{what}: {mean} instead of {wanted}");
    }
}

#[test]
fn points_suns_and_several_lamps_match_the_path_tracer() {
    let device = Device::new();
    let lamps = [
        "point at=0.2,1.4,0.6 power=60",
        "sun direction=-0.3,-0.6,-1 power=4",
        "spot at=-0.8,1.8,0.8 to=0.5,0,0 power=10 angle=50 color=1,0.4,0.1",
    ];
    let lamps = lamps.map(lamp);
    let mut renderer = BOX.renderer(&device.0, settings(1, 1024));
    for chosen in [&lamps[..1], &lamps[1..2], &lamps[..]] {
        let truth = truth(SIZE, &BOX.tracer, chosen, (1, 64));
        let frame = renderer.render(&camera(), chosen).expect("a picture");
        let difference = difference(&radiance(&frame), &truth, 0..=1);
        println!("{} lamps: {difference:?}", chosen.len());
        // A sun from outside leaks in along the edges of walls that have no thickness.
        assert!(difference.rms < 0.25 && difference.bias.abs() < 0.05, "{}: {difference:?}", chosen[0]);
    }
}

#[test]
fn a_cube_that_only_a_wall_lights_casts_a_soft_shadow() {
    // Figure 6: a spot on the right wall, a cube in the middle of the floor.
    let device = Device::new();
    let mut room = cornell_box();
    let tall = 5..10;
    room.surfaces.drain(tall);
    let scene = Scene::new(room, 300_000);
    let spot = [lamp("spot at=-0.6,1.2,0.2 to=1,0.7,0.2 power=40 angle=40")];
    let frame = scene.renderer(&device.0, settings(1, 1024)).render(&camera(), &spot).expect("a picture");
    let truth = truth(SIZE, &scene.tracer, &spot, (1, 256));
    // Along two rows of the floor before the cube, two pixels at a time: paths are noisy.
    let lit = radiance(&frame);
    let row: Vec<(f32, f32)> = (0..SIZE / 2)
        .map(|x| {
            let pixels = [123, 124].into_iter().flat_map(|y| [2 * x, 2 * x + 1].map(|x| y * SIZE + x));
            pixels.fold((0.0, 0.0), |sum, k| (sum.0 + lit[k] / 4.0, sum.1 + truth[k][1] / 4.0))
        })
        .collect();
    println!("{row:.3?}");
    let brightest = row.iter().map(|(_, expected)| *expected).fold(0.0, f32::max);
    for (value, expected) in &row {
        assert!((value - expected).abs() < 0.2 * brightest, "{value} instead of {expected}: {row:.3?}");
    }
    // It is there, and soft: dark, half lit and bright parts.
    for share in [0.0..0.3, 0.3..0.7, 0.7..1.01] {
        let count = row.iter().filter(|(value, _)| share.contains(&(value / brightest))).count();
        assert!(count >= 3, "{count} places of {share:?}: {row:.3?}");
    }
}

#[test]
fn the_same_lamps_give_the_same_bytes() {
    let device = Device::new();
    let spot = [lamp(CEILING)];
    let settings = LampSettings {
        interleave: 2,
        surfaces: Surfaces { diffuse: 0.7, specular: 0.3, shininess: 20.0 },
        ..settings(3, 256)
    };
    let bytes = |renderer: &mut LampRenderer| renderer.render(&camera(), &spot).expect("a picture").color_depth;
    let mut renderer = BOX.renderer(&device.0, settings);
    let first = bytes(&mut renderer);
    renderer.render(&camera(), &[lamp("point at=0,1,0 power=3")]).expect("another picture");
    assert!(first == bytes(&mut renderer), "after other lamps");
    assert!(first == bytes(&mut BOX.renderer(&device.0, settings)), "in another renderer");
    let dark = renderer.render(&camera(), &[]).expect("a dark picture");
    assert!(dark.color_depth.iter().all(|[r, g, b, _]| r + g + b == 0.0) && mean(&dark) == 0.0);
}

#[test]
fn odd_lamps_and_clouds_give_dark_pixels_or_clear_errors_but_no_nan() {
    let device = Device::new();
    let lamps = [
        "spot at=0,1,-1.5 to=0,1,-3 power=5 angle=40",
        "spot at=-1,1,0 to=1,1,0 power=5 angle=170",
        "point at=-0.34,0.5,-0.36 power=5",
        "point at=0,0,0 power=5",
        "sun direction=0,1,0 power=1e9",
        "spot at=0,1.9,0 to=0,0,0 power=1e-9 angle=0.1",
    ];
    let small = LampSettings { width: 33, height: 20, light_size: 64, ..settings(2, 64) };
    let mut renderer = BOX.renderer(&device.0, small);
    for text in lamps {
        let frame = renderer.render(&camera(), &[lamp(text)]).expect("a picture");
        assert!(frame.color_depth.iter().flatten().all(|v| v.is_finite()), "{text}");
    }
    let clouds: [&[Vec3]; 4] =
        [&[], &[vec3(0.0, 1.0, 0.0)], &[Vec3::ZERO; 3], &[vec3(1e9, 0.0, 0.0), vec3(0.0, 1e-20, 0.0)]];
    for positions in clouds {
        let (colors, normals) = (vec![Vec3::ONE; positions.len()], vec![Vec3::Z; positions.len()]);
        let cloud = Cloud { positions: positions.to_vec(), colors, normals, ..Cloud::default() };
        let chunks = Arc::new(PointChunks::new(&cloud).expect("few points"));
        let mut renderer = LampRenderer::new(&device.0, &chunks, small).expect("a renderer");
        let lamps = [lamp("spot at=0,1,3 to=0,1,0 power=5 angle=60"), lamp("sun direction=0,0,-1 power=1")];
        let frame = renderer.render(&camera(), &lamps).expect("a picture");
        assert!(frame.color_depth.iter().flatten().all(|v| v.is_finite()), "{positions:?}");
    }
    let bare = Arc::new(PointChunks::from_points(&[Vec3::ONE], &[Vec3::ONE], &[]).expect("a point"));
    let message = LampRenderer::new(&device.0, &bare, small).err().expect("no normals").to_string();
    assert!(message.contains("normals"), "{message}");
    for (wrong, word) in [
        (LampSettings { bounces: 9, ..small }, "9 bounces"),
        (LampSettings { vpls: 100, ..small }, "multiple of 16"),
        (LampSettings { interleave: 3, ..small }, "interleaving"),
        (LampSettings { ism_size: 48, ..small }, "power of two"),
        (LampSettings { light_size: 0, ..small }, "views of lamps"),
        (LampSettings { surfaces: Surfaces { diffuse: 0.9, specular: 0.2, shininess: 5.0 }, ..small }, "more light"),
    ] {
        let message = LampRenderer::new(&device.0, &BOX.chunks, wrong).err().expect(word).to_string();
        assert!(message.contains(word), "{message}");
    }
    let many = vec![lamp("point at=0,1,0 power=1"); 11];
    let message = renderer.render(&camera(), &many).expect_err("66 views").to_string();
    assert!(message.contains("66 views"), "{message}");
}

#[test]
fn one_lit_rectangle_sends_what_a_lambertian_does() {
    // A floor and a wall that face each other at a right angle; one bounce, by hand at a few places.
    let device = Device::new();
    let white = Vec3::splat(0.8);
    let floor = Rectangle::new(vec3(-2.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 4.0, white);
    let wall = Rectangle::new(vec3(-2.0, 0.0, -1.0), Vec3::X * 4.0, Vec3::Y * 2.0, white);
    let scene = Scene::new(Room { surfaces: vec![floor, wall] }, 200_000);
    let spot = [lamp("spot at=0,1.5,0.5 to=0,0,0.5 power=10 angle=30")];
    let mut renderer = scene.renderer(&device.0, settings(1, 1024));
    renderer.render(&camera(), &spot).expect("a picture");
    let [_, bounced] = renderer.irradiance().expect("irradiance");
    // Flux on the floor is the power; seen from 1 m up the wall it comes from one spot of light in good approximation.
    let index = SIZE / 2 * SIZE + SIZE / 2;
    let (to, intensity) = (vec3(0.0, -1.0, 1.5), 10.0 * 0.8 / PI);
    let expected = intensity * 1.0 * 1.5 / to.length_squared().powi(2);
    let value = bounced[index][0];
    assert!((value / expected - 1.0).abs() < 0.10, "{value} instead of {expected}");
}
