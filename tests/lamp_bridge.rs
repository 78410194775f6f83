//! An object in a room that lamps light: the lamps' light on the cloud is what the object's pixels gather.

mod common;

use std::f32::consts::PI;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use common::Device;
use glam::{Vec3, vec3};
use rayon::prelude::*;
use relume::Error;
use relume::compare::luminance;
use relume::frames::lamps::{LampRenderer, LampSettings};
use relume::frames::{Frame, MaterialChoice, Renderer, Settings};
use relume::preprocess::hierarchy::{BuildOptions, Hierarchy, build};
use relume::preprocess::point_chunks::PointChunks;
use relume::reference::path_tracer::PathTracer;
use relume::reference::rooms::toy_room;
use relume::reference::shapes::sphere;
use relume::scene::{Camera, Lamp};

const SIZE: u32 = 96;
const ALBEDO: f32 = 0.7;
/// At the red wall of the toy room, from its middle.
const AT_RED: &str = "spot at=0.4,1.4,0 to=-2,1.2,0 power=60 angle=50";

fn lamp(text: &str) -> Lamp {
    text.parse().expect("a lamp")
}

/// The toy room without light, as walls and as points whose colours are albedos.
struct Dark {
    tracer: PathTracer,
    hierarchy: Hierarchy,
    chunks: Arc<PointChunks>,
}

impl Dark {
    fn new(points: usize) -> Self {
        let mut room = toy_room();
        room.surfaces.iter_mut().for_each(|surface| surface.emission = Vec3::ZERO);
        let tracer = PathTracer::new(room).expect("a room");
        let cloud = tracer.albedo_cloud(points, 1);
        let chunks = Arc::new(PointChunks::new(&cloud).expect("points"));
        let (hierarchy, _) = build(&cloud, &BuildOptions::default()).expect("a hierarchy");
        Self { tracer, hierarchy, chunks }
    }

    fn lamps(&self, device: &Device, settings: LampSettings) -> LampRenderer {
        let mut lamps = LampRenderer::new(&device.0, &self.chunks, settings).expect("a renderer");
        lamps.choose_leaves(&self.hierarchy).expect("leaves");
        lamps
    }

    fn object(&self, device: &Device) -> Renderer {
        let object = sphere(0.35, 4).transformed(glam::Affine3A::from_translation(vec3(0.0, 1.0, 0.0)));
        let material = MaterialChoice::Diffuse(ALBEDO);
        let settings = Settings { width: SIZE, height: SIZE, material, ..Settings::default() };
        Renderer::new(&device.0, &self.hierarchy, &object, None, settings).expect("a renderer")
    }
}

/// The `n`th of `count` even directions over the hemisphere, their density as the cosine; turned by `seed`.
fn cosine_direction(normal: Vec3, n: u32, count: u32, seed: u32) -> Vec3 {
    let (u, v) = ((n as f32 + 0.5) / count as f32, (n as f32 * 0.618_034 + seed as f32 * 0.754_878).fract());
    let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    (tangent * cos + bitangent * sin) * u.sqrt() + normal * (1.0 - u).sqrt()
}

/// Sees the lit wall's side of the sphere at an angle.
fn camera() -> Camera {
    Camera { from: vec3(-1.2, 1.3, 1.6), at: vec3(0.0, 1.0, 0.0), fov_y: 0.5 }
}

fn settings(bounces: u32) -> LampSettings {
    LampSettings { width: 16, height: 16, bounces, vpls: 1024, interleave: 2, ..LampSettings::default() }
}

fn picture(renderer: &mut Renderer) -> Frame {
    renderer.render(&camera(), &mut |_, _| {}).expect("a picture")
}

#[test]
fn a_sphere_shows_the_red_bounce_of_a_lamp_as_path_tracing_does() {
    let device = Device::new();
    let room = Dark::new(400_000);
    let bounces = 2;
    let spot = [lamp(AT_RED)];
    let (radiance, _) = room.lamps(&device, settings(bounces)).relight(&room.hierarchy, &spot, 0.0).expect("light");
    let mut renderer = room.object(&device);
    let dark = Frame { rgba: Vec::new(), ..picture(&mut renderer) };
    renderer.relight(&room.hierarchy, Some(&radiance)).expect("relit");
    let frame = picture(&mut renderer);
    assert_eq!(frame.position, dark.position);

    // Light of the walls after up to as many reflections as the lights have had.
    let truth = |k: usize| -> Option<Vec3> {
        let [x, y, z, covered] = frame.position[k];
        let [nx, ny, nz, _] = frame.normal[k];
        let (position, normal) = (vec3(x, y, z), vec3(nx, ny, nz));
        if covered == 0.0 {
            return None;
        }
        let samples = 256;
        let light = |sample: u32| {
            let direction = cosine_direction(normal, sample, samples, k as u32);
            let Some(hit) = room.tracer.hit(position, direction).filter(|hit| hit.front) else { return Vec3::ZERO };
            let surface = &room.tracer.room().surfaces[hit.surface];
            let place = (surface.at(hit.u, hit.v), surface.normal());
            let seed = (k as u64) << 16 | u64::from(sample);
            let irradiance: Vec3 = room.tracer.lamp_bounces(&spot, place, bounces as usize, 1, seed).into_iter().sum();
            irradiance * surface.albedo_at(hit.u, hit.v) / PI
        };
        Some((0..samples).map(light).sum::<Vec3>() * (ALBEDO / samples as f32))
    };
    let truths: Vec<Option<Vec3>> = (0..frame.rgba.len()).into_par_iter().map(truth).collect();
    let (mut squares, mut sum, mut difference, mut count, mut reds) = (0.0, 0.0, 0.0, 0.0, [Vec3::ZERO; 2]);
    for (rgba, truth) in frame.rgba.iter().zip(&truths) {
        let Some(truth) = truth else { continue };
        let value = Vec3::from_slice(rgba);
        let off = luminance(value) - luminance(*truth);
        squares += off * off;
        difference += off;
        sum += luminance(*truth);
        count += 1.0;
        reds[0] += value;
        reds[1] += *truth;
    }
    let (rms, bias): (f32, f32) = ((squares * count).sqrt() / sum, difference / sum);
    println!("{count} pixels: RMS {rms}, bias {bias}, sums {reds:?}");
    assert!(count > 1000.0 && rms < 0.08 && bias.abs() < 0.03, "RMS {rms}, bias {bias}");
    let [value, truth] = reds.map(|sum| sum.x / sum.y);
    assert!(value > 2.0 && (value / truth - 1.0).abs() < 0.05, "red over green: {value} instead of {truth}");
}

#[test]
fn light_of_chosen_points_is_that_of_the_path_tracer() {
    let device = Device::new();
    let room = Dark::new(300_000);
    let spot = [lamp(AT_RED), lamp("point at=0.8,2,1 power=20 color=0.2,0.5,1")];
    let mut lamps = room.lamps(&device, settings(1));
    let light = lamps.light(&spot).expect("light");
    let leaves: Vec<usize> = room.hierarchy.leaves().collect();
    assert_eq!(light.radiance.len(), leaves.len());
    // Every hundredth leaf, which is a point of a wall or close before one.
    let pairs: Vec<(f32, f32)> = leaves
        .par_iter()
        .zip(&light.radiance)
        .enumerate()
        .filter(|(k, _)| k % 101 == 0)
        .map(|(k, (leaf, radiance))| {
            let [x, y, z, _] = room.hierarchy.spheres[*leaf];
            let normal = Vec3::from(room.hierarchy.area_vectors[*leaf]).normalize_or_zero();
            let irradiance: Vec3 =
                room.tracer.lamp_bounces(&spot, (vec3(x, y, z), normal), 1, 256, k as u64).into_iter().sum();
            let truth = irradiance * Vec3::from(room.hierarchy.colors[*leaf]) / PI;
            (luminance(*radiance), luminance(truth))
        })
        .collect();
    let (sum, truth): (f32, f32) = pairs.iter().fold((0.0, 0.0), |(a, b), (value, truth)| (a + value, b + truth));
    let near = pairs.iter().filter(|(value, truth)| (value - truth).abs() < 0.15 * truth + 0.02).count();
    println!("{} leaves, {near} near, mean {}", pairs.len(), sum / truth);
    assert!((sum / truth - 1.0).abs() < 0.03, "mean {}", sum / truth);
    assert!(near as f32 > 0.95 * pairs.len() as f32, "{near} of {}", pairs.len());
}

#[test]
fn an_object_is_lit_straight_from_the_lamp_and_shades_the_room() {
    let device = Device::new();
    let room = Dark::new(400_000);
    let (centre, radius) = (vec3(0.0, 1.0, 0.0), 0.35);
    let object = sphere(radius, 5).transformed(glam::Affine3A::from_translation(centre));
    let spot = [lamp("spot at=-0.3,2.6,0.2 to=0.1,0,0 power=40 angle=70")];
    let size = 128;
    let settings = LampSettings { width: size, height: size, light_size: 1024, ..settings(0) };
    let mut lamps = LampRenderer::new(&device.0, &room.chunks, settings).expect("a renderer");
    let camera = Camera { from: vec3(-0.4, 1.8, 2.3), at: vec3(0.0, 0.6, 0.0), fov_y: 1.0 };
    lamps.render(&camera, &spot).expect("a picture");
    let [without, _] = lamps.irradiance().expect("irradiance");
    lamps.set_object(Some((&object, MaterialChoice::Diffuse(ALBEDO)))).expect("an object");
    let light = lamps.light_object(&camera, &spot).expect("light");
    let frame = lamps.render(&camera, &spot).expect("a picture");
    let [direct, _] = lamps.irradiance().expect("irradiance");

    // The way from a place to the lamp, if the sphere is not in it, and whether that is a close call.
    let at = vec3(-0.3, 2.6, 0.2);
    let clear = |place: Vec3| {
        let (direction, length) = (at - place).normalize_and_length();
        let along = (centre - place).dot(direction).clamp(0.0, length);
        let past = (place + direction * along).distance(centre);
        (past > radius, (past - radius).abs() < 0.03)
    };
    let (mut shaded, mut lit, mut on_object) = (0, 0, 0);
    for k in 0..(size * size) as usize {
        let (x, y) = (k as u32 % size, k as u32 / size);
        let ray = camera.ray_direction(x, y, size, size);
        let depth = frame.color_depth[k][3];
        let (_, _, forward) = camera.basis();
        let place = camera.from + ray * (depth / ray.dot(forward));
        let expected = without[k][0];
        if depth > 0.0 && expected > 0.1 && !clear(place).1 {
            let share = direct[k][0] / expected;
            let wanted = if clear(place).0 { 1.0 } else { 0.0 };
            assert!((share - wanted).abs() < 0.01, "pixel {x}, {y}: {share} of the light instead of {wanted}");
            if wanted == 0.0 { shaded += 1 } else { lit += 1 }
        }
        // The sphere: where the eye's ray meets it, lit on the side of the lamp.
        let b = ray.dot(centre - camera.from);
        let past = (camera.from + ray * b).distance(centre);
        // Its rim is that of a mesh.
        if past > radius * 0.9 {
            continue;
        }
        let hit = camera.from + ray * (b - (radius * radius - past * past).sqrt());
        let normal = (hit - centre) / radius;
        let incident = spot[0].incident(hit).expect("within the cone");
        let cosine = normal.dot(incident.towards);
        let expected = incident.irradiance.x * cosine.max(0.0) * ALBEDO / PI;
        let [value, .., covered] = light.radiance[k];
        assert!(covered == 1.0, "pixel {x}, {y} shows the sphere");
        // Where the light grazes it, a texel of the shadow map has more depths than its bias allows for.
        if cosine.abs() > 0.2 {
            assert!((value - expected).abs() < 0.04 * expected + 0.02, "pixel {x}, {y}: {value} instead of {expected}");
            on_object += 1;
        }
    }
    println!("{shaded} pixels in the shadow, {lit} lit, {on_object} on the sphere");
    assert!(shaded > 100 && lit > 1000 && on_object > 500);

    // Another place is as if it had been there from the beginning.
    let moved = object.clone().transformed(glam::Affine3A::from_translation(vec3(0.3, -0.2, 0.1)));
    lamps.place_object(&moved.vertices).expect("moved");
    let there = lamps.light_object(&camera, &spot).expect("light");
    lamps.set_object(Some((&moved, MaterialChoice::Diffuse(ALBEDO)))).expect("an object");
    assert!(there.radiance == lamps.light_object(&camera, &spot).expect("light").radiance);
    assert!(there.radiance != light.radiance);
    lamps.set_object(None).expect("no object");
    lamps.render(&camera, &spot).expect("a picture");
    assert!(lamps.irradiance().expect("irradiance")[0] == without, "the shadow stays");
}

#[test]
fn a_lamp_that_is_put_out_leaves_the_bytes_of_the_unlit_picture() {
    let device = Device::new();
    let mut room = toy_room();
    room.surfaces.iter_mut().for_each(|surface| surface.emission = Vec3::ZERO);
    let tracer = PathTracer::new(room).expect("a room");
    // The albedos as radiance: a scan under even light.
    let cloud = tracer.albedo_cloud(100_000, 1);
    let (hierarchy, _) = build(&cloud, &BuildOptions::default()).expect("a hierarchy");
    let chunks = Arc::new(PointChunks::new(&cloud).expect("points"));
    let place = Dark { tracer, hierarchy, chunks };
    let mut lamps = place.lamps(&device, settings(1));
    let mut renderer = place.object(&device);
    let unlit = picture(&mut renderer);
    let mean = |frame: &Frame| frame.rgba.iter().map(|[r, g, b, _]| r + g + b).sum::<f32>();
    for text in [AT_RED, "point at=0.5,2,-0.5 power=30"] {
        let spot = [lamp(text)];
        let (radiance, light) = lamps.relight(&place.hierarchy, &spot, 1.0).expect("light");
        renderer.relight(&place.hierarchy, Some(&radiance)).expect("relit");
        let lit = picture(&mut renderer);
        assert!(mean(&lit) > 1.02 * mean(&unlit), "{text}");
        // A scene that is uploaded with that light has the same bytes.
        let anew = place.hierarchy.clone().with_radiance(radiance);
        let other = Dark { hierarchy: anew, tracer: PathTracer::new(toy_room()).expect("a room"), ..Dark::new(10) };
        assert!(picture(&mut other.object(&device)).rgba == lit.rgba, "{text}: another renderer");
        assert!(lamps.light(&spot).expect("light").radiance == light.radiance, "{text}: again");
        renderer.relight(&place.hierarchy, None).expect("put out");
        assert!(picture(&mut renderer).rgba == unlit.rgba, "{text}: not what it was");
    }
    assert!(renderer.relight(&Dark::new(1000).hierarchy, None).is_err());
}

#[test]
fn a_renderer_that_is_lent_or_resized_or_stopped_lights_as_a_new_one_does() {
    let device = Device::new();
    let room = Dark::new(60_000);
    let lamps = [lamp(AT_RED), lamp("point at=0.8,2,1 power=20")];
    // Maps of one bounce are used again, those of several are not.
    for bounces in [1, 2] {
        let of_size = |width, height| LampSettings { width, height, vpls: 128, ..settings(bounces) };
        let picture = |renderer: &mut LampRenderer| renderer.render(&camera(), &lamps).expect("a picture").color_depth;
        let light = |renderer: &mut LampRenderer| renderer.light(&lamps).expect("light").radiance;
        let mut new = room.lamps(&device, of_size(40, 30));
        let (expected, expected_light) = (picture(&mut new), light(&mut room.lamps(&device, of_size(40, 30))));
        assert!(expected.iter().any(|[r, ..]| *r > 0.1));
        let mut first = room.lamps(&device, of_size(70, 20));
        assert!(light(&mut first) == expected_light);
        first.resize(40, 30).expect("a size");
        assert!(picture(&mut first) == expected, "{bounces} bounces: at another size, after other work");
        let mut lent = first.beside(of_size(40, 30)).expect("a renderer");
        lent.stop_when(Some(Arc::new(AtomicBool::new(true))));
        assert!(matches!(lent.render(&camera(), &lamps), Err(Error::Stopped)));
        lent.stop_when(None);
        assert!(picture(&mut lent) == expected && light(&mut lent) == expected_light, "{bounces} bounces: lent points");
        lent.resize(90, 50).expect("a size");
        let other = [lamp("point at=0.8,2,1 power=5")];
        assert!(lent.render(&camera(), &other).expect("a picture").color_depth.len() == 90 * 50);
        lent.resize(40, 30).expect("a size");
        assert!(picture(&mut lent) == expected && picture(&mut lent) == expected, "{bounces} bounces: again");
    }
}
