//! Images in and out.

use exr::prelude::*;
use glam::Vec3;
use image::codecs::hdr::HdrEncoder;
use relume::Error;
use relume::formats::image::{ExrGroup, ExrLayers, read_far_field, read_rgba_exr, write_exr, write_png};

use crate::{put, temp};

fn ramp(count: usize) -> Vec<Vec3> {
    (0..count).map(|i| Vec3::new(i as f32, 0.1, 1e-5 * i as f32)).collect()
}

#[test]
fn exr_round_trip_with_named_channels() {
    let dir = temp();
    let path = dir.path().join("frame.exr");
    let (rgb, depth) = (ramp(35), (0..35).map(|i| i as f32 * 1e4 + 0.001).collect::<Vec<f32>>());
    let groups = [
        ("albedo", ExrGroup::Color(&rgb)),
        ("N", ExrGroup::Vector(&rgb)),
        ("Z", ExrGroup::Scalar(&depth)),
        ("P", ExrGroup::Vector(&rgb)),
    ];
    let layers = ExrLayers { width: 7, height: 5, rgb: &rgb, alpha: Some(&depth), groups: &groups };
    write_exr(&path, &layers).unwrap();
    let image = read_rgba_exr(&path).unwrap();
    assert_eq!((image.width, image.height), (7, 5));
    assert_eq!((&image.rgb, &image.alpha), (&rgb, &depth));
    let raw = read_all_flat_layers_from_file(&path).unwrap();
    assert_eq!(raw.layer_data.len(), 1);
    let names: Vec<String> = raw.layer_data[0].channel_data.list.iter().map(|c| c.name.to_string()).collect();
    let expected = "A B G N.X N.Y N.Z P.X P.Y P.Z R Z albedo.B albedo.G albedo.R";
    assert_eq!(names.join(" "), expected);
    write_exr(&path, &ExrLayers { alpha: None, groups: &[], ..layers }).unwrap();
    assert_eq!(read_rgba_exr(&path).unwrap().alpha, vec![1.0; 35]);
}

#[test]
fn exr_of_half_floats_and_named_layers() {
    let dir = temp();
    let path = dir.path().join("half.exr");
    write_rgba_file(&path, 4, 2, |x, y| {
        (f16::from_f32(x as f32), f16::from_f32(y as f32), f16::from_f32(0.5), f16::from_f32(0.25))
    })
    .unwrap();
    let image = read_rgba_exr(&path).unwrap();
    assert_eq!(image.rgb[6], Vec3::new(2.0, 1.0, 0.5));
    assert_eq!(image.alpha[6], 0.25);
    // R, G, B exist only inside a layer, as in Blender's multi-layer files.
    let channels = SpecificChannels::build()
        .with_channel("ViewLayer.Combined.R")
        .with_channel("ViewLayer.Combined.G")
        .with_channel("ViewLayer.Combined.B")
        .with_pixel_fn(|at| (at.0 as f32, at.1 as f32, 3f32));
    Image::from_channels((4, 2), channels).write().to_file(&path).unwrap();
    assert_eq!(read_rgba_exr(&path).unwrap().rgb[6], Vec3::new(2.0, 1.0, 3.0));
    let channels = SpecificChannels::build().with_channel("Y").with_pixel_fn(|at| (at.0 as f32,));
    Image::from_channels((4, 2), channels).write().to_file(&path).unwrap();
    assert_eq!(read_rgba_exr(&path).unwrap().rgb[6], Vec3::splat(2.0));
}

#[test]
fn a_crop_lands_in_its_display_window() {
    let dir = temp();
    let path = dir.path().join("crop.exr");
    let channels = SpecificChannels::rgb(|_: Vec2<usize>| (1f32, 2f32, 3f32));
    let attributes = LayerAttributes { layer_position: Vec2(6, -1), ..LayerAttributes::default() };
    let layer = Layer::new((4, 3), attributes, Encoding::FAST_LOSSLESS, channels);
    let window = IntegerBounds::new((0, 0), (8, 4));
    Image::new(ImageAttributes::new(window), layer).write().to_file(&path).unwrap();
    let image = read_rgba_exr(&path).unwrap();
    assert_eq!((image.width, image.height), (8, 4));
    // Columns 6 and 7 of rows 0 and 1; the rest of the crop lies outside.
    let covered: Vec<usize> = (0..32).filter(|&i| image.alpha[i] == 1.0).collect();
    assert_eq!(covered, [6, 7, 14, 15]);
    assert_eq!((image.rgb[6], image.rgb[5]), (Vec3::new(1.0, 2.0, 3.0), Vec3::ZERO));
}

#[test]
fn far_fields_are_finite_and_not_negative() {
    let dir = temp();
    let path = dir.path().join("sky.exr");
    let mut rgb = ramp(32);
    rgb[3] = Vec3::new(-1.0, 5.0, -0.0);
    rgb[4] = Vec3::new(f32::NAN, 5.0, 5.0);
    rgb[5] = Vec3::new(f32::INFINITY, 5.0, 5.0);
    write_exr(&path, &ExrLayers { width: 8, height: 4, rgb: &rgb, alpha: None, groups: &[] }).unwrap();
    let far = read_far_field(&path).unwrap();
    assert_eq!((far.width, far.height), (8, 4));
    assert_eq!(far.radiance[3..6], [Vec3::new(0.0, 5.0, 0.0), Vec3::ZERO, Vec3::ZERO]);
    assert_eq!((far.radiance[2], far.radiance[31]), (rgb[2], rgb[31]));
}

#[test]
fn radiance_hdr() {
    let dir = temp();
    let pixels: Vec<image::Rgb<f32>> = (0..32).map(|i| image::Rgb([i as f32, 0.5, 1000.0])).collect();
    let mut bytes = Vec::new();
    HdrEncoder::new(&mut bytes).encode(&pixels, 8, 4).unwrap();
    let far = read_far_field(&put(&dir, "sky.HDR", bytes)).unwrap();
    assert_eq!((far.width, far.height), (8, 4));
    // Eight bits of the largest channel.
    assert!((far.radiance[9] - Vec3::new(9.0, 0.5, 1000.0)).abs().max_element() < 8.0);
}

#[test]
fn png_round_trip() {
    let dir = temp();
    let path = dir.path().join("frame.png");
    let bytes: Vec<u8> = (0..60).collect();
    write_png(&path, 5, 3, &bytes).unwrap();
    assert_eq!(image::open(&path).unwrap().into_rgba8().into_raw(), bytes);
}

#[test]
fn bad_arguments_and_targets_leave_the_old_file() {
    let dir = temp();
    let path = put(&dir, "old.exr", "old");
    let rgb = ramp(4);
    let layers = ExrLayers { width: 2, height: 2, rgb: &rgb, alpha: None, groups: &[] };
    let short = write_exr(&path, &ExrLayers { width: 3, ..layers });
    assert!(matches!(short, Err(Error::Argument(m)) if m == "EXR channel R has 4 values for 3x2 pixels"));
    let empty = write_exr(&path, &ExrLayers { width: 0, rgb: &[], ..layers });
    assert!(matches!(empty, Err(Error::Argument(_))));
    let twice = [("Z", ExrGroup::Scalar(&[0.0; 4])), ("Z", ExrGroup::Scalar(&[0.0; 4]))];
    let twice = write_exr(&path, &ExrLayers { groups: &twice, ..layers });
    assert!(matches!(twice, Err(Error::Argument(m)) if m == "EXR channel Z occurs twice"));
    assert!(matches!(write_png(&path, 2, 2, &[0; 15]), Err(Error::Argument(_))));
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    let nowhere = dir.path().join("no/such/folder/a.exr");
    crate::assert_says(&crate::problem(write_exr(&nowhere, &layers), &nowhere), &["cannot be written"]);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "parts were left behind");
}
