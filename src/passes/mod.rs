//! One GPU pass a file, under the same name as its folder in `glsl/`, and the structs that cross the border to GLSL.

pub mod bin;
pub mod convolve;
pub mod gbuffer;
pub mod rasterise;
pub mod receivers;
pub mod refine;
pub mod trace;
pub mod traverse;

use std::sync::Arc;

use ash::vk;
use bytemuck::{Pod, Zeroable};

use crate::Result;
use crate::gpu::{Bindings, Buffer, Constant, Context};
use crate::preprocess::hierarchy::Hierarchy;

/// Push constants of the traversal passes (`glsl/shared/traversal.glsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Traversal {
    /// Pixel slots in the receiver buffers, a multiple of 256.
    pub pixels: u32,
    /// Squared sine of the half angle of a cone with the solid angle that stops the traversal.
    pub stop_sin2: f32,
    /// The same for the solid angle at which hybrid leaves the geometry shader.
    pub switch_sin2: f32,
    /// Pairs, or nodes a pixel, that fit where the pass appends.
    pub capacity: u32,
}

/// Push constants of the raster passes and the convolution (`glsl/shared/gather.glsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Gather {
    /// Pixel slots in the receiver buffers.
    pub pixels: u32,
    /// First entry of the chunk.
    pub first_entry: u32,
    /// Entries in the chunk.
    pub entry_count: u32,
    /// Radiance to fixed point.
    pub color_scale: f32,
    /// Eye, world space.
    pub eye: [f32; 3],
    /// Sum of coverage that a micro-pixel's fixed-point sums hold, in micro-pixels.
    pub coverage_limit: f32,
    /// Width of the image region, pixels.
    pub width: u32,
    /// Height of the image region, pixels.
    pub height: u32,
    /// Tiles in a row of the image region.
    pub tiles_x: u32,
    /// Albedo of a diffuse override, GGX alpha of a metal one.
    pub material_parameter: f32,
    /// Height of the far field in texels; 0 without one.
    pub far_field_height: u32,
    /// As in [`Traversal`], for classic's walk.
    pub stop_sin2: f32,
    /// 1 in the last dispatch that a raster pass gets for this chunk: what it leaves unfinished is counted.
    pub last_round: u32,
    /// Micro-buffers in a row of the paper's image store.
    pub store_columns: u32,
}

/// Push constants of the receiver pass (`glsl/shared/image_region.glsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ImageRegion {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// 16 x 16 tiles in a row.
    pub tiles_x: u32,
    /// Pixel slots in the receiver buffers.
    pub pixels: u32,
}

/// Which parts of the method follow the paper to the letter instead of relume's corrections (`--paper`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Paper {
    /// RGBA16F image load, compare and store (5.4).
    pub image: bool,
    /// Ray-sphere test, one node a micro-pixel (5.2.1).
    pub coverage: bool,
    /// The same solid angle for every micro-pixel (Eq. 5).
    pub weights: bool,
    /// The refinement rule for coarse receivers (5.2.1).
    pub cut: bool,
}

impl Paper {
    /// All of them.
    pub const ALL: Self = Self { image: true, coverage: true, weights: true, cut: true };

    /// Constants that every traversal shader takes.
    pub(crate) fn traversal_constants(self) -> [Constant; 2] {
        [Constant::new(0, self.cut), Constant::new(1, self.coverage)]
    }

    /// True when a micro-pixel keeps one node instead of a sum.
    pub fn one_node(self) -> bool {
        self.image || self.coverage
    }
}

/// Squared sine of the half angle of a cone with the given share of a hemisphere's solid angle 2 pi: the test
/// `Omega(A) <= share * 2 pi` of Sabbadin 2019, Eq. 4, as `r^2 <= sin^2 * d^2`.
pub fn sin2_of_share(share: f64) -> f32 {
    let cosine = (1.0 - share).max(0.0);
    (1.0 - cosine * cosine) as f32
}

/// The hierarchy on the device: 40 bytes a node for the traversal (sphere, normal cone, area vector and skip), as many
/// as the paper's node has, and 16 for the colour.
pub struct GpuHierarchy {
    spheres: Buffer,
    cones: Buffer,
    areas: Buffer,
    colors: Buffer,
    /// Number of nodes.
    pub nodes: u32,
    /// Longest path from the root to a leaf, in nodes.
    pub depth: u32,
    /// Largest channel of any node's colour.
    pub brightest: f32,
}

impl GpuHierarchy {
    /// Uploads a hierarchy.
    ///
    /// # Errors
    /// [`crate::Error::Limit`] when an array is larger than the device's buffers.
    pub fn new(context: &Arc<Context>, hierarchy: &Hierarchy) -> Result<Self> {
        let four = vk::Format::R32G32B32A32_SFLOAT;
        let areas: Vec<[f32; 4]> = hierarchy
            .area_vectors
            .iter()
            .zip(&hierarchy.skips)
            .map(|([x, y, z], skip)| [*x, *y, *z, f32::from_bits(*skip)])
            .collect();
        let colors: Vec<[f32; 4]> = hierarchy.colors.iter().map(|[r, g, b]| [*r, *g, *b, 0.0]).collect();
        Ok(Self {
            spheres: Buffer::texels_from_slice(context, "node spheres", &hierarchy.spheres, four)?,
            cones: Buffer::texels_from_slice(context, "node cones", &hierarchy.cones, vk::Format::R32G32_UINT)?,
            areas: Buffer::texels_from_slice(context, "node areas", &areas, four)?,
            colors: Buffer::texels_from_slice(context, "node colours", &colors, four)?,
            nodes: hierarchy.skips.len() as u32,
            depth: hierarchy.depth,
            brightest: hierarchy.brightest(),
        })
    }

    /// The node arrays under the names that shaders use.
    pub fn bindings(&self) -> Bindings<'_> {
        Bindings::new()
            .buffer("node_spheres", &self.spheres)
            .buffer("node_cones", &self.cones)
            .buffer("node_areas", &self.areas)
            .buffer("node_colors", &self.colors)
    }
}

/// A receiver: level in the top four bits, index at that level below (`glsl/common/receivers.glsl`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Receiver(pub u32);

impl Receiver {
    /// Level of a 16 x 16 tile.
    pub const TILE_LEVEL: u32 = 4;

    /// From level and index.
    pub fn new(level: u32, index: u32) -> Self {
        Self(level << 28 | index)
    }

    /// 0 for a pixel, 4 for a tile.
    pub fn level(self) -> u32 {
        self.0 >> 28
    }

    /// Index at its level.
    pub fn index(self) -> u32 {
        self.0 & 0x0fff_ffff
    }

    /// Pixel indices below it.
    pub fn pixels(self) -> std::ops::Range<u32> {
        let shift = 2 * self.level();
        self.index() << shift..(self.index() + 1) << shift
    }

    /// The four receivers one level down; the level must not be 0.
    pub fn children(self) -> [Self; 4] {
        [0, 1, 2, 3].map(|k| Self::new(self.level() - 1, (self.index() << 2) + k))
    }

    /// Index into the receiver and list buffers, where levels lie one after the other.
    pub fn slot(self, pixels: u32) -> u32 {
        (pixels - (pixels >> (2 * self.level()))) / 3 * 4 + self.index()
    }

    /// Slots of all five levels above and including `pixels` pixel slots (a multiple of 256).
    pub fn slots(pixels: u32) -> u32 {
        pixels / 256 * 341
    }
}
