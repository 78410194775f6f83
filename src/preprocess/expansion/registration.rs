//! Where the photo was taken from: its camera is found by holding views of the cloud against it, whatever their
//! exposures. Surfaces that both show then tell the exposure far better than histograms do, which know nothing of what
//! the photo happens to hold. The paper needs no such registration and neither does the rest: where none is found, the
//! histograms' exposure stays.

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use super::scouts::{Scouts, sketch, thinned};
use super::shots::{Pane, render};
use crate::compare::luminance;
use crate::scene::{Cloud, Picture};

/// Vertical fields of view that are tried first, degrees: long side 28 to 100.
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

    fn focal(&self, log_tan: f32) -> f32 {
        0.5 * self.size[1] as f32 / log_tan.exp()
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
                    let mut of_direction = (f32::INFINITY, View::default());
                    for field in FIELDS {
                        let turn = turn as f32 / TURNS as f32 * std::f32::consts::TAU;
                        let log_tan = (0.5 * field.to_radians()).tan().ln();
                        let [x, y, z] = sketch.eye.to_array();
                        let view = [x, y, z, turn, tilt.to_radians(), 0.0, log_tan];
                        let (axes, focal) = (axes(&view), photo.focal(log_tan));
                        let middle = 0.5 * Vec2::from(photo.size.map(|s| s as f32));
                        let (cost, _) = misfit(photo, |n| {
                            let pixel = Vec2::new((n % photo.size[0]) as f32, (n / photo.size[0]) as f32) + 0.5;
                            let ray = axes * ((pixel - middle) / focal).extend(1.0);
                            scouts.cloud.colors.get(sketch.towards(ray).1 as usize).copied()
                        });
                        if cost < of_direction.0 {
                            of_direction = (cost, view);
                        }
                    }
                    best.push(of_direction);
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

fn cost(cloud: &Cloud, photo: &Small, view: &View) -> (f32, f32) {
    let pane = Pane {
        eye: Vec3::new(view[0], view[1], view[2]),
        axes: axes(view),
        size: photo.size,
        focal: photo.focal(view[6]),
    };
    let front = sketch(cloud, &pane);
    misfit(photo, |n| cloud.colors.get(front[n as usize].1 as usize).copied())
}

/// Downhill simplex (Nelder and Mead 1965).
fn refine(cloud: &Cloud, photo: &Small, start: View, level: usize) -> (f32, View) {
    const EVALUATIONS: [u32; 3] = [140, 120, 60];
    let size = crate::preprocess::neighbours::bounds(&cloud.positions);
    let extent = (size.1 - size.0).length();
    let reach = [0.5_f32, 0.1, 0.02][level];
    let steps = [0.08 * extent, 0.08 * extent, 0.08 * extent, 0.15, 0.15, 0.05, 0.15].map(|s| s * reach);
    let evaluate = |view: View| (cost(cloud, photo, &view).0, view);
    let mut simplex = vec![evaluate(start)];
    for (axis, step) in steps.into_iter().enumerate() {
        let mut view = start;
        view[axis] += step;
        simplex.push(evaluate(view));
    }
    for _ in 0..EVALUATIONS[level] {
        simplex.sort_by(|a, b| a.0.total_cmp(&b.0));
        let worst = simplex[7];
        let mut middle = View::default();
        for (_, view) in &simplex[..7] {
            for (m, v) in middle.iter_mut().zip(view) {
                *m += v / 7.0;
            }
        }
        let along = |t: f32| {
            let mut view = middle;
            for (v, w) in view.iter_mut().zip(worst.1) {
                *v += t * (w - *v);
            }
            evaluate(view)
        };
        let reflected = along(-1.0);
        let next = if reflected.0 < simplex[0].0 {
            let further = along(-2.0);
            if further.0 < reflected.0 { further } else { reflected }
        } else if reflected.0 < simplex[6].0 {
            reflected
        } else {
            let nearer = along(if reflected.0 < worst.0 { -0.5 } else { 0.5 });
            if nearer.0 < worst.0.min(reflected.0) {
                nearer
            } else {
                let best = simplex[0].1;
                for (cost, view) in &mut simplex[1..] {
                    for (v, b) in view.iter_mut().zip(best) {
                        *v = 0.5 * (*v + b);
                    }
                    (*cost, *view) = evaluate(*view);
                }
                continue;
            }
        };
        simplex[7] = next;
    }
    simplex.sort_by(|a, b| a.0.total_cmp(&b.0));
    simplex[0]
}

/// Holds the photo against the whole cloud at that view.
fn agreement(cloud: &Cloud, photo: &Picture, view: &View) -> Option<Registration> {
    let small = Small::new(photo, 480);
    let pane = Pane {
        eye: Vec3::new(view[0], view[1], view[2]),
        axes: axes(view),
        size: small.size,
        focal: small.focal(view[6]),
    };
    let face = render(cloud, &pane);
    let color = |n: usize| cloud.colors.get(face.point[n] as usize).copied();
    let (_, rough) = misfit(&small, |n| color(n as usize));
    let mut stops = Vec::new();
    for (n, &photo) in small.colors.iter().enumerate() {
        if let Some(cloud) = color(n).filter(|c| c.max_element() < 0.8 && luminance(*c) > 0.02) {
            let here = luminance(cloud).log2() - luminance(photo.map(f32::exp2)).log2();
            if (here - rough).abs() < 3.0 * AGREES {
                stops.push(here);
            }
        }
    }
    let same = stops.iter().filter(|s| (**s - rough).abs() < AGREES).count();
    let agreement = same as f32 / small.colors.len() as f32;
    if stops.is_empty() {
        return None;
    }
    let middle = stops.len() / 2;
    let gain = *stops.select_nth_unstable_by(middle, f32::total_cmp).1;
    let fov_y = 2.0 * view[6].exp().atan();
    let found =
        Registration { eye: pane.eye, angles: [view[3], view[4], view[5]], fov_y, agreement, alpha: gain.exp2() };
    (agreement >= LEAST_AGREEMENT).then_some(found)
}
