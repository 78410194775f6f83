//! Clouds in the light of lamps against the path tracer: direct light, bounces, energy, shadows; and odd input.

mod common;

use std::f32::consts::PI;
use std::sync::{Arc, LazyLock};

use common::Device;
use glam::{Vec3, vec3};
use rayon::prelude::*;
use relume::compare::luminance;
use relume::frames::lamps::{AlbedoFrom, Brush, LampFrame, LampRenderer, LampSettings, Surfaces};
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
    for (text, most) in [(FRONT, [0.05; 3]), (CEILING, [0.11, 0.10, 0.10])] {
        let spot = [lamp(text)];
        let truth = truth(FINE, &scene.tracer, &spot, (3, 128));
        let render = |bounces| {
            let settings = LampSettings { width: FINE as u32, height: FINE as u32, ..settings(bounces, 1024) };
            radiance(&scene.renderer(&device.0, settings).render(&camera(), &spot).expect("a picture"))
        };
        let direct = render(0);
        println!("{text}: direct {:?}", difference(&direct, &truth, 0..=0));
        for (bounces, most) in (1..).zip(most) {
            let all = render(bounces as u32);
            let bounced: Vec<f32> = all.iter().zip(&direct).map(|(all, direct)| all - direct).collect();
            let (whole, alone) = (difference(&all, &truth, 0..=bounces), difference(&bounced, &truth, 1..=bounces));
            println!("{bounces} bounces: {whole:?}, bounced light alone {alone:?}");
            assert!(whole.rms < most && whole.bias.abs() < 0.05, "{bounces} bounces: {whole:?}");
            assert!(alone.rms < 0.17 && alone.bias.abs() < 0.06, "{bounces} bounces: {alone:?}");
        }
    }
}

#[test]
fn silhouettes_lie_where_the_surfaces_end() {
    let device = Device::new();
    let frame = BOX.renderer(&device.0, settings(0, 16)).render(&camera(), &[]).expect("a picture");
    let (camera, size) = (camera(), SIZE as u32);
    let (.., forward) = camera.basis();
    let wrong = |k: &u32| {
        let direction = camera.ray_direction(k % size, k / size, size, size);
        let hit = BOX.tracer.hit(camera.from, direction).filter(|hit| hit.front);
        let expected = hit.map_or(0.0, |hit| hit.distance * direction.dot(forward));
        (frame.color_depth[*k as usize][3] - expected).abs() > 0.02 * expected
    };
    let count = (0..size * size).filter(wrong).count();
    println!("{count} pixels show another surface");
    assert!(count < 60, "{count} pixels show another surface");
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
fn mirror_lobes_make_no_light() {
    // A closed box, a spot straight down at its floor: a lobe at a right angle reflects all of its share.
    let device = Device::new();
    let (low, high, albedo, power) = (Vec3::splat(-1.0), Vec3::splat(1.0), 0.8, 12.0);
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let walls = [(low, z, x), (low, x, y), (low, y, z), (high, -x, -z), (high, -y, -x), (high, -z, -y)];
    let surfaces = walls.map(|(corner, u, v)| Rectangle::new(corner, u, v, Vec3::splat(albedo))).to_vec();
    let scene = Scene::new(Room { surfaces }, 100_000);
    let spot = [lamp(&format!("spot at=0,0.9,0 to=0,-1,0 power={power} angle=20"))];
    let (points, surfels) = (&scene.chunks.points, &scene.chunks.surfels);
    let surfaces = Surfaces { diffuse: 0.4, specular: 0.6, shininess: 15.0 };
    let reflected = surfaces.diffuse * albedo + surfaces.specular;
    let mut last = 0.0;
    for bounces in 0..=3 {
        let mut renderer = scene.renderer(&device.0, LampSettings { surfaces, ..settings(bounces, 1024) });
        renderer.choose(points, surfels).expect("points to light");
        let light = renderer.light(&spot).expect("light").radiance;
        let area = 24.0 / points.len() as f32;
        let flux = light.iter().map(|radiance| radiance.y * PI / reflected * area).sum::<f32>() / power;
        println!("{bounces} bounces: {flux} of the power arrives");
        let most = (0..=bounces as i32).map(|bounce| reflected.powi(bounce)).sum::<f32>();
        if bounces < 2 {
            assert!((flux / most - 1.0).abs() < 0.04, "{bounces} bounces: {flux} instead of {most}");
        } else {
            // Aslant a lobe loses what would go into the surface.
            let least = last + (surfaces.diffuse * albedo).powi(bounces as i32);
            assert!(flux < 1.02 * most && flux > least, "{bounces} bounces: {flux} of {least} to {most}");
        }
        last = flux;
    }
}

#[test]
fn a_brush_changes_the_surfaces_of_its_colour_alone() {
    let device = Device::new();
    let half = Surfaces { diffuse: 0.5, ..Surfaces::default() };
    let red = Brush { from: vec3(0.5, 0.0, 0.0), to: vec3(0.7, 0.2, 0.2), surfaces: half };
    let of_no_colour = Brush { from: Vec3::ONE, to: Vec3::ONE, surfaces: half };
    let render = |settings: &LampSettings, text: &str| {
        let mut renderer = BOX.renderer(&device.0, settings.clone());
        let frame = renderer.render(&camera(), &[lamp(text)]).expect("a picture");
        let [_, bounced] = renderer.irradiance().expect("irradiance");
        (frame.color_depth, bounced, renderer.surface().expect("a surface"))
    };
    let plain = settings(0, 64);
    let brushed = LampSettings { brushes: vec![of_no_colour, red], ..plain.clone() };
    let ((before, _, surface), (after, ..)) = (render(&plain, FRONT), render(&brushed, FRONT));
    let mut counts = [0; 2];
    for ((before, after), normal) in before.iter().zip(&after).zip(&surface.normal) {
        // The red wall looks along +X, and so does a side of a block that is turned, but not as straight.
        let red = normal[0] > 0.999;
        let expected = if red { 0.5 * before[0] } else { before[0] };
        assert!((after[0] - expected).abs() <= 1e-5 * before[0], "{after:?} after {before:?}");
        counts[usize::from(red)] += usize::from(before[0] > 0.0);
    }
    assert!(counts.iter().all(|count| *count > 100), "{counts:?} lit pixels");
    // All light that has been reflected comes from the red wall: half as much of it is left.
    let on_red = "spot at=0.6,1.2,0.5 to=-1,1,0.5 power=20 angle=20";
    let [plain, brushed] = [plain, brushed].map(|settings| LampSettings { bounces: 1, vpls: 256, ..settings });
    let ((_, before, _), (_, after, _)) = (render(&plain, on_red), render(&brushed, on_red));
    let sum = |light: &[[f32; 4]]| light.iter().map(|light| light[0]).sum::<f32>();
    let (before, after) = (sum(&before), sum(&after));
    assert!(before > 0.0 && (after / before - 0.5).abs() < 1e-3, "{after} of {before}");
    // The first that fits wins, and constant albedos leave brushes to the colour.
    let white = Brush { surfaces: Surfaces::default(), ..red };
    let undone = LampSettings { brushes: vec![white, red], ..plain.clone() };
    assert!(render(&undone, on_red).1 == render(&plain, on_red).1);
    let constant = |settings: &LampSettings| LampSettings { albedo: AlbedoFrom::Constant(0.5), ..settings.clone() };
    let (before, after) = (render(&constant(&plain), on_red).1, render(&constant(&brushed), on_red).1);
    assert!((sum(&after) / sum(&before) - 0.5).abs() < 1e-3);
    assert!(before.iter().all(|light| (light[0] - light[1]).abs() <= 1e-5 * light[0]), "grey light from a red wall");
}

#[test]
fn a_mirror_sends_light_where_the_law_of_reflection_says() {
    // A spot at 45 degrees onto a polished floor; its lobe falls on a wall.
    let device = Device::new();
    let gold = vec3(0.9, 0.6, 0.2);
    let floor = Rectangle::new(vec3(-0.4, 0.0, -0.4), Vec3::Z * 0.8, Vec3::X * 0.8, gold);
    let wall = Rectangle::new(vec3(1.5, 0.0, -1.5), Vec3::Z * 3.0, Vec3::Y * 3.0, Vec3::splat(0.5));
    let scene = Scene::new(Room { surfaces: vec![floor, wall] }, 400_000);
    let (specular, shininess, power) = (0.8, 40.0, 10.0);
    let surfaces = Surfaces { diffuse: 0.0, specular, shininess };
    let brushes = vec![Brush { from: gold - 0.02, to: gold + 0.02, surfaces }];
    let mut renderer = scene.renderer(&device.0, LampSettings { brushes, ..settings(1, 256) });
    let camera = Camera { from: vec3(-0.5, 1.5, 0.0), at: vec3(1.5, 1.5, 0.0), fov_y: 1.2 };
    renderer.render(&camera, &[lamp("spot at=-1.5,1.5,0 to=0,0,0 power=10 angle=3")]).expect("a picture");
    let [_, bounced] = renderer.irradiance().expect("irradiance");
    let size = SIZE as u32;
    let mut brightest = (0.0, Vec3::ZERO);
    let (mut differences, mut sum) = (0.0, 0.0);
    for (k, light) in (0..size * size).zip(&bounced) {
        let direction = camera.ray_direction(k % size, k / size, size, size);
        let place = camera.from + direction * ((1.5 - camera.from.x) / direction.x);
        if place.y < 0.05 {
            continue;
        }
        // All of the lamp's light in the origin, by the lobe about (1, 1, 0).
        let (to, distance) = place.normalize_and_length();
        let cosine = to.dot(vec3(1.0, 1.0, 0.0).normalize()).max(0.0);
        let lobe = specular * (shininess + 2.0) / (2.0 * PI) * cosine.powf(shininess);
        let expected = power * lobe * to.y * to.x / (distance * distance);
        differences += (light[0] - expected).powi(2);
        sum += expected * expected;
        if light[0] > brightest.0 {
            brightest = (light[0], place);
        }
    }
    println!("{brightest:?}, relative difference {}", (differences / sum).sqrt());
    assert!((differences / sum).sqrt() < 0.05, "{}", (differences / sum).sqrt());
    // A little below 45 degrees, since the wall is nearer there.
    assert!(brightest.1.distance(vec3(1.5, 1.45, 0.0)) < 0.1, "{brightest:?}");
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
    let mut renderer = BOX.renderer(&device.0, settings.clone());
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
    let mut renderer = BOX.renderer(&device.0, small.clone());
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
        let mut renderer = LampRenderer::new(&device.0, &chunks, small.clone()).expect("a renderer");
        let lamps = [lamp("spot at=0,1,3 to=0,1,0 power=5 angle=60"), lamp("sun direction=0,0,-1 power=1")];
        let frame = renderer.render(&camera(), &lamps).expect("a picture");
        assert!(frame.color_depth.iter().flatten().all(|v| v.is_finite()), "{positions:?}");
    }
    let bare = Arc::new(PointChunks::from_points(&[Vec3::ONE], &[Vec3::ONE], &[]).expect("a point"));
    let message = LampRenderer::new(&device.0, &bare, small.clone()).err().expect("no normals").to_string();
    assert!(message.contains("normals"), "{message}");
    let brush = Brush { from: Vec3::ZERO, to: Vec3::ONE, surfaces: Surfaces::default() };
    for (wrong, word) in [
        (LampSettings { bounces: 9, ..small.clone() }, "9 bounces"),
        (LampSettings { vpls: 100, ..small.clone() }, "multiple of 16"),
        (LampSettings { interleave: 3, ..small.clone() }, "interleaving"),
        (LampSettings { ism_size: 48, ..small.clone() }, "power of two"),
        (LampSettings { light_size: 0, ..small.clone() }, "views of lamps"),
        (
            LampSettings { surfaces: Surfaces { diffuse: 0.9, specular: 0.2, shininess: 5.0 }, ..small.clone() },
            "more light",
        ),
        (LampSettings { brushes: vec![brush; 9], ..small.clone() }, "9 brushes"),
        (LampSettings { albedo: AlbedoFrom::Constant(0.0), ..small.clone() }, "albedo of 0"),
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
