//! From a lit frame to the picture on the screen: backdrop, exposure, tone curve.

use rayon::prelude::*;

use super::backdrop::Backdrop;
use super::state::ToneCurve;
use crate::formats::color::encode_srgb8;
use crate::frames::Frame;

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

    fn encode(&self, linear: f32) -> u8 {
        let x = (linear * self.scale).max(0.0);
        let toned = match self.tone {
            ToneCurve::Srgb => x,
            ToneCurve::Filmic if x > 1e4 => 1.0,
            ToneCurve::Filmic => (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14),
        };
        // NaN counts as black.
        self.table[((toned.min(1.0) * STEPS as f32 + 0.5) as usize).min(STEPS)]
    }
}

/// The picture, RGBA of 8 bits a channel, row by row from the top; opaque.
pub(super) fn develop(frame: &Frame, backdrop: Option<&Backdrop>, stops: f32, tone: ToneCurve) -> Vec<u8> {
    let curve = Curve::new(stops, tone);
    let width = (frame.width as usize).max(1);
    let mut bytes = vec![255; frame.rgba.len() * 4];
    bytes.par_chunks_mut(4 * width).enumerate().for_each(|(y, row)| {
        let along = y as f32 / frame.height as f32;
        let ground = (GROUND[0] + (GROUND[1] - GROUND[0]) * along).round() as u8;
        for (x, pixel) in row.chunks_exact_mut(4).enumerate() {
            let at = y * width + x;
            let light = match (backdrop, frame.rgba[at]) {
                (Some(backdrop), _) => Some(backdrop.composed[at]),
                (None, [r, g, b, alpha]) if alpha > 0.0 => Some([r, g, b]),
                _ => None,
            };
            let code = light.map_or([ground; 3], |light| light.map(|channel| curve.encode(channel)));
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
        let rgba = vec![[1.0, 0.5, f32::NAN, 1.0], [9.0, 9.0, 9.0, 0.0]];
        let frame = Frame { width: 2, height: 1, rgba, ..Frame::default() };
        let bytes = develop(&frame, None, 0.0, ToneCurve::Srgb);
        assert_eq!(bytes[..4], [255, 188, 0, 255]);
        assert!(bytes[4] < 60 && bytes[4] == bytes[5] && bytes[7] == 255);
        let brighter = develop(&frame, None, 1.0, ToneCurve::Srgb);
        assert_eq!(brighter[1], 255, "half a white and a stop");
        let filmic = develop(&frame, None, 0.0, ToneCurve::Filmic);
        assert!(filmic[0] < 250 && filmic[0] > 200 && filmic[1] > 150, "{filmic:?}");
    }
}
