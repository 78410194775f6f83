//! Cones of normals: G. Barequet and G. Elber, "Optimal Bounding Cones of Vectors in Three Dimensions", 2005, for the
//! points of one leaf; Sabbadin 2019, 5.1 for the cone around two cones. Angles are kept as cosine and sine, in `x` and
//! `y` of a [`Vec2`], where adding angles is `rotate` and no inverse trigonometry is needed.

use glam::{Vec2, Vec3};

/// A normal cone packed in 64 bits: axis x, y, z and the cosine of the half aperture as signed 16-bit fractions of
/// 2^15 (`value as f32 * 2^-15`, which is exact), x in the low half of the first word, z in the low half of the
/// second. A cosine of -1 (stored as -32768) means 'any direction'.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct PackedCone(pub [u32; 2]);

/// One as a 16-bit fraction.
const ONE: f32 = 32768.0;

/// Bound of the rounding errors of a cosine in this file; cosines are lowered by it, so that cones err on the wide side.
const SLACK: f32 = 5e-7;

/// Support vectors count as inside the cap that they define, up to rounding.
const ON_THE_RIM: f32 = 1e-6;

impl PackedCone {
    /// The cone of every direction; its axis (+Z) says nothing.
    pub const ANY: Self = Self([0, 0x8000_7fff]);

    /// The narrowest cone that can be packed around the nearest packed axis and contains the given one.
    ///
    /// `axis` need not have unit length; without a direction (zero, infinite, NaN) the cone is [`Self::ANY`], as it is
    /// for a `half_angle_cos` of -1, below it or NaN. The least half aperture that decodes is 0.45 degrees.
    pub fn encode(axis: Vec3, half_angle_cos: f32) -> Self {
        match axis.try_normalize() {
            Some(axis) if half_angle_cos > -1.0 => around_axis(axis, &[Cone::new(axis, half_angle_cos.min(1.0))]),
            _ => Self::ANY,
        }
    }

    /// [`Self::encode`] of the cone that is a single direction of unit length, or of none where it is zero.
    pub(super) fn of_direction(direction: Vec3) -> Self {
        if direction == Vec3::ZERO {
            return Self::ANY;
        }
        // Rounding turns the axis by at most sqrt(3) 2^-16, and the narrowest cone has a half aperture of 2^-7.
        Self::pack(rounded(direction), ONE - 1.0)
    }

    /// The axis (its length is 1 up to 3e-5; containment is meant for the normalised axis) and the cosine of the half
    /// aperture.
    pub fn decode(self) -> (Vec3, f32) {
        let [xy, zc] = self.0;
        // The low half moves up, so that both are shifted down with their sign.
        let low = |word: u32| ((word << 16) as i32 >> 16) as f32 / ONE;
        let high = |word: u32| (word as i32 >> 16) as f32 / ONE;
        (Vec3::new(low(xy), high(xy), low(zc)), high(zc))
    }

    /// Packs fractions that are rounded already, from -2^15 to 2^15.
    fn pack([x, y, z]: [f32; 3], cos: f32) -> Self {
        let bits = |fraction: f32| u32::from(fraction.min(ONE - 1.0) as i16 as u16);
        Self([bits(x) | bits(y) << 16, bits(z) | bits(cos) << 16])
    }
}

/// A unit vector in fractions of 2^15, to the nearest.
fn rounded(direction: Vec3) -> [f32; 3] {
    // Casts round towards zero, and are instructions on every processor, which `round` and `floor` are not.
    direction.to_array().map(|f| (f * ONE + 0.5f32.copysign(f)) as i32 as f32)
}

/// A cone unpacked for arithmetic.
#[derive(Clone, Copy)]
struct Cone {
    /// Unit length.
    axis: Vec3,
    /// Half aperture, as (cosine, sine), from 0 to pi.
    half: Vec2,
}

impl Cone {
    fn new(axis: Vec3, cos: f32) -> Self {
        // (1 - c) (1 + c) keeps the digits that 1 - c^2 loses near 1.
        Self { axis, half: Vec2::new(cos, ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt()) }
    }

    /// The cone as the GPU sees it; none for 'any direction'.
    fn unpack(packed: PackedCone) -> Option<Self> {
        let (axis, cos) = packed.decode();
        (cos > -1.0).then(|| axis.try_normalize()).flatten().map(|axis| Self::new(axis, cos))
    }

    /// Cosine of the half aperture that a cone needs to contain this one, whose axis is half as far from that cone's
    /// axis as `half_between` says, (cosine, sine); -1 when it has to contain all directions.
    fn reach(&self, half_between: Vec2) -> f32 {
        if half_between.y == 0.0 {
            return self.half.x;
        }
        // Twice the angle, by the formulas that stay exact for small ones.
        let (cos, sin) = half_between.into();
        let sum = Vec2::new(1.0 - 2.0 * sin * sin, 2.0 * sin * cos).rotate(self.half);
        // A negative sine is a sum beyond pi.
        if sum.y >= 0.0 { sum.x - SLACK } else { -1.0 }
    }

    /// Half of the half aperture: the half-angle formulas.
    fn quarter(&self) -> Vec2 {
        Vec2::new((0.5 * (1.0 + self.half.x)).sqrt(), (0.5 * (1.0 - self.half.x)).sqrt())
    }
}

/// Half the angle between two directions of unit length, as (cosine, sine): from the sides of their rhombus, which is
/// exact for small angles too.
fn half_between(a: Vec3, b: Vec3) -> Vec2 {
    0.5 * Vec2::new((a + b).length(), (a - b).length())
}

/// The narrowest packed cone around `axis`, once that is packed, that contains all `cones`.
fn around_axis(axis: Vec3, cones: &[Cone]) -> PackedCone {
    let axis = rounded(axis);
    let Some(decoded) = PackedCone::pack(axis, 0.0).decode().0.try_normalize() else {
        return PackedCone::ANY;
    };
    let cos = cones.iter().map(|cone| cone.reach(half_between(decoded, cone.axis))).fold(1.0, f32::min) * ONE;
    // The integer below: towards zero, and one less where that went up.
    let whole = cos as i32 as f32;
    let cos = if whole > cos { whole - 1.0 } else { whole };
    if cos > -ONE { PackedCone::pack(axis, cos) } else { PackedCone::ANY }
}

/// The minimum cone around two cones, both as they decode, rounded so that it decodes to one that contains them. Where
/// one contains the other it is that one, to the bit, so that a flat wall's cone does not grow level by level.
pub(super) fn around(a: PackedCone, b: PackedCone) -> PackedCone {
    if a == b {
        return a;
    }
    let (Some(cone_a), Some(cone_b)) = (Cone::unpack(a), Cone::unpack(b)) else {
        return PackedCone::ANY;
    };
    let half_between = half_between(cone_a.axis, cone_b.axis);
    if cone_b.reach(half_between) >= cone_a.half.x {
        return a;
    }
    if cone_a.reach(half_between) >= cone_b.half.x {
        return b;
    }

    // Sabbadin 2019, 5.1 turns each axis about the cross product of axis and difference vector by plus and minus the
    // aperture and takes the minimum cone around these four vectors. They lie in one plane, so that cone spans the arc
    // between the outermost two: a's border away from b, and b's border away from a.
    let half_between = 0.5 * Vec2::new((cone_b.axis + cone_a.axis).length(), (cone_b.axis - cone_a.axis).length());
    let half = cone_a.quarter().rotate(cone_b.quarter()).rotate(half_between);

    // The middle of the arc: from a's border back by half the arc, which is from a's axis by that less a's aperture.
    // Where half the arc is pi or more, no cone around any axis reaches far enough, and it becomes every direction.
    let plane = cone_a.axis.cross(cone_b.axis).try_normalize();
    let towards_b = plane.map_or_else(|| cone_a.axis.any_orthonormal_vector(), |plane| plane.cross(cone_a.axis));
    let turn = half.rotate(Vec2::new(cone_a.half.x, -cone_a.half.y));
    around_axis(cone_a.axis * turn.x + towards_b * turn.y, &[cone_a, cone_b])
}

/// The minimum cone around the normals of one leaf's points: Barequet and Elber 2005, as the smallest cap on the unit
/// sphere, built point by point. `normals` have unit length and come back in another order; any that is zero makes
/// it [`PackedCone::ANY`].
pub(super) fn around_normals(normals: &mut [Vec3]) -> PackedCone {
    if normals.contains(&Vec3::ZERO) {
        return PackedCone::ANY;
    }
    // A random order makes the expected time linear; a fixed seed makes it the same order every time.
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    for i in (1..normals.len()).rev() {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        normals.swap(i, ((state >> 32) % (i as u64 + 1)) as usize);
    }

    let axis = smallest_cap(normals, &[]);
    let cos = normals.iter().map(|normal| normal.dot(axis)).fold(1.0, f32::min);
    PackedCone::encode(axis, cos - SLACK)
}

/// Axis of the smallest cap around `normals` with all of `rim`, at most three, on its border.
fn smallest_cap(normals: &[Vec3], rim: &[Vec3]) -> Vec3 {
    let mut axis = match *rim {
        [] => normals.first().copied().unwrap_or(Vec3::Z),
        [a] => a,
        [a, b] => a + b,
        // The cap through three points: its axis is normal to their plane, on their side.
        [a, b, c, ..] => {
            let normal = (b - a).cross(c - a);
            normal * normal.dot(a).signum()
        }
    }
    .normalize_or_zero();
    if rim.len() == 3 {
        return axis;
    }
    let mut cos = rim.first().map_or(1.0, |a| a.dot(axis));
    for (i, &normal) in normals.iter().enumerate() {
        // A point outside lies on the border of the smallest cap around it and those before it.
        if normal.dot(axis) < cos - ON_THE_RIM {
            let (seen, rim) = (&normals[..i], [rim, &[normal]].concat());
            axis = smallest_cap(seen, &rim);
            cos = normal.dot(axis);
        }
    }
    axis
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    /// Angle between two directions, radians, in f64.
    fn angle(a: Vec3, b: Vec3) -> f64 {
        let (a, b) = (a.as_dvec3().normalize(), b.as_dvec3().normalize());
        2.0 * (a - b).length().atan2((a + b).length())
    }

    /// Half aperture of a decoded cone, radians.
    fn half_angle(cone: PackedCone) -> f64 {
        f64::from(cone.decode().1).acos()
    }

    /// How far `inner` sticks out of `outer`, radians.
    fn excess(outer: PackedCone, inner: PackedCone) -> f64 {
        if outer.decode().1 == -1.0 {
            return 0.0;
        }
        angle(outer.decode().0, inner.decode().0) + half_angle(inner) - half_angle(outer)
    }

    fn direction() -> impl Strategy<Value = Vec3> {
        let near_z = (-1e-3..1e-3f32, -1e-3..1e-3f32).prop_map(|(x, y)| Vec3::new(x, y, 1.0));
        let along = prop::sample::select(vec![Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z]);
        let free = (-1.0..1.0f64, 0.0..std::f64::consts::TAU).prop_map(|(z, turn): (f64, f64)| {
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * turn.cos(), r * turn.sin(), z).as_vec3()
        });
        prop_oneof![near_z, along, free].prop_map(Vec3::normalize)
    }

    fn cone() -> impl Strategy<Value = PackedCone> {
        let cos = prop_oneof![Just(1.0f32), Just(-1.0), -1.0..1.0f32, 0.999..1.0f32];
        (direction(), cos).prop_map(|(axis, cos)| PackedCone::encode(axis, cos))
    }

    #[test]
    fn fractions_land_where_the_interface_says() {
        let cone = PackedCone::pack([1.0, -2.0, 3.0], -4.0);
        assert_eq!(cone.0, [0xfffe_0001, 0xfffc_0003]);
        assert_eq!(cone.decode(), (Vec3::new(1.0, -2.0, 3.0) / ONE, -4.0 / ONE));
        assert_eq!(PackedCone::ANY.decode().1, -1.0);
    }

    #[test]
    fn what_has_no_direction_is_any_direction() {
        for axis in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
            assert_eq!(PackedCone::encode(axis, 0.5), PackedCone::ANY);
        }
        for cos in [-1.0, -2.0, f32::NAN, f32::NEG_INFINITY] {
            assert_eq!(PackedCone::encode(Vec3::X, cos), PackedCone::ANY);
        }
        assert_eq!(around_normals(&mut [Vec3::X, Vec3::ZERO]), PackedCone::ANY);
    }

    #[test]
    fn opposite_cones_meet_in_the_middle_or_become_any_direction() {
        let wide = |cos| around(PackedCone::encode(Vec3::X, cos), PackedCone::encode(Vec3::NEG_X, cos));
        // 90 degrees and half a degree of rounding: a half space.
        assert!((half_angle(wide(1.0)) - std::f64::consts::FRAC_PI_2).abs() < 0.01);
        // 90 + 60 degrees; then 90 + 90, which is everything.
        assert!((half_angle(wide(0.5)).to_degrees() - 150.0).abs() < 0.5);
        assert_eq!(wide(-0.001), PackedCone::ANY);
    }

    #[test]
    fn a_long_chain_of_equal_cones_does_not_grow() {
        let leaf = PackedCone::encode(Vec3::new(0.3, -0.5, 0.8), 1.0);
        assert_eq!((0..60).fold(leaf, |cone, _| around(cone, leaf)), leaf);
    }

    #[test]
    fn three_normals_at_right_angles_lie_on_the_rim() {
        let cone = around_normals(&mut [Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE.normalize()]);
        assert!(angle(cone.decode().0, Vec3::ONE) < 1e-4);
        assert!((f64::from(cone.decode().1) - 1.0 / 3f64.sqrt()).abs() < 1e-4);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 4096, ..super::super::seeded() })]

        #[test]
        fn encoding_contains_the_cone_and_is_tight(axis in direction(), cos in -1.0..=1.0f32) {
            let packed = PackedCone::encode(axis, cos);
            let half = f64::from(cos).acos();
            prop_assert!(packed == PackedCone::ANY || angle(packed.decode().0, axis) + half <= half_angle(packed) + 1e-9);
            // Rounding of the axis (5e-5) and two steps of the cosine.
            let step = 2.0 / 32768.0 + 5e-5 * half.sin();
            prop_assert!(f64::from(cos - packed.decode().1) < step + 1e-5);
        }

        #[test]
        fn a_direction_is_a_cone_without_aperture(direction in direction()) {
            let cone = PackedCone::of_direction(direction);
            prop_assert_eq!(cone.decode().1, 1.0 - 1.0 / ONE);
            prop_assert!(angle(cone.decode().0, direction) < 5e-5);
        }

        #[test]
        fn the_cone_around_two_contains_both_and_is_tight(a in cone(), b in cone()) {
            let both = around(a, b);
            prop_assert!(excess(both, a) < 1e-9 && excess(both, b) < 1e-9, "{} {}", excess(both, a), excess(both, b));
            let exact = (0.5 * (angle(a.decode().0, b.decode().0) + half_angle(a) + half_angle(b)))
                .max(half_angle(a)).max(half_angle(b)).min(std::f64::consts::PI);
            prop_assert!(f64::from(both.decode().1) > exact.cos() - 2e-4, "{} for {exact}", half_angle(both));
        }

        #[test]
        fn the_cap_holds_every_normal_and_no_pair_or_triple_needs_less(
            mut normals in prop::collection::vec((-0.5..0.5f32, -0.5..0.5f32), 1..12)
                .prop_map(|v| v.into_iter().map(|(x, y)| Vec3::new(x, y, 1.0).normalize()).collect::<Vec<_>>()),
        ) {
            let given = normals.clone();
            let cone = around_normals(&mut normals);
            for &normal in &given {
                prop_assert!(angle(cone.decode().0, normal) <= half_angle(cone) + 1e-7);
            }
            // The slow plain reference: the smallest cap that some pair or triple defines and that holds all.
            let holds = |axis: Vec3| given.iter().map(|n| angle(axis, *n)).fold(0.0, f64::max);
            let mut best = given.iter().map(|&a| holds(a)).fold(f64::MAX, f64::min);
            for &a in &given {
                for &b in &given {
                    best = best.min(holds((a + b).normalize()));
                    for &c in &given {
                        if let Some(axis) = (b - a).cross(c - a).try_normalize() {
                            best = best.min(holds(axis * axis.z.signum()));
                        }
                    }
                }
            }
            prop_assert!(cone.decode().1 > best.cos() as f32 - 2e-4, "{} for {best}", half_angle(cone));
        }
    }
}
