//! Bad objects and images: every message is one line that names the file and says what is wrong.

use relume::formats::image::{ExrLayers, read_far_field, read_rgba_exr, write_exr};
use relume::formats::object::load;
use serde_json::{Value, json};

use crate::objects::{CUBE, Gltf, base64, ply_mesh, png, square};
use crate::{assert_says, problem, put, temp};

#[track_caller]
fn refused(name: &str, bytes: impl AsRef<[u8]>) -> String {
    let dir = temp();
    let path = put(&dir, name, bytes);
    problem(load(&path), &path)
}

#[test]
fn unknown_extensions_and_missing_files() {
    for name in ["a.fbx", "a", "a.usdz"] {
        assert_says(&refused(name, "x"), &["expected .gltf, .glb, .obj or .ply"]);
    }
    let dir = temp();
    for name in ["none.gltf", "none.glb", "none.obj", "none.ply"] {
        let path = dir.path().join(name);
        assert_says(&problem(load(&path), &path), &["cannot be read"]);
    }
}

#[test]
fn ply_meshes() {
    let only_vertices = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n";
    assert_says(&refused("a.ply", only_vertices), &["no element 'face' (it has: vertex)"]);
    assert_says(&refused("a.ply", ply_mesh(&CUBE, &[&[0, 1, 8]])), &["vertex index 8", "only 8 vertices"]);
    assert_says(&refused("a.ply", ply_mesh(&CUBE, &[&[0, 1, -1]])), &["vertex index 4294967295"]);
    assert_says(&refused("a.ply", ply_mesh(&CUBE, &[])), &["no triangle with an area"]);
    assert_says(&refused("a.ply", ply_mesh(&CUBE, &[&[0, 1], &[2, 2, 2]])), &["no triangle with an area"]);
    let mut nan = CUBE;
    nan[3][1] = f32::NAN;
    assert_says(&refused("a.ply", ply_mesh(&nan, &[&[0, 1, 2]])), &["not finite, at vertex 3"]);
    let no_list = ply_mesh(&CUBE, &[]).replace("list uchar int vertex_indices", "int a").replace("face 0", "face 1");
    assert_says(&refused("a.ply", no_list + "1\n"), &["not a mesh", "vertex_indices"]);
    let no_positions = ply_mesh(&CUBE, &[&[0, 1, 2]]).replace("float x", "float a");
    assert_says(&refused("a.ply", no_positions), &["not a mesh", "no x, y, z"]);
    let cut = ply_mesh(&CUBE, &[&[0, 1, 2]]).replace("face 1", "face 2");
    assert_says(&refused("a.ply", cut), &["cut short", "promises 2 of element 'face', it holds 1"]);
}

#[test]
fn obj_files() {
    assert_says(&refused("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"), &["not a readable OBJ"]);
    assert_says(&refused("a.obj", "v 0 zero 0\n"), &["not a readable OBJ"]);
    assert_says(&refused("a.obj", ""), &["no triangle with an area"]);
    assert_says(&refused("a.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), &["not finite"]);
    let dir = temp();
    put(&dir, "a.mtl", "newmtl a\nmap_Kd gone.png\n");
    put(&dir, "b.mtl", "newmtl b\nmap_Kd bad.png\n");
    put(&dir, "bad.png", "no image");
    for (name, parts) in [("a", ["'gone.png'", "cannot be read"]), ("b", ["'bad.png'", "not a readable image"])] {
        let text = format!("mtllib {name}.mtl\nusemtl {name}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
        let path = put(&dir, "a.obj", text);
        assert_says(&problem(load(&path), &path), &parts);
    }
}

/// The square as a glTF document, changed by `change`.
#[track_caller]
fn refused_gltf(change: impl FnOnce(&mut Value)) -> String {
    let mut gltf = Gltf::default();
    let primitive = square(&mut gltf);
    let image = gltf.view(&png(&[[1, 2, 3, 255]], 1));
    let mut document = gltf.document(&json!({
        "images": [{"bufferView": image, "mimeType": "image/png"}],
        "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "meshes": [{"primitives": [primitive]}],
        "nodes": [{"mesh": 0}, {}],
        "scenes": [{"nodes": [0]}],
    }));
    let uri = format!("data:application/octet-stream;base64,{}", base64(&gltf.buffer));
    document["buffers"][0]["uri"] = json!(uri);
    let dir = temp();
    let path = put(&dir, "good.gltf", document.to_string());
    load(&path).unwrap();
    change(&mut document);
    refused("bad.gltf", document.to_string())
}

#[test]
fn gltf_files() {
    for bytes in ["", "{", "{}", "glTF"] {
        assert_says(&refused("a.gltf", bytes), &["not a readable glTF file"]);
        assert_says(&refused("a.glb", bytes), &["not a readable glTF file"]);
    }
    assert_says(&refused_gltf(|d| d["buffers"][0]["uri"] = json!("gone.bin")), &["'gone.bin'", "cannot be read"]);
    assert_says(&refused_gltf(|d| d["buffers"][0]["uri"] = json!("%ff.bin")), &["'%ff.bin'", "no valid name"]);
    assert_says(&refused_gltf(|d| d["buffers"][0]["uri"] = json!("http://a/b.bin")), &["cannot be read"]);
    assert_says(&refused_gltf(|d| d["buffers"][0]["byteLength"] = json!(99_999)), &["buffer 0", "99999"]);
    assert_says(&refused_gltf(|d| _ = d["buffers"][0].as_object_mut().unwrap().remove("uri")), &["no binary chunk"]);
    assert_says(&refused_gltf(|d| d["extensionsRequired"] = json!(["KHR_draco_mesh_compression"])), &["glTF"]);
    assert_says(&refused_gltf(|d| d["bufferViews"][3]["byteLength"] = json!(999_999)), &["image 0", "beyond"]);
    assert_says(&refused_gltf(|d| d["bufferViews"][3]["byteLength"] = json!(20)), &["image 0", "not a readable image"]);
    for source in [json!({}), json!({"mimeType": "image/png"}), json!({"bufferView": 3})] {
        assert_says(&refused_gltf(|d| d["images"] = json!([source])), &["image 0 without uri"]);
    }
    assert_says(&refused_gltf(|d| d["images"] = json!([{"uri": "gone.png"}])), &["'gone.png'", "cannot be read"]);
}

#[test]
fn gltf_accessors_and_nodes() {
    for count in [5, 1_000_000, usize::MAX >> 1] {
        assert_says(&refused_gltf(|d| d["accessors"][0]["count"] = json!(count)), &["accessor 0", "beyond its buffer"]);
    }
    assert_says(&refused_gltf(|d| d["accessors"][0]["count"] = json!(0)), &["accessor 0", "empty"]);
    assert_says(&refused_gltf(|d| d["accessors"][0]["type"] = json!("VEC2")), &["accessor 0", "expected Vec3"]);
    assert_says(
        &refused_gltf(|d| d["accessors"][2]["componentType"] = json!(5126)),
        &["accessor 2", "expected Scalar"],
    );
    assert_says(&refused_gltf(|d| d["bufferViews"][0]["byteStride"] = json!(4)), &["accessor 0", "beyond"]);
    assert_says(&refused_gltf(|d| d["accessors"][0]["count"] = json!(3)), &["3 positions but 4"]);
    assert_says(
        &refused_gltf(|d| {
            d["accessors"][0]["count"] = json!(3);
            d["accessors"][1]["count"] = json!(3);
        }),
        &["vertex index 3", "only 3 vertices"],
    );
    assert_says(
        &refused_gltf(|d| {
            let primitive = &mut d["meshes"][0]["primitives"][0];
            primitive["mode"] = json!(1);
        }),
        &["no triangle with an area"],
    );
    assert_says(&refused_gltf(|d| d["accessors"] = json!([])), &["accessor", "only 0 accessors"]);
    assert_says(&refused_gltf(|d| d["nodes"][0]["scale"] = json!([0, 0, 0])), &["no triangle with an area"]);
    assert_says(&refused_gltf(|d| d["nodes"][0]["children"] = json!([0])), &["node 0 occurs more than once"]);
    assert_says(&refused_gltf(|d| d["scenes"][0]["nodes"] = json!([])), &["no triangle with an area"]);
    assert_says(&refused_gltf(|d| d["meshes"][0]["primitives"][0]["attributes"] = json!({})), &["glTF"]);
}

#[test]
fn panoramas() {
    let dir = temp();
    let refused = |name: &str, bytes: &[u8]| {
        let path = put(&dir, name, bytes);
        problem(read_far_field(&path), &path)
    };
    assert_says(&refused("a.jpg", b"x"), &["expected .exr or .hdr"]);
    assert_says(&refused("a.exr", b"x"), &["not a readable EXR file"]);
    assert_says(&refused("a.hdr", b"x"), &["not a readable Radiance HDR file"]);
    let header = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n";
    assert_says(&refused("a.hdr", format!("{header}-Y 4 +X 8\n\u{2}").as_bytes()), &["not a readable Radiance"]);
    assert_says(
        &refused("a.hdr", format!("{header}-Y 99999 +X 99999\n1").as_bytes()),
        &["promises 99999x99999 pixels"],
    );
    let rgb = vec![glam::Vec3::ONE; 32];
    let path = dir.path().join("whole.exr");
    write_exr(&path, &ExrLayers { width: 8, height: 4, rgb: &rgb, alpha: None, groups: &[] }).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for cut in [10, 100, whole.len() / 2, whole.len() - 3] {
        assert_says(&refused("a.exr", &whole[..cut]), &["not a readable EXR file"]);
    }
    use exr::prelude::*;
    let channels = SpecificChannels::build().with_channel("Z").with_pixel_fn(|_| (1f32,));
    Image::from_channels((4, 2), channels).write().to_file(&path).unwrap();
    assert_says(&problem(read_rgba_exr(&path), &path), &["no colours", "R, G, B", "Z"]);
    // A display window that no data backs.
    let channels = SpecificChannels::rgb(|_: Vec2<usize>| (1f32, 2f32, 3f32));
    let layer = Layer::new((4, 3), LayerAttributes::default(), Encoding::FAST_LOSSLESS, channels);
    let window = IntegerBounds::new((0, 0), (1 << 29, 1 << 29));
    Image::new(ImageAttributes::new(window), layer).write().to_file(&path).unwrap();
    assert_says(&problem(read_rgba_exr(&path), &path), &["536870912x536870912"]);
}
