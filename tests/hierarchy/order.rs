//! The order of the leaves and the splits of the nodes, against a slow plain reference.

use relume::preprocess::hierarchy::{BuildOptions, Hierarchy};

use super::{built, floor, position};

/// The slow plain reference for the order and the tree: every point's code bit by bit, and a split where the highest
/// differing bit changes. Returns the leaves below `node`.
fn check_morton(hierarchy: &Hierarchy, node: usize, code: &impl Fn(usize) -> u64) -> Vec<u64> {
    if hierarchy.is_leaf(node) {
        return vec![code(node)];
    }
    let left = check_morton(hierarchy, hierarchy.left(node), code);
    let right = check_morton(hierarchy, hierarchy.right(node), code);
    let codes = [&left[..], &right[..]].concat();
    assert!(codes.windows(2).all(|pair| pair[0] < pair[1]), "leaves of node {node} are not in order");
    let bit = 63 - (codes[0] ^ codes[codes.len() - 1]).leading_zeros();
    assert_eq!(codes.partition_point(|code| code >> bit & 1 == 0), left.len(), "split of node {node}");
    codes
}

#[test]
fn leaves_follow_the_morton_curve_and_split_at_the_highest_differing_bit() {
    let mut cloud = floor();
    let (low, high) = cloud
        .positions
        .iter()
        .fold((cloud.positions[0], cloud.positions[0]), |(low, high), point| (low.min(*point), high.max(*point)));
    let size = (high.as_dvec3() - low.as_dvec3()).max_element() / f64::from(1 << 21);
    let code = |sphere: [f32; 4]| {
        let cell = ((position(sphere) - low.as_dvec3()) / size).to_array().map(|c| (c as u64).min((1 << 21) - 1));
        (0..63).fold(0u64, |code, bit| code | (cell[bit % 3] >> (bit / 3) & 1) << bit)
    };
    // In one order of the points and in the other.
    for _ in 0..2 {
        let (hierarchy, report) = built(&cloud, &BuildOptions::unpruned());
        let codes = check_morton(&hierarchy, 0, &|node| code(hierarchy.spheres[node]));
        assert_eq!(codes.len(), report.occupied_cells);
        assert!(report.occupied_cells > 49_000 && report.occupied_cells <= 50_000, "{}", report.occupied_cells);
        cloud.positions.reverse();
        cloud.normals.reverse();
        cloud.colors.reverse();
        cloud.spacing.reverse();
    }
}
