//! Objects of fewer triangles, for pictures of things that move: vertices of a cell of a grid become one (Rossignac and
//! Borrel 1993).

use std::collections::HashMap;

use glam::{IVec3, Vec3};

use crate::scene::{Object, Primitive, Vertex};

/// An object of about `triangles` triangles or fewer; the same where it has no more. Materials stay, and vertices of
/// different materials are not joined.
pub fn simplify(object: &Object, triangles: usize) -> Object {
    if object.indices.len() / 3 <= triangles {
        return object.clone();
    }
    let (low, high) = object.bounds();
    let extent = (high - low).max_element().max(f32::MIN_POSITIVE);
    // A surface crosses about as many cells as the grid has on its sides, with two triangles in each.
    let mut cells = (triangles as f32 / 6.0).sqrt().max(2.0);
    loop {
        let simpler = clustered(object, low, extent / cells);
        if simpler.indices.len() / 3 <= triangles || cells < 3.0 {
            return simpler;
        }
        cells *= 0.85;
    }
}

fn clustered(object: &Object, low: Vec3, cell: f32) -> Object {
    let mut simpler = Object {
        vertices: Vec::new(),
        indices: Vec::new(),
        primitives: Vec::new(),
        materials: object.materials.clone(),
        textures: object.textures.clone(),
    };
    for primitive in &object.primitives {
        // In the order in which they come, so that the result is the same every time.
        let mut clusters: HashMap<IVec3, u32> = HashMap::new();
        let mut sums: Vec<(Vec3, Vec3, f32)> = Vec::new();
        let first = simpler.vertices.len() as u32;
        let start = simpler.indices.len() as u32;
        let range = primitive.indices.start as usize..primitive.indices.end as usize;
        for triangle in object.indices[range].chunks_exact(3) {
            let corners = [0, 1, 2].map(|k| {
                let vertex = &object.vertices[triangle[k] as usize];
                let key = ((vertex.position - low) / cell).floor().as_ivec3();
                let index = *clusters.entry(key).or_insert_with(|| {
                    simpler.vertices.push(*vertex);
                    sums.push((Vec3::ZERO, Vec3::ZERO, 0.0));
                    sums.len() as u32 - 1
                });
                let sum = &mut sums[index as usize];
                *sum = (sum.0 + vertex.position, sum.1 + vertex.normal, sum.2 + 1.0);
                index
            });
            if corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0] {
                simpler.indices.extend(corners.map(|corner| first + corner));
            }
        }
        for (vertex, (position, normal, count)) in simpler.vertices[first as usize..].iter_mut().zip(&sums) {
            *vertex = Vertex { position: *position / *count, normal: normal.normalize_or(vertex.normal), ..*vertex };
        }
        let indices = start..simpler.indices.len() as u32;
        if !indices.is_empty() {
            simpler.primitives.push(Primitive { indices, material: primitive.material });
        }
    }
    simpler
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::shapes::{sphere, trophy};

    #[test]
    fn a_simpler_ball_is_still_a_ball() {
        let ball = sphere(0.5, 64);
        let simpler = simplify(&ball, 4000);
        let triangles = simpler.indices.len() / 3;
        assert!(triangles <= 4000 && triangles > 1000, "{triangles} of {}", ball.indices.len() / 3);
        for vertex in &simpler.vertices {
            assert!((vertex.position.length() - 0.5).abs() < 0.02);
            assert!(vertex.normal.dot(vertex.position.normalize()) > 0.95);
        }
        assert_eq!(simplify(&ball, 4000).indices, simpler.indices, "the same every time");
    }

    #[test]
    fn materials_stay_and_small_objects_too() {
        let object = trophy();
        let simpler = simplify(&object, 5000);
        assert!(simpler.indices.len() <= 15_000);
        assert_eq!(simpler.primitives.len(), object.primitives.len());
        let ends = |o: &Object| (o.bounds().0, o.bounds().1);
        assert!(ends(&object).0.distance(ends(&simpler).0) < 0.05 && ends(&object).1.distance(ends(&simpler).1) < 0.05);
        assert_eq!(simplify(&object, 1 << 20).indices, object.indices);
    }
}
