//! How far two images are from each other, in numbers ([`compare()`]) and in pictures ([`difference_map`],
//! [`contact_sheet()`], [`Plot`]).

mod contact_sheet;
mod false_color;
mod metrics;
mod plot;
mod ssim;
mod text;

use glam::Vec3;
use image::{Rgba, RgbaImage};

pub use contact_sheet::{Tile, contact_sheet};
pub use false_color::difference_map;
pub use metrics::{Metrics, compare};
pub use plot::{Axis, Plot, Series};

use crate::{Error, Result};

/// More pixels than this are more than FLIP's 32-bit sizes can address.
const MAX_PIXELS: u64 = 1 << 28;

/// A linear image.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width in pixels, at least 1.
    pub width: u32,
    /// Height in pixels, at least 1.
    pub height: u32,
    /// `width * height` linear Rec. 709 radiances, row by row from the top.
    pub rgb: Vec<Vec3>,
    /// As many coverages, 0 to 1; above 0.5 is inside of the mask.
    pub alpha: Vec<f32>,
}

impl Image {
    /// An image of checked size: [`Error::Argument`] when the lengths do not fit `width * height` or that is 0,
    /// [`Error::Limit`] when it is above 2^28.
    pub fn new(width: u32, height: u32, rgb: Vec<Vec3>, alpha: Vec<f32>) -> Result<Self> {
        let image = Self { width, height, rgb, alpha };
        image.check()?;
        Ok(image)
    }

    /// The same, opaque everywhere.
    pub fn opaque(width: u32, height: u32, rgb: Vec<Vec3>) -> Result<Self> {
        let alpha = vec![1.0; rgb.len()];
        Self::new(width, height, rgb, alpha)
    }

    fn check(&self) -> Result<()> {
        let (width, height) = (self.width, self.height);
        let pixels = u64::from(width) * u64::from(height);
        if pixels > MAX_PIXELS {
            return Err(Error::Limit(format!("image: {width}x{height} pixels, limit {MAX_PIXELS}")));
        }
        if pixels == 0 || self.rgb.len() as u64 != pixels || self.alpha.len() as u64 != pixels {
            let (colors, alphas) = (self.rgb.len(), self.alpha.len());
            return Err(Error::Argument(format!("image: {width}x{height}, but {colors} colours and {alphas} alphas")));
        }
        Ok(())
    }
}

/// Two images checked against each other: the indices of the pixels inside of `a`'s mask.
///
/// [`Error::Argument`] when the sizes differ, the mask is empty, or a value inside of it is not finite.
fn masked(a: &Image, b: &Image) -> Result<Vec<usize>> {
    a.check()?;
    b.check()?;
    if (a.width, a.height) != (b.width, b.height) {
        let sizes = format!("A is {}x{}, B is {}x{}", a.width, a.height, b.width, b.height);
        return Err(Error::Argument(format!("images differ in size: {sizes}")));
    }
    let mask: Vec<usize> = (0..a.rgb.len()).filter(|&n| a.alpha[n] > 0.5).collect();
    if mask.is_empty() {
        return Err(Error::Argument("A's mask is empty: no alpha above 0.5".into()));
    }
    for (name, image) in [("A", a), ("B", b)] {
        if let Some(&n) = mask.iter().find(|&&n| !image.rgb[n].is_finite()) {
            let (x, y) = (n % a.width as usize, n / a.width as usize);
            return Err(Error::Argument(format!("{name} is not finite at pixel ({x}, {y})")));
        }
    }
    Ok(mask)
}

/// Mean luminance of the truth over the mask, above 0; [`Error::Argument`] when it is black.
fn mean_luminance(b: &Image, mask: &[usize]) -> Result<f64> {
    let mean = mask.iter().map(|&n| f64::from(luminance(b.rgb[n]))).sum::<f64>() / mask.len() as f64;
    if mean > 0.0 {
        Ok(mean)
    } else {
        Err(Error::Argument("B is black inside of A's mask: no error can be relative to it".into()))
    }
}

/// Luminance of a linear Rec. 709 colour, in the colour's own units (ITU-R BT.709).
pub fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// The sRGB curve (IEC 61966-2-1) for a linear value, clamped to 0..1 before.
fn srgb_encode(linear: f32) -> f32 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// A linear colour in 8 bits a channel; NaN becomes 0.
fn encode(linear: Vec3) -> [u8; 3] {
    linear.to_array().map(|channel| (srgb_encode(channel) * 255.0 + 0.5) as u8)
}

/// An image for the eye: multiplied by 2 to the power `exposure_stops`, clamped, sRGB-encoded; no other curve, so that
/// equal values stay equal between pictures. Alpha is kept. [`Error::Argument`] for an image of inconsistent size.
pub fn to_srgb8(image: &Image, exposure_stops: f32) -> Result<RgbaImage> {
    image.check()?;
    let scale = exposure_stops.exp2();
    Ok(RgbaImage::from_fn(image.width, image.height, |x, y| {
        let index = y as usize * image.width as usize + x as usize;
        let [r, g, b] = encode(image.rgb[index] * scale);
        Rgba([r, g, b, (image.alpha[index].clamp(0.0, 1.0) * 255.0 + 0.5) as u8])
    }))
}
