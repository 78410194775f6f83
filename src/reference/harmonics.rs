//! Sums over all texels of a panorama in double precision: its projection to spherical harmonics, and the irradiance of
//! a surface that nothing occludes.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use rayon::prelude::*;

use crate::scene::FarField;
use crate::scene::harmonics::{MOST_COEFFICIENTS, basis};

/// Unit direction of the middle of a texel, as [`FarField`] lays them out.
pub fn direction(panorama: &FarField, x: u32, y: u32) -> DVec3 {
    let along = TAU * ((f64::from(x) + 0.5) / f64::from(panorama.width) - 0.5);
    let (sine, cosine) = (PI * (f64::from(y) + 0.5) / f64::from(panorama.height)).sin_cos();
    DVec3::new(sine * along.sin(), cosine, -sine * along.cos())
}

/// Solid angle of a texel of a row, steradians.
pub fn solid_angle(panorama: &FarField, y: u32) -> f64 {
    let edge = |row: u32| (PI * f64::from(row) / f64::from(panorama.height)).cos();
    TAU / f64::from(panorama.width) * (edge(y) - edge(y + 1))
}

/// Sums of what `weigh` makes of each texel's direction, times its radiance and solid angle.
fn sums<const N: usize>(panorama: &FarField, weigh: impl Fn(DVec3) -> [f64; N] + Sync) -> [DVec3; N] {
    let row = |y: u32| {
        let mut sums = [DVec3::ZERO; N];
        for x in 0..panorama.width {
            let radiance = panorama.radiance[(y * panorama.width + x) as usize].as_dvec3();
            let weights = weigh(direction(panorama, x, y));
            sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += radiance * weight);
        }
        sums.map(|sum| sum * solid_angle(panorama, y))
    };
    let rows: Vec<[DVec3; N]> = (0..panorama.height).into_par_iter().map(row).collect();
    rows.into_iter().fold([DVec3::ZERO; N], |mut all, row| {
        all.iter_mut().zip(row).for_each(|(all, row)| *all += row);
        all
    })
}

/// Coefficients of the radiance, of all orders (Hajisharif 2012, Eq. 12 with the exact solid angles of rows).
pub fn project(panorama: &FarField) -> [DVec3; MOST_COEFFICIENTS] {
    sums(panorama, basis)
}

/// Irradiance of a surface with the given unit normal.
pub fn irradiance(panorama: &FarField, normal: DVec3) -> DVec3 {
    sums(panorama, |direction| [direction.dot(normal).max(0.0)])[0]
}
