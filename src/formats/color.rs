//! The sRGB transfer function (IEC 61966-2-1).

use glam::Vec3;

/// Encoded value of a linear one. Values above 1 go on along the same curve and negative ones mirror it, so that
/// [`decode_srgb`] undoes it everywhere.
pub fn encode_srgb(linear: f32) -> f32 {
    let magnitude = linear.abs();
    let encoded = if magnitude <= 0.003_130_8 { 12.92 * magnitude } else { 1.055 * magnitude.powf(1.0 / 2.4) - 0.055 };
    encoded.copysign(linear)
}

/// Linear value of an encoded one; the inverse of [`encode_srgb`].
pub fn decode_srgb(encoded: f32) -> f32 {
    let magnitude = encoded.abs();
    let linear = if magnitude <= 0.040_45 { magnitude / 12.92 } else { ((magnitude + 0.055) / 1.055).powf(2.4) };
    linear.copysign(encoded)
}

/// Nearest 8-bit code of a linear value, clamped to 0..=255; NaN becomes 0.
pub fn encode_srgb8(linear: f32) -> u8 {
    // The cast saturates and maps NaN to 0.
    (encode_srgb(linear) * 255.0).round() as u8
}

/// Linear colour of three 8-bit sRGB codes.
pub fn decode_srgb8(rgb: [u8; 3]) -> Vec3 {
    Vec3::from(rgb.map(|code| decode_srgb(f32::from(code) / 255.0)))
}
