//! `relume bench pbgi`: the paper's Table 3 for our own rooms.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use ash::vk;
use glam::Vec3;
use indicatif::ProgressBar;
use serde::Serialize;

use super::tables;
use crate::cli::output::say;
use crate::cli::stage::{self, Stage};
use crate::cli::{progress, render, values};
use crate::frames::{Frame, Renderer, Settings, Technique};
use crate::gpu::recorder::PassProfile;
use crate::gpu::{Context, ContextOptions};
use crate::preprocess::hierarchy::Hierarchy;
use crate::reference::bake::BakeOptions;
use crate::reference::rooms::{Room, hall, toy_room};
use crate::reference::shapes::trophy;
use crate::scene::{Camera, Object};
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Args {
    /// The toy room alone, viewports to 256x256, micro-buffers to 24x24
    #[arg(long)]
    quick: bool,
    /// Viewports of this many pixels a side alone
    #[arg(long, value_name = "SIDE")]
    viewport: Option<u32>,
    /// Micro-buffers of this many micro-pixels a side alone
    #[arg(long, value_name = "N")]
    microbuffer: Option<u32>,
    /// The numbers, written after every cell
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
}

/// A frame under this is rendered again: its time is the median of [`RUNS`].
const SHORT_MS: f64 = 500.0;
const RUNS: usize = 3;
const HOW: &str = "wall time from G-buffer to image after a warm-up frame of a few pixels; the median of 3 frames \
                   below 0.5 s, one frame above; nothing is read back in between but counts";

/// Where an object stands.
pub(super) struct Place<'a> {
    name: &'static str,
    hierarchy: &'a Hierarchy,
    object: Object,
    views: Vec<(&'static str, Camera)>,
}

/// What is measured at every place and view.
pub(super) struct Grid {
    viewports: Vec<u32>,
    microbuffers: Vec<u32>,
    techniques: Vec<Technique>,
    memory_budget: u64,
}

/// One cell of the tables.
#[derive(Serialize)]
pub(super) struct Cell {
    pub(super) room: &'static str,
    pub(super) view: &'static str,
    pub(super) viewport: u32,
    pub(super) microbuffer: u32,
    pub(super) technique: Technique,
    pub(super) measured: Option<Measured>,
    /// Why it could not be rendered.
    pub(super) failed: Option<String>,
}

/// Numbers of a cell.
#[derive(Serialize)]
pub(super) struct Measured {
    pub(super) wall_ms: f64,
    pub(super) runs: usize,
    /// Wall time over that of classic for the same picture in the same run, where that was measured.
    pub(super) of_classic: Option<f64>,
    pub(super) covered_pixels: u64,
    pub(super) visited_per_pixel: f64,
    pub(super) rasterised_per_pixel: f64,
    pub(super) peak_feedback_bytes: u64,
    pub(super) microbuffer_bytes: u64,
    pub(super) device_bytes_peak: u64,
    pub(super) splits: u64,
    pub(super) passes: BTreeMap<&'static str, PassProfile>,
}

/// A room's own numbers.
#[derive(Serialize)]
struct RoomReport {
    name: &'static str,
    points: usize,
    nodes_before_pruning: usize,
    nodes: usize,
    bake_s: f64,
    build_s: f64,
}

/// Contents of `--json`.
#[derive(Serialize)]
struct Report<'a> {
    device: &'a str,
    driver: &'a str,
    how: &'static str,
    rooms: &'a [RoomReport],
    cells: &'a [Cell],
}

/// A room, its name, where the object stands in it, points of its scan and the size of a texel of its light.
type Source = (&'static str, fn() -> Room, Vec3, usize, f32);

pub(super) fn run(args: &Args) -> Result<()> {
    if let Some(json) = &args.json {
        values::check_output(json, &["json"])?;
    }
    let context = Context::new(&ContextOptions::default())?;
    let (device, driver) = (context.capabilities.name.clone(), context.capabilities.driver.clone());
    let techniques = stage::techniques(&context);
    drop(context);
    let toy: Source = ("toy room", toy_room, Vec3::Y, 300_000, 0.04);
    let large: Source = ("hall", hall, Vec3::new(0.0, 1.2, 0.0), 1_500_000, 0.07);
    let memory_budget = Settings::DEFAULT_BUDGET;
    let (sources, grid) = if args.quick {
        (vec![toy], Grid { viewports: vec![128, 256], microbuffers: vec![16, 24], techniques, memory_budget })
    } else {
        let (viewports, microbuffers) = (vec![128, 256, 512, 1024], vec![16, 24, 32]);
        (vec![toy, large], Grid { viewports, microbuffers, techniques, memory_budget })
    };
    let only = |wanted: Option<u32>, all: Vec<u32>| wanted.map_or(all, |size| vec![size]);
    let grid = Grid {
        viewports: only(args.viewport, grid.viewports),
        microbuffers: only(args.microbuffer, grid.microbuffers),
        ..grid
    };
    say!("{device}, {driver}\n{HOW}")?;
    let (mut rooms, mut cells) = (Vec::new(), Vec::new());
    let result = sources.iter().try_for_each(|source| {
        let stage = stage_of(source, &mut rooms)?;
        let place = place_of(source, &stage.hierarchy);
        measure(&place, &grid, &mut cells, &mut |cells| match &args.json {
            Some(path) => {
                render::write_json(path, &Report { device: &device, driver: &driver, how: HOW, rooms: &rooms, cells })
            }
            None => Ok(()),
        })
    });
    // What was measured before a failure is shown all the same.
    if !cells.is_empty() {
        print!("{}", tables::all(&cells));
    }
    result
}

fn stage_of(&(name, room, _, points, texel): &Source, rooms: &mut Vec<RoomReport>) -> Result<Stage> {
    let options = BakeOptions { texel, direct_samples: 32, bounced_samples: 256, ..BakeOptions::default() };
    let stage = Stage::new(room(), points, &options)?;
    let report = RoomReport {
        name,
        points: stage.build.points,
        nodes_before_pruning: stage.build.nodes_before,
        nodes: stage.build.nodes_after,
        bake_s: stage.bake_s,
        build_s: stage.build_s,
    };
    say!(
        "{name}: {} points, {} nodes ({} before pruning); baked in {:.1} s, built in {:.2} s",
        report.points,
        report.nodes,
        report.nodes_before_pruning,
        report.bake_s,
        report.build_s
    )?;
    rooms.push(report);
    Ok(stage)
}

/// The object seen twice: so near that it fills the view, and whole.
fn place_of<'a>(&(name, _, at, ..): &Source, hierarchy: &'a Hierarchy) -> Place<'a> {
    let object = stage::placed(trophy(), at);
    let from = at + Vec3::new(0.18, 0.1, 0.6);
    let detail = Camera { from, at: at - Vec3::Y * 0.01, fov_y: 20.0_f32.to_radians() };
    let whole = stage::framing(&object);
    Place { name, hierarchy, object, views: vec![("detail", detail), ("whole", whole)] }
}

/// Measures every cell of a place; `done` hears of every one.
fn measure(
    place: &Place<'_>,
    grid: &Grid,
    cells: &mut Vec<Cell>,
    done: &mut dyn FnMut(&[Cell]) -> Result<()>,
) -> Result<()> {
    // Work grows with pixels and micro-pixels: the bar should move evenly.
    let work = |viewport: u32, microbuffer: u32| u64::from(viewport).pow(2) * u64::from(microbuffer).pow(2);
    let picture: u64 = grid.viewports.iter().flat_map(|v| grid.microbuffers.iter().map(|m| work(*v, *m))).sum();
    let total = picture * (grid.techniques.len() * place.views.len()) as u64;
    let bar = progress::bar(place.name, total);
    let mut finished = 0;
    for (view, camera) in &place.views {
        for &viewport in &grid.viewports {
            for &microbuffer in &grid.microbuffers {
                let mut classic = None;
                for &technique in &grid.techniques {
                    let settings = Settings {
                        technique,
                        width: viewport,
                        height: viewport,
                        microbuffer,
                        memory_budget: grid.memory_budget,
                        ..Settings::default()
                    };
                    let part = work(viewport, microbuffer);
                    let (measured, failed) = match cell(place, camera, settings, &bar, (finished, part)) {
                        Ok(measured) => (Some(measured), None),
                        Err(error) if is_too_large(&error) => (None, Some(error.to_string())),
                        Err(error) => return Err(error),
                    };
                    let measured = measured.map(|m| {
                        if technique == Technique::Classic {
                            classic = Some(m.wall_ms);
                        }
                        Measured { of_classic: classic.map(|c| m.wall_ms / c), ..m }
                    });
                    finished += part;
                    bar.set_position(finished);
                    let room = place.name;
                    cells.push(Cell { room, view, viewport, microbuffer, technique, measured, failed });
                    done(cells)?;
                }
            }
        }
    }
    bar.finish_and_clear();
    Ok(())
}

/// What the paper's table marks with an x.
fn is_too_large(error: &Error) -> bool {
    let memory = [vk::Result::ERROR_OUT_OF_DEVICE_MEMORY, vk::Result::ERROR_OUT_OF_HOST_MEMORY];
    match error {
        Error::Limit(_) => true,
        Error::Vulkan { result, .. } => memory.contains(result),
        _ => false,
    }
}

/// Measures one cell. A device context of its own: peaks of memory are those of this cell.
fn cell(
    place: &Place<'_>,
    camera: &Camera,
    settings: Settings,
    bar: &ProgressBar,
    (finished, part): (u64, u64),
) -> Result<Measured> {
    let context: Arc<Context> = Context::new(&ContextOptions::default())?;
    let mut renderer = Renderer::new(&context, place.hierarchy, &place.object, None, settings)?;
    stage::warm_up(&mut renderer, &place.object)?;
    let mut frames: Vec<Frame> = Vec::new();
    while frames.is_empty() || (frames.len() < RUNS && frames[0].stats.wall_ms < SHORT_MS) {
        frames.push(renderer.render(camera, &mut |done, total| {
            bar.set_position(finished + (part as f64 * done as f64 / total.max(1) as f64) as u64);
        })?);
    }
    frames.sort_by(|a, b| a.stats.wall_ms.total_cmp(&b.stats.wall_ms));
    let runs = frames.len();
    let stats = frames.swap_remove(runs / 2).stats;
    let per_pixel = |count: u64| count as f64 / stats.covered_pixels.max(1) as f64;
    Ok(Measured {
        wall_ms: stats.wall_ms,
        runs,
        of_classic: None,
        covered_pixels: stats.covered_pixels,
        visited_per_pixel: per_pixel(stats.visited_pairs),
        rasterised_per_pixel: per_pixel(stats.rasterised_nodes),
        peak_feedback_bytes: stats.peak_feedback_bytes,
        microbuffer_bytes: stats.microbuffer_bytes,
        device_bytes_peak: stats.device_bytes_peak,
        splits: stats.splits,
        passes: stats.profile.passes,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A room of few points and few texels.
    fn tiny() -> (Stage, Source) {
        let source: Source = ("tiny", toy_room, Vec3::Y, 4000, 0.4);
        (stage_of(&source, &mut Vec::new()).expect("a room"), source)
    }

    fn grid(memory_budget: u64) -> Grid {
        let context = Context::new(&ContextOptions::default()).expect("a device");
        Grid { viewports: vec![16, 24], microbuffers: vec![8], techniques: stage::techniques(&context), memory_budget }
    }

    #[test]
    fn every_cell_is_measured_and_reported() {
        let (stage, source) = tiny();
        let (place, grid) = (place_of(&source, &stage.hierarchy), grid(Settings::DEFAULT_BUDGET));
        let (mut cells, mut heard) = (Vec::new(), Vec::new());
        measure(&place, &grid, &mut cells, &mut |cells| {
            heard.push(cells.len());
            Ok(())
        })
        .expect("measurements");
        let count = 2 * 2 * grid.techniques.len();
        assert_eq!(heard, (1..=count).collect::<Vec<_>>());
        for cell in &cells {
            let measured = cell.measured.as_ref().expect("a number");
            assert!(measured.wall_ms > 0.0 && measured.visited_per_pixel > 0.0);
            assert!(measured.of_classic.is_some_and(|ratio| ratio > 0.0));
            let all = u64::from(cell.viewport * cell.viewport);
            match cell.view {
                "detail" => assert_eq!(measured.covered_pixels, all, "the detail fills the view"),
                _ => assert!((all / 10..all * 6 / 10).contains(&measured.covered_pixels), "the whole object is seen"),
            }
            assert!(cell.technique != Technique::Classic || measured.of_classic == Some(1.0));
        }
        let text = tables::all(&cells);
        for word in ["classic", "16x16", "24x24", "detail", "whole", "8x8", "tiny"] {
            assert!(text.contains(word), "{word} in\n{text}");
        }
    }

    #[test]
    fn what_does_not_fit_becomes_an_x_with_its_reason() {
        let (stage, source) = tiny();
        let mut cells = Vec::new();
        measure(&place_of(&source, &stage.hierarchy), &grid(1 << 20), &mut cells, &mut |_| Ok(())).expect("a table");
        assert!(cells.iter().all(|cell| cell.measured.is_none() && cell.failed.is_some()));
        let text = tables::all(&cells);
        assert!(text.contains(" x") && text.contains("memory budget"), "{text}");
    }
}
