//! How much diffuse light a point of a triangle reflects.

use glam::{Vec2, Vec3};

use crate::formats::color::decode_srgb;
use crate::scene::{Object, Texture, TextureRef};

/// Marks triangles that no primitive draws.
const NO_MATERIAL: u32 = u32::MAX;

/// Diffuse albedos over the surface of an object.
pub(super) struct Albedo<'a> {
    object: &'a Object,
    /// A material a triangle.
    materials: Vec<u32>,
    /// Linear values of 8-bit codes: as they are, and sRGB-encoded.
    linear: [[f32; 256]; 2],
}

impl<'a> Albedo<'a> {
    pub(super) fn new(object: &'a Object) -> Self {
        let mut materials = vec![NO_MATERIAL; object.indices.len() / 3];
        for primitive in &object.primitives {
            let range = primitive.indices.start as usize / 3..primitive.indices.end as usize / 3;
            if let Some(part) = materials.get_mut(range) {
                part.fill(primitive.material as u32);
            }
        }
        let code = |code: usize| code as f32 / 255.0;
        let linear = [std::array::from_fn(code), std::array::from_fn(|n| decode_srgb(code(n)))];
        Self { object, materials, linear }
    }

    /// Linear albedo of the diffuse part of the metallic-roughness material (glTF 2.0, B.2) at a place of triangle
    /// number `triangle`, given by the weights of its corners. 0 where no primitive draws the triangle.
    pub(super) fn at(&self, triangle: u32, weights: [f32; 3]) -> Vec3 {
        let first = 3 * triangle as usize;
        let Some(material) = self.object.materials.get(self.materials[triangle as usize] as usize) else {
            return Vec3::ZERO;
        };
        let corners = self.object.indices[first..first + 3].iter().zip(weights);
        let uv = corners.map(|(&index, weight)| self.object.vertices[index as usize].uv * weight).sum();
        let color = self.texel(material.base_color_texture, uv).map_or(Vec3::ONE, Vec3::from);
        let metallic = self.texel(material.metallic_roughness_texture, uv).map_or(1.0, |[_, _, blue]| blue);
        let albedo = material.base_color * color * (1.0 - material.metallic * metallic);
        // Factors beyond what a surface can do would make bounces grow.
        albedo.clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// The nearest texel, linear; textures repeat. `None` where there is no texture.
    fn texel(&self, texture: Option<TextureRef>, uv: Vec2) -> Option<[f32; 3]> {
        let Texture { width, height, srgb, rgba } = self.object.textures.get(texture?.texture)?;
        let place = |share: f32, size: u32| (((share - share.floor()) * size as f32) as usize).min(size as usize - 1);
        let texel = place(uv.y, *height) * *width as usize + place(uv.x, *width);
        let codes = rgba.get(4 * texel..4 * texel + 3)?;
        Some([0, 1, 2].map(|channel: usize| self.linear[usize::from(*srgb)][usize::from(codes[channel])]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Primitive, Vertex};

    /// One triangle over the lower left half of the texture square.
    fn triangle(material: Material, textures: Vec<Texture>) -> Object {
        let vertex = |u: f32, v: f32| Vertex {
            position: Vec3::new(u, v, 0.0),
            normal: Vec3::Z,
            uv: Vec2::new(u, v),
            ..Vertex::default()
        };
        Object {
            vertices: vec![vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(0.0, 1.0)],
            indices: vec![0, 1, 2],
            primitives: vec![Primitive { indices: 0..3, material: 0 }],
            materials: vec![material],
            textures,
        }
    }

    fn texture(srgb: bool, texels: [[u8; 4]; 2]) -> Texture {
        Texture { width: 2, height: 1, srgb, rgba: texels.concat() }
    }

    #[test]
    fn factors_and_texels_multiply_and_metal_reflects_no_diffuse_light() {
        let material = Material {
            base_color: Vec3::new(1.0, 0.5, 0.25),
            base_color_texture: Some(TextureRef { texture: 0 }),
            metallic: 0.5,
            metallic_roughness_texture: Some(TextureRef { texture: 1 }),
            ..Material::default()
        };
        let textures =
            vec![texture(true, [[255, 188, 0, 9], [0, 255, 255, 9]]), texture(false, [[7, 7, 0, 0], [7, 7, 255, 0]])];
        let object = triangle(material, textures);
        let albedo = Albedo::new(&object);
        // u = 0.2 is the left texel, u = 0.8 the right one, although both have the same corners
        let left = albedo.at(0, [0.7, 0.2, 0.1]);
        assert!(left.abs_diff_eq(Vec3::new(1.0, 0.5 * decode_srgb(188.0 / 255.0), 0.0), 1e-6), "{left}");
        let right = albedo.at(0, [0.1, 0.8, 0.1]);
        assert!(right.abs_diff_eq(Vec3::new(0.0, 0.25, 0.125), 1e-6), "{right}");
    }

    #[test]
    fn textures_repeat_and_broken_references_are_harmless() {
        let material = Material {
            base_color: Vec3::ONE,
            base_color_texture: Some(TextureRef { texture: 0 }),
            ..Material::default()
        };
        let mut object = triangle(material, vec![texture(false, [[255, 0, 0, 0], [0, 255, 0, 0]])]);
        for vertex in &mut object.vertices {
            vertex.uv.x -= 3.0;
        }
        assert_eq!(Albedo::new(&object).at(0, [0.1, 0.8, 0.1]), Vec3::Y);
        object.vertices[0].uv.x = f32::NAN;
        assert_eq!(Albedo::new(&object).at(0, [0.1, 0.8, 0.1]), Vec3::X);
        object.textures.clear();
        assert_eq!(Albedo::new(&object).at(0, [0.1, 0.8, 0.1]), Vec3::ONE);
        object.primitives.clear();
        assert_eq!(Albedo::new(&object).at(0, [0.1, 0.8, 0.1]), Vec3::ZERO);
    }
}
