//! The cut of one pixel, found the slow and plain way: the twin of `glsl/common/cut.glsl` for single pixels, which
//! takes the same decisions to the bit, because both use nothing but single additions, multiplications and comparisons.

use glam::Vec3;

use crate::preprocess::hierarchy::Hierarchy;

/// A traversal discards an inner node only with this much to spare, relative to the distance.
const SLACK: f32 = 1e-3;

/// A dot product in the order in which the shaders sum it.
fn dot(a: Vec3, b: Vec3) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

fn sphere(hierarchy: &Hierarchy, node: usize) -> (Vec3, f32) {
    let [x, y, z, radius] = hierarchy.spheres[node];
    (Vec3::new(x, y, z), radius)
}

/// Whether a node covers anything of a pixel's hemisphere: its centre is above the horizon and its front is seen.
pub fn covers(hierarchy: &Hierarchy, node: usize, position: Vec3, normal: Vec3) -> bool {
    let to_node = sphere(hierarchy, node).0 - position;
    dot(normal, to_node) > 0.0 && dot(Vec3::from(hierarchy.area_vectors[node]), to_node) < 0.0
}

/// Whether a node's solid angle is at most the threshold, or it has no children (Sabbadin 2019, Eq. 4), and it is none of
/// those that are opened whatever their size. `stop_sin2` is [`crate::passes::sin2_of_share`] of the threshold.
pub fn stops(hierarchy: &Hierarchy, node: usize, position: Vec3, stop_sin2: f32) -> bool {
    let (centre, radius) = sphere(hierarchy, node);
    let to_node = centre - position;
    !hierarchy.opens(node) && (hierarchy.is_leaf(node) || radius * radius <= stop_sin2 * dot(to_node, to_node))
}

/// Whether nothing below an inner node can cover anything: its sphere is below the horizon, or all normals face away
/// from the pixel at all points of the sphere (Sabbadin 2019, Eq. 8 and Figure 5).
fn discards(hierarchy: &Hierarchy, node: usize, position: Vec3, normal: Vec3) -> bool {
    let (centre, radius) = sphere(hierarchy, node);
    let to_node = centre - position;
    let margin = SLACK * (to_node.x.abs() + to_node.y.abs() + to_node.z.abs() + radius);
    if dot(normal, to_node) + radius + margin < 0.0 {
        return true;
    }
    let (axis, cosine) = hierarchy.cones[node].decode();
    let along = dot(to_node, axis);
    let rest = along * cosine - radius - margin;
    let lost2 = (dot(to_node, to_node) - along * along) * (1.0 - cosine * cosine);
    cosine > 0.0 && rest > 0.0 && rest * rest > lost2
}

/// Nodes that a pixel rasterises, in ascending order, and how many nodes it visits.
pub fn of_pixel(hierarchy: &Hierarchy, position: Vec3, normal: Vec3, stop_sin2: f32) -> (Vec<u32>, usize) {
    let mut cut = Vec::new();
    let mut visited = 0;
    let mut node = 0;
    while node < hierarchy.len() {
        visited += 1;
        let skip = hierarchy.skips[node] as usize;
        if stops(hierarchy, node, position, stop_sin2) {
            if covers(hierarchy, node, position, normal) {
                cut.push(node as u32);
            }
            node = skip;
        } else if discards(hierarchy, node, position, normal) {
            node = skip;
        } else {
            node += 1;
        }
    }
    (cut, visited)
}
