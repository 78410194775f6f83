//! Bounding sphere hierarchy over a cloud (Sabbadin 2019, 5.1): Morton codes, sort, leaves, inner nodes (Karras 2012),
//! and one walk that propagates the leaves' attributes upwards, prunes and writes depth first.

mod cone;
mod linearise;
pub(in crate::preprocess) mod morton;
mod nodes;
mod propagate;
mod prune;
mod refit;
mod sort;
mod sphere;
mod tree;

use glam::Vec3;
use rayon::prelude::*;

use super::clock::Clock;
use crate::scene::Cloud;
use crate::{Error, Result};

pub use cone::PackedCone;
pub(crate) use nodes::mean_luminance;
pub use nodes::{Hierarchy, MAX_DEPTH};
pub use prune::ColorRule;
pub use refit::NodeRadiance;

/// How far subtrees of like points are clustered into leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BuildOptions {
    /// t_c of Sabbadin 2019, 5.1: a subtree may become a leaf where its colours are closer together than this (root
    /// mean square distance in linear radiance, see `color_rule`). Zero prunes nothing.
    pub color_threshold: f32,
    /// t_n of Sabbadin 2019, 5.1: ... and the mean dot product of its normals with their mean direction is above this.
    pub normal_threshold: f32,
    /// What `color_threshold` is measured against.
    pub color_rule: ColorRule,
    /// Not in the paper: ... and its sphere has at most this radius, in mean spacings of its points; infinite for the
    /// paper's rule.
    pub max_cluster_radius_in_spacings: f32,
}

impl Default for BuildOptions {
    /// The paper's thresholds, relative to the colour, for clusters of up to four spacings.
    fn default() -> Self {
        Self {
            color_threshold: 0.01,
            normal_threshold: 0.98,
            color_rule: ColorRule::Relative,
            max_cluster_radius_in_spacings: 4.0,
        }
    }
}

impl BuildOptions {
    /// One leaf an occupied cell.
    pub fn unpruned() -> Self {
        Self { color_threshold: 0.0, ..Self::default() }
    }
}

/// What [`build`] did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BuildReport {
    /// Points of the cloud.
    pub points: usize,
    /// Cells of the Morton lattice with a point in them: leaves before pruning.
    pub occupied_cells: usize,
    /// Nodes before pruning.
    pub nodes_before: usize,
    /// Nodes after pruning.
    pub nodes_after: usize,
    /// Leaves after pruning.
    pub leaves_after: usize,
    /// Longest path from the root to a leaf after pruning, in nodes.
    pub depth: u32,
    /// Wall-clock seconds of each step, in order.
    pub seconds: Vec<(&'static str, f64)>,
    /// Most bytes that the builder held at once, the finished hierarchy included and the cloud not; an upper bound,
    /// because places of pruned nodes are counted although most are never touched.
    pub peak_bytes_estimate: usize,
}

/// Largest coordinate, spacing and radiance that is accepted: squares and sums stay finite in f32.
const LARGEST: f32 = 1e15;

/// Builds the hierarchy of `cloud`, which needs normals (unit length, or zero where unknown) and spacing. The result is
/// the same to the byte whatever the number of threads.
///
/// # Errors
///
/// [`Error::Argument`] for a cloud without points, with arrays of different lengths, or with a value that is not finite,
/// beyond 1e15, or negative where that makes no sense; for areas and radiances whose sums overflow; for options that are
/// NaN. [`Error::Limit`] for more than 2^31
/// points.
pub fn build(cloud: &Cloud, options: &BuildOptions) -> Result<(Hierarchy, BuildReport)> {
    let points = cloud.len();
    let mut report = BuildReport { points, ..BuildReport::default() };
    let mut clock = Clock::default();
    check_options(options)?;
    check_lengths(cloud)?;

    // The box around the points, and whether all values make sense.
    let (low, high) = clock.time("check", || check_values(cloud))?;

    // A Morton code for each point.
    let lattice = morton::Lattice::new(low, high);
    let keyed = clock.time("codes", || codes(cloud, lattice));

    // Points along the Morton curve.
    let keyed = clock.time("sort", || sort::sort(keyed));

    // One leaf an occupied cell.
    let cells = clock.time("leaves", || Cells::new(&keyed));
    drop(keyed);
    let leaves = cells.keys.len();
    report.occupied_cells = leaves;
    report.nodes_before = 2 * leaves - 1;

    // Inner nodes.
    let Cells { keys, order, starts } = cells;
    let splits = clock.time("inner nodes", || tree::splits(&keys));
    drop(keys);

    // Attributes from the leaves to the root, pruned and depth first, with gaps where something was pruned.
    let mut hierarchy = linearise::allocate(report.nodes_before);
    let input = propagate::Input { cloud, options, order: &order, starts: &starts, splits: &splits };
    let places = linearise::Places::all(&mut hierarchy);
    let (root, filled) = clock.time("propagate and prune", || input.build(0, 0..leaves, places, 0));
    drop((order, starts, splits));
    if !(root.area.is_finite() && root.area_vector.is_finite() && root.radiance_vector.is_finite()) {
        return Err(Error::Argument(
            "the cloud's areas and radiances are too large together: their sums are not finite; scale it down".into(),
        ));
    }
    hierarchy.depth = root.depth;
    hierarchy.brightest_point = brightest_point(cloud);

    // One run of nodes.
    clock.time("linearise", || linearise::close_gaps(&mut hierarchy, &filled));

    report.nodes_after = hierarchy.len();
    report.leaves_after = hierarchy.len().div_ceil(2);
    report.depth = hierarchy.depth;
    report.seconds = clock.steps;
    report.peak_bytes_estimate = peak_bytes(points, leaves);
    Ok((hierarchy, report))
}

fn check_options(options: &BuildOptions) -> Result<()> {
    let numbers = [options.color_threshold, options.normal_threshold, options.max_cluster_radius_in_spacings];
    if numbers.iter().any(|number| number.is_nan()) {
        return Err(Error::Argument("a pruning threshold is not a number".into()));
    }
    Ok(())
}

fn check_lengths(cloud: &Cloud) -> Result<()> {
    let points = cloud.len();
    if points == 0 {
        return Err(Error::Argument("the cloud has no points to build a hierarchy over".into()));
    }
    // 2 n - 1 nodes, and a skip that may be one beyond them.
    if points > 1 << 31 {
        return Err(Error::Limit(format!("the cloud has {points} points; a hierarchy holds at most 2147483648")));
    }
    let lengths = [("colors", cloud.colors.len()), ("normals", cloud.normals.len()), ("spacings", cloud.spacing.len())];
    match lengths.iter().find(|(_, len)| *len != points) {
        Some((name, len)) => Err(Error::Argument(format!(
            "the cloud has {len} {name} for {points} points; estimate what is missing before building the hierarchy"
        ))),
        None => Ok(()),
    }
}

/// The corners of the box around the points, once every value is known to be usable.
fn check_values(cloud: &Cloud) -> Result<(Vec3, Vec3)> {
    // Largest magnitudes; comparisons that NaN fails.
    let usable = |value: Vec3| value.abs().cmple(Vec3::splat(LARGEST)).all();
    let wrong = |point: usize| {
        let (normal, spacing) = (cloud.normals[point], cloud.spacing[point]);
        match () {
            () if !usable(cloud.positions[point]) => Some("position"),
            () if !(usable(cloud.colors[point]) && cloud.colors[point].min_element() >= 0.0) => Some("color"),
            () if !usable(normal) => Some("normal"),
            () if !(0.0..=LARGEST).contains(&spacing) => Some("spacing"),
            () => None,
        }
    };
    let first_wrong = (0..cloud.len()).into_par_iter().find_map_first(|point| wrong(point).map(|name| (point, name)));
    if let Some((point, name)) = first_wrong {
        return Err(Error::Argument(format!(
            "the {name} of point {point} is not usable: it must be finite, not beyond {LARGEST:e} and, for colors and \
             spacings, not negative"
        )));
    }
    let empty = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    Ok(cloud
        .positions
        .par_iter()
        .fold(|| empty, |(low, high), point| (low.min(*point), high.max(*point)))
        .reduce(|| empty, |a, b| (a.0.min(b.0), a.1.max(b.1))))
}

/// The largest channel of any point's radiance.
fn brightest_point(cloud: &Cloud) -> f32 {
    cloud.colors.par_iter().map(|color| color.max_element()).reduce(|| 0.0, f32::max)
}

/// Every point's Morton code, in the order of the cloud.
fn codes(cloud: &Cloud, lattice: morton::Lattice) -> Vec<sort::Keyed> {
    cloud
        .positions
        .par_iter()
        .enumerate()
        .map(|(index, position)| sort::Keyed { key: lattice.code(*position), index: index as u32 })
        .collect()
}

/// The occupied cells along the Morton curve.
struct Cells {
    /// Codes, strictly increasing.
    keys: Vec<u64>,
    /// Points by cell.
    order: Vec<u32>,
    /// The first point of each cell in `order`, and the number of points at the end.
    starts: Vec<u32>,
}

impl Cells {
    fn new(sorted: &[sort::Keyed]) -> Self {
        let order = sorted.par_iter().map(|item| item.index).collect();
        let (mut keys, mut starts) = (Vec::with_capacity(sorted.len()), Vec::with_capacity(sorted.len() + 1));
        for (start, item) in (0..).zip(sorted) {
            if keys.last() != Some(&item.key) {
                keys.push(item.key);
                starts.push(start);
            }
        }
        starts.push(sorted.len() as u32);
        Self { keys, order, starts }
    }
}

/// The largest of the builder's stages, in bytes.
fn peak_bytes(points: usize, leaves: usize) -> usize {
    let keyed = points * size_of::<sort::Keyed>();
    // Keys by cell, order, starts; splits; nodes.
    let cells = points * (8 + 4 + 4);
    let walk = points * (4 + 4) + leaves * 4 + (2 * leaves - 1) * 68;
    (2 * keyed).max(keyed + cells).max(walk)
}

/// Property tests that ask the same questions every time and leave no files behind.
#[cfg(test)]
fn seeded() -> proptest::test_runner::Config {
    proptest::test_runner::Config {
        rng_seed: proptest::test_runner::RngSeed::Fixed(2019),
        failure_persistence: None,
        ..proptest::test_runner::Config::default()
    }
}
