//! Which subtrees become a leaf (Sabbadin 2019, 5.1: t_c and t_n).

use glam::Vec3;

use super::BuildOptions;
use super::propagate::Summary;

/// What a distance between colours is measured against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColorRule {
    /// The node's own luminance, at least 0.01: the same wall is clustered alike in the sun and in the shade. At
    /// luminance 1, the white of a low dynamic range cloud, it is the paper's rule.
    #[default]
    Relative,
    /// One, as in the paper, which was made for colours that rarely exceed it.
    Absolute,
}

/// Rec. 709 weights of luminance.
pub(super) const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// Below a hundredth of white the steps of 8-bit colours would decide.
const LEAST_LUMINANCE: f32 = 0.01;

/// True when `subtree` should become a leaf; false wherever a value is undefined (no area).
pub(super) fn becomes_leaf(subtree: &Summary, options: &BuildOptions) -> bool {
    // Sabbadin 2019, 5.1 takes the mean distance from the node's colour. Here it is the root mean square, which
    // the children's values determine and which is never smaller; so no node is pruned that the paper would keep.
    let unit = match options.color_rule {
        ColorRule::Relative => subtree.color.dot(LUMINANCE).max(LEAST_LUMINANCE),
        ColorRule::Absolute => 1.0,
    };
    let similar_color = subtree.color_variance.sqrt() < options.color_threshold * unit;

    // Mean dot product with the node's normal N = S / |S|, S = sum a n: sum a (n . N) / sum a = |S| / sum a.
    let similar_normal = subtree.area_vector.length() > options.normal_threshold * subtree.area;

    // Not in the paper: a wall of one colour would become a single leaf, metres wide, which no micro-buffer can
    // rasterise well.
    let spacing = (subtree.area / subtree.points as f32).sqrt();
    let small = subtree.sphere[3] <= options.max_cluster_radius_in_spacings * spacing;

    similar_color && similar_normal && small
}
