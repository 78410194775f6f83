//! Light probes over time: sequences of files, and streams that decode them ahead.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod sequences;
mod streams;

use std::path::Path;

use glam::Vec3;
use relume::Error;
use relume::formats::image::{ExrLayers, write_exr};
use relume::probes::ProbeStream;
use tempfile::TempDir;

fn write(path: &Path, (width, height): (u32, u32), rgb: &[Vec3]) {
    write_exr(path, &ExrLayers { width, height, rgb, alpha: None, groups: &[] }).unwrap();
}

/// A folder of panoramas of 8x4 texels, each of one value.
fn folder(files: &[(&str, f32)]) -> TempDir {
    let dir = TempDir::new().unwrap();
    for &(name, value) in files {
        write(&dir.path().join(name), (8, 4), &[Vec3::splat(value); 32]);
    }
    dir
}

#[track_caller]
fn says(error: &Error, parts: &[&str]) {
    let text = error.to_string();
    assert!(!text.contains('\n') && parts.iter().all(|part| text.contains(part)), "{text:?} does not say {parts:?}");
}

/// A panorama of 16x8 texels that has no symmetry.
fn uneven(seed: u32) -> Vec<Vec3> {
    (0..128_u32).map(|i| Vec3::from([1, 3, 7].map(|k| ((i * k + seed) * 37 % 101) as f32))).collect()
}

fn problems(stream: &mut ProbeStream) -> Vec<u64> {
    let mut numbers: Vec<u64> = stream.take_problems().into_iter().map(|problem| problem.0).collect();
    numbers.sort_unstable();
    numbers
}
