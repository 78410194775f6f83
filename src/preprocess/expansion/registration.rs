//! Where the photo was taken from: its camera is found by holding views of the cloud against it, whatever their
//! exposures. Surfaces that both show then tell the exposure far better than histograms do, which know nothing of what
//! the photo happens to hold. The paper needs no such registration and neither does the rest: where none is found, the
//! histograms' exposure stays.

use std::f32::consts::TAU;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::scouts::{Scouts, sketch, thinned};
use super::shots::{Pane, render};
use super::simplex;
use crate::compare::luminance;
use crate::preprocess::neighbours::bounds;
use crate::scene::{Cloud, Picture};

/// Vertical fields of view that are tried first, degrees.
const FIELDS: [f32; 5] = [30.0, 40.0, 52.0, 65.0, 80.0];
/// Turns and tilts that are tried first.
const TURNS: u32 = 32;
const TILTS: [f32; 5] = [-50.0, -25.0, 0.0, 25.0, 50.0];
/// Longer side of the photo in pixels: in the first search, and in the refinements.
const SIDES: [u32; 4] = [24, 32, 64, 128];
/// Points of the cloud in the refinements.
const POINTS: [usize; 3] = [8_000, 25_000, 100_000];
/// Views that are left after each.
const LEFT: [usize; 3] = [2, 1, 1];
/// Rounds of the simplex search in each, and the size of its first steps relative to what the first search leaves open.
const ROUNDS: [u32; 3] = [140, 120, 60];
const REACH: [f32; 3] = [0.5, 0.1, 0.02];
/// Longer side of the photo in the last look.
const LAST_SIDE: u32 = 480;
/// Views that are refined.
const REFINED: usize = 12;
/// Differences are cut off at this many stops: a wrong surface is wrong, however wrong.
const CUT: f32 = 1.0;
/// Nothing counts as darker.
const FLOOR: f32 = 1.0 / 256.0;
/// A channel above this is clipped.
const CLIPPED: f32 = 0.95;
/// Surfaces that agree within this many stops are the same.
const AGREES: f32 = 0.1;
/// Surfaces darker or brighter than this, in the cloud, do not tell the exposure.
const WELL_EXPOSED: (f32, f32) = (0.02, 0.8);
/// Share of a plain grey picture's misfit that a view may have at most.
const EXPLAINED: f32 = 0.5;
/// Share of the photo that must agree, or the photo is not found.
const LEAST_AGREEMENT: f32 = 0.4;

/// The photo's camera in the cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registration {
    /// Eye, in the space of [`Cloud::positions`].
    pub eye: Vec3,
    /// Radians about +Y from -Z towards -X; above the horizon; clockwise about the view.
    pub angles: [f32; 3],
    /// Vertical field of view, radians.
    pub fov_y: f32,
    /// Share of the photo's pixels that show the same surface as the cloud, by their agreement, 0 to 1.
    pub agreement: f32,
    /// What the photo's values are multiplied by to be those of the cloud.
    pub alpha: f32,
}

/// A camera as seven numbers.
type View = [f32; 7];

fn axes(view: &View) -> Mat3 {
    let [_, _, _, turn, tilt, roll, _] = *view;
    // Columns (right, down, forward) of a camera that looks along -Z.
    let straight = Mat3::from_cols(Vec3::X, Vec3::NEG_Y, Vec3::NEG_Z);
    Mat3::from_rotation_y(turn) * Mat3::from_rotation_x(tilt) * straight * Mat3::from_rotation_z(roll)
}

/// The photo made small: logarithms of base 2.
struct Small {
    size: [u32; 2],
    colors: Vec<Vec3>,
}

impl Small {
    fn new(photo: &Picture, side: u32) -> Self {
        let longer = photo.width.max(photo.height);
        let shrunk = |length: u32| ((length * side.min(longer)) as f32 / longer as f32).round().max(1.0) as u32;
        let size = [shrunk(photo.width), shrunk(photo.height)];
        let range = |n: u32, count: u32, length: u32| {
            n * length / count..((n + 1) * length / count).max(n * length / count + 1)
        };
        let mean = |n: u32| {
            let (columns, rows) = (range(n % size[0], size[0], photo.width), range(n / size[0], size[1], photo.height));
            let count = (columns.len() * rows.len()) as f32;
            let sum: Vec3 = rows.flat_map(|y| columns.clone().map(move |x| photo.at(x, y))).sum();
            sum / count
        };
        Self { size, colors: (0..size[0] * size[1]).map(|n| mean(n).max(Vec3::splat(1e-9)).map(f32::log2)).collect() }
    }

    /// What a camera would see the cloud through, to be held against the photo.
    fn pane(&self, view: &View) -> Pane {
        let [x, y, z, _, _, _, log_tan] = *view;
        let focal = 0.5 * self.size[1] as f32 / log_tan.exp();
        Pane { eye: Vec3::new(x, y, z), axes: axes(view), size: self.size, focal }
    }
}

/// How badly a view of the cloud fits the photo, in stops, and the gain in stops. `seen` gives the cloud's colour at a
/// pixel, if any.
fn misfit(photo: &Small, seen: impl Fn(u32) -> Option<Vec3>) -> (f32, f32) {
    let mut differences = Vec::with_capacity(photo.colors.len());
    let mut clipped = Vec::new();
    for (n, &color) in photo.colors.iter().enumerate() {
        match seen(n as u32) {
            Some(cloud) if cloud.max_element() >= CLIPPED => clipped.push(color),
            Some(cloud) => differences.push(cloud.max(Vec3::splat(FLOOR)).map(f32::log2) - color),
            None => {}
        }
    }
    let holes = photo.colors.len() - differences.len() - clipped.len();
    if differences.len() < photo.colors.len() / 4 {
        return (f32::INFINITY, 0.0);
    }
    let mut levels: Vec<f32> = differences.iter().map(|d| d.element_sum() / 3.0).collect();
    let middle = levels.len() / 2;
    let gain = *levels.select_nth_unstable_by(middle, f32::total_cmp).1;
    let mut sum: f32 = differences.iter().map(|d| (*d - gain).abs().max_element().min(CUT)).sum();
    // What the cloud clips must clip in the photo too.
    sum += clipped.iter().map(|c| (-c.max_element() - gain).clamp(0.0, CUT)).sum::<f32>();
    sum += holes as f32 * 0.5 * CUT;
    (sum / photo.colors.len() as f32, gain)
}

/// Finds the photo in the cloud; `None` where it shows something else or too little.
pub(super) fn register(cloud: &Cloud, scouts: &Scouts, photo: &Picture) -> Option<Registration> {
    let mut views = first_views(scouts, &Small::new(photo, SIDES[0]));
    for (level, &points) in POINTS.iter().enumerate() {
        let thin = thinned(cloud, points);
        let small = Small::new(photo, SIDES[level + 1]);
        views = views.into_par_iter().map(|(_, view)| refine(&thin, &small, view, level)).collect();
        views.sort_by(|a, b| a.0.total_cmp(&b.0));
        views.truncate(LEFT[level]);
    }
    let (_, view) = *views.first()?;
    agreement(cloud, photo, &view)
}

/// The best views from all scouts.
fn first_views(scouts: &Scouts, photo: &Small) -> Vec<(f32, View)> {
    let mut views: Vec<(f32, View)> = scouts
        .sketches
        .par_iter()
        .flat_map_iter(|sketch| {
            let mut best: Vec<(f32, View)> = Vec::new();
            for turn in 0..TURNS {
                for tilt in TILTS {
                    let of_field = |field: f32| {
                        let turn = turn as f32 / TURNS as f32 * TAU;
                        let log_tan = (0.5 * field.to_radians()).tan().ln();
                        let [x, y, z] = sketch.eye.to_array();
                        let view = [x, y, z, turn, tilt.to_radians(), 0.0, log_tan];
                        let pane = photo.pane(&view);
                        let (cost, _) = misfit(photo, |n| {
                            let ray = pane.ray(n % pane.size[0], n / pane.size[0]);
                            scouts.cloud.colors.get(sketch.towards(pane.axes * ray).1 as usize).copied()
                        });
                        (cost, view)
                    };
                    best.extend(FIELDS.map(of_field).into_iter().min_by(|a, b| a.0.total_cmp(&b.0)));
                }
            }
            best.sort_by(|a, b| a.0.total_cmp(&b.0));
            best.truncate(4);
            best
        })
        .collect();
    views.sort_by(|a, b| a.0.total_cmp(&b.0));
    views.truncate(REFINED);
    views
}

/// Betters a view by drawing the thinned cloud again and again.
fn refine(cloud: &Cloud, photo: &Small, start: View, level: usize) -> (f32, View) {
    let (low, high) = bounds(&cloud.positions);
    let place = 0.08 * (high - low).length();
    let steps = [place, place, place, 0.15, 0.15, 0.05, 0.15].map(|step| step * REACH[level]);
    simplex::minimise(start, steps, ROUNDS[level], |view| {
        let front = sketch(cloud, &photo.pane(view));
        misfit(photo, |n| cloud.colors.get(front[n as usize].1 as usize).copied()).0
    })
}

/// Holds the photo against the whole cloud at that view.
fn agreement(cloud: &Cloud, photo: &Picture, view: &View) -> Option<Registration> {
    let small = Small::new(photo, LAST_SIDE);
    let pane = small.pane(view);
    let face = render(cloud, &pane);
    let color = |n: usize| cloud.colors.get(face.point[n] as usize).copied();
    let (cost, rough) = misfit(&small, |n| color(n as usize));
    // Plain walls agree with any plain wall, at any exposure.
    let (flat, _) = misfit(&small, |_| Some(Vec3::splat(0.5 * CLIPPED)));
    if cost.is_nan() || cost > EXPLAINED * flat {
        return None;
    }
    let mut stops = Vec::new();
    for (n, &photo) in small.colors.iter().enumerate() {
        if let Some(cloud) = color(n).filter(|&c| c.max_element() < WELL_EXPOSED.1 && luminance(c) > WELL_EXPOSED.0) {
            let here = luminance(cloud).log2() - luminance(photo.map(f32::exp2)).log2();
            if (here - rough).abs() < 3.0 * AGREES {
                stops.push(here);
            }
        }
    }
    let same = stops.iter().filter(|here| (**here - rough).abs() < AGREES).count();
    let agreement = same as f32 / small.colors.len() as f32;
    if agreement < LEAST_AGREEMENT {
        return None;
    }
    let middle = stops.len() / 2;
    let alpha = stops.select_nth_unstable_by(middle, f32::total_cmp).1.exp2();
    let [_, _, _, turn, tilt, roll, log_tan] = *view;
    let fov_y = 2.0 * log_tan.exp().atan();
    Some(Registration { eye: pane.eye, angles: [turn, tilt, roll], fov_y, agreement, alpha })
}
