//! Objects built in code.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use crate::scene::{Material, Object, Primitive, Vertex};

/// Step of the finite differences that normals come from, in surface parameters.
const STEP: f32 = 1e-3;

/// A sphere about 0: a grid of `4 * subdivisions` meridians and `2 * subdivisions` parallels, exact normals, texture
/// coordinates by longitude and latitude. `subdivisions` counts as at least 2 and at most 1024.
pub fn sphere(radius: f32, subdivisions: u32) -> Object {
    let subdivisions = subdivisions.clamp(2, 1024);
    let mut object = Object::default();
    let point = |u: f32, v: f32| {
        let (around, down) = (TAU * u, PI * v);
        radius * Vec3::new(down.sin() * around.cos(), down.cos(), -down.sin() * around.sin())
    };
    add(&mut object, (4 * subdivisions, 2 * subdivisions), Material::default(), point);
    for vertex in &mut object.vertices {
        vertex.normal = vertex.position.normalize_or(Vec3::Y);
    }
    object
}

/// A ball of radius 1 with bumps that shadow each other, over a ground of 6 x 6 at a height of -1.3: what the transfers of
/// benchmarks are of. Both are grids of so many cells along either side, with one vertex more along each.
pub fn bumpy_ball(ball: (u32, u32), ground: (u32, u32)) -> Object {
    let mut object = Object::default();
    add(&mut object, ball, Material::default(), |u, v| {
        let (around, down) = (TAU * u, PI * v);
        let radius = 1.0 + 0.25 * (7.0 * around).sin() * (5.0 * down).sin();
        radius * Vec3::new(down.sin() * around.cos(), down.cos(), -down.sin() * around.sin())
    });
    add_level(&mut object, ground, 3.0, Vec3::new(0.0, -1.3, 0.0));
    object
}

/// Adds the ground that an object stands on: level, `reach` times as wide as the object, of so many cells a side.
pub fn add_ground(object: &mut Object, reach: f32, cells: u32) {
    let (low, high) = object.bounds();
    let size = high - low;
    let middle = 0.5 * (low + high);
    let half = 0.5 * reach * size.x.max(size.z);
    add_level(object, (cells, cells), half, Vec3::new(middle.x, low.y - 1e-3 * size.y, middle.z));
}

/// A level square about `middle`, half as wide as `half` says.
fn add_level(object: &mut Object, cells: (u32, u32), half: f32, middle: Vec3) {
    add(object, cells, Material::default(), |u, v| middle + half * Vec3::new(2.0 * u - 1.0, 0.0, 2.0 * v - 1.0));
}

/// A demonstration piece about 0, 0.9 m tall: a matt clay plinth, on it a glossy twisted vase with fine flutes, and
/// around its neck a knot of polished metal. About 60,000 triangles, three materials: `clay`, `glaze`, `metal`.
pub fn trophy() -> Object {
    let clay = Material {
        name: "clay".into(),
        base_color: Vec3::new(0.72, 0.66, 0.58),
        roughness: 1.0,
        specular: 0.0,
        ..Material::default()
    };
    let glaze = Material {
        name: "glaze".into(),
        base_color: Vec3::new(0.05, 0.22, 0.36),
        roughness: 0.3,
        ..Material::default()
    };
    let metal = Material {
        name: "metal".into(),
        base_color: Vec3::new(0.95, 0.78, 0.48),
        metallic: 1.0,
        roughness: 0.4,
        ..Material::default()
    };
    let mut object = Object::default();
    add(&mut object, (96, 64), clay, |u, v| turned(u, profile(&PLINTH, 1.0 - v)));
    add(&mut object, (288, 64), glaze, |u, v| {
        let place = profile(&VASE, 1.0 - v);
        // flutes wind up the belly and fade out towards foot and lip
        let strength = (PI * (1.0 - v)).sin().max(0.0).powi(2);
        let flute = (24.0 * (TAU * u + 0.9 * v)).cos();
        turned(u, Vec2::new(place.x * (1.0 + 0.035 * strength * flute), place.y))
    });
    add(&mut object, (320, 20), metal, knot);
    object
}

/// (radius, height) from the middle of the bottom to the middle of the top; rounded where the curve between them is.
const PLINTH: [Vec2; 12] = [
    Vec2::new(0.0, -0.45),
    Vec2::new(0.12, -0.45),
    Vec2::new(0.25, -0.45),
    Vec2::new(0.27, -0.44),
    Vec2::new(0.27, -0.41),
    Vec2::new(0.24, -0.39),
    Vec2::new(0.205, -0.375),
    Vec2::new(0.20, -0.33),
    Vec2::new(0.215, -0.31),
    Vec2::new(0.205, -0.295),
    Vec2::new(0.10, -0.29),
    Vec2::new(0.0, -0.29),
];

/// The vase's outside from its foot to the lip, and its inside down again.
const VASE: [Vec2; 14] = [
    Vec2::new(0.0, -0.288),
    Vec2::new(0.09, -0.288),
    Vec2::new(0.115, -0.28),
    Vec2::new(0.10, -0.25),
    Vec2::new(0.16, -0.14),
    Vec2::new(0.225, 0.0),
    Vec2::new(0.20, 0.13),
    Vec2::new(0.115, 0.23),
    Vec2::new(0.085, 0.31),
    Vec2::new(0.115, 0.41),
    Vec2::new(0.165, 0.45),
    Vec2::new(0.145, 0.435),
    Vec2::new(0.07, 0.31),
    Vec2::new(0.0, 0.20),
];

/// A uniform Catmull-Rom spline through `points` at `t` in 0..1; the radius never goes below 0.
fn profile(points: &[Vec2], t: f32) -> Vec2 {
    let last = points.len() - 1;
    let place = t.clamp(0.0, 1.0) * last as f32;
    let from = (place as usize).min(last - 1);
    let s = place - from as f32;
    let [a, b, c, d] = [from.saturating_sub(1), from, from + 1, (from + 2).min(last)].map(|n| points[n]);
    let curve = 2.0 * b + (c - a) * s + (2.0 * a - 5.0 * b + 4.0 * c - d) * s * s + (3.0 * (b - c) + d - a) * s * s * s;
    (0.5 * curve).max(Vec2::new(0.0, f32::NEG_INFINITY))
}

/// A (radius, height) turned about +Y by `u` of a full turn.
fn turned(u: f32, place: Vec2) -> Vec3 {
    let (sin, cos) = (TAU * u).sin_cos();
    Vec3::new(place.x * cos, place.y, -place.x * sin)
}

/// A tube along a (2, 5) torus knot around the neck of the vase: `u` along it, `v` around it.
fn knot(u: f32, v: f32) -> Vec3 {
    const TUBE: f32 = 0.02;
    let centre = |u: f32| {
        let turn = 2.0 * TAU * u;
        let (sin, cos) = (2.5 * turn).sin_cos();
        let radius = 0.165 + 0.045 * cos;
        Vec3::new(radius * turn.cos(), 0.30 + 0.045 * sin, -radius * turn.sin())
    };
    let along = (centre(u + STEP) - centre(u - STEP)).normalize_or(Vec3::X);
    let side = along.cross(Vec3::Y).normalize_or(Vec3::X);
    let (sin, cos) = (TAU * v).sin_cos();
    centre(u) + TUBE * (cos * side + sin * along.cross(side))
}

/// Adds `point(u, v)` over the unit square as a grid of cells with a material of its own. Its front is where
/// d/dv x d/du points; triangles without area, as at poles, are left out.
fn add(object: &mut Object, (columns, rows): (u32, u32), material: Material, point: impl Fn(f32, f32) -> Vec3) {
    let first = object.vertices.len() as u32;
    let first_index = object.indices.len() as u32;
    for (row, column) in (0..=rows).flat_map(|row| (0..=columns).map(move |column| (row, column))) {
        let uv = Vec2::new(column as f32 / columns as f32, row as f32 / rows as f32);
        // at a pole all of d/du vanishes: the normal is taken just beside it, inside of the square
        let v = uv.y.clamp(2.0 * STEP, 1.0 - 2.0 * STEP);
        let along_u = point(uv.x + STEP, v) - point(uv.x - STEP, v);
        let along_v = point(uv.x, v + STEP) - point(uv.x, v - STEP);
        let normal = along_v.cross(along_u).normalize_or(Vec3::Y);
        object.vertices.push(Vertex { position: point(uv.x, uv.y), normal, tangent: [0.0; 4], uv });
    }
    let at = |column: u32, row: u32| first + row * (columns + 1) + column;
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let (a, b) = (at(column, row), at(column + 1, row));
        let (c, d) = (at(column, row + 1), at(column + 1, row + 1));
        for triangle in [[a, c, b], [b, c, d]] {
            let [p, q, r] = triangle.map(|index| object.vertices[index as usize].position);
            let longest = (q - p).length_squared().max((r - p).length_squared());
            if (q - p).cross(r - p).length() > 1e-5 * longest {
                object.indices.extend(triangle);
            }
        }
    }
    let indices = first_index..object.indices.len() as u32;
    object.primitives.push(Primitive { indices, material: object.materials.len() });
    object.materials.push(material);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Volume inside of closed surfaces whose fronts look outwards, and whether normals agree with the triangles.
    fn check(object: &Object) -> f32 {
        let mut volume = 0.0;
        let mut against = 0;
        for triangle in object.indices.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|n| object.vertices[triangle[n] as usize]);
            volume += a.position.dot(b.position.cross(c.position)) / 6.0;
            let face = (b.position - a.position).cross(c.position - a.position);
            against += usize::from(face.dot(a.normal + b.normal + c.normal) <= 0.0);
        }
        assert!(against * 200 < object.indices.len() / 3, "{against} triangles look away from their normals");
        assert!(object.vertices.iter().all(|v| v.position.is_finite() && v.normal.is_normalized()));
        assert!(object.vertices.iter().all(|v| v.uv.min_element() >= 0.0 && v.uv.max_element() <= 1.0));
        let ranges: Vec<_> = object.primitives.iter().map(|p| p.indices.clone()).collect();
        assert!(ranges.windows(2).all(|pair| pair[0].end == pair[1].start), "{ranges:?}");
        assert_eq!(ranges.last().map(|range| range.end as usize), Some(object.indices.len()));
        volume
    }

    #[test]
    fn a_sphere_has_its_volume() {
        let volume = check(&sphere(0.5, 32));
        assert!((volume / (PI / 6.0) - 1.0).abs() < 0.01, "{volume}");
        assert!(check(&sphere(1.0, 0)) > 0.0);
    }

    #[test]
    fn the_ground_lies_below_and_looks_up() {
        let mut object = sphere(1.0, 8);
        let before = object.vertices.len();
        add_ground(&mut object, 4.0, 3);
        let ground = &object.vertices[before..];
        assert_eq!(ground.len(), 16);
        assert!(ground.iter().all(|v| v.normal.distance(Vec3::Y) < 1e-3 && v.position.y < -1.0));
        assert_eq!(object.bounds().1.x, 4.0);
        let sizes = [((118, 60), (13, 13)), ((333, 163), (10, 15))].map(|(a, b)| bumpy_ball(a, b).vertices.len());
        assert_eq!(sizes, [7455, 54_952], "those of Hajisharif 2012, Table 1");
    }

    #[test]
    fn the_trophy_is_dense_and_shows_three_materials() {
        let object = trophy();
        assert!(check(&object) > 0.01);
        assert!(object.indices.len() / 3 > 20_000);
        assert_eq!((object.materials.len(), object.primitives.len()), (3, 3));
        let (low, high) = object.bounds();
        assert!((high.y - low.y - 0.9).abs() < 0.02 && (high.y + low.y).abs() < 0.02, "{low} to {high}");
    }
}
