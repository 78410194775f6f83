//! Packets of rays with a common origin and neighbouring directions through a [`Bvh`] (Wald et al., "Interactive
//! Rendering with Coherent Ray Tracing", 2001). All that depends on the origin is computed once a packet.
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

/// Three roundings lie behind a slab's distance: widened by more than these take away, no box is missed that a ray
/// touches (Ize, "Robust BVH Ray Traversal", 2013).
const WIDER: f32 = 1.0 + 4.0 * f32::EPSILON;
/// Stands for components that are zero: their inverse stays finite, so that no slab distance is 0 times infinity.
const LEAST: f32 = 1e-18;

/// Directions that lie in one octant.
pub(super) struct Packet {
    direction: [Lanes; 3],
    inverse: [Lanes; 3],
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
    /// Shares of the area opposite of the corners as the rays see them, times `sum`.
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
        Self {
            direction: std::array::from_fn(|axis| lanes(&|lane| directions[lane][axis])),
            inverse: std::array::from_fn(|axis| lanes(&|lane| inverse(lane, axis))),
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
        let ends: Lanes =
            std::array::from_fn(|g| Vec4::select(cosine[g].cmpgt(Vec4::ZERO), self.used[g], Vec4::splat(NO_RAY)));
        ends.iter().any(|ends| ends.cmpgt(Vec4::ZERO).any()).then_some((cosine, ends))
    }

    /// Whether some ray may enter the box before it ends.
    #[inline(always)]
    fn enters(&self, node: &Node, origin: [f32; 3], ends: &Lanes) -> bool {
        let near: [f32; 3] = std::array::from_fn(|axis| node.bounds[self.negative[axis]][axis] - origin[axis]);
        let far: [f32; 3] = std::array::from_fn(|axis| node.bounds[1 - self.negative[axis]][axis] - origin[axis]);
        let mut any = false;
        for (g, ends) in ends.iter().enumerate() {
            let at = |plane: &[f32; 3], axis: usize| self.inverse[axis][g] * plane[axis];
            let enter = at(&near, 0).max(at(&near, 1)).max(at(&near, 2)).max(Vec4::ZERO);
            let leave = at(&far, 0).min(at(&far, 1)).min(at(&far, 2)) * WIDER;
            any |= enter.cmple(leave.min(*ends)).any();
        }
        any
    }
}

/// A triangle seen from the origin of a packet.
struct View {
    /// Normals of the planes through the origin and the edges opposite of the corners, towards the inside.
    sides: [Vec3; 3],
    /// Twelve times the volume of the tetrahedron with the origin: as large as the sum of the parts at distance 1.
    volume: f32,
    /// How far below 0 a part may be.
    slack: f32,
}

impl View {
    /// `None` where the origin lies in the triangle's plane.
    ///
    /// A side is twice the cross product of its two corners, out of their difference and their sum, which rounds less
    /// where they are close to each other (Embree's Plücker test). Triangles that share an edge make the same products
    /// of it with the other sign: outside of the one is inside of the other. That leaves rays through a corner, which
    /// rounding may put outside of all triangles there; `slack` is what rounding can do.
    #[inline(always)]
    fn new(triangle: &Triangle, origin: Vec3) -> Option<Self> {
        let [a, b, c] = triangle.corners.map(|corner| corner - origin);
        let volume = 2.0 * a.dot((b - a).cross(c - a));
        // Both sides of a triangle block.
        let sign = 1.0_f32.copysign(volume);
        let side = |from: Vec3, to: Vec3| (from - to).cross(from + to) * sign;
        let sides = [side(b, c), side(c, a), side(a, b)];
        let slack = -f32::EPSILON * (sides[0].abs() + sides[1].abs() + sides[2].abs()).element_sum();
        (volume != 0.0).then(|| Self { sides, volume: volume.abs(), slack })
    }

    /// Where four lanes of a packet cross it.
    #[inline(always)]
    fn cross(&self, packet: &Packet, g: usize) -> Crossing {
        let [x, y, z] = &packet.direction;
        let part = |side: Vec3| x[g] * side.x + y[g] * side.y + z[g] * side.z;
        let parts = [part(self.sides[0]), part(self.sides[1]), part(self.sides[2])];
        let sum = parts[0] + parts[1] + parts[2];
        let least = parts[0].min(parts[1]).min(parts[2]);
        Crossing { parts, sum, inside: least.cmpge(Vec4::splat(self.slack)) & sum.cmpgt(Vec4::ZERO) }
    }
}

impl Bvh {
    /// Calls `visit` with the triangles of the leaves that a packet's rays enter before their ends, near ones first,
    /// until it returns false.
    #[inline(always)]
    fn walk(
        &self,
        packet: &Packet,
        origin: Vec3,
        ends: &mut Lanes,
        mut visit: impl FnMut(&Triangle, &mut Lanes) -> bool,
    ) {
        let from = origin.to_array();
        let mut stack = [0_u32; STACK];
        let mut depth = usize::from(!self.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            let index = stack[depth];
            let node = &self.nodes[index as usize];
            if !packet.enters(node, from, ends) {
                continue;
            }
            match node.content() {
                Content::Leaf { first, count } => {
                    for triangle in &self.triangles[first..first + count] {
                        if !visit(triangle, ends) {
                            return;
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
    }

    /// Sets the ends of rays that meet a triangle to [`BLOCKED`]; only those that are above 0 are traced.
    pub(super) fn occlude(&self, packet: &Packet, origin: Vec3, ends: &mut Lanes) {
        self.walk(packet, origin, ends, |triangle, ends| {
            let Some(view) = View::new(triangle, origin) else { return true };
            let mut left = false;
            for (g, ends) in ends.iter_mut().enumerate() {
                let alive = ends.cmpgt(Vec4::ZERO);
                let inside = view.cross(packet, g).inside & alive;
                *ends = Vec4::select(inside, Vec4::splat(BLOCKED), *ends);
                left |= ends.cmpgt(Vec4::ZERO).any();
            }
            left
        });
    }

    /// The closest hits of rays before their `ends`.
    pub(super) fn closest(&self, packet: &Packet, origin: Vec3, mut ends: Lanes) -> Hits {
        let (mut number, mut weights) = ([0; LANES], [[0.0; 3]; LANES]);
        self.walk(packet, origin, &mut ends, |triangle, ends| {
            let Some(view) = View::new(triangle, origin) else { return true };
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::sampling::Random;
    use glam::DVec3;

    fn signed(random: &mut Random) -> Vec3 {
        let (a, b) = (random.square(), random.square());
        Vec3::new(a.x, a.y, b.x) * 2.0 - 1.0
    }

    /// Small triangles everywhere, walls along the axes, slivers, and triangles without area.
    fn soup() -> Vec<[Vec3; 3]> {
        let mut random = Random::new(0, 1);
        let mut soup: Vec<[Vec3; 3]> = (0..300)
            .map(|_| {
                let centre = signed(&mut random);
                [0; 3].map(|_| centre + 0.2 * signed(&mut random))
            })
            .collect();
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            let (u, v) = (axis.any_orthonormal_vector().abs(), axis.cross(axis.any_orthonormal_vector()).abs());
            soup.extend([[axis, axis + u, axis + v], [axis + u, axis + v, axis + u + v]]);
        }
        let point = Vec3::new(0.25, 0.5, 0.125);
        soup.extend([[point; 3], [point, point, Vec3::ONE], [Vec3::ZERO, point, 2.0 * point], [Vec3::NAN; 3]]);
        soup.push([Vec3::ZERO, Vec3::X, Vec3::new(0.5, 1e-6, 0.0)]);
        soup
    }

    /// A packet of random directions, all in the octant of the first.
    fn random_packet(random: &mut Random) -> Packet {
        let octant = signed(random).signum();
        Packet::new([0; LANES].map(|_| (signed(random).abs() * octant).normalize_or(octant)), LANES)
    }

    /// Möller and Trumbore 1997, in f64: how far inside of the triangle (negative outside), and the distance.
    fn plain_hit(corners: [Vec3; 3], origin: Vec3, direction: Vec3) -> Option<(f64, f64)> {
        let [a, b, c] = corners.map(|corner| corner.as_dvec3());
        let (ab, ac, from) = (b - a, c - a, origin.as_dvec3() - a);
        let direction: DVec3 = direction.as_dvec3();
        let determinant = ab.dot(direction.cross(ac));
        let u = from.dot(direction.cross(ac)) / determinant;
        let v = direction.dot(from.cross(ab)) / determinant;
        let distance = ac.dot(from.cross(ab)) / determinant;
        (distance > 0.0).then_some((u.min(v).min(1.0 - u - v), distance))
    }

    #[test]
    fn the_hierarchy_finds_what_testing_all_triangles_finds() {
        let soup = soup();
        let bvh = Bvh::new(&soup);
        let every = Bvh { nodes: Vec::new(), triangles: bvh.triangles.clone() };
        assert_eq!(every.triangles.len(), soup.len() - 4, "triangles without area are left out");
        let mut random = Random::new(1, 1);
        let mut blocked = 0;
        for _ in 0..400 {
            let (origin, packet) = (signed(&mut random), random_packet(&mut random));
            let all = packet.used;
            let hits = bvh.closest(&packet, origin, all);
            let mut ends = all;
            bvh.occlude(&packet, origin, &mut ends);
            for lane in 0..LANES {
                let found = hits.distance[lane / 4][lane % 4];
                let direction = packet.direction(lane);
                // the same test without boxes: exactly
                let nearest = every
                    .triangles
                    .iter()
                    .filter_map(|triangle| {
                        let view = View::new(triangle, origin)?;
                        let crossing = view.cross(&packet, lane / 4);
                        crossing.inside.test(lane % 4).then(|| view.volume / crossing.sum[lane % 4])
                    })
                    .fold(f32::INFINITY, f32::min);
                assert_eq!(found, nearest);
                assert_eq!(ends[lane / 4][lane % 4] == BLOCKED, nearest.is_finite());
                // another test in other numbers: wherever rounding can't decide
                let plain = || soup.iter().filter_map(|&corners| plain_hit(corners, origin, direction));
                let surely = plain().filter(|hit| hit.0 > 1e-4).map(|hit| hit.1).fold(f64::INFINITY, f64::min);
                let perhaps = plain().filter(|hit| hit.0 > -1e-4).map(|hit| hit.1).fold(f64::INFINITY, f64::min);
                assert!(f64::from(found) <= surely * 1.0001 && f64::from(found) >= perhaps * 0.9999);
                if found.is_finite() {
                    blocked += 1;
                    let corners = soup[hits.number[lane] as usize];
                    let place: Vec3 = corners.iter().zip(hits.weights[lane]).map(|(c, weight)| *c * weight).sum();
                    assert!(place.abs_diff_eq(origin + found * direction, 1e-4), "{place}");
                }
            }
        }
        assert!((1000..5400).contains(&blocked), "{blocked} rays of 6400 meet something: the test is no test");
    }

    #[test]
    fn no_ray_slips_out_between_triangles() {
        let sphere = crate::reference::shapes::sphere(0.5, 24);
        // the first and the last meridian are the same but for rounding
        let corner = |index: u32| (sphere.vertices[index as usize].position * 1e4).round() / 1e4;
        let triangles: Vec<[Vec3; 3]> =
            sphere.indices.chunks_exact(3).map(|t| [corner(t[0]), corner(t[1]), corner(t[2])]).collect();
        let bvh = Bvh::new(&triangles);
        let mut random = Random::new(2, 1);
        for [a, b, c] in triangles {
            let origin = 0.25 * signed(&mut random);
            let share = random.square().x;
            for target in [a, b, c, a.lerp(b, share), b.lerp(c, share), c.lerp(a, share)] {
                let packet = Packet::new([(target - origin).normalize(); LANES], LANES);
                let mut ends = packet.used;
                bvh.occlude(&packet, origin, &mut ends);
                assert_eq!(ends, [Vec4::splat(BLOCKED); GROUPS], "from {origin} to {target}");
            }
        }
    }

    #[test]
    fn rays_along_walls_and_nothing_at_all_are_harmless() {
        let wall = [[Vec3::ZERO, Vec3::X, Vec3::Y], [Vec3::X, Vec3::Y, Vec3::X + Vec3::Y]];
        let trace = |bvh: &Bvh, origin: Vec3, direction: Vec3| {
            let packet = Packet::new([direction; LANES], 1);
            let hits = bvh.closest(&packet, origin, packet.used);
            assert!(hits.distance[1..].iter().all(|unused| *unused == Vec4::splat(NO_RAY)));
            hits.distance[0].x
        };
        let bvh = Bvh::new(&wall);
        for direction in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::new(0.6, 0.8, -0.0)] {
            assert_eq!(trace(&bvh, Vec3::new(0.5, 0.5, 0.0), direction), f32::INFINITY);
            assert_eq!(trace(&bvh, Vec3::new(0.5, 0.5, 1e-5), direction), f32::INFINITY);
        }
        for height in [0.25, 1e-5] {
            assert_eq!(trace(&bvh, Vec3::new(0.25, 0.25, height), Vec3::NEG_Z), height);
            assert_eq!(trace(&bvh, Vec3::new(0.25, 0.25, -height), Vec3::Z), height);
            assert_eq!(trace(&bvh, Vec3::new(0.5, 0.5, height), Vec3::NEG_Z), height, "between the triangles");
            assert_eq!(trace(&bvh, Vec3::new(0.25, 0.25, height), Vec3::Z), f32::INFINITY);
        }
        assert_eq!(trace(&Bvh::new(&[]), Vec3::ZERO, Vec3::X), f32::INFINITY);
        assert_eq!(trace(&Bvh::new(&[[Vec3::ONE; 3]]), Vec3::ZERO, Vec3::X), f32::INFINITY);
    }

    #[test]
    fn many_triangles_in_one_place_end_in_leaves_of_limited_size() {
        let bvh = Bvh::new(&vec![[Vec3::ZERO, Vec3::X, Vec3::Y]; 1000]);
        let largest = bvh.nodes.iter().map(|node| match node.content() {
            Content::Leaf { count, .. } => count,
            Content::Inner { .. } => 0,
        });
        assert!(largest.max() <= Some(8));
        assert_eq!(bvh.triangles.len(), 1000);
    }
}
