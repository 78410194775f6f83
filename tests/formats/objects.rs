//! Objects in every format.

use std::fmt::Write as _;

use glam::{Vec2, Vec3};
use relume::formats::object::load;
use relume::scene::{Material, Object};
use serde_json::{Value, json};

use crate::{put, temp};

/// Standard base64, for data URIs.
pub(crate) fn base64(bytes: &[u8]) -> String {
    let alphabet = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for chunk in bytes.chunks(3) {
        let word = chunk.iter().fold(0u32, |w, &b| w << 8 | u32::from(b)) << (8 * (3 - chunk.len()));
        for i in 0..4 {
            let letter = if i <= chunk.len() { alphabet[(word >> (18 - 6 * i)) as usize & 63] } else { b'=' };
            text.push(char::from(letter));
        }
    }
    text
}

pub(crate) fn png(pixels: &[[u8; 4]], width: u32) -> Vec<u8> {
    let image = image::RgbaImage::from_raw(width, pixels.len() as u32 / width, pixels.concat()).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// A glTF in the making: what is pushed goes into one buffer, one view and accessor each.
#[derive(Default)]
pub(crate) struct Gltf {
    pub(crate) buffer: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Gltf {
    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        self.buffer.resize(self.buffer.len().next_multiple_of(4), 0);
        self.views.push(json!({"buffer": 0, "byteOffset": self.buffer.len(), "byteLength": bytes.len()}));
        self.buffer.extend(bytes);
        self.views.len() - 1
    }

    pub(crate) fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let view = self.view(bytemuck::cast_slice(values));
        let components = match kind {
            "VEC2" => 2,
            "VEC3" => 3,
            _ => 4,
        };
        let mut accessor =
            json!({"bufferView": view, "componentType": 5126, "count": values.len() / components, "type": kind});
        if kind == "VEC3" {
            accessor["min"] = json!([-9, -9, -9]);
            accessor["max"] = json!([9, 9, 9]);
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    pub(crate) fn indices(&mut self, values: &[u16]) -> usize {
        let view = self.view(bytemuck::cast_slice(values));
        self.accessors
            .push(json!({"bufferView": view, "componentType": 5123, "count": values.len(), "type": "SCALAR"}));
        self.accessors.len() - 1
    }

    /// JSON with the rest of the document's fields.
    pub(crate) fn document(&self, rest: &Value) -> Value {
        let mut document = json!({
            "asset": {"version": "2.0"},
            "buffers": [{"byteLength": self.buffer.len()}],
            "bufferViews": self.views,
            "accessors": self.accessors,
        });
        for (key, value) in rest.as_object().unwrap() {
            document[key] = value.clone();
        }
        document
    }

    pub(crate) fn text(&self, rest: &Value) -> String {
        let mut document = self.document(rest);
        document["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{}", base64(&self.buffer)));
        document.to_string()
    }

    fn binary(&self, rest: &Value) -> Vec<u8> {
        let mut text = self.document(rest).to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut buffer = self.buffer.clone();
        buffer.resize(buffer.len().next_multiple_of(4), 0);
        let mut glb = b"glTF".to_vec();
        glb.extend(2u32.to_le_bytes());
        glb.extend((12 + 8 + text.len() as u32 + 8 + buffer.len() as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", text), (b"BIN\0", buffer)] {
            glb.extend((chunk.len() as u32).to_le_bytes());
            glb.extend(kind);
            glb.extend(chunk);
        }
        glb
    }
}

/// A unit square in z = 0 facing +z, u to the right, v downwards.
pub(crate) fn square(gltf: &mut Gltf) -> Value {
    let positions = gltf.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    let uvs = gltf.floats("VEC2", &[0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
    let indices = gltf.indices(&[0, 1, 2, 0, 2, 3]);
    json!({"attributes": {"POSITION": positions, "TEXCOORD_0": uvs}, "indices": indices, "material": 0})
}

#[track_caller]
fn assert_valid(object: &Object) {
    assert!(!object.indices.is_empty() && object.indices.iter().all(|&i| (i as usize) < object.vertices.len()));
    let mut end = 0;
    for primitive in &object.primitives {
        assert_eq!((primitive.indices.start, primitive.indices.len() % 3), (end, 0));
        end = primitive.indices.end;
        let mapped = object.materials[primitive.material].normal_texture.is_some();
        for &index in &object.indices[primitive.indices.start as usize..end as usize] {
            let v = object.vertices[index as usize];
            let tangent = Vec3::from_slice(&v.tangent);
            assert!((v.normal.length() - 1.0).abs() < 1e-5 && v.position.is_finite() && v.uv.is_finite());
            if mapped {
                assert!((tangent.length() - 1.0).abs() < 1e-5 && v.tangent[3].abs() == 1.0);
                assert!(tangent.dot(v.normal).abs() < 1e-5);
            } else {
                assert_eq!(v.tangent, [0.0; 4]);
            }
        }
    }
    assert_eq!(end as usize, object.indices.len());
}

#[test]
fn gltf_with_textures_transforms_and_a_mirror() {
    let dir = temp();
    let mut gltf = Gltf::default();
    let primitive = square(&mut gltf);
    let image = gltf.view(&png(&[[255, 0, 0, 255], [0, 255, 0, 128]], 2));
    let rest = json!({
        "images": [{"bufferView": image, "mimeType": "image/png"}],
        "textures": [{"source": 0}],
        "materials": [{
            "name": "painted",
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.5, 0.25, 1.0, 0.8], "metallicFactor": 0.25, "roughnessFactor": 0.75,
                "baseColorTexture": {"index": 0, "extensions":
                    {"KHR_texture_transform": {"offset": [0.5, 0.0], "scale": [2.0, 1.0]}}},
                "metallicRoughnessTexture": {"index": 0},
            },
            "normalTexture": {"index": 0, "scale": 0.5},
            "emissiveFactor": [1.0, 0.5, 0.0],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 8.0}},
            "alphaMode": "MASK", "alphaCutoff": 0.4,
        }],
        "extensionsUsed": ["KHR_materials_emissive_strength", "KHR_texture_transform"],
        "meshes": [{"primitives": [primitive]}],
        "nodes": [
            {"children": [1, 2], "translation": [10.0, 0.0, 0.0]},
            {"mesh": 0, "scale": [2.0, 2.0, 2.0]},
            {"mesh": 0, "scale": [-1.0, 1.0, 1.0]},
        ],
        "scenes": [{"nodes": []}, {"nodes": [0]}],
        "scene": 1,
    });
    let text = load(&put(&dir, "a.gltf", gltf.text(&rest))).unwrap();
    let binary = load(&put(&dir, "a.glb", gltf.binary(&rest))).unwrap();
    assert_eq!(text, binary);
    // And with the buffer in a file of its own whose name needs an escape.
    put(&dir, "the data.bin", &gltf.buffer);
    let mut document = gltf.document(&rest);
    document["buffers"][0]["uri"] = json!("the%20data.bin");
    assert_eq!(load(&put(&dir, "b.gltf", document.to_string())).unwrap(), text);

    assert_valid(&text);
    assert_eq!((text.vertices.len(), text.indices.len(), text.primitives.len()), (8, 12, 2));
    assert_eq!(text.vertices[2].position, Vec3::new(12.0, 2.0, 0.0));
    assert_eq!(text.vertices[6].position, Vec3::new(9.0, 1.0, 0.0));
    assert_eq!(text.vertices[1].uv, Vec2::new(2.5, 1.0));
    // Both squares still face +z, and so do their triangles; u runs to the left on the mirrored one.
    for triangle in text.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|i| text.vertices[triangle[i] as usize]);
        assert!((b.position - a.position).cross(c.position - a.position).z > 0.0);
        assert_eq!(a.normal, Vec3::Z);
    }
    assert_eq!(text.vertices[0].tangent, [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(text.vertices[4].tangent, [-1.0, 0.0, 0.0, -1.0]);
    let material = &text.materials[0];
    assert_eq!((material.name.as_str(), material.base_color), ("painted", Vec3::new(0.5, 0.25, 1.0)));
    assert_eq!((material.metallic, material.roughness, material.normal_scale), (0.25, 0.75, 0.5));
    assert_eq!(material.emissive, Vec3::new(8.0, 4.0, 0.0));
    assert!((material.alpha_cutoff - 0.5).abs() < 1e-6);
    // One image, used as colour and as data.
    assert_eq!(text.textures.iter().map(|t| t.srgb).collect::<Vec<_>>(), [true, false]);
    assert_eq!(text.textures[0].rgba, [255, 0, 0, 255, 0, 255, 0, 128]);
    assert_eq!(material.metallic_roughness_texture, material.normal_texture);
}

#[test]
fn gltf_strips_fans_and_what_is_no_surface() {
    let dir = temp();
    let mut gltf = Gltf::default();
    let positions = gltf.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0]);
    let fan = gltf.indices(&[0, 1, 3, 2]);
    let attributes = json!({"POSITION": positions});
    let primitives = json!([
        {"attributes": attributes, "mode": 5},
        {"attributes": attributes, "mode": 6, "indices": fan},
        {"attributes": attributes, "mode": 1},
        {"attributes": attributes, "mode": 0},
    ]);
    // No scene at all: every node counts.
    let rest = json!({"meshes": [{"primitives": primitives}], "nodes": [{"mesh": 0}]});
    let object = load(&put(&dir, "a.gltf", gltf.text(&rest))).unwrap();
    assert_valid(&object);
    assert_eq!((object.primitives.len(), object.indices.len()), (2, 12));
    assert!(object.vertices.iter().all(|v| v.normal == Vec3::Z));
    assert_eq!((object.materials[0].base_color, object.materials[0].metallic), (Vec3::ONE, 1.0));
}

#[test]
fn obj_with_materials() {
    let dir = temp();
    put(&dir, "stone.png", png(&[[9, 8, 7, 255]], 1));
    put(
        &dir,
        "lib.mtl",
        "newmtl shiny\nKd 0.1 0.2 0.3\nNs 98\nKe 1 2 3\nnewmtl pbr\nKd 1 1 1\nmap_Kd -s 1 1 1 .\\stone.png\nPm 0.5\nPr 0.25\nnorm stone.png\n",
    );
    let faces = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 2 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 0.5 1\n\
        o quad\nusemtl shiny\nf 1/1 2/2 3/3 4/4\no penta\nusemtl pbr\nf 1/1 2/2 3/3 5/5 4/4\n";
    let object = load(&put(&dir, "a.obj", format!("mtllib lib.mtl\n{faces}"))).unwrap();
    assert_valid(&object);
    assert_eq!(object.indices.len(), 3 * (2 + 3));
    let used: Vec<&Material> = object.primitives.iter().map(|p| &object.materials[p.material]).collect();
    assert_eq!((used[0].name.as_str(), used[0].base_color), ("shiny", Vec3::new(0.1, 0.2, 0.3)));
    assert!((used[0].roughness - 0.02f32.powf(0.25)).abs() < 1e-6);
    assert_eq!(used[0].emissive, Vec3::new(1.0, 2.0, 3.0));
    assert_eq!((used[1].metallic, used[1].roughness), (0.5, 0.25));
    assert_eq!(object.textures.len(), 2);
    // v = 0 is the bottom row in OBJ and the top row here.
    let corner = object.vertices.iter().find(|v| v.position == Vec3::ZERO).unwrap();
    assert_eq!(corner.uv, Vec2::new(0.0, 1.0));
    assert!(object.vertices.iter().all(|v| v.normal == Vec3::Z));
    let plain = load(&put(&dir, "b.obj", format!("mtllib gone.mtl\n{faces}"))).unwrap();
    assert_eq!(plain.materials, [Material::default()]);
}

/// A mesh PLY in ASCII.
pub(crate) fn ply_mesh(vertices: &[[f32; 3]], faces: &[&[i32]]) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
        element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        vertices.len(),
        faces.len()
    );
    for [x, y, z] in vertices {
        writeln!(text, "{x} {y} {z}").unwrap();
    }
    for face in faces {
        let corners: Vec<String> = face.iter().map(i32::to_string).collect();
        writeln!(text, "{} {}", face.len(), corners.join(" ")).unwrap();
    }
    text
}

pub(crate) const CUBE: [[f32; 3]; 8] = [
    [-1.0, -1.0, -1.0],
    [1.0, -1.0, -1.0],
    [1.0, 1.0, -1.0],
    [-1.0, 1.0, -1.0],
    [-1.0, -1.0, 1.0],
    [1.0, -1.0, 1.0],
    [1.0, 1.0, 1.0],
    [-1.0, 1.0, 1.0],
];

#[test]
fn ply_meshes() {
    let dir = temp();
    let faces: [&[i32]; 8] = [
        &[0, 3, 2, 1],
        &[4, 5, 6, 7],
        &[0, 1, 5, 4],
        &[2, 3, 7, 6],
        &[1, 2, 6, 5],
        &[0, 4, 7, 3],
        // Dropped: two corners, and a corner twice.
        &[0, 1],
        &[0, 1, 1],
    ];
    let object = load(&put(&dir, "cube.ply", ply_mesh(&CUBE, &faces))).unwrap();
    assert_valid(&object);
    assert_eq!((object.vertices.len(), object.indices.len()), (8, 36));
    // Weighted by angle, a cube's corners look exactly outwards however its faces are cut.
    assert!(object.vertices.iter().all(|v| v.normal.dot(v.position.normalize()) > 0.9999));
    assert_eq!(object.materials, [Material::default()]);
    let (lo, hi) = object.bounds();
    assert_eq!((lo, hi), (Vec3::splat(-1.0), Vec3::ONE));
    // Two sides of a leaf keep their own normals, and a seam has one.
    let [a, b, c, d] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 1.0]];
    let leaf = load(&put(&dir, "leaf.ply", ply_mesh(&[a, b, c, a, b, c], &[&[0, 1, 2], &[3, 5, 4]]))).unwrap();
    assert_eq!(leaf.vertices.iter().map(|v| v.normal.z).collect::<Vec<_>>(), [1.0, 1.0, 1.0, -1.0, -1.0, -1.0]);
    let seam = load(&put(&dir, "seam.ply", ply_mesh(&[a, b, c, b, d, c], &[&[0, 1, 2], &[3, 4, 5]]))).unwrap();
    assert_eq!((seam.vertices[1].normal, seam.vertices[2].normal), (seam.vertices[3].normal, seam.vertices[5].normal));
    // Big-endian, u16 counts, unsigned indices by their other name, normals from the file.
    let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty double z\nproperty float x\n\
        property float y\nproperty float nx\nproperty float ny\nproperty float nz\n\
        element face 1\nproperty uchar flags\nproperty list ushort uint vertex_index\nend_header\n"
        .to_vec();
    for (x, y) in [(0f32, 0f32), (1.0, 0.0), (0.0, 1.0)] {
        bytes.extend(5f64.to_be_bytes());
        [x, y, 0.0, 3.0, 4.0].iter().for_each(|v| bytes.extend(v.to_be_bytes()));
    }
    bytes.push(7);
    bytes.extend(3u16.to_be_bytes());
    [0u32, 1, 2].iter().for_each(|v| bytes.extend(v.to_be_bytes()));
    let object = load(&put(&dir, "one.ply", bytes)).unwrap();
    assert_eq!(object.vertices[1].position, Vec3::new(1.0, 0.0, 5.0));
    assert_eq!((object.indices.as_slice(), object.vertices[1].normal), (&[0, 1, 2][..], Vec3::new(0.0, 0.6, 0.8)));
}
