//! Technique probes in the viewer: the simplified object while things move, the object itself once they rest.

use std::sync::Arc;

use glam::DVec3;

use super::loader::Assets;
use super::state::ViewState;
use crate::frames::probes::{ProbeRenderer, ProbeSettings, Projection, Reflection};
use crate::frames::{Frame, Settings};
use crate::gpu::{Context, Profile};
use crate::preprocess::transfer::Transfer;
use crate::scene::{Camera, FarField, Object, Placement, Vertex};
use crate::{Error, Result};

/// Samples of a lobe in pictures of things that move.
const QUICK_LOBES: u32 = 8;
/// Probes are at most so wide then, texels: what they take goes with their size, whatever that of the picture.
const QUICK_PROBE: u32 = 512;
/// ... and projected at this width: four bands of spherical harmonics hardly differ.
const QUICK_PROJECTION: u32 = 256;
/// Most memory while a picture is made: what else the viewer has on the device counts too, and may be several times what
/// one renderer takes.
const BUDGET: u64 = 8 * Settings::DEFAULT_BUDGET;

/// The renderers of the simplified object and of the object itself.
#[derive(Default)]
pub(super) struct ProbeRenderers {
    slots: [Option<Slot>; 2],
}

struct Slot {
    renderer: ProbeRenderer,
    /// Where its object stands.
    placement: (Placement, DVec3),
    /// [`Assets::light`] that it was lit by; none before the first.
    light: Option<u64>,
}

/// What is rendered.
pub(super) struct Subject<'a> {
    pub(super) object: &'a Object,
    pub(super) transfer: &'a Transfer,
    /// The object's vertices in their place.
    pub(super) vertices: &'a [Vertex],
    /// The object itself, not the simplified one.
    pub(super) own: bool,
}

impl ProbeRenderers {
    /// Other files are loaded, or another technique is in use.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    /// Makes all pipelines again, or keeps all that there are.
    pub(super) fn rebuild(&mut self, context: &Arc<Context>, assets: &Assets) -> Result<()> {
        let again = |slot: &Option<Slot>, own: bool| -> Result<Option<Slot>> {
            let (Some(slot), Some(transfer)) = (slot, assets.transfers.of(own)) else { return Ok(None) };
            let Some(object) = assets.object_for(own) else { return Ok(None) };
            let (placement, origin) = slot.placement;
            let object = Object::clone(object).transformed(placement.world_from_object(origin));
            Slot::new(context, &object, transfer, slot.placement, *slot.renderer.settings()).map(Some)
        };
        let [quick, own] = &self.slots;
        self.slots = [again(quick, false)?, again(own, true)?];
        Ok(())
    }

    /// Renders a view.
    pub(super) fn render(
        &mut self,
        context: &Arc<Context>,
        assets: &Assets,
        state: &ViewState,
        subject: &Subject<'_>,
        ([width, height], camera): ([u32; 2], &Camera),
    ) -> Result<Frame> {
        let Some(far_field) = assets.far_field() else {
            return Err(Error::Argument("technique probes needs light probes or a far field".into()));
        };
        let place = (state.placement, assets.origin);
        let slot = &mut self.slots[usize::from(subject.own)];
        if !slot.as_mut().is_some_and(|slot| slot.renderer.set_material(state.material)) {
            // Memory of the old one is free before the new one takes its own.
            *slot = None;
        }
        let slot = match slot {
            Some(slot) => slot,
            none => {
                let object = Object { vertices: subject.vertices.to_vec(), ..subject.object.clone() };
                none.insert(Slot::new(context, &object, subject.transfer, place, settings(state, subject.own))?)
            }
        };
        if slot.placement != place {
            slot.renderer.place(subject.vertices, place.0.world_from_object(place.1))?;
            slot.placement = place;
        }
        let mut profile = Profile::default();
        if slot.light != Some(assets.light) {
            let coarse = if subject.own { None } else { coarse(far_field) };
            slot.renderer.light(coarse.as_ref().unwrap_or(far_field), &mut profile)?;
            slot.light = Some(assets.light);
        }
        slot.renderer.resize(width, height)?;
        let mut frame = slot.renderer.render(camera)?;
        frame.stats.profile.add(&profile);
        Ok(frame)
    }
}

impl Slot {
    /// For an object in its place.
    fn new(
        context: &Arc<Context>,
        object: &Object,
        transfer: &Transfer,
        placement: (Placement, DVec3),
        settings: ProbeSettings,
    ) -> Result<Self> {
        let world_from_object = placement.0.world_from_object(placement.1);
        let renderer = ProbeRenderer::new(context, object, world_from_object, Some(transfer), settings)?;
        Ok(Self { renderer, placement, light: None })
    }
}

/// A probe of fewer texels, where it has too many for things that move.
fn coarse(far_field: &FarField) -> Option<FarField> {
    let mut smaller = None;
    while smaller.as_ref().unwrap_or(far_field).width > QUICK_PROBE {
        smaller = Some(smaller.as_ref().unwrap_or(far_field).half()?);
    }
    smaller
}

/// Settings of a picture, but for its size.
fn settings(state: &ViewState, own: bool) -> ProbeSettings {
    let (reflection, width) = match own {
        true => (Reflection::default(), None),
        false => (Reflection::Lobes(QUICK_LOBES), Some(QUICK_PROJECTION)),
    };
    let projection = Projection { width, ..Projection::default() };
    let material = state.material;
    ProbeSettings { material, reflection, projection, memory_budget: BUDGET, ..ProbeSettings::default() }
}
