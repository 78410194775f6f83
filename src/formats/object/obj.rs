//! Wavefront OBJ with MTL.

use std::collections::HashMap;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use tobj::{LoadError, LoadOptions};

use super::{Piece, assemble, texture};
use crate::formats::read_bytes;
use crate::scene::{Material, Object, Texture, TextureRef};
use crate::{Error, Result};

/// Reads all models of the file.
pub(super) fn read(path: &Path) -> Result<Object> {
    let bytes = read_bytes(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let options = LoadOptions { triangulate: true, single_index: true, ignore_points: true, ignore_lines: true };
    let open_mtl = |name: &Path| {
        let file =
            std::fs::File::open(folder.join(unix(&name.to_string_lossy()))).map_err(|_| LoadError::OpenFileFailed)?;
        tobj::load_mtl_buf(&mut BufReader::new(file))
    };
    let (models, materials) = tobj::load_obj_buf(&mut bytes.as_slice(), &options, open_mtl)
        .map_err(|e| Error::file(path, format!("is not a readable OBJ file: {e}")))?;
    let materials = materials.or_else(|e| match e {
        LoadError::OpenFileFailed => {
            tracing::warn!("{}: its material library is missing: using the default material", path.display());
            Ok(Vec::new())
        }
        other => Err(Error::file(path, format!("has an unreadable material library: {other}"))),
    })?;
    let mut textures = Textures { folder, loaded: Vec::new(), by_name: HashMap::new() };
    let mut converted = vec![Material::default()];
    for material in &materials {
        converted.push(convert(path, material, &mut textures)?);
    }
    let pieces = models.into_iter().map(|model| {
        let mesh = model.mesh;
        let vectors = |values: &[f32]| values.chunks_exact(3).map(Vec3::from_slice).collect();
        Piece {
            positions: vectors(&mesh.positions),
            normals: vectors(&mesh.normals),
            // (0, 0) is the lower left in OBJ.
            uvs: mesh.texcoords.chunks_exact(2).map(|uv| Vec2::new(uv[0], 1.0 - uv[1])).collect(),
            indices: mesh.indices,
            material: mesh.material_id.map_or(0, |id| id + 1).min(materials.len()),
            ..Piece::default()
        }
    });
    assemble(path, pieces.collect(), converted, textures.loaded)
}

/// The nearest metallic-roughness material. Pm, Pr, norm: the PBR extension that most exporters follow.
fn convert(path: &Path, material: &tobj::Material, textures: &mut Textures) -> Result<Material> {
    let default = Material::default();
    let extra = |name: &str| material.unknown_param.get(name).map(String::as_str);
    let number = |name: &str| extra(name).and_then(|text| text.trim().parse::<f32>().ok()).filter(|v| v.is_finite());
    let color = |rgb: [f32; 3]| Some(Vec3::from(rgb).max(Vec3::ZERO)).filter(|c| c.is_finite());
    // Blinn's exponent n of a lobe as wide as GGX's: alpha^2 = 2 / (n + 2), and roughness is the root of alpha.
    let from_exponent = material.shininess.map(|n| (2.0 / (n.max(0.0) + 2.0)).powf(0.25));
    let mut texture = |name: Option<&str>, srgb: bool| name.map(|n| textures.get(path, n, srgb)).transpose();
    let base_color_texture = texture(material.diffuse_texture.as_deref(), true)?;
    // Without Kd a texture shows as it is.
    let fallback = if base_color_texture.is_some() { Vec3::ONE } else { default.base_color };
    Ok(Material {
        name: material.name.clone(),
        base_color: material.diffuse.and_then(color).unwrap_or(fallback),
        base_color_texture,
        metallic: number("Pm").unwrap_or(0.0).clamp(0.0, 1.0),
        roughness: number("Pr")
            .or(from_exponent)
            .filter(|r| r.is_finite())
            .unwrap_or(default.roughness)
            .clamp(0.0, 1.0),
        normal_texture: texture(extra("norm"), false)?,
        emissive: material.emissive.and_then(color).unwrap_or(Vec3::ZERO),
        emissive_texture: texture(extra("map_Ke"), true)?,
        ..default
    })
}

/// Image files that materials name, each read once.
struct Textures<'a> {
    folder: &'a Path,
    loaded: Vec<Texture>,
    by_name: HashMap<(PathBuf, bool), usize>,
}

impl Textures<'_> {
    fn get(&mut self, path: &Path, statement: &str, srgb: bool) -> Result<TextureRef> {
        // `-s 1 1 1 -o 0 0 0 name.png`: options come first and no option's value looks like a file name.
        let statement = statement.trim();
        let name =
            if statement.starts_with('-') { statement.rsplit(' ').next().unwrap_or(statement) } else { statement };
        let file = self.folder.join(unix(name));
        if let Some(&texture) = self.by_name.get(&(file.clone(), srgb)) {
            return Ok(TextureRef { texture });
        }
        let encoded =
            std::fs::read(&file).map_err(|e| Error::file(path, format!("texture '{name}' cannot be read: {e}")))?;
        let decoded = texture::decode(&encoded, srgb)
            .map_err(|e| Error::file(path, format!("texture '{name}' is not a readable image: {e}")))?;
        self.loaded.push(decoded);
        let texture = self.loaded.len() - 1;
        self.by_name.insert((file, srgb), texture);
        Ok(TextureRef { texture })
    }
}

/// Exporters on Windows write backslashes.
fn unix(name: &str) -> String {
    name.replace('\\', "/")
}
