//! A small room with a lamp and a window whose light is known, as a scan of low dynamic range and as an HDR photo.

use glam::{Vec3, vec3};
use relume::compare::luminance;
use relume::formats::image::{decode_srgb, encode_srgb};
use relume::reference::bake::{BakeOptions, BakedRoom, bake};
use relume::reference::rooms::toy_room;
use relume::scene::{Camera, Cloud, Picture};

/// The room, and what a scanner makes of it.
pub(crate) struct Scan {
    baked: BakedRoom,
    /// What the scanner multiplies all light by.
    pub(crate) alpha: f32,
    /// The cloud as it should come out: light times `alpha`, neither clamped nor rounded.
    pub(crate) truth: Cloud,
    /// The cloud as it goes in: clamped, and rounded to 8 bits of sRGB.
    pub(crate) low: Cloud,
}

impl Scan {
    pub(crate) fn new(points: usize) -> Self {
        let options = BakeOptions { texel: 0.1, direct_samples: 16, bounced_samples: 128, bounces: 4, seed: 1 };
        let baked = bake(toy_room(), &options, &|_| ()).unwrap();
        let mut truth = baked.sample_cloud(points, 1);
        let mut luminances: Vec<f32> = truth.colors.iter().map(|&c| luminance(c)).collect();
        luminances.sort_by(f32::total_cmp);
        let alpha = luminances[luminances.len() * 95 / 100].recip();
        truth.colors.iter_mut().for_each(|color| *color *= alpha);
        let mut low = truth.clone();
        let coded = |value: f32| decode_srgb((encode_srgb(value.min(1.0)) * 255.0).round() / 255.0);
        low.colors.iter_mut().for_each(|color| *color = color.map(coded));
        Self { baked, alpha, truth, low }
    }

    /// The light itself, not multiplied by anything, as a camera of 62 degrees sees it.
    pub(crate) fn photo(&self, from: Vec3, at: Vec3) -> Picture {
        let (width, height) = (320, 240);
        let camera = Camera { from, at, fov_y: 62.0_f32.to_radians() };
        let radiance = |n: u32| self.baked.trace(from, camera.ray_direction(n % width, n / width, width, height));
        Picture { width, height, rgb: (0..width * height).map(radiance).collect() }
    }

    /// A photo of window and lamp.
    pub(crate) fn photo_of_lights(&self) -> Picture {
        let from = vec3(-0.9, 1.0, 2.35);
        self.photo(from, from + vec3(0.284, 0.249, -0.956))
    }

    /// A photo of the floor.
    pub(crate) fn photo_of_floor(&self) -> Picture {
        self.photo(vec3(-0.4, 1.6, 0.2), vec3(-0.3, 0.0, 0.0))
    }

    /// Which points are over-exposed.
    pub(crate) fn over_exposed(&self) -> Vec<bool> {
        self.low.colors.iter().map(|&c| luminance(c) > 0.9).collect()
    }

    /// Over-exposed points of the lamp's underside and of the window's pane.
    pub(crate) fn lamp_and_window(&self) -> [Vec<usize>; 2] {
        let over = self.over_exposed();
        let of = |emits: &dyn Fn(f32) -> bool| {
            (0..over.len()).filter(|&n| over[n] && emits(luminance(self.truth.colors[n]) / self.alpha)).collect()
        };
        [of(&|light| light > 30.0), of(&|light| (3.5..8.0).contains(&light))]
    }
}
