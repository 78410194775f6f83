//! What the worker tells the window, and what that makes of it.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::controller::{Controller, base};
use super::loader::Part;
use super::pick;
use super::state::ViewState;
use crate::Error;
use crate::frames::FrameStats;
use crate::gpu::context::ValidationLog;
use crate::preprocess::hierarchy::Hierarchy;
use crate::scene::{Camera, Viewpoint};

/// How good a picture is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Quick, while things move.
    Moving,
    /// Of full resolution and draft quality.
    Draft,
    /// As good as was asked for.
    Finished,
}

/// A picture and what it took.
pub struct Picture {
    /// The request that it answers.
    pub number: u64,
    /// How good it is.
    pub stage: Stage,
    /// The frame of the light probes that it shows, if they change.
    pub frame: Option<u64>,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Four bytes a pixel, row by row from the top.
    pub rgba: Vec<u8>,
    /// World position of the object at every pixel, w 1 where it is seen and 0 elsewhere.
    pub position: Vec<[f32; 4]>,
    /// What it took.
    pub stats: FrameStats,
    /// Milliseconds from the worker's start on it to its end.
    pub ms: f64,
}

/// What the window hears from the worker.
pub enum Message {
    /// A device is there: its name, where its validation messages go, and why it has only technique classic.
    Device(String, Arc<ValidationLog>, Option<String>),
    /// Loading has come so far, a share of the whole; none goes on for `None`.
    Loading(Option<(String, f32)>),
    /// All files of a view are there.
    Loaded(Box<Loaded>),
    /// A file could not be loaded; what was there before stays.
    LoadFailed(Part, String),
    /// A picture.
    Picture(Box<Picture>),
    /// A line about what happened.
    Status(String),
    /// Shaders were compiled again: what is wrong with them, if the old ones stay.
    Shaders(Option<String>),
    /// A view could not be rendered: its number, and why.
    RenderFailed(u64, String),
    /// A screenshot was written, by this name and both endings.
    Saved(PathBuf),
    /// Nothing works any more.
    Fatal(Error),
}

/// What the window needs to know of the loaded files.
pub struct Loaded {
    /// The paths that were asked for.
    pub state: ViewState,
    /// What was subtracted from the cloud's coordinates.
    pub origin: DVec3,
    /// The scan, for picking.
    pub hierarchy: Option<Arc<Hierarchy>>,
    /// Corners of the object's bounds in its own space.
    pub object_bounds: Option<(Vec3, Vec3)>,
}

impl Controller {
    /// Hears from the worker.
    pub fn message(&mut self, message: Message) {
        match message {
            Message::Device(name, log, why_no_feedback) => {
                self.device = name;
                self.logs.push(log);
                if let Some(why) = why_no_feedback {
                    self.status = why;
                }
            }
            Message::Loading(loading) => self.loading = loading,
            Message::Loaded(loaded) => self.take(*loaded),
            Message::LoadFailed(part, problem) => {
                self.status = problem;
                match part {
                    _ if self.undo.is_some() => self.state = self.undo.take().unwrap_or_default(),
                    Part::Cloud => (self.state.cloud, self.state.up) = (self.loaded.cloud.clone(), self.loaded.up),
                    Part::Object => self.state.object.clone_from(&self.loaded.object),
                    Part::Environment | Part::Probes => {
                        self.state.environment.clone_from(&self.loaded.environment);
                        self.state.probes.clone_from(&self.loaded.probes);
                    }
                }
                self.failed = self.sent.as_ref().map(|request| request.number);
            }
            Message::Picture(picture) => {
                // While probes are played, more pictures of what there was may come.
                if self.sent.as_ref().is_some_and(|sent| sent.number == picture.number && sent.state == self.state) {
                    self.undo = None;
                }
                self.picture = Some(*picture);
            }
            Message::Status(line) => self.status = line,
            Message::Shaders(None) => {
                self.shader_error = None;
                self.status = "the shaders are compiled anew".into();
            }
            Message::Shaders(Some(error)) => {
                let first = error.lines().next().unwrap_or_default();
                self.status = format!("the old shaders stay: {first}");
                self.shader_error = Some(error);
            }
            Message::RenderFailed(number, problem) => (self.failed, self.status) = (Some(number), problem),
            Message::Saved(stem) => {
                self.status = format!("{0}.png and {0}.exr are written", stem.display());
                self.saved.push(stem);
            }
            Message::Fatal(error) => self.fatal = Some(error),
        }
    }

    fn take(&mut self, loaded: Loaded) {
        (self.origin, self.hierarchy, self.object_bounds) = (loaded.origin, loaded.hierarchy, loaded.object_bounds);
        self.loaded = loaded.state;
        self.undo = None;
        let Some((low, high)) = self.object_bounds else {
            let scan = self.hierarchy.as_ref().filter(|_| self.loaded.scan_alone());
            if let (None, Some(hierarchy)) = (self.state.viewpoint, scan) {
                let [x, y, z, radius] = hierarchy.spheres[0];
                let camera = Camera::framing(Vec3::new(x, y, z), radius);
                self.state.viewpoint = Some(Viewpoint::of(&camera, self.origin));
            }
            return;
        };
        if let (None, Some(hierarchy)) = (self.state.placement.at, &self.hierarchy) {
            let mut at = self.origin;
            let [x, y, z, radius] = hierarchy.spheres[0];
            let centre = Vec3::new(x, y, z);
            let world = self.state.placement.world_from_object(self.origin);
            let middle = world.transform_point3(0.5 * (low + high));
            if middle.distance(centre) > radius {
                // The file puts it outside of the scan: on the ground in the scan's middle it can be seen.
                let ground = pick::surface(hierarchy, centre, Vec3::NEG_Y).map_or(centre, |hit| hit.position);
                at += (ground - world.transform_vector3(base(low, high))).as_dvec3();
            }
            self.state.placement.at = Some(at);
        }
        // Another scan that is still being read brings its own.
        let whole = self.loaded.complete() && self.loaded.cloud == self.state.cloud;
        if self.state.viewpoint.is_none() && whole {
            let world = self.state.placement.world_from_object(self.origin);
            let middle = world.transform_point3(0.5 * (low + high));
            let radius = 0.5 * world.transform_vector3(high - low).length();
            let camera = Camera::framing(middle, 1.6 * radius);
            self.state.viewpoint = Some(Viewpoint::of(&camera, self.origin));
        }
    }
}
