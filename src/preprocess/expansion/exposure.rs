//! The exposure that brings the photo to the cloud's own range (Sabbadin 2019, 4.1): the luminance histograms of the
//! photo at several exposures are compared with the cloud's by the Wasserstein distance (Chan, Esedoglu and Ni 2007).

use glam::Vec3;
use rayon::prelude::*;

use crate::compare::luminance;
use crate::scene::Picture;

/// Bins of a histogram.
pub const BINS: usize = 128;
/// Steps of the search between the bracketed exposures, at most.
const STEPS: u32 = 50;
/// The search ends when its interval is this small, relative to its middle.
const PRECISION: f32 = 2e-3;
/// Bracketed exposures lie this many to a stop: the distance has small side minima that a finer comb passes over.
const PER_STOP: i32 = 4;
/// Luminances that are looked at; larger pictures and clouds are sampled evenly.
const MOST_SAMPLES: usize = 1 << 20;

/// Normalised histogram of luminance from 0 to 1; what is brighter falls into the last bin.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram(pub [f64; BINS]);

impl Histogram {
    /// Of linear luminances, each multiplied by `gain`.
    pub fn new(luminances: &[f32], gain: f32) -> Self {
        let mut counts = [0_u64; BINS];
        for &luminance in luminances {
            // The cast saturates: negative values fall into the first bin.
            counts[((luminance * gain * BINS as f32) as usize).min(BINS - 1)] += 1;
        }
        Self(counts.map(|count| count as f64 / luminances.len().max(1) as f64))
    }

    /// Wasserstein distance of order 1, in units of luminance: the area between the cumulative histograms.
    pub fn distance(&self, other: &Self) -> f64 {
        let (mut gap, mut area) = (0.0, 0.0);
        for (a, b) in self.0.iter().zip(&other.0) {
            gap += a - b;
            area += f64::abs(gap);
        }
        area / BINS as f64
    }
}

/// An exposure, and all that were tried on the way.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposure {
    /// What the photo's values are multiplied by (Eq. 1).
    pub alpha: f32,
    /// Distance there.
    pub distance: f64,
    /// (alpha, distance) in rising order of alpha.
    pub curve: Vec<(f32, f64)>,
}

/// Finds the exposure at which the photo's histogram is nearest to the cloud's. `None` for a photo without any light.
pub fn match_histograms(photo: &Picture, cloud: &[Vec3]) -> Option<Exposure> {
    let sampled = |colors: &[Vec3]| -> Vec<f32> {
        let step = colors.len().div_ceil(MOST_SAMPLES).max(1);
        colors.iter().step_by(step).map(|&color| luminance(color)).collect()
    };
    let (photo, cloud) = (sampled(&photo.rgb), sampled(cloud));
    let target = Histogram::new(&cloud, 1.0);
    let distance = |alpha: f32| Histogram::new(&photo, alpha).distance(&target);

    // From where the brightest pixel falls into the first bin to where half of all that are lit clip.
    let mut lit: Vec<f32> = photo.iter().copied().filter(|&y| y > 0.0).collect();
    lit.sort_unstable_by(f32::total_cmp);
    let (brightest, middle) = (*lit.last()?, lit[lit.len() / 2]);
    let first = (1.0 / (BINS as f32 * brightest)).log2().floor() as i32 * PER_STOP;
    let last = (1.0 / middle).log2().ceil() as i32 * PER_STOP;
    let of_step = |step: i32| (step as f32 / PER_STOP as f32).exp2();
    let mut curve: Vec<(f32, f64)> =
        (first..=last.max(first)).into_par_iter().map(|step| (of_step(step), distance(of_step(step)))).collect();
    let best = (0..curve.len()).min_by(|&a, &b| curve[a].1.total_cmp(&curve[b].1))?;
    let (mut low, mut high) = (curve[best].0 / of_step(1), curve[best].0 * of_step(1));

    // Golden section: each step keeps the part that holds the smaller distance.
    const GOLDEN: f32 = 0.618_034;
    let inner = |low: f32, high: f32| (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut left, mut right) = inner(low, high);
    let (mut at_left, mut at_right) = (distance(left), distance(right));
    for _ in 0..STEPS {
        curve.extend([(left, at_left), (right, at_right)]);
        if high - low < PRECISION * low {
            break;
        }
        if at_left <= at_right {
            (high, right, at_right) = (right, left, at_left);
            left = inner(low, high).0;
            at_left = distance(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = inner(low, high).1;
            at_right = distance(right);
        }
    }
    curve.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    curve.dedup_by_key(|point| point.0);
    let (alpha, distance) = curve.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(Exposure { alpha, distance, curve })
}
