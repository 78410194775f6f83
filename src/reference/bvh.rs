//! Closest hits on rectangles: a bounding volume hierarchy split by surface area (MacDonald and Booth 1990), since
//! a median among walls and balusters leaves boxes as large as the room.

use glam::{Vec3, Vec3Swizzles};

use super::rooms::Rectangle;

/// Leaves hold at most this many; below it, testing all is quicker than descending.
const LEAF: usize = 4;
/// Splits by area may be lopsided: from this depth on the median ends the descent, in at most 32 levels more.
const SWEEPS: usize = 24;
/// One entry stays on the stack a level.
const STACK: usize = SWEEPS + 32 + 2;
/// Edges are widened by this fraction of their length, so that no ray slips between two walls that share one.
const OVERLAP: f32 = 1e-5;

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index into [`super::rooms::Room::surfaces`].
    pub surface: usize,
    /// Distance along the ray in lengths of its direction (metres when that is a unit vector).
    pub distance: f32,
    /// Where along `edge_u`, 0 to 1.
    pub u: f32,
    /// Where along `edge_v`, 0 to 1.
    pub v: f32,
    /// True when the ray meets the side that the normal points to.
    pub front: bool,
}

/// A rectangle made ready for intersection: `normal . p = offset` on it, and u = `dual_u . (p - corner)`.
struct Plane {
    normal: Vec3,
    offset: f32,
    corner: Vec3,
    dual_u: Vec3,
    dual_v: Vec3,
    low: Vec3,
    high: Vec3,
    surface: usize,
}

impl Plane {
    fn new(surface: usize, rectangle: &Rectangle) -> Self {
        let (u, v) = (rectangle.edge_u, rectangle.edge_v);
        let normal = rectangle.normal();
        let area = u.cross(v).dot(normal);
        let corners = rectangle.corners();
        Self {
            normal,
            offset: normal.dot(rectangle.corner),
            corner: rectangle.corner,
            dual_u: v.cross(normal) / area,
            dual_v: normal.cross(u) / area,
            low: corners.into_iter().fold(Vec3::INFINITY, Vec3::min),
            high: corners.into_iter().fold(Vec3::NEG_INFINITY, Vec3::max),
            surface,
        }
    }

    fn centre(&self) -> Vec3 {
        0.5 * (self.low + self.high)
    }

    fn hit(&self, origin: Vec3, direction: Vec3, nearest: f32) -> Option<Hit> {
        let slope = self.normal.dot(direction);
        let distance = (self.offset - self.normal.dot(origin)) / slope;
        // a ray along the plane gives NaN or infinity here, and neither lies in the range
        if !(distance > 0.0 && distance < nearest) {
            return None;
        }
        let local = origin + direction * distance - self.corner;
        let (u, v) = (self.dual_u.dot(local), self.dual_v.dot(local));
        let range = -OVERLAP..=1.0 + OVERLAP;
        (range.contains(&u) && range.contains(&v)).then(|| Hit {
            surface: self.surface,
            distance,
            u: u.clamp(0.0, 1.0),
            v: v.clamp(0.0, 1.0),
            front: slope < 0.0,
        })
    }
}

/// A node: a box around `count` planes from `first`, or around two children when `count` is 0; then the left child
/// comes next in the list and the right one at `first`.
struct Node {
    low: Vec3,
    high: Vec3,
    first: usize,
    count: usize,
}

impl Node {
    /// Distance at which the ray enters the box, when it does so before `nearest`.
    fn entry(&self, origin: Vec3, inverse: Vec3, nearest: f32) -> Option<f32> {
        let (a, b) = ((self.low - origin) * inverse, (self.high - origin) * inverse);
        let (enter, leave) = (a.min(b).max_element().max(0.0), a.max(b).min_element());
        (enter <= leave && enter < nearest).then_some(enter)
    }
}

/// The hierarchy over the surfaces of a room.
pub(super) struct Bvh {
    planes: Vec<Plane>,
    nodes: Vec<Node>,
}

impl Bvh {
    pub(super) fn new(rectangles: &[Rectangle]) -> Self {
        let mut planes: Vec<_> = rectangles.iter().enumerate().map(|(i, r)| Plane::new(i, r)).collect();
        let mut nodes = Vec::new();
        if !planes.is_empty() {
            let count = planes.len();
            build(&mut planes, &mut nodes, 0, count, 0);
        }
        Self { planes, nodes }
    }

    /// Calls `visit` with the planes of every leaf that the ray enters before the distance `visit` last returned,
    /// near children first, until it returns 0.
    fn walk(&self, origin: Vec3, direction: Vec3, mut nearest: f32, mut visit: impl FnMut(&Plane, f32) -> f32) {
        // infinities from zero components are what the slab test wants
        let inverse = direction.recip();
        let mut stack = [(0_u32, 0.0_f32); STACK];
        let mut depth = usize::from(!self.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            let (index, enter) = stack[depth];
            if enter >= nearest {
                continue;
            }
            let index = index as usize;
            let node = &self.nodes[index];
            if node.count > 0 {
                for plane in &self.planes[node.first..node.first + node.count] {
                    nearest = visit(plane, nearest);
                }
            } else {
                let near = |child: usize| Some((child as u32, self.nodes[child].entry(origin, inverse, nearest)?));
                let (left, right) = (near(index + 1), near(node.first));
                let left_first = match (&left, &right) {
                    (Some(l), Some(r)) => l.1 <= r.1,
                    _ => true,
                };
                let order = if left_first { [right, left] } else { [left, right] };
                for child in order.into_iter().flatten() {
                    stack[depth] = child;
                    depth += 1;
                }
            }
        }
    }

    /// The first surface that the ray meets.
    pub(super) fn closest(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        let mut closest = None;
        self.walk(origin, direction, f32::INFINITY, |plane, nearest| match plane.hit(origin, direction, nearest) {
            Some(hit) => {
                closest = Some(hit);
                hit.distance
            }
            None => nearest,
        });
        closest
    }

    /// True when any surface lies on the ray before `distance`.
    pub(super) fn blocked(&self, origin: Vec3, direction: Vec3, distance: f32) -> bool {
        let mut blocked = false;
        self.walk(origin, direction, distance, |plane, nearest| {
            blocked |= plane.hit(origin, direction, nearest).is_some();
            // nothing is nearer than 0, so the walk ends
            if blocked { 0.0 } else { nearest }
        });
        blocked
    }
}

/// Builds the subtree of `planes[first..first + count]` at the end of `nodes`.
fn build(planes: &mut [Plane], nodes: &mut Vec<Node>, first: usize, count: usize, depth: usize) {
    let part = &mut planes[first..first + count];
    let (low, high) = bounds(part);
    // a flat box around an axis-aligned wall needs some thickness, or rounding lets rays through
    let pad = Vec3::splat(1e-5) * (1.0 + low.abs().max(high.abs()));
    let index = nodes.len();
    nodes.push(Node { low: low - pad, high: high + pad, first, count });
    if count <= LEAF {
        return;
    }
    let (axis, split) = if depth < SWEEPS { cheapest_split(part) } else { ((high - low).max_position(), count / 2) };
    part.sort_unstable_by(|a, b| a.centre()[axis].total_cmp(&b.centre()[axis]));
    build(planes, nodes, first, split, depth + 1);
    nodes[index].first = nodes.len();
    nodes[index].count = 0;
    build(planes, nodes, first + split, count - split, depth + 1);
}

/// (axis, count on the left) with the least sum of counts times surface areas, of all splits of the sorted planes.
fn cheapest_split(planes: &mut [Plane]) -> (usize, usize) {
    let half_area = |(low, high): (Vec3, Vec3)| (high - low).dot((high - low).zxy());
    let join = |a: (Vec3, Vec3), b: (Vec3, Vec3)| (a.0.min(b.0), a.1.max(b.1));
    let mut best = (f32::INFINITY, (0, planes.len() / 2));
    for axis in 0..3 {
        planes.sort_unstable_by(|a, b| a.centre()[axis].total_cmp(&b.centre()[axis]));
        // areas of everything from each plane on, right to left
        let mut from: Vec<f32> = Vec::with_capacity(planes.len());
        let mut grown = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for plane in planes.iter().rev() {
            grown = join(grown, (plane.low, plane.high));
            from.push(half_area(grown));
        }
        let mut grown = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for left in 1..planes.len() {
            grown = join(grown, (planes[left - 1].low, planes[left - 1].high));
            let right = planes.len() - left;
            let cost = half_area(grown) * left as f32 + from[right - 1] * right as f32;
            if cost < best.0 {
                best = (cost, (axis, left));
            }
        }
    }
    best.1
}

fn bounds(planes: &[Plane]) -> (Vec3, Vec3) {
    planes.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p.low), high.max(p.high)))
}

#[cfg(test)]
mod tests {
    use super::super::rooms::hall;
    use super::super::sampling::Random;
    use super::*;

    #[test]
    fn the_hierarchy_finds_what_testing_all_finds() {
        let room = hall();
        let bvh = Bvh::new(&room.surfaces);
        let mut random = Random::new(0, 4);
        let mut signed = || 2.0 * random.uniform() - 1.0;
        for _ in 0..5000 {
            let origin = Vec3::new(6.0 * signed(), 3.0 + 3.0 * signed(), 10.0 * signed());
            let direction = Vec3::new(signed(), signed(), signed()).normalize_or(Vec3::X);
            let hit = bvh.closest(origin, direction);
            let all = bvh.planes.iter().filter_map(|plane| plane.hit(origin, direction, f32::INFINITY));
            let nearest = all.map(|hit| hit.distance).fold(f32::INFINITY, f32::min);
            assert_eq!(hit.map_or(f32::INFINITY, |hit| hit.distance), nearest);
            assert!(!bvh.blocked(origin, direction, nearest));
            assert_eq!(bvh.blocked(origin, direction, 2.0 * nearest + 1.0), nearest.is_finite());
        }
    }

    #[test]
    fn nothing_and_rays_along_walls_are_harmless() {
        assert_eq!(Bvh::new(&[]).closest(Vec3::ZERO, Vec3::X), None);
        let wall = Rectangle::new(Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE);
        let bvh = Bvh::new(&[wall]);
        assert_eq!(bvh.closest(Vec3::new(-1.0, 0.5, 0.0), Vec3::X), None);
        assert_eq!(bvh.closest(Vec3::NAN, Vec3::X), None);
        assert_eq!(bvh.closest(Vec3::ZERO, Vec3::ZERO), None);
        assert!(bvh.closest(Vec3::new(0.5, 0.5, 1.0), Vec3::NEG_Z).is_some_and(|hit| hit.front));
        assert!(bvh.closest(Vec3::new(0.5, 0.5, -1.0), Vec3::Z).is_some_and(|hit| !hit.front));
    }
}
