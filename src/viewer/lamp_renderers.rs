//! The light of lamps in the viewer: a quick guess of it while things move, what was asked for once they rest.

use std::path::PathBuf;
use std::sync::Arc;

use super::loader::Assets;
use super::messages::Stage;
use super::renderers::Shot;
use super::state::{LampChoice, ViewState};
use crate::frames::lamps::{LampFrame, LampRenderer, LampSettings, ObjectLight, PointLight};
use crate::frames::points::PointFrame;
use crate::frames::{MaterialChoice, Method};
use crate::gpu::Context;
use crate::preprocess::hierarchy::NodeRadiance;
use crate::scene::{Camera, Lamp, Object, Placement, Vertex};
use crate::{Error, Result};

/// Virtual point lights while things move, shared by blocks of [`QUICK_INTERLEAVE`] x [`QUICK_INTERLEAVE`] pixels: of one
/// bounce, whose maps serve as long as only the camera moves.
const QUICK_VPLS: u32 = 64;
const QUICK_INTERLEAVE: u32 = 4;
const QUICK_BOUNCES: u32 = 1;
/// Pixels along a side of a lamp's view then.
const QUICK_LIGHT_SIZE: u32 = 256;
/// Points of such a view, and of what is seen of the scan.
const QUICK_POINTS: u64 = 100_000;
/// Points that a map gets at least then.
const QUICK_ISM_POINTS: u32 = 2048;

/// What decides the light on the scan, wherever it is seen from.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Light {
    choice: LampChoice,
    /// Share of the scan's own light.
    share: f32,
    /// What casts a shadow, and where.
    object: Option<(PathBuf, Placement)>,
    /// As was asked for, not the quick guess.
    own: bool,
}

impl Light {
    /// That of a view; `None` without lamps.
    pub(super) fn of(state: &ViewState, shot: &Shot<'_>) -> Option<Self> {
        let choice = state.lit_by(shot.method)?.clone();
        let object = state.object.clone().filter(|_| shot.method != Method::Lamps);
        Some(Self {
            share: choice.share(shot.method),
            choice,
            object: object.map(|path| (path, state.placement)),
            own: shot.stage != Stage::Moving,
        })
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
            most_points: Some(QUICK_POINTS),
            ..settings
        }
    }
}

/// What is lit, and how it is seen.
pub(super) struct Lit<'a> {
    pub(super) assets: &'a Assets,
    pub(super) light: &'a Light,
    /// The object, its vertices in their place, and what it is made of.
    pub(super) object: Option<(&'a Object, &'a [Vertex], MaterialChoice)>,
    pub(super) shot: &'a Shot<'a>,
}

/// What a picture of the lit scan depends on: camera, size and light.
type Shown = (Camera, [u32; 2], Light);

/// The renderers of moving and of still pictures, which share the points.
#[derive(Default)]
pub(super) struct LampRenderers {
    slots: [Option<Slot>; 2],
    /// The last picture, and what it shows.
    frame: Option<(Shown, LampFrame)>,
}

struct Slot {
    renderer: LampRenderer,
    /// The object that is in its light, and where.
    object: Option<(PathBuf, Placement)>,
}

impl LampRenderers {
    /// Another scan is loaded, or there are no lamps any more.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    /// Radiance of all nodes of the scan.
    pub(super) fn relight(&mut self, context: &Arc<Context>, lit: &Lit<'_>) -> Result<(NodeRadiance, PointLight)> {
        let Some((_, _, hierarchy)) = &lit.assets.cloud else { return Err(no_scan()) };
        self.renderer(context, lit)?.relight(hierarchy, &lit.lamps(), lit.light.share)
    }

    /// What comes to the object straight from the lamps.
    pub(super) fn object(&mut self, context: &Arc<Context>, lit: &Lit<'_>) -> Result<ObjectLight> {
        self.renderer(context, lit)?.light_object(lit.shot.camera, &lit.lamps())
    }

    /// The light on the scan at all pixels of a view, and the share of its own light that stays.
    pub(super) fn picture(&mut self, context: &Arc<Context>, lit: &Lit<'_>) -> Result<(&LampFrame, f32)> {
        let shown = (*lit.shot.camera, lit.shot.size, lit.light.clone());
        let frame = match self.frame.take().filter(|(known, _)| *known == shown) {
            Some((_, frame)) => frame,
            None => self.renderer(context, lit)?.render(lit.shot.camera, &lit.lamps())?,
        };
        Ok((&self.frame.insert((shown, frame)).1, lit.light.share))
    }

    /// The scan by itself as the lamps' light is found on it, in that light.
    pub(super) fn scan_alone(&mut self, context: &Arc<Context>, lit: &Lit<'_>) -> Result<PointFrame> {
        let renderer = self.renderer(context, lit)?;
        let frame = renderer.render(lit.shot.camera, &lit.lamps())?;
        let surface = renderer.surface()?;
        let mut points = PointFrame {
            width: frame.width,
            height: frame.height,
            color_depth: surface.color_depth,
            normal: surface.normal,
            ..PointFrame::default()
        };
        frame.add_to(&mut points, lit.light.share);
        points.profile.add(&frame.profile);
        Ok(points)
    }

    /// The renderer for a light, which the other one lends its points.
    fn renderer(&mut self, context: &Arc<Context>, lit: &Lit<'_>) -> Result<&mut LampRenderer> {
        let Lit { assets, light, object, shot } = *lit;
        let (Some((_, _, hierarchy)), Some(chunks)) = (&assets.cloud, &assets.chunks) else { return Err(no_scan()) };
        let wanted = light.settings(shot.size);
        let [quick, own] = &mut self.slots;
        let (slot, other) = if light.own { (own, quick) } else { (quick, own) };
        let suits =
            |have: &LampSettings| LampSettings { width: wanted.width, height: wanted.height, ..have.clone() } == wanted;
        // One that fails on the way is not kept.
        let known = slot.take().filter(|slot| suits(slot.renderer.settings()));
        let mut next = match (known, other) {
            (Some(known), _) => known,
            (None, Some(Slot { renderer, .. })) => Slot { renderer: renderer.beside(wanted.clone())?, object: None },
            (None, None) => {
                let mut renderer = LampRenderer::new(context, chunks, wanted.clone())?;
                renderer.choose_leaves(hierarchy)?;
                Slot { renderer, object: None }
            }
        };
        next.renderer.resize(wanted.width, wanted.height)?;
        next.renderer.stop_when(shot.stop.clone());
        next.put(object, &light.object)?;
        Ok(&mut slot.insert(next).renderer)
    }
}

impl Slot {
    /// Puts the object into the light, at its place.
    fn put(
        &mut self,
        object: Option<(&Object, &[Vertex], MaterialChoice)>,
        place: &Option<(PathBuf, Placement)>,
    ) -> Result<()> {
        let path = |object: &Option<(PathBuf, Placement)>| object.as_ref().map(|(path, _)| path.clone());
        match object {
            _ if path(&self.object) != path(place) => {
                let placed = object.map(|(object, vertices, material)| {
                    (Object { vertices: vertices.to_vec(), ..object.clone() }, material)
                });
                self.renderer.set_object(placed.as_ref().map(|(object, material)| (object, *material)))?;
            }
            Some((_, vertices, _)) if self.object != *place => self.renderer.place_object(vertices)?,
            _ => {}
        }
        self.object.clone_from(place);
        object.map_or(Ok(()), |(_, _, material)| self.renderer.set_material(material))
    }
}

impl Lit<'_> {
    fn lamps(&self) -> Vec<Lamp> {
        self.light.choice.relative_to(self.assets.origin)
    }
}

fn no_scan() -> Error {
    Error::Argument("lamps need a scan to light".into())
}
