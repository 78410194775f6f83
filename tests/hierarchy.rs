//! Invariants of the bounding sphere hierarchy, rung 1 of the ladder.

use glam::{DVec3, Vec3};
use proptest::prelude::*;
use relume::preprocess::hierarchy::{BuildOptions, BuildReport, ColorRule, Hierarchy, MAX_DEPTH, build};
use relume::scene::Cloud;

/// Property tests that ask the same questions every time and leave no files behind.
fn seeded(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: proptest::test_runner::RngSeed::Fixed(51),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

fn built(cloud: &Cloud, options: &BuildOptions) -> (Hierarchy, BuildReport) {
    build(cloud, options).expect("the cloud is usable")
}

/// One cloud of every awkward kind: scattered, on a plane, on a line, in few places, in one place, a billion metres
/// away, huge, tiny; normals alike, scattered or unknown; colours equal or up to 1000; spacings equal, free or zero.
fn clouds() -> impl Strategy<Value = Cloud> {
    let point = (
        prop::array::uniform3(-1.0..1.0f32),
        prop::array::uniform3(0.0..1.0f32),
        prop::array::uniform3(-1.0..1.0f32),
        0.001..0.2f32,
    );
    let points = prop::collection::vec(point, 1..200);
    (points, 0..8usize, 0..4usize, 0..3usize, 0..3usize).prop_map(|(points, shape, normals, colors, spacing)| {
        let mut cloud = Cloud::default();
        for (position, color, normal, space) in points {
            let [x, y, z] = position;
            cloud.positions.push(match shape {
                0 => Vec3::new(x, y, z),
                1 => Vec3::new(x, 0.5, z),
                2 => Vec3::new(1.0, 2.0, 3.0) * x,
                3 => Vec3::new(x.round(), y.round(), z.round()),
                4 => Vec3::new(0.1, 0.2, 0.3),
                5 => Vec3::new(1e9, -1e9, 1e9) + Vec3::new(x, y, z) * 1e3,
                6 => Vec3::new(x, y, z) * 1e15,
                _ => Vec3::new(x, y, z) * 1e-30,
            });
            cloud.normals.push(match normals {
                0 => Vec3::Y,
                1 => (Vec3::Y + 0.1 * Vec3::from(normal)).normalize(),
                2 => Vec3::from(normal).normalize_or(Vec3::X),
                _ if space < 0.01 => Vec3::ZERO,
                _ => Vec3::NEG_Z,
            });
            cloud.colors.push(match colors {
                0 => Vec3::splat(0.5),
                1 => Vec3::from(color),
                _ => Vec3::from(color).powf(8.0) * 1000.0,
            });
            cloud.spacing.push(match spacing {
                0 => 0.05,
                1 => space,
                _ => 0.0,
            });
        }
        cloud
    })
}

fn options() -> impl Strategy<Value = BuildOptions> {
    let rule = prop::sample::select(vec![ColorRule::Relative, ColorRule::Absolute]);
    let color = prop::sample::select(vec![0.0, 0.01, 0.3, f32::INFINITY]);
    let normal = prop::sample::select(vec![0.98, 0.5, -1.0]);
    let radius = prop::sample::select(vec![4.0, 50.0, f32::INFINITY]);
    (rule, color, normal, radius).prop_map(
        |(color_rule, color_threshold, normal_threshold, max_cluster_radius_in_spacings)| BuildOptions {
            color_threshold,
            normal_threshold,
            color_rule,
            max_cluster_radius_in_spacings,
        },
    )
}

fn position(sphere: [f32; 4]) -> DVec3 {
    Vec3::from_slice(&sphere).as_dvec3()
}

/// Angle between two directions, radians.
fn angle(a: Vec3, b: Vec3) -> f64 {
    let (a, b) = (a.as_dvec3().normalize(), b.as_dvec3().normalize());
    2.0 * (a - b).length().atan2((a + b).length())
}

/// How far cone `inner` sticks out of cone `outer`, radians; both as they decode, axes normalised.
fn excess(hierarchy: &Hierarchy, outer: usize, inner: usize) -> f64 {
    let ((outer, outer_cos), (inner, inner_cos)) = (hierarchy.cones[outer].decode(), hierarchy.cones[inner].decode());
    if outer_cos == -1.0 {
        return 0.0;
    }
    angle(outer, inner) + f64::from(inner_cos).acos() - f64::from(outer_cos).acos()
}

/// Everything that must hold between a node and its children.
fn check_nesting(hierarchy: &Hierarchy) {
    for node in (0..hierarchy.len()).filter(|node| !hierarchy.is_leaf(*node)) {
        let children = [hierarchy.left(node), hierarchy.right(node)];
        for child in children {
            // Spheres contain spheres, exactly.
            let (outer, inner) = (hierarchy.spheres[node], hierarchy.spheres[child]);
            let reach = position(outer).distance(position(inner)) + f64::from(inner[3]);
            assert!(reach <= f64::from(outer[3]), "sphere of node {node}: {reach} > {}", outer[3]);
            // Cones contain cones.
            let excess = excess(hierarchy, node, child);
            assert!(excess < 1e-4, "cone of node {node} misses {excess} rad of {child}");
        }
        // Areas and area vectors add up, colours average.
        let [left, right] = children;
        let (areas, vectors) = (&hierarchy.areas, &hierarchy.area_vectors);
        assert_close(areas[node].into(), f64::from(areas[left]) + f64::from(areas[right]), areas[node].into());
        let (a, b) = (f64::from(areas[left]), f64::from(areas[right]));
        let share = if a + b > 0.0 { b / (a + b) } else { 0.5 };
        let sum = dvec(vectors[left]) + dvec(vectors[right]);
        assert!(dvec(vectors[node]).distance(sum) <= 1e-6 * f64::from(areas[node]), "area vector of node {node}");
        let (l, r) = (dvec(hierarchy.colors[left]), dvec(hierarchy.colors[right]));
        let off = dvec(hierarchy.colors[node]) - l.lerp(r, share);
        assert!(off.length() <= 1e-6 * l.length().max(r.length()), "color of node {node}");
    }
}

fn dvec(value: [f32; 3]) -> DVec3 {
    Vec3::from(value).as_dvec3()
}

fn assert_close(value: f64, expected: f64, scale: f64) {
    assert!((value - expected).abs() <= 1e-6 * scale, "{value} instead of {expected}");
}

/// What the root must know about the whole cloud.
fn check_root(cloud: &Cloud, hierarchy: &Hierarchy) {
    let areas: Vec<f64> = cloud.spacing.iter().map(|s| f64::from(s * s)).collect();
    let area: f64 = areas.iter().sum();
    assert!((f64::from(hierarchy.areas[0]) - area).abs() <= 1e-5 * area);

    let vector: DVec3 = cloud.normals.iter().zip(&areas).map(|(n, a)| n.as_dvec3() * *a).sum();
    assert!(Vec3::from(hierarchy.area_vectors[0]).as_dvec3().distance(vector) <= 1e-5 * area);

    if area > 0.0 {
        let color = cloud.colors.iter().zip(&areas).map(|(c, a)| c.as_dvec3() * *a).sum::<DVec3>() / area;
        let scale = cloud.colors.iter().map(|c| c.as_dvec3().length()).fold(0.0, f64::max);
        assert!(Vec3::from(hierarchy.colors[0]).as_dvec3().distance(color) <= 1e-5 * scale);
    }

    let (axis, cos) = hierarchy.cones[0].decode();
    for point in 0..cloud.len() {
        // Every point's disc is in the sphere, every normal in the cone.
        let reach = cloud.positions[point].as_dvec3().distance(position(hierarchy.spheres[0]));
        assert!(reach + f64::from(cloud.spacing[point]) <= f64::from(hierarchy.spheres[0][3]) * (1.0 + 1e-7));
        if cos > -1.0 {
            assert!(angle(axis, cloud.normals[point]) <= f64::from(cos).acos() + 1e-4);
        }
    }
}

/// Without pruning every occupied cell is a leaf once: leaves with one point are those points, to the bit.
fn check_leaves(cloud: &Cloud, hierarchy: &Hierarchy, report: &BuildReport) {
    let leaves: Vec<usize> = (0..hierarchy.len()).filter(|node| hierarchy.is_leaf(*node)).collect();
    assert_eq!(leaves.len(), report.occupied_cells);
    if report.occupied_cells == cloud.len() {
        let bits = |p: Vec3, s: f32, c: Vec3| [p.x, p.y, p.z, s, c.x, c.y, c.z].map(|v| (v + 0.0).to_bits());
        let mut found: Vec<_> = leaves
            .iter()
            .map(|&leaf| (Vec3::from_slice(&hierarchy.spheres[leaf]), hierarchy.spheres[leaf][3], leaf))
            .map(|(p, s, leaf)| bits(p, s, hierarchy.colors[leaf].into()))
            .collect();
        let mut expected: Vec<_> =
            (0..cloud.len()).map(|i| bits(cloud.positions[i], cloud.spacing[i], cloud.colors[i])).collect();
        found.sort_unstable();
        expected.sort_unstable();
        assert_eq!(found, expected);
    }
}

proptest! {
    #![proptest_config(seeded(400))]

    #[test]
    fn invariants_hold_on_every_kind_of_cloud(cloud in clouds(), options in options()) {
        let (hierarchy, report) = built(&cloud, &options);
        prop_assert_eq!(hierarchy.validate(), Ok(()));
        check_nesting(&hierarchy);
        check_root(&cloud, &hierarchy);
        if options.color_threshold == 0.0 {
            check_leaves(&cloud, &hierarchy, &report);
        }
        prop_assert_eq!(report.points, cloud.len());
        prop_assert_eq!(report.nodes_before, 2 * report.occupied_cells - 1);
        prop_assert_eq!(report.nodes_after, hierarchy.len());
        prop_assert_eq!(report.leaves_after, (0..hierarchy.len()).filter(|n| hierarchy.is_leaf(*n)).count());
        prop_assert_eq!(report.depth, hierarchy.depth);
        prop_assert!(report.depth <= MAX_DEPTH);
        prop_assert!(report.nodes_after <= report.nodes_before);
    }
}
