//! Which subtrees become leaves, against a slow plain reference and at every threshold.

use glam::{DVec3, Vec3};
use relume::preprocess::hierarchy::{BuildOptions, ColorRule, Hierarchy, PackedCone};
use relume::scene::Cloud;

use super::{built, dvec, floor, pair};

/// What the points (here leaves of the unpruned hierarchy) below a node say about pruning it, in f64: the root mean
/// square and the mean distance of their colours, both over the rule's unit, the mean dot product with the mean normal
/// and the radius in mean spacings.
struct Likeness {
    rms: f64,
    mean: f64,
    dot: f64,
    radius: f64,
}

fn likeness(all: &Hierarchy, node: usize, rule: ColorRule) -> Likeness {
    let leaves: Vec<usize> = (node..all.skips[node] as usize).filter(|n| all.is_leaf(*n)).collect();
    let area: f64 = leaves.iter().map(|&leaf| f64::from(all.areas[leaf])).sum();
    let mean_of = |value: &dyn Fn(usize) -> f64| {
        leaves.iter().map(|&leaf| f64::from(all.areas[leaf]) * value(leaf)).sum::<f64>() / area
    };
    let color = DVec3::from_array([0, 1, 2].map(|axis| mean_of(&|leaf| f64::from(all.colors[leaf][axis]))));
    let normal = leaves.iter().map(|&leaf| dvec(all.area_vectors[leaf])).sum::<DVec3>().normalize();
    let unit = match rule {
        ColorRule::Relative => color.dot(DVec3::new(0.2126, 0.7152, 0.0722)).max(0.01),
        ColorRule::Absolute => 1.0,
    };
    Likeness {
        rms: mean_of(&|leaf| dvec(all.colors[leaf]).distance_squared(color)).sqrt() / unit,
        mean: mean_of(&|leaf| dvec(all.colors[leaf]).distance(color)) / unit,
        dot: leaves.iter().map(|&leaf| dvec(all.area_vectors[leaf]).dot(normal)).sum::<f64>() / area,
        radius: f64::from(all.spheres[node][3]) / (area / leaves.len() as f64).sqrt(),
    }
}

#[test]
fn a_pruned_hierarchy_is_the_unpruned_one_cut_where_points_are_alike() {
    // No cell with two points, so that the leaves of the unpruned hierarchy are the points.
    let mut cloud = floor();
    let mut seen = std::collections::HashSet::new();
    let keep: Vec<bool> = cloud.positions.iter().map(|p| seen.insert(p.to_array().map(f32::to_bits))).collect();
    let kept = |point: &usize| keep[*point];
    let points: Vec<usize> = (0..cloud.len()).filter(kept).collect();
    cloud.positions = points.iter().map(|&p| cloud.positions[p]).collect();
    cloud.normals = points.iter().map(|&p| cloud.normals[p]).collect();
    cloud.colors = points.iter().map(|&p| cloud.colors[p]).collect();
    cloud.spacing = points.iter().map(|&p| cloud.spacing[p]).collect();

    let all = built(&cloud, &BuildOptions::unpruned()).0;
    let unbounded = BuildOptions { max_cluster_radius_in_spacings: f32::INFINITY, ..BuildOptions::default() };
    let absolute = BuildOptions { color_rule: ColorRule::Absolute, ..BuildOptions::default() };
    for options in [BuildOptions::default(), unbounded, absolute] {
        let pruned = built(&cloud, &options).0;
        assert!(pruned.len() < all.len() / 2, "{} of {}", pruned.len(), all.len());
        let (color, normal) = (f64::from(options.color_threshold), f64::from(options.normal_threshold));
        let radius = f64::from(options.max_cluster_radius_in_spacings);

        // Both depth first; where the pruned one ends in a leaf, the other goes on behind the subtree.
        let mut whole = 0;
        for node in 0..pruned.len() {
            assert_eq!(pruned.spheres[node], all.spheres[whole], "node {node}");
            assert_eq!(pruned.cones[node], all.cones[whole], "node {node}");
            assert_eq!(pruned.area_vectors[node], all.area_vectors[whole], "node {node}");
            assert_eq!(pruned.colors[node], all.colors[whole], "node {node}");
            assert_eq!(pruned.radiance_vectors[node], all.radiance_vectors[whole], "node {node}");
            assert_eq!(pruned.areas[node], all.areas[whole], "node {node}");

            let like = likeness(&all, whole, options.color_rule);
            let alike = |slack: f64| {
                like.rms < color * (1.0 + slack) && like.dot > normal - slack && like.radius < radius * (1.0 + slack)
            };
            let cut = pruned.is_leaf(node) && !all.is_leaf(whole);
            if cut {
                assert!(alike(1e-4), "node {node}: {} {} {}", like.rms, like.dot, like.radius);
                assert!(like.mean <= like.rms, "the paper's rule would have kept node {node}");
            } else if !all.is_leaf(whole) {
                assert!(!alike(-1e-4), "node {node}: {} {} {}", like.rms, like.dot, like.radius);
            }
            whole = if cut { all.skips[whole] as usize } else { whole + 1 };
        }
        assert_eq!(whole, all.len());
        assert_eq!(pruned.validate(), Ok(()));
    }
}

#[test]
fn two_points_are_pruned_on_this_side_of_every_threshold_and_kept_on_the_other() {
    let up = [Vec3::Y; 2];
    let tilted = |degrees: f32| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [Vec3::new(sin, cos, 0.0), Vec3::new(-sin, cos, 0.0)]
    };
    let relative = BuildOptions::default();
    let absolute = BuildOptions { color_rule: ColorRule::Absolute, ..relative };
    let unbounded = BuildOptions { max_cluster_radius_in_spacings: f32::INFINITY, ..relative };
    let cases = [
        ("alike", pair(1.0, [0.5, 0.5], up), relative, 1),
        ("alike, but zero as a threshold prunes nothing", pair(1.0, [0.5, 0.5], up), BuildOptions::unpruned(), 3),
        // Grey g -+ d is sqrt(3) d from its mean.
        ("colour below 0.005 of 0.5", pair(1.0, [0.4972, 0.5028], up), relative, 1),
        ("colour above 0.005 of 0.5", pair(1.0, [0.497, 0.503], up), relative, 3),
        ("the same for the paper", pair(1.0, [0.497, 0.503], up), absolute, 1),
        ("colour below 0.01", pair(1.0, [0.4943, 0.5057], up), absolute, 1),
        ("colour above 0.01", pair(1.0, [0.494, 0.506], up), absolute, 3),
        ("a lamp", pair(1.0, [49.8, 50.2], up), relative, 1),
        ("a lamp for the paper", pair(1.0, [49.8, 50.2], up), absolute, 3),
        ("dark, below 0.0001", pair(1.0, [0.0, 0.0001], up), relative, 1),
        ("dark, above 0.0001", pair(1.0, [0.0, 0.0002], up), relative, 3),
        // acos(0.98) is 11.48 degrees.
        ("normals below", pair(1.0, [0.5, 0.5], tilted(11.4)), relative, 1),
        ("normals above", pair(1.0, [0.5, 0.5], tilted(11.6)), relative, 3),
        ("no normals", pair(1.0, [0.5, 0.5], [Vec3::ZERO; 2]), relative, 3),
        // The sphere of two discs d apart has the radius 1 + d / 2.
        ("radius below 4", pair(5.99, [0.5, 0.5], up), relative, 1),
        ("radius above 4", pair(6.01, [0.5, 0.5], up), relative, 3),
        ("radius above 4 for the paper", pair(6.01, [0.5, 0.5], up), unbounded, 1),
    ];
    for (name, cloud, options, nodes) in cases {
        assert_eq!(built(&cloud, &options).0.len(), nodes, "{name}");
    }
}

#[test]
fn the_papers_rule_makes_one_leaf_of_a_wall_and_ours_many_small_ones() {
    let mut cloud = Cloud::default();
    for i in 0..128 * 128u16 {
        cloud.positions.push(Vec3::new(f32::from(i % 128), f32::from(i / 128), 0.0) * 0.01);
        cloud.colors.push(Vec3::splat(0.5));
        cloud.normals.push(Vec3::Z);
        cloud.spacing.push(0.01);
    }
    let paper = BuildOptions { max_cluster_radius_in_spacings: f32::INFINITY, ..BuildOptions::default() };
    let (wall, report) = built(&cloud, &paper);
    assert_eq!((wall.len(), wall.depth, report.leaves_after), (1, 1, 1));
    assert!((wall.areas[0] - 1.6384).abs() < 1e-5);
    assert!((Vec3::from(wall.area_vectors[0]) - Vec3::Z * 1.6384).length() < 1e-5);
    assert_eq!(wall.cones[0], PackedCone::encode(Vec3::Z, 1.0));
    assert!((0.9..1.3).contains(&wall.spheres[0][3]), "at least half the diagonal: {}", wall.spheres[0][3]);

    let (wall, report) = built(&cloud, &BuildOptions::default());
    assert!((512..2048).contains(&report.leaves_after), "{}", report.leaves_after);
    let leaves = (0..wall.len()).filter(|node| wall.is_leaf(*node));
    assert!(leaves.map(|leaf| wall.spheres[leaf][3]).all(|radius| radius <= 0.0401));
}
