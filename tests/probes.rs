//! Light probes on the device: projection, pyramid, temporal filter, and objects in their light.

mod common;

use std::f64::consts::PI;

use common::{Device, Random, ball, shared};
use glam::{Affine3A, DMat3, DVec3, Quat, Vec3, vec3};
use rayon::prelude::*;
use relume::formats::image::read_far_field;
use relume::frames::probes::{ProbeRenderer, ProbeSettings, Projection, Reflection};
use relume::frames::{Frame, MaterialChoice};
use relume::gpu::Profile;
use relume::passes::probe_light::ProbeLight;
use relume::preprocess::transfer::Transfer;
use relume::reference::harmonics::{direction, irradiance, project, solid_angle};
use relume::scene::harmonics::{COSINE_LOBE, MOST_COEFFICIENTS, band, basis, hanning, rotation};
use relume::scene::{Camera, FarField, Material, Object, Primitive, Vertex};

/// The size of the probes of Hajisharif 2012, Table 2.
const PAPER: [u32; 2] = [1628, 814];

/// A panorama whose radiance is a function of the direction.
fn panorama([width, height]: [u32; 2], radiance: impl Fn(DVec3) -> DVec3 + Sync) -> FarField {
    let mut panorama = FarField { width, height, radiance: Vec::new() };
    let texels = (0..width * height).into_par_iter();
    panorama.radiance = texels.map(|at| radiance(direction(&panorama, at % width, at / width)).as_vec3()).collect();
    panorama
}

/// Soft light from everywhere and three lamps.
fn surround(size: [u32; 2]) -> FarField {
    let lamps = [
        (DVec3::new(0.3, 0.8, -0.5).normalize(), DVec3::new(40.0, 30.0, 20.0), 0.99),
        (DVec3::new(-0.9, 0.1, 0.2).normalize(), DVec3::new(2.0, 5.0, 9.0), 0.9),
        (DVec3::new(0.2, -0.6, 0.9).normalize(), DVec3::new(3.0, 0.5, 0.2), 0.8),
    ];
    panorama(size, |w| {
        let lamp = |sum, (at, color, cosine): (DVec3, DVec3, f64)| if w.dot(at) > cosine { sum + color } else { sum };
        lamps.into_iter().fold(DVec3::splat(0.3 + 0.2 * w.y), lamp)
    })
}

fn light(device: &Device, projection: Projection, probe: &FarField) -> Vec<Vec3> {
    let mut light = ProbeLight::new(&device.0, projection, false).expect("pipelines");
    light.set(probe, 0.0, &mut Profile::default()).expect("a projection");
    light.coefficients().expect("coefficients")
}

fn order(order: usize) -> Projection {
    Projection { order, ..Projection::default() }
}

/// The largest difference of any coefficient as a share of the largest coefficient of that channel.
fn difference(values: &[Vec3], expected: &[DVec3]) -> f64 {
    let largest = expected.iter().fold(DVec3::splat(1e-30), |most, c| most.max(c.abs()));
    let differences = values.iter().zip(expected).map(|(v, e)| ((v.as_dvec3() - e).abs() / largest).max_element());
    differences.fold(0.0, f64::max)
}

#[test]
fn every_basis_function_projects_to_itself() {
    let device = Device::new();
    for first in (0..MOST_COEFFICIENTS).step_by(3) {
        let shown = |w: DVec3| {
            let values = basis(w);
            DVec3::from_array([0, 1, 2].map(|channel| values.get(first + channel).copied().unwrap_or(0.0)))
        };
        let coefficients = light(&device, order(5), &panorama(PAPER, shown));
        for (k, found) in coefficients.iter().enumerate() {
            for channel in 0..3 {
                let expected = if first + channel == k { 1.0 } else { 0.0 };
                let off = f64::from(found[channel]) - expected;
                assert!(off.abs() < 1e-4, "function {} has {expected} + {off} of {k}", first + channel);
            }
        }
    }
}

#[test]
fn constants_and_cosine_lobes_have_their_analytic_coefficients() {
    let device = Device::new();
    for bands in 1..=5 {
        let white = light(&device, order(bands), &panorama(PAPER, |_| DVec3::ONE));
        assert_eq!(white.len(), bands * bands);
        for (k, found) in white.iter().enumerate() {
            let expected = if k == 0 { (4.0 * PI).sqrt() } else { 0.0 };
            assert!((found.as_dvec3() - expected).abs().max_element() < 1e-4, "{k}: {found}");
        }
        let axes = [DVec3::Y, DVec3::new(0.6, 0.0, -0.8), DVec3::new(-0.48, -0.6, 0.64)];
        let lobes = panorama(PAPER, |w| DVec3::from_array(axes.map(|axis| axis.dot(w).max(0.0))));
        for (k, found) in light(&device, order(bands), &lobes).iter().enumerate() {
            for (channel, axis) in axes.iter().enumerate() {
                let expected = COSINE_LOBE[band(k)] * basis(*axis)[k];
                let off = f64::from(found[channel]) - expected;
                assert!(off.abs() < 1e-4, "lobe {channel} has {expected} + {off} of {k}");
            }
        }
    }
}

#[test]
fn a_quarter_turn_of_the_panorama_turns_the_coefficients() {
    let device = Device::new();
    let probe = surround(PAPER);
    let mut turned = probe.clone();
    for row in turned.radiance.chunks_exact_mut(PAPER[0] as usize) {
        row.rotate_right(PAPER[0] as usize / 4);
    }
    let (before, after) = (light(&device, order(5), &probe), light(&device, order(5), &turned));
    // Columns run from -Z over +X to +Z: a quarter to the right takes -Z to +X.
    let matrix = rotation(DMat3::from_cols(DVec3::Z, DVec3::Y, DVec3::NEG_X));
    let rotated: Vec<DVec3> = matrix
        .iter()
        .map(|row| row.iter().zip(&before).fold(DVec3::ZERO, |sum, (entry, c)| sum + c.as_dvec3() * *entry))
        .collect();
    let (same, off) = (difference(&after, &rotated), difference(&before, &rotated));
    assert!(same < 1e-5, "{same}");
    assert!(off > 0.05, "the turn changes something: {off}");
}

#[test]
fn projections_are_sums_over_all_texels_whatever_the_size() {
    let device = Device::new();
    for size in [PAPER, [1, 1], [2, 1], [3, 2], [33, 17], [64, 32], [407, 203], [65, 128]] {
        let mut random = Random(u64::from(size[0]));
        let mut probe = surround(size);
        probe.radiance.iter_mut().for_each(|texel| *texel *= random.vector());
        let truth = project(&probe);
        for bands in [1, 4, 5] {
            for rows in [None, Some(1), Some(5)] {
                let found = light(&device, Projection { order: bands, rows, ..Projection::default() }, &probe);
                let off = difference(&found, &truth[..bands * bands]);
                assert!(off < 1e-5, "{size:?}, order {bands}, {rows:?} rows: {off}");
            }
        }
    }
}

#[test]
fn the_same_probe_gives_the_same_bytes() {
    let device = Device::new();
    let probe = surround([814, 407]);
    let first = light(&device, order(4), &probe);
    for _ in 0..3 {
        assert_eq!(light(&device, order(4), &probe), first);
    }
}

#[test]
fn a_window_weighs_bands_and_a_temporal_filter_mixes_frames() {
    let device = Device::new();
    let (probe, other) = (surround([64, 32]), panorama([64, 32], |w| DVec3::new(1.0 + w.x, 0.5, 0.0)));
    let (plain, next) = (light(&device, order(4), &probe), light(&device, order(4), &other));
    let windowed = light(&device, Projection { hanning: true, ..order(4) }, &probe);
    for (k, (value, plain)) in windowed.iter().zip(&plain).enumerate() {
        let expected = *plain * hanning(band(k), 4) as f32;
        assert!(value.distance(expected) <= 1e-6 * plain.length(), "{k}: {value} instead of {expected}");
    }
    let mut filtered = ProbeLight::new(&device.0, order(4), false).expect("pipelines");
    let mut profile = Profile::default();
    let keep = 3.0;
    // The first frame has nothing before it.
    filtered.set(&probe, keep, &mut profile).expect("a projection");
    assert_eq!(filtered.coefficients().expect("coefficients"), plain);
    let mut expected = plain;
    for _ in 0..3 {
        filtered.set(&other, keep, &mut profile).expect("a projection");
        // Eq. 13.
        expected.iter_mut().zip(&next).for_each(|(kept, new)| *kept = (*new + *kept * keep) / (1.0 + keep));
        for (value, expected) in filtered.coefficients().expect("coefficients").iter().zip(&expected) {
            assert!(value.distance(*expected) < 1e-5, "{value} instead of {expected}");
        }
    }
}

fn energy(panorama: &FarField) -> DVec3 {
    let texel =
        |(at, radiance): (usize, &Vec3)| radiance.as_dvec3() * solid_angle(panorama, at as u32 / panorama.width);
    panorama.radiance.iter().enumerate().map(texel).sum()
}

#[test]
fn levels_of_the_pyramid_keep_lamps_and_constants() {
    let device = Device::new();
    let mut pyramid = ProbeLight::new(&device.0, order(4), true).expect("pipelines");
    let mut profile = Profile::default();
    pyramid.set(&panorama(PAPER, |_| DVec3::splat(0.7)), 0.0, &mut profile).expect("a pyramid");
    for level in 1..9 {
        let level = pyramid.level(level).expect("a level");
        assert!(level.radiance.iter().all(|texel| (*texel - 0.7).abs().max_element() < 1e-5));
    }
    let mut random = Random(3);
    for _ in 0..12 {
        // A lamp of a few texels anywhere, near the poles too, where rows have other solid angles.
        let axis = (random.vector() * 2.0 - 1.0).as_dvec3().normalize_or(DVec3::Y);
        let lamp = panorama(PAPER, |w| if w.dot(axis) > 0.9998 { DVec3::splat(1e4) } else { DVec3::ZERO });
        pyramid.set(&lamp, 0.0, &mut profile).expect("a pyramid");
        let whole = energy(&lamp);
        for level in 1..6 {
            let off = energy(&pyramid.level(level).expect("a level")) / whole - 1.0;
            assert!(off.abs().max_element() < 0.02, "{axis}, level {level}: {off}");
        }
    }
    // Projected from a smaller level, the light is the same but for what is too fine for that level.
    let probe = surround(PAPER);
    let whole = light(&device, order(4), &probe);
    let fine: Vec<DVec3> = whole.iter().map(|c| c.as_dvec3()).collect();
    for (width, most) in [(814, 1e-4), (203, 2e-3), (50, 3e-2)] {
        let off = difference(&light(&device, Projection { width: Some(width), ..order(4) }, &probe), &fine);
        assert!(off < most && off > 0.0, "from {width} texels: {off}");
    }
}

/// A ball of radius 1 without a transfer, framed.
fn ball_frame(device: &Device, probe: &FarField, settings: ProbeSettings) -> Frame {
    let object = ball(1.0);
    let mut renderer = ProbeRenderer::new(&device.0, &object, Affine3A::IDENTITY, None, settings).expect("a renderer");
    renderer.light(probe, &mut Profile::default()).expect("light");
    renderer.render(&Camera::framing(Vec3::ZERO, 1.0)).expect("a frame")
}

fn small() -> ProbeSettings {
    ProbeSettings { width: 96, height: 64, ..ProbeSettings::default() }
}

#[test]
fn a_ball_without_occluders_reflects_the_irradiance_of_its_normals() {
    let device = Device::new();
    let probe = surround([256, 128]);
    for (bands, most) in [(3, 0.05), (5, 0.025)] {
        let settings = ProbeSettings { material: MaterialChoice::Diffuse(0.6), projection: order(bands), ..small() };
        let frame = ball_frame(&device, &probe, settings);
        let covered: Vec<usize> = (0..frame.rgba.len()).filter(|at| frame.rgba[*at][3] > 0.0).collect();
        assert!(covered.len() > 1000);
        let (mut squares, mut sum) = (0.0, 0.0);
        for at in covered.iter().step_by(7) {
            let [x, y, z, _] = frame.normal[*at];
            let truth = irradiance(&probe, vec3(x, y, z).normalize().as_dvec3()) * 0.6 / PI;
            squares += (f64::from(frame.rgba[*at][1]) - truth.y).powi(2);
            sum += truth.y;
        }
        let count = covered.iter().step_by(7).count() as f64;
        let rms = (squares / count).sqrt() / (sum / count);
        assert!(rms < most, "order {bands}: {rms}");
    }
}

#[test]
fn white_surrounds_make_white_objects() {
    let device = Device::new();
    let white = panorama([256, 128], |_| DVec3::splat(2.0));
    for (material, reflection, expected, most) in [
        (MaterialChoice::Diffuse(0.5), Reflection::default(), 1.0, 1e-4),
        (MaterialChoice::Diffuse(0.5), Reflection::Mirror(0.25), 1.5, 1e-4),
        // A narrow lobe loses nothing to masking.
        (MaterialChoice::Metal(0.02), Reflection::default(), 2.0, 2e-2),
    ] {
        let frame = ball_frame(&device, &white, ProbeSettings { material, reflection, ..small() });
        let covered: Vec<f32> = frame.rgba.iter().filter(|p| p[3] > 0.0).map(|p| p[0]).collect();
        let mean = covered.iter().sum::<f32>() / covered.len() as f32;
        assert!((mean / expected - 1.0).abs() < most, "{material:?}, {reflection:?}: {mean} instead of {expected}");
    }
}

#[test]
fn a_mirror_shows_the_probe() {
    let device = Device::new();
    let probe = panorama([256, 128], |w| DVec3::new(1.0 + w.x, 1.0 + w.y, 1.0 + w.z));
    let material = MaterialChoice::Diffuse(0.0);
    let camera = Camera::framing(Vec3::ZERO, 1.0);
    for (material, reflection, most) in
        [(material, Reflection::Mirror(1.0), 0.02), (MaterialChoice::Metal(0.03), Reflection::default(), 0.05)]
    {
        let frame = ball_frame(&device, &probe, ProbeSettings { material, reflection, ..small() });
        for at in (0..frame.rgba.len()).filter(|at| frame.rgba[*at][3] > 0.0) {
            let ([x, y, z, _], [nx, ny, nz, _]) = (frame.position[at], frame.normal[at]);
            let (normal, view) = (vec3(nx, ny, nz), (camera.from - vec3(x, y, z)).normalize());
            if normal.dot(view) < 0.3 {
                continue;
            }
            let mirrored = 2.0 * normal.dot(view) * normal - view;
            let [r, g, b, _] = frame.rgba[at];
            let off = (vec3(r, g, b) - (Vec3::ONE + mirrored)).abs().max_element();
            assert!(off < most, "{reflection:?}: {off} at {normal}");
        }
    }
}

#[test]
fn strips_under_a_small_budget_make_the_same_image() {
    let device = Device::new();
    let probe = surround([64, 32]);
    let settings = ProbeSettings { width: 512, height: 512, ..ProbeSettings::default() };
    let whole = ball_frame(&device, &probe, settings);
    let strips = ball_frame(&device, &probe, ProbeSettings { memory_budget: 16 << 20, ..settings });
    assert!(strips.stats.profile.passes["gbuffer"].runs > 1, "the budget holds all of it");
    // Rasterisers round the edges of strips otherwise than those of the whole.
    let differ = strips.rgba.iter().zip(&whole.rgba).filter(|(a, b)| (0..4).any(|c| (a[c] - b[c]).abs() > 1e-3 * b[c]));
    assert!(differ.count() < 20, "strips show something else");
    let object = ball(1.0);
    let tight = ProbeSettings { memory_budget: 1 << 20, ..settings };
    let mut renderer = ProbeRenderer::new(&device.0, &object, Affine3A::IDENTITY, None, tight).expect("a renderer");
    renderer.light(&probe, &mut Profile::default()).expect("light");
    let error = renderer.render(&Camera::framing(Vec3::ZERO, 1.0)).expect_err("too small");
    assert!(error.to_string().contains("1 MiB"), "{error}");
}

#[test]
fn a_renderer_without_a_probe_says_so() {
    let device = Device::new();
    let object = ball(1.0);
    let mut renderer = ProbeRenderer::new(&device.0, &object, Affine3A::IDENTITY, None, small()).expect("a renderer");
    assert!(renderer.render(&Camera::framing(Vec3::ZERO, 1.0)).is_err());
    for order in [0, 6] {
        assert!(ProbeLight::new(&device.0, Projection { order, ..Projection::default() }, false).is_err());
    }
}

/// A triangle that fills the picture, its normals towards +Z.
fn triangle() -> Object {
    let vertex = |x: f32, y: f32| Vertex { position: vec3(x, y, 0.0), normal: Vec3::Z, ..Vertex::default() };
    Object {
        vertices: vec![vertex(-9.0, -9.0), vertex(9.0, -9.0), vertex(0.0, 18.0)],
        indices: vec![0, 1, 2],
        primitives: vec![Primitive { indices: 0..3, material: 0 }],
        materials: vec![Material::default()],
        ..Object::default()
    }
}

#[test]
fn pixels_have_the_product_of_light_and_transfer() {
    let device = Device::new();
    let probe = surround([128, 64]);
    let light = project(&probe);
    let mut random = Random(5);
    for bands in 1..=5 {
        for channels in [1, 3] {
            // All three vertices have the same: there is nothing to interpolate.
            let count = bands * bands * channels;
            let mut own: Vec<f32> = (0..count).map(|_| random.next() - 0.5).collect();
            // Enough of the mean for positive light.
            (0..channels).for_each(|c| own[c * bands * bands] = 6.0);
            let transfer = Transfer {
                order: bands,
                samples: 1,
                bounces: 0,
                visibility: true,
                channels,
                vertices: 3,
                coefficients: own.repeat(3),
            };
            let settings =
                ProbeSettings { material: MaterialChoice::Diffuse(0.8), projection: order(bands), ..small() };
            let renderer = ProbeRenderer::new(&device.0, &triangle(), Affine3A::IDENTITY, Some(&transfer), settings);
            let mut renderer = renderer.expect("a renderer");
            renderer.light(&probe, &mut Profile::default()).expect("light");
            let camera = |z: f32| Camera { from: vec3(0.0, 0.0, z), at: Vec3::ZERO, fov_y: 0.5 };
            let frame = renderer.render(&camera(4.0)).expect("a frame");
            for channel in 0..3 {
                let part = &own[channel.min(channels - 1) * bands * bands..][..bands * bands];
                let product: f64 = part.iter().zip(&light).map(|(t, l)| f64::from(*t) * l[channel]).sum();
                let expected = product.max(0.0) * 0.8 / PI;
                for pixel in &frame.rgba {
                    let off = f64::from(pixel[channel]) - expected;
                    assert!(
                        off.abs() < 2e-4 * expected,
                        "order {bands}, {channels} channels: {pixel:?}, not {expected}"
                    );
                }
            }
            // From behind, the transfer is not that of the side that is seen.
            let behind = renderer.render(&camera(-4.0)).expect("a frame");
            let open: f64 =
                (0..bands * bands).map(|k| COSINE_LOBE[band(k)] * basis(DVec3::NEG_Z)[k] * light[k].y).sum();
            let expected = open.max(0.0) * 0.8 / PI;
            assert!((f64::from(behind.rgba[0][1]) - expected).abs() < 1e-3 * expected.max(0.1), "{:?}", behind.rgba[0]);
        }
    }
}

#[test]
fn a_transfer_of_something_else_is_refused() {
    let device = Device::new();
    let object = ball(1.0);
    for (transfer, expected) in
        [(exact_transfer(&triangle(), 4), "3 vertices for an object"), (exact_transfer(&object, 3), "of order 3")]
    {
        let made = ProbeRenderer::new(&device.0, &object, Affine3A::IDENTITY, Some(&transfer), small());
        let error = made.err().expect("refused").to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn real_panoramas_project_as_double_sums_and_irradiance_is_that_of_all_texels() {
    let Some(shared) = shared("real_panoramas_project_as_double_sums_and_irradiance_is_that_of_all_texels") else {
        return;
    };
    let device = Device::new();
    // Normals along a spiral, each with the same share of the sphere.
    let normal = |n: u32| {
        let height = 1.0 - 2.0 * (f64::from(n) + 0.5) / 96.0;
        let (sine, cosine) = (f64::from(n) * PI * (3.0 - 5.0_f64.sqrt())).sin_cos();
        let across = (1.0 - height * height).sqrt();
        DVec3::new(across * sine, height, across * cosine)
    };
    let normals: Vec<DVec3> = (0..96).map(normal).collect();
    // Order 3 is the best that a function of three bands can do: what is left is in the light, 12.5 % of a single lamp far
    // away. The last one has the bare sun in it.
    for (name, third, fifth) in [
        ("sunset.exr", 0.014, 0.005),
        ("forest.exr", 0.034, 0.014),
        ("interior.exr", 0.040, 0.022),
        ("spiaggia_di_mondello_1k.hdr", 0.11, 0.06),
    ] {
        let probe = read_far_field(&shared.join("data/hdr").join(name)).expect("a panorama");
        let truth = project(&probe);
        let found = light(&device, order(5), &probe);
        let off = difference(&found, &truth);
        assert!(off < 1e-4, "{name}: {off}");
        let irradiances: Vec<DVec3> = normals.par_iter().map(|n| irradiance(&probe, *n)).collect();
        let mean = irradiances.iter().map(|e| e.y).sum::<f64>() / normals.len() as f64;
        let rms = |bands: usize| {
            let squares = normals.iter().zip(&irradiances).map(|(normal, truth)| {
                let values = basis(*normal);
                let sum: f64 =
                    (0..bands * bands).map(|k| COSINE_LOBE[band(k)] * f64::from(found[k].y) * values[k]).sum();
                (sum - truth.y).powi(2)
            });
            (squares.sum::<f64>() / normals.len() as f64).sqrt() / mean
        };
        println!("{name}: coefficients {off:.1e}, irradiance {:.4} and {:.4} off", rms(3), rms(5));
        assert!(rms(3) < third && rms(5) < fifth, "{name}: {} and {}", rms(3), rms(5));
    }
}

#[test]
fn a_turned_object_is_lit_like_its_vertices_turned() {
    let device = Device::new();
    let probe = surround([128, 64]);
    // Without a transfer the axes do not matter, with one they are made good for.
    let turn = Affine3A::from_quat(Quat::from_axis_angle(vec3(0.6, 0.0, 0.8), 1.2));
    let settings = ProbeSettings { material: MaterialChoice::Diffuse(0.5), ..small() };
    let object = ball(1.0);
    let transfer = exact_transfer(&object, 4);
    let turned = object.clone().transformed(turn);
    let frame = |transfer: Option<&Transfer>| {
        let mut renderer = ProbeRenderer::new(&device.0, &turned, turn, transfer, settings).expect("a renderer");
        renderer.light(&probe, &mut Profile::default()).expect("light");
        renderer.render(&Camera::framing(Vec3::ZERO, 1.0)).expect("a frame")
    };
    let (with, without) = (frame(Some(&transfer)), frame(None));
    for (a, b) in with.rgba.iter().zip(&without.rgba) {
        // Interpolated over triangles in the one, by the pixel's normal in the other.
        assert!((a[1] - b[1]).abs() < 0.01, "{a:?} and {b:?}");
    }
}

/// What a convex object's transfer is.
fn exact_transfer(object: &Object, order: usize) -> Transfer {
    let coefficients = |vertex: &Vertex| {
        let values = basis(vertex.normal.as_dvec3());
        (0..order * order).map(move |k| (COSINE_LOBE[band(k)] * values[k]) as f32).collect::<Vec<_>>()
    };
    Transfer {
        order,
        samples: 0,
        bounces: 0,
        visibility: true,
        channels: 1,
        vertices: object.vertices.len(),
        coefficients: object.vertices.iter().flat_map(coefficients).collect(),
    }
}
