//! Objects, whatever their format: each reader makes pieces, which are then checked and completed alike.

mod gltf;
mod obj;
mod ply_mesh;
mod shading;
mod texture;

use std::path::Path;

use glam::{Vec2, Vec3, Vec4};

use super::extension;
use crate::scene::{Material, Object, Primitive, Texture, Vertex};
use crate::{Error, Result};

/// Coordinates beyond this many metres are refused: their squares must fit f32.
const FARTHEST: f32 = 1e12;

/// Reads an object:
/// - .gltf, .glb: the default scene with its node transforms; metallic-roughness materials with textures, normal maps,
///   emission (KHR_materials_emissive_strength) and alpha masks. Skins and animations are left at rest, blended
///   materials are drawn opaque, occlusion maps are ignored.
/// - .obj with its .mtl: Kd and map_Kd; Pr, or else Ns, as roughness; Pm as metallic; Ke; norm. A missing .mtl leaves
///   the default material.
/// - .ply: faces of any size; normals where the file has them.
///
/// Missing normals are smooth ones, weighted by angle; missing tangents are made where a normal map needs them.
/// Triangles without area are dropped. Nothing is scaled or turned: objects are taken to be in metres with +Y up.
///
/// # Errors
/// [`Error::File`] where the extension is another, the file or one of the files it refers to is missing or damaged,
/// an index is out of range, a coordinate is not finite, or no triangle is left.
pub fn load(path: &Path) -> Result<Object> {
    match extension(path).as_str() {
        "gltf" | "glb" => gltf::read(path),
        "obj" => obj::read(path),
        "ply" => ply_mesh::read(path),
        _ => Err(Error::file(path, "is not a known kind of object: expected .gltf, .glb, .obj or .ply")),
    }
}

/// Triangles of one material as a file has them. Attributes are as many as positions, or none where the file lacks
/// them.
#[derive(Default)]
struct Piece {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    tangents: Vec<Vec4>,
    uvs: Vec<Vec2>,
    /// Triangle list.
    indices: Vec<u32>,
    /// Index into the materials.
    material: usize,
}

/// Makes the object that all invariants of [`Object`] hold for, or says which one cannot.
fn assemble(path: &Path, pieces: Vec<Piece>, materials: Vec<Material>, textures: Vec<Texture>) -> Result<Object> {
    let mut object = Object { materials, textures, ..Object::default() };
    for mut piece in pieces {
        let count = piece.positions.len();
        if let Some(index) = piece.indices.iter().find(|&&index| index as usize >= count) {
            let problem = format!("has vertex index {index} in a face, but only {count} vertices there");
            return Err(Error::file(path, problem));
        }
        if let Some(index) = piece.positions.iter().position(|p| !p.is_finite()) {
            return Err(Error::file(path, format!("has a coordinate that is not finite, at vertex {index}")));
        }
        if let Some(index) = piece.positions.iter().position(|p| p.abs().max_element() > FARTHEST) {
            return Err(Error::file(path, format!("has a coordinate beyond {FARTHEST:e} m, at vertex {index}")));
        }
        piece.indices.truncate(piece.indices.len() / 3 * 3);
        drop_degenerate(&mut piece);
        if piece.indices.is_empty() {
            continue;
        }
        shading::complete_normals(&mut piece);
        let normal_mapped = object.materials.get(piece.material).is_some_and(|m| m.normal_texture.is_some());
        if normal_mapped {
            shading::complete_tangents(&mut piece);
        }
        let first_vertex = object.vertices.len() as u64;
        let (start, end) = (object.indices.len() as u64, (object.indices.len() + piece.indices.len()) as u64);
        let (Ok(start), Ok(end), true) =
            (u32::try_from(start), u32::try_from(end), first_vertex + count as u64 <= u64::from(u32::MAX))
        else {
            return Err(Error::file(path, format!("is too large: more than {} vertices or indices", u32::MAX)));
        };
        object.vertices.extend((0..count).map(|i| Vertex {
            position: piece.positions[i],
            normal: piece.normals[i],
            tangent: if normal_mapped { piece.tangents[i].to_array() } else { [0.0; 4] },
            uv: piece.uvs.get(i).copied().filter(|uv| uv.is_finite()).unwrap_or_default(),
        }));
        object.indices.extend(piece.indices.iter().map(|&index| first_vertex as u32 + index));
        object.primitives.push(Primitive { indices: start..end, material: piece.material });
    }
    if object.indices.is_empty() {
        return Err(Error::file(path, "holds no triangle with an area"));
    }
    Ok(object)
}

/// Removes triangles without area: they have no normal and no reader of the object should need to care.
fn drop_degenerate(piece: &mut Piece) {
    let Piece { positions, indices, .. } = piece;
    let at = |index: u32| positions[index as usize].as_dvec3();
    let has_area = |t: &[u32]| (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])) != glam::DVec3::ZERO;
    *indices = indices.chunks_exact(3).filter(|t| has_area(t)).flatten().copied().collect();
}
