//! The renderers of moving and of still pictures, which share the scan on the device.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::DVec3;

use super::loader::{Assets, Part};
use super::state::ViewState;
use super::worker::{Stage, technique};
use crate::frames::{Frame, GpuScene, Paper, Quality, Renderer, Settings, Technique};
use crate::gpu::Context;
use crate::scene::{Camera, Object, Placement, Vertex};
use crate::{Error, Result};

/// Micro-pixels along a side in pictures of things that move.
const QUICK_MICROBUFFER: u32 = 12;
/// Parallax of their tiles, texels: hardly any is split.
const QUICK_PARALLAX: f64 = 2.0;

/// What a view needs on the device.
pub(super) struct Renderers {
    context: Arc<Context>,
    scene: Option<GpuScene>,
    /// By stage.
    slots: [Option<Slot>; 3],
    /// The simpler object's vertices and the object's own, and for which place.
    placed: [Option<Placed>; 2],
}

type Placed = (Placement, DVec3, Vec<Vertex>);

struct Slot {
    renderer: Renderer,
    /// Where its object stands.
    placement: (Placement, DVec3),
}

impl Renderers {
    pub(super) fn new(context: Arc<Context>) -> Self {
        Self { context, scene: None, slots: [None, None, None], placed: [None, None] }
    }

    /// Other files are loaded.
    pub(super) fn changed(&mut self, parts: &[Part]) {
        self.slots = [None, None, None];
        if parts.contains(&Part::Object) || parts.contains(&Part::Cloud) {
            self.placed = [None, None];
        }
        if parts.contains(&Part::Environment) || parts.contains(&Part::Cloud) {
            self.scene = None;
        }
    }

    /// Makes all pipelines again, or keeps all that there are.
    pub(super) fn rebuild(&mut self, assets: &Assets) -> Result<()> {
        let (Some(scene), Some((_, object)), Some(simple)) = (&self.scene, &assets.object, &assets.simple_object)
        else {
            return Ok(());
        };
        let again = |slot: &Option<Slot>, object: &Arc<Object>| -> Result<Option<Slot>> {
            let Some(Slot { renderer, placement }) = slot else { return Ok(None) };
            let object = Object::clone(object).transformed(placement.0.world_from_object(placement.1));
            let settings = made_for(renderer.settings());
            let renderer = Renderer::with_scene(&self.context, scene, &object, settings)?;
            Ok(Some(Slot { renderer, placement: *placement }))
        };
        let [moving, draft, finished] = &self.slots;
        self.slots = [again(moving, simple)?, again(draft, object)?, again(finished, object)?];
        Ok(())
    }

    /// Renders a view of loaded files.
    pub(super) fn render(
        &mut self,
        assets: &Assets,
        state: &ViewState,
        stage: Stage,
        [width, height]: [u32; 2],
        camera: &Camera,
        stop: Option<Arc<AtomicBool>>,
    ) -> Result<Frame> {
        let moving = stage == Stage::Moving;
        let own = assets.object.as_ref().map(|(_, object)| object);
        let object = if moving { assets.simple_object.as_ref() } else { own };
        let (Some(object), Some((_, _, hierarchy))) = (object, &assets.cloud) else {
            return Err(Error::Argument("a view needs a cloud and an object".into()));
        };
        let settings = settings(state, stage, self.context.why_no_feedback().is_none());
        let far_field = assets.environment.as_ref().map(|(_, far_field)| far_field.as_ref());
        let place = (state.placement, assets.origin);
        let vertices = match &mut self.placed[usize::from(!moving)] {
            Some((placement, origin, vertices)) if (*placement, *origin) == place => vertices,
            placed => {
                let vertices = object.transformed_vertices(place.0.world_from_object(place.1));
                &placed.insert((place.0, place.1, vertices)).2
            }
        };
        let scene = match &self.scene {
            Some(scene) => scene.clone(),
            None => {
                let scene = GpuScene::new(&self.context, hierarchy, far_field, Paper::NONE)?;
                self.scene.insert(scene).clone()
            }
        };
        let slot = &mut self.slots[stage as usize];
        let fits = slot.as_mut().is_some_and(|slot| suits(&mut slot.renderer, &settings));
        if !fits {
            // Memory of the old one is free before the new one takes its own.
            *slot = None;
            let object = Object { vertices: vertices.clone(), ..object.as_ref().clone() };
            let renderer = Renderer::with_scene(&self.context, &scene, &object, made_for(&settings))?;
            *slot = Some(Slot { renderer, placement: place });
        }
        let Some(slot) = slot else { return Err(Error::Argument("there is no renderer".into())) };
        if slot.placement != place {
            slot.renderer.place(vertices)?;
            slot.placement = place;
        }
        slot.renderer.resize(width, height)?;
        slot.renderer.stop_when(stop);
        slot.renderer.render(camera, &mut |_, _| {})
    }
}

/// The same for pictures of any size.
fn made_for(settings: &Settings) -> Settings {
    Settings { width: Renderer::LARGEST_REGION, height: Renderer::LARGEST_REGION, ..*settings }
}

/// Settings of a picture, but for its size.
fn settings(state: &ViewState, stage: Stage, feedback: bool) -> Settings {
    if stage == Stage::Finished {
        let quality = state.quality.settings();
        return Settings {
            technique: technique(state, feedback),
            microbuffer: state.microbuffer.unwrap_or(quality.microbuffer),
            material: state.material,
            ..quality
        };
    }
    let technique = if feedback { Technique::Shared } else { Technique::Classic };
    Settings {
        technique,
        material: state.material,
        microbuffer: QUICK_MICROBUFFER,
        parallax: QUICK_PARALLAX,
        ..Quality::Draft.settings()
    }
}

/// Whether a renderer does for other settings, of whatever size; it takes a material that it can.
fn suits(renderer: &mut Renderer, wanted: &Settings) -> bool {
    let have = *renderer.settings();
    let same = have.technique == wanted.technique
        && have.microbuffer == wanted.microbuffer
        && have.stop == wanted.stop
        && have.sharp == wanted.sharp
        && have.parallax == wanted.parallax;
    same && renderer.set_material(wanted.material)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::MaterialChoice;

    #[test]
    fn moving_pictures_are_drafts_whatever_was_asked_for() {
        let state = ViewState {
            technique: Some(Technique::Classic),
            microbuffer: Some(64),
            material: MaterialChoice::Metal(0.2),
            ..ViewState::default()
        };
        let moving = settings(&state, Stage::Moving, true);
        assert_eq!((moving.technique, moving.microbuffer, moving.sharp), (Technique::Shared, QUICK_MICROBUFFER, false));
        let finished = settings(&state, Stage::Finished, true);
        assert_eq!((finished.technique, finished.microbuffer), (Technique::Classic, 64));
        assert_eq!(settings(&state, Stage::Draft, false).technique, Technique::Classic);
    }
}
