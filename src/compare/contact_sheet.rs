//! Several images in one, with words.

use image::imageops::{self, FilterType};
use image::{Rgba, RgbaImage};

use super::text;
use crate::{Error, Result};

const BACKGROUND: Rgba<u8> = Rgba([36, 36, 36, 255]);
const BEHIND: Rgba<u8> = Rgba([20, 20, 20, 255]);
const BRIGHT: Rgba<u8> = Rgba([240, 240, 240, 255]);
const SOFT: Rgba<u8> = Rgba([180, 180, 180, 255]);
const MARGIN: u32 = 16;
const SCALE: u32 = 2;
/// Height of a line of text with its gap.
const LINE: u32 = text::CELL * SCALE + 4;
/// Narrower images are enlarged by a whole factor, so that words fit below them and pixels can be told apart.
const LEAST_WIDTH: u32 = 256;
/// A sheet of more than this many pixels a side is not for the eye.
const MAX_SIDE: u64 = 32_768;

/// One image of a sheet.
#[derive(Clone, Debug)]
pub struct Tile {
    /// The image; transparent parts show a dark ground.
    pub image: RgbaImage,
    /// A line or more above it.
    pub title: String,
    /// A line or more below it; numbers belong here.
    pub caption: String,
}

/// Lays tiles out in rows of `columns` under a title, on dark grey. [`Error::Argument`] without tiles or columns,
/// [`Error::Limit`] when the sheet would be larger than 32768 pixels a side.
pub fn contact_sheet(title: &str, columns: usize, tiles: &[Tile]) -> Result<RgbaImage> {
    if tiles.is_empty() || columns == 0 {
        return Err(Error::Argument(format!("contact sheet: {} tiles in {columns} columns", tiles.len())));
    }
    if let Some(index) = tiles.iter().position(|tile| tile.image.is_empty()) {
        return Err(Error::Argument(format!("contact sheet: tile {index} has no pixels")));
    }
    let columns = columns.min(tiles.len());
    let factor = |tile: &Tile| LEAST_WIDTH.div_ceil(tile.image.width().max(1)).max(1);
    let size = |tile: &Tile| {
        let scaled = |side: u32| u64::from(side) * u64::from(factor(tile));
        (scaled(tile.image.width()), scaled(tile.image.height()))
    };
    let cell_width = tiles.iter().map(|tile| size(tile).0).max().unwrap_or(0);
    let cell_height = tiles.iter().map(|tile| size(tile).1).max().unwrap_or(0);
    let sheet_width = (cell_width + u64::from(MARGIN)) * columns as u64 + u64::from(MARGIN);

    let letters = |pixels: u64| (pixels / u64::from(text::CELL * SCALE)) as usize;
    let wrap = |words: &str| text::wrap(words, letters(cell_width));
    let title = text::wrap(title, letters(sheet_width - 2 * u64::from(MARGIN)));
    let lines = |words: fn(&Tile) -> &str| tiles.iter().map(|tile| wrap(words(tile)).len()).max().unwrap_or(0) as u64;
    let (above, below) = (lines(|tile| &tile.title), lines(|tile| &tile.caption));
    let row_height = cell_height + (above + below) * u64::from(LINE) + u64::from(MARGIN);
    let first_row = u64::from(MARGIN) + title.len() as u64 * u64::from(LINE);
    let sheet_height = first_row + row_height * tiles.len().div_ceil(columns) as u64;
    if sheet_width > MAX_SIDE || sheet_height > MAX_SIDE {
        return Err(Error::Limit(format!(
            "contact sheet: {sheet_width}x{sheet_height} pixels, limit {MAX_SIDE} a side"
        )));
    }

    let mut sheet = RgbaImage::from_pixel(sheet_width as u32, sheet_height as u32, BACKGROUND);
    let write = |sheet: &mut RgbaImage, left: u32, top: u32, color: Rgba<u8>, lines: &[String]| {
        for (index, line) in lines.iter().enumerate() {
            text::draw(sheet, (left, top + index as u32 * LINE), SCALE, color, line);
        }
    };
    write(&mut sheet, MARGIN, MARGIN / 2, BRIGHT, &title);
    for (index, tile) in tiles.iter().enumerate() {
        let left = MARGIN + (index % columns) as u32 * (cell_width as u32 + MARGIN);
        let top = (first_row + (index / columns) as u64 * row_height) as u32;
        let image_top = top + above as u32 * LINE;
        let (width, height) = size(tile);
        let image = imageops::resize(&tile.image, width as u32, height as u32, FilterType::Nearest);
        let mut ground = RgbaImage::from_pixel(width as u32, height as u32, BEHIND);
        imageops::overlay(&mut ground, &image, 0, 0);
        // blending rounds the alpha of an opaque ground down
        ground.pixels_mut().for_each(|pixel| pixel[3] = u8::MAX);
        imageops::replace(&mut sheet, &ground, i64::from(left), i64::from(image_top));
        write(&mut sheet, left, top, BRIGHT, &wrap(&tile.title));
        write(&mut sheet, left, image_top + cell_height as u32 + 4, SOFT, &wrap(&tile.caption));
    }
    Ok(sheet)
}
