//! Rooms built in code, baked and scanned, and what is rendered in them: common to `demo` and `bench`.

use std::sync::Arc;
use std::time::Instant;

use glam::{Affine3A, Vec3};

use super::progress;
use crate::compare::Image;
use crate::frames::{Frame, MaterialChoice, Renderer, Settings, Technique};
use crate::gpu::Context;
use crate::preprocess::hierarchy::{self, BuildOptions, BuildReport, Hierarchy};
use crate::reference::bake::{BakeOptions, BakedRoom, bake};
use crate::reference::gather::{Brdf, Receiver, render_reference};
use crate::reference::rooms::Room;
use crate::scene::{Camera, Cloud, Object};
use crate::{Error, Result};

/// Steps of a bar over a fraction.
const STEPS: u64 = 1000;

/// A place to stand in: its light, and the hierarchy of its scan.
pub(super) struct Stage {
    pub(super) baked: BakedRoom,
    pub(super) cloud: Cloud,
    pub(super) hierarchy: Hierarchy,
    pub(super) build: BuildReport,
    pub(super) bake_s: f64,
    pub(super) scan_s: f64,
    pub(super) build_s: f64,
}

impl Stage {
    /// Bakes a room, scans it into about `points` points and builds their hierarchy.
    pub(super) fn new(room: Room, points: usize, options: &BakeOptions) -> Result<Self> {
        let bar = progress::bar("baking", STEPS);
        let start = Instant::now();
        let baked = bake(room, options, &|done| bar.set_position((done * STEPS as f32) as u64))?;
        let bake_s = start.elapsed().as_secs_f64();
        bar.finish_and_clear();
        let bar = progress::spinner("scanning, building");
        let start = Instant::now();
        let cloud = baked.sample_cloud(points, 1);
        let scan_s = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let (hierarchy, build) = hierarchy::build(&cloud, &BuildOptions::default())?;
        bar.finish_and_clear();
        Ok(Self { baked, cloud, hierarchy, build, bake_s, scan_s, build_s: start.elapsed().as_secs_f64() })
    }

    /// The truth at the pixels of a frame: the hemisphere of each gathered in the real room, which occludes while the
    /// object does not, as in the renderer. [`MaterialChoice::File`] has no truth.
    pub(super) fn truth(
        &self,
        frame: &Frame,
        camera: &Camera,
        material: MaterialChoice,
        samples: u32,
    ) -> Result<Image> {
        let brdf = match material {
            MaterialChoice::Diffuse(albedo) => Brdf::Diffuse { albedo: Vec3::splat(albedo) },
            MaterialChoice::Metal(alpha) => Brdf::Metal { alpha },
            MaterialChoice::File => return Err(Error::Argument("the truth of a file's materials is not known".into())),
        };
        let covered: Vec<usize> = (0..frame.rgba.len()).filter(|&n| frame.rgba[n][3] > 0.5).collect();
        let receivers: Vec<Receiver> =
            covered.iter().map(|&n| receiver(camera.from, three(frame.position[n]), three(frame.normal[n]))).collect();
        let bar = progress::bar("tracing the truth", STEPS);
        let radiance = render_reference(&self.baked, &receivers, brdf, samples, &|done| {
            bar.set_position((done * STEPS as f32) as u64);
        })?;
        bar.finish_and_clear();
        let mut rgb = vec![Vec3::ZERO; frame.rgba.len()];
        for (n, value) in covered.into_iter().zip(radiance) {
            rgb[n] = value;
        }
        Image::new(frame.width, frame.height, rgb, frame.rgba.iter().map(|c| c[3]).collect())
    }
}

/// A pixel as the convolution sees it: interpolated normals may face away from the eye, and are then lit edge-on.
fn receiver(eye: Vec3, position: Vec3, normal: Vec3) -> Receiver {
    let normal = normal.normalize_or(Vec3::Y);
    let mut receiver = Receiver::seen_from(eye, position, normal);
    let cosine = receiver.view.dot(normal);
    if cosine < 1e-3 {
        receiver.view = (receiver.view + normal * (1e-3 - cosine)).normalize_or(normal);
    }
    receiver
}

/// The first three components.
pub(super) fn three([x, y, z, _]: [f32; 4]) -> Vec3 {
    Vec3::new(x, y, z)
}

/// A frame's colours, its mask as alpha.
pub(super) fn image_of(frame: &Frame) -> Result<Image> {
    let rgb = frame.rgba.iter().map(|c| three(*c)).collect();
    Image::new(frame.width, frame.height, rgb, frame.rgba.iter().map(|c| c[3]).collect())
}

/// An object with its origin moved.
pub(super) fn placed(object: Object, at: Vec3) -> Object {
    object.transformed(Affine3A::from_translation(at))
}

/// All of an object in the picture.
pub(super) fn framing(object: &Object) -> Camera {
    let (low, high) = object.bounds();
    Camera::framing(0.5 * (low + high), 0.5 * (high - low).length())
}

/// The techniques that run on a device; says why where some do not.
pub(super) fn techniques(context: &Context) -> Vec<Technique> {
    match context.why_no_feedback() {
        None => Technique::ALL.to_vec(),
        Some(why) => {
            eprintln!("relume: {why}");
            vec![Technique::Classic]
        }
    }
}

/// The quickest of the techniques that have a micro-buffer for each pixel, as the paper has.
pub(super) fn per_pixel(context: &Context) -> Technique {
    if context.why_no_feedback().is_none() { Technique::Hybrid } else { Technique::Classic }
}

/// Renders one frame with a bar. Drivers finish compiling a pipeline when it first runs: a frame of the object from
/// afar does that before the clock starts.
pub(super) fn render(
    context: &Arc<Context>,
    hierarchy: &Hierarchy,
    object: &Object,
    camera: &Camera,
    settings: Settings,
) -> Result<Frame> {
    let mut renderer = Renderer::new(context, hierarchy, object, None, settings)?;
    warm_up(&mut renderer, object)?;
    let bar = progress::bar("lighting", 1);
    let frame = renderer.render(camera, &mut |done, total| {
        bar.set_length(total);
        bar.set_position(done);
    })?;
    bar.finish_and_clear();
    Ok(frame)
}

/// A frame of a few pixels, which runs every pipeline once.
pub(super) fn warm_up(renderer: &mut Renderer, object: &Object) -> Result<()> {
    const FURTHER: f32 = 12.0;
    let mut camera = framing(object);
    camera.from = camera.at + (camera.from - camera.at) * FURTHER;
    renderer.render(&camera, &mut |_, _| {}).map(|_| ())
}
