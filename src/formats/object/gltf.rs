//! glTF 2.0. The crate's own import slices buffers without looking at their length, so that the bytes are fetched and
//! every accessor is checked here first.

use std::collections::HashMap;
use std::path::Path;

use glam::{Affine2, Affine3A, Mat4, Vec2, Vec3, Vec4};
use gltf::accessor::{Accessor, DataType, Dimensions};
use gltf::material::AlphaMode;
use gltf::mesh::Mode;
use gltf::texture::TextureTransform;
use gltf::{Document, Gltf, Semantic, buffer, image};
use rayon::prelude::*;

use super::{Piece, assemble, texture};
use crate::formats::{excerpt, read_bytes};
use crate::scene::{Material, Object, Texture, TextureRef};
use crate::{Error, Result};

/// Reads the default scene, or the first one, or (in a file without scenes) all nodes.
pub(super) fn read(path: &Path) -> Result<Object> {
    let bytes = read_bytes(path)?;
    let (document, mut blob) = parse(path, &bytes)?;
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let data = match buffer.source() {
            buffer::Source::Bin => {
                blob.take().ok_or_else(|| Error::file(path, "has no binary chunk for its buffer"))?
            }
            buffer::Source::Uri(uri) => fetch(path, uri)?,
        };
        if data.len() < buffer.length() {
            let (index, promised, held) = (buffer.index(), buffer.length(), data.len());
            let problem = format!("is cut short: buffer {index} should hold {promised} bytes, it holds {held}");
            return Err(Error::file(path, problem));
        }
        buffers.push(data);
    }
    let mut wanted = Wanted::default();
    let mut materials: Vec<Material> = document.materials().map(|m| convert(path, &m, &mut wanted)).collect();
    let textures = decode_images(path, &document, &buffers, &wanted.images)?;
    let scene = Scene { path, buffers: &buffers, default_material: materials.len() };
    let pieces = scene.pieces(&document)?;
    if pieces.iter().any(|piece| piece.material == scene.default_material) {
        // What the specification gives to primitives without material.
        let name = "default".into();
        materials.push(Material { name, base_color: Vec3::ONE, metallic: 1.0, roughness: 1.0, ..Material::default() });
    }
    assemble(path, pieces, materials, textures)
}

/// The validated document and the binary chunk of a .glb.
fn parse(path: &Path, bytes: &[u8]) -> Result<(Document, Option<Vec<u8>>)> {
    let bad = |e: gltf::Error| Error::file(path, format!("is not a readable glTF file: {e}"));
    let Gltf { document, blob } = Gltf::from_slice_without_validation(bytes).map_err(bad)?;
    let root = document.into_json();
    // Validation looks positions up without asking whether they exist, and leaves these images to panic later.
    let mut attributes = root.meshes.iter().flat_map(|m| &m.primitives).flat_map(|p| p.attributes.values());
    if let Some(index) = attributes.find(|index| index.value() >= root.accessors.len()) {
        let problem =
            format!("has a mesh with accessor {}, but only {} accessors", index.value(), root.accessors.len());
        return Err(Error::file(path, problem));
    }
    let sourceless = |i: &gltf::json::Image| i.uri.is_none() && (i.buffer_view.is_none() || i.mime_type.is_none());
    if let Some(index) = root.images.iter().position(sourceless) {
        return Err(Error::file(
            path,
            format!("has an image {index} without uri, and without bufferView and mimeType"),
        ));
    }
    Ok((Document::from_json(root).map_err(bad)?, blob))
}

/// Bytes behind a URI: a file beside `path`, or data in base64.
fn fetch(path: &Path, uri: &str) -> Result<Vec<u8>> {
    let shown = excerpt(uri);
    let bad = |e: String| Error::file(path, format!("refers to '{shown}', which cannot be read: {e}"));
    if !is_decodable(uri) {
        return Err(bad("its %-escapes make no valid name".into()));
    }
    let data = buffer::Data::from_source(buffer::Source::Uri(uri), path.parent()).map_err(|e| bad(e.to_string()))?;
    Ok(data.0)
}

/// True where decoding the %-escapes gives UTF-8, which the crate takes for granted.
fn is_decodable(uri: &str) -> bool {
    let mut decoded = Vec::new();
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        let code =
            tail.get(..2).and_then(|hex| std::str::from_utf8(hex).ok()).and_then(|h| u8::from_str_radix(h, 16).ok());
        match code {
            Some(code) if *first == b'%' => {
                decoded.push(code);
                rest = &tail[2..];
            }
            _ => {
                decoded.push(*first);
                rest = tail;
            }
        }
    }
    std::str::from_utf8(&decoded).is_ok()
}

/// (image, is sRGB) pairs that the materials use; an image used both ways becomes two textures.
#[derive(Default)]
struct Wanted {
    images: Vec<(usize, bool)>,
    index: HashMap<(usize, bool), usize>,
}

impl Wanted {
    fn get(&mut self, texture: &gltf::Texture, srgb: bool) -> TextureRef {
        let key = (texture.source().index(), srgb);
        let texture = *self.index.entry(key).or_insert_with(|| {
            self.images.push(key);
            self.images.len() - 1
        });
        TextureRef { texture }
    }
}

fn decode_images(
    path: &Path,
    document: &Document,
    buffers: &[Vec<u8>],
    wanted: &[(usize, bool)],
) -> Result<Vec<Texture>> {
    let mut encoded = Vec::new();
    let images: Vec<image::Image> = document.images().collect();
    for &(index, _) in wanted {
        encoded.push(match images[index].source() {
            image::Source::Uri { uri, .. } => fetch(path, uri)?,
            image::Source::View { view, .. } => view_bytes(&view, buffers)
                .ok_or_else(|| Error::file(path, format!("image {index} reaches beyond its buffer")))?
                .to_vec(),
        });
    }
    wanted
        .par_iter()
        .zip(encoded)
        .map(|(&(index, srgb), encoded)| {
            texture::decode(&encoded, srgb).map_err(|e| {
                let name = images[index].name().map(|n| format!(" ('{n}')")).unwrap_or_default();
                Error::file(path, format!("image {index}{name} is not a readable image: {e}"))
            })
        })
        .collect()
}

fn view_bytes<'a>(view: &buffer::View, buffers: &'a [Vec<u8>]) -> Option<&'a [u8]> {
    buffers.get(view.buffer().index())?.get(view.offset()..view.offset().checked_add(view.length())?)
}

fn convert(path: &Path, material: &gltf::Material, wanted: &mut Wanted) -> Material {
    let pbr = material.pbr_metallic_roughness();
    let [r, g, b, alpha] = pbr.base_color_factor();
    let name = material.name().map_or_else(|| format!("material {}", material.index().unwrap_or(0)), str::to_owned);
    if material.alpha_mode() == AlphaMode::Blend {
        tracing::warn!("{}: '{name}' is transparent; it will be drawn opaque", path.display());
    }
    let alpha_cutoff = match material.alpha_mode() {
        // The texture's alpha alone is compared later: the factor goes to the other side.
        AlphaMode::Mask => material.alpha_cutoff().unwrap_or(0.5) / alpha.max(1e-6),
        AlphaMode::Opaque | AlphaMode::Blend => 0.0,
    };
    Material {
        name,
        base_color: Vec3::new(r, g, b),
        base_color_texture: pbr.base_color_texture().map(|t| wanted.get(&t.texture(), true)),
        metallic: pbr.metallic_factor(),
        roughness: pbr.roughness_factor(),
        metallic_roughness_texture: pbr.metallic_roughness_texture().map(|t| wanted.get(&t.texture(), false)),
        normal_texture: material.normal_texture().map(|t| wanted.get(&t.texture(), false)),
        normal_scale: material.normal_texture().map_or(1.0, |t| t.scale()),
        emissive: Vec3::from(material.emissive_factor()) * material.emissive_strength().unwrap_or(1.0),
        emissive_texture: material.emissive_texture().map(|t| wanted.get(&t.texture(), true)),
        alpha_cutoff,
        ..Material::default()
    }
}

/// What is the same for all nodes.
struct Scene<'a> {
    path: &'a Path,
    buffers: &'a [Vec<u8>],
    /// Index of the material of primitives that have none.
    default_material: usize,
}

impl Scene<'_> {
    fn pieces(&self, document: &Document) -> Result<Vec<Piece>> {
        let scene = document.default_scene().or_else(|| document.scenes().next());
        let children: Vec<usize> = document.nodes().flat_map(|n| n.children().map(|c| c.index())).collect();
        let roots: Vec<gltf::Node> = match scene {
            Some(scene) => scene.nodes().collect(),
            None => document.nodes().filter(|n| !children.contains(&n.index())).collect(),
        };
        let mut pieces = Vec::new();
        let mut visited = vec![false; document.nodes().len()];
        let mut open: Vec<(gltf::Node, Affine3A)> = roots.into_iter().map(|n| (n, Affine3A::IDENTITY)).collect();
        open.reverse();
        while let Some((node, world_from_parent)) = open.pop() {
            if std::mem::replace(&mut visited[node.index()], true) {
                return Err(self.bad(format!("node {} occurs more than once in the scene", node.index())));
            }
            let local = Mat4::from_cols_array_2d(&node.transform().matrix());
            let world_from_node = world_from_parent * Affine3A::from_mat4(local);
            for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
                if let Some(mut piece) = self.piece(&primitive)? {
                    transform(&mut piece, world_from_node);
                    pieces.push(piece);
                }
            }
            let mut children: Vec<_> = node.children().map(|child| (child, world_from_node)).collect();
            children.reverse();
            open.append(&mut children);
        }
        Ok(pieces)
    }

    /// `None` for points and lines.
    fn piece(&self, primitive: &gltf::Primitive) -> Result<Option<Piece>> {
        if matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
            return Ok(None);
        }
        let (set, uv_transform) = texture_coordinates(&primitive.material());
        let checks: [(Semantic, Dimensions, &[DataType]); 4] = [
            (Semantic::Positions, Dimensions::Vec3, &[DataType::F32]),
            (Semantic::Normals, Dimensions::Vec3, &[DataType::F32]),
            (Semantic::Tangents, Dimensions::Vec4, &[DataType::F32]),
            (Semantic::TexCoords(set), Dimensions::Vec2, &[DataType::F32, DataType::U8, DataType::U16]),
        ];
        for (semantic, dimensions, types) in checks {
            if let Some(accessor) = primitive.get(&semantic) {
                self.check(&accessor, dimensions, types)?;
            }
        }
        if let Some(accessor) = primitive.indices() {
            self.check(&accessor, Dimensions::Scalar, &[DataType::U8, DataType::U16, DataType::U32])?;
        }
        let reader = primitive.reader(|buffer| self.buffers.get(buffer.index()).map(Vec::as_slice));
        let positions: Vec<Vec3> = reader
            .read_positions()
            .ok_or_else(|| self.bad("a mesh has no positions".into()))?
            .map(Vec3::from)
            .collect();
        let count = positions.len();
        let indices: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..count as u32).collect(),
        };
        let uv = |uv: [f32; 2]| uv_transform.transform_point2(Vec2::from(uv));
        let piece = Piece {
            positions,
            normals: reader.read_normals().map(|n| n.map(Vec3::from).collect()).unwrap_or_default(),
            tangents: reader.read_tangents().map(|t| t.map(Vec4::from).collect()).unwrap_or_default(),
            uvs: reader.read_tex_coords(set).map(|t| t.into_f32().map(uv).collect()).unwrap_or_default(),
            indices: triangles(primitive.mode(), indices),
            material: primitive.material().index().unwrap_or(self.default_material),
        };
        for length in [piece.normals.len(), piece.tangents.len(), piece.uvs.len()] {
            if length != 0 && length != count {
                return Err(self.bad(format!("a mesh has {count} positions but {length} of another attribute")));
            }
        }
        Ok(Some(piece))
    }

    /// Everything that the crate's accessor iterators take for granted.
    fn check(&self, accessor: &Accessor, dimensions: Dimensions, types: &[DataType]) -> Result<()> {
        let index = accessor.index();
        if accessor.dimensions() != dimensions || !types.contains(&accessor.data_type()) {
            let (is, kind) = (accessor.dimensions(), accessor.data_type());
            return Err(
                self.bad(format!("accessor {index} is {is:?} of {kind:?}, expected {dimensions:?} of {types:?}"))
            );
        }
        let fits = |view: Option<buffer::View>, offset: usize, count: usize, size: usize| {
            let Some(view) = view else { return Some(()) };
            let stride = view.stride().unwrap_or(size);
            let end = count.checked_sub(1)?.checked_mul(stride)?.checked_add(offset)?.checked_add(size)?;
            (stride >= size && end <= view_bytes(&view, self.buffers)?.len()).then_some(())
        };
        let beyond = || self.bad(format!("accessor {index} is empty or reaches beyond its buffer"));
        fits(accessor.view(), accessor.offset(), accessor.count(), accessor.size()).ok_or_else(beyond)?;
        let Some(sparse) = accessor.sparse() else {
            return accessor.view().map(|_| ()).ok_or_else(beyond);
        };
        let (indices, values) = (sparse.indices(), sparse.values());
        fits(Some(indices.view()), indices.offset(), sparse.count(), indices.index_type().size()).ok_or_else(beyond)?;
        fits(Some(values.view()), values.offset(), sparse.count(), accessor.size()).ok_or_else(beyond)?;
        // Zeros that no byte of the file stands for.
        if accessor.view().is_none() && accessor.count() > 1 << 24 {
            return Err(self.bad(format!("accessor {index} claims {} values without data", accessor.count())));
        }
        Ok(())
    }

    fn bad(&self, problem: String) -> Error {
        Error::file(self.path, problem)
    }
}

/// The texture coordinate set of a material and its KHR_texture_transform: those of its first texture, because
/// relume's vertices have one set.
fn texture_coordinates(material: &gltf::Material) -> (u32, Affine2) {
    let pbr = material.pbr_metallic_roughness();
    let mapped = [pbr.base_color_texture(), pbr.metallic_roughness_texture(), material.emissive_texture()];
    if let Some(info) = mapped.into_iter().flatten().next() {
        let transform = info.texture_transform();
        let set = transform.as_ref().and_then(TextureTransform::tex_coord).unwrap_or(info.tex_coord());
        let matrix = transform.map_or(Affine2::IDENTITY, |t| {
            // The extension's rotation is counter-clockwise in an image whose v points down.
            Affine2::from_scale_angle_translation(Vec2::from(t.scale()), -t.rotation(), Vec2::from(t.offset()))
        });
        return (set, matrix);
    }
    (material.normal_texture().map_or(0, |t| t.tex_coord()), Affine2::IDENTITY)
}

/// Triangle list of strips, fans and lists.
fn triangles(mode: Mode, indices: Vec<u32>) -> Vec<u32> {
    match mode {
        Mode::TriangleStrip => {
            let turned = |(i, t): (usize, &[u32])| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] };
            indices.windows(3).enumerate().flat_map(turned).collect()
        }
        Mode::TriangleFan => match indices.split_first() {
            Some((&first, rest)) => rest.windows(2).flat_map(|pair| [first, pair[0], pair[1]]).collect(),
            None => Vec::new(),
        },
        _ => indices,
    }
}

/// Brings a piece from its node's space to the object's. A node that mirrors turns triangles inside out: they are
/// turned back.
fn transform(piece: &mut Piece, world_from_node: Affine3A) {
    let normal_matrix = world_from_node.matrix3.inverse().transpose();
    let mirrored = world_from_node.matrix3.determinant() < 0.0;
    piece.positions.iter_mut().for_each(|p| *p = world_from_node.transform_point3(*p));
    piece.normals.iter_mut().for_each(|n| *n = normal_matrix * *n);
    for tangent in &mut piece.tangents {
        let side = if mirrored { -tangent.w } else { tangent.w };
        *tangent = world_from_node.transform_vector3(tangent.truncate()).extend(side);
    }
    if mirrored {
        piece.indices.chunks_exact_mut(3).for_each(|triangle| triangle.swap(1, 2));
    }
}
