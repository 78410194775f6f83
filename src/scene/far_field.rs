//! Light from beyond the scan: a lat-long panorama at infinity.

use glam::Vec3;
use rayon::prelude::*;

/// A lat-long image of linear radiance, row 0 towards +Y, image centre towards -Z, +X at three quarters of the width.
#[derive(Clone, Debug, PartialEq)]
pub struct FarField {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// `width * height` linear Rec. 709 radiances, row by row; finite and non-negative.
    pub radiance: Vec<Vec3>,
}

impl FarField {
    /// Radiance seen towards the unit vector `direction`: bilinear, wrapping around the horizon and clamped at the
    /// poles.
    pub fn sample(&self, direction: Vec3) -> Vec3 {
        let u = 0.5 + direction.x.atan2(-direction.z) / std::f32::consts::TAU;
        let v = direction.y.clamp(-1.0, 1.0).acos() / std::f32::consts::PI;
        let (x, y) = (u * self.width as f32 - 0.5, v * self.height as f32 - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let texel = |dx: i64, dy: i64| {
            let column = (x0 as i64 + dx).rem_euclid(i64::from(self.width)) as usize;
            let row = (y0 as i64 + dy).clamp(0, i64::from(self.height) - 1) as usize;
            self.radiance[row * self.width as usize + column]
        };
        let top = texel(0, 0).lerp(texel(1, 0), fx);
        let bottom = texel(0, 1).lerp(texel(1, 1), fx);
        top.lerp(bottom, fy)
    }

    /// The same at half the size, each texel the mean of those it covers; `None` for a single texel.
    pub fn half(&self) -> Option<Self> {
        if self.width == 1 && self.height == 1 {
            return None;
        }
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let texel =
            |x: u32, y: u32| self.radiance[(y.min(self.height - 1) * self.width + x.min(self.width - 1)) as usize];
        let radiance = (0..width * height)
            .into_par_iter()
            .map(|i| {
                let (x, y) = (i % width * 2, i / width * 2);
                (texel(x, y) + texel(x + 1, y) + texel(x, y + 1) + texel(x + 1, y + 1)) * 0.25
            })
            .collect();
        Some(Self { width, height, radiance })
    }
}
