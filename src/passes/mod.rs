//! One GPU pass a file, under the same name as its folder in `glsl/`, and the structs that cross the border to GLSL.

pub mod bin;
pub mod contact_shadow;
pub mod convolve;
pub mod gbuffer;
pub mod ism;
pub mod lamp_cloud;
pub mod lamp_light;
pub mod lamp_object;
pub mod lamp_view;
mod operator;
pub mod point_operators;
pub mod points;
pub mod probe_light;
pub mod probe_object;
pub mod rasterise;
pub mod receivers;
pub mod refine;
pub mod surfel_view;
pub mod tile_convolve;
pub mod tile_radiance;
pub mod trace;
pub mod traverse;
pub mod vpl;

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use ash::vk;
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use crate::gpu::{Bindings, Buffer, Constant, Context, Recorder, Use};
use crate::preprocess::hierarchy::{Hierarchy, NodeRadiance, mean_luminance};
use crate::{Error, Result};

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
    /// Nodes that fit a tile's list (technique `shared`).
    pub list_capacity: u32,
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
    /// Mean luminance of the cloud.
    pub typical: f32,
    /// GGX alpha below which lobes have buffers of their own; 0 for none.
    pub sharp_alpha: f32,
    /// Radiance to the texels of the tiles of technique `shared`.
    pub radiance_scale: f32,
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

/// Records a pass that fills whole buffers with a word, after what used them before and before what writes them next.
fn fill(recorder: &mut Recorder, name: &'static str, buffers: &[(&Buffer, u32)]) {
    recorder.barrier(&[Use::ComputeWrite], &[Use::CopyTarget]);
    recorder.pass(name, |device, commands| {
        for (buffer, word) in buffers {
            // SAFETY: the command buffer is recording and the buffers are live.
            unsafe { device.cmd_fill_buffer(commands, buffer.handle, 0, vk::WHOLE_SIZE, *word) };
        }
    });
    recorder.barrier(&[Use::CopyTarget], &[Use::ComputeWrite]);
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
    /// None of them.
    pub const NONE: Self = Self { image: false, coverage: false, weights: false, cut: false };

    /// All of them.
    pub const ALL: Self = Self { image: true, coverage: true, weights: true, cut: true };

    /// True when a micro-pixel keeps one node instead of a sum.
    pub fn one_node(self) -> bool {
        self.image || self.coverage
    }
}

/// By which rules the nodes of a cut are chosen (`glsl/common/cut.glsl`).
#[derive(Clone, Copy, Debug, Default)]
pub struct CutRules {
    /// The paper's ways.
    pub paper: Paper,
    /// One cut for all pixels of a tile.
    pub shared: bool,
}

impl CutRules {
    /// Constants that every traversal shader takes.
    pub(crate) fn constants(self) -> [Constant; 3] {
        let Paper { cut, coverage, .. } = self.paper;
        [Constant::new(0, cut), Constant::new(1, coverage), Constant::new(4, self.shared)]
    }
}

/// Squared sine of the half angle of a cone with the given share of a hemisphere's solid angle 2 pi: the test
/// `Omega(A) <= share * 2 pi` of Sabbadin 2019, Eq. 4, as `r^2 <= sin^2 * d^2`.
pub fn sin2_of_share(share: f64) -> f32 {
    let cosine = (1.0 - share).max(0.0);
    (1.0 - cosine * cosine) as f32
}

/// The hierarchy on the device: 40 bytes a node for the traversal (sphere, normal cone, area vector and skip), as many
/// as the paper's node has, and 16 for the radiance (radiance vector and chromaticity; the mean colour for the paper's
/// ways that keep one node a micro-pixel, which would not be the paper's with another).
pub struct GpuHierarchy {
    spheres: Buffer,
    cones: Buffer,
    areas: Buffer,
    radiances: Buffer,
    /// Number of nodes.
    pub nodes: u32,
    /// Longest path from the root to a leaf, in nodes.
    pub depth: u32,
    /// Bits of [`GpuHierarchy::brightest`].
    brightest: AtomicU32,
    /// Bits of [`GpuHierarchy::typical`].
    typical: AtomicU32,
    /// One node a micro-pixel ([`Paper::one_node`]).
    one_node: bool,
}

impl GpuHierarchy {
    /// Uploads a hierarchy for renderings in the given ways of the paper.
    ///
    /// # Errors
    /// [`Error::Limit`] for 2^28 nodes or more, or when an array is larger than the device's buffers.
    pub fn new(context: &Arc<Context>, hierarchy: &Hierarchy, paper: Paper) -> Result<Self> {
        let nodes = hierarchy.len();
        if nodes > MOST_NODES {
            return Err(Error::Limit(format!("the hierarchy has {nodes} nodes; devices get at most {MOST_NODES}")));
        }
        let four = vk::Format::R32G32B32A32_SFLOAT;
        let one_node = paper.one_node();
        let (areas, radiances) = light_texels(hierarchy, None, one_node);
        Ok(Self {
            spheres: Buffer::texels_from_slice(context, "node spheres", &hierarchy.spheres, four)?,
            cones: Buffer::texels_from_slice(context, "node cones", &hierarchy.cones, vk::Format::R32G32_UINT)?,
            areas: Buffer::texels_from_slice(context, "node areas", &areas, four)?,
            radiances: Buffer::texels_from_slice(context, "node radiances", &radiances, four)?,
            nodes: nodes as u32,
            depth: hierarchy.depth,
            brightest: AtomicU32::new(hierarchy.brightest_point.to_bits()),
            typical: AtomicU32::new(hierarchy.mean_luminance().to_bits()),
            one_node,
        })
    }

    /// Gives all nodes other radiance, or that which they were made with. `hierarchy` is the one they are of.
    ///
    /// # Errors
    /// [`Error::Argument`] for another number of nodes; Vulkan's own errors.
    pub fn relight(&self, hierarchy: &Hierarchy, radiance: Option<&NodeRadiance>) -> Result<()> {
        let given = radiance.map_or(hierarchy.len(), |radiance| radiance.colors.len());
        if [hierarchy.len(), given] != [self.nodes as usize; 2] {
            let nodes = self.nodes;
            return Err(Error::Argument(format!("radiance of {given} nodes for a hierarchy of {nodes}")));
        }
        let (areas, radiances) = light_texels(hierarchy, radiance, self.one_node);
        self.areas.upload(bytemuck::cast_slice(&areas))?;
        self.radiances.upload(bytemuck::cast_slice(&radiances))?;
        let brightest = radiance.map_or(hierarchy.brightest_point, |radiance| radiance.brightest_point);
        let typical = radiance.map_or(hierarchy.mean_luminance(), |radiance| mean_luminance(&radiance.colors));
        self.brightest.store(brightest.to_bits(), Ordering::Relaxed);
        self.typical.store(typical.to_bits(), Ordering::Relaxed);
        Ok(())
    }

    /// Largest channel of any point's radiance, which bounds that of nodes from all sides.
    pub fn brightest(&self) -> f32 {
        f32::from_bits(self.brightest.load(Ordering::Relaxed))
    }

    /// Mean luminance of the cloud.
    pub fn typical(&self) -> f32 {
        f32::from_bits(self.typical.load(Ordering::Relaxed))
    }

    /// The node arrays under the names that shaders use.
    pub fn bindings(&self) -> Bindings<'_> {
        Bindings::new()
            .buffer("node_spheres", &self.spheres)
            .buffer("node_cones", &self.cones)
            .buffer("node_areas", &self.areas)
            .buffer("node_radiances", &self.radiances)
    }
}

/// What the device has of the nodes' light: area vectors with skips and [`Hierarchy::opens`], and radiances.
fn light_texels(
    hierarchy: &Hierarchy,
    radiance: Option<&NodeRadiance>,
    one_node: bool,
) -> (Vec<[f32; 4]>, Vec<[f32; 4]>) {
    let colors = radiance.map_or(&hierarchy.colors, |radiance| &radiance.colors);
    let vectors = radiance.map_or(&hierarchy.radiance_vectors, |radiance| &radiance.radiance_vectors);
    let area = |(node, ([x, y, z], skip)): (usize, (&[f32; 3], &u32))| {
        let opens = if hierarchy.opens_in(colors, node) { OPENS } else { 0 };
        [*x, *y, *z, float_with(*skip | opens)]
    };
    let radiance = |([x, y, z], color): (&[f32; 3], &[f32; 3])| match *color {
        [r, g, b] if one_node => [r, g, b, 0.0],
        color => [*x, *y, *z, float_with(packed_chromaticity(color))],
    };
    rayon::join(
        || hierarchy.area_vectors.par_iter().zip(&hierarchy.skips).enumerate().map(area).collect(),
        || vectors.par_iter().zip(colors).map(radiance).collect(),
    )
}

/// Skips, of which the largest is the number of nodes, fit [`float_with`] with a bit to spare.
const MOST_NODES: usize = (1 << 28) - 1;
/// That bit: [`Hierarchy::opens`].
const OPENS: u32 = 1 << 28;

/// A float that carries 29 bits through a texel of floats. As they are they might be a denormal number, which devices
/// may flush to zero, or NaN, whose bits they need not keep; with bit 30 set and bit 29 clear they are neither.
fn float_with(bits: u32) -> f32 {
    f32::from_bits(1 << 30 | bits)
}

/// A colour's channels divided by the largest: which that is in bits 26 and 27, and the other two, in their order, in
/// 13 bits each from the lowest on, as fractions of 8191.
fn packed_chromaticity(color: [f32; 3]) -> u32 {
    let [r, g, b] = color;
    let (largest, index, others) = match () {
        () if r >= g && r >= b => (r, 0, [g, b]),
        () if g >= b => (g, 1, [r, b]),
        () => (b, 2, [r, g]),
    };
    // Black has no chromaticity, and a radiance vector of zero.
    let [first, second] = others.map(|c| if largest > 0.0 { (c / largest * 8191.0 + 0.5) as u32 } else { 0 });
    index << 26 | second << 13 | first
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// As `chromaticity` in `glsl/common/hierarchy.glsl`.
    fn unpacked(bits: u32) -> [f32; 3] {
        let [a, b] = [bits & 8191, bits >> 13 & 8191].map(|fraction| fraction as f32 / 8191.0);
        match bits >> 26 & 3 {
            0 => [1.0, a, b],
            1 => [a, 1.0, b],
            _ => [a, b, 1.0],
        }
    }

    #[test]
    fn whatever_a_float_carries_it_is_a_normal_number() {
        for bits in [0, 1, 0x7f_ffff, 0x80_0000, 0x1f80_0000, MOST_NODES as u32] {
            let float = float_with(bits);
            assert!(float.is_normal());
            assert_eq!(float.to_bits() & 0x1fff_ffff, bits);
        }
    }

    #[test]
    fn pure_colors_and_grays_are_exact() {
        for color in [[2.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1e-30], [0.25; 3], [1e15, 1e15, 0.0]] {
            let largest = color.into_iter().fold(0.0, f32::max);
            assert_eq!(unpacked(packed_chromaticity(color)), color.map(|c| c / largest));
        }
        assert_eq!(packed_chromaticity([0.0; 3]), 0);
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            rng_seed: proptest::test_runner::RngSeed::Fixed(709),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        #[test]
        fn chromaticity_is_kept_to_a_thousandth(color in prop::array::uniform3(prop_oneof![0.0..1.0f32, 0.0..1e-3f32])) {
            let weights = [0.2126, 0.7152, 0.0722];
            let luminance = |c: [f32; 3]| c.into_iter().zip(weights).map(|(c, weight)| c * weight).sum::<f32>();
            let largest = color.into_iter().fold(0.0, f32::max);
            prop_assume!(largest > 0.0);
            let bits = packed_chromaticity(color);
            prop_assert!(bits < 1 << 29);
            // As the shader scales it to the luminance.
            let back = unpacked(bits);
            let decoded = back.map(|c| c * luminance(color) / luminance(back));
            for (value, expected) in decoded.into_iter().zip(color) {
                prop_assert!((value - expected).abs() <= 1e-3 * largest, "{decoded:?} instead of {color:?}");
            }
        }
    }
}
