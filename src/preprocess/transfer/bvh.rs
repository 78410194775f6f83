//! A bounding volume hierarchy over triangles, for many rays from one point: split by the surface area heuristic over
//! bins (Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007), in parallel. `packet.rs` walks
//! it.
//!
//! The splits depend on the triangles alone, never on threads, and so does everything that is found with them.

use glam::{DVec3, Vec3, Vec3Swizzles};
use rayon::prelude::*;

/// Bins along each axis.
const BINS: usize = 16;
/// Leaves hold at most this many triangles; fewer where the heuristic finds that a further split pays.
const LEAF: usize = 8;
/// What the visit of a node costs in tests of a triangle by a packet, for the heuristic.
const NODE_COST: f32 = 1.0;
/// Splits by area may be lopsided: from this depth on halves end the descent, in at most 32 levels more.
const BINNED_DEPTH: usize = 40;
/// One entry stays on the stack a level.
pub(super) const STACK: usize = BINNED_DEPTH + 32 + 2;
/// Boxes are larger than their triangles by this share of the largest coordinate, since the edges that a ray sees are
/// as far off by rounding: where it finds the triangle, it has to find the box.
const PAD: f32 = 4e-6;
/// Subtrees of fewer triangles are built by one thread.
const TASK: usize = 4096;

/// A triangle of a leaf.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Triangle {
    /// Corners in the order of the index list.
    pub(super) corners: [Vec3; 3],
    /// Its number in the list that the hierarchy was built from.
    pub(super) number: u32,
}

/// 32 bytes: two nodes a cache line. The left child of an inner node is the next in the list.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Node {
    /// Low and high corner of the box.
    pub(super) bounds: [[f32; 3]; 2],
    /// First triangle of a leaf; the right child of an inner node.
    pub(super) first: u32,
    /// Number of triangles of a leaf; an inner node has the axis of its split in the two highest bits, plus one.
    info: u32,
}

/// What a node leads to.
pub(super) enum Content {
    /// Triangles from `first` on.
    Leaf { first: usize, count: usize },
    /// Split along `axis`; the left child is on its low side.
    Inner { right: u32, axis: usize },
}

impl Node {
    pub(super) fn content(&self) -> Content {
        match self.info >> 30 {
            0 => Content::Leaf { first: self.first as usize, count: self.info as usize },
            axis => Content::Inner { right: self.first, axis: axis as usize - 1 },
        }
    }
}

/// The hierarchy.
pub(super) struct Bvh {
    pub(super) nodes: Vec<Node>,
    pub(super) triangles: Vec<Triangle>,
}

/// A triangle on its way into a leaf.
#[derive(Clone, Copy)]
struct Item {
    low: Vec3,
    high: Vec3,
    triangle: Triangle,
}

impl Item {
    /// Twice the middle of the box.
    fn centre(&self) -> Vec3 {
        self.low + self.high
    }
}

/// A box that grows.
#[derive(Clone, Copy)]
struct Extent {
    low: Vec3,
    high: Vec3,
}

impl Extent {
    const EMPTY: Self = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    fn join(self, low: Vec3, high: Vec3) -> Self {
        Self { low: self.low.min(low), high: self.high.max(high) }
    }

    /// Half of the surface; 0 for the empty box.
    fn half_area(self) -> f32 {
        let size = (self.high - self.low).max(Vec3::ZERO);
        size.dot(size.zxy())
    }
}

impl Bvh {
    /// Builds the hierarchy of at most `u32::MAX / 2` triangles. Those without an area or with a corner that is not
    /// finite can't be hit and are left out; `number` counts them nevertheless.
    pub(super) fn new(triangles: &[[Vec3; 3]]) -> Self {
        let usable = || triangles.par_iter().enumerate().filter(|(_, corners)| has_area(corners));
        let largest = |corners: &[Vec3; 3]| corners.iter().fold(0.0, |most, c| c.abs().max_element().max(most));
        let pad = PAD * usable().map(|(_, corners)| largest(corners)).reduce(|| 0.0, f32::max);
        let item = |(number, &corners): (usize, &[Vec3; 3])| Item {
            low: corners[0].min(corners[1]).min(corners[2]) - pad,
            high: corners[0].max(corners[1]).max(corners[2]) + pad,
            triangle: Triangle { corners, number: number as u32 },
        };
        let mut items: Vec<Item> = usable().map(item).collect();
        if items.is_empty() {
            return Self { nodes: Vec::new(), triangles: Vec::new() };
        }
        // A subtree of n triangles has at most 2n - 1 nodes: with a room of that size for each, no thread waits for
        // another, and where a node lies doesn't depend on threads.
        let mut rooms = vec![Node::default(); 2 * items.len() - 1];
        build(&mut items, &mut rooms, 0, 0);
        let mut nodes = Vec::with_capacity(rooms.len());
        pack(&rooms, 0, &mut nodes);
        Self { nodes, triangles: items.into_iter().map(|item| item.triangle).collect() }
    }
}

/// True for triangles that a ray can hit.
fn has_area([a, b, c]: &[Vec3; 3]) -> bool {
    let [a, b, c] = [a, b, c].map(|corner| corner.as_dvec3());
    let normal = (b - a).cross(c - a);
    normal.is_finite() && normal != DVec3::ZERO
}

/// Builds the subtree of `items`, the first of which is triangle number `first` of the leaves, into `rooms`. The right
/// child's place counts from the subtree's own root.
fn build(items: &mut [Item], rooms: &mut [Node], first: usize, depth: usize) {
    let extent = items.iter().fold(Extent::EMPTY, |extent, item| extent.join(item.low, item.high));
    let bounds = [extent.low.to_array(), extent.high.to_array()];
    let count = items.len();
    let Some((axis, left)) = split(items, extent.half_area(), depth) else {
        rooms[0] = Node { bounds, first: first as u32, info: count as u32 };
        return;
    };
    let (left_items, right_items) = items.split_at_mut(left);
    let (own, below) = rooms.split_at_mut(1);
    let (left_rooms, right_rooms) = below.split_at_mut(2 * left - 1);
    own[0] = Node { bounds, first: 2 * left as u32, info: (axis as u32 + 1) << 30 };
    let mut build_left = || build(left_items, left_rooms, first, depth + 1);
    let mut build_right = || build(right_items, right_rooms, first + left, depth + 1);
    if count < TASK {
        build_left();
        build_right();
    } else {
        rayon::join(build_left, build_right);
    }
}

/// Copies the subtree at `from` without the empty rooms.
fn pack(rooms: &[Node], from: usize, nodes: &mut Vec<Node>) {
    let place = nodes.len();
    nodes.push(rooms[from]);
    if let Content::Inner { right, .. } = rooms[from].content() {
        pack(rooms, from + 1, nodes);
        nodes[place].first = nodes.len() as u32;
        pack(rooms, from + right as usize, nodes);
    }
}

/// Divides the items in two: the axis, and how many are now first. `None` where a leaf is better.
fn split(items: &mut [Item], half_area: f32, depth: usize) -> Option<(usize, usize)> {
    let count = items.len();
    if count == 1 {
        return None;
    }
    let centres = items.iter().fold(Extent::EMPTY, |extent, item| extent.join(item.centre(), item.centre()));
    let size = centres.high - centres.low;
    let widest = size.max_position();
    // Bins can't tell centres apart that all but coincide.
    if depth < BINNED_DEPTH && size[widest] > f32::MIN_POSITIVE {
        let scale = (BINS as f32 * (1.0 - 1e-6)) / size.max(Vec3::splat(f32::MIN_POSITIVE));
        let bin = |item: &Item, axis: usize| {
            // The cast saturates, so that every value is a bin.
            (((item.centre()[axis] - centres.low[axis]) * scale[axis]) as usize).min(BINS - 1)
        };
        if let Some((cost, axis, border)) = cheapest_border(items, bin) {
            let leaf_cost = count as f32 * half_area;
            if count <= LEAF && leaf_cost <= NODE_COST * half_area + cost {
                return None;
            }
            return Some((axis, partition(items, |item| bin(item, axis) < border)));
        }
    }
    if count <= LEAF {
        return None;
    }
    let middle = count / 2;
    let order = |a: &Item, b: &Item| {
        a.centre()[widest].total_cmp(&b.centre()[widest]).then(a.triangle.number.cmp(&b.triangle.number))
    };
    items.select_nth_unstable_by(middle, order);
    Some((widest, middle))
}

/// (sum of counts times half areas of both sides, axis, first bin of the right side) of the cheapest split between two
/// bins that leaves none of its sides empty.
fn cheapest_border(items: &[Item], bin: impl Fn(&Item, usize) -> usize) -> Option<(f32, usize, usize)> {
    let mut bins = [[(Extent::EMPTY, 0_u32); BINS]; 3];
    for item in items {
        for (axis, bins) in bins.iter_mut().enumerate() {
            let (extent, count) = &mut bins[bin(item, axis)];
            *extent = extent.join(item.low, item.high);
            *count += 1;
        }
    }
    let mut best: Option<(f32, usize, usize)> = None;
    for (axis, bins) in bins.iter().enumerate() {
        // Costs of everything from each bin on, right to left; then the left sides on top of them.
        let mut right = [0.0; BINS];
        let (mut grown, mut sum) = (Extent::EMPTY, 0);
        for border in (1..BINS).rev() {
            let (extent, count) = bins[border];
            (grown, sum) = (grown.join(extent.low, extent.high), sum + count);
            right[border] = if sum == 0 { f32::INFINITY } else { grown.half_area() * sum as f32 };
        }
        let (mut grown, mut sum) = (Extent::EMPTY, 0);
        for border in 1..BINS {
            let (extent, count) = bins[border - 1];
            (grown, sum) = (grown.join(extent.low, extent.high), sum + count);
            let cost = grown.half_area() * sum as f32 + right[border];
            if sum > 0 && cost < best.map_or(f32::INFINITY, |best| best.0) {
                best = Some((cost, axis, border));
            }
        }
    }
    best
}

/// Moves the items that are `left` to the front, and returns how many they are.
fn partition(items: &mut [Item], left: impl Fn(&Item) -> bool) -> usize {
    let mut count = 0;
    for place in 0..items.len() {
        if left(&items[place]) {
            items.swap(place, count);
            count += 1;
        }
    }
    count
}
