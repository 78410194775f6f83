//! Bounding sphere hierarchy over a cloud (Sabbadin 2019, 5.1).

/// A normal cone packed in 64 bits: axis x, y, z and the cosine of the half aperture as signed 16-bit fractions of
/// 2^15 (`value as f32 * 2^-15`, which is exact), x in the low half of the first word, z in the low half of the
/// second. A cosine of -1 (stored as -32768) means 'any direction'.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct PackedCone(pub [u32; 2]);

/// The hierarchy, depth first and as a structure of arrays, so that each pass reads only what it needs and no array
/// outgrows the storage buffer limit early: 52 bytes a node on the GPU (28 for the traversal), 4 more on the CPU.
///
/// Node 0 is the root. The left child of inner node `i` is `i + 1`, its right child is `skips[i + 1]`; `skips[i]` is
/// the node after the whole subtree of `i`, so a leaf has `skips[i] == i + 1`.
#[derive(Clone, Debug, Default)]
pub struct Hierarchy {
    /// Centre x, y, z and radius of a sphere that contains the children's spheres; a leaf's radius is its spacing.
    pub spheres: Vec<[f32; 4]>,
    /// Cone that contains the normals of all points below, in its decoded form.
    pub cones: Vec<PackedCone>,
    /// Next node after the subtree.
    pub skips: Vec<u32>,
    /// Sum of area times unit normal over the points below, square metres.
    pub area_vectors: Vec<[f32; 3]>,
    /// Mean radiance of the points below, weighted by area, linear Rec. 709.
    pub colors: Vec<[f32; 3]>,
    /// Sum of the points' areas (spacing squared), square metres.
    pub areas: Vec<f32>,
    /// Longest path from the root to a leaf, in nodes; 1 for a single leaf.
    pub depth: u32,
}
