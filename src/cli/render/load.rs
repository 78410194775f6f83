//! What a rendering needs: object and its place, camera, scan.

use std::path::Path;
use std::sync::Arc;

use glam::{Affine3A, DVec3};

use super::{Args, Clock, UpAxis};
use crate::formats::cloud::CloudOptions;
use crate::formats::{bsh, cloud};
use crate::preprocess::hierarchy::{self, BuildOptions, Hierarchy};
use crate::preprocess::point_chunks::PointChunks;
use crate::scene::{Camera, Cloud, Object, Placement};
use crate::{Error, Result};

/// A scan, and where it comes from.
#[derive(Default)]
pub(super) struct Scan {
    /// What lights the object, unless that is probes alone.
    pub(super) hierarchy: Option<Hierarchy>,
    pub(super) points: Option<usize>,
    pub(super) nodes_before: Option<usize>,
    pub(super) origin: DVec3,
    /// For the backdrop, if it is asked for.
    pub(super) chunks: Option<Arc<PointChunks>>,
}

/// The object's transform into the space of a cloud whose `origin` was subtracted.
pub(super) fn placement(args: &Args, origin: DVec3) -> Affine3A {
    let Args { object_at: at, object_scale: scale, object_turn: turn, object_up: up, .. } = *args;
    Placement { at, scale, turn, up }.world_from_object(origin)
}

pub(super) fn camera(args: &Args, object: &Object, origin: DVec3) -> Result<Camera> {
    let (low, high) = object.bounds();
    let framing = Camera::framing(0.5 * (low + high), 0.5 * (high - low).length());
    let camera = Camera {
        from: args.camera_from.map_or(framing.from, |p| (p - origin).as_vec3()),
        at: args.camera_at.map_or(framing.at, |p| (p - origin).as_vec3()),
        fov_y: args.fov.map_or(framing.fov_y, |degrees| degrees.to_radians() as f32),
    };
    if camera.from.distance(camera.at) <= 1e-6 * (1.0 + camera.at.length()) {
        let problem = if args.camera_from.is_some() && args.camera_at.is_some() {
            "--camera-from and --camera-at are the same point"
        } else if args.camera_from.is_some() || args.camera_at.is_some() {
            "--camera-from and --camera-at are the same point, one of them being the default; give both"
        } else {
            "the object is too small for its distance from the origin to be framed; give --camera-from and --camera-at"
        };
        return Err(Error::Argument(problem.into()));
    }
    Ok(camera)
}

/// Reads the scan; its hierarchy only where the cloud `lights` the object.
pub(super) fn scan(args: &Args, path: &Path, object: &Object, lights: bool, clock: &mut Clock) -> Result<Scan> {
    let shown = args.backdrop.shows_points();
    let saved = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("bsh"));
    if saved {
        let (hierarchy, info) = clock.time("hierarchy file", || bsh::read_with_info(path))?;
        let chunks = shown.then(|| PointChunks::of_hierarchy(&hierarchy)).transpose()?;
        return Ok(Scan {
            hierarchy: lights.then_some(hierarchy),
            points: usize::try_from(info.points).ok(),
            nodes_before: None,
            origin: info.origin,
            chunks: chunks.map(Arc::new),
        });
    }
    // The object's middle, without its place, which f32 may not hold: the cloud's origin is not known yet.
    let turned = object.clone().transformed(placement(args, args.object_at.unwrap_or_default()));
    let (low, high) = turned.bounds();
    let middle = (0.5 * (low + high)).as_dvec3() + args.object_at.unwrap_or_default();
    let towards = args.towards.unwrap_or(middle);
    let cloud = clock.time("cloud", || load_cloud(path, args.up, Some(towards)))?;
    let built = lights.then(|| clock.time("hierarchy", || hierarchy::build(&cloud, &BuildOptions::default())));
    let built = built.transpose()?;
    let chunks = shown.then(|| PointChunks::new(&cloud)).transpose()?;
    Ok(Scan {
        points: Some(cloud.len()),
        nodes_before: built.as_ref().map(|(_, report)| report.nodes_before),
        hierarchy: built.map(|(hierarchy, _)| hierarchy),
        origin: cloud.origin,
        chunks: chunks.map(Arc::new),
    })
}

/// Reads a cloud; `towards` is where estimated normals look if the file does not know better.
pub(in crate::cli) fn load_cloud(path: &Path, up: UpAxis, towards: Option<DVec3>) -> Result<Cloud> {
    cloud::load(path, &CloudOptions { up: up.into(), orient_towards: towards })
}
