//! Labels in pictures.

use font8x8::UnicodeFonts;
use image::{Rgba, RgbaImage};

/// Width and height of a character at scale 1.
pub(super) const CELL: u32 = 8;

/// Width of one line in pixels.
pub(super) fn width(text: &str, scale: u32) -> u32 {
    (text.chars().count() as u32).saturating_mul(CELL * scale)
}

/// Draws one line with its upper left corner at (left, top); what lies outside of the image is cut off, and characters
/// that the font lacks are drawn as question marks.
pub(super) fn draw(image: &mut RgbaImage, (left, top): (u32, u32), scale: u32, color: Rgba<u8>, text: &str) {
    for (index, character) in text.chars().enumerate() {
        let found = font8x8::BASIC_FONTS.get(character).or_else(|| font8x8::LATIN_FONTS.get(character));
        let Some(rows) = found.or_else(|| font8x8::BASIC_FONTS.get('?')) else { continue };
        let corner = left.saturating_add((index as u32).saturating_mul(CELL * scale));
        for (y, x) in (0..CELL * scale).flat_map(|y| (0..CELL * scale).map(move |x| (y, x))) {
            // bit 0 is the leftmost pixel
            let inked = rows[(y / scale) as usize] >> (x / scale) & 1 == 1;
            let pixel = image.get_pixel_mut_checked(corner.saturating_add(x), top.saturating_add(y));
            if let Some(pixel) = pixel.filter(|_| inked) {
                *pixel = color;
            }
        }
    }
}

/// Breaks `text` at spaces into lines of at most `columns` characters; longer words are cut.
pub(super) fn wrap(text: &str, columns: usize) -> Vec<String> {
    let columns = columns.max(1);
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let characters: Vec<char> = word.chars().collect();
        for piece in characters.chunks(columns) {
            match lines.last_mut() {
                Some(line) if line.chars().count() + 1 + piece.len() <= columns => {
                    line.push(' ');
                    line.extend(piece);
                }
                _ => lines.push(piece.iter().collect()),
            }
        }
    }
    lines
}
