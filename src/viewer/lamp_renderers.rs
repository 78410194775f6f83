//! The light of lamps in the viewer: a quick guess of it while things move, what was asked for once they rest.

use std::sync::Arc;

use super::loader::Assets;
use super::messages::Stage;
use super::renderers::Shot;
use super::state::LampChoice;
use crate::frames::lamps::{LampFrame, LampRenderer, LampSettings, PointLight};
use crate::frames::points::PointFrame;
use crate::gpu::Context;
use crate::preprocess::hierarchy::NodeRadiance;
use crate::scene::Camera;
use crate::{Error, Result};

/// Virtual point lights while things move, shared by blocks of [`QUICK_INTERLEAVE`] x [`QUICK_INTERLEAVE`] pixels: of one
/// bounce, whose maps serve as long as only the camera moves.
const QUICK_VPLS: u32 = 64;
const QUICK_INTERLEAVE: u32 = 4;
const QUICK_BOUNCES: u32 = 1;
/// Pixels along a side of a lamp's view then.
const QUICK_LIGHT_SIZE: u32 = 256;
/// Most points that a map gets then.
const QUICK_ISM_POINTS: u32 = 2048;

/// What decides the light on the scan, wherever it is seen from.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Light {
    choice: LampChoice,
    /// Share of the scan's own light.
    share: f32,
    /// As was asked for, not the quick guess.
    own: bool,
}

impl Light {
    /// That of a shot.
    pub(super) fn new(choice: &LampChoice, shot: &Shot<'_>) -> Self {
        Self { choice: choice.clone(), share: choice.share(shot.method), own: shot.stage != Stage::Moving }
    }

    /// Whether it does in the place of another one.
    pub(super) fn does_for(&self, wanted: &Self) -> bool {
        *self == Self { own: self.own, ..wanted.clone() } && (self.own || !wanted.own)
    }

    fn settings(&self, [width, height]: [u32; 2]) -> LampSettings {
        let settings = LampSettings { width, height, ..self.choice.settings() };
        if self.own {
            return settings;
        }
        LampSettings {
            bounces: settings.bounces.min(QUICK_BOUNCES),
            vpls: settings.vpls.min(QUICK_VPLS),
            interleave: QUICK_INTERLEAVE,
            ism_points: QUICK_ISM_POINTS,
            light_size: QUICK_LIGHT_SIZE,
            ..settings
        }
    }
}

/// The renderers of moving and of still pictures, which share the points.
#[derive(Default)]
pub(super) struct LampRenderers {
    slots: [Option<LampRenderer>; 2],
    /// The last picture, and what it shows.
    frame: Option<((Camera, [u32; 2], Light), LampFrame)>,
}

impl LampRenderers {
    /// Another scan is loaded, or there are no lamps any more.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    /// Radiance of all nodes of the scan.
    pub(super) fn relight(
        &mut self,
        context: &Arc<Context>,
        assets: &Assets,
        light: &Light,
        shot: &Shot<'_>,
    ) -> Result<(NodeRadiance, PointLight)> {
        let Some((_, _, hierarchy)) = &assets.cloud else { return Err(no_scan()) };
        let lamps = light.choice.relative_to(assets.origin);
        self.renderer(context, assets, light, shot)?.relight(hierarchy, &lamps, light.share)
    }

    /// The light on the scan at all pixels of a view, and the share of its own light that stays.
    pub(super) fn picture(
        &mut self,
        context: &Arc<Context>,
        assets: &Assets,
        light: &Light,
        shot: &Shot<'_>,
    ) -> Result<(&LampFrame, f32)> {
        let shown = (*shot.camera, shot.size, light.clone());
        let frame = match self.frame.take().filter(|(known, _)| *known == shown) {
            Some((_, frame)) => frame,
            None => {
                let lamps = light.choice.relative_to(assets.origin);
                self.renderer(context, assets, light, shot)?.render(shot.camera, &lamps)?
            }
        };
        Ok((&self.frame.insert((shown, frame)).1, light.share))
    }

    /// The scan by itself as the lamps' light is found on it, in that light.
    pub(super) fn scan_alone(
        &mut self,
        context: &Arc<Context>,
        assets: &Assets,
        light: &Light,
        shot: &Shot<'_>,
    ) -> Result<PointFrame> {
        let lamps = light.choice.relative_to(assets.origin);
        let renderer = self.renderer(context, assets, light, shot)?;
        let lit = renderer.render(shot.camera, &lamps)?;
        let surface = renderer.surface()?;
        let mut points = PointFrame {
            width: lit.width,
            height: lit.height,
            color_depth: surface.color_depth,
            normal: surface.normal,
            ..PointFrame::default()
        };
        lit.add_to(&mut points, light.share);
        points.profile.add(&lit.profile);
        Ok(points)
    }

    /// The renderer for a light, which the other one lends its points.
    fn renderer(
        &mut self,
        context: &Arc<Context>,
        assets: &Assets,
        light: &Light,
        shot: &Shot<'_>,
    ) -> Result<&mut LampRenderer> {
        let (Some((_, _, hierarchy)), Some(chunks)) = (&assets.cloud, &assets.chunks) else { return Err(no_scan()) };
        let wanted = light.settings(shot.size);
        let [quick, own] = &mut self.slots;
        let (slot, other) = if light.own { (own, quick) } else { (quick, own) };
        let suits =
            |have: &LampSettings| LampSettings { width: wanted.width, height: wanted.height, ..*have } == wanted;
        let mut known = slot.take().filter(|renderer| suits(renderer.settings()));
        if let Some(renderer) = &mut known {
            renderer.resize(wanted.width, wanted.height)?;
        }
        let mut renderer = match (known, other) {
            (Some(renderer), _) => renderer,
            (None, Some(other)) => other.beside(wanted)?,
            (None, None) => {
                let mut renderer = LampRenderer::new(context, chunks, wanted)?;
                renderer.choose_leaves(hierarchy)?;
                renderer
            }
        };
        renderer.stop_when(shot.stop.clone());
        Ok(slot.insert(renderer))
    }
}

fn no_scan() -> Error {
    Error::Argument("lamps need a scan to light".into())
}
