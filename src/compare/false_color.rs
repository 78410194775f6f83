//! Where two images differ, in colour.

use glam::{Mat3, Vec3};
use image::{Rgba, RgbaImage};

use super::{Image, encode, luminance, masked, mean_luminance, text};
use crate::{Error, Result};

const BACKGROUND: Rgba<u8> = Rgba([40, 40, 40, 255]);
const INK: Rgba<u8> = Rgba([235, 235, 235, 255]);
/// The bar and its numbers, pixels.
const BAR: u32 = 16;
const MARGIN: u32 = 8;
/// Least height, so that five numbers have room beside the bar.
const LEAST_HEIGHT: u32 = 96;

/// A map of (luminance A - luminance B) / mean luminance of B over A's mask: blue where A is too dark, white where they
/// agree, red where A is too bright, dark grey outside of the mask; a bar on the right gives the numbers. `range` is
/// the difference at which colours end; None takes the 99th percentile, rounded up to 1, 2 or 5 times a power of ten.
///
/// Errors as [`super::compare`], and [`Error::Argument`] for a range that is not above 0.
pub fn difference_map(a: &Image, b: &Image, range: Option<f32>) -> Result<RgbaImage> {
    let mask = masked(a, b)?;
    let mean = mean_luminance(b, &mask)?;
    let difference = |n: usize| (f64::from(luminance(a.rgb[n]) - luminance(b.rgb[n])) / mean) as f32;
    let range = match range {
        Some(range) if range > 0.0 && range.is_finite() => range,
        Some(range) => return Err(Error::Argument(format!("difference map: range {range}, must be above 0"))),
        None => rounded_up(percentile_99(mask.iter().map(|&n| difference(n).abs()).collect())),
    };

    let labels = [1.0, 0.5, 0.0, -0.5, -1.0].map(|part| label(part * range));
    let label_width = labels.iter().map(|label| text::width(label, 1)).max().unwrap_or(0);
    let width = a.width + 3 * MARGIN + BAR + label_width;
    let height = a.height.max(LEAST_HEIGHT);
    let mut map = RgbaImage::from_pixel(width, height, BACKGROUND);
    for &n in &mask {
        let (x, y) = (n as u32 % a.width, n as u32 / a.width);
        map.put_pixel(x, y, color(difference(n) / range));
    }
    draw_bar(&mut map, a.width + MARGIN, &labels);
    Ok(map)
}

fn draw_bar(map: &mut RgbaImage, left: u32, labels: &[String]) {
    let top = MARGIN;
    let length = map.height() - 2 * MARGIN;
    for y in 0..length {
        let value = 1.0 - 2.0 * y as f32 / (length - 1) as f32;
        for x in 0..BAR {
            map.put_pixel(left + x, top + y, color(value));
        }
    }
    for (index, label) in labels.iter().enumerate() {
        let y = top + (length - 1) * index as u32 / (labels.len() as u32 - 1) - text::CELL / 2;
        text::draw(map, (left + BAR + MARGIN, y), 1, INK, label);
    }
}

/// A signed number that is short at any magnitude.
fn label(value: f32) -> String {
    if value == 0.0 {
        "0".into()
    } else if (0.001..1000.0).contains(&value.abs()) {
        let digits = (1.0 - value.abs().log10().floor()).clamp(0.0, 5.0) as usize;
        format!("{value:+.digits$}")
    } else {
        format!("{value:+.0e}")
    }
}

fn percentile_99(mut values: Vec<f32>) -> f32 {
    values.sort_unstable_by(f32::total_cmp);
    let index = (values.len() * 99 / 100).min(values.len().saturating_sub(1));
    values.get(index).copied().unwrap_or(0.0)
}

/// The next 1, 2 or 5 times a power of ten; equal images get a range of 0.01.
fn rounded_up(value: f32) -> f32 {
    if value < 1e-6 {
        return 0.01;
    }
    let power = 10.0_f32.powf(value.log10().floor());
    let steps = [1.0, 2.0, 5.0].map(|step| step * power);
    // rounding of the power may leave the value an ulp above its own step
    steps.into_iter().find(|step| value <= step * 1.0001).unwrap_or(10.0 * power)
}

/// -1 is blue, 0 white, 1 red; straight lines in Oklab (Björn Ottosson 2020), so that equal steps look equal.
fn color(value: f32) -> Rgba<u8> {
    // (lightness, a, b)
    let (blue, white, red) = (Vec3::new(0.42, -0.03, -0.19), Vec3::new(0.97, 0.0, 0.0), Vec3::new(0.46, 0.16, 0.09));
    let value = value.clamp(-1.0, 1.0);
    let lab = white.lerp(if value < 0.0 { blue } else { red }, value.abs());
    let cubes = Mat3::from_cols_array(&[
        1.0,
        1.0,
        1.0, //
        0.396_337_78,
        -0.105_561_346,
        -0.089_484_18, //
        0.215_803_76,
        -0.063_854_17,
        -1.291_485_5,
    ]) * lab;
    let linear = Mat3::from_cols_array(&[
        4.076_741_7,
        -1.268_438,
        -0.004_196_086_3, //
        -3.307_711_6,
        2.609_757_4,
        -0.703_418_6, //
        0.230_969_94,
        -0.341_319_4,
        1.707_614_7,
    ]) * (cubes * cubes * cubes);
    let [r, g, b] = encode(linear);
    Rgba([r, g, b, 255])
}
