//! From the leaves to the root: what a node knows about the points below it (Sabbadin 2019, 5.1), in one walk down and
//! up the tree of [`super::tree`], which prunes and writes depth first as it returns. Halves of large subtrees are
//! walked in parallel and merged in the same order always, so the result does not depend on the threads.

use std::ops::Range;

use glam::{DVec3, Vec3};

use super::linearise::{Places, Run};
use super::prune::LUMINANCE;
use super::{BuildOptions, PackedCone, cone, prune, sphere};
use crate::scene::Cloud;

/// Subtrees of up to this many leaves are one task: their nodes stay in the second level cache.
const TASK_LEAVES: usize = 1 << 12;

/// A subtree, seen from its root.
#[derive(Clone, Copy, Debug)]
pub(super) struct Summary {
    pub(super) sphere: sphere::Sphere,
    pub(super) cone: PackedCone,
    /// Sum of area times normal, square metres.
    pub(super) area_vector: Vec3,
    /// Mean by area.
    pub(super) color: Vec3,
    /// Mean by area of the squared distance from `color`.
    pub(super) color_variance: f32,
    /// Sum of luminance times area times normal.
    pub(super) radiance_vector: Vec3,
    /// Square metres.
    pub(super) area: f32,
    /// Points below.
    pub(super) points: u32,
    /// Nodes, itself included.
    pub(super) size: u32,
    /// Longest path to a leaf, in nodes, itself included.
    pub(super) depth: u32,
}

/// What the walk reads.
pub(super) struct Input<'a> {
    pub(super) cloud: &'a Cloud,
    pub(super) options: &'a BuildOptions,
    /// Points in the order of their codes.
    pub(super) order: &'a [u32],
    /// The first point of each leaf in `order`, and the number of points at the end.
    pub(super) starts: &'a [u32],
    /// [`super::tree::splits`].
    pub(super) splits: &'a [u32],
}

impl Input<'_> {
    /// Builds the subtree of inner node `node` over `leaves` (a single leaf has no inner node) in `places`, which start
    /// at place `first` of the whole hierarchy. Returns its summary and the runs of places that it filled, in order.
    pub(super) fn build(
        &self,
        node: usize,
        leaves: Range<usize>,
        mut places: Places,
        first: usize,
    ) -> (Summary, Vec<Run>) {
        if leaves.len() <= TASK_LEAVES {
            let summary = Task::gather(self, &leaves).build(node, leaves, &mut places, 0);
            return (summary, vec![Run { first, nodes: summary.size as usize }]);
        }

        // Both children, each in its own places.
        let (split, left_leaves, right_leaves) = self.children(node, leaves);
        let (mut own, below) = places.split(1);
        let left_places = 2 * left_leaves.len() - 1;
        let (left, right) = below.split(left_places);
        let ((left, left_filled), (right, right_filled)) = rayon::join(
            || self.build(split, left_leaves, left, first + 1),
            || self.build(split + 1, right_leaves, right, first + 1 + left_places),
        );

        // Then the node itself.
        let (summary, pruned) = self.inner(&left, &right);
        own.set(0, &summary);
        let mut filled = vec![Run { first, nodes: 1 }];
        if !pruned {
            filled.extend(left_filled);
            filled.extend(right_filled);
        }
        (summary, filled)
    }

    /// The split of an inner node, and the leaves on both sides of it.
    fn children(&self, node: usize, leaves: Range<usize>) -> (usize, Range<usize>, Range<usize>) {
        let split = self.splits[node] as usize;
        (split, leaves.start..split + 1, split + 1..leaves.end)
    }

    /// An inner node, and whether it has become a leaf.
    fn inner(&self, left: &Summary, right: &Summary) -> (Summary, bool) {
        let mut summary = merge(left, right);
        let pruned = prune::becomes_leaf(&summary, self.options);
        if pruned {
            summary.size = 1;
            summary.depth = 1;
        }
        (summary, pruned)
    }
}

/// A subtree that one thread builds alone.
struct Task<'a> {
    input: &'a Input<'a>,
    /// Its points in the order of their codes. They come from all over the cloud: gathered in a loop that does nothing
    /// else, many of the cache misses overlap, which halves the time of the whole walk.
    points: Vec<Point>,
    /// Where they begin in the order of all points.
    first_point: usize,
}

/// What the hierarchy takes from one point of the cloud.
#[derive(Clone, Copy)]
struct Point {
    position: Vec3,
    color: Vec3,
    normal: Vec3,
    spacing: f32,
}

impl<'a> Task<'a> {
    fn gather(input: &'a Input, leaves: &Range<usize>) -> Self {
        let cloud = input.cloud;
        let first_point = input.starts[leaves.start] as usize;
        let points = input.order[first_point..input.starts[leaves.end] as usize].iter().map(|&point| {
            let point = point as usize;
            Point {
                position: cloud.positions[point],
                color: cloud.colors[point],
                normal: cloud.normals[point],
                spacing: cloud.spacing[point],
            }
        });
        Self { input, points: points.collect(), first_point }
    }

    /// [`Input::build`] without gaps, from place `place` of `places` on.
    fn build(&self, node: usize, leaves: Range<usize>, places: &mut Places, place: usize) -> Summary {
        let summary = if leaves.len() == 1 {
            self.leaf(leaves.start)
        } else {
            let (split, left_leaves, right_leaves) = self.input.children(node, leaves);
            let left = self.build(split, left_leaves, places, place + 1);
            let right = self.build(split + 1, right_leaves, places, place + 1 + left.size as usize);
            // Whatever a pruned node leaves behind it is written over by the next.
            self.input.inner(&left, &right).0
        };
        places.set(place, &summary);
        summary
    }

    /// The leaf of one cell: its point, or the average of its points.
    fn leaf(&self, leaf: usize) -> Summary {
        let range = self.input.starts[leaf] as usize..self.input.starts[leaf + 1] as usize;
        match &self.points[range.start - self.first_point..range.end - self.first_point] {
            [point] => disc(point),
            points => cell(points),
        }
    }
}

/// The leaf of one point: a disc as wide as the space around it.
fn disc(point: &Point) -> Summary {
    let [x, y, z] = point.position.to_array();
    let normal = point.normal.normalize_or_zero();
    let area = point.spacing * point.spacing;
    Summary {
        sphere: [x, y, z, point.spacing],
        cone: PackedCone::of_direction(normal),
        area_vector: normal * area,
        color: point.color,
        color_variance: 0.0,
        radiance_vector: normal * (point.color.dot(LUMINANCE) * area),
        area,
        points: 1,
        size: 1,
        depth: 1,
    }
}

/// The leaf of several points that share a cell.
fn cell(points: &[Point]) -> Summary {
    let count = points.len() as f64;
    let area_of = |point: &Point| f64::from(point.spacing * point.spacing);
    let area: f64 = points.iter().map(area_of).sum();
    // Areas as weights; equal ones where no point has any.
    let weight = |point: &Point| if area > 0.0 { area_of(point) / area } else { 1.0 / count };
    let mut normals: Vec<Vec3> = points.iter().map(|point| point.normal.normalize_or_zero()).collect();

    // Averages; the vectors and the area are sums.
    let (mut center, mut color) = (DVec3::ZERO, DVec3::ZERO);
    let (mut area_vector, mut radiance_vector) = (DVec3::ZERO, DVec3::ZERO);
    for (point, normal) in points.iter().zip(&normals) {
        center += point.position.as_dvec3() / count;
        color += point.color.as_dvec3() * weight(point);
        let area = normal.as_dvec3() * area_of(point);
        area_vector += area;
        radiance_vector += area * point.color.as_dvec3().dot(LUMINANCE.as_dvec3());
    }
    let center = center.as_vec3();

    // Distances from the averages.
    let (mut radius, mut color_variance) = (0.0f64, 0.0);
    for point in points {
        let distance = center.as_dvec3().distance(point.position.as_dvec3());
        radius = radius.max(distance + f64::from(point.spacing));
        color_variance += point.color.as_dvec3().distance_squared(color) * weight(point);
    }
    Summary {
        sphere: [center.x, center.y, center.z, sphere::round_up(radius)],
        cone: cone::around_normals(&mut normals),
        area_vector: area_vector.as_vec3(),
        color: color.as_vec3(),
        color_variance: color_variance as f32,
        radiance_vector: of_color(color.as_vec3(), radiance_vector.as_vec3()),
        area: area as f32,
        points: points.len() as u32,
        size: 1,
        depth: 1,
    }
}

/// The parent of two nodes.
fn merge(left: &Summary, right: &Summary) -> Summary {
    let area = left.area + right.area;
    let share = right_share(left.area, right.area);
    let across = right.color - left.color;
    let color = mean_color((left.color, left.area), (right.color, right.area));
    Summary {
        sphere: sphere::around(left.sphere, right.sphere),
        cone: cone::around(left.cone, right.cone),
        area_vector: left.area_vector + right.area_vector,
        color,
        // Parallel axis theorem: the variance within the children and the one between them.
        color_variance: (1.0 - share) * left.color_variance
            + share * right.color_variance
            + share * (1.0 - share) * across.length_squared(),
        radiance_vector: of_color(color, left.radiance_vector + right.radiance_vector),
        area,
        points: left.points + right.points,
        size: 1 + left.size + right.size,
        depth: 1 + left.depth.max(right.depth),
    }
}

/// The right child's share of the area; half where neither has any.
fn right_share(left: f32, right: f32) -> f32 {
    let area = left + right;
    if area > 0.0 { right / area } else { 0.5 }
}

/// The mean by area of two children's colours.
pub(super) fn mean_color((left, left_area): (Vec3, f32), (right, right_area): (Vec3, f32)) -> Vec3 {
    left + (right - left) * right_share(left_area, right_area)
}

/// The sum of radiance vectors below a node of a mean colour: none where that is black, if only by rounding, since
/// there is no chromaticity then to give it.
pub(super) fn of_color(color: Vec3, sum: Vec3) -> Vec3 {
    if color == Vec3::ZERO { Vec3::ZERO } else { sum }
}
