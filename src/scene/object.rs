//! An object to be lit: triangles with metallic-roughness materials.

use std::ops::Range;

use glam::{Affine3A, Vec2, Vec3};
use rayon::prelude::*;

/// One vertex, in the object's own space once the file's node transforms have been applied.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Vertex {
    /// Position, metres.
    pub position: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// Unit tangent in xyz and the bitangent's sign in w, as in glTF; zero where there is no normal map.
    pub tangent: [f32; 4],
    /// Texture coordinates, (0, 0) at the upper left of the image, as in glTF.
    pub uv: Vec2,
}

/// A reference to one of the object's textures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TextureRef {
    /// Index into [`Object::textures`].
    pub texture: usize,
}

/// Metallic-roughness material, as in glTF 2.0; factors multiply textures.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file, for messages.
    pub name: String,
    /// Linear base colour factor.
    pub base_color: Vec3,
    /// sRGB texture that multiplies `base_color`.
    pub base_color_texture: Option<TextureRef>,
    /// Metallic factor, 0 to 1.
    pub metallic: f32,
    /// Perceptual roughness factor, 0 to 1; GGX alpha is its square.
    pub roughness: f32,
    /// Linear texture: roughness in green, metallic in blue.
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Linear tangent-space normal map.
    pub normal_texture: Option<TextureRef>,
    /// Scale of the normal map's x and y.
    pub normal_scale: f32,
    /// Emitted linear radiance factor (strength included).
    pub emissive: Vec3,
    /// sRGB texture that multiplies `emissive`.
    pub emissive_texture: Option<TextureRef>,
    /// Disney's specular parameter: 0.5 is a normal-incidence reflectance of 0.04.
    pub specular: f32,
    /// Fragments whose base colour alpha is below this are not drawn; 0 draws all.
    pub alpha_cutoff: f32,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".into(),
            base_color: Vec3::splat(0.7),
            base_color_texture: None,
            metallic: 0.0,
            roughness: 0.5,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            specular: 0.5,
            alpha_cutoff: 0.0,
        }
    }
}

/// An 8-bit RGBA image, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// True where the values are sRGB-encoded (base colour, emissive).
    pub srgb: bool,
    /// `4 * width * height` bytes.
    pub rgba: Vec<u8>,
}

/// A range of triangles with one material.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Primitive {
    /// Range in [`Object::indices`]; its length is a multiple of three.
    pub indices: Range<u32>,
    /// Index into [`Object::materials`].
    pub material: usize,
}

/// An object: one vertex and index list, cut into primitives. Always has at least one triangle, all indices valid,
/// all values finite.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Object {
    /// All vertices.
    pub vertices: Vec<Vertex>,
    /// Triangle list, counter-clockwise seen from outside.
    pub indices: Vec<u32>,
    /// Ranges by material.
    pub primitives: Vec<Primitive>,
    /// Materials; at least one.
    pub materials: Vec<Material>,
    /// Textures that the materials refer to.
    pub textures: Vec<Texture>,
}

impl Object {
    /// The same object with positions, normals and tangents transformed.
    pub fn transformed(mut self, world_from_object: Affine3A) -> Self {
        self.vertices = self.transformed_vertices(world_from_object);
        if world_from_object.matrix3.determinant() < 0.0 {
            for triangle in self.indices.chunks_exact_mut(3) {
                triangle.swap(1, 2);
            }
        }
        self
    }

    /// The vertices with positions, normals and tangents transformed. A mirroring transform also turns triangles inside
    /// out, which [`Object::transformed`] puts right.
    pub fn transformed_vertices(&self, world_from_object: Affine3A) -> Vec<Vertex> {
        let normal_matrix = world_from_object.matrix3.inverse().transpose();
        let mirrored = world_from_object.matrix3.determinant() < 0.0;
        let transform = |vertex: &Vertex| {
            let [x, y, z, sign] = vertex.tangent;
            let tangent = world_from_object.transform_vector3(Vec3::new(x, y, z)).normalize_or_zero();
            Vertex {
                position: world_from_object.transform_point3(vertex.position),
                normal: (normal_matrix * vertex.normal).normalize_or_zero(),
                tangent: [tangent.x, tangent.y, tangent.z, if mirrored { -sign } else { sign }],
                uv: vertex.uv,
            }
        };
        self.vertices.par_iter().map(transform).collect()
    }

    /// Axis-aligned bounds of all vertices: (minimum, maximum).
    pub fn bounds(&self) -> (Vec3, Vec3) {
        self.vertices
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), v| (lo.min(v.position), hi.max(v.position)))
    }
}
