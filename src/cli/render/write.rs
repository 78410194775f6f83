//! Pictures and reports as files.

use std::path::Path;

use glam::Vec3;
use serde::Serialize;

use crate::formats::image::{ExrGroup, ExrLayers};
use crate::formats::tone::ToneCurve;
use crate::formats::{image, whole};
use crate::frames::Frame;
use crate::frames::composite::Composite;
use crate::scene::Camera;
use crate::{Error, Result};

/// Writes an EXR with layers or a PNG, by the name's ending.
pub(in crate::cli) fn write_frame(
    path: &Path,
    frame: &Frame,
    camera: &Camera,
    composite: &Composite,
    stops: f32,
    tone: ToneCurve,
) -> Result<()> {
    let three = |values: &[[f32; 4]]| values.iter().map(|v| Vec3::new(v[0], v[1], v[2])).collect::<Vec<_>>();
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        let scale = stops.exp2();
        let bytes: Vec<u8> = composite
            .rgb
            .iter()
            .zip(&composite.alpha)
            .flat_map(|(c, a)| {
                let [r, g, b] = tone.encode(*c * scale);
                [r, g, b, (a * 255.0).round() as u8]
            })
            .collect();
        return image::write_png(path, frame.width, frame.height, &bytes);
    }
    let alpha: Vec<f32> = frame.rgba.iter().map(|v| v[3]).collect();
    let position = three(&frame.position);
    let (_, _, forward) = camera.basis();
    let depth: Vec<f32> = position
        .iter()
        .zip(&alpha)
        .map(|(p, a)| if *a > 0.0 { (*p - camera.from).dot(forward) } else { 0.0 })
        .collect();
    let (albedo, normal, object) = (three(&frame.albedo), three(&frame.normal), three(&frame.rgba));
    let mut groups = vec![
        ("albedo", ExrGroup::Color(&albedo)),
        ("N", ExrGroup::Vector(&normal)),
        ("Z", ExrGroup::Scalar(&depth)),
        ("P", ExrGroup::Vector(&position)),
    ];
    if !composite.backdrop.is_empty() {
        // The lit object alone, where it is seen, and what is around and behind it.
        groups.extend([
            ("object", ExrGroup::Color(&object)),
            ("object.A", ExrGroup::Scalar(&composite.object)),
            ("backdrop", ExrGroup::Color(&composite.backdrop)),
        ]);
    }
    let (width, height) = (frame.width, frame.height);
    let (rgb, alpha) = (&composite.rgb, Some(&composite.alpha[..]));
    image::write_exr(path, &ExrLayers { width, height, rgb, alpha, groups: &groups })
}

/// Writes a report as JSON.
pub(in crate::cli) fn write_json(path: &Path, report: &impl Serialize) -> Result<()> {
    whole::write(path, |file| {
        serde_json::to_writer_pretty(file, report).map_err(|e| Error::file(path, format!("cannot be written: {e}")))
    })
}
