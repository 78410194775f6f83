//! The nearest neighbours of every point, which normals and spacing are both estimated from: one pass for the two.

use glam::{DQuat, DVec3, EulerRot, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZero;

use super::{normals, spacing};
use crate::scene::Cloud;
use crate::{Error, Result};

/// Neighbours that [`complete`] looks at for each point: enough to average noise out of a plane fit, few enough to
/// stay on one side of a box.
pub const DEFAULT_NEIGHBOURS: usize = 16;

/// Gives a cloud the normals and the spacing that it lacks. Normals that the file has are kept; zero ones (where the
/// scanner software gave up) are estimated like missing ones.
///
/// Estimated normals look towards the cloud's viewpoint when it is known, else towards `orient_towards` (in the
/// space of [`Cloud::positions`]), else towards the centre of the bounding box, which is right for a scanned room.
///
/// # Errors
/// [`Error::Limit`] when there are more than 2^32 - 1 points.
pub fn complete(cloud: &mut Cloud, orient_towards: Option<Vec3>) -> Result<()> {
    let needs_normals = cloud.normals.len() != cloud.len() || cloud.normals.contains(&Vec3::ZERO);
    let needs_spacing = cloud.spacing.len() != cloud.len();
    if !needs_normals {
        if needs_spacing {
            cloud.spacing = spacing::estimate(&cloud.positions, DEFAULT_NEIGHBOURS)?;
        }
        return Ok(());
    }
    let target = cloud.viewpoint.or(orient_towards).unwrap_or_else(|| box_centre(&cloud.positions));
    let (normals, spacing) = normals_and_spacing(&cloud.positions, DEFAULT_NEIGHBOURS, target)?;
    if cloud.normals.len() == normals.len() {
        for (kept, estimated) in cloud.normals.iter_mut().zip(normals) {
            if *kept == Vec3::ZERO {
                *kept = estimated;
            }
        }
    } else {
        cloud.normals = normals;
    }
    if needs_spacing {
        cloud.spacing = spacing;
    }
    Ok(())
}

/// [`normals::estimate`] and [`spacing::estimate`] from one search: (unit normals, spacing in metres).
///
/// # Errors
/// [`Error::Limit`] when there are more than 2^32 - 1 points.
pub fn normals_and_spacing(positions: &[Vec3], k: usize, towards: Vec3) -> Result<(Vec<Vec3>, Vec<f32>)> {
    let estimates = map(positions, k, |around| {
        let normal = normals::fit(around, towards);
        (normal, spacing::of(around, normal))
    })?;
    Ok(estimates.into_iter().unzip())
}

/// One distinct position and what lies around it.
pub(super) struct Neighbourhood<'a> {
    /// The position.
    pub position: Vec3,
    /// How many points of the cloud lie at exactly this position; at least 1.
    pub copies: u32,
    /// From `position` to its nearest distinct neighbours, nearest first, in f64 so that differences of squares keep
    /// their digits. At most k; empty when all points coincide.
    pub offsets: &'a [DVec3],
}

/// Calls `f` once for each distinct position with its `k` nearest distinct neighbours, in parallel, and returns the
/// results in the order of `positions`. The same input gives the same output, whatever the number of threads.
///
/// Coinciding points count as one position: were they neighbours of each other, 20 copies of a point would see
/// nothing but themselves.
pub(super) fn map<T: Copy + Default + Send + Sync>(
    positions: &[Vec3],
    k: usize,
    f: impl Fn(&Neighbourhood) -> T + Sync,
) -> Result<Vec<T>> {
    let order = spatial_order(positions);
    let runs: Vec<&[(u64, [f32; 3], u32)]> = order.chunk_by(|a, b| a.1 == b.1).collect();
    let distinct: Vec<[f32; 3]> = runs.iter().map(|run| run[0].1).collect();
    let turned = turn(&distinct);
    let tree: ImmutableKdTree<f32, 3> = ImmutableKdTree::new_from_slice(&turned)
        .map_err(|_| Error::Limit(format!("a cloud holds at most {} points, not {}", u32::MAX, positions.len())))?;
    // One more than asked for: the position itself is its own nearest.
    let count = NonZero::new(k.max(1).min(distinct.len().saturating_sub(1)) + 1).unwrap_or(NonZero::<usize>::MIN);
    let results: Vec<T> = runs
        .par_iter()
        .enumerate()
        .map_init(Vec::new, |offsets, (at, run)| {
            let position = Vec3::from(run[0].1);
            offsets.clear();
            // Distances come from the positions themselves: turning has rounded the tree's.
            for near in tree.query(&turned[at]).nearest_n::<SquaredEuclidean<f32>>(count).execute() {
                if near.item as usize != at {
                    offsets.push(Vec3::from(distinct[near.item as usize]).as_dvec3() - position.as_dvec3());
                }
            }
            // Rounding may have put another position where this one is, and left it out of its own neighbours.
            offsets.truncate(k.max(1));
            f(&Neighbourhood { position, copies: run.len() as u32, offsets })
        })
        .collect();
    let mut in_order = vec![T::default(); positions.len()];
    for (run, result) in runs.iter().zip(results) {
        for &(_, _, index) in *run {
            in_order[index as usize] = result;
        }
    }
    Ok(in_order)
}

/// The positions turned by an odd rotation. Floors and walls are planes across an axis, and half of a k-d tree's
/// splits along that axis tell nothing apart: a million points on the floor took six times as long as a million in a
/// cube, and take as long once the floor is oblique.
pub(super) fn turn(positions: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let rotation = DQuat::from_euler(EulerRot::XYZ, 0.61, 0.83, 0.47);
    let start = positions.first().map_or(DVec3::ZERO, |&p| Vec3::from(p).as_dvec3());
    positions.par_iter().map(|&p| (rotation * (Vec3::from(p).as_dvec3() - start)).as_vec3().to_array()).collect()
}

/// All points along a Morton curve as (key, position, index), equal positions side by side. Neighbours in the list are
/// neighbours in space, so that consecutive searches walk the same few leaves of the tree.
pub(super) fn spatial_order(positions: &[Vec3]) -> Vec<(u64, [f32; 3], u32)> {
    let (lo, hi) = bounds(positions);
    let scale = ((1u32 << 21) - 1) as f32 / (hi - lo).max_element().max(f32::MIN_POSITIVE);
    let mut order: Vec<(u64, [f32; 3], u32)> = positions
        .par_iter()
        .enumerate()
        .map(|(index, &p)| {
            let cell = ((p - lo) * scale).as_uvec3();
            let key = spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2;
            // Adding zero turns -0.0 into 0.0: one position must not have two spellings.
            (key, (p + Vec3::ZERO).to_array(), index as u32)
        })
        .collect();
    order.par_sort_unstable_by_key(|&(key, position, index)| (key, position.map(f32::to_bits), index));
    order
}

/// The low 21 bits with two zeros between each: abc -> a00b00c.
fn spread(bits: u32) -> u64 {
    let mut x = u64::from(bits & 0x1f_ffff);
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// Axis-aligned bounds: (minimum, maximum).
pub(super) fn bounds(positions: &[Vec3]) -> (Vec3, Vec3) {
    positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)))
}

/// Middle of the bounding box.
fn box_centre(positions: &[Vec3]) -> Vec3 {
    let (lo, hi) = bounds(positions);
    0.5 * lo + 0.5 * hi
}
