//! The hierarchy as arrays, depth first (Sabbadin 2019, 5.1: 'we linearize the pruned hierarchy into a vector using a
//! depth-first visit'). A subtree over n leaves needs 2 n - 1 places, so every subtree knows where it may write before
//! anything is built; pruning leaves gaps, which [`close_gaps`] removes.

use rayon::prelude::*;

use super::Hierarchy;
use super::propagate::Summary;

/// Neighbouring places that hold nodes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    pub(super) first: usize,
    pub(super) nodes: usize,
}

/// The places of one subtree in all arrays.
pub(super) struct Places<'a> {
    spheres: &'a mut [[f32; 4]],
    cones: &'a mut [super::PackedCone],
    /// Sizes of subtrees, until [`close_gaps`] makes skips of them.
    sizes: &'a mut [u32],
    area_vectors: &'a mut [[f32; 3]],
    colors: &'a mut [[f32; 3]],
    radiance_vectors: &'a mut [[f32; 3]],
    areas: &'a mut [f32],
}

/// Places for `nodes` nodes. The allocator's zeroed pages cost no memory before they are written.
pub(super) fn allocate(nodes: usize) -> Hierarchy {
    Hierarchy {
        spheres: vec![[0.0; 4]; nodes],
        cones: bytemuck::zeroed_vec(nodes),
        skips: vec![0; nodes],
        area_vectors: vec![[0.0; 3]; nodes],
        colors: vec![[0.0; 3]; nodes],
        radiance_vectors: vec![[0.0; 3]; nodes],
        areas: vec![0.0; nodes],
        depth: 0,
        brightest_point: 0.0,
    }
}

impl<'a> Places<'a> {
    /// All places of `hierarchy`.
    pub(super) fn all(hierarchy: &'a mut Hierarchy) -> Self {
        Self {
            spheres: &mut hierarchy.spheres,
            cones: &mut hierarchy.cones,
            sizes: &mut hierarchy.skips,
            area_vectors: &mut hierarchy.area_vectors,
            colors: &mut hierarchy.colors,
            radiance_vectors: &mut hierarchy.radiance_vectors,
            areas: &mut hierarchy.areas,
        }
    }

    /// The first `count` places and the others.
    pub(super) fn split(self, count: usize) -> (Self, Self) {
        let (spheres, other_spheres) = self.spheres.split_at_mut(count);
        let (cones, other_cones) = self.cones.split_at_mut(count);
        let (sizes, other_sizes) = self.sizes.split_at_mut(count);
        let (area_vectors, other_area_vectors) = self.area_vectors.split_at_mut(count);
        let (colors, other_colors) = self.colors.split_at_mut(count);
        let (radiance_vectors, other_radiance_vectors) = self.radiance_vectors.split_at_mut(count);
        let (areas, other_areas) = self.areas.split_at_mut(count);
        let others = Self {
            spheres: other_spheres,
            cones: other_cones,
            sizes: other_sizes,
            area_vectors: other_area_vectors,
            colors: other_colors,
            radiance_vectors: other_radiance_vectors,
            areas: other_areas,
        };
        (Self { spheres, cones, sizes, area_vectors, colors, radiance_vectors, areas }, others)
    }

    /// Writes one node.
    pub(super) fn set(&mut self, place: usize, node: &Summary) {
        self.spheres[place] = node.sphere;
        self.cones[place] = node.cone;
        self.sizes[place] = node.size;
        self.area_vectors[place] = node.area_vector.to_array();
        self.colors[place] = node.color.to_array();
        self.radiance_vectors[place] = node.radiance_vector.to_array();
        self.areas[place] = node.area;
    }
}

/// Moves the filled runs, which are ascending and apart, to the front of all arrays, gives back what is behind them
/// and turns sizes of subtrees into skips.
pub(super) fn close_gaps(hierarchy: &mut Hierarchy, filled: &[Run]) {
    let mut nodes = 0;
    for run in filled {
        if run.first != nodes {
            let range = run.first..run.first + run.nodes;
            hierarchy.spheres.copy_within(range.clone(), nodes);
            hierarchy.cones.copy_within(range.clone(), nodes);
            hierarchy.skips.copy_within(range.clone(), nodes);
            hierarchy.area_vectors.copy_within(range.clone(), nodes);
            hierarchy.colors.copy_within(range.clone(), nodes);
            hierarchy.radiance_vectors.copy_within(range.clone(), nodes);
            hierarchy.areas.copy_within(range, nodes);
        }
        nodes += run.nodes;
    }
    shorten(&mut hierarchy.spheres, nodes);
    shorten(&mut hierarchy.cones, nodes);
    shorten(&mut hierarchy.skips, nodes);
    shorten(&mut hierarchy.area_vectors, nodes);
    shorten(&mut hierarchy.colors, nodes);
    shorten(&mut hierarchy.radiance_vectors, nodes);
    shorten(&mut hierarchy.areas, nodes);

    hierarchy.skips.par_iter_mut().enumerate().with_min_len(1 << 14).for_each(|(node, skip)| *skip += node as u32);
}

/// Keeps the first `len` values and no memory for more.
fn shorten<T>(values: &mut Vec<T>, len: usize) {
    values.truncate(len);
    values.shrink_to_fit();
}
