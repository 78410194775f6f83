//! Which panorama a frame number stands for. It depends on the number alone, so that frames may be asked for in any
//! order, by any number of threads.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::files::Files;
use super::resample::resample;
use super::{Mapping, Unwrapper};
use crate::formats::image::read_probe;
use crate::scene::{FarField, Picture};
use crate::{Error, Result};

/// How the files of a sequence become panoramas.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceOptions {
    /// What the pictures show.
    pub mapping: Mapping,
    /// Rows of the panoramas, 1 to 16384, which are then twice as wide; none: as [`Unwrapper::new`] has it.
    pub height: Option<u32>,
    /// Degrees a second by which the light turns about +Y, counter-clockwise seen from above, as an object's placement
    /// does: with 90, what is at +Z in frame 0 is at +X a second later, and in the panorama things move to the left.
    pub turn: f64,
    /// Frames a second.
    pub rate: f64,
    /// What the sequence changes into.
    pub cross_fade: Option<CrossFade>,
}

impl Default for SequenceOptions {
    fn default() -> Self {
        Self { mapping: Mapping::LatLong, height: None, turn: 0.0, rate: 25.0, cross_fade: None }
    }
}

/// A change from one sequence to another.
#[derive(Clone, Debug, PartialEq)]
pub struct CrossFade {
    /// File, folder or pattern of the other sequence, whose frames have the same mapping and the same numbers.
    pub to: PathBuf,
    /// The last frame that has nothing of the other sequence, and the first that has nothing else. Between them its
    /// part grows evenly, in linear radiance. Where both are one frame, that one is the other sequence's.
    pub frames: RangeInclusive<u64>,
}

impl CrossFade {
    /// Part of the other sequence in a frame, from 0 to 1.
    pub fn weight(&self, number: u64) -> f32 {
        let (start, end) = (*self.frames.start(), *self.frames.end());
        if number >= end { 1.0 } else { (number.saturating_sub(start) as f64 / (end - start) as f64) as f32 }
    }

    /// First frame that has something of the other sequence.
    fn first(&self) -> u64 {
        self.frames.start().saturating_add(1).min(*self.frames.end())
    }
}

/// Panoramas by frame number.
#[derive(Debug)]
pub struct ProbeSequence {
    probe: Probe,
    other: Option<(Probe, CrossFade)>,
    /// Degrees a second.
    turn: f64,
    /// Frames a second.
    rate: f64,
}

impl ProbeSequence {
    /// Opens a sequence, whose first good frame is read. `path` is
    /// - one .exr or .hdr file, which is then every frame, without end,
    /// - a folder, whose .exr and .hdr files are the frames from 0, in natural order (`9.exr` before `10.exr`), or
    /// - a pattern like `probes/probe.####.exr`: the frames have the numbers in the files' names, of as many digits as
    ///   there are `#` or more. Missing ones are holes: errors of [`Self::frame`].
    ///
    /// # Errors
    /// [`Error::File`] where nothing matches or no frame can be read. [`Error::Argument`] where an option is out of
    /// its range, or a cross-fade needs a frame that the other sequence has not.
    pub fn open(path: &Path, options: &SequenceOptions) -> Result<Self> {
        let &SequenceOptions { mapping, height, turn, rate, ref cross_fade } = options;
        if !(rate.is_finite() && rate > 0.0 && turn.is_finite()) {
            return Err(Error::Argument(format!(
                "a probe cannot turn {turn} degrees a second at {rate} frames a second"
            )));
        }
        if let Some(rows) = height.filter(|rows| !(1..=16384).contains(rows)) {
            return Err(Error::Argument(format!("a panorama cannot have {rows} rows: expected 1 to 16384")));
        }
        let probe = Probe::open(path, mapping, height)?;
        let other = match cross_fade {
            Some(fade) => Some((probe.other(mapping, fade)?, fade.clone())),
            None => None,
        };
        Ok(Self { probe, other, turn, rate })
    }

    /// The first and the last frame; none where every number has one. With a cross-fade, up to the end of the sequence
    /// that ends first.
    pub fn frames(&self) -> Option<RangeInclusive<u64>> {
        let own = self.probe.files.range();
        match (own, self.other.as_ref().and_then(|(other, _)| other.files.range())) {
            (Some(own), Some(other)) => Some(*own.start()..=*own.end().min(other.end())),
            (None, Some(other)) => Some(0..=*other.end()),
            (own, None) => own,
        }
    }

    /// Width and height of the panoramas, texels.
    pub fn size(&self) -> (u32, u32) {
        self.probe.unwrapper.size()
    }

    /// The panorama of a frame: read, unwrapped, blended and turned. Values that are negative or not finite are taken
    /// as [`crate::formats::image::read_far_field`] takes them.
    ///
    /// # Errors
    /// [`Error::File`] where the frame's file is missing, damaged or of another size than the first good one.
    pub fn frame(&self, number: u64) -> Result<FarField> {
        let (width, height) = self.size();
        let mut panorama = match &self.other {
            Some((other, fade)) if fade.weight(number) == 1.0 => resample(other.panorama(number)?, width, height),
            Some((other, fade)) if fade.weight(number) > 0.0 => {
                let mut panorama = self.probe.panorama(number)?;
                let other = resample(other.panorama(number)?, width, height);
                let weight = fade.weight(number);
                let texels = panorama.radiance.par_iter_mut().zip(&other.radiance);
                texels.for_each(|(texel, &other)| *texel = texel.lerp(other, weight));
                panorama
            }
            _ => self.probe.panorama(number)?,
        };
        let degrees = (self.turn * number as f64 / self.rate).rem_euclid(360.0);
        turn(&mut panorama, degrees / 360.0 * f64::from(width));
        Ok(panorama)
    }
}

/// Moves what a panorama shows to the left, with linear interpolation between whole texels.
fn turn(panorama: &mut FarField, texels: f64) {
    // Angles that are not binary fractions miss whole texels by their rounding only.
    let texels = if (texels - texels.round()).abs() < 1e-6 { texels.round() } else { texels };
    let width = panorama.width as usize;
    let (whole, part) = (texels as usize % width, (texels - texels.floor()) as f32);
    if whole == 0 && part == 0.0 {
        return;
    }
    panorama.radiance.par_chunks_mut(width).for_each(|row| {
        row.rotate_left(whole);
        if part > 0.0 {
            let first = row[0];
            for x in 0..width {
                row[x] = row[x].lerp(*row.get(x + 1).unwrap_or(&first), part);
            }
        }
    });
}

/// One sequence as its files have it.
#[derive(Debug)]
struct Probe {
    files: Files,
    unwrapper: Unwrapper,
    /// Width and height of the pictures.
    size: (u32, u32),
    /// The panorama of a sequence of one file.
    still: Option<FarField>,
}

impl Probe {
    fn open(path: &Path, mapping: Mapping, height: Option<u32>) -> Result<Self> {
        let files = Files::find(path)?;
        let mut problem = None;
        let first = files.all().into_iter().find_map(|file| match read_probe(file) {
            Ok(picture) => Some((file, picture)),
            Err(error) => {
                problem.get_or_insert(error);
                None
            }
        });
        let Some((file, picture)) = first else {
            return Err(problem.unwrap_or_else(|| Error::file(path, "has no frames")));
        };
        let size @ (width, high) = (picture.width, picture.height);
        if mapping == Mapping::LatLong && (i64::from(width) - 2 * i64::from(high)).abs() > 1 {
            tracing::warn!("{}: {width}x{high} is not 2:1, as a lat-long panorama should be", file.display());
        }
        let unwrapper = Unwrapper::new(size, mapping, height);
        let still = match files {
            Files::One(_) => Some(unwrapper.unwrap(picture)?),
            Files::Many { .. } => None,
        };
        Ok(Self { files, unwrapper, size, still })
    }

    /// The sequence that this one fades to.
    fn other(&self, mapping: Mapping, fade: &CrossFade) -> Result<Self> {
        let (start, end) = (*fade.frames.start(), *fade.frames.end());
        if start > end {
            return Err(Error::Argument(format!("a cross-fade cannot end at frame {end} and begin at frame {start}")));
        }
        let (width, height) = self.unwrapper.size();
        // Lat-long pictures keep their own size, as this one's may not be 2:1.
        let rows = if mapping == Mapping::LatLong { None } else { Some(height) };
        let mut other = Self::open(&fade.to, mapping, rows)?;
        let first = self.files.range().map_or(fade.first(), |own| fade.first().max(*own.start()));
        if let Some(range) = other.files.range().filter(|range| !range.contains(&first)) {
            let (path, start, end) = (fade.to.display(), range.start(), range.end());
            return Err(Error::Argument(format!(
                "a cross-fade needs frame {first} of {path}, which has frames {start} to {end}"
            )));
        }
        other.still = other.still.map(|still| resample(still, width, height));
        Ok(other)
    }

    /// The panorama of a frame.
    fn panorama(&self, number: u64) -> Result<FarField> {
        if let Some(still) = &self.still {
            return Ok(still.clone());
        }
        let file = self.files.of(number)?;
        let picture = read_probe(file)?;
        let ((width, height), Picture { width: w, height: h, .. }) = (self.size, &picture);
        if (width, height) != (*w, *h) {
            return Err(Error::file(file, format!("has {w}x{h} pixels; its sequence has {width}x{height}")));
        }
        self.unwrapper.unwrap(picture)
    }
}
