//! From expanded shots back to the points (Sabbadin 2019, 4.1).

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::shots::Shot;
use crate::scene::Cloud;

/// One face of a shot after its expansion: a value for every pixel.
pub(super) struct Expanded {
    /// Linear HDR colours, where the weight is above 0.
    pub(super) colors: Vec<Vec3>,
    /// What a pixel counts for when several shots see the same point; 0 where it has nothing to say.
    pub(super) weights: Vec<f32>,
    /// What a match cost, with PatchMatch; infinite where there is none. Else empty.
    pub(super) costs: Vec<f32>,
    /// Where in the photo it lies, 0 to 1 from its left and its top. Else empty.
    pub(super) places: Vec<Vec2>,
}

impl Expanded {
    /// Nothing to say about any of these pixels.
    pub(super) fn nothing(pixels: usize) -> Self {
        Self { colors: vec![Vec3::ZERO; pixels], weights: vec![0.0; pixels], costs: Vec::new(), places: Vec::new() }
    }

    /// The same weight for all wanted pixels.
    pub(super) fn equal(colors: Vec<Vec3>, wanted: &[bool]) -> Self {
        let weights = wanted.iter().map(|&wanted| f32::from(u8::from(wanted))).collect();
        Self { colors, weights, costs: Vec::new(), places: Vec::new() }
    }
}

/// Sums over shots, for every over-exposed point.
pub(super) struct Gathered {
    /// Indices of the points.
    pub(super) points: Vec<u32>,
    sums: Vec<Sum>,
}

#[derive(Clone, Copy, Default)]
struct Sum {
    color: Vec3,
    weight: f32,
    /// Shots that saw the point.
    seen: u32,
}

/// Colours that differ by more than this, in any channel, are not of the same thing.
const AGREES: f32 = 0.25;

impl Gathered {
    pub(super) fn new(over: &[bool]) -> Self {
        let points: Vec<u32> = (0..over.len() as u32).filter(|&n| over[n as usize]).collect();
        let sums = vec![Sum::default(); points.len()];
        Self { points, sums }
    }

    /// Adds what a shot says. A value whose LDR colour is not the point's comes from beside it: from the wall beside the
    /// lamp, say.
    pub(super) fn add(&mut self, cloud: &Cloud, shot: &Shot, faces: &[Expanded]) {
        self.points.par_iter().zip(&mut self.sums).for_each(|(&point, sum)| {
            let point = point as usize;
            let Some((face, pixel)) = shot.sees(cloud.positions[point], cloud.spacing[point]) else { return };
            sum.seen += 1;
            let (color, weight) = (faces[face].colors[pixel], faces[face].weights[pixel]);
            if weight > 0.0 && (color.min(Vec3::ONE) - cloud.colors[point].min(Vec3::ONE)).abs().max_element() < AGREES
            {
                sum.color += color * weight;
                sum.weight += weight;
            }
        });
    }

    /// (seen in no shot, seen but without a value).
    pub(super) fn missing(&self) -> (usize, usize) {
        let unseen = self.sums.iter().filter(|sum| sum.seen == 0).count();
        let without = self.sums.iter().filter(|sum| sum.seen > 0 && sum.weight <= 0.0).count();
        (unseen, without)
    }

    /// Weighted means: (point, colour or nothing).
    pub(super) fn means(&self) -> impl Iterator<Item = (u32, Option<Vec3>)> + '_ {
        let mean = |sum: &Sum| (sum.weight > 0.0).then(|| sum.color / sum.weight);
        self.points.iter().zip(&self.sums).map(move |(&point, sum)| (point, mean(sum)))
    }
}
