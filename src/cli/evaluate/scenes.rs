//! Clouds whose HDR colours are known, each with a photo of a part of it.

use std::path::Path;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::cli::progress;
use crate::compare::luminance;
use crate::formats::cloud::{self, CloudOptions};
use crate::formats::color::{decode_srgb8, encode_srgb8};
use crate::formats::image::read_photo;
use crate::preprocess::panorama_room::{PanoramaRoom, panorama_room};
use crate::reference::bake::{BakeOptions, BakedRoom, bake};
use crate::reference::rooms::{Room, hall, toy_room};
use crate::scene::{Camera, Cloud, FarField, Picture};
use crate::{Error, Result};

/// Share of the points that clips.
const CLIPS: f32 = 0.03;
/// Points of the scenes built in code.
const POINTS: usize = 300_000;

/// Where the toy room's photo is taken from: it sees the window and the lamp.
pub(in crate::cli) const TOY_ROOM_PHOTO: Camera =
    Camera { from: Vec3::new(1.7, 1.5, 2.2), at: Vec3::new(-0.2, 1.75, -1.2), fov_y: 1.15 };

/// A cloud with its photo.
pub(super) struct Scene {
    pub(super) name: String,
    /// With the true colours.
    pub(super) truth: Cloud,
    pub(super) photo: Picture,
    /// Where the object stands, in the space of the cloud's positions.
    pub(super) object_at: Vec3,
    /// Its radius, metres.
    pub(super) radius: f32,
}

impl Scene {
    pub(super) fn read(cloud: &Path, photo: &Path, object_at: DVec3, radius: f32) -> Result<Self> {
        let truth = cloud::load(cloud, &CloudOptions { orient_towards: Some(object_at), ..CloudOptions::default() })?;
        let name = cloud.file_stem().map_or_else(|| "cloud".into(), |stem| stem.to_string_lossy().into_owned());
        if truth.colors.iter().all(|color| color.max_element() <= 1.0) {
            let problem = "has no colour above 1: to evaluate an expansion its HDR colours must be known";
            return Err(Error::file(cloud, problem));
        }
        let object_at = (object_at - truth.origin).as_vec3();
        Ok(Self { name, truth, photo: read_photo(photo)?, object_at, radius })
    }

    /// The toy room, photographed from a corner.
    pub(super) fn toy_room() -> Result<Self> {
        let baked = baked(toy_room(), 0.04)?;
        let photo = photo(&baked, &TOY_ROOM_PHOTO);
        let truth = baked.sample_cloud(POINTS, 1);
        Ok(Self { name: "toy room".into(), truth, photo, object_at: Vec3::Y, radius: 0.35 })
    }

    /// A box on which a panorama of the hall is projected, and a part of the panorama for a photo.
    pub(super) fn panorama_room() -> Result<Self> {
        let baked = baked(hall(), 0.15)?;
        let (width, height) = (2048, 1024);
        let eye = Vec3::new(0.0, 1.7, 1.0);
        let radiance = (0..width * height).into_par_iter().map(|n| baked.trace(eye, direction(n, width, height)));
        let panorama = FarField { width, height, radiance: radiance.collect() };
        let size = Vec3::new(12.0, 6.0, 20.0);
        let options = PanoramaRoom { size, eye_height: eye.y, points: POINTS, seed: 1 };
        let truth = panorama_room(&panorama, &options)?;
        let camera = Camera { from: eye, at: eye + Vec3::new(0.45, 0.5, -1.0), fov_y: 1.45 };
        Ok(Self { name: "panorama room".into(), truth, photo: photo(&baked, &camera), object_at: eye, radius: 0.5 })
    }
}

/// The exposure at which [`CLIPS`] of the points clip.
pub(in crate::cli) fn exposure(truth: &Cloud) -> f32 {
    let mut luminances: Vec<f32> = truth.colors.iter().map(|&color| luminance(color)).collect();
    let place = ((luminances.len() as f32 * (1.0 - CLIPS)) as usize).min(luminances.len() - 1);
    1.0 / luminances.select_nth_unstable_by(place, f32::total_cmp).1.max(f32::MIN_POSITIVE)
}

/// What a scanner would have made of a cloud: exposed, clamped, 8 bits.
pub(in crate::cli) fn low(truth: &Cloud, alpha: f32) -> Cloud {
    let coded = |color: &Vec3| decode_srgb8((*color * alpha).to_array().map(encode_srgb8));
    Cloud { colors: truth.colors.iter().map(coded).collect(), ..truth.clone() }
}

fn baked(room: Room, texel: f32) -> Result<BakedRoom> {
    let options = BakeOptions { texel, direct_samples: 48, bounced_samples: 384, ..BakeOptions::default() };
    let bar = progress::bar("baking", 1000);
    let baked = bake(room, &options, &|done| bar.set_position((done * 1000.0) as u64))?;
    bar.finish_and_clear();
    Ok(baked)
}

/// Direction of a texel of a lat-long panorama.
fn direction(n: u32, width: u32, height: u32) -> Vec3 {
    let (u, v) = (((n % width) as f32 + 0.5) / width as f32, ((n / width) as f32 + 0.5) / height as f32);
    let (around, down) = ((u - 0.5) * std::f32::consts::TAU, v * std::f32::consts::PI);
    Vec3::new(down.sin() * around.sin(), down.cos(), -down.sin() * around.cos())
}

/// 640 x 480, four rays a pixel.
pub(in crate::cli) fn photo(baked: &BakedRoom, camera: &Camera) -> Picture {
    let (width, height) = (640, 480);
    let pixel = |n: u32| {
        let (x, y) = (n % width, n / width);
        let ray = |k: u32| camera.ray_direction(2 * x + k % 2, 2 * y + k / 2, 2 * width, 2 * height);
        (0..4).map(|k| baked.trace(camera.from, ray(k))).sum::<Vec3>() / 4.0
    };
    Picture { width, height, rgb: (0..width * height).into_par_iter().map(pixel).collect() }
}
