//! From a picture in linear light to the one on the screen: exposure, tone curve, a plain ground where nothing is.

use glam::Vec3;
use rayon::prelude::*;

use crate::formats::color::encode_srgb8;
use crate::formats::tone::ToneCurve;
use crate::frames::composite::Composite;

/// Steps of the table from linear light to 8 bits: the first of them is half a code.
const STEPS: usize = 1 << 13;
/// Brightness of the plain ground at the top and the bottom of a picture, sRGB codes.
const GROUND: [f32; 2] = [30.0, 52.0];

/// From linear light to 8-bit sRGB.
struct Curve {
    table: Vec<u8>,
    scale: f32,
    tone: ToneCurve,
}

impl Curve {
    fn new(stops: f32, tone: ToneCurve) -> Self {
        let table = (0..=STEPS).map(|i| encode_srgb8(i as f32 / STEPS as f32)).collect();
        Self { table, scale: stops.exp2(), tone }
    }

    fn encode(&self, color: Vec3) -> [u8; 3] {
        let color = color * self.scale;
        if self.tone.channel(0.0).is_none() {
            return self.tone.encode(color);
        }
        color.to_array().map(|linear| {
            let shown = self.tone.channel(linear).unwrap_or(linear);
            // NaN counts as black.
            self.table[((shown.clamp(0.0, 1.0) * STEPS as f32 + 0.5) as usize).min(STEPS)]
        })
    }
}

/// The picture, RGBA of 8 bits a channel, row by row from the top; opaque.
pub(super) fn develop(picture: &Composite, width: u32, stops: f32, tone: ToneCurve) -> Vec<u8> {
    let curve = Curve::new(stops, tone);
    let width = (width as usize).max(1);
    let rows = picture.rgb.len().div_ceil(width).max(1);
    let mut bytes = vec![255; picture.rgb.len() * 4];
    bytes.par_chunks_mut(4 * width).enumerate().for_each(|(y, row)| {
        let along = y as f32 / rows as f32;
        let ground = (GROUND[0] + (GROUND[1] - GROUND[0]) * along).round() as u8;
        for (x, pixel) in row.chunks_exact_mut(4).enumerate() {
            let at = y * width + x;
            let code = if picture.alpha[at] > 0.0 { curve.encode(picture.rgb[at]) } else { [ground; 3] };
            pixel[..3].copy_from_slice(&code);
        }
    });
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_is_white_and_the_ground_is_dark() {
        let rgb = vec![Vec3::new(1.0, 0.5, f32::NAN), Vec3::splat(9.0)];
        let picture = Composite { rgb, alpha: vec![1.0, 0.0], ..Composite::default() };
        let bytes = develop(&picture, 2, 0.0, ToneCurve::Srgb);
        assert_eq!(bytes[..4], [255, 188, 0, 255]);
        assert!(bytes[4] < 60 && bytes[4] == bytes[5] && bytes[7] == 255);
        let brighter = develop(&picture, 2, 1.0, ToneCurve::Srgb);
        assert_eq!(brighter[1], 255, "half a white and a stop");
        let filmic = develop(&picture, 2, 0.0, ToneCurve::Filmic);
        assert!(filmic[0] < 250 && filmic[0] > 200 && filmic[1] > 150, "{filmic:?}");
    }
}
