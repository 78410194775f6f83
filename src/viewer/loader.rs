//! Reads what a view needs, and keeps it until another file is asked for.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::state::ViewState;
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
}

/// What has been read.
#[derive(Default)]
pub(super) struct Assets {
    pub(super) object: Option<(PathBuf, Arc<Object>)>,
    pub(super) cloud: Option<(PathBuf, Up, Arc<Hierarchy>)>,
    /// What was subtracted from the cloud's coordinates.
    pub(super) origin: DVec3,
    pub(super) environment: Option<(PathBuf, Arc<FarField>)>,
    /// The cloud's points.
    pub(super) chunks: Option<Arc<PointChunks>>,
    /// The object with fewer triangles, for pictures of things that move.
    pub(super) simple_object: Option<Arc<Object>>,
    /// Distances to the object's surface.
    pub(super) field: Option<Arc<DistanceField>>,
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
        match (&state.environment, &self.environment) {
            (None, Some(_)) => {
                self.environment = None;
                new.push(Part::Environment);
            }
            (wished, known) => {
                if let Some(path) = wanted(wished, known.as_ref().map(|(path, _)| path)) {
                    report(&format!("reading {}", name(path)), 0.9);
                    let far_field = image::read_far_field(path).map_err(|e| (Part::Environment, e))?;
                    self.environment = Some((path.clone(), Arc::new(far_field)));
                    new.push(Part::Environment);
                }
            }
        }
        Ok(new)
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
