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

/// Three mantissas of 9 bits and a common exponent (EXT_texture_shared_exponent), as `glsl/common/rgb9e5.glsl` reads
/// them: to half a 512th of the largest channel. Values beyond 65,408 and below 0 are clamped; NaN becomes 0.
pub fn pack_rgb9e5(color: Vec3) -> u32 {
    let color = color.to_array().map(|c| if c > 0.0 { c.min(65_408.0) } else { 0.0 });
    let largest = color.into_iter().fold(0.0, f32::max);
    // The exponent that leaves the largest channel below 2^9 units; one more where rounding would reach it.
    let mut exponent = ((largest.to_bits() >> 23) as i32 - 126).clamp(-15, 16);
    let units = |value: f32, exponent: i32| (value * f32::exp2((9 - exponent) as f32) + 0.5) as u32;
    if units(largest, exponent) == 512 {
        exponent += 1;
    }
    let [r, g, b] = color.map(|value| units(value, exponent));
    r | g << 9 | b << 18 | ((exponent + 15) as u32) << 27
}

/// The colour that [`pack_rgb9e5`] packed.
pub fn unpack_rgb9e5(bits: u32) -> Vec3 {
    let unit = f32::exp2((bits >> 27) as f32 - 24.0);
    Vec3::from([bits & 511, bits >> 9 & 511, bits >> 18 & 511].map(|mantissa| mantissa as f32)) * unit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_common_exponent_keeps_colors_to_half_a_512th_of_the_largest_channel() {
        let colors =
            [Vec3::ZERO, Vec3::ONE, Vec3::new(0.999, 0.3, 0.02), Vec3::new(52.0, 49.0, 42.0), Vec3::splat(65_408.0)];
        for color in
            colors.into_iter().chain((0..200).map(|i| Vec3::new(0.37, 0.11, 0.9) * f32::exp2(i as f32 / 20.0 - 4.0)))
        {
            let back = unpack_rgb9e5(pack_rgb9e5(color));
            assert!((back - color).abs().max_element() <= color.max_element() / 512.0, "{back} instead of {color}");
        }
        assert_eq!(unpack_rgb9e5(pack_rgb9e5(Vec3::new(f32::NAN, -1.0, 0.5))), Vec3::new(0.0, 0.0, 0.5));
        assert_eq!(unpack_rgb9e5(pack_rgb9e5(Vec3::splat(f32::INFINITY))), Vec3::splat(65_408.0));
    }
}
