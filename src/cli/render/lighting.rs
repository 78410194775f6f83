//! What lights the object: a cloud, with the current probe beyond it, or probes alone.

use std::sync::Arc;

use glam::Affine3A;

use super::load::Scan;
use super::{Args, HarmonicsArgs};
use crate::cli::{progress, values};
use crate::formats::prt::{self, Source};
use crate::frames::probes::{ProbeRenderer, ProbeSettings, Projection};
use crate::frames::{Frame, Method, Renderer, Settings, Technique};
use crate::gpu::{Context, Profile};
use crate::preprocess::transfer::{Transfer, TransferOptions};
use crate::scene::{Camera, FarField, Object};
use crate::{Error, Result};

/// What was asked for; else what the quality has, or classic with one line about why; without a cloud, probes.
pub(super) fn pick(args: &Args, context: &Context) -> Method {
    match (args.technique, context.why_no_feedback()) {
        (Some(method), _) => method,
        (None, _) if args.cloud.is_none() => Method::Probes,
        (None, None) if args.paper.is_some() => Method::Cloud(Technique::Hybrid),
        (None, None) => Method::Cloud(args.quality.settings().technique),
        (None, Some(why)) => {
            tracing::warn!("{why}");
            Method::Cloud(Technique::Classic)
        }
    }
}

/// An object in its place, and how it got there.
#[derive(Clone, Copy)]
pub(super) struct Placed<'a> {
    /// As the file has it.
    pub(super) own: &'a Object,
    /// In world space.
    pub(super) object: &'a Object,
    pub(super) world_from_object: Affine3A,
}

/// A renderer.
pub(super) enum Lighting {
    Cloud(Box<Renderer>),
    Probes(Box<ProbeRenderer>),
}

impl Lighting {
    /// A cloud's light, and beyond it the far field.
    pub(super) fn by_cloud(
        context: &Arc<Context>,
        scan: &Scan,
        object: &Object,
        settings: Settings,
        far_field: Option<&FarField>,
    ) -> Result<Self> {
        let Some(hierarchy) = &scan.hierarchy else {
            return Err(Error::Argument(format!("technique {} needs a cloud", settings.technique)));
        };
        Ok(Self::Cloud(Box::new(Renderer::new(context, hierarchy, object, far_field, settings)?)))
    }

    /// Probes alone, of which there is none yet.
    pub(super) fn by_probes(
        context: &Arc<Context>,
        args: &Args,
        Placed { object, world_from_object, .. }: Placed<'_>,
        settings: &Settings,
        transfer: Option<&Transfer>,
    ) -> Result<Self> {
        let settings = probe_settings(&args.harmonics, settings);
        let renderer = ProbeRenderer::new(context, object, world_from_object, transfer, settings)?;
        Ok(Self::Probes(Box::new(renderer)))
    }

    /// Takes the next probe.
    pub(super) fn light(&mut self, probe: &FarField, profile: &mut Profile) -> Result<()> {
        match self {
            Self::Cloud(renderer) => renderer.set_far_field(probe),
            Self::Probes(renderer) => renderer.light(probe, profile),
        }
    }

    pub(super) fn render(&mut self, camera: &Camera, progress: &mut dyn FnMut(u64, u64)) -> Result<Frame> {
        match self {
            Self::Cloud(renderer) => renderer.render(camera, progress),
            Self::Probes(renderer) => renderer.render(camera),
        }
    }
}

/// What technique `probes` takes of the flags.
fn probe_settings(flags: &HarmonicsArgs, settings: &Settings) -> ProbeSettings {
    ProbeSettings {
        width: settings.width,
        height: settings.height,
        projection: flags.projection(),
        temporal: flags.temporal as f32,
        material: settings.material,
        reflection: flags.reflection,
        memory_budget: settings.memory_budget,
    }
}

impl HarmonicsArgs {
    fn projection(&self) -> Projection {
        let hanning = self.window == values::Window::Hanning;
        Projection { order: self.order, hanning, width: self.probe_width, rows: None }
    }
}

/// The object's transfer, read or made; none where no shadows are wanted.
pub(super) fn transfer(args: &Args, object: &Object) -> Result<Option<Transfer>> {
    let flags = &args.harmonics;
    let path = match &flags.transfer {
        Some(path) if path.as_os_str() == "none" => return Ok(None),
        Some(path) => path.clone(),
        None => args.object.as_ref().map(|object| object.with_extension("prt")).unwrap_or_default(),
    };
    let bounces = flags.bounces.unwrap_or_default();
    let options = TransferOptions { order: flags.order, samples: flags.samples, bounces, visibility: true };
    let bar = progress::bar("transfer", 1000);
    let (transfer, source) =
        prt::load_or_compute(Some(&path), object, &options, &|share| bar.set_position((share * 1000.0) as u64))?;
    bar.finish_and_clear();
    if let Source::ComputedUnsaved(error) = source {
        tracing::warn!("the transfer is not kept: {error}");
    }
    Ok(Some(transfer))
}
