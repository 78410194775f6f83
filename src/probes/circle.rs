//! Which pixels of a round picture of the sphere make up the texels of a panorama.

use std::f64::consts::PI;

use glam::DVec2;

use super::Mapping;

/// A pixel of the picture and its part in a texel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tap {
    pub(super) column: u32,
    pub(super) row: u32,
    pub(super) weight: f32,
}

/// What the texels of half a row are made of.
#[derive(Clone, Debug, Default)]
pub(super) struct HalfRow {
    taps: Vec<Tap>,
    /// Where the taps of each texel end.
    ends: Vec<u32>,
}

impl HalfRow {
    /// The taps of each texel.
    pub(super) fn texels(&self) -> impl Iterator<Item = &[Tap]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.taps[start as usize..end as usize])
    }
}

/// The largest circle in the middle of a picture.
pub(super) struct Circle {
    mapping: Mapping,
    width: u32,
    height: u32,
    /// In pixels from the upper left corner.
    middle: DVec2,
    /// Pixels.
    radius: f64,
}

impl Circle {
    pub(super) fn new(mapping: Mapping, (width, height): (u32, u32)) -> Self {
        let middle = DVec2::new(f64::from(width), f64::from(height)) / 2.0;
        Self { mapping, width, height, middle, radius: middle.min_element() }
    }

    /// What the left half of a row of a panorama of `height` rows is made of. Round pictures are mirror-symmetric: the
    /// right half is of the pixels mirrored left to right, and a row as far from the bottom of those mirrored
    /// upside down.
    pub(super) fn left_half(&self, row: u32, height: u32) -> HalfRow {
        let (mut result, mut taps) = (HalfRow::default(), Vec::new());
        for column in 0..height {
            taps.clear();
            self.texel(DVec2::new(f64::from(column), f64::from(row)), f64::from(height), &mut taps);
            taps.sort_unstable_by_key(|tap: &Share| (tap.row, tap.column));
            let total: f64 = taps.iter().map(|tap| tap.weight).sum();
            for same in taps.chunk_by(|a, b| (a.row, a.column) == (b.row, b.column)) {
                let weight = (same.iter().map(|tap| tap.weight).sum::<f64>() / total) as f32;
                result.taps.push(Tap { column: same[0].column, row: same[0].row, weight });
            }
            result.ends.push(result.taps.len() as u32);
        }
        result
    }

    /// Adds pixels and their weights for the texel whose upper left corner is `corner`: the line between pixels at many
    /// places, each weighted by its solid angle.
    fn texel(&self, corner: DVec2, height: f64, taps: &mut Vec<Share>) {
        // Places a pixel: bilinear weights add up to the same for every pixel, to two parts in a hundred, from about
        // three on. Beyond the limit is only what lies next to a mirror ball's rim.
        const DENSITY: f64 = 3.0;
        const MOST: f64 = 256.0;
        let longitude = |x: f64| ((x / height - 1.0) * PI).sin_cos();
        let latitude = |y: f64| (y / height * PI).sin_cos();
        let middle = corner + 0.5;
        let (left, right) = (longitude(corner.x), longitude(corner.x + 1.0));
        let (top, bottom) = (latitude(corner.y), latitude(corner.y + 1.0));
        let (across, down) = (latitude(middle.y), longitude(middle.x));
        let places = |a: DVec2, b: DVec2| (a.distance(b) * DENSITY).ceil().clamp(1.0, MOST) as u32;
        let columns = places(self.place(left, across), self.place(right, across));
        let rows = places(self.place(down, top), self.place(down, bottom));
        let parts = |count: u32| (0..count).map(move |part| (f64::from(part) + 0.5) / f64::from(count));
        let longitudes: Vec<(f64, f64)> = parts(columns).map(|part| longitude(corner.x + part)).collect();
        for latitude in parts(rows).map(|part| latitude(corner.y + part)) {
            for &longitude in &longitudes {
                self.bilinear(self.place(longitude, latitude), latitude.0, taps);
            }
        }
    }

    /// Where the picture shows a direction, given as (sin, cos) of its angles: in pixels from the upper left corner.
    fn place(&self, longitude: (f64, f64), latitude: (f64, f64)) -> DVec2 {
        let (x, y, z) = (latitude.0 * longitude.0, latitude.1, -latitude.0 * longitude.1);
        // What lies beyond the outermost pixels' middles has the colour of these.
        let radius = (self.mapping.radius(z) * self.radius).min((self.radius - 0.5).max(0.0));
        // Exactly towards +Z or -Z any side will do.
        self.middle + DVec2::new(x, -y).try_normalize().unwrap_or(DVec2::X) * radius
    }

    /// Adds the four pixels around `at`, without those whose middle is outside of the circle.
    fn bilinear(&self, at: DVec2, weight: f64, taps: &mut Vec<Share>) {
        let corner = (at - 0.5).floor();
        let part = at - 0.5 - corner;
        let mut empty = true;
        for offset in [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE] {
            let pixel = corner + offset;
            let share = DVec2::ONE - (part - offset).abs();
            let inside = (pixel + 0.5).distance_squared(self.middle) <= self.radius * self.radius;
            if inside && share.min_element() > 0.0 {
                self.add(pixel, weight * share.element_product(), taps);
                empty = false;
            }
        }
        if empty {
            self.add(at.floor(), weight, taps);
        }
    }

    /// Adds a pixel, or the one closest to it in the picture.
    fn add(&self, pixel: DVec2, weight: f64, taps: &mut Vec<Share>) {
        // Most pixels were just seen; the others are sorted out at the end.
        const RECENT: usize = 16;
        let clamp = |at: f64, side: u32| at.clamp(0.0, f64::from(side - 1)) as u32;
        let (column, row) = (clamp(pixel.x, self.width), clamp(pixel.y, self.height));
        match taps.iter_mut().rev().take(RECENT).find(|tap| tap.column == column && tap.row == row) {
            Some(tap) => tap.weight += weight,
            None => taps.push(Share { column, row, weight }),
        }
    }
}

/// A pixel and what was added up for it so far.
struct Share {
    column: u32,
    row: u32,
    weight: f64,
}
