//! The scan behind and before the object. This is the one place where the viewer gets its backdrop from.

use std::sync::Arc;

use glam::DVec3;

use super::loader::{Assets, Part};
use super::messages::Stage;
use super::renderers::Shot;
use super::state::ViewState;
use crate::Result;
use crate::frames::composite::{Backdrop, Composite, compose};
use crate::frames::points::{PointDisplay, PointFrame, PointRenderer, PointSettings, ShadowCaster};
use crate::frames::{Frame, Method, Settings};
use crate::gpu::Context;
use crate::scene::{Camera, Placement};

/// Points in pictures of things that move.
const QUICK_POINTS: u64 = 100_000;

/// The scan on the device, from the first time that it is shown on.
#[derive(Default)]
pub(super) struct Scan {
    renderer: Option<PointRenderer>,
    /// Where the object stands that casts its shadow, and [`Assets::light`] beyond the scan.
    shadow: Option<(Placement, DVec3, u64)>,
    /// The last picture, and what it shows: where only the light changes, as while probes are played, most of it stays.
    picture: Option<(Shown, PointFrame)>,
}

/// What a picture depends on besides its shadow: camera, size, display, most points.
type Shown = (Camera, [u32; 2], PointDisplay, Option<u64>);

impl Scan {
    /// Other files are loaded.
    pub(super) fn changed(&mut self, parts: &[Part]) {
        if parts.contains(&Part::Cloud) || parts.contains(&Part::Object) {
            *self = Self::default();
        }
    }

    /// The scan, displayed as the state says; `None` where it is not shown.
    pub(super) fn render(
        &mut self,
        context: &Arc<Context>,
        assets: &Assets,
        state: &ViewState,
        shot: &Shot<'_>,
    ) -> Result<Option<&PointFrame>> {
        let Shot { size: [width, height], camera, .. } = *shot;
        let moving = shot.stage == Stage::Moving;
        let (Some(display), Some(chunks)) = (state.points, &assets.chunks) else { return Ok(None) };
        let most_points = moving.then_some(QUICK_POINTS);
        let renderer = match &mut self.renderer {
            Some(renderer) => renderer,
            none => {
                let memory_budget = Settings::DEFAULT_BUDGET;
                let settings = PointSettings { width, height, memory_budget, ..PointSettings::default() };
                (self.shadow, self.picture) = (None, None);
                none.insert(PointRenderer::new(context, chunks, settings)?)
            }
        };
        renderer.resize(width, height)?;
        renderer.show(display, most_points);
        let shown = (*camera, [width, height], display, most_points);
        let mut known = self.picture.take().filter(|(known, _)| *known == shown);
        let place = (state.placement, assets.origin, assets.light);
        if let Some(field) = assets.field.as_deref().filter(|_| display != PointDisplay::Raw) {
            let caster = ShadowCaster {
                field,
                world_from_object: place.0.world_from_object(place.1),
                far_field: assets.far_field().map(Arc::as_ref),
            };
            match self.shadow {
                None => {
                    renderer.cast_shadow(Some(caster))?;
                    known = None;
                }
                Some(known) if known != place => renderer.move_shadow(caster)?,
                Some(_) => {}
            }
            self.shadow = Some(place);
        }
        let picture = match known {
            None => renderer.render(camera)?,
            Some((_, mut picture)) => {
                renderer.shade_again(&mut picture)?;
                picture
            }
        };
        Ok(Some(&self.picture.insert((shown, picture)).1))
    }
}

/// Object, scan and far field in one picture; technique lamps shows the scan alone.
pub(super) fn composed(assets: &Assets, frame: &Frame, scan: Option<&PointFrame>, shot: &Shot<'_>) -> Composite {
    let environment = assets.far_field().map(Arc::as_ref).filter(|_| shot.method != Method::Lamps);
    let tolerance = assets.chunks.as_ref().map_or(0.0, |chunks| chunks.spacing);
    compose(frame, shot.camera, Backdrop { points: scan, environment, tolerance })
}
