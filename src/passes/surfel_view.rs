//! G-buffers of a cloud with normals (Preiner 2010, 4.1): what the point passes drew, made exact by the points themselves.

use std::sync::Arc;

use ash::vk;

use super::operator::Operator;
use super::point_operators::PointImages;
use super::points::PointView;
use super::vpl::LitPoints;
use crate::Result;
use crate::gpu::pipeline::DescriptorSet;
use crate::gpu::{Bindings, Buffer, Context, Recorder};

/// The pass for images of one size.
pub struct SurfelViewPass {
    context: Arc<Context>,
    images: SurfelImages,
    edges: Operator,
    nearest: Operator,
    resolve: Operator,
    /// By buffer of points.
    sets: Vec<[DescriptorSet; 2]>,
}

struct SurfelImages {
    /// Albedo, and depth along the view in metres or 0, a pixel.
    surface: Buffer,
    /// Unit normals, world space, a pixel.
    normals: Buffer,
    keys: Buffer,
    sides: Buffer,
}

impl SurfelImages {
    fn new(context: &Arc<Context>, drawn: &PointImages) -> Result<Self> {
        let (width, height, _) = drawn.levels.levels[0];
        let pixels = u64::from(width) * u64::from(height);
        let four = vk::Format::R32G32B32A32_SFLOAT;
        Ok(Self {
            surface: Buffer::with_texels(context, "surface", pixels * 16, four)?,
            normals: Buffer::with_texels(context, "surface normals", pixels * 16, four)?,
            keys: Buffer::with_texels(context, "surfel keys", pixels * 16, vk::Format::R32G32_UINT)?,
            sides: Buffer::with_texels(context, "surfel sides", pixels * 8, vk::Format::R32_UINT)?,
        })
    }

    fn bindings<'a>(&'a self, drawn: &'a PointImages, points: &LitPoints<'a>) -> Bindings<'a> {
        Bindings::new()
            .buffer("shaded_in", &drawn.shaded)
            .buffer("shaded_normals_in", &drawn.shaded_normals)
            .buffer("SurfelKeys", &self.keys)
            .buffer("surfel_taken", &self.keys)
            .buffer("SurfelSides", &self.sides)
            .buffer("surfel_sides_in", &self.sides)
            .buffer("surfel_sides_out", &self.sides)
            .buffer("surface_out", &self.surface)
            .buffer("surface_normals_out", &self.normals)
            .and(points.bindings())
    }
}

impl SurfelViewPass {
    /// Makes buffers and pipelines for what is drawn into `drawn`.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, drawn: &PointImages, points: &[LitPoints<'_>]) -> Result<Self> {
        let images = SurfelImages::new(context, drawn)?;
        let first = images.bindings(drawn, &points[0]);
        let edges = Operator::new(context, "surfel_view/edges.comp", &[], &first)?;
        let nearest = Operator::new(context, "surfel_view/nearest.comp", &[], &first)?;
        let resolve = Operator::new(context, "surfel_view/resolve.comp", &[], &first)?;
        let mut pass = Self { context: context.clone(), images, edges, nearest, resolve, sets: Vec::new() };
        pass.bind_sets(drawn, points)?;
        Ok(pass)
    }

    /// Takes what is drawn into other images, of whatever size, from now on.
    ///
    /// # Errors
    /// When buffers of that size do not fit the device.
    pub fn bind(&mut self, drawn: &PointImages, points: &[LitPoints<'_>]) -> Result<()> {
        self.images = SurfelImages::new(&self.context, drawn)?;
        let first = self.images.bindings(drawn, &points[0]);
        // What these were bound to is gone.
        self.edges.bind(&first)?;
        self.nearest.bind(&first)?;
        self.resolve.bind(&first)?;
        self.bind_sets(drawn, points)
    }

    fn bind_sets(&mut self, drawn: &PointImages, points: &[LitPoints<'_>]) -> Result<()> {
        let set = |buffer| {
            let bindings = self.images.bindings(drawn, buffer);
            Ok([self.nearest.set(&bindings)?, self.resolve.set(&bindings)?])
        };
        self.sets = points.iter().map(set).collect::<Result<_>>()?;
        Ok(())
    }

    /// Unit normals, world space, a pixel.
    pub fn normals(&self) -> &Buffer {
        &self.images.normals
    }

    /// The cloud's own colour, and depth along the view in metres or 0, a pixel.
    pub fn surface(&self) -> &Buffer {
        &self.images.surface
    }

    /// The G-buffer under the names that shaders use.
    pub fn bindings(&self) -> Bindings<'_> {
        Bindings::new().buffer("surface", &self.images.surface).buffer("surface_normals", &self.images.normals)
    }

    /// Records the pass after a share of the points was drawn for `view`.
    ///
    /// # Errors
    /// When there are more points or pixels than a dispatch has.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        (points, share): (&[LitPoints<'_>], f32),
        view: PointView,
    ) -> Result<()> {
        super::fill(recorder, "clear surfels", &[(&self.images.keys, u32::MAX)]);
        self.edges.record(recorder, "silhouettes", &view, view.pixels())?;
        for (buffer, [set, _]) in points.iter().zip(&self.sets) {
            let dispatches: Vec<_> = buffer
                .thin_runs(share)
                .into_iter()
                .map(|(first, count)| (PointView { first, count, source: buffer.base, ..view }, count))
                .collect();
            self.nearest.record_with(recorder, "nearest surfels", set, &dispatches)?;
        }
        for (buffer, [_, set]) in points.iter().zip(&self.sets) {
            let constants = PointView { count: buffer.count, source: buffer.base, ..view };
            self.resolve.record_with(recorder, "resolve surfels", set, &[(constants, view.pixels())])?;
        }
        Ok(())
    }
}
