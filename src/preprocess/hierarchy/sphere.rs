//! The smallest sphere around two spheres: the step that K. Fischer, B. Gaertner and M. Kutz, "Fast Smallest-Enclosing-
//! Ball Computation in High Dimensions", 2003, reduces to when there are two, exact up to rounding, and rounded so
//! that the result contains both (Sabbadin 2019, 5.1: 'forcing the parent node to always contain its children').

use glam::{DVec3, Vec3};

/// Centre x, y, z and radius, metres.
pub(super) type Sphere = [f32; 4];

/// The smallest f32 that is not below `value`, with a margin above the rounding of the few f64 operations before it.
pub(super) fn round_up(value: f64) -> f32 {
    let value = value * (1.0 + 1e-14);
    let near = value as f32;
    if f64::from(near) < value { near.next_up() } else { near }
}

/// The smallest sphere around `a` and `b`. Where one holds the other it is that one, to the bit.
pub(super) fn around(a: Sphere, b: Sphere) -> Sphere {
    let (center_a, radius_a) = parts(a);
    let (center_b, radius_b) = parts(b);
    let across = center_b - center_a;
    let distance = across.length();

    // One inside the other.
    if distance + radius_b <= radius_a {
        return a;
    }
    if distance + radius_a <= radius_b {
        return b;
    }

    // Both touch the result from inside, on the line through their centres.
    let radius = 0.5 * (distance + radius_a + radius_b);
    let center = (center_a + across * ((radius - radius_a) / distance)).as_vec3();

    // The centre has moved by rounding to f32: measure from where it is.
    let reach = |child: DVec3, radius: f64| center.as_dvec3().distance(child) + radius;
    let radius = reach(center_a, radius_a).max(reach(center_b, radius_b));
    [center.x, center.y, center.z, round_up(radius)]
}

/// Centre and radius in f64, in which the squares of f32 are exact enough to forget about rounding.
fn parts(sphere: Sphere) -> (DVec3, f64) {
    let [x, y, z, radius] = sphere;
    (Vec3::new(x, y, z).as_dvec3(), f64::from(radius))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sphere() -> impl Strategy<Value = Sphere> {
        let coordinate = || prop_oneof![-10.0..10.0f32, 1e9..1.1e9f32, Just(0.0f32)];
        (coordinate(), coordinate(), coordinate(), prop_oneof![Just(0.0f32), 0.0..20.0f32])
            .prop_map(|(x, y, z, r)| [x, y, z, r])
    }

    #[test]
    fn two_unit_spheres_apart_touch_the_result() {
        assert_eq!(around([-1.0, 0.0, 0.0, 1.0], [3.0, 0.0, 0.0, 1.0])[..3], [1.0, 0.0, 0.0]);
        let radius = around([-1.0, 0.0, 0.0, 1.0], [3.0, 0.0, 0.0, 1.0])[3];
        assert!((3.0..3.000_001).contains(&radius), "{radius}");
    }

    proptest! {
        #![proptest_config(super::super::seeded())]

        #[test]
        fn contains_both_and_is_no_larger_than_needed(a in sphere(), b in sphere()) {
            let (center, radius) = parts(around(a, b));
            for child in [a, b] {
                let (child_center, child_radius) = parts(child);
                prop_assert!(center.distance(child_center) + child_radius <= radius);
            }
            let (center_a, radius_a) = parts(a);
            let (center_b, radius_b) = parts(b);
            let exact = (0.5 * (center_a.distance(center_b) + radius_a + radius_b)).max(radius_a).max(radius_b);
            // Half a step of f32 an axis, where the centre lies.
            let step = 1e-7 * (center_a.abs().max_element() + center_b.abs().max_element() + exact);
            prop_assert!(radius <= exact + 2.0 * step, "{radius} instead of {exact}");
        }
    }
}
