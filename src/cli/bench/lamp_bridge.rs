//! The part of `relume bench lamps` about lamps for an object: light of the leaves, the refit of the hierarchy over them, and
//! its upload.

use std::sync::Arc;
use std::time::Instant;

use serde::Serialize;

use super::median;
use crate::Result;
use crate::cli::output::say;
use crate::frames::lamps::{LampRenderer, LampSettings};
use crate::frames::{GpuScene, Paper};
use crate::gpu::Context;
use crate::preprocess::hierarchy::{self, BuildOptions};
use crate::preprocess::point_chunks::PointChunks;
use crate::reference::path_tracer::PathTracer;
use crate::reference::rooms::cornell_box;
use crate::scene::Lamp;

/// Points of which an unpruned hierarchy has a million nodes.
const POINTS: usize = 500_000;
/// Of a few.
const RUNS: usize = 5;

/// What it takes to light an object by another lamp; times in milliseconds, medians.
#[derive(Serialize)]
pub(super) struct Bridge {
    nodes: usize,
    leaves: usize,
    /// Light of the lamp and its bounces at all leaves.
    light_ms: f64,
    /// Radiance of all nodes from that of the leaves.
    refit_ms: f64,
    /// That radiance to the device.
    upload_ms: f64,
    /// The hierarchy built anew over points in that light.
    build_ms: f64,
}

pub(super) fn measure(context: &Arc<Context>, lamp: &Lamp, settings: LampSettings) -> Result<Bridge> {
    let cloud = PathTracer::new(cornell_box())?.albedo_cloud(POINTS, 1);
    let start = Instant::now();
    let (hierarchy, _) = hierarchy::build(&cloud, &BuildOptions::unpruned())?;
    let build_ms = start.elapsed().as_secs_f64() * 1e3;
    let chunks = Arc::new(PointChunks::new(&cloud)?);
    let mut renderer = LampRenderer::new(context, &chunks, settings)?;
    renderer.choose_leaves(&hierarchy)?;
    let scene = GpuScene::new(context, &hierarchy, None, Paper::NONE)?;
    let mut times = [Vec::new(), Vec::new(), Vec::new()];
    for _ in 0..RUNS {
        let light = renderer.light(std::slice::from_ref(lamp))?;
        times[0].push(light.wall_ms);
        let start = Instant::now();
        let radiance = hierarchy.refit(0.0, &light.radiance)?;
        times[1].push(start.elapsed().as_secs_f64() * 1e3);
        let start = Instant::now();
        scene.relight(&hierarchy, Some(&radiance))?;
        times[2].push(start.elapsed().as_secs_f64() * 1e3);
    }
    let [light_ms, refit_ms, upload_ms] = times.map(median);
    let leaves = hierarchy.leaves().count();
    Ok(Bridge { nodes: hierarchy.len(), leaves, light_ms, refit_ms, upload_ms, build_ms })
}

impl Bridge {
    pub(super) fn print(&self) -> Result<()> {
        let Self { nodes, leaves, light_ms, refit_ms, upload_ms, build_ms } = self;
        say!("\nanother lamp for an object, {nodes} nodes: light of {leaves} leaves {light_ms:.0} ms")?;
        say!("refit {refit_ms:.1} ms, upload {upload_ms:.1} ms; building the hierarchy anew {build_ms:.0} ms")
    }
}
