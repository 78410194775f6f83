//! A picture in linear light.

use glam::Vec3;

/// A linear Rec. 709 image without a mask: a photo, or a rendering of the cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width * height` colours, row by row from the top; finite and non-negative.
    pub rgb: Vec<Vec3>,
}

impl Picture {
    /// A black picture.
    pub fn black(width: u32, height: u32) -> Self {
        Self { width, height, rgb: vec![Vec3::ZERO; width as usize * height as usize] }
    }

    /// Colour of a pixel inside of the picture.
    pub fn at(&self, x: u32, y: u32) -> Vec3 {
        self.rgb[y as usize * self.width as usize + x as usize]
    }
}
