//! A room from one panorama: a lat-long image projected from its centre on walls, floor and ceiling, as the scenes ATRIUM
//! and BUILDING of Sabbadin, Palma, Banterle, Boubekeur, Cignoni: "High Dynamic Range Expansion of Point Clouds for
//! Real-Time Relighting", 2019, were made.

use std::f64::consts::PI;
use std::ops::RangeInclusive;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::reference::sampling::Random;
use crate::scene::{Cloud, FarField};
use crate::{Error, Result};

/// A box about x = z = 0 that stands on y = 0, and how it is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PanoramaRoom {
    /// Width (x), height (y) and depth (z), metres, each in [`PanoramaRoom::SIDES`].
    pub size: Vec3,
    /// Where the panorama was taken: (0, `eye_height`, 0), metres, above the floor and below the ceiling.
    pub eye_height: f32,
    /// About how many points the cloud gets, in [`PanoramaRoom::POINTS`].
    pub points: usize,
    /// Seed of the points' places in their cells.
    pub seed: u64,
}

impl PanoramaRoom {
    /// What a side of the box may be, metres.
    pub const SIDES: RangeInclusive<f32> = 0.01..=10_000.0;
    /// How many points there may be: at the most a gigabyte and a half of them.
    pub const POINTS: RangeInclusive<usize> = 6..=1 << 25;

    fn check(&self) -> Result<()> {
        let Self { size, eye_height, points, .. } = *self;
        if !size.to_array().iter().all(|side| Self::SIDES.contains(side)) {
            let (low, high) = (Self::SIDES.start(), Self::SIDES.end());
            return Err(Error::Argument(format!("a room is {low} to {high} m on each side, not {size}")));
        }
        if !(eye_height > 0.0 && eye_height < size.y) {
            let height = size.y;
            return Err(Error::Argument(format!(
                "the eye is inside of the room, above 0 and below its height of {height} m, not at {eye_height} m"
            )));
        }
        if !Self::POINTS.contains(&points) {
            let (low, high) = (Self::POINTS.start(), Self::POINTS.end());
            return Err(Error::Limit(format!("a room has {low} to {high} points, not {points}")));
        }
        Ok(())
    }
}

/// The inside of the box as a cloud, complete with normals and spacing. Each face is cut into cells of nearly the same
/// area and shape, each with one point near its middle; the point's colour is the mean radiance that the eye sees
/// through the whole cell, so that a sun smaller than a cell is neither missed nor counted twice.
///
/// # Errors
/// [`Error::Argument`] and [`Error::Limit`] for options outside of their bounds, or a panorama without texels.
pub fn panorama_room(panorama: &FarField, options: &PanoramaRoom) -> Result<Cloud> {
    options.check()?;
    if panorama.radiance.is_empty() {
        return Err(Error::Argument("a panorama without texels cannot be projected".into()));
    }
    let eye = DVec3::new(0.0, options.eye_height.into(), 0.0);
    let mut cloud = Cloud::default();
    for (number, face) in faces(options).iter().enumerate() {
        let cells = face.columns * face.rows;
        let points: Vec<(Vec3, Vec3)> = (0..cells)
            .into_par_iter()
            .map(|cell| {
                let (column, row) = (cell % face.columns, cell / face.columns);
                let jitter = Random::new((number as u64) << 32 | cell as u64, options.seed).square();
                let inside = 0.375 + 0.25 * jitter.as_dvec2();
                let point = face.at(column as f64 + inside.x, row as f64 + inside.y);
                (point.as_vec3(), face.radiance(panorama, eye, column, row))
            })
            .collect();
        cloud.positions.extend(points.iter().map(|point| point.0));
        cloud.colors.extend(points.iter().map(|point| point.1));
        cloud.normals.extend(std::iter::repeat_n(face.normal.as_vec3(), cells));
        cloud.spacing.extend(std::iter::repeat_n(face.step_u.cross(face.step_v).length().sqrt() as f32, cells));
    }
    Ok(cloud)
}

/// One side of the box, cut into cells.
struct Face {
    corner: DVec3,
    /// Along a row from one cell to the next.
    step_u: DVec3,
    /// From one row to the next.
    step_v: DVec3,
    columns: usize,
    rows: usize,
    /// Unit, into the room.
    normal: DVec3,
}

/// All six, their numbers of cells in proportion to their areas.
fn faces(options: &PanoramaRoom) -> [Face; 6] {
    let size = options.size.as_dvec3();
    let total = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
    let cell_area = total / options.points as f64;
    [(0, 0.0), (0, 1.0), (1, 0.0), (1, 1.0), (2, 0.0), (2, 1.0)].map(|(axis, side)| {
        // u is the shorter edge: a strip narrower than a cell is one cell wide, and still has as many as its area asks.
        let (mut u, mut v) = ((axis + 1) % 3, (axis + 2) % 3);
        if size[u] > size[v] {
            (u, v) = (v, u);
        }
        let columns = (size[u] / cell_area.sqrt()).round().max(1.0);
        let rows = (size[u] * size[v] / cell_area / columns).round().max(1.0);
        let unit =
            |axis: usize, length: f64| DVec3::from_array([0, 1, 2].map(|n| if n == axis { length } else { 0.0 }));
        Face {
            corner: DVec3::new(-0.5 * size.x, 0.0, -0.5 * size.z) + unit(axis, side * size[axis]),
            step_u: unit(u, size[u] / columns),
            step_v: unit(v, size[v] / rows),
            columns: columns as usize,
            rows: rows as usize,
            normal: unit(axis, 1.0 - 2.0 * side),
        }
    })
}

impl Face {
    /// The place at (u, v), counted in cells.
    fn at(&self, u: f64, v: f64) -> DVec3 {
        self.corner + self.step_u * u + self.step_v * v
    }

    /// Mean of the radiance over a cell, by solid angle at `eye`.
    fn radiance(&self, panorama: &FarField, eye: DVec3, column: usize, row: usize) -> Vec3 {
        // Two samples along a texel find the smallest sun and get a wall right; but samples beat with texels, and a sun
        // of one texel came out up to 4 % wrong.
        let (mean, brightest) = self.mean(panorama, eye, (column, row), 2.0);
        if brightest > 4.0 * mean.max_element() { self.mean(panorama, eye, (column, row), 16.0).0 } else { mean }
    }

    /// Mean from so many samples along a texel, and the largest value among them.
    fn mean(&self, panorama: &FarField, eye: DVec3, (column, row): (usize, usize), density: f64) -> (Vec3, f32) {
        let (column, row) = (column as f64, row as f64);
        let nearest = self.nearest(eye, column, row).distance(eye);
        let samples = |step: DVec3| {
            let angle = (step.length() / nearest).min(PI);
            (density * angle * f64::from(panorama.height) / PI).ceil().max(4.0)
        };
        let (across, along) = (samples(self.step_u), samples(self.step_v));
        let (mut sum, mut weight, mut brightest) = (DVec3::ZERO, 0.0, 0.0_f32);
        for j in 0..along as u32 {
            let v = row + (f64::from(j) + 0.5) / along;
            for i in 0..across as u32 {
                let u = column + (f64::from(i) + 0.5) / across;
                let seen = self.at(u, v) - eye;
                let distance = seen.length();
                // Solid angle of a piece of area: cosine / distance^2; what all pieces share is left out.
                let solid_angle = distance.powi(-3);
                let radiance = panorama.sample((seen / distance).as_vec3());
                sum += radiance.as_dvec3() * solid_angle;
                weight += solid_angle;
                brightest = brightest.max(radiance.max_element());
            }
        }
        ((sum / weight).as_vec3(), brightest)
    }

    /// The place of a cell that is nearest to `eye`.
    fn nearest(&self, eye: DVec3, column: f64, row: f64) -> DVec3 {
        let from_corner = eye - self.corner;
        let along = |step: DVec3, first: f64| (from_corner.dot(step) / step.length_squared()).clamp(first, first + 1.0);
        self.at(along(self.step_u, column), along(self.step_v, row))
    }
}
