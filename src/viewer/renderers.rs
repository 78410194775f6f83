//! The renderers of moving and of still pictures, which share the scan on the device.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::DVec3;

use super::lamp_renderers::{LampRenderers, Light, Lit};
use super::loader::{Assets, Part};
use super::messages::Stage;
use super::probe_renderers::{ProbeRenderers, Subject};
use super::state::ViewState;
use crate::frames::lamps::LampFrame;
use crate::frames::points::{PointDisplay, PointFrame};
use crate::frames::{Frame, GpuScene, Method, Paper, Quality, Renderer, Settings, Technique};
use crate::gpu::{Context, Profile};
use crate::preprocess::hierarchy::Hierarchy;
use crate::scene::{Camera, Object, Placement, Vertex};
use crate::{Error, Result};

/// Micro-pixels along a side in pictures of things that move.
const QUICK_MICROBUFFER: u32 = 12;
/// Parallax of their tiles, texels: hardly any is split.
const QUICK_PARALLAX: f64 = 2.0;

/// What a view needs on the device.
pub(super) struct Renderers {
    context: Arc<Context>,
    scene: Option<LitScene>,
    /// By stage.
    slots: [Option<Slot>; 3],
    /// Those of technique probes.
    probes: ProbeRenderers,
    lamps: LampRenderers,
    /// The simpler object's vertices and the object's own, and for which place.
    placed: [Option<Placed>; 2],
}

type Placed = (Placement, DVec3, Vec<Vertex>);

/// The scan, and what lies beyond it.
struct LitScene {
    scene: GpuScene,
    /// [`Assets::light`] of the far field.
    light: u64,
    /// Size of the far field, texels; none without one.
    size: Option<[u32; 2]>,
    /// That of the lamps on the scan; none where it has its own alone.
    lamps: Option<Light>,
}

struct Slot {
    renderer: Renderer,
    /// Where its object stands.
    placement: (Placement, DVec3),
}

/// How a view is to be rendered.
pub(super) struct Shot<'a> {
    pub(super) method: Method,
    pub(super) stage: Stage,
    /// Width and height, pixels.
    pub(super) size: [u32; 2],
    pub(super) camera: &'a Camera,
    /// Ends the picture early once it is true.
    pub(super) stop: Option<Arc<AtomicBool>>,
}

impl Renderers {
    pub(super) fn new(context: Arc<Context>) -> Self {
        let (slots, placed) = ([None, None, None], [None, None]);
        let (probes, lamps) = (ProbeRenderers::default(), LampRenderers::default());
        Self { context, scene: None, slots, probes, lamps, placed }
    }

    /// Other files are loaded.
    pub(super) fn changed(&mut self, parts: &[Part]) {
        let has = |part| parts.contains(&part);
        if has(Part::Object) || has(Part::Cloud) {
            self.slots = [None, None, None];
            self.probes.clear();
            self.placed = [None, None];
        }
        if has(Part::Cloud) {
            self.scene = None;
            self.lamps.clear();
        }
    }

    /// Makes all pipelines again, or keeps all that there are.
    pub(super) fn rebuild(&mut self, assets: &Assets) -> Result<()> {
        // Those of lamps are made again when they are needed.
        self.lamps.clear();
        if let (Some(lit), Some((_, _, hierarchy))) = (&mut self.scene, &assets.cloud) {
            lit.scene.relight(hierarchy, None)?;
            lit.lamps = None;
        }
        let (Some((_, object)), Some(simple)) = (&assets.object, &assets.simple_object) else { return Ok(()) };
        let again = |slot: &Option<Slot>, object: &Arc<Object>| -> Result<Option<Slot>> {
            let (Some(Slot { renderer, placement }), Some(lit)) = (slot, &self.scene) else { return Ok(None) };
            let object = Object::clone(object).transformed(placement.0.world_from_object(placement.1));
            let settings = made_for(renderer.settings());
            let renderer = Renderer::with_scene(&self.context, &lit.scene, &object, settings)?;
            Ok(Some(Slot { renderer, placement: *placement }))
        };
        let [moving, draft, finished] = &self.slots;
        let slots = [again(moving, simple)?, again(draft, object)?, again(finished, object)?];
        self.probes.rebuild(&self.context, assets)?;
        self.slots = slots;
        Ok(())
    }

    /// Renders a view of loaded files.
    pub(super) fn render(&mut self, assets: &Assets, state: &ViewState, shot: &Shot<'_>) -> Result<Frame> {
        if shot.method == Method::Lamps {
            let [width, height] = shot.size;
            return Ok(Frame::empty(width, height));
        }
        // Technique probes has one object until its own transfer is made, whether things move or not.
        let own = match shot.method {
            Method::Probes => shot.stage == Stage::Finished,
            Method::Cloud(_) | Method::Lamps => shot.stage != Stage::Moving,
        };
        let Some(object) = assets.object_for(own) else {
            return Err(Error::Argument("a view needs an object".into()));
        };
        let place = (state.placement, assets.origin);
        let placed = &mut self.placed[usize::from(own)];
        if !placed.as_ref().is_some_and(|(placement, origin, _)| (*placement, *origin) == place) {
            let vertices = object.transformed_vertices(place.0.world_from_object(place.1));
            *placed = Some((place.0, place.1, vertices));
        }
        match (shot.method, &assets.cloud) {
            (Method::Probes, _) => {
                self.slots = [None, None, None];
                let vertices = self.placed[usize::from(own)].as_ref().map_or(&[][..], |(_, _, vertices)| vertices);
                let Some(transfer) = assets.transfers.of(own) else {
                    return Err(Error::Argument("technique probes needs the object's transfer".into()));
                };
                let subject = Subject { object, transfer, vertices, own };
                self.probes.render(&self.context, assets, state, &subject, (shot.size, shot.camera))
            }
            (Method::Cloud(_) | Method::Lamps, Some((_, _, hierarchy))) => {
                self.probes.clear();
                let scene = self.scene(assets, hierarchy)?;
                let profile = self.relight(assets, state, hierarchy, shot)?;
                let mut frame = self.gather(state, &scene, object, place, shot)?;
                frame.stats.profile.add(&profile);
                if let Some(light) = Light::of(state, shot) {
                    let lit = lit(&self.placed, (assets, state), &light, shot);
                    let direct = self.lamps.object(&self.context, &lit)?;
                    direct.add_to(&mut frame);
                    frame.stats.profile.add(&direct.profile);
                }
                Ok(frame)
            }
            (Method::Cloud(_) | Method::Lamps, None) => Err(Error::Argument("a view needs a cloud".into())),
        }
    }

    /// The scan in front of the far field of now.
    fn scene(&mut self, assets: &Assets, hierarchy: &Hierarchy) -> Result<GpuScene> {
        let far_field = assets.far_field();
        let size = far_field.map(|far_field| [far_field.width, far_field.height]);
        let known = self.scene.take().filter(|lit| lit.size == size);
        let mut lit = match known {
            Some(lit) => lit,
            None => {
                // Memory of the old ones is free before the new one takes its own.
                self.slots = [None, None, None];
                let far_field = far_field.map(Arc::as_ref);
                let scene = GpuScene::new(&self.context, hierarchy, far_field, Paper::NONE)?;
                LitScene { scene, light: assets.light, size, lamps: None }
            }
        };
        if let Some(far_field) = far_field.filter(|_| lit.light != assets.light) {
            lit.scene.set_far_field(far_field)?;
            lit.light = assets.light;
        }
        Ok(self.scene.insert(lit).scene.clone())
    }

    /// Lights the scan on the device with the lamps of a view, unless it is.
    fn relight(
        &mut self,
        assets: &Assets,
        state: &ViewState,
        hierarchy: &Hierarchy,
        shot: &Shot<'_>,
    ) -> Result<Profile> {
        let Some(scene) = &mut self.scene else { return Ok(Profile::default()) };
        let wanted = Light::of(state, shot);
        let mut profile = Profile::default();
        match (&scene.lamps, &wanted) {
            (None, None) => {}
            (Some(known), Some(wanted)) if known.does_for(wanted) => return Ok(profile),
            (_, Some(light)) => {
                let lit = lit(&self.placed, (assets, state), light, shot);
                let (radiance, light) = self.lamps.relight(&self.context, &lit)?;
                scene.scene.relight(hierarchy, Some(&radiance))?;
                profile = light.profile;
            }
            (Some(_), None) => {
                scene.scene.relight(hierarchy, None)?;
                self.lamps.clear();
            }
        }
        scene.lamps = wanted;
        Ok(profile)
    }

    /// The lamps' light on what is seen around an object of the scan, and the share of its own that stays; none without
    /// lamps, and where the scan is not seen in its colours.
    pub(super) fn lamp_light(
        &mut self,
        assets: &Assets,
        state: &ViewState,
        shot: &Shot<'_>,
    ) -> Result<Option<(&LampFrame, f32)>> {
        let shown = shot.method != Method::Lamps && state.points.is_some_and(PointDisplay::shows_light);
        let Some(light) = Light::of(state, shot).filter(|_| shown) else { return Ok(None) };
        self.lamps.picture(&self.context, &lit(&self.placed, (assets, state), &light, shot)).map(Some)
    }

    /// The scan by itself in the light of the lamps.
    pub(super) fn scan_alone(&mut self, assets: &Assets, state: &ViewState, shot: &Shot<'_>) -> Result<PointFrame> {
        let Some(light) = Light::of(state, shot) else {
            return Err(Error::Argument("technique lamps needs a scan and lamps".into()));
        };
        self.lamps.scan_alone(&self.context, &Lit { assets, light: &light, object: None, shot })
    }

    /// A picture by a technique that gathers the scan's light.
    fn gather(
        &mut self,
        state: &ViewState,
        scene: &GpuScene,
        object: &Object,
        place: (Placement, DVec3),
        shot: &Shot<'_>,
    ) -> Result<Frame> {
        let Shot { stage, size: [width, height], camera, method, .. } = *shot;
        let moving = stage == Stage::Moving;
        let Some((_, _, vertices)) = &self.placed[usize::from(!moving)] else {
            return Err(Error::Argument("the object has no place".into()));
        };
        let settings = settings(state, stage, method, self.context.why_no_feedback().is_none());
        let slot = &mut self.slots[stage as usize];
        let fits = slot.as_mut().is_some_and(|slot| suits(&mut slot.renderer, &settings));
        if !fits {
            // Memory of the old one is free before the new one takes its own.
            *slot = None;
            let object = Object { vertices: vertices.clone(), ..object.clone() };
            let renderer = Renderer::with_scene(&self.context, scene, &object, made_for(&settings))?;
            *slot = Some(Slot { renderer, placement: place });
        }
        let Some(slot) = slot else { return Err(Error::Argument("there is no renderer".into())) };
        if slot.placement != place {
            slot.renderer.place(vertices)?;
            slot.placement = place;
        }
        slot.renderer.resize(width, height)?;
        slot.renderer.stop_when(shot.stop.clone());
        slot.renderer.render(camera, &mut |_, _| {})
    }
}

/// The view's object in its place, and the scan around it, in the light of lamps.
fn lit<'a>(
    placed: &'a [Option<Placed>; 2],
    (assets, state): (&'a Assets, &ViewState),
    light: &'a Light,
    shot: &'a Shot<'a>,
) -> Lit<'a> {
    let own = shot.stage != Stage::Moving;
    let vertices = placed[usize::from(own)].as_ref().map(|(_, _, vertices)| &vertices[..]);
    let object = assets.object_for(own).zip(vertices);
    Lit { assets, light, object: object.map(|(object, vertices)| (&**object, vertices, state.material)), shot }
}

/// The same for pictures of any size.
fn made_for(settings: &Settings) -> Settings {
    Settings { width: Renderer::LARGEST_REGION, height: Renderer::LARGEST_REGION, ..*settings }
}

/// Settings of a picture, but for its size.
fn settings(state: &ViewState, stage: Stage, method: Method, feedback: bool) -> Settings {
    if let (Stage::Finished, Method::Cloud(technique)) = (stage, method) {
        let quality = state.quality.settings();
        return Settings {
            technique,
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
            technique: Some(Method::Cloud(Technique::Classic)),
            microbuffer: Some(64),
            material: MaterialChoice::Metal(0.2),
            ..ViewState::default()
        };
        let settings = |stage, feedback| settings(&state, stage, state.method(true, feedback), feedback);
        let moving = settings(Stage::Moving, true);
        assert_eq!((moving.technique, moving.microbuffer, moving.sharp), (Technique::Shared, QUICK_MICROBUFFER, false));
        let finished = settings(Stage::Finished, true);
        assert_eq!((finished.technique, finished.microbuffer), (Technique::Classic, 64));
        assert_eq!(settings(Stage::Draft, false).technique, Technique::Classic);
    }

    #[test]
    fn without_a_scan_there_are_only_probes() {
        let state = |technique| ViewState { technique, ..ViewState::default() };
        let hybrid = Some(Method::Cloud(Technique::Hybrid));
        assert_eq!([None, hybrid].map(|t| state(t).method(false, true)), [Method::Probes; 2]);
        assert_eq!(state(hybrid).method(true, true), Method::Cloud(Technique::Hybrid));
        assert_eq!(state(hybrid).method(true, false), Method::Cloud(Technique::Classic));
        assert_eq!(state(Some(Method::Probes)).method(true, false), Method::Probes);
    }
}
