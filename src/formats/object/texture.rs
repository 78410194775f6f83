//! Encoded images to RGBA8 textures.

use std::io::Cursor;

use image::ImageReader;

use crate::scene::Texture;

/// Decodes a PNG or JPEG file in memory (16-bit images are reduced to 8 bits), or says what is wrong with it.
pub(super) fn decode(encoded: &[u8], srgb: bool) -> Result<Texture, String> {
    let reader = ImageReader::new(Cursor::new(encoded)).with_guessed_format().map_err(|e| e.to_string())?;
    let rgba = reader.decode().map_err(|e| e.to_string())?.into_rgba8();
    Ok(Texture { width: rgba.width(), height: rgba.height(), srgb, rgba: rgba.into_raw() })
}
