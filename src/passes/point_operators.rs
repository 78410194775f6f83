//! The pyramidal operators on the screen (Bouchiba et al. 2018, 3.1 to 3.3): point pyramid, hidden point removal,
//! pull-push, normals, shading. All levels of a pyramid lie one after the other in a texel buffer.

use std::sync::Arc;

use ash::vk;

use super::operator::Operator;
use super::points::{PointView, PointsPass};
use crate::Result;
use crate::gpu::pipeline::DescriptorSet;
use crate::gpu::{Bindings, Buffer, Constant, Context, Recorder, Use};

/// How hidden points are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum HiddenPoints {
    /// By the pyramidal neighbourhood that adapts to depth (3.1.2).
    #[default]
    Pyramid,
    /// By all pixels within this radius (Pintus et al. 2011).
    Fixed(u32),
}

/// Sizes of all levels and where each starts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Levels {
    /// (width, height, first texel), finest first.
    pub levels: Vec<(u32, u32, u32)>,
    /// Texels of all.
    pub texels: u32,
}

impl Levels {
    /// Levels down to a single texel.
    pub fn new(width: u32, height: u32) -> Self {
        let (mut width, mut height, mut first) = (width, height, 0);
        let mut levels = Vec::new();
        loop {
            levels.push((width, height, first));
            first += width * height;
            if width <= 1 && height <= 1 {
                return Self { levels, texels: first };
            }
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
        }
    }

    /// `view` with what a pass from level `source` to level `target` needs.
    fn step(&self, view: PointView, source: usize, target: usize) -> PointView {
        let (level_width, level_height, first) = self.levels[target];
        let source = self.levels[source].2;
        PointView { level: target as u32, level_width, level_height, source, target: first, ..view }
    }
}

/// Buffers of an image.
pub struct PointImages {
    /// Their levels.
    pub levels: Levels,
    points: Buffer,
    colors: Buffer,
    filled: Buffer,
    filled_colors: Buffer,
    normals: Buffer,
    /// Colour, and depth along the view in metres or 0, a pixel.
    pub shaded: Buffer,
    /// World normals, w 1 where there is one, a pixel.
    pub shaded_normals: Buffer,
}

impl PointImages {
    /// Bytes for an image of `width` x `height`.
    pub fn bytes(width: u32, height: u32) -> u64 {
        let pixels = u64::from(width) * u64::from(height);
        // Five pyramids, of which the levels add a third, and what is shaded.
        pixels * 4 / 3 * (16 + 16 + 4 + 4) + pixels * (4 + 16 + 16)
    }

    /// Makes the buffers.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, width: u32, height: u32) -> Result<Self> {
        let levels = Levels::new(width, height);
        let (four, one) = (vk::Format::R32G32B32A32_SFLOAT, vk::Format::R32_UINT);
        let (texels, pixels) = (u64::from(levels.texels), u64::from(width) * u64::from(height));
        let buffer = |name, texels: u64, format| {
            let size = if format == four { 16 } else { 4 };
            Buffer::with_texels(context, name, texels * size, format)
        };
        Ok(Self {
            points: buffer("point pyramid", texels, four)?,
            colors: buffer("point colours", pixels, one)?,
            filled: buffer("filled surface", texels, four)?,
            filled_colors: buffer("filled colours", texels, one)?,
            normals: buffer("point normals", texels, one)?,
            shaded: buffer("shaded points", pixels, four)?,
            shaded_normals: buffer("shaded normals", pixels, four)?,
            levels,
        })
    }

    /// The buffers under the names that shaders use.
    pub fn bindings(&self) -> Bindings<'_> {
        Bindings::new()
            .buffer("point_levels", &self.points)
            .buffer("point_levels_out", &self.points)
            .buffer("point_colors", &self.colors)
            .buffer("point_colors_out", &self.colors)
            .buffer("filled", &self.filled)
            .buffer("filled_out", &self.filled)
            .buffer("filled_colors", &self.filled_colors)
            .buffer("filled_colors_out", &self.filled_colors)
            .buffer("point_normals", &self.normals)
            .buffer("point_normals_out", &self.normals)
            .buffer("shaded", &self.shaded)
            .buffer("shaded_normals", &self.shaded_normals)
    }

    /// Positions in view space and weights of the finest level: before pull-push the visibility mask, after it the
    /// surface. Weight -1 is the background, 0 a hole.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn surface(&self) -> Result<Vec<[f32; 4]>> {
        let (width, height, _) = self.levels.levels[0];
        self.filled.download(width as usize * height as usize)
    }

    /// Positions in view space before hidden points are removed; z is 0 where there is no point.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn points(&self) -> Result<Vec<[f32; 4]>> {
        let (width, height, _) = self.levels.levels[0];
        self.points.download(width as usize * height as usize)
    }
}

/// Records an operator over the texels of a level.
fn record_level(operator: &Operator, recorder: &mut Recorder, name: &'static str, view: PointView) -> Result<()> {
    operator.record(recorder, name, &view, view.level_width * view.level_height)
}

/// All operators for images of one size.
pub struct PointOperators {
    resolve: DescriptorSet,
    pyramid: Operator,
    hidden: Operator,
    copy_colors: (vk::Buffer, vk::Buffer, u64),
    pull: Operator,
    push: Operator,
    normals: Operator,
    shade: Operator,
}

impl PointOperators {
    /// Makes the pipelines.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn new(
        context: &Arc<Context>,
        points: &PointsPass,
        images: &PointImages,
        hidden: HiddenPoints,
    ) -> Result<Self> {
        let bindings = images.bindings();
        let operator = |shader: &str, constants: &[Constant]| Operator::new(context, shader, constants, &bindings);
        Ok(Self {
            resolve: points.bind_resolve(bindings.clone())?,
            pyramid: operator("point_pyramid/point_pyramid.comp", &[])?,
            hidden: match hidden {
                HiddenPoints::Pyramid => operator("hidden_points/hidden_points.comp", &[])?,
                HiddenPoints::Fixed(radius) => operator("hidden_points/fixed.comp", &[Constant::new(0, radius)])?,
            },
            copy_colors: (images.colors.handle, images.filled_colors.handle, images.colors.size),
            pull: operator("pull_push/pull.comp", &[])?,
            push: operator("pull_push/push.comp", &[])?,
            normals: operator("point_normals/point_normals.comp", &[])?,
            shade: operator("point_shade/point_shade.comp", &[])?,
        })
    }

    /// Works on other images from now on.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn bind(&mut self, points: &PointsPass, images: &PointImages) -> Result<()> {
        let bindings = images.bindings();
        self.resolve = points.bind_resolve(bindings.clone())?;
        self.copy_colors = (images.colors.handle, images.filled_colors.handle, images.colors.size);
        let Self { pyramid, hidden, pull, push, normals, shade, .. } = self;
        [pyramid, hidden, pull, push, normals, shade].into_iter().try_for_each(|operator| operator.bind(&bindings))
    }

    /// Level 0 of the point pyramid, the others, and the visibility mask (3.1).
    ///
    /// # Errors
    /// When the image is larger than a dispatch.
    pub fn remove_hidden(
        &self,
        recorder: &mut Recorder,
        points: &PointsPass,
        levels: &Levels,
        view: PointView,
    ) -> Result<()> {
        points.resolve(recorder, &self.resolve, view)?;
        for level in 1..levels.levels.len() {
            record_level(&self.pyramid, recorder, "point pyramid", levels.step(view, level - 1, level))?;
        }
        record_level(&self.hidden, recorder, "hidden points", view)
    }

    /// Pull and push (3.2), and normals of all levels (3.3).
    ///
    /// # Errors
    /// When the image is larger than a dispatch.
    pub fn fill(&self, recorder: &mut Recorder, levels: &Levels, view: PointView) -> Result<()> {
        let (source, target, size) = self.copy_colors;
        recorder.pass("copy colours", |device, commands| {
            let region = vk::BufferCopy::default().size(size);
            // SAFETY: both buffers are live and at least as large.
            unsafe { device.cmd_copy_buffer(commands, source, target, &[region]) };
        });
        recorder.barrier(&[Use::CopyTarget], &[Use::ComputeWrite]);
        for level in 1..levels.levels.len() {
            record_level(&self.pull, recorder, "pull", levels.step(view, level - 1, level))?;
        }
        for level in (0..levels.levels.len() - 1).rev() {
            record_level(&self.push, recorder, "push", levels.step(view, level + 1, level))?;
        }
        for level in 0..levels.levels.len() {
            record_level(&self.normals, recorder, "point normals", levels.step(view, level, level))?;
        }
        Ok(())
    }

    /// What the screen shows.
    ///
    /// # Errors
    /// When the image is larger than a dispatch.
    pub fn shade(&self, recorder: &mut Recorder, view: PointView) -> Result<()> {
        record_level(&self.shade, recorder, "shade points", view)
    }
}
