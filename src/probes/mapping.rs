//! From the picture of a light probe to a panorama.

use std::f64::consts::PI;
use std::fmt;
use std::str::FromStr;

use glam::Vec3;
use rayon::prelude::*;

use super::circle::{Circle, HalfRow, Tap};
use super::resample::resample;
use crate::scene::{FarField, Picture};
use crate::{Error, Result};

/// How a picture shows the sphere of directions.
///
/// The world is that of the camera that took the picture: right in the picture is +X, up is +Y, and the camera looks to
/// -Z. A virtual camera that looks to -Z then sees an object lit as the probe was, and text in the panorama is
/// upright and not mirrored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Mapping {
    /// A panorama already: rows are latitudes, +Y first, and the middle is -Z.
    #[default]
    LatLong,
    /// A mirror ball that fills the largest circle in the middle of the picture, seen from far away (Debevec 1998).
    /// Its middle reflects what is behind the camera, +Z, the panorama's left and right edge; its rim reflects what the
    /// ball hides, -Z, the panorama's middle, where it is least sharp.
    MirrorBall,
    /// An angular map in the largest circle in the middle of the picture: -Z in its middle, +Z all along its rim, and
    /// the distance from the middle grows with the angle (Debevec 1998).
    Angular,
}

impl Mapping {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::LatLong, Self::MirrorBall, Self::Angular];

    /// The name it has everywhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::LatLong => "lat-long",
            Self::MirrorBall => "mirror-ball",
            Self::Angular => "angular",
        }
    }

    /// Distance from the middle of the circle, whose radius is 1, to directions with this z.
    pub(super) fn radius(self, z: f64) -> f64 {
        match self {
            // The normal is halfway between the direction and the camera: sin of half the angle from +Z.
            Self::MirrorBall => ((1.0 - z) / 2.0).max(0.0).sqrt(),
            Self::Angular | Self::LatLong => (-z).clamp(-1.0, 1.0).acos() / PI,
        }
    }
}

impl fmt::Display for Mapping {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Mapping {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|mapping| mapping.name() == text)
            .ok_or_else(|| format!("{text:?} is no mapping of a probe; there are lat-long, mirror-ball and angular"))
    }
}

/// The panorama of one picture; see [`Unwrapper::new`] for its size. For many pictures of one size make one
/// [`Unwrapper`].
pub fn unwrap(picture: &Picture, mapping: Mapping, height: Option<u32>) -> FarField {
    Unwrapper::new((picture.width, picture.height), mapping, height).apply(picture.clone())
}

/// Turns pictures of one size and one mapping into panoramas. What each texel is made of is found once; it takes about
/// 35 bytes a texel.
#[derive(Clone, Debug)]
pub struct Unwrapper {
    mapping: Mapping,
    /// Width and height of the pictures.
    source: (u32, u32),
    /// Width and height of the panoramas.
    size: (u32, u32),
    /// The left half of the upper half; none for lat-long pictures.
    rows: Vec<HalfRow>,
}

impl Unwrapper {
    /// For pictures of `source` = (width, height) pixels, of which there is one at least. Panoramas have `height` rows,
    /// at least 1, and are twice as wide; without `height`, half the diameter of the picture's circle made even, at
    /// least 2, or for lat-long pictures their own size.
    pub fn new(source: (u32, u32), mapping: Mapping, height: Option<u32>) -> Self {
        if mapping == Mapping::LatLong {
            let size = height.map_or(source, |height| (2 * height.max(1), height.max(1)));
            return Self { mapping, source, size, rows: Vec::new() };
        }
        let height = height.unwrap_or_else(|| ((source.0.min(source.1) / 2) & !1).max(2)).max(1);
        let circle = Circle::new(mapping, source);
        let rows = (0..height.div_ceil(2)).into_par_iter().map(|row| circle.left_half(row, height)).collect();
        Self { mapping, source, size: (2 * height, height), rows }
    }

    /// Width and height of the panoramas.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// The panorama of `picture`. The sum of radiance times solid angle stays: texels are means over their solid angle,
    /// not samples.
    ///
    /// # Errors
    /// [`Error::Argument`] where the picture has another size.
    pub fn unwrap(&self, picture: Picture) -> Result<FarField> {
        let ((width, height), Picture { width: w, height: h, .. }) = (self.source, &picture);
        if (width, height) != (*w, *h) {
            return Err(Error::Argument(format!("a probe's picture has {w}x{h} pixels instead of {width}x{height}")));
        }
        Ok(self.apply(picture))
    }

    fn apply(&self, picture: Picture) -> FarField {
        let (width, height) = self.size;
        if self.mapping == Mapping::LatLong {
            let panorama = FarField { width: picture.width, height: picture.height, radiance: picture.rgb };
            return resample(panorama, width, height);
        }
        let (columns, rows) = (picture.width as usize, picture.height as usize);
        let mut radiance = vec![Vec3::ZERO; width as usize * height as usize];
        radiance.par_chunks_mut(width as usize).enumerate().for_each(|(row, texels)| {
            let mirrored = height as usize - 1 - row;
            let (left, right) = texels.split_at_mut(height as usize);
            let texels = left.iter_mut().zip(right.iter_mut().rev());
            for ((left, right), taps) in texels.zip(self.rows[row.min(mirrored)].texels()) {
                for &Tap { column, row: source, weight } in taps {
                    let source = if row <= mirrored { source as usize } else { rows - 1 - source as usize };
                    let pixels = &picture.rgb[source * columns..][..columns];
                    *left += weight * pixels[column as usize];
                    *right += weight * pixels[columns - 1 - column as usize];
                }
            }
        });
        FarField { width, height, radiance }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use glam::DVec3;

    use super::*;

    /// A smooth sky of coloured lobes, one a side of the world, none of which is like another.
    fn sky(direction: DVec3) -> Vec3 {
        let lobe = |axis: DVec3, color: Vec3| color * (4.0 * (direction.dot(axis) - 1.0)).exp() as f32;
        lobe(DVec3::X, Vec3::new(3.0, 0.2, 0.1))
            + lobe(DVec3::Y, Vec3::new(0.1, 0.3, 4.0))
            + lobe(DVec3::Z, Vec3::new(0.2, 2.0, 0.1))
            + lobe(DVec3::NEG_Z, Vec3::new(1.0, 0.0, 1.0))
            + 0.1
    }

    /// The direction that a picture of `mapping` shows at (x right, y up) in its circle of radius 1, worked out the
    /// other way around than the code does it; and the solid angle of a unit of the circle's area.
    fn shown(mapping: Mapping, x: f64, y: f64) -> Option<(DVec3, f64)> {
        let radius = x.hypot(y);
        match mapping {
            _ if radius > 1.0 => None,
            Mapping::MirrorBall => {
                let (normal, ray) = (DVec3::new(x, y, (1.0 - radius * radius).sqrt()), DVec3::NEG_Z);
                Some((ray - 2.0 * ray.dot(normal) * normal, 4.0))
            }
            _ => {
                let (sin, cos) = (PI * radius).sin_cos();
                let per_radius = if radius > 0.0 { sin / radius } else { PI };
                Some((DVec3::new(per_radius * x, per_radius * y, -cos), PI * per_radius))
            }
        }
    }

    fn picture(mapping: Mapping, (width, height): (u32, u32), color: impl Fn(u32, u32, DVec3) -> Vec3) -> Picture {
        let mut picture = Picture::black(width, height);
        let radius = f64::from(width.min(height)) / 2.0;
        for (index, pixel) in picture.rgb.iter_mut().enumerate() {
            let (column, row) = (index as u32 % width, index as u32 / width);
            let x = (f64::from(column) + 0.5 - f64::from(width) / 2.0) / radius;
            let y = -(f64::from(row) + 0.5 - f64::from(height) / 2.0) / radius;
            // The background is bright enough for every leak to be seen.
            *pixel = shown(mapping, x, y).map_or(Vec3::splat(1e6), |(direction, _)| color(column, row, direction));
        }
        picture
    }

    fn direction(panorama: &FarField, column: u32, row: u32) -> DVec3 {
        let longitude = ((f64::from(column) + 0.5) / f64::from(panorama.width) - 0.5) * 2.0 * PI;
        let (sin, cos) = ((f64::from(row) + 0.5) / f64::from(panorama.height) * PI).sin_cos();
        DVec3::new(sin * longitude.sin(), cos, -sin * longitude.cos())
    }

    /// The largest difference from the sky among directions whose z is in a range.
    fn largest_error(panorama: &FarField, z: std::ops::Range<f64>) -> f32 {
        let mut largest = 0.0_f32;
        for (index, texel) in panorama.radiance.iter().enumerate() {
            let towards = direction(panorama, index as u32 % panorama.width, index as u32 / panorama.width);
            if z.contains(&towards.z) {
                largest = largest.max((*texel - sky(towards)).abs().max_element());
            }
        }
        largest
    }

    #[test]
    fn pictures_of_a_smooth_sky_become_that_sky() {
        for size in [(256, 256), (301, 256), (256, 300)] {
            let angular = picture(Mapping::Angular, size, |_, _, towards| sky(towards));
            let panorama = unwrap(&angular, Mapping::Angular, None);
            assert_eq!((panorama.width, panorama.height), (256, 128));
            // The rim's outermost half pixel shows +Z only in theory.
            assert!(largest_error(&panorama, -2.0..2.0) < 0.02, "{}", largest_error(&panorama, -2.0..2.0));
            let ball = picture(Mapping::MirrorBall, size, |_, _, towards| sky(towards));
            let panorama = unwrap(&ball, Mapping::MirrorBall, None);
            assert!(largest_error(&panorama, -0.9..2.0) < 0.02, "{}", largest_error(&panorama, -0.9..2.0));
            // Ten degrees around what the ball hides share its rim.
            assert!(largest_error(&panorama, -2.0..2.0) < 0.2, "{}", largest_error(&panorama, -2.0..2.0));
            // Sizes other than the usual one.
            for height in [31, 150] {
                let panorama = unwrap(&ball, Mapping::MirrorBall, Some(height));
                assert_eq!((panorama.width, panorama.height), (2 * height, height));
                assert!(largest_error(&panorama, -0.9..2.0) < 0.06, "{}", largest_error(&panorama, -0.9..2.0));
            }
        }
    }

    #[test]
    fn every_mapping_has_its_name_and_every_picture_a_panorama() {
        for mapping in Mapping::ALL {
            assert_eq!(mapping.to_string().parse(), Ok(mapping));
            for size in [(1, 1), (2, 1), (2, 2), (3, 5)] {
                let even = Picture {
                    rgb: vec![Vec3::new(1.0, 2.0, 3.0); (size.0 * size.1) as usize],
                    ..picture(mapping, size, |_, _, _| Vec3::ZERO)
                };
                for height in [None, Some(1), Some(6)] {
                    let panorama = unwrap(&even, mapping, height);
                    assert_eq!(panorama.radiance.len(), (panorama.width * panorama.height) as usize);
                    let off = |texel: &Vec3| (*texel - even.rgb[0]).abs().max_element();
                    assert!(panorama.radiance.iter().all(|texel| off(texel) < 1e-5), "{mapping} {size:?}");
                }
            }
        }
        assert!("ball".parse::<Mapping>().is_err());
        let unwrapper = Unwrapper::new((4, 4), Mapping::Angular, None);
        let refused = unwrapper.unwrap(Picture::black(4, 5)).unwrap_err().to_string();
        assert!(refused.contains("4x5") && refused.contains("4x4"), "{refused}");
    }

    #[test]
    fn the_world_is_that_of_the_camera() {
        // A ball with a red left, a green top and a blue middle.
        let mut ball = Picture::black(101, 101);
        for (x, y, color) in [(15, 50, Vec3::X), (50, 15, Vec3::Y), (50, 50, Vec3::Z)] {
            for (x, y) in (x - 3..x + 3).flat_map(|x| (y - 3..y + 3).map(move |y| (x, y))) {
                ball.rgb[y * 101 + x] = color;
            }
        }
        let panorama = unwrap(&ball, Mapping::MirrorBall, None);
        // 35 of 50.5 pixels from the middle is where the normal is halfway between the camera and the side.
        assert!(panorama.sample(Vec3::NEG_X).x > 0.9 && panorama.sample(Vec3::Y).y > 0.9);
        assert!(panorama.sample(Vec3::Z).z > 0.9, "the middle reflects the camera");
        let angular = unwrap(&ball, Mapping::Angular, None);
        assert!(angular.sample(Vec3::NEG_Z).z > 0.9, "the middle is straight ahead");
        // 0.69 of the way from -Z to +Z, by way of the side.
        assert!(angular.sample(Vec3::new(-0.8, 0.0, 0.6)).x > 0.9 && angular.sample(Vec3::new(0.0, 0.8, 0.6)).y > 0.9);
    }

    #[test]
    fn small_suns_keep_their_energy() {
        // Suns of one pixel, in panoramas finer and coarser than the picture. Measured: at most 0.020 of a sun's
        // radiance times solid angle is lost or gained with mirror balls, 0.016 with angular maps, and 0.002 and 0.001
        // on average.
        for mapping in [Mapping::MirrorBall, Mapping::Angular] {
            let (mut sum, mut count) = (0.0_f64, 0);
            for height in [8, 50, 64, 90, 128] {
                let unwrapper = Unwrapper::new((200, 200), mapping, Some(height));
                for (column, row) in [(100, 100), (120, 93), (77, 61), (139, 100), (171, 100), (30, 90), (101, 21)] {
                    let sun = |x, y, _| if (x, y) == (column, row) { Vec3::splat(1e4) } else { Vec3::ZERO };
                    let mut sun = picture(mapping, (200, 200), sun);
                    sun.rgb.iter_mut().filter(|pixel| pixel.x == 1e6).for_each(|pixel| *pixel = Vec3::ZERO);
                    let at = |side: u32| (f64::from(side) - 99.5) / 100.0;
                    let (_, per_area) = shown(mapping, at(column), -at(row)).unwrap();
                    let truth = 1e4 * per_area / 1e4;
                    let panorama = unwrapper.unwrap(sun).unwrap();
                    let texel = PI / f64::from(height);
                    let energy: f64 = (0..height)
                        .map(|row| {
                            let band = (f64::from(row) * texel).cos() - (f64::from(row + 1) * texel).cos();
                            let texels = &panorama.radiance[(row * 2 * height) as usize..][..2 * height as usize];
                            texels.iter().map(|texel| f64::from(texel.x)).sum::<f64>() * band * texel
                        })
                        .sum();
                    let error = energy / truth - 1.0;
                    assert!(error.abs() < 0.025, "{mapping} to {height} rows: {error} at {column},{row}");
                    sum += error;
                    count += 1;
                }
            }
            assert!((sum / f64::from(count)).abs() < 0.003, "{mapping}: {} on average", sum / f64::from(count));
        }
    }
}
