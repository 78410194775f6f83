//! What a rendering needs: object and its place, camera, scan.

use std::path::Path;
use std::sync::Arc;

use glam::{Affine3A, DVec3, Vec3};

use super::{Args, Clock, UpAxis};
use crate::formats::cloud::CloudOptions;
use crate::formats::{bsh, cloud};
use crate::frames::lamps::LampFrame;
use crate::preprocess::hierarchy::{self, BuildOptions, Hierarchy};
use crate::preprocess::point_chunks::PointChunks;
use crate::scene::{Camera, Cloud, Lamp, Object, Placement};
use crate::{Error, Result};

/// A scan, and where it comes from.
#[derive(Default)]
pub(super) struct Scan {
    /// What lights the object, unless that is probes alone.
    pub(super) hierarchy: Option<Hierarchy>,
    pub(super) points: Option<usize>,
    pub(super) nodes_before: Option<usize>,
    pub(super) origin: DVec3,
    /// For the backdrop and for lamps, if they are asked for.
    pub(super) chunks: Option<Arc<PointChunks>>,
    /// Its picture in the light of lamps, and the share of its own light that stays.
    pub(super) lit: Option<(LampFrame, f32)>,
}

/// The object's transform into the space of a cloud whose `origin` was subtracted.
pub(super) fn placement(args: &Args, origin: DVec3) -> Affine3A {
    let Args { object_at: at, object_scale: scale, object_turn: turn, object_up: up, .. } = *args;
    Placement { at, scale, turn, up }.world_from_object(origin)
}

/// The camera that is asked for; where nothing is, one that frames what lies between two corners.
pub(super) fn camera(args: &Args, (low, high): (Vec3, Vec3), origin: DVec3) -> Result<Camera> {
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
            "what is shown is too small for its distance from the origin to be framed; give --camera-from and --camera-at"
        };
        return Err(Error::Argument(problem.into()));
    }
    Ok(camera)
}

/// Reads the scan; its hierarchy only where the cloud `lights` the object.
pub(super) fn scan(args: &Args, path: &Path, object: Option<&Object>, lights: bool, clock: &mut Clock) -> Result<Scan> {
    let shown = args.backdrop.shows_points() || !args.lamps.lamps.is_empty();
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
            lit: None,
        });
    }
    // The object's middle, without its place, which f32 may not hold: the cloud's origin is not known yet.
    let middle = object.map(|object| {
        let turned = object.clone().transformed(placement(args, args.object_at.unwrap_or_default()));
        let (low, high) = turned.bounds();
        (0.5 * (low + high)).as_dvec3() + args.object_at.unwrap_or_default()
    });
    // Without an object it is the eye, or the first lamp that is somewhere.
    let place = || args.camera_from.or_else(|| args.lamps.lamps.iter().find_map(Lamp::place));
    let towards = args.towards.or(middle).or_else(place);
    let cloud = clock.time("cloud", || load_cloud(path, args.up, towards))?;
    let built = lights.then(|| clock.time("hierarchy", || hierarchy::build(&cloud, &BuildOptions::default())));
    let built = built.transpose()?;
    let chunks = shown.then(|| PointChunks::new(&cloud)).transpose()?;
    Ok(Scan {
        points: Some(cloud.len()),
        nodes_before: built.as_ref().map(|(_, report)| report.nodes_before),
        hierarchy: built.map(|(hierarchy, _)| hierarchy),
        origin: cloud.origin,
        chunks: chunks.map(Arc::new),
        lit: None,
    })
}

/// Reads a cloud; `towards` is where estimated normals look if the file does not know better.
pub(in crate::cli) fn load_cloud(path: &Path, up: UpAxis, towards: Option<DVec3>) -> Result<Cloud> {
    cloud::load(path, &CloudOptions { up: up.into(), orient_towards: towards })
}
