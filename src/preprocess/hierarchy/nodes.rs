//! The finished hierarchy.

use super::PackedCone;

/// No path is longer: 63 bits of a Morton code, one a node, and the leaf.
pub const MAX_DEPTH: u32 = 64;

/// The hierarchy, depth first and as a structure of arrays, so that each pass reads only what it needs and no array
/// outgrows the storage buffer limit early: 68 bytes a node here, 56 on the GPU (40 of them for the traversal).
///
/// Node 0 is the root. The left child of inner node `i` is `i + 1`, its right child is `skips[i + 1]`; `skips[i]` is
/// the node after the whole subtree of `i`, so a leaf has `skips[i] == i + 1`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hierarchy {
    /// Centre x, y, z and radius of a sphere that contains the children's spheres, metres. The radius of a leaf is its
    /// spacing where it is one point; otherwise the sphere contains those of its points.
    pub spheres: Vec<[f32; 4]>,
    /// Cone that contains the normals of all points below, in its decoded form.
    pub cones: Vec<PackedCone>,
    /// Next node after the subtree.
    pub skips: Vec<u32>,
    /// Sum of area times unit normal over the points below, square metres.
    pub area_vectors: Vec<[f32; 3]>,
    /// Mean radiance of the points below, weighted by area, linear Rec. 709.
    pub colors: Vec<[f32; 3]>,
    /// Sum of luminance times area times unit normal over the points below: Rec. 709 luminance of the radiance, times
    /// square metres. Seen along a direction `w` from the receiver, a node's luminance is `(F . w) / (S . w)`, with this
    /// as `F` and the area vector as `S`: what its sides that face the receiver send, where the mean would mix in those
    /// that do not (a lamp and its casing). Zero where `colors` is black.
    pub radiance_vectors: Vec<[f32; 3]>,
    /// Sum of the points' areas (spacing squared), square metres.
    pub areas: Vec<f32>,
    /// Longest path from the root to a leaf, in nodes; 1 for a single leaf, at most [`MAX_DEPTH`].
    pub depth: u32,
    /// The largest channel of any point's radiance, linear Rec. 709: no side of any node is brighter.
    pub brightest_point: f32,
}

/// Mean luminance of a cloud whose nodes have these colours.
pub(crate) fn mean_luminance(colors: &[[f32; 3]]) -> f32 {
    colors.first().map_or(0.0, |color| luminance(*color))
}

fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

impl Hierarchy {
    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.skips.len()
    }

    /// True without any node; [`super::build`] never returns such a hierarchy.
    pub fn is_empty(&self) -> bool {
        self.skips.is_empty()
    }

    /// True when node `node` has no children. Panics beyond the last node, like indexing.
    pub fn is_leaf(&self, node: usize) -> bool {
        self.skips[node] as usize == node + 1
    }

    /// Mean luminance of all points; 0 without any.
    pub fn mean_luminance(&self) -> f32 {
        mean_luminance(&self.colors)
    }

    /// True for an inner node that a cut never takes as it is: bright points whose normals spread more than 25 degrees
    /// about their axis. One area and one radiance vector cannot say how much of a lamp's edge is seen from where, and
    /// with lamps that shows. Not in the paper.
    pub fn opens(&self, node: usize) -> bool {
        self.opens_in(&self.colors, node)
    }

    /// The same where nodes send other radiance ([`super::NodeRadiance::colors`]).
    pub fn opens_in(&self, colors: &[[f32; 3]], node: usize) -> bool {
        const SPREAD_COSINE: f32 = 0.9;
        const BRIGHT: f32 = 4.0;
        let bright = luminance(colors[node]) > BRIGHT * mean_luminance(colors);
        bright && !self.is_leaf(node) && self.cones[node].decode().1 < SPREAD_COSINE
    }

    /// Left child of an inner node.
    pub fn left(&self, node: usize) -> usize {
        node + 1
    }

    /// Right child of an inner node. Panics for a last leaf, like indexing.
    pub fn right(&self, node: usize) -> usize {
        self.skips[node + 1] as usize
    }

    /// Checks everything that a traversal relies on: arrays of one length, subtrees that nest and have two children or
    /// none, the depth, and numbers that are finite and, where a sign makes no sense, not negative. The error is one
    /// line that names the node. It does not check that spheres and cones contain those below.
    pub fn validate(&self) -> Result<(), String> {
        self.validate_lengths()?;
        self.validate_structure()?;
        self.validate_values()
    }

    fn validate_lengths(&self) -> Result<(), String> {
        let nodes = self.len();
        if nodes == 0 {
            return Err("the hierarchy has no nodes".into());
        }
        let lengths = [
            ("spheres", self.spheres.len()),
            ("cones", self.cones.len()),
            ("area vectors", self.area_vectors.len()),
            ("colors", self.colors.len()),
            ("radiance vectors", self.radiance_vectors.len()),
            ("areas", self.areas.len()),
        ];
        match lengths.iter().find(|(_, len)| *len != nodes) {
            Some((name, len)) => Err(format!("there are {len} {name} for {nodes} nodes")),
            None => Ok(()),
        }
    }

    fn validate_structure(&self) -> Result<(), String> {
        let nodes = self.len();
        if self.skips[0] as usize != nodes {
            return Err(format!("the root ends at node {}, the hierarchy at node {nodes}", self.skips[0]));
        }
        // Ends of the subtrees that the node is in.
        let mut ends: Vec<usize> = Vec::with_capacity(MAX_DEPTH as usize);
        let mut depth = 0;
        for node in 0..nodes {
            while ends.last().is_some_and(|end| *end <= node) {
                ends.pop();
            }
            let end = self.skips[node] as usize;
            // A root whose end is the last node, and two children that share what is left of each parent, make a tree:
            // every node is in its parent's range and the ranges have no gap.
            if end != node + 1 {
                let right = self.skips.get(node + 1).map_or(0, |skip| *skip as usize);
                let split_well = node + 1 < right && right < end && self.skips.get(right) == Some(&self.skips[node]);
                if !split_well {
                    return Err(format!(
                        "node {node} ends at {end}, but its children do not fill the nodes up to there"
                    ));
                }
            }
            ends.push(end);
            depth = depth.max(ends.len());
            if depth > MAX_DEPTH as usize {
                return Err(format!("node {node} is deeper than {MAX_DEPTH} nodes"));
            }
        }
        if depth != self.depth as usize {
            return Err(format!("the longest path has {depth} nodes, the stated depth is {}", self.depth));
        }
        Ok(())
    }

    fn validate_values(&self) -> Result<(), String> {
        if !(self.brightest_point.is_finite() && self.brightest_point >= 0.0) {
            return Err("the radiance of the brightest point is not finite or is negative".into());
        }
        let wrong = (0..self.len()).find_map(|node| {
            let [x, y, z, radius] = self.spheres[node];
            let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
            let size = |values: &[f32]| values.iter().all(|value| value.is_finite() && *value >= 0.0);
            let checks = [
                ("centre", finite(&[x, y, z])),
                ("radius", size(&[radius])),
                ("area vector", finite(&self.area_vectors[node])),
                ("color", size(&self.colors[node])),
                ("radiance vector", finite(&self.radiance_vectors[node])),
                ("area", size(&[self.areas[node]])),
            ];
            checks.iter().find(|(_, right)| !right).map(|(name, _)| (node, *name))
        });
        match wrong {
            Some((node, name)) => Err(format!("the {name} of node {node} is not finite or is negative")),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Root, leaf, inner node with two leaves.
    fn small() -> Hierarchy {
        Hierarchy {
            spheres: vec![[0.0, 0.0, 0.0, 1.0]; 5],
            cones: vec![PackedCone::ANY; 5],
            skips: vec![5, 2, 5, 4, 5],
            area_vectors: vec![[0.0; 3]; 5],
            colors: vec![[0.5, 0.25, 0.0]; 5],
            radiance_vectors: vec![[0.0; 3]; 5],
            areas: vec![1.0; 5],
            depth: 3,
            brightest_point: 0.5,
        }
    }

    #[test]
    fn a_sound_hierarchy_passes_and_can_be_walked() {
        let hierarchy = small();
        assert_eq!(hierarchy.validate(), Ok(()));
        assert_eq!(hierarchy.len(), 5);
        assert_eq!((0..5).map(|n| hierarchy.is_leaf(n)).collect::<Vec<_>>(), [false, true, false, true, true]);
        assert_eq!((hierarchy.left(0), hierarchy.right(0)), (1, 2));
        assert_eq!((hierarchy.left(2), hierarchy.right(2)), (3, 4));
    }

    #[test]
    fn whatever_a_traversal_relies_on_is_checked() {
        type Damage = fn(&mut Hierarchy);
        let broken: [(&str, Damage); 21] = [
            ("no nodes", |h| *h = Hierarchy::default()),
            ("spheres", |h| h.spheres.truncate(4)),
            ("colors", |h| h.colors.push([0.0; 3])),
            ("root ends", |h| h.skips[0] = 4),
            ("root ends", |h| h.skips[0] = u32::MAX),
            ("node 0 ends at 5, but its children", |h| h.skips[1] = 0),
            ("node 0 ends at 5, but its children", |h| h.skips[1] = 5),
            ("node 0 ends at 5, but its children", |h| h.skips[1] = u32::MAX),
            ("children", |h| h.skips[2] = 4),
            ("node 2 ends at 5, but its children", |h| h.skips[3] = 3),
            ("children", |h| h.skips[4] = 4),
            ("stated depth", |h| h.depth = 4),
            ("centre of node 3", |h| h.spheres[3][1] = f32::NAN),
            ("radius of node 4", |h| h.spheres[4][3] = -1.0),
            ("area vector of node 0", |h| h.area_vectors[0][2] = f32::INFINITY),
            ("radiance vectors", |h| h.radiance_vectors.truncate(4)),
            ("radiance vector of node 1", |h| h.radiance_vectors[1][1] = f32::NAN),
            ("brightest point", |h| h.brightest_point = f32::INFINITY),
            ("brightest point", |h| h.brightest_point = -1.0),
            ("color of node 2", |h| h.colors[2][0] = -0.5),
            ("area of node 1", |h| h.areas[1] = f32::NAN),
        ];
        for (expected, damage) in broken {
            let mut hierarchy = small();
            damage(&mut hierarchy);
            let message = hierarchy.validate().expect_err(expected);
            assert!(message.contains(expected), "{message} instead of {expected}");
        }
    }

    #[test]
    fn a_chain_is_refused_where_it_gets_too_deep() {
        // Inner node, leaf, inner node, leaf, ..., leaf, leaf.
        let chain = |inner: u32| {
            let nodes = 2 * inner + 1;
            let skips = (0..nodes).map(|n| if n % 2 == 0 { nodes } else { n + 1 }).collect::<Vec<_>>();
            let n = nodes as usize;
            Hierarchy {
                spheres: vec![[0.0; 4]; n],
                cones: vec![PackedCone::ANY; n],
                skips,
                area_vectors: vec![[0.0; 3]; n],
                colors: vec![[0.0; 3]; n],
                radiance_vectors: vec![[0.0; 3]; n],
                areas: vec![0.0; n],
                depth: inner + 1,
                brightest_point: 0.0,
            }
        };
        assert_eq!(chain(63).validate(), Ok(()));
        assert!(chain(64).validate().is_err_and(|message| message.contains("deeper than 64")));
    }
}
