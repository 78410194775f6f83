//! Reads what a view needs, and keeps it until another file is asked for.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::{DVec3, Vec3};

use super::player::Player;
use super::state::ViewState;
use super::transfers::Transfers;
use crate::Result;
use crate::formats::cloud::{CloudOptions, Up};
use crate::formats::{bsh, cloud, image, object};
use crate::preprocess::distance_field::DistanceField;
use crate::preprocess::hierarchy::{self, BuildOptions, Hierarchy};
use crate::preprocess::point_chunks::PointChunks;
use crate::preprocess::simplify::simplify;
use crate::scene::{FarField, Object};

/// Triangles of an object in pictures of things that move.
const QUICK_TRIANGLES: usize = 12_000;

/// A part of a scene that a file is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Cloud or hierarchy.
    Cloud,
    /// Object.
    Object,
    /// Far field.
    Environment,
    /// Light probes.
    Probes,
}

/// What has been read.
#[derive(Default)]
pub(super) struct Assets {
    pub(super) object: Option<(PathBuf, Arc<Object>)>,
    pub(super) cloud: Option<(PathBuf, Up, Arc<Hierarchy>)>,
    /// What was subtracted from the cloud's coordinates.
    pub(super) origin: DVec3,
    environment: Option<(PathBuf, Arc<FarField>)>,
    probes: Option<Player>,
    /// Counts up with every other light from beyond the scan.
    pub(super) light: u64,
    /// The cloud's points.
    pub(super) chunks: Option<Arc<PointChunks>>,
    /// The object with fewer triangles, for pictures of things that move.
    pub(super) simple_object: Option<Arc<Object>>,
    /// Distances to the object's surface.
    pub(super) field: Option<Arc<DistanceField>>,
    /// The object's transfers.
    pub(super) transfers: Transfers,
}

/// How far reading is.
pub(super) type Report<'a> = &'a mut dyn FnMut(&str, f32);

impl Assets {
    /// Reads the files of `state` that are not there yet; returns which parts are new.
    ///
    /// # Errors
    /// The part and the reason; what was there before stays.
    pub(super) fn load(&mut self, state: &ViewState, report: Report<'_>) -> Result<Vec<Part>, (Part, crate::Error)> {
        let mut new = Vec::new();
        // The object first: estimated normals of the cloud look at it.
        if let Some(path) = wanted(&state.object, self.object.as_ref().map(|(path, _)| path)) {
            report(&format!("reading {}", name(path)), 0.1);
            let object = object::load(path).map_err(|e| (Part::Object, e))?;
            self.field = Some(Arc::new(DistanceField::new(&object)));
            self.simple_object = Some(Arc::new(simplify(&object, QUICK_TRIANGLES)));
            self.object = Some((path.clone(), Arc::new(object)));
            self.transfers = Transfers::default();
            new.push(Part::Object);
        }
        let known = self.cloud.as_ref().filter(|(_, up, _)| *up == state.up).map(|(path, ..)| path);
        if let Some(path) = wanted(&state.cloud, known) {
            let (hierarchy, origin, chunks) = self.load_cloud(path, state, report).map_err(|e| (Part::Cloud, e))?;
            self.chunks = Some(Arc::new(chunks));
            self.cloud = Some((path.clone(), state.up, Arc::new(hierarchy)));
            self.origin = origin;
            new.push(Part::Cloud);
        }
        let wished = state.probes.as_ref();
        let probes = match wished.filter(|wished| self.probes.as_ref().map(Player::choice) != Some(*wished)) {
            Some(wished) => {
                report(&format!("reading {}", name(&wished.path)), 0.9);
                Some(Player::open(wished).map_err(|e| (Part::Probes, e))?)
            }
            None => None,
        };
        let environment = match wanted(&state.environment, self.environment.as_ref().map(|(path, _)| path)) {
            Some(path) => {
                report(&format!("reading {}", name(path)), 0.9);
                let far_field = image::read_far_field(path).map_err(|e| (Part::Environment, e))?;
                Some((path.clone(), Arc::new(far_field)))
            }
            None => None,
        };
        // Both are there: one may take the other's place.
        if probes.is_some() || (wished.is_none() && self.probes.is_some()) {
            self.probes = probes;
            new.push(Part::Probes);
        }
        if environment.is_some() || (state.environment.is_none() && self.environment.is_some()) {
            self.environment = environment;
            new.push(Part::Environment);
        }
        self.light += u64::from(new.contains(&Part::Probes) || new.contains(&Part::Environment));
        Ok(new)
    }

    /// What lies beyond the scan now.
    pub(super) fn far_field(&self) -> Option<&Arc<FarField>> {
        let environment = self.environment.as_ref().map(|(_, far_field)| far_field);
        self.probes.as_ref().map(Player::panorama).or(environment)
    }

    /// The probes that are open.
    pub(super) fn probes(&self) -> Option<&Player> {
        self.probes.as_ref()
    }

    /// The same, to be played.
    pub(super) fn probes_mut(&mut self) -> Option<&mut Player> {
        self.probes.as_mut()
    }

    /// Takes the probe that is due as light; false where none is.
    pub(super) fn advance(&mut self, now: Instant) -> bool {
        let new = self.probes.as_mut().is_some_and(|probes| probes.advance(now));
        self.light += u64::from(new);
        new
    }

    /// The object itself or the simplified one.
    pub(super) fn object_for(&self, own: bool) -> Option<&Arc<Object>> {
        if own { self.object.as_ref().map(|(_, object)| object) } else { self.simple_object.as_ref() }
    }

    fn load_cloud(
        &self,
        path: &Path,
        state: &ViewState,
        report: Report<'_>,
    ) -> Result<(Hierarchy, DVec3, PointChunks)> {
        report(&format!("reading {}", name(path)), 0.2);
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("bsh")) {
            let (hierarchy, info) = bsh::read_with_info(path)?;
            let chunks = PointChunks::of_hierarchy(&hierarchy)?;
            return Ok((hierarchy, info.origin, chunks));
        }
        let towards = self.object.as_ref().map(|(_, object)| {
            let mut placement = state.placement;
            let at = placement.at.unwrap_or_default();
            placement.at = Some(DVec3::ZERO);
            let (low, high) = object.bounds();
            let middle = placement.world_from_object(DVec3::ZERO).transform_point3(0.5 * (low + high));
            middle.as_dvec3() + at
        });
        let cloud = cloud::load(path, &CloudOptions { up: state.up, orient_towards: towards })?;
        report(&format!("building the hierarchy of {} points", cloud.len()), 0.6);
        let (hierarchy, _) = hierarchy::build(&cloud, &BuildOptions::default())?;
        let chunks = PointChunks::new(&cloud)?;
        Ok((hierarchy, cloud.origin, chunks))
    }

    /// Corners of the object's bounds in its own space.
    pub(super) fn object_bounds(&self) -> Option<(Vec3, Vec3)> {
        self.object.as_ref().map(|(_, object)| object.bounds())
    }
}

fn wanted<'a>(wished: &'a Option<PathBuf>, known: Option<&PathBuf>) -> Option<&'a PathBuf> {
    wished.as_ref().filter(|path| known != Some(*path))
}

fn name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}
