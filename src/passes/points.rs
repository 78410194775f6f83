//! The geometry pass of the point renderer: one pixel a point, colour and depth (Bouchiba et al. 2018, section 3), as
//! rasterised points or by atomics in compute (Schütz et al. 2021).

use std::sync::Arc;

use ash::vk;
use bytemuck::{Pod, Zeroable};

use crate::Result;
use crate::gpu::graphics::{GraphicsInfo, graphics_pipeline};
use crate::gpu::memory::ImageInfo;
use crate::gpu::pipeline::{DescriptorSet, Pipeline, Sampler};
use crate::gpu::{Bindings, Buffer, ComputePipeline, Context, Image, Recorder, Use};
use crate::preprocess::point_chunks::PackedPoint;
use crate::scene::Camera;

/// Push constants of all point passes (`glsl/shared/point_view.glsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PointView {
    /// Eye, world space.
    pub eye: [f32; 3],
    /// Distance to the image plane, pixels.
    pub focal: f32,
    /// To the right, unit length.
    pub right: [f32; 3],
    /// Points nearer than this are not drawn, metres.
    pub near: f32,
    /// Down in the image, unit length.
    pub down: [f32; 3],
    /// s_0, metres.
    pub spacing: f32,
    /// Away from the eye, unit length.
    pub forward: [f32; 3],
    /// Width of the image, pixels.
    pub width: u32,
    /// Height of the image, pixels.
    pub height: u32,
    /// Level that a pass writes.
    pub level: u32,
    /// Its width.
    pub level_width: u32,
    /// Its height.
    pub level_height: u32,
    /// First texel of the level that a pass reads.
    pub source: u32,
    /// First texel of the level that a pass writes.
    pub target: u32,
    /// First point of a dispatch.
    pub first: u32,
    /// Points of a dispatch.
    pub count: u32,
    /// `PointDisplay` as a number.
    pub display: u32,
    /// Levels of all pyramids.
    pub levels: u32,
}

impl PointView {
    /// What a camera sees in an image of `width` x `height`, of a cloud whose points are `spacing` metres apart.
    pub fn new(camera: &Camera, width: u32, height: u32, spacing: f32) -> Self {
        let (right, up, forward) = camera.basis();
        Self {
            eye: camera.from.into(),
            focal: 0.5 * height as f32 / (0.5 * camera.fov_y).tan(),
            right: right.into(),
            near: 2.0 * spacing,
            down: (-up).into(),
            spacing,
            forward: forward.into(),
            width,
            height,
            level_width: width,
            level_height: height,
            ..Self::default()
        }
    }

    /// Pixels of the image.
    pub fn pixels(&self) -> u32 {
        self.width * self.height
    }
}

/// How points are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PointGeometry {
    /// As a list of points, by the rasteriser.
    Raster,
    /// By 64-bit atomics on depth and colour in a compute shader.
    Atomics,
}

/// A run of points in a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointRun {
    /// Its first point.
    pub first: u32,
    /// Number of points.
    pub count: u32,
}

/// A buffer of points with what binds it.
pub struct PointBuffer {
    buffer: Arc<Buffer>,
    set: Option<DescriptorSet>,
}

/// What the pass draws into.
enum Target {
    Images { color: Image, depth: Image },
    Keys(Buffer),
}

impl Target {
    fn new(context: &Arc<Context>, geometry: PointGeometry, width: u32, height: u32) -> Result<Self> {
        match geometry {
            PointGeometry::Raster => {
                let info = |name, format, usage| ImageInfo { name, width, height, levels: 1, format, usage };
                let sampled = vk::ImageUsageFlags::SAMPLED;
                let color = vk::ImageUsageFlags::COLOR_ATTACHMENT | sampled;
                let depth = vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT | sampled;
                Ok(Self::Images {
                    color: Image::new(context, info("point colour", vk::Format::R32_UINT, color))?,
                    depth: Image::new(context, info("point depth", vk::Format::D32_SFLOAT, depth))?,
                })
            }
            PointGeometry::Atomics => {
                let bytes = u64::from(width) * u64::from(height) * TARGET_BYTES_PER_PIXEL;
                Ok(Self::Keys(Buffer::with_texels(context, "point keys", bytes, vk::Format::R32G32_UINT)?))
            }
        }
    }
}

/// Pipeline of one of both ways.
enum Draw {
    Raster(Pipeline),
    Atomics(ComputePipeline),
}

/// The pass, what it draws into and how that becomes level 0 of the point pyramid.
pub struct PointsPass {
    context: Arc<Context>,
    draw: Draw,
    target: Target,
    resolve: ComputePipeline,
    nearest: Sampler,
}

/// Bytes a pixel of what points are drawn into.
pub const TARGET_BYTES_PER_PIXEL: u64 = 8;

impl PointsPass {
    /// Makes pipelines, and targets for an image of `width` x `height`.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, geometry: PointGeometry, width: u32, height: u32) -> Result<Self> {
        let (draw, resolve) = match geometry {
            PointGeometry::Raster => (Draw::Raster(raster_pipeline(context)?), "point_resolve/from_images.comp"),
            PointGeometry::Atomics => {
                let pipeline = ComputePipeline::new(context, "points/points.comp", &[])?;
                (Draw::Atomics(pipeline), "point_resolve/from_keys.comp")
            }
        };
        let target = Target::new(context, geometry, width, height)?;
        Ok(Self {
            context: context.clone(),
            draw,
            target,
            resolve: ComputePipeline::new(context, resolve, &[])?,
            nearest: Sampler::new(context, vk::Filter::NEAREST, vk::SamplerAddressMode::CLAMP_TO_EDGE)?,
        })
    }

    /// Draws images of `width` x `height` from now on, of the points in `buffers`.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn resize(&mut self, buffers: &mut [PointBuffer], width: u32, height: u32) -> Result<()> {
        let geometry = match &self.draw {
            Draw::Raster(_) => PointGeometry::Raster,
            Draw::Atomics(_) => PointGeometry::Atomics,
        };
        self.target = Target::new(&self.context, geometry, width, height)?;
        buffers.iter_mut().try_for_each(|points| {
            points.set = self.bind(&points.buffer)?;
            Ok(())
        })
    }

    /// The set of the compute shader that draws points of a buffer.
    fn bind(&self, buffer: &Buffer) -> Result<Option<DescriptorSet>> {
        match (&self.draw, &self.target) {
            (Draw::Atomics(pipeline), Target::Keys(keys)) => {
                pipeline.bind(&Bindings::new().buffer("points", buffer).buffer("PointKeys", keys)).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// Room for `count` points.
    ///
    /// # Errors
    /// When it does not fit the device.
    pub fn buffer(&self, count: usize) -> Result<PointBuffer> {
        let bytes = (count * size_of::<PackedPoint>()) as u64;
        let buffer = Buffer::with_texels(&self.context, "points", bytes, vk::Format::R32G32B32A32_UINT)?;
        let set = self.bind(&buffer)?;
        Ok(PointBuffer { buffer: Arc::new(buffer), set })
    }

    /// The same points, to be drawn by this pass.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn share(&self, points: &PointBuffer) -> Result<PointBuffer> {
        Ok(PointBuffer { buffer: points.buffer.clone(), set: self.bind(&points.buffer)? })
    }

    /// Records the pass for runs of points of a buffer; `clear` for the first buffer of an image.
    ///
    /// # Errors
    /// When a run is larger than a dispatch.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        points: &PointBuffer,
        runs: &[PointRun],
        view: PointView,
        clear: bool,
    ) -> Result<()> {
        match (&self.draw, &self.target) {
            (Draw::Raster(pipeline), Target::Images { color, depth }) => {
                recorder.pass("points", |device, commands| {
                    let before = |used| if clear { Use::Undefined } else { used };
                    color.transition(device, commands, before(Use::SampledRead), Use::ColorTarget);
                    depth.transition(device, commands, before(Use::SampledRead), Use::DepthTarget);
                    self.begin(commands, (color, depth), view, clear);
                    draw(device, commands, pipeline, points, runs, view);
                    self.context.end_rendering(commands);
                    color.transition(device, commands, Use::ColorTarget, Use::SampledRead);
                    depth.transition(device, commands, Use::DepthTarget, Use::SampledRead);
                });
                Ok(())
            }
            (Draw::Atomics(pipeline), Target::Keys(keys)) => {
                if clear {
                    recorder.barrier(&[Use::ComputeWrite], &[Use::CopyTarget]);
                    recorder.pass("clear points", |device, commands| {
                        // SAFETY: the command buffer is recording and the buffer is live.
                        unsafe { device.cmd_fill_buffer(commands, keys.handle, 0, vk::WHOLE_SIZE, 0) };
                    });
                    recorder.barrier(&[Use::CopyTarget], &[Use::ComputeWrite]);
                }
                let Some(set) = &points.set else { return Ok(()) };
                recorder.pass("points", |_, commands| {
                    runs.iter().try_for_each(|run| {
                        let constants = PointView { first: run.first, count: run.count, ..view };
                        pipeline.dispatch(commands, set, &constants, run.count)
                    })
                })?;
                recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeWrite]);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// A descriptor set for [`Self::resolve`]; `bindings` has the buffers of level 0.
    ///
    /// # Errors
    /// When a resource is missing.
    pub fn bind_resolve(&self, bindings: Bindings<'_>) -> Result<DescriptorSet> {
        let bindings = match &self.target {
            Target::Images { color, depth } => bindings.sampled("point_depth", depth, self.nearest.handle).sampled(
                "point_color",
                color,
                self.nearest.handle,
            ),
            Target::Keys(keys) => bindings.buffer("point_keys", keys),
        };
        self.resolve.bind(&bindings)
    }

    /// Records the step from what was drawn to level 0 of the point pyramid.
    ///
    /// # Errors
    /// When the image is larger than a dispatch.
    pub fn resolve(&self, recorder: &mut Recorder, set: &DescriptorSet, view: PointView) -> Result<()> {
        recorder.pass("resolve points", |_, commands| self.resolve.dispatch(commands, set, &view, view.pixels()))?;
        recorder.barrier(&[Use::ComputeWrite], &[Use::ComputeWrite]);
        Ok(())
    }

    fn begin(&self, commands: vk::CommandBuffer, (color, depth): (&Image, &Image), view: PointView, clear: bool) {
        let attachment = |image: &Image, layout| {
            vk::RenderingAttachmentInfo::default()
                .image_view(image.view)
                .image_layout(layout)
                .load_op(if clear { vk::AttachmentLoadOp::CLEAR } else { vk::AttachmentLoadOp::LOAD })
                .store_op(vk::AttachmentStoreOp::STORE)
                // All zeros: black, and infinitely far.
                .clear_value(vk::ClearValue::default())
        };
        let colors = [attachment(color, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)];
        let depth = attachment(depth, vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL);
        let extent = vk::Extent2D { width: view.width, height: view.height };
        let info = vk::RenderingInfo::default()
            .render_area(vk::Rect2D { offset: vk::Offset2D::default(), extent })
            .layer_count(1)
            .color_attachments(&colors)
            .depth_attachment(&depth);
        self.context.begin_rendering(commands, &info);
    }
}

impl PointBuffer {
    /// Points that fit.
    pub fn capacity(&self) -> usize {
        self.buffer.size as usize / size_of::<PackedPoint>()
    }

    /// The points, for passes of other kinds.
    pub fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Fills the beginning of the buffer.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn upload(&self, points: &[PackedPoint]) -> Result<()> {
        self.buffer.upload(bytemuck::cast_slice(points))
    }
}

fn draw(
    device: &ash::Device,
    commands: vk::CommandBuffer,
    pipeline: &Pipeline,
    points: &PointBuffer,
    runs: &[PointRun],
    view: PointView,
) {
    let extent = vk::Extent2D { width: view.width, height: view.height };
    let viewport = vk::Viewport {
        x: 0.0,
        y: 0.0,
        width: view.width as f32,
        height: view.height as f32,
        min_depth: 0.0,
        max_depth: 1.0,
    };
    // SAFETY: all handles are live and `commands` records inside a rendering instance with these attachments.
    unsafe {
        device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::GRAPHICS, pipeline.handle);
        device.cmd_set_viewport(commands, 0, &[viewport]);
        device.cmd_set_scissor(commands, 0, &[vk::Rect2D { offset: vk::Offset2D::default(), extent }]);
        device.cmd_bind_vertex_buffers(commands, 0, &[points.buffer.handle], &[0]);
        pipeline.layout.push(commands, &view);
        for run in runs {
            device.cmd_draw(commands, run.count, 1, run.first, 0);
        }
    }
}

fn raster_pipeline(context: &Arc<Context>) -> Result<Pipeline> {
    graphics_pipeline(
        context,
        &GraphicsInfo {
            name: "points",
            shaders: ["points/points.vert", "points/points.frag"],
            constants: &[],
            topology: vk::PrimitiveTopology::POINT_LIST,
            stride: size_of::<PackedPoint>(),
            attributes: &[(vk::Format::R32G32B32_SFLOAT, 0), (vk::Format::R32_UINT, 12)],
            colors: &[vk::Format::R32_UINT],
            // Depth is near / z.
            nearer: vk::CompareOp::GREATER,
        },
    )
}
