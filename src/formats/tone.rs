//! From linear radiance to what a screen shows.

use std::fmt;
use std::str::FromStr;

use glam::{Mat3, Vec3};

use super::color;

/// A curve from linear Rec. 709 radiance, of which 1 is the white of a photo, to a screen's values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ToneCurve {
    /// The sRGB curve alone: what is brighter than white is white.
    #[default]
    Srgb,
    /// A filmic shoulder before it (Narkowicz 2015, after ACES).
    Filmic,
    /// Highlights that lose their colour as they burn out (after AgX, Sobotka 2022, by Wrensch's fit of its curve).
    Agx,
}

impl ToneCurve {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Srgb, Self::Filmic, Self::Agx];

    /// The name it has everywhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::Srgb => "srgb",
            Self::Filmic => "filmic",
            Self::Agx => "agx",
        }
    }

    /// 8-bit sRGB codes of a linear colour; NaN becomes 0.
    pub fn encode(self, linear: Vec3) -> [u8; 3] {
        match self {
            Self::Srgb => linear.to_array().map(color::encode_srgb8),
            Self::Filmic => linear.to_array().map(|x| color::encode_srgb8(narkowicz(x))),
            Self::Agx => agx(linear).to_array().map(|x| (x * 255.0).round() as u8),
        }
    }
}

impl fmt::Display for ToneCurve {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for ToneCurve {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|curve| curve.name() == text)
            .ok_or_else(|| format!("{text:?} is no tone curve; there are srgb, filmic and agx"))
    }
}

/// Rational fit of the ACES reference transforms for one channel.
fn narkowicz(x: f32) -> f32 {
    let x = x.clamp(0.0, 1e6);
    (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)
}

/// Encoded values from 0 to 1.
fn agx(linear: Vec3) -> Vec3 {
    // Rec. 709 to the primaries in which the curve works, and back.
    const INSET: Mat3 = Mat3::from_cols(
        Vec3::new(0.842_479, 0.042_328, 0.042_376),
        Vec3::new(0.078_434, 0.878_469, 0.078_434),
        Vec3::new(0.079_224, 0.079_166, 0.879_143),
    );
    const OUTSET: Mat3 = Mat3::from_cols(
        Vec3::new(1.196_879, -0.052_897, -0.052_972),
        Vec3::new(-0.098_021, 1.151_903, -0.098_043),
        Vec3::new(-0.099_03, -0.098_961, 1.151_074),
    );
    // Stops around middle grey that the curve covers.
    const STOPS: (f32, f32) = (-12.474, 4.026);
    let value = INSET * linear.max(Vec3::ZERO).min(Vec3::splat(1e6));
    let log = value.to_array().map(|v| ((v.max(1e-10).log2() - STOPS.0) / (STOPS.1 - STOPS.0)).clamp(0.0, 1.0));
    let curve = log.map(|x| {
        let x2 = x * x;
        let x4 = x2 * x2;
        15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.002_32
    });
    (OUTSET * Vec3::from(curve)).clamp(Vec3::ZERO, Vec3::ONE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_rise_from_black_to_white_and_keep_grey_grey() {
        for curve in ToneCurve::ALL {
            assert!(curve.encode(Vec3::ZERO).iter().all(|c| *c <= 1), "{curve}: {:?}", curve.encode(Vec3::ZERO));
            assert!(curve.encode(Vec3::splat(1e5)).iter().all(|c| *c >= 250), "{curve}");
            let mut last = 0;
            for step in -40..40 {
                let [r, g, b] = curve.encode(Vec3::splat(f32::exp2(step as f32 / 4.0)));
                assert!(r.abs_diff(g) <= 1 && g.abs_diff(b) <= 1, "{curve}: {r} {g} {b}");
                assert!(r >= last, "{curve} falls at {step}");
                last = r;
            }
            assert_eq!(curve.name().parse(), Ok(curve));
        }
        let middle = ToneCurve::Agx.encode(Vec3::splat(0.18))[0];
        assert!((100..140).contains(&middle), "middle grey: {middle}");
    }

    #[test]
    fn highlights_keep_more_than_their_largest_channel_on_a_filmic_curve() {
        let red = Vec3::new(8.0, 0.8, 0.4);
        assert_eq!(ToneCurve::Srgb.encode(red)[0], 255);
        let [r, g, b] = ToneCurve::Agx.encode(red);
        assert!(r > g && g > 60 && b > 60, "{r} {g} {b} goes towards white");
    }

    #[test]
    fn what_is_no_number_is_black() {
        for curve in ToneCurve::ALL {
            assert!(curve.encode(Vec3::NAN).iter().all(|c| *c <= 1), "{curve}: {:?}", curve.encode(Vec3::NAN));
        }
    }
}
