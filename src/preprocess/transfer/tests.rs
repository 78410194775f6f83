use super::*;
use crate::scene::{Material, Primitive};

fn object(triangles: &[[Vec3; 3]], normal: impl Fn(Vec3, Vec3) -> Vec3, albedo: Vec3) -> Object {
    let vertices = triangles.iter().flat_map(|&[a, b, c]| {
        let face = (b - a).cross(c - a).normalize();
        [a, b, c].map(|position| Vertex { position, normal: normal(position, face), ..Vertex::default() })
    });
    let indices: Vec<u32> = (0..3 * triangles.len() as u32).collect();
    Object {
        vertices: vertices.collect(),
        primitives: vec![Primitive { indices: 0..indices.len() as u32, material: 0 }],
        indices,
        materials: vec![Material { base_color: albedo, ..Material::default() }],
        textures: Vec::new(),
    }
}

/// The faces of a cube of 2 m about 0, seen from inside.
fn cube_inside() -> Vec<[Vec3; 3]> {
    let mut triangles = Vec::new();
    for axis in 0..6 {
        let mut normal = Vec3::ZERO;
        normal[axis % 3] = if axis < 3 { 1.0 } else { -1.0 };
        let u = normal.any_orthonormal_vector();
        let v = normal.cross(u);
        let at = |x: f32, y: f32| u * x + v * y - normal;
        triangles
            .extend([[at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0)], [at(-1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)]]);
    }
    triangles
}

#[test]
fn a_bounce_in_a_closed_box_multiplies_with_the_albedo() {
    let albedo = Vec3::new(0.75, 0.5, 0.25);
    let box_inside = object(&cube_inside(), |_, face| face, albedo);
    let options = TransferOptions { order: 2, samples: 2500, bounces: 1, visibility: true };
    let direct = compute(&box_inside, &TransferOptions { bounces: 0, ..options }, &|_| ()).expect("the box is sound");
    assert!(direct.coefficients.iter().all(|c| *c == 0.0), "nothing gets in");
    let scene = Scene::new(&box_inside, &options);
    let colors = Albedo::new(&box_inside);
    // what a wall receives is 1 everywhere in all coefficients: the next wall receives albedo, and so on
    let mut last = vec![1.0; box_inside.vertices.len() * 12];
    let mut sum = last.clone();
    for _ in 0..40 {
        let mut next = vec![0.0; last.len()];
        scene.for_each_vertex(&mut next, &|| (), |vertex, out| scene.reflected(vertex, &colors, &last, out));
        sum.iter_mut().zip(&next).for_each(|(sum, next)| *sum += next);
        last = next;
    }
    for (at, value) in sum.into_iter().enumerate() {
        let expected = 1.0 / (1.0 - albedo[at / 4 % 3]);
        assert!((value / expected - 1.0).abs() < 0.02, "{at}: {value} instead of {expected}");
    }
}

#[test]
fn the_backs_of_surfaces_reflect_nothing() {
    let wall = [[Vec3::new(-9.0, 1.0, -9.0), Vec3::new(9.0, 1.0, -9.0), Vec3::new(0.0, 1.0, 9.0)]];
    let floor = [[Vec3::ZERO, Vec3::Z * 0.1, Vec3::X * 0.1]];
    let triangles = [wall[0], floor[0]];
    let reflected = |wall_normal: Vec3| {
        let object = object(&triangles, |position, face| if position.y > 0.5 { wall_normal } else { face }, Vec3::ONE);
        let scene = Scene::new(&object, &TransferOptions { order: 1, ..TransferOptions::default() });
        let mut out = [0.0; 3];
        scene.reflected(3, &Albedo::new(&object), &[1.0; 18], &mut out);
        out
    };
    assert_eq!(reflected(Vec3::Y), [0.0; 3]);
    assert!(reflected(Vec3::NEG_Y).iter().all(|light| (0.9..1.0).contains(light)));
}

#[test]
fn light_comes_from_the_corner_of_the_triangle_that_is_lit() {
    let triangles = [
        [Vec3::new(-0.5, 1.0, -0.5), Vec3::new(0.5, 1.0, -0.5), Vec3::new(0.0, 1.0, 0.5)],
        [Vec3::ZERO, Vec3::Z * 0.01, Vec3::X * 0.01],
    ];
    let object = object(&triangles, |position, face| if position.y > 0.5 { Vec3::NEG_Y } else { face }, Vec3::ONE);
    let scene = Scene::new(&object, &TransferOptions { order: 1, samples: 100_000, ..TransferOptions::default() });
    let gathered = |corner: usize| {
        let mut light = [0.0; 18];
        light[3 * corner..3 * corner + 3].fill(1.0);
        let mut out = [0.0; 3];
        scene.reflected(3, &Albedo::new(&object), &light, &mut out);
        out[0]
    };
    // by brute force: the form factor of the triangle, weighted by each corner's barycentric coordinate
    let [a, b, c] = triangles[0];
    let mut expected = [0.0_f32; 3];
    let steps = 200;
    for (i, j) in (0..steps).flat_map(|i| (0..steps - i).map(move |j| (i, j))) {
        let (u, v) = ((i as f32 + 1.0 / 3.0) / steps as f32, (j as f32 + 1.0 / 3.0) / steps as f32);
        let at = a + (b - a) * u + (c - a) * v;
        let area = (b - a).cross(c - a).length() / (steps * steps) as f32;
        let share = area / (PI * at.length_squared() * at.length_squared());
        [1.0 - u - v, u, v].into_iter().zip(&mut expected).for_each(|(weight, sum)| *sum += weight * share);
    }
    for corner in 0..3 {
        let (found, expected) = (gathered(corner), expected[corner]);
        assert!((found / expected - 1.0).abs() < 0.02, "{corner}: {found} instead of {expected}");
    }
}
