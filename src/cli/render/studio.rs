//! Takes the pictures: one frame after the other, lit, in front of its backdrop, written.

use std::path::PathBuf;
use std::sync::Arc;

use indicatif::ProgressBar;

use super::lighting::{Lighting, Placed};
use super::load::Scan;
use super::sequence::FrameNames;
use super::source::Next;
use super::stats::{Clock, Totals};
use super::{Args, write_frame};
use crate::cli::backdrop::{Around, ScanPicture};
use crate::frames::lamps::ObjectLight;
use crate::frames::{Frame, Method, Settings};
use crate::gpu::{Capture, Context};
use crate::scene::{Camera, FarField};
use crate::{Error, Result};

/// What all frames have in common.
pub(super) struct Set<'a> {
    pub(super) args: &'a Args,
    pub(super) context: Arc<Context>,
    pub(super) method: Method,
    pub(super) settings: Settings,
    pub(super) scan: Scan,
    pub(super) object: Placed<'a>,
    /// What comes to it straight from lamps.
    pub(super) lit: Option<ObjectLight>,
    pub(super) camera: Camera,
    pub(super) names: FrameNames,
    /// There is one frame only.
    pub(super) single: bool,
}

/// The set, and what is kept from frame to frame.
pub(super) struct Studio<'a> {
    pub(super) set: Set<'a>,
    lighting: Option<Lighting>,
    backdrop: Option<ScanPicture>,
    capture: Option<Capture>,
    /// The first frame's capture.
    pub(super) captured: Option<PathBuf>,
    pub(super) totals: Totals,
    /// Pixels that show the object in the last frame.
    pub(super) covered: u64,
}

impl<'a> Studio<'a> {
    pub(super) fn new(set: Set<'a>, capture: Option<Capture>) -> Self {
        Self { set, lighting: None, backdrop: None, capture, captured: None, totals: Totals::default(), covered: 0 }
    }

    /// Lights the set for the next frame.
    pub(super) fn light(&mut self, far_field: Option<&FarField>, clock: &mut Clock) -> Result<()> {
        let Set { args, context, method, settings, scan, object, .. } = &self.set;
        if let (Some(lighting), Some(probe)) = (&mut self.lighting, far_field) {
            return lighting.light(probe, &mut self.totals.profile);
        }
        let transfer = match method {
            Method::Probes => clock.time("transfer", || super::lighting::transfer(args, object.own))?,
            Method::Cloud(_) | Method::Lamps => None,
        };
        self.lighting = Some(clock.time("upload and pipelines", || {
            let mut lighting = match method {
                Method::Cloud(_) => Lighting::by_cloud(context, scan, object.object, *settings, far_field)?,
                Method::Probes => Lighting::by_probes(context, args, *object, settings, transfer.as_ref())?,
                Method::Lamps => return Err(Error::Argument("technique lamps lights no object".into())),
            };
            if let (Method::Probes, Some(probe)) = (method, far_field) {
                lighting.light(probe, &mut self.totals.profile)?;
            }
            Ok(lighting)
        })?);
        Ok(())
    }

    /// Renders and writes a frame that the set is lit for; `bar` counts pixels where there is no other frame.
    pub(super) fn shoot(&mut self, next: &Next, clock: &mut Clock, bar: &ProgressBar) -> Result<()> {
        let Some(mut lighting) = self.lighting.take() else { return Ok(()) };
        let Set { args, context, scan, object, lit, camera, settings, names, single, .. } = &self.set;
        let mut light = || {
            lighting.render(camera, &mut |done, total| {
                if *single {
                    bar.set_length(total);
                    bar.set_position(done);
                }
            })
        };
        let mut frame = match self.capture.take() {
            None => light()?,
            Some(mut capture) => {
                let (frame, file) = capture.frame(light)?;
                self.captured = Some(file);
                frame
            }
        };
        if *single {
            // Its memory is the backdrop's now.
            drop(lighting);
        } else {
            self.lighting = Some(lighting);
        }
        if let Some(lit) = lit {
            lit.add_to(&mut frame);
        }
        let far_field = next.far_field.as_deref();
        let points = scan.chunks.clone().filter(|_| args.backdrop.shows_points());
        let around = Around { points, far_field, object: object.object };
        let lit = scan.lit.as_ref().filter(|_| args.backdrop.shows_light());
        let mut scan = clock
            .time("backdrop", || args.backdrop.render_points(context, &around, camera, settings, &mut self.backdrop))?;
        if let (Some(points), Some((light, share))) = (&mut scan, lit) {
            light.add_to(points, *share);
        }
        let composite = args.backdrop.compose(&frame, camera, scan.as_ref(), &around);
        let messages = context.validation.messages();
        if let Some(first) = messages.first() {
            return Err(Error::Device(format!("{} validation messages, the first: {first}", messages.len())));
        }
        let path = names.path(next.number);
        clock.time("writing", || {
            write_frame(&path, &frame, camera, &composite, args.exposure as f32, args.backdrop.tone)
        })?;
        if let Some(scan) = &scan {
            self.totals.profile.add(&scan.profile);
        }
        self.add(&frame);
        Ok(())
    }

    fn add(&mut self, frame: &Frame) {
        self.totals.add(frame);
        self.covered = frame.stats.covered_pixels;
    }
}
