//! What `render` shows around the object.

use std::sync::Arc;

use super::values;
use crate::formats::tone::ToneCurve;
use crate::frames::composite::{Backdrop, Composite, compose};
use crate::frames::points::{PointDisplay, PointFrame, PointRenderer, PointSettings, ShadowCaster};
use crate::frames::{Frame, Settings};
use crate::gpu::Context;
use crate::preprocess::distance_field::DistanceField;
use crate::preprocess::point_chunks::PointChunks;
use crate::scene::{Camera, FarField, Object};
use crate::{Error, Result};

/// What lies behind the object, and before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum BackdropChoice {
    /// Nothing: the image is transparent around the object
    #[default]
    None,
    /// The scan, and the far field where it has holes
    Points,
    /// The far field
    Environment,
}

#[derive(Clone, Debug, clap::Args)]
pub(super) struct BackdropArgs {
    /// What is seen around the object
    #[arg(long, value_enum, default_value_t)]
    backdrop: BackdropChoice,
    /// How the scan is shown: raw, filled, normals, headlight or eye-dome
    #[arg(long, value_name = "DISPLAY", default_value = "filled")]
    points: PointDisplay,
    /// Distance between the scan's points, metres [default: estimated]
    #[arg(long, value_name = "METRES", value_parser = values::positive, allow_hyphen_values = true)]
    spacing: Option<f64>,
    /// Do without the object's shadow on the scan around it
    #[arg(long)]
    no_contact_shadow: bool,
    /// From linear light to a PNG: srgb, filmic or agx
    #[arg(long, value_name = "CURVE", default_value = "srgb")]
    pub(super) tone: ToneCurve,
}

/// What the backdrop is made of.
pub(super) struct Around<'a> {
    pub(super) points: Option<Arc<PointChunks>>,
    pub(super) far_field: Option<&'a FarField>,
    /// The object in its place.
    pub(super) object: &'a Object,
}

/// The scan's renderer, and the object's distances for its shadow.
pub(super) struct ScanPicture {
    renderer: PointRenderer,
    field: Option<DistanceField>,
}

impl BackdropArgs {
    /// Whether anything is seen around the object.
    pub(super) fn any(&self) -> bool {
        self.backdrop != BackdropChoice::None
    }

    /// Whether lamps' light is added to what is seen of the scan: not where that is no colour.
    pub(super) fn shows_light(&self) -> bool {
        self.points.shows_light()
    }

    /// Whether the scan's points are needed.
    pub(super) fn shows_points(&self) -> bool {
        self.backdrop == BackdropChoice::Points
    }

    /// Refuses what makes no sense before anything is read.
    pub(super) fn check(&self, has_far_field: bool) -> Result<()> {
        if self.backdrop == BackdropChoice::Environment && !has_far_field {
            return Err(Error::Argument("--backdrop environment needs --environment FILE or --probes PATTERN".into()));
        }
        Ok(())
    }

    /// The scan as the camera sees it, in the object's shadow; `None` where it is not asked for. `kept` keeps what pictures
    /// in other light need again.
    pub(super) fn render_points(
        &self,
        context: &Arc<Context>,
        around: &Around<'_>,
        camera: &Camera,
        settings: &Settings,
        kept: &mut Option<ScanPicture>,
    ) -> Result<Option<PointFrame>> {
        let Some(chunks) = &around.points else { return Ok(None) };
        let picture = match kept.take() {
            Some(mut picture) => {
                if let Some(field) = &picture.field {
                    picture.renderer.move_shadow(caster(field, around))?;
                }
                picture
            }
            None => {
                let settings = PointSettings {
                    width: settings.width,
                    height: settings.height,
                    display: self.points,
                    spacing: self.spacing.map(|metres| metres as f32),
                    memory_budget: settings.memory_budget,
                    ..PointSettings::default()
                };
                let mut renderer = PointRenderer::new(context, chunks, settings)?;
                let shadow = !self.no_contact_shadow && self.points != PointDisplay::Raw;
                let field = shadow.then(|| DistanceField::new(around.object));
                renderer.cast_shadow(field.as_ref().map(|field| caster(field, around)))?;
                ScanPicture { renderer, field }
            }
        };
        let frame = kept.insert(picture).renderer.render(camera)?;
        Ok(Some(frame))
    }

    /// Object and backdrop in one picture.
    pub(super) fn compose(
        &self,
        frame: &Frame,
        camera: &Camera,
        points: Option<&PointFrame>,
        around: &Around<'_>,
    ) -> Composite {
        let spacing = around.points.as_ref().map_or(0.0, |chunks| chunks.spacing);
        let tolerance = self.spacing.map_or(spacing, |metres| metres as f32);
        let environment = around.far_field.filter(|_| self.backdrop != BackdropChoice::None);
        compose(frame, camera, Backdrop { points, environment, tolerance })
    }
}

/// The object, in its place already, in front of its light.
fn caster<'a>(field: &'a DistanceField, around: &Around<'a>) -> ShadowCaster<'a> {
    ShadowCaster { field, world_from_object: glam::Affine3A::IDENTITY, far_field: around.far_field }
}
