//! How far two images are from each other, in numbers and in pictures.

use glam::Vec3;

/// Luminance of a linear Rec. 709 colour, in the colour's own units (ITU-R BT.709).
pub fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}
