//! `relume evaluate expansion`: Sabbadin 2019, Table 2.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use serde::Serialize;

use super::scenes::{Scene, exposure, low};
use crate::cli::expand::ShotsByName;
use crate::cli::output::say;
use crate::cli::{expand, render, stage, values};
use crate::compare::{self, Image, Metrics, Tile, contact_sheet, to_srgb8};
use crate::formats::image::write_png;
use crate::frames::{MaterialChoice, Settings};
use crate::gpu::{Context, ContextOptions};
use crate::preprocess::expansion::{Expansion, Inputs, Options, Places, Strategy, Transfer};
use crate::preprocess::hierarchy::{self, BuildOptions};
use crate::reference::shapes::sphere;
use crate::scene::{Camera, Cloud, Object};
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Args {
    /// Cloud with HDR colours; repeat with a photo and a place each [default: two rooms built in code]
    #[arg(long, value_name = "HDR.ply")]
    cloud: Vec<PathBuf>,
    /// HDR photo of a part of that cloud
    #[arg(long, value_name = "FILE")]
    photo: Vec<PathBuf>,
    /// Where the object stands in it
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    object_at: Vec<DVec3>,
    /// Radius of the object, a sphere, metres
    #[arg(long, value_name = "R", default_value = "0.35", value_parser = values::positive)]
    radius: f64,
    /// Pixels along a side of a shot's faces
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = clap::value_parser!(u32).range(32..=4096))]
    shot_size: u32,
    /// How shots are rendered
    #[arg(long, value_enum, default_value_t = ShotsByName::Splats)]
    shots_by: ShotsByName,
    /// Write all numbers here
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Folder of contact sheets of the lit object; made where it is missing
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
}

/// Pixels along a side of a rendering.
const SIZE: u32 = 128;
const MATERIALS: [(&str, MaterialChoice); 2] =
    [("diffuse", MaterialChoice::Diffuse(0.7)), ("metal 0.25", MaterialChoice::Metal(0.25))];

/// One row of the table.
#[derive(Serialize)]
struct Row {
    scene: String,
    method: String,
    /// Root mean square over points and channels, in the truth's units.
    points_rms: f64,
    renderings: Vec<Rendering>,
}

#[derive(Serialize)]
struct Rendering {
    view: usize,
    material: &'static str,
    relative_rms_luminance: f64,
    bias: f64,
    ssim: f64,
    flip: f64,
}

pub(super) fn run(args: &Args) -> Result<()> {
    if let Some(json) = &args.json {
        values::check_output(json, &["json"])?;
    }
    if args.cloud.len() != args.photo.len() || args.cloud.len() != args.object_at.len() {
        let (clouds, photos, places) = (args.cloud.len(), args.photo.len(), args.object_at.len());
        return Err(Error::Argument(format!(
            "{clouds} --cloud, {photos} --photo and {places} --object-at: each cloud needs one of both"
        )));
    }
    if let Some(folder) = &args.report {
        std::fs::create_dir_all(folder).map_err(|e| Error::file(folder, format!("cannot be made: {e}")))?;
    }
    let context = Context::new(&ContextOptions::default())?;
    let mut rows = Vec::new();
    if args.cloud.is_empty() {
        for scene in [Scene::toy_room as fn() -> Result<Scene>, Scene::panorama_room] {
            rows.extend(evaluate(&context, &scene()?, args)?);
        }
    } else {
        for ((cloud, photo), at) in args.cloud.iter().zip(&args.photo).zip(&args.object_at) {
            rows.extend(evaluate(&context, &Scene::read(cloud, photo, *at, args.radius as f32)?, args)?);
        }
    }
    if let Some(path) = &args.json {
        render::write_json(path, &rows)?;
    }
    Ok(())
}

/// What is compared: (name, strategy, transfer).
fn methods() -> Vec<(String, Strategy, Transfer)> {
    let mut methods = Vec::new();
    for strategy in Strategy::ALL {
        methods.push((format!("{} luminance", strategy.name()), strategy, Transfer::Luminance));
        if strategy.knows_colors() {
            methods.push((format!("{} rgb", strategy.name()), strategy, Transfer::Rgb));
        }
    }
    methods
}

fn evaluate(context: &Arc<Context>, scene: &Scene, args: &Args) -> Result<Vec<Row>> {
    let alpha = exposure(&scene.truth);
    let low = low(&scene.truth, alpha);
    let lit = Lit::new(context, scene)?;
    say!("{}: {} points, exposure {alpha:.3}", scene.name, low.len())?;
    say!(
        "{:>22} {:>8} {:>8} {:>8} {:>8} {:>7} {:>7} {:>9}",
        "method",
        "diffuse",
        "metal",
        "near d.",
        "near m.",
        "SSIM",
        "FLIP",
        "points"
    )?;
    let mut rows = Vec::new();
    let mut tiles = lit.tiles("truth", &lit.truth, None)?;
    // The first expansion finds exposure and places; the others take its word.
    let mut found: Option<(Option<f32>, Vec<Vec3>)> = None;
    let mut results = vec![("LDR".to_owned(), low.colors.clone())];
    for (name, strategy, transfer) in methods() {
        let (shot_size, shots_by) = (args.shot_size, args.shots_by.into());
        let mut options = Options { strategy, transfer, shot_size, shots_by, ..Options::default() };
        if let Some((alpha, places)) = &found {
            options.alpha = *alpha;
            options.places = Places::At(places.clone());
        }
        let inputs = Inputs { cloud: &low, photo: Some(&scene.photo), network: None };
        let Expansion { colors, report, .. } = expand::with_progress(inputs, &options)?;
        if found.is_none() {
            say!("{:>22} found {:.3}", "exposure", report.alpha.unwrap_or_default())?;
            found = Some((report.alpha, report.shots));
        }
        results.push((name, colors));
    }
    for (name, colors) in results {
        let colors: Vec<Vec3> = colors.iter().map(|color| *color / alpha).collect();
        let points_rms = points_rms(&colors, &scene.truth.colors);
        let images = lit.images(&Cloud { colors, ..low.clone() })?;
        let metrics: Vec<Metrics> =
            images.iter().zip(&lit.truth).map(|(a, b)| compare::compare(a, b)).collect::<Result<_>>()?;
        let mean = |value: fn(&Metrics) -> f64| metrics.iter().map(value).sum::<f64>() / metrics.len() as f64;
        let rms: Vec<String> = metrics.iter().map(|m| format!("{:8.4}", m.relative_rms_luminance)).collect();
        let (rms, ssim, flip) = (rms.join(" "), mean(|m| m.ssim), mean(|m| m.flip));
        say!("{name:>22} {rms} {ssim:7.4} {flip:7.4} {points_rms:9.4}")?;
        tiles.extend(lit.tiles(&name, &images, Some(&metrics))?);
        rows.push(Row { scene: scene.name.clone(), method: name, points_rms, renderings: renderings(&metrics) });
    }
    if let Some(folder) = &args.report {
        let sheet = contact_sheet(&format!("{}: the object in expanded clouds", scene.name), 4, &tiles)?;
        let path = folder.join(format!("{}.png", scene.name.replace(' ', "-")));
        write_png(&path, sheet.width(), sheet.height(), sheet.as_raw())?;
        say!("{}", path.display())?;
    }
    Ok(rows)
}

fn renderings(metrics: &[Metrics]) -> Vec<Rendering> {
    let rendering = |(n, m): (usize, &Metrics)| Rendering {
        view: n / MATERIALS.len() + 1,
        material: MATERIALS[n % MATERIALS.len()].0,
        relative_rms_luminance: m.relative_rms_luminance,
        bias: m.bias,
        ssim: m.ssim,
        flip: m.flip,
    };
    metrics.iter().enumerate().map(rendering).collect()
}

fn points_rms(a: &[Vec3], b: &[Vec3]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from((*a - *b).length_squared())).sum();
    (sum / (3 * a.len().max(1)) as f64).sqrt()
}

/// The object, its two views, and how it looks in the true cloud.
struct Lit<'a> {
    context: &'a Arc<Context>,
    object: Object,
    views: [Camera; 2],
    truth: Vec<Image>,
    stops: f32,
}

impl<'a> Lit<'a> {
    fn new(context: &'a Arc<Context>, scene: &Scene) -> Result<Self> {
        let object = stage::placed(sphere(scene.radius, 24), scene.object_at);
        let whole = Camera::framing(scene.object_at, scene.radius);
        let eye = scene.object_at + scene.radius * Vec3::new(-1.2, 0.7, 2.2);
        let near = Camera { from: eye, at: scene.object_at, fov_y: 22.0_f32.to_radians() };
        let mut lit = Self { context, object, views: [whole, near], truth: Vec::new(), stops: 0.0 };
        lit.truth = lit.images(&scene.truth)?;
        let covered = |image: &Image| image.alpha.iter().filter(|alpha| **alpha > 0.5).count().max(1) as f32;
        let first = &lit.truth[0];
        let mean = first.rgb.iter().map(|&c| compare::luminance(c)).sum::<f32>() / covered(first);
        lit.stops = (0.3 / mean.max(1e-6)).log2();
        Ok(lit)
    }

    /// By view, then by material.
    fn images(&self, cloud: &Cloud) -> Result<Vec<Image>> {
        let (hierarchy, _) = hierarchy::build(cloud, &BuildOptions::default())?;
        let technique = stage::per_pixel(self.context);
        let mut images = Vec::new();
        for camera in &self.views {
            for (_, material) in MATERIALS {
                let settings = Settings { technique, material, width: SIZE, height: SIZE, ..Settings::default() };
                let frame = stage::render(self.context, &hierarchy, &self.object, camera, settings)?;
                images.push(stage::image_of(&frame)?);
            }
        }
        Ok(images)
    }

    fn tiles(&self, name: &str, images: &[Image], metrics: Option<&[Metrics]>) -> Result<Vec<Tile>> {
        let tile = |(n, image): (usize, &Image)| {
            let (view, material) = (n / MATERIALS.len() + 1, MATERIALS[n % MATERIALS.len()].0);
            let caption = metrics.map_or_else(
                || "lit by the true cloud".into(),
                |m| format!("RMS {:.3}, bias {:+.3}", m[n].relative_rms_luminance, m[n].bias),
            );
            let title = format!("{name}: {material}, view {view}");
            Ok(Tile { image: to_srgb8(image, self.stops)?, title, caption })
        };
        images.iter().enumerate().map(tile).collect()
    }
}
