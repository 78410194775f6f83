//! The object's shadow on the scan around it, by cones through a distance field (`contact_shadow.comp`).

use std::sync::Arc;

use ash::vk;
use glam::{Affine3A, Vec3};

use super::point_operators::PointImages;
use super::points::PointView;
use crate::Result;
use crate::gpu::pipeline::DescriptorSet;
use crate::gpu::{Bindings, Buffer, ComputePipeline, Constant, Context, Recorder, Use};
use crate::preprocess::directional_light::DIRECTIONS;
use crate::preprocess::distance_field::DistanceField;

/// Where the object stands and which light it takes away.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadowSetup {
    /// World to the space of the distance field; scales alike along all axes.
    pub object_from_world: Affine3A,
    /// Middle of the object, world space.
    pub centre: Vec3,
    /// Radius of a sphere around it that holds the object, metres.
    pub radius: f32,
    /// Directions and the radiance from each ([`crate::preprocess::directional_light`]).
    pub lights: Vec<(Vec3, Vec3)>,
}

/// The pass for images of one size and one object.
pub struct ContactShadowPass {
    context: Arc<Context>,
    pipeline: ComputePipeline,
    set: DescriptorSet,
    setup: Buffer,
    grid: [[f32; 4]; 2],
    /// Share of the light that is left, a pixel.
    pub shadow: Buffer,
    field: Buffer,
}

/// Texels before the lights.
const HEAD: usize = 6;

impl ContactShadowPass {
    /// Uploads the field and makes the pipeline.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, images: &PointImages, field: &DistanceField) -> Result<Self> {
        let four = vk::Format::R32G32B32A32_SFLOAT;
        let setup = Buffer::with_texels(context, "shadow setup", (HEAD + 2 * DIRECTIONS) as u64 * 16, four)?;
        let distances = Buffer::texels_from_slice(context, "distance field", &field.distances, vk::Format::R32_SFLOAT)?;
        let pipeline = ComputePipeline::new(
            context,
            "contact_shadow/contact_shadow.comp",
            &[Constant::new(0, DIRECTIONS as u32)],
        )?;
        let shadow = shadow_buffer(context, images)?;
        let set = bind(&pipeline, images, [&distances, &setup, &shadow])?;
        let size = field.size.as_vec3();
        let grid = [field.low.extend(field.cell).into(), size.extend(0.0).into()];
        Ok(Self { context: context.clone(), pipeline, set, setup, grid, shadow, field: distances })
    }

    /// Works on other images from now on.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn bind(&mut self, images: &PointImages) -> Result<()> {
        self.shadow = shadow_buffer(&self.context, images)?;
        self.set = bind(&self.pipeline, images, [&self.field, &self.setup, &self.shadow])?;
        Ok(())
    }

    /// Where the object stands from now on.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn place(&self, setup: &ShadowSetup) -> Result<()> {
        let rows = setup.object_from_world.matrix3.transpose();
        let translation = setup.object_from_world.translation;
        let row = |axis: glam::Vec3A, t: f32| [axis.x, axis.y, axis.z, t];
        let mut texels = self.grid.to_vec();
        texels.extend([
            row(rows.x_axis, translation.x),
            row(rows.y_axis, translation.y),
            row(rows.z_axis, translation.z),
            setup.centre.extend(setup.radius).into(),
        ]);
        for (direction, light) in setup.lights.iter().take(DIRECTIONS) {
            texels.extend([direction.extend(0.0).to_array(), light.extend(0.0).to_array()]);
        }
        texels.resize(HEAD + 2 * DIRECTIONS, [0.0; 4]);
        self.setup.upload(bytemuck::cast_slice(&texels))
    }

    /// Records the pass.
    ///
    /// # Errors
    /// When the image is larger than a dispatch.
    pub fn record(&self, recorder: &mut Recorder, view: PointView) -> Result<()> {
        recorder
            .pass("contact shadow", |_, commands| self.pipeline.dispatch(commands, &self.set, &view, view.pixels()))?;
        recorder.barrier(&[Use::ComputeWrite], &[Use::CopySource]);
        Ok(())
    }
}

fn shadow_buffer(context: &Arc<Context>, images: &PointImages) -> Result<Buffer> {
    let (width, height, _) = images.levels.levels[0];
    let bytes = u64::from(width) * u64::from(height) * 16;
    Buffer::with_texels(context, "contact shadow", bytes, vk::Format::R32G32B32A32_SFLOAT)
}

fn bind(
    pipeline: &ComputePipeline,
    images: &PointImages,
    [field, setup, shadow]: [&Buffer; 3],
) -> Result<DescriptorSet> {
    pipeline.bind(
        &Bindings::new()
            .buffer("shaded_in", &images.shaded)
            .buffer("shaded_normals_in", &images.shaded_normals)
            .buffer("field", field)
            .buffer("shadow_setup", setup)
            .buffer("shadow", shadow),
    )
}
