//! Packets of rays with a common origin and neighbouring directions, through a [`Bvh`]: an interval test of the whole
//! packet (Boulos et al., "Geometric and Arithmetic Culling Methods for Entire Ray Packets", 2006) before that of its
//! lanes, and triangle tests that share all that depends on the origin.
//!
//! Four lanes are a [`Vec4`], which glam keeps in a register. Nothing here depends on what the processor can do beyond
//! that: no fused operations, so that all machines find the same hits.

use glam::{BVec4A, Vec3, Vec4};

use super::bvh::{Bvh, Content, Node, STACK, Triangle};

/// Rays of a packet.
pub(super) const LANES: usize = 16;
/// Registers a component.
const GROUPS: usize = LANES / 4;

/// A number a lane.
pub(super) type Lanes = [Vec4; GROUPS];

/// The [`Lanes`] of where rays end that need not be traced.
pub(super) const NO_RAY: f32 = -1.0;
/// The [`Lanes`] of where rays end that [`Bvh::occlude`] found blocked.
pub(super) const BLOCKED: f32 = -2.0;

/// Slab distances are products of two roundings each: widened by more than these can take away, no box is missed that
/// a ray touches (Ize, "Robust BVH Ray Traversal", 2013).
const WIDER: f32 = 1.0 + 4.0 * f32::EPSILON;
/// Stands for components that are zero: their inverse stays finite, so that no slab distance is 0 times infinity.
const LEAST: f32 = 1e-18;

/// Directions that lie in one octant.
pub(super) struct Packet {
    direction: [Lanes; 3],
    inverse: [Lanes; 3],
    /// The inverse components that are nearest to 0 and farthest from it, over all lanes.
    inverse_range: [[f32; 2]; 3],
    /// 1 along axes on which the packet runs towards lower coordinates.
    negative: [usize; 3],
    /// Infinity in lanes that are used, [`NO_RAY`] in those that fill up the packet.
    used: Lanes,
}

/// The closest hits of a packet; meaningful in lanes whose distance is finite.
pub(super) struct Hits {
    /// Distances in lengths of the directions; [`NO_RAY`] where no ray was asked for, infinity where nothing is hit.
    pub(super) distance: Lanes,
    /// Numbers of triangles, as in [`Triangle::number`].
    pub(super) number: [u32; LANES],
    /// Barycentric coordinates: weights of the triangle's corners.
    pub(super) weights: [[f32; 3]; LANES],
}

/// Where the rays of a packet meet the plane of a triangle.
struct Crossing {
    /// Twice the areas of the parts opposite of the corners, as the rays see them; all positive inside.
    parts: [Vec4; 3],
    sum: Vec4,
    inside: BVec4A,
}

impl Packet {
    /// Of directions whose components have the same signs; the first `used` lanes are used.
    pub(super) fn new(directions: [Vec3; LANES], used: usize) -> Self {
        let lanes = |value: &dyn Fn(usize) -> f32| -> Lanes {
            std::array::from_fn(|group| Vec4::from_array(std::array::from_fn(|lane| value(4 * group + lane))))
        };
        let inverse = |lane: usize, axis: usize| {
            let component = directions[lane][axis];
            component.abs().max(LEAST).copysign(component).recip()
        };
        let range = |axis: usize| {
            let magnitudes = || (0..LANES).map(|lane| inverse(lane, axis).abs());
            let (least, most) = (magnitudes().fold(f32::INFINITY, f32::min), magnitudes().fold(0.0, f32::max));
            [least, most].map(|magnitude| magnitude.copysign(directions[0][axis]))
        };
        Self {
            direction: std::array::from_fn(|axis| lanes(&|lane| directions[lane][axis])),
            inverse: std::array::from_fn(|axis| lanes(&|lane| inverse(lane, axis))),
            inverse_range: std::array::from_fn(range),
            negative: std::array::from_fn(|axis| usize::from(directions[0][axis].is_sign_negative())),
            used: lanes(&|lane| if lane < used { f32::INFINITY } else { NO_RAY }),
        }
    }

    /// The direction of a lane.
    pub(super) fn direction(&self, lane: usize) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|axis: usize| self.direction[axis][lane / 4][lane % 4]))
    }

    /// Cosines with a unit normal, and the ends of the rays above its horizon; `None` where there are none.
    pub(super) fn above(&self, normal: Vec3) -> Option<(Lanes, Lanes)> {
        let [x, y, z] = &self.direction;
        let cosine: Lanes = std::array::from_fn(|g| x[g] * normal.x + y[g] * normal.y + z[g] * normal.z);
        let ends: Lanes = std::array::from_fn(|g| {
            Vec4::select(cosine[g].cmpgt(Vec4::ZERO), self.used[g], Vec4::splat(NO_RAY))
        });
        ends.iter().any(|ends| ends.cmpgt(Vec4::ZERO).any()).then_some((cosine, ends))
    }

    /// True when some ray may enter the box before it ends.
    fn enters(&self, node: &Node, origin: [f32; 3], ends: &Lanes) -> bool {
        let near: [f32; 3] = std::array::from_fn(|axis| node.bounds[self.negative[axis]][axis] - origin[axis]);
        let far: [f32; 3] = std::array::from_fn(|axis| node.bounds[1 - self.negative[axis]][axis] - origin[axis]);
        // Before any lane's own distances, bounds of all of them.
        let mut first = 0.0_f32;
        let mut last = f32::INFINITY;
        for axis in 0..3 {
            let [least, most] = self.inverse_range[axis];
            first = greater(first, lesser(near[axis] * least, near[axis] * most));
            last = lesser(last, greater(far[axis] * least, far[axis] * most));
        }
        if first > last * WIDER {
            return false;
        }
        let mut any = false;
        for g in 0..GROUPS {
            let at = |plane: &[f32; 3], axis: usize| self.inverse[axis][g] * plane[axis];
            let enter = at(&near, 0).max(at(&near, 1)).max(at(&near, 2)).max(Vec4::ZERO);
            let leave = at(&far, 0).min(at(&far, 1)).min(at(&far, 2)) * WIDER;
            any |= enter.cmple(leave.min(ends[g])).any();
        }
        any
    }
}

/// As `f32::min`, but without its care for NaN: one instruction.
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// As `f32::max`, but without its care for NaN: one instruction.
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// A triangle seen from the origin of a packet.
struct View {
    /// Normals of the planes through the origin and the edges opposite of the corners, towards the inside.
    sides: [Vec3; 3],
    /// Six times the volume of the tetrahedron with the origin.
    volume: f32,
}

impl View {
    /// `None` where the origin lies in the triangle's plane.
    ///
    /// Triangles that share an edge make the same products of it, with the other sign, so that no ray slips between
    /// them: what is outside of the one is inside of the other.
    fn new(triangle: &Triangle, origin: Vec3) -> Option<Self> {
        let [a, b, c] = triangle.corners.map(|corner| corner - origin);
        let volume = a.dot((b - a).cross(c - a));
        // Both sides of a triangle block.
        let sign = 1.0_f32.copysign(volume);
        (volume != 0.0).then(|| Self {
            sides: [b.cross(c) * sign, c.cross(a) * sign, a.cross(b) * sign],
            volume: volume.abs(),
        })
    }

    /// Where four lanes of a packet cross it.
    fn cross(&self, packet: &Packet, g: usize) -> Crossing {
        let [x, y, z] = &packet.direction;
        let parts = self.sides.map(|side| x[g] * side.x + y[g] * side.y + z[g] * side.z);
        let sum = parts[0] + parts[1] + parts[2];
        let least = parts[0].min(parts[1]).min(parts[2]);
        Crossing { parts, sum, inside: least.cmpge(Vec4::ZERO) & sum.cmpgt(Vec4::ZERO) }
    }
}

impl Bvh {
    /// Calls `visit` with the triangles of the leaves that a packet's rays enter before their ends, near ones first,
    /// until it returns false. Nothing below the horizon, the plane through `origin` with the normal `up`, is visited;
    /// zero sees everything. Returns how many nodes were looked at.
    fn walk(
        &self,
        packet: &Packet,
        (origin, up): (Vec3, Vec3),
        ends: &mut Lanes,
        mut visit: impl FnMut(&Triangle, &mut Lanes) -> bool,
    ) -> u32 {
        let (from, up) = (origin.to_array(), up.to_array());
        let highest = up.map(|component| usize::from(component > 0.0));
        let mut stack = [0_u32; STACK];
        let mut depth = usize::from(!self.nodes.is_empty());
        let mut visited = 0;
        while depth > 0 {
            depth -= 1;
            let index = stack[depth];
            let node = &self.nodes[index as usize];
            visited += 1;
            let height = |axis: usize| (node.bounds[highest[axis]][axis] - from[axis]) * up[axis];
            if height(0) + height(1) + height(2) < 0.0 || !packet.enters(node, from, ends) {
                continue;
            }
            match node.content() {
                Content::Leaf { first, count } => {
                    for triangle in &self.triangles[first..first + count] {
                        if !visit(triangle, ends) {
                            return visited;
                        }
                    }
                }
                Content::Inner { right, axis } => {
                    let children = [index + 1, right];
                    let near = packet.negative[axis];
                    stack[depth] = children[1 - near];
                    stack[depth + 1] = children[near];
                    depth += 2;
                }
            }
        }
        visited
    }

    /// Sets the ends of rays that meet a triangle to [`BLOCKED`]; only those that are above 0 are traced. `origin` and
    /// `up` as in [`Bvh::closest`]. Returns how many nodes were looked at.
    pub(super) fn occlude(&self, packet: &Packet, from: (Vec3, Vec3), ends: &mut Lanes) -> u32 {
        self.walk(packet, from, ends, |triangle, ends| {
            let Some(view) = View::new(triangle, from.0) else { return true };
            let mut left = false;
            for (g, ends) in ends.iter_mut().enumerate() {
                let alive = ends.cmpgt(Vec4::ZERO);
                let inside = view.cross(packet, g).inside & alive;
                *ends = Vec4::select(inside, Vec4::splat(BLOCKED), *ends);
                left |= ends.cmpgt(Vec4::ZERO).any();
            }
            left
        })
    }

    /// The closest hits of rays from an origin, on triangles above the plane through it with a normal (the second of
    /// `from`; zero for all triangles), before their `ends`.
    pub(super) fn closest(&self, packet: &Packet, from: (Vec3, Vec3), mut ends: Lanes) -> Hits {
        let (mut number, mut weights) = ([0; LANES], [[0.0; 3]; LANES]);
        self.walk(packet, from, &mut ends, |triangle, ends| {
            let Some(view) = View::new(triangle, from.0) else { return true };
            for (g, ends) in ends.iter_mut().enumerate() {
                let crossing = view.cross(packet, g);
                let distance = Vec4::splat(view.volume) / crossing.sum;
                let nearer = crossing.inside & distance.cmplt(*ends);
                *ends = Vec4::select(nearer, distance, *ends);
                let mut lanes = nearer.bitmask();
                while lanes != 0 {
                    let lane = lanes.trailing_zeros() as usize;
                    lanes &= lanes - 1;
                    let sum = crossing.sum[lane];
                    number[4 * g + lane] = triangle.number;
                    weights[4 * g + lane] = crossing.parts.map(|part| part[lane] / sum);
                }
            }
            true
        });
        Hits { distance: ends, number, weights }
    }
}
