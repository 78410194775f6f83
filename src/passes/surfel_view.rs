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
    /// Albedo, and depth along the view in metres or 0, a pixel.
    surface: Buffer,
    /// Unit normals, world space, a pixel.
    pub normals: Buffer,
    keys: Buffer,
    _sides: Buffer,
    edges: Operator,
    nearest: Operator,
    resolve: Operator,
    /// By buffer of points.
    sets: Vec<[DescriptorSet; 2]>,
}

impl SurfelViewPass {
    /// Makes buffers and pipelines for what is drawn into `images`.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, images: &PointImages, points: &[LitPoints<'_>]) -> Result<Self> {
        let (width, height, _) = images.levels.levels[0];
        let pixels = u64::from(width) * u64::from(height);
        let four = vk::Format::R32G32B32A32_SFLOAT;
        let surface = Buffer::with_texels(context, "surface", pixels * 16, four)?;
        let normals = Buffer::with_texels(context, "surface normals", pixels * 16, four)?;
        let keys = Buffer::with_texels(context, "surfel keys", pixels * 16, vk::Format::R32G32_UINT)?;
        let sides = Buffer::with_texels(context, "surfel sides", pixels * 4, vk::Format::R32_UINT)?;
        let shared = Bindings::new()
            .buffer("shaded_in", &images.shaded)
            .buffer("shaded_normals_in", &images.shaded_normals)
            .buffer("SurfelKeys", &keys)
            .buffer("surfel_taken", &keys)
            .buffer("SurfelSides", &sides)
            .buffer("surfel_sides_in", &sides)
            .buffer("surfel_sides_out", &sides)
            .buffer("surface_out", &surface)
            .buffer("surface_normals_out", &normals);
        let first = shared.clone().and(points[0].bindings());
        let edges = Operator::new(context, "surfel_view/edges.comp", &[], &first)?;
        let nearest = Operator::new(context, "surfel_view/nearest.comp", &[], &first)?;
        let resolve = Operator::new(context, "surfel_view/resolve.comp", &[], &first)?;
        let sets = points
            .iter()
            .map(|buffer| {
                let bindings = shared.clone().and(buffer.bindings());
                Ok([nearest.set(&bindings)?, resolve.set(&bindings)?])
            })
            .collect::<Result<_>>()?;
        Ok(Self { surface, normals, keys, _sides: sides, edges, nearest, resolve, sets })
    }

    /// The G-buffer under the names that shaders use.
    pub fn bindings(&self) -> Bindings<'_> {
        Bindings::new().buffer("surface", &self.surface).buffer("surface_normals", &self.normals)
    }

    /// Records the pass after the points were drawn for `view`.
    ///
    /// # Errors
    /// When there are more points or pixels than a dispatch has.
    pub fn record(&self, recorder: &mut Recorder, points: &[LitPoints<'_>], view: PointView) -> Result<()> {
        super::fill(recorder, "clear surfels", &[(&self.keys, u32::MAX)]);
        self.edges.record(recorder, "silhouettes", &view, view.pixels())?;
        for (buffer, [set, _]) in points.iter().zip(&self.sets) {
            let dispatches: Vec<_> = buffer
                .runs()
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
