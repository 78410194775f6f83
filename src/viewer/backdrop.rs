//! The scan behind and before the object. This is the one place where the viewer gets its backdrop from.

use std::sync::Arc;

use glam::DVec3;

use super::loader::Assets;
use super::state::ViewState;
use crate::Result;
use crate::frames::composite::{Backdrop, Composite, compose};
use crate::frames::points::{PointDisplay, PointFrame, PointRenderer, PointSettings, ShadowCaster};
use crate::frames::{Frame, Settings};
use crate::gpu::Context;
use crate::scene::{Camera, Placement};

/// Points in pictures of things that move.
const QUICK_POINTS: u64 = 100_000;

/// The scan on the device, from the first time that it is shown on.
#[derive(Default)]
pub(super) struct Scan {
    renderer: Option<PointRenderer>,
    /// Where the object stands that casts its shadow.
    shadow: Option<(Placement, DVec3)>,
}

impl Scan {
    /// Other files are loaded.
    pub(super) fn changed(&mut self) {
        *self = Self::default();
    }

    /// The scan, displayed as the state says; `None` where it is not shown.
    pub(super) fn render(
        &mut self,
        context: &Arc<Context>,
        assets: &Assets,
        state: &ViewState,
        [width, height]: [u32; 2],
        camera: &Camera,
        moving: bool,
    ) -> Result<Option<PointFrame>> {
        let (Some(display), Some(chunks)) = (state.points, &assets.chunks) else { return Ok(None) };
        let most_points = moving.then_some(QUICK_POINTS);
        let renderer = match &mut self.renderer {
            Some(renderer) => renderer,
            none => {
                let memory_budget = Settings::DEFAULT_BUDGET;
                let settings = PointSettings { width, height, memory_budget, ..PointSettings::default() };
                self.shadow = None;
                none.insert(PointRenderer::new(context, chunks, settings)?)
            }
        };
        renderer.resize(width, height)?;
        renderer.show(display, most_points);
        let place = (state.placement, assets.origin);
        if let Some(field) = assets.field.as_deref().filter(|_| display != PointDisplay::Raw) {
            let caster = ShadowCaster {
                field,
                world_from_object: place.0.world_from_object(place.1),
                far_field: assets.environment.as_ref().map(|(_, far_field)| far_field.as_ref()),
            };
            match self.shadow {
                None => renderer.cast_shadow(Some(caster))?,
                Some(known) if known != place => renderer.move_shadow(caster)?,
                Some(_) => {}
            }
            self.shadow = Some(place);
        }
        renderer.render(camera).map(Some)
    }
}

/// Object, scan and far field in one picture.
pub(super) fn composed(assets: &Assets, frame: &Frame, scan: Option<&PointFrame>, camera: &Camera) -> Composite {
    let environment = assets.environment.as_ref().map(|(_, far_field)| far_field.as_ref());
    let tolerance = assets.chunks.as_ref().map_or(0.0, |chunks| chunks.spacing);
    compose(frame, camera, Backdrop { points: scan, environment, tolerance })
}
