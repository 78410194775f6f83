//! Meshes in PLY files.

use std::path::Path;

use super::{Piece, assemble};
use crate::formats::ply::read_elements;
use crate::scene::{Material, Object};
use crate::{Error, Result};

/// Reads `vertex` (x, y, z; nx, ny, nz) and `face` (vertex_indices or vertex_index); faces of more than three corners
/// become fans.
pub(super) fn read(path: &Path) -> Result<Object> {
    let [vertices, faces] = read_elements(path, [("vertex", ""), ("face", "vertex_ind")])?;
    let missing = |what: &str| Error::file(path, format!("is not a mesh: {what}"));
    let positions = vertices.table.positions().ok_or_else(|| missing("its vertices have no x, y, z"))?;
    if faces.ends.len() != faces.rows {
        return Err(missing("its faces have no list 'vertex_indices'"));
    }
    let mut indices = Vec::new();
    let mut start = 0;
    for &end in &faces.ends {
        if let [first, rest @ ..] = &faces.list[start..end] {
            indices.extend(rest.windows(2).flat_map(|pair| [*first, pair[0], pair[1]]));
        }
        start = end;
    }
    let piece = Piece {
        positions: positions.into_iter().map(|p| p.as_vec3()).collect(),
        normals: vertices.table.normals().unwrap_or_default(),
        indices,
        ..Piece::default()
    };
    assemble(path, vec![piece], vec![Material::default()], Vec::new())
}
