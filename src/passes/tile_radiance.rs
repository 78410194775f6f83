//! Technique `shared`: from the sums of a tile's texels to their radiance.

use std::sync::Arc;

use ash::vk;

use super::Gather;
use crate::Result;
use crate::gpu::pipeline::{ComputePipeline, DescriptorSet};
use crate::gpu::{Bindings, Buffer, Constant, Context, Recorder, Use};

/// Unit direction of a place in [0, 1]^2 of the equal-area octahedral map (Clarberg 2008).
pub fn octahedral_direction(x: f64, y: f64) -> [f64; 3] {
    let (x, y) = (2.0 * x - 1.0, 2.0 * y - 1.0);
    let (width, height) = (x.abs(), y.abs());
    let beyond = 1.0 - width - height; // negative in the lower half
    let radius = 1.0 - beyond.abs();
    let turn = if radius > 0.0 { ((height - width) / radius + 1.0) * std::f64::consts::FRAC_PI_4 } else { 0.0 };
    let across = radius * (2.0 - radius * radius).sqrt();
    let z = (1.0 - radius * radius) * if beyond < 0.0 { -1.0 } else { 1.0 };
    [turn.cos() * across * if x < 0.0 { -1.0 } else { 1.0 }, turn.sin() * across * if y < 0.0 { -1.0 } else { 1.0 }, z]
}

/// Buffers of tiles (`glsl/common/tile_texel.glsl`).
pub struct Tiles {
    texels: Buffer,
    /// Texels along a side, even.
    pub size: u32,
    /// Tiles that fit.
    pub capacity: u32,
}

impl Tiles {
    /// Bytes of a tile with `size` texels along a side.
    pub fn bytes(size: u32) -> u64 {
        u64::from(size * size) * 8
    }

    /// Room for `capacity` tiles.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, size: u32, capacity: u32) -> Result<Self> {
        let format = vk::Format::R32G32B32A32_UINT;
        let bytes = u64::from(capacity) * Self::bytes(size);
        Ok(Self { texels: Buffer::with_texels(context, "tile texels", bytes, format)?, size, capacity })
    }

    /// The buffers under the names that shaders use.
    pub fn bindings<'a>(&'a self, others: Bindings<'a>) -> Bindings<'a> {
        others.buffer("tile_texels", &self.texels)
    }
}

/// Factor from radiance to the texels' range, which holds `brightest` and light of a thousand millionth of it.
pub fn radiance_scale(brightest: f32) -> f32 {
    32_768.0 / brightest.max(1e-20)
}

/// The pass.
pub struct TileRadiancePass {
    pipeline: ComputePipeline,
}

impl TileRadiancePass {
    /// Makes the pipeline for tiles with `size` texels along a side, with a far field or without.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(context: &Arc<Context>, size: u32, far_field: bool) -> Result<Self> {
        let constants = [Constant::new(3, size), Constant::new(10, far_field)];
        Ok(Self { pipeline: ComputePipeline::new(context, "tile_radiance/tile_radiance.comp", &constants)? })
    }

    /// A descriptor set for the pass; `bindings` has receivers, entries, sums, tiles, their slots and the far field.
    ///
    /// # Errors
    /// When a resource is missing.
    pub fn bind(&self, bindings: &Bindings<'_>) -> Result<DescriptorSet> {
        self.pipeline.bind(bindings)
    }

    /// Records the pass for a chunk of entries.
    ///
    /// # Errors
    /// When the chunk is larger than a dispatch.
    pub fn record(&self, recorder: &mut Recorder, set: &DescriptorSet, constants: Gather) -> Result<()> {
        let invocations = constants.entry_count * self.pipeline.workgroup;
        recorder.pass("tile radiance", |_, c| self.pipeline.dispatch(c, set, &constants, invocations))?;
        recorder.count("tiles", u64::from(constants.entry_count));
        recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeWrite, Use::CopySource]);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use proptest::prelude::*;

    /// As `octahedral_place` in `glsl/common/octahedral.glsl`.
    fn place(direction: Vec3) -> [f32; 2] {
        let size = direction.abs();
        let radius = (1.0 - size.z).max(0.0).sqrt();
        let turn = size.x.min(size.y).atan2(size.x.max(size.y)) / std::f32::consts::FRAC_PI_2;
        let turn = if size.x < size.y { 1.0 - turn } else { turn };
        let (x, y) = (radius - turn * radius, turn * radius);
        let (x, y) = if direction.z < 0.0 { (1.0 - y, 1.0 - x) } else { (x, y) };
        [x * direction.x.signum(), y * direction.y.signum()].map(|v| 0.5 + 0.5 * v)
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            rng_seed: proptest::test_runner::RngSeed::Fixed(2008),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        #[test]
        fn places_and_directions_are_inverse(x in 0.001..0.999f64, y in 0.001..0.999f64) {
            let direction = octahedral_direction(x, y).map(|v| v as f32);
            prop_assert!((Vec3::from(direction).length() - 1.0).abs() < 1e-6);
            let back = place(Vec3::from(direction));
            prop_assert!((f64::from(back[0]) - x).abs() < 1e-3 && (f64::from(back[1]) - y).abs() < 1e-3, "{back:?}");
        }
    }

    #[test]
    fn all_texels_have_the_same_solid_angle() {
        // The area of a small quadrilateral on the sphere, everywhere but at the poles, where it is not small.
        let side = 1.0 / 256.0;
        for i in 0..64 * 64 {
            let (x, y) = (f64::from(i % 64) / 64.0 + 0.3 * side, f64::from(i / 64) / 64.0 + 0.6 * side);
            let corner = |dx: f64, dy: f64| glam::DVec3::from(octahedral_direction(x + dx * side, y + dy * side));
            let (a, b, c, d) = (corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0));
            let area = 0.5 * (c - a).cross(d - b).length();
            let expected = 4.0 * std::f64::consts::PI * side * side;
            let pole = (corner(0.0, 0.0).z.abs() - 1.0).abs() < 1e-3;
            assert!(pole || (area / expected - 1.0).abs() < 5e-3, "{area} instead of {expected} at {x}, {y}");
        }
    }
}
