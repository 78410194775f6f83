//! The transfer of objects, held against known answers and a plain computation.

use std::f64::consts::PI;
use std::fs;
use std::path::Path;

use glam::{DVec3, Vec2, Vec3};
use relume::Error;
use relume::formats::prt::{self, Source, load_or_compute};
use relume::preprocess::transfer::{Transfer, TransferOptions, compute};
use relume::reference::shapes;
use relume::reference::transfer::{Directions, sphere_blocks, triangle_hit};
use relume::scene::harmonics::{COSINE_LOBE, band, basis};
use relume::scene::{Material, Object, Primitive, Texture, TextureRef, Vertex};

/// The constant basis function.
const CONSTANT: f64 = 0.282_094_791_773_878_14;

fn computed(object: &Object, options: TransferOptions) -> Transfer {
    compute(object, &options, &|_| ()).expect("object and options are sound")
}

/// Adds a rectangle of `cells` by `cells`, with a material of its own. Its front is where `u x v` points.
fn add_wall(object: &mut Object, corner: Vec3, (u, v): (Vec3, Vec3), cells: u32, albedo: Vec3) {
    let (first, start) = (object.vertices.len() as u32, object.indices.len() as u32);
    for (row, column) in (0..=cells).flat_map(|row| (0..=cells).map(move |column| (row, column))) {
        let uv = Vec2::new(column as f32, row as f32) / cells as f32;
        let (position, normal) = (corner + u * uv.x + v * uv.y, u.cross(v).normalize());
        object.vertices.push(Vertex { position, normal, uv, ..Vertex::default() });
    }
    for (row, column) in (0..cells).flat_map(|row| (0..cells).map(move |column| (row, column))) {
        let a = first + row * (cells + 1) + column;
        object.indices.extend([a, a + 1, a + cells + 2, a, a + cells + 2, a + cells + 1]);
    }
    object.primitives.push(Primitive { indices: start..object.indices.len() as u32, material: object.materials.len() });
    object.materials.push(Material { base_color: albedo, ..Material::default() });
}

/// A sphere of radius 1 that touches a floor of 8 m at y = -1.
fn sphere_on_a_floor() -> Object {
    let mut object = shapes::sphere(1.0, 24);
    add_wall(&mut object, Vec3::new(-4.0, -1.0, -4.0), (Vec3::Z * 8.0, Vec3::X * 8.0), 16, Vec3::ONE);
    object
}

/// A floor and a wall at right angles, 20 m wide and 4 m deep and tall; they share the line x = y = 0.
fn corner() -> Object {
    let mut object = Object::default();
    add_wall(&mut object, Vec3::new(0.0, 0.0, -10.0), (Vec3::Z * 20.0, Vec3::X * 4.0), 12, Vec3::ONE);
    add_wall(&mut object, Vec3::new(0.0, 0.0, -10.0), (Vec3::Y * 4.0, Vec3::Z * 20.0), 12, Vec3::new(0.8, 0.4, 0.2));
    object
}

/// An open box of 2 m, its faces inwards, without its lid. All walls have the albedo.
fn open_box(albedo: Vec3, cells: u32) -> Object {
    let mut object = Object::default();
    let low = Vec3::splat(-1.0);
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    for (corner, u, v) in [(low, z, x), (low, y, z), (low + x, z, y), (low, x, y), (low + z, y, x)] {
        add_wall(&mut object, corner, (u, v), cells, albedo);
    }
    object
}

/// Lights as coefficients: each basis function alone, and random ones whose bands fade as those of real places do.
fn lights(order: usize) -> Vec<Vec<f64>> {
    let functions = order * order;
    let one = |k: usize| (0..functions).map(|j| f64::from(u8::from(j == k))).collect();
    let random = |light: usize| {
        let value = |k: usize| 2.0 * ((light * 31 + k * 17 + 1) as f64 * 0.618_033_988_749_894_9).fract() - 1.0;
        (0..functions).map(|k| if k == 0 { 1.0 } else { value(k) / band(k) as f64 }).collect()
    };
    (0..functions).map(one).chain((0..20).map(random)).collect()
}

fn irradiance(light: &[f64], transfer: impl Iterator<Item = f64>) -> f64 {
    light.iter().zip(transfer).map(|(light, transfer)| light * transfer).sum()
}

/// For each light, the RMS over `vertices` of the error of the irradiance against `truth`, over the irradiance that a
/// surface without occluders gets from the light's mean: pi times the mean radiance (that of the constant function for
/// lights that have no mean). The largest over all lights.
fn largest_error(transfer: &Transfer, vertices: &[usize], truth: impl Fn(usize) -> Vec<f64>) -> f64 {
    let truths: Vec<Vec<f64>> = vertices.iter().map(|&vertex| truth(vertex)).collect();
    let error = |light: Vec<f64>| {
        let squares = vertices.iter().zip(&truths).map(|(&vertex, truth)| {
            let found = irradiance(&light, transfer.of(vertex, 0).iter().map(|&c| f64::from(c)));
            (found - irradiance(&light, truth.iter().copied())).powi(2)
        });
        (squares.sum::<f64>() / vertices.len() as f64).sqrt() / (PI * CONSTANT)
    };
    lights(transfer.order).into_iter().map(error).fold(0.0, f64::max)
}

fn place(object: &Object, vertex: usize) -> (DVec3, DVec3) {
    let Vertex { position, normal, .. } = object.vertices[vertex];
    (position.as_dvec3(), normal.as_dvec3())
}

#[test]
fn a_sphere_on_a_floor_is_what_its_plain_twin_says() {
    let object = sphere_on_a_floor();
    let options = TransferOptions { order: 5, ..TransferOptions::default() };
    let transfer = computed(&object, options);
    let directions = Directions::new(100_000);
    let floor = object.vertices.len() - 17 * 17;
    let truth = |vertex: usize| {
        let (position, normal) = place(&object, vertex);
        let origin = position + 1e-6 * normal;
        let blocked = |direction: DVec3| {
            let down = (-1.0 - origin.y) / direction.y;
            let at = origin + direction * down;
            let floor = vertex < floor && down > 0.0 && at.x.abs() < 4.0 && at.z.abs() < 4.0;
            floor || (position.length() > 1.001 && sphere_blocks(DVec3::ZERO, 1.0, origin, direction))
        };
        directions.transfer(normal, blocked).to_vec()
    };
    // not where sphere and floor touch: there the triangles are no sphere
    let far = |vertex: &usize| place(&object, *vertex).0.distance(DVec3::NEG_Y) > 0.3;
    let vertices: Vec<usize> = (0..floor).step_by(97).chain(floor..floor + 17 * 17).filter(far).collect();
    let error = largest_error(&transfer, &vertices, truth);
    assert!(error < 0.01, "{error}");
    // without the floor's and the sphere's shadows it is another thing
    let unshadowed = computed(&object, TransferOptions { visibility: false, ..options });
    let error = largest_error(&unshadowed, &vertices, truth);
    assert!(error > 0.05, "{error}");
}

#[test]
fn a_corner_of_walls_is_what_its_plain_twin_says() {
    let object = corner();
    let transfer = computed(&object, TransferOptions { order: 5, ..TransferOptions::default() });
    let directions = Directions::new(100_000);
    let corners = |[a, b, c]: [f64; 3]| DVec3::new(a, b, c);
    let (low, high) = ([0.0, 0.0, -10.0], [0.0, 0.0, 10.0]);
    let walls = [[4.0, 0.0], [0.0, 4.0]].map(|[x, y]| {
        [[low, high, [x, y, -10.0]], [high, [x, y, 10.0], [x, y, -10.0]]].map(|triangle| triangle.map(corners))
    });
    let truth = |vertex: usize| {
        let (position, normal) = place(&object, vertex);
        let other = walls[usize::from(normal.y > 0.5)];
        let origin = position + 1e-6 * (normal + if normal.y > 0.5 { DVec3::X } else { DVec3::Y });
        directions.transfer(normal, |w| other.iter().any(|&t| triangle_hit(t, origin, w).is_some())).to_vec()
    };
    // not in the two points where both walls end: there light depends on the side that one comes from
    let inside = |vertex: &usize| {
        let (position, _) = place(&object, *vertex);
        position.truncate().length() > 0.0 || position.z.abs() < 10.0
    };
    let vertices: Vec<usize> = (0..object.vertices.len()).step_by(3).filter(inside).collect();
    let error = largest_error(&transfer, &vertices, truth);
    assert!(error < 0.01, "{error}");
}

#[test]
fn in_the_crease_of_two_walls_half_of_the_light_is_left() {
    // the walls are 100 times as long as the place is away from their ends
    let mut object = Object::default();
    add_wall(&mut object, Vec3::new(0.0, 0.0, -100.0), (Vec3::Z * 200.0, Vec3::X * 100.0), 2, Vec3::ONE);
    add_wall(&mut object, Vec3::new(0.0, 0.0, -100.0), (Vec3::Y * 100.0, Vec3::Z * 200.0), 2, Vec3::ONE);
    let transfer = computed(&object, TransferOptions { order: 2, ..TransferOptions::default() });
    for vertex in 0..object.vertices.len() {
        if object.vertices[vertex].position == Vec3::ZERO {
            let share = f64::from(transfer.of(vertex, 0)[0]) / (PI * CONSTANT);
            assert!((share - 0.5).abs() < 0.005, "vertex {vertex}: {share}");
            let [_, x, up, _] = transfer.of(vertex, 0) else { panic!("four coefficients") };
            let ratio = if object.vertices[vertex].normal.y > 0.5 { x / up } else { up / x };
            // over a quarter of the sphere the product of two axes has the integral 2/3, the square of one pi/3
            assert!((f64::from(ratio) - 2.0 / PI).abs() < 0.01, "vertex {vertex}: {ratio}");
        }
    }
}

#[test]
fn convex_objects_are_exact_for_any_number_of_directions() {
    for (object, samples) in [(shapes::sphere(2.0, 8), 9), (shapes::sphere(0.001, 32), 100)] {
        let shadowed = computed(&object, TransferOptions { order: 5, samples, ..TransferOptions::default() });
        let free = TransferOptions { order: 5, visibility: false, ..TransferOptions::default() };
        assert_eq!(shadowed.coefficients, computed(&object, free).coefficients);
        for (vertex, Vertex { normal, .. }) in object.vertices.iter().enumerate() {
            let values = basis(normal.as_dvec3());
            for (k, &found) in shadowed.of(vertex, 0).iter().enumerate() {
                assert!((f64::from(found) - COSINE_LOBE[band(k)] * values[k]).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn an_open_box_of_white_walls_shows_nothing_of_itself_in_even_light() {
    // a furnace: light of 1 from everywhere, and nothing is absorbed
    let transfer = computed(
        &open_box(Vec3::ONE, 4),
        TransferOptions { order: 1, samples: 900, bounces: 60, ..TransferOptions::default() },
    );
    assert_eq!(transfer.channels, 3);
    for coefficient in transfer.coefficients {
        let share = f64::from(coefficient) / (PI * CONSTANT);
        assert!((share - 1.0).abs() < 0.001, "{share}");
    }
}

#[test]
fn bounces_take_the_colors_of_walls_and_of_their_textures() {
    let color = Vec3::new(0.8, 0.4, 0.2);
    let options = TransferOptions { bounces: 1, samples: 900, ..TransferOptions::default() };
    let direct = computed(&corner(), TransferOptions { bounces: 0, ..options });
    let plain = computed(&corner(), options);
    // the floor is lit by the coloured wall, and the wall by the white floor
    let bounce =
        |transfer: &Transfer, vertex: usize, channel: usize| transfer.of(vertex, channel)[0] - direct.of(vertex, 0)[0];
    let near = 6 * 13 + 1;
    for channel in 0..3 {
        let ratio = bounce(&plain, near, channel) / bounce(&plain, near, 0);
        assert!((ratio - color[channel] / color[0]).abs() < 1e-3, "channel {channel}: {ratio}");
    }
    assert!(bounce(&plain, near, 0) > 0.05);
    // the same colours by a texture, linear, and half of it metal
    let mut textured = corner();
    textured.materials[1].base_color = Vec3::ONE;
    textured.materials[1].base_color_texture = Some(TextureRef { texture: 0 });
    textured.materials[1].metallic = 0.5;
    textured.textures.push(Texture { width: 1, height: 1, srgb: false, rgba: vec![204, 102, 51, 255] });
    let textured = computed(&textured, options);
    for channel in 0..3 {
        let ratio = bounce(&textured, near, channel) / bounce(&plain, near, channel);
        assert!((ratio - 0.5).abs() < 1e-3, "channel {channel}: {ratio}");
    }
}

#[test]
fn threads_and_distance_from_the_origin_change_nothing() {
    let object = sphere_on_a_floor();
    let options = TransferOptions { samples: 400, bounces: 1, ..TransferOptions::default() };
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| computed(&object, options))
    };
    assert!(with(1) == with(4));
    // coordinates that f32 holds exactly before and after
    let mut near = corner();
    let mut far = corner();
    for vertex in near.vertices.iter_mut().chain(&mut far.vertices) {
        vertex.position = (vertex.position * 4.0).round();
    }
    far.vertices.iter_mut().for_each(|vertex| vertex.position += Vec3::new(1e6, -1e6, 1e6));
    assert!(computed(&near, options) == computed(&far, options));
}

#[test]
fn odd_objects_are_harmless() {
    let triangle = |normal: Vec3| {
        let vertex = |x: f32, y: f32| Vertex { position: Vec3::new(x, y, 0.0), normal, ..Vertex::default() };
        let mut object = Object {
            vertices: vec![vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(0.0, 1.0), vertex(0.0, 0.0)],
            indices: vec![0, 1, 2, 3, 0, 0],
            ..Object::default()
        };
        object.materials.push(Material::default());
        object.primitives.push(Primitive { indices: 0..6, material: 0 });
        object
    };
    let options = TransferOptions { bounces: 1, samples: 100, ..TransferOptions::default() };
    let lobe = COSINE_LOBE[0] * CONSTANT;
    for object in [triangle(Vec3::Z), triangle(Vec3::NEG_Z), triangle(7.0 * Vec3::X)] {
        let transfer = computed(&object, options);
        assert!((0..4).all(|vertex| (f64::from(transfer.of(vertex, 2)[0]) - lobe).abs() < 1e-6));
    }
    for normal in [Vec3::ZERO, Vec3::NAN, Vec3::new(f32::INFINITY, 0.0, 0.0)] {
        assert!(computed(&triangle(normal), options).coefficients.iter().all(|&c| c == 0.0));
    }
    let mut broken = triangle(Vec3::Z);
    broken.vertices[1].position.x = f32::NAN;
    let transfer = computed(&broken, options);
    assert!(transfer.coefficients.iter().all(|c| c.is_finite()));
    assert!(transfer.of(1, 0)[0] == 0.0 && transfer.of(0, 0)[0] > 0.5);
    assert!(computed(&Object::default(), options).coefficients.is_empty());
    for wrong in [
        TransferOptions { order: 0, ..options },
        TransferOptions { order: 6, ..options },
        TransferOptions { samples: 0, ..options },
        TransferOptions { bounces: 65, ..options },
        TransferOptions { visibility: false, ..options },
    ] {
        let error = compute(&broken, &wrong, &|_| ()).expect_err("it is out of range");
        assert!(matches!(&error, Error::Argument(line) if line.contains("of the transfer")), "{error}");
    }
}

#[test]
fn progress_ends_at_one() {
    let seen = std::sync::Mutex::new(Vec::new());
    let options = TransferOptions { samples: 9, bounces: 2, ..TransferOptions::default() };
    compute(&corner(), &options, &|share| seen.lock().expect("no panics").push(share)).expect("it is sound");
    let mut seen = seen.into_inner().expect("no panics");
    seen.sort_by(f32::total_cmp);
    assert!(seen.len() > 10 && seen[0] > 0.0 && seen.last() == Some(&1.0), "{seen:?}");
}

/// What `load_or_compute` says of its source, in a word.
fn source(path: &Path, object: &Object, options: &TransferOptions) -> Result<&'static str, String> {
    let (transfer, source) =
        load_or_compute(Some(path), object, options, &|_| ()).map_err(|error| error.to_string())?;
    assert!(transfer == computed(object, *options));
    Ok(match source {
        Source::Read => "read",
        Source::Computed => "computed",
        Source::ComputedUnsaved(_) => "unsaved",
    })
}

#[test]
fn saved_transfer_is_read_where_it_fits_and_replaced_where_it_does_not() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("corner.prt");
    let object = corner();
    let options = TransferOptions { samples: 100, ..TransferOptions::default() };
    let from = |object: &Object, options: TransferOptions| source(&path, object, &options);
    assert_eq!(from(&object, options).as_deref(), Ok("computed"));
    assert_eq!(from(&object, options).as_deref(), Ok("read"));
    for other in [
        TransferOptions { order: 3, ..options },
        TransferOptions { samples: 200, ..options },
        TransferOptions { bounces: 1, ..options },
        TransferOptions { visibility: false, ..options },
    ] {
        assert_eq!(from(&object, other).as_deref(), Ok("computed"), "{other:?}");
        assert_eq!(from(&object, other).as_deref(), Ok("read"), "{other:?}");
    }
    let mut moved = object.clone();
    moved.vertices[5].position.y += 1e-6;
    assert_eq!(from(&object, options).as_deref(), Ok("computed"));
    assert_eq!(from(&moved, options).as_deref(), Ok("computed"));
    // damaged: one bit, and cut short
    let bytes = fs::read(&path).expect("it was written");
    for damaged in [[&bytes[..99], &[bytes[99] ^ 4], &bytes[100..]].concat(), bytes[..bytes.len() - 9].to_vec()] {
        fs::write(&path, damaged).expect("the folder is writable");
        assert_eq!(from(&moved, options).as_deref(), Ok("computed"));
        assert_eq!(from(&moved, options).as_deref(), Ok("read"));
    }
    // any other file stays as it is
    for foreign in [&b"ply\nformat ascii 1.0\n"[..], b"", b"RELUMEPR"] {
        fs::write(&path, foreign).expect("the folder is writable");
        let message = from(&object, options).expect_err("it is another file");
        assert!(message.contains("corner.prt: is not a saved transfer"), "{message}");
        assert_eq!(fs::read(&path).expect("it is still there"), foreign);
    }
    // where nothing can be written the transfer comes all the same
    let nowhere = folder.path().join("missing").join("corner.prt");
    assert_eq!(source(&nowhere, &object, &options).as_deref(), Ok("unsaved"));
    assert!(source(folder.path(), &object, &options).expect_err("a folder").contains("it is a folder"));
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
}

#[test]
fn the_key_covers_what_transfer_depends_on_and_no_more() {
    let mut object = corner();
    object.materials[0].base_color_texture = Some(TextureRef { texture: 0 });
    object.textures = vec![Texture { width: 2, height: 1, srgb: true, rgba: vec![9; 8] }; 2];
    let keys = |object: &Object| [prt::key(object, 0), prt::key(object, 1)];
    let before = keys(&object);
    // known: the same on every machine
    let triangle = Object { vertices: vec![Vertex { position: Vec3::ONE, ..Vertex::default() }], ..Object::default() };
    assert_eq!(prt::key(&triangle, 0), KNOWN_KEY);
    let changed = |change: &dyn Fn(&mut Object)| {
        let mut object = object.clone();
        change(&mut object);
        let after = keys(&object);
        [after[0] != before[0], after[1] != before[1]]
    };
    assert_eq!(changed(&|o| o.vertices[3].position.x += 1e-6), [true, true]);
    assert_eq!(changed(&|o| o.vertices[3].normal = Vec3::X), [true, true]);
    assert_eq!(changed(&|o| o.indices.swap(0, 1)), [true, true]);
    assert_eq!(changed(&|o| o.vertices.swap(0, 1)), [true, true]);
    assert_eq!(changed(&|o| o.vertices[3].uv.x += 0.1), [false, true]);
    assert_eq!(changed(&|o| o.primitives.swap(0, 1)), [false, true]);
    assert_eq!(changed(&|o| o.materials[1].base_color.x = 0.9), [false, true]);
    assert_eq!(changed(&|o| o.materials[1].metallic = 0.9), [false, true]);
    assert_eq!(changed(&|o| o.materials[0].base_color_texture = None), [false, true]);
    assert_eq!(changed(&|o| o.textures[0].rgba[6] = 8), [false, true]);
    assert_eq!(changed(&|o| o.textures[0].srgb = false), [false, true]);
    // what only shines or lies there unused
    assert_eq!(changed(&|o| o.textures[1].rgba[6] = 8), [false, false]);
    assert_eq!(changed(&|o| o.materials[1].roughness = 0.9), [false, false]);
    assert_eq!(changed(&|o| o.vertices[3].tangent = [1.0; 4]), [false, false]);
}

/// Of one vertex at (1, 1, 1).
const KNOWN_KEY: u64 = 8_644_389_653_399_136_528;
