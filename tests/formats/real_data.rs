//! Real scans, objects and panoramas, which are not part of the project. RELUME_SHARED names the folder that has them.

use glam::{DVec3, Vec3};
use relume::formats::cloud::{CloudOptions, Up, load};
use relume::formats::{image, object, ply};
use relume::preprocess::normals;

use crate::common::shared;

#[test]
fn clouds() {
    let Some(folder) = shared("clouds") else { return };
    let clouds = folder.join("data/clouds");
    for (name, count, up, towards_origin) in [
        ("region_growing_rgb_tutorial.pcd", 259_847, Up::Y, true),
        ("milk_cartoon_all_small_clorox.pcd", 241_407, Up::Y, true),
        ("autzen_trim.laz", 110_000, Up::Z, false),
    ] {
        let cloud = load(&clouds.join(name), &CloudOptions { up, orient_towards: None }).unwrap();
        assert_eq!(cloud.len(), count);
        assert_eq!((cloud.normals.len(), cloud.spacing.len(), cloud.colors.len()), (count, count, count));
        assert!(cloud.positions.iter().chain(&cloud.normals).chain(&cloud.colors).all(|v| v.is_finite()));
        assert!(cloud.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
        assert!(cloud.spacing.iter().all(|s| s.is_finite() && *s > 0.0));
        assert!(
            cloud.colors.iter().any(|c| c.max_element() > 0.5) && cloud.colors.iter().all(|c| c.max_element() <= 1.0)
        );
        assert_eq!(cloud.viewpoint, towards_origin.then_some(Vec3::ZERO));
        if towards_origin {
            assert!(cloud.normals.iter().zip(&cloud.positions).all(|(n, p)| n.dot(-*p) >= -1e-4));
        } else {
            assert!(cloud.origin != DVec3::ZERO && cloud.origin.y < 1000.0);
        }
    }
}

#[test]
fn toyroom_area_and_normals() {
    let Some(folder) = shared("toyroom_area_and_normals") else { return };
    let folder = folder.join("reference/toyroom");
    let hdr = load(&folder.join("cloud_hdr.ply"), &CloudOptions::default()).unwrap();
    let ldr = load(&folder.join("cloud_ldr.ply"), &CloudOptions::default()).unwrap();
    assert_eq!((hdr.len(), ldr.len()), (299_986, 299_986));
    assert_eq!(hdr.spacing, ldr.spacing);
    let area: f64 = hdr.spacing.iter().map(|&s| f64::from(s).powi(2)).sum();
    assert!((area / 95.82 - 1.0).abs() < 0.03, "{area}");
    // The same scene at exposure 2, clamped and rounded to 8 bits of sRGB.
    for (bright, coded) in hdr.colors.iter().zip(&ldr.colors) {
        let expected = (2.0 * *bright).min(Vec3::ONE);
        assert!((expected - coded).abs().max_element() < 0.006, "{expected} {coded}");
    }
    // Fitted normals against the file's, up to their side: the room is flat but for its edges.
    let fitted = normals::estimate(&hdr.positions, 16, Vec3::Y).unwrap();
    let close = fitted.iter().zip(&hdr.normals).filter(|(a, b)| a.dot(**b).abs() > 0.999).count();
    assert!(close > 280_000, "{close}");
    let written = tempfile::TempDir::new().unwrap();
    let path = written.path().join("room.ply");
    ply::write_cloud(&path, &hdr).unwrap();
    assert_eq!(ply::read_cloud(&path).unwrap().positions, hdr.positions);
}

#[test]
fn objects() {
    let Some(folder) = shared("objects") else { return };
    let helmet = object::load(&folder.join("data/objects/FlightHelmet/FlightHelmet.gltf")).unwrap();
    assert_eq!((helmet.indices.len() / 3, helmet.materials.len(), helmet.textures.len()), (94_722, 6, 15));
    assert!(helmet.vertices.iter().all(|v| (Vec3::from_slice(&v.tangent).length() - 1.0).abs() < 1e-4));
    let dragon = object::load(&folder.join("data/objects/dragon_100k.ply")).unwrap();
    assert_eq!((dragon.vertices.len(), dragon.indices.len() / 3), (50_000, 100_000));
    let sphere = object::load(&folder.join("reference/sphere/sphere.ply")).unwrap();
    let centre = Vec3::new(0.0, 1.0, 0.0);
    assert!(sphere.vertices.iter().all(|v| v.normal.dot((v.position - centre).normalize()) > 0.999));
}

#[test]
fn panoramas() {
    let Some(folder) = shared("panoramas") else { return };
    let mut count = 0;
    for entry in std::fs::read_dir(folder.join("data/hdr")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "exr" || e == "hdr") {
            let far = image::read_far_field(&path).unwrap();
            assert_eq!(far.radiance.len(), (far.width * far.height) as usize);
            assert!(far.radiance.iter().all(|r| r.is_finite() && r.min_element() >= 0.0));
            assert!(far.radiance.iter().any(|r| r.max_element() > 1.0));
            count += 1;
        }
    }
    assert_eq!(count, 12);
    let room = image::read_far_field(&folder.join("reference/toyroom/panorama.exr")).unwrap();
    assert_eq!((room.width, room.height), (1024, 512));
}
