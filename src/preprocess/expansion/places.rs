//! Where shots are taken from, when nobody says: the paper leaves this to a person ("from the best positions, i.e. to
//! see the most important over-exposed areas"). Places are chosen greedily, each for what it adds to those before it.

use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;

use super::scouts::{Scouts, Sketch};
use crate::preprocess::neighbours::bounds;
use crate::scene::Cloud;

/// Over-exposed points that places are judged by, at most.
const SAMPLES: usize = 4096;
/// A point hidden by less than this share of its distance is seen: scouts are coarse.
const HIDDEN: f32 = 0.06;
/// Cells along the longest side of the cloud, for telling lights apart.
const CELLS: f32 = 48.0;
/// The best distance, as a share of the median one from all places: from farther away lights are small, from nearer their
/// surroundings are out of sight, and a lamp looks like a window.
const BEST_DISTANCE: f32 = 0.8;

/// Up to `count` places, best first; fewer where more would add nothing.
pub(super) fn choose(cloud: &Cloud, scouts: &Scouts, over: &[bool], count: usize) -> Vec<Vec3> {
    let all: Vec<usize> = (0..cloud.len()).filter(|&n| over[n]).collect();
    let step = all.len().div_ceil(SAMPLES).max(1);
    let samples: Vec<usize> = all.into_iter().step_by(step).collect();
    let mut distances: Vec<f32> =
        scouts.sketches.iter().flat_map(|s| samples.iter().map(|&n| s.eye.distance(cloud.positions[n]))).collect();
    if distances.is_empty() {
        return Vec::new();
    }
    let middle = distances.len() / 2;
    let near = BEST_DISTANCE * *distances.select_nth_unstable_by(middle, f32::total_cmp).1;
    let shares = shares(&samples.iter().map(|&n| cloud.positions[n]).collect::<Vec<_>>(), cloud);
    let views: Vec<Vec<f32>> = scouts
        .sketches
        .par_iter()
        .map(|sketch| samples.iter().zip(&shares).map(|(&n, share)| share * worth(sketch, cloud, n, near)).collect())
        .collect();
    let mut best = vec![0.0_f32; samples.len()];
    let mut chosen: Vec<usize> = Vec::new();
    while chosen.len() < count {
        let gain = |view: &Vec<f32>| view.iter().zip(&best).map(|(new, old)| (new - old).max(0.0)).sum::<f32>();
        let gains: Vec<f32> = views.par_iter().map(gain).collect();
        // The first of equals, so that the order of places decides.
        let Some(next) = (0..views.len()).rev().max_by(|&a, &b| gains[a].total_cmp(&gains[b])) else { break };
        if gains[next] <= 0.0 {
            break;
        }
        best.iter_mut().zip(&views[next]).for_each(|(best, new)| *best = best.max(*new));
        chosen.push(next);
    }
    chosen.into_iter().map(|n| scouts.sketches[n].eye).collect()
}

/// What a sample counts for: one over the number of samples of its light, so that a lamp of a few hundred points counts
/// for as much as a window of thousands. Samples belong to one light where cells of a grid touch.
fn shares(samples: &[Vec3], cloud: &Cloud) -> Vec<f32> {
    let (low, high) = bounds(&cloud.positions);
    let cell = (high - low).max_element().max(f32::MIN_POSITIVE) / CELLS;
    let key = |position: Vec3| ((position - low) / cell).as_ivec3();
    let mut lights: BTreeMap<[i32; 3], usize> = BTreeMap::new();
    for &sample in samples {
        lights.insert(key(sample).to_array(), usize::MAX);
    }
    let cells: Vec<[i32; 3]> = lights.keys().copied().collect();
    let mut count = 0;
    for start in cells {
        let mut open = vec![start];
        while let Some(cell) = open.pop() {
            match lights.get_mut(&cell) {
                Some(light) if *light == usize::MAX => *light = count,
                _ => continue,
            }
            let steps = (0..27).map(|n| [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1]);
            open.extend(steps.map(|step: [i32; 3]| [0, 1, 2].map(|axis| cell[axis] + step[axis])));
        }
        count += 1;
    }
    let light_of: Vec<usize> = samples.iter().map(|&sample| lights[&key(sample).to_array()]).collect();
    let mut sizes = vec![0_u32; count];
    light_of.iter().for_each(|&light| sizes[light] += 1);
    light_of.into_iter().map(|light| 1.0 / sizes[light] as f32).collect()
}

/// How well a place sees a point, 0 to 1: from a good distance, from in front, and at all.
fn worth(sketch: &Sketch, cloud: &Cloud, point: usize, near: f32) -> f32 {
    let to = cloud.positions[point] - sketch.eye;
    let distance = to.length();
    let (face_depth, _) = sketch.towards(to);
    // The axis of a cubemap's face is the largest component.
    let depth = to.abs().max_element();
    // False for a NaN.
    let is_seen = depth <= face_depth * (1.0 + HIDDEN) + cloud.spacing[point];
    if !is_seen || distance <= 0.0 {
        return 0.0;
    }
    let cosine = -to.dot(cloud.normals[point]) / distance;
    let relative = distance / near;
    cosine.max(0.0) * 2.0 * relative.powi(2) / (1.0 + relative.powi(4))
}
