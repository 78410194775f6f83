//! Normals and tangents that a file lacks.

use std::collections::HashMap;

use glam::{DVec3, Vec2, Vec3, Vec4};

use super::Piece;

/// Unitises the normals of a piece and gives smooth ones to vertices that have none (or unusable ones): the mean over
/// the triangles around a position, weighted by their angle there (Thürmer and Wüthrich, "Computing Vertex Normals
/// from Polygonal Facets", 1998), which does not depend on how a face was cut into triangles. Vertices at the same
/// position share the sum, so that texture seams do not show in the shading; but the two sides of a leaf, back to
/// back, do not.
pub(super) fn complete_normals(piece: &mut Piece) {
    piece.normals.resize(piece.positions.len(), Vec3::ZERO);
    for normal in &mut piece.normals {
        *normal = normal.normalize_or_zero();
    }
    if !piece.normals.contains(&Vec3::ZERO) {
        return;
    }
    // Adding zero makes -0.0 and 0.0 the same key.
    let key = |index: u32| (piece.positions[index as usize] + Vec3::ZERO).to_array().map(f32::to_bits);
    let mut shared: HashMap<[u32; 3], DVec3> = HashMap::new();
    let mut own = vec![DVec3::ZERO; piece.positions.len()];
    for triangle in piece.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|corner| piece.positions[triangle[corner] as usize].as_dvec3());
        let normal = (b - a).cross(c - a).normalize_or_zero();
        for (corner, (here, next, last)) in [(a, b, c), (b, c, a), (c, a, b)].into_iter().enumerate() {
            let angle = (next - here).angle_between(last - here);
            let weighted = if angle.is_finite() { angle } else { 0.0 } * normal;
            *shared.entry(key(triangle[corner])).or_default() += weighted;
            own[triangle[corner] as usize] += weighted;
        }
    }
    for (index, own) in own.into_iter().enumerate() {
        if piece.normals[index] == Vec3::ZERO {
            let shared = shared.get(&key(index as u32)).copied().unwrap_or_default();
            // Rounding leaves a little of what cancels out, hence not just the sign.
            let sum = if shared.dot(own) > 1e-6 * own.length_squared() { shared } else { own };
            // Y for vertices that no triangle uses.
            piece.normals[index] = sum.normalize_or(DVec3::Y).as_vec3().normalize_or(Vec3::Y);
        }
    }
}

/// Unitises the tangents of a piece and makes them where missing: the direction in which u grows, averaged over a
/// vertex's triangles and made orthogonal to its normal, with the side on which v grows towards the image's top in w
/// (glTF 2.0, 3.7.2.1; v points down the image, so the bitangent is against it). Needs unit normals.
pub(super) fn complete_tangents(piece: &mut Piece) {
    let count = piece.positions.len();
    let usable = |t: &Vec4| t.is_finite() && t.truncate().length_squared() > 1e-12 && t.w.abs() == 1.0;
    piece.tangents.resize(count, Vec4::ZERO);
    if !piece.tangents.iter().all(usable) {
        let uv = |index: u32| piece.uvs.get(index as usize).copied().unwrap_or(Vec2::ZERO).as_dvec2();
        let mut along = vec![(DVec3::ZERO, DVec3::ZERO); count];
        for triangle in piece.indices.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|corner| piece.positions[triangle[corner] as usize].as_dvec3());
            let (e1, e2) = (b - a, c - a);
            let (d1, d2) = (uv(triangle[1]) - uv(triangle[0]), uv(triangle[2]) - uv(triangle[0]));
            let determinant = d1.perp_dot(d2);
            if determinant == 0.0 || !determinant.is_finite() {
                continue;
            }
            // Large triangles count more: divide by the sign of the area in texture space alone.
            let (tangent, down) =
                ((e1 * d2.y - e2 * d1.y) * determinant.signum(), (e2 * d1.x - e1 * d2.x) * determinant.signum());
            for &index in triangle {
                along[index as usize].0 += tangent;
                along[index as usize].1 -= down;
            }
        }
        for (index, (tangent, up)) in along.into_iter().enumerate() {
            if !usable(&piece.tangents[index]) {
                let normal = piece.normals[index].as_dvec3();
                let side = if normal.cross(tangent).dot(up) < 0.0 { -1.0 } else { 1.0 };
                piece.tangents[index] = tangent.as_vec3().extend(side);
            }
        }
    }
    for (tangent, &normal) in piece.tangents.iter_mut().zip(&piece.normals) {
        let flat = tangent.truncate() - normal * normal.dot(tangent.truncate());
        *tangent = flat.normalize_or(normal.any_orthonormal_vector()).extend(tangent.w);
    }
}
