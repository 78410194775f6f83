//! Differences as numbers.

use glam::Vec3;
use nv_flip::FlipImageRgb8;

use super::ssim::ssim;
use super::{Image, encode, luminance, masked, mean_luminance, srgb_encode};
use crate::Result;

/// Where the mean luminance of the truth is put before SSIM and FLIP clamp and encode.
const MIDDLE: f64 = 0.25;

/// What [`compare`] finds, over the pixels of A's mask.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metrics {
    /// Root mean square of luminance A - luminance B, divided by the mean luminance of B.
    pub relative_rms_luminance: f64,
    /// Root mean square of A - B over pixels and channels, radiance.
    pub rgb_rms: f64,
    /// (mean luminance A - mean luminance B) / mean luminance B.
    pub bias: f64,
    /// Structural similarity of tone-mapped luminance, at most 1 (equal).
    pub ssim: f64,
    /// Mean FLIP error of the tone-mapped images, 0 (equal) to 1.
    pub flip: f64,
    /// Pixels in the mask.
    pub pixels: usize,
}

/// Compares `a` with the truth `b` over A's mask (alpha above 0.5).
///
/// For SSIM (Wang et al. 2004) and FLIP (Andersson et al. 2020, at its default of 67 pixels a degree) both images get
/// one exposure, which brings the mean luminance of B to 0.25, and are clamped and sRGB-encoded; both are black
/// outside of the mask, and what is left out there does not count.
///
/// [`crate::Error::Argument`] when the sizes differ, the mask is empty, a value inside of it is not finite, or B is black.
pub fn compare(a: &Image, b: &Image) -> Result<Metrics> {
    let mask = masked(a, b)?;
    let count = mask.len() as f64;
    let mean_b = mean_luminance(b, &mask)?;
    let (mut difference, mut squared, mut squared_rgb) = (0.0_f64, 0.0_f64, 0.0_f64);
    for &n in &mask {
        let (lum_a, lum_b) = (f64::from(luminance(a.rgb[n])), f64::from(luminance(b.rgb[n])));
        difference += lum_a - lum_b;
        squared += (lum_a - lum_b).powi(2);
        squared_rgb += (a.rgb[n] - b.rgb[n]).as_dvec3().length_squared();
    }

    let exposure = (MIDDLE / mean_b) as f32;
    let mut shown = [vec![Vec3::ZERO; a.rgb.len()], vec![Vec3::ZERO; a.rgb.len()]];
    for (shown, image) in shown.iter_mut().zip([a, b]) {
        for &n in &mask {
            shown[n] = image.rgb[n] * exposure;
        }
    }
    let lightness = shown.each_ref().map(|image| image.iter().map(|&c| srgb_encode(luminance(c))).collect::<Vec<_>>());
    Ok(Metrics {
        relative_rms_luminance: (squared / count).sqrt() / mean_b,
        rgb_rms: (squared_rgb / (3.0 * count)).sqrt(),
        bias: difference / count / mean_b,
        ssim: ssim(&lightness[0], &lightness[1], a.width as usize, &mask),
        flip: flip(&shown[0], &shown[1], (a.width, a.height), &mask),
        pixels: mask.len(),
    })
}

fn flip(a: &[Vec3], b: &[Vec3], (width, height): (u32, u32), mask: &[usize]) -> f64 {
    let bytes = |image: &[Vec3]| image.iter().flat_map(|&color| encode(color)).collect::<Vec<u8>>();
    let flip_image = |image| FlipImageRgb8::with_data(width, height, &bytes(image));
    let errors = nv_flip::flip(flip_image(b), flip_image(a), nv_flip::DEFAULT_PIXELS_PER_DEGREE).to_vec();
    mask.iter().map(|&n| f64::from(errors[n])).sum::<f64>() / mask.len() as f64
}
