//! Times and counts of a rendering (`--stats`).

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use serde::Serialize;

use super::load::Scan;
use super::write_json;
use crate::Result;
use crate::frames::{Frame, FrameStats, MaterialChoice, Method, Paper, Settings};
use crate::gpu::recorder::PassProfile;
use crate::gpu::{Context, Profile};
use crate::probes::StreamStats;
use crate::trace::Trace;

/// Contents of the file. Counts and times of passes are summed over all frames.
#[derive(Serialize)]
struct Report<'a> {
    device: &'a str,
    driver: &'a str,
    technique: Method,
    width: u32,
    height: u32,
    microbuffer: u32,
    paper: Paper,
    material: MaterialChoice,
    frames: u64,
    covered_pixels: u64,
    shared_tiles: u64,
    per_pixel: u64,
    sharp_lobes: u64,
    points: Option<usize>,
    nodes_before_pruning: Option<usize>,
    nodes: Option<usize>,
    visited_pairs: u64,
    rasterised_nodes: u64,
    pairs_per_covered_pixel: f64,
    tiles: u64,
    splits: u64,
    peak_feedback_bytes: u64,
    microbuffer_bytes: u64,
    memory_budget_bytes: u64,
    device_bytes_peak: u64,
    /// Mean over the frames.
    frame_wall_ms: f64,
    total_wall_s: f64,
    probes_decoded: u64,
    probes_damaged: u64,
    probes_waited_ms: f64,
    loading_s: &'a [(&'static str, f64)],
    passes: &'a BTreeMap<&'static str, PassProfile>,
}

/// Seconds of named steps, which are spans of the trace.
pub(super) struct Clock {
    steps: Vec<(&'static str, f64)>,
    trace: Trace,
}

impl Clock {
    pub(super) fn new(trace: Trace) -> Self {
        Self { steps: Vec::new(), trace }
    }

    /// Seconds by step.
    pub(super) fn steps(&self) -> &[(&'static str, f64)] {
        &self.steps
    }

    pub(super) fn time<T>(&mut self, step: &'static str, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let start = Instant::now();
        let _span = self.trace.span(step);
        let result = work();
        let seconds = start.elapsed().as_secs_f64();
        match self.steps.iter_mut().find(|(name, _)| *name == step) {
            Some((_, sum)) => *sum += seconds,
            None => self.steps.push((step, seconds)),
        }
        result
    }
}

/// Everything that is known besides the frames.
pub(super) struct Circumstances<'a> {
    pub(super) context: &'a Context,
    pub(super) method: Method,
    pub(super) settings: &'a Settings,
    pub(super) scan: &'a Scan,
    pub(super) clock: &'a Clock,
    pub(super) start: Instant,
    /// What the stream of probes did.
    pub(super) probes: StreamStats,
}

/// Sums over the frames of a rendering.
#[derive(Default)]
pub(super) struct Totals {
    pub(super) frames: u64,
    pub(super) profile: Profile,
    sums: FrameStats,
}

impl Totals {
    pub(super) fn add(&mut self, frame: &Frame) {
        let (sums, more) = (&mut self.sums, &frame.stats);
        self.frames += 1;
        self.profile.add(&more.profile);
        sums.covered_pixels += more.covered_pixels;
        sums.tiles += more.tiles;
        sums.per_pixel += more.per_pixel;
        sums.lobes += more.lobes;
        sums.visited_pairs += more.visited_pairs;
        sums.rasterised_nodes += more.rasterised_nodes;
        sums.batches += more.batches;
        sums.splits += more.splits;
        sums.wall_ms += more.wall_ms;
        sums.peak_feedback_bytes = sums.peak_feedback_bytes.max(more.peak_feedback_bytes);
        sums.microbuffer_bytes = sums.microbuffer_bytes.max(more.microbuffer_bytes);
        sums.device_bytes_peak = sums.device_bytes_peak.max(more.device_bytes_peak);
    }

    /// Wall time of a frame, milliseconds.
    pub(super) fn mean_ms(&self) -> f64 {
        self.sums.wall_ms / self.frames.max(1) as f64
    }

    pub(super) fn write(&self, path: &Path, circumstances: &Circumstances<'_>) -> Result<()> {
        let Circumstances { context, method, settings, scan, clock, start, probes } = circumstances;
        let sums = &self.sums;
        let report = Report {
            device: &context.capabilities.name,
            driver: &context.capabilities.driver,
            technique: *method,
            width: settings.width,
            height: settings.height,
            microbuffer: settings.microbuffer,
            paper: settings.paper,
            material: settings.material,
            frames: self.frames,
            covered_pixels: sums.covered_pixels,
            shared_tiles: sums.tiles,
            per_pixel: sums.per_pixel,
            sharp_lobes: sums.lobes,
            points: scan.points,
            nodes_before_pruning: scan.nodes_before,
            nodes: scan.hierarchy.as_ref().map(|hierarchy| hierarchy.len()),
            visited_pairs: sums.visited_pairs,
            rasterised_nodes: sums.rasterised_nodes,
            pairs_per_covered_pixel: sums.visited_pairs as f64 / sums.covered_pixels.max(1) as f64,
            tiles: sums.batches,
            splits: sums.splits,
            peak_feedback_bytes: sums.peak_feedback_bytes,
            microbuffer_bytes: sums.microbuffer_bytes,
            memory_budget_bytes: settings.memory_budget,
            device_bytes_peak: sums.device_bytes_peak,
            frame_wall_ms: self.mean_ms(),
            total_wall_s: start.elapsed().as_secs_f64(),
            probes_decoded: probes.decoded,
            probes_damaged: probes.damaged,
            probes_waited_ms: probes.waited_ms,
            loading_s: &clock.steps,
            passes: &self.profile.passes,
        };
        write_json(path, &report)
    }
}
