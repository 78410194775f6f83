//! Invariants of the bounding sphere hierarchy, rung 1 of the ladder.

mod order;
mod pruning;

use glam::{DVec3, Vec3};
use proptest::prelude::*;
use rayon::ThreadPoolBuilder;
use relume::Error;
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
        // Radiance vectors add up, to nothing where the mean colour is black.
        let vectors = &hierarchy.radiance_vectors;
        let off = dvec(vectors[node]) - (dvec(vectors[left]) + dvec(vectors[right]));
        let most = (a + b) * f64::from(hierarchy.brightest_point);
        assert!(off.length() <= 1e-6 * most, "radiance vector of node {node}");
        assert!(hierarchy.colors[node] != [0.0; 3] || dvec(vectors[node]) == DVec3::ZERO, "node {node} is black");
    }
}

/// Rec. 709.
fn luminance(color: Vec3) -> f64 {
    color.as_dvec3().dot(DVec3::new(0.2126, 0.7152, 0.0722))
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

    let brightest = cloud.colors.iter().map(|color| color.max_element()).fold(0.0, f32::max);
    assert_eq!(hierarchy.brightest_point, brightest);
    let facing = cloud.normals.iter().zip(&areas).map(|(n, a)| n.as_dvec3() * *a);
    let sum: DVec3 = facing.zip(&cloud.colors).map(|(facing, color)| facing * luminance(*color)).sum();
    assert!(dvec(hierarchy.radiance_vectors[0]).distance(sum) <= 1e-5 * area * f64::from(brightest));

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

/// A cloud large enough for many parallel tasks: a wavy floor, mostly of one colour, with patches of noise, and some
/// points twice.
fn floor() -> Cloud {
    let mut state = 7u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32
    };
    let mut cloud = Cloud::default();
    for point in 0..50_000 {
        let (x, z) = (random() * 10.0, random() * 10.0);
        let noisy = (x.floor() + z.floor()) % 3.0 == 0.0;
        let rough = if noisy { 0.5 } else { 0.01 };
        for _ in 0..if point % 100 == 0 { 2 } else { 1 } {
            cloud.positions.push(Vec3::new(x, 0.1 * x.sin(), z));
            cloud.normals.push((Vec3::Y + rough * Vec3::new(random(), random(), random())).normalize());
            cloud.colors.push(Vec3::new(0.5, 0.4, 0.3) * (1.0 + rough * random()));
            cloud.spacing.push(0.04 + 0.02 * random());
        }
    }
    cloud
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let cloud = floor();
    for options in [BuildOptions::default(), BuildOptions::unpruned()] {
        let with = |threads| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let hierarchy = pool.install(|| built(&cloud, &options)).0;
            let bytes = [
                bytemuck::cast_slice(&hierarchy.spheres),
                bytemuck::cast_slice(&hierarchy.cones),
                bytemuck::cast_slice(&hierarchy.skips),
                bytemuck::cast_slice(&hierarchy.area_vectors),
                bytemuck::cast_slice(&hierarchy.colors),
                bytemuck::cast_slice(&hierarchy.radiance_vectors),
                bytemuck::cast_slice::<f32, u8>(&hierarchy.areas),
            ]
            .concat();
            (bytes, hierarchy.depth, hierarchy.brightest_point)
        };
        let one = with(1);
        assert!(one == with(2) && one == with(7));
    }
}

/// Two points, `apart` metres from each other along x, with spacing 1.
fn pair(apart: f32, colors: [f32; 2], normals: [Vec3; 2]) -> Cloud {
    Cloud {
        positions: vec![Vec3::ZERO, Vec3::X * apart],
        colors: colors.map(Vec3::splat).to_vec(),
        normals: normals.to_vec(),
        spacing: vec![1.0; 2],
        ..Cloud::default()
    }
}

#[test]
fn points_in_one_cell_become_their_average() {
    let cloud = Cloud {
        positions: vec![Vec3::splat(2.0); 3],
        colors: vec![Vec3::X, Vec3::Y, Vec3::Y],
        normals: vec![Vec3::X, Vec3::Y, Vec3::Z],
        spacing: vec![1.0, 2.0, 1.0],
        ..Cloud::default()
    };
    let (hierarchy, report) = built(&cloud, &BuildOptions::default());
    assert_eq!((hierarchy.len(), report.occupied_cells, hierarchy.depth), (1, 1, 1));
    assert_eq!(hierarchy.areas, [6.0]);
    assert_eq!(hierarchy.area_vectors, [[1.0, 4.0, 1.0]]);
    assert!((Vec3::from(hierarchy.colors[0]) - Vec3::new(1.0 / 6.0, 5.0 / 6.0, 0.0)).length() < 1e-6);
    assert!((hierarchy.spheres[0][3] - 2.0).abs() < 1e-6, "the largest disc");
    assert!(angle(hierarchy.cones[0].decode().0, Vec3::ONE) < 1e-4);
}

#[test]
fn a_million_points_in_one_place_take_no_longer_than_others() {
    let one = |value| vec![value; 1_000_000];
    let cloud = Cloud {
        positions: one(Vec3::ONE),
        colors: one(Vec3::splat(0.25)),
        normals: (0..1_000_000).map(|i| Vec3::new((i as f32).sin(), (i as f32).cos(), 2.0).normalize()).collect(),
        spacing: vec![0.0; 1_000_000],
        ..Cloud::default()
    };
    let (hierarchy, report) = built(&cloud, &BuildOptions::default());
    assert_eq!((hierarchy.len(), report.points), (1, 1_000_000));
    assert!((Vec3::from(hierarchy.colors[0]) - 0.25).length() < 1e-6, "equal weights where there is no area");
    assert!(angle(hierarchy.cones[0].decode().0, Vec3::Z) < 1e-3);
}

#[test]
fn a_point_sends_its_luminance_along_its_normal() {
    let color = Vec3::new(4.0, 1.0, 0.5);
    let cloud = Cloud {
        positions: vec![Vec3::ONE],
        colors: vec![color],
        normals: vec![Vec3::new(0.6, 0.0, -0.8)],
        spacing: vec![0.5],
        ..Cloud::default()
    };
    let hierarchy = built(&cloud, &BuildOptions::default()).0;
    let expected = DVec3::new(0.6, 0.0, -0.8) * luminance(color) * 0.25;
    assert!(dvec(hierarchy.radiance_vectors[0]).distance(expected) < 1e-7);
    assert_eq!(hierarchy.brightest_point, 4.0);
}

#[test]
fn where_all_is_alike_every_side_has_the_mean_luminance() {
    let mut cloud = floor();
    cloud.colors.fill(Vec3::new(0.5, 0.4, 0.3));
    let hierarchy = built(&cloud, &BuildOptions::unpruned()).0;
    let mean = luminance(Vec3::new(0.5, 0.4, 0.3));
    for node in 0..hierarchy.len() {
        let expected = dvec(hierarchy.area_vectors[node]) * mean;
        let off = dvec(hierarchy.radiance_vectors[node]).distance(expected);
        assert!(off <= 1e-6 * f64::from(hierarchy.areas[node]), "node {node}: {off}");
    }
}

#[test]
fn a_lamp_keeps_its_light_beside_its_dark_casing() {
    let lamp = pair(1.0, [10.0, 0.0], [Vec3::NEG_Y, Vec3::X]);
    let hierarchy = built(&lamp, &BuildOptions::default()).0;
    let seen = |to_node: DVec3| {
        dvec(hierarchy.radiance_vectors[0]).dot(to_node) / dvec(hierarchy.area_vectors[0]).dot(to_node)
    };
    assert!((seen(DVec3::Y) - 10.0).abs() < 1e-5, "from below, the lamp alone");
    assert!(seen(DVec3::NEG_X).abs() < 1e-5, "from the side, the casing alone");
    assert_eq!(hierarchy.colors[0], [5.0; 3]);
}

#[test]
fn sums_that_no_float_holds_are_refused() {
    let cloud = Cloud { spacing: vec![1e14; 2], ..pair(1.0, [1e14; 2], [Vec3::Y; 2]) };
    let error = build(&cloud, &BuildOptions::default()).expect_err("1e42 is no f32");
    assert!(matches!(error, Error::Argument(_)) && error.to_string().contains("not finite"), "{error}");
}

#[test]
fn unusable_clouds_are_refused_with_a_reason() {
    let good = || pair(1.0, [0.5, 0.5], [Vec3::Y; 2]);
    type Damage = fn(&mut Cloud);
    let cases: [(&str, Damage); 12] = [
        ("no points", |c| *c = Cloud::default()),
        ("0 normals for 2 points", |c| c.normals.clear()),
        ("1 spacings for 2 points", |c| c.spacing.truncate(1)),
        ("3 colors for 2 points", |c| c.colors.push(Vec3::ONE)),
        ("position of point 1", |c| c.positions[1].y = f32::NAN),
        ("position of point 0", |c| c.positions[0].z = 1e16),
        ("color of point 0", |c| c.colors[0].x = -0.1),
        ("color of point 1", |c| c.colors[1].z = f32::INFINITY),
        ("normal of point 1", |c| c.normals[1].x = f32::NAN),
        ("spacing of point 0", |c| c.spacing[0] = -1.0),
        ("spacing of point 1", |c| c.spacing[1] = f32::NAN),
        ("spacing of point 1", |c| c.spacing[1] = f32::INFINITY),
    ];
    for (expected, damage) in cases {
        let mut cloud = good();
        damage(&mut cloud);
        let error = build(&cloud, &BuildOptions::default()).expect_err(expected);
        assert!(matches!(error, Error::Argument(_)), "{error}");
        assert!(error.to_string().contains(expected), "{error} instead of {expected}");
    }
    let nonsense = BuildOptions { color_threshold: f32::NAN, ..BuildOptions::default() };
    assert!(matches!(build(&good(), &nonsense), Err(Error::Argument(_))));
}
