//! Small cubemaps from many places inside the cloud, of a thinned-out cloud: where shots are best taken from and where
//! the photo may have been taken from are both looked for among them.

use glam::{UVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::shots::{FACES, NO_POINT, Pane, project};
use crate::preprocess::neighbours::{bounds, spatial_order};
use crate::scene::Cloud;

/// Points of the thinned cloud, about.
const POINTS: usize = 16_000;
/// Places that are tried at most.
const PLACES: u32 = 160;
/// Pixels along a side of a face.
const SIZE: u32 = 48;
/// Share of the directions in which a place must see the cloud, or it lies outside.
const SURROUNDED: f32 = 0.35;

/// The thinned cloud with cubemaps of it.
pub(super) struct Scouts {
    pub(super) cloud: Cloud,
    pub(super) sketches: Vec<Sketch>,
}

/// A quick cubemap of squares without tilt, of [`SIZE`].
pub(super) struct Sketch {
    pub(super) eye: Vec3,
    /// (depth, point) of every pixel, face by face.
    front: Vec<(f32, u32)>,
}

impl Sketch {
    fn take(cloud: &Cloud, eye: Vec3) -> Self {
        let mut front = vec![(f32::INFINITY, NO_POINT); 6 * (SIZE * SIZE) as usize];
        let half = 0.5 * SIZE as f32;
        for (index, (&position, &spacing)) in cloud.positions.iter().zip(&cloud.spacing).enumerate() {
            let (face, at) = project(position - eye, SIZE);
            let depth = (position - eye).dot(FACES[face].z_axis);
            let face = &mut front[face * (SIZE * SIZE) as usize..][..(SIZE * SIZE) as usize];
            square(face, [SIZE; 2], at, half * spacing / depth, (depth, index as u32));
        }
        Self { eye, front }
    }

    /// (depth, point) seen in a direction; [`NO_POINT`] where there is none.
    pub(super) fn towards(&self, direction: Vec3) -> (f32, u32) {
        let (face, at) = project(direction, SIZE);
        let pixel = at.min(Vec2::splat(SIZE as f32 - 1.0)).as_uvec2();
        self.front[((face as u32 * SIZE + pixel.y) * SIZE + pixel.x) as usize]
    }

    /// Share of the directions in which there is a point.
    fn surrounded(&self) -> f32 {
        self.front.iter().filter(|(_, point)| *point != NO_POINT).count() as f32 / self.front.len() as f32
    }
}

/// Keeps the nearer of what is there and a square of `side` pixels around `at`.
fn square(front: &mut [(f32, u32)], size: [u32; 2], at: Vec2, side: f32, item: (f32, u32)) {
    // Not above an eighth of the picture: what is nearer than that is no part of it. NaN ends here too.
    let widest = 0.125 * size[0].max(size[1]) as f32;
    if !(at.is_finite() && side <= widest && item.0 > 0.0) {
        return;
    }
    let half = 0.5 * side.max(1.42);
    let clamp = |v: Vec2| v.clamp(Vec2::ZERO, Vec2::from(size.map(|s| s as f32))).as_uvec2();
    let (from, to) = (clamp((at - half - 0.5).ceil()), clamp((at + half - 0.5).floor() + 1.0));
    for y in from.y..to.y {
        for pixel in &mut front[(y * size[0] + from.x) as usize..(y * size[0] + to.x.max(from.x)) as usize] {
            if item.0 < pixel.0 {
                *pixel = item;
            }
        }
    }
}

/// The front point of every pixel of a pane, drawn as [`Sketch`] draws.
pub(super) fn sketch(cloud: &Cloud, pane: &Pane) -> Vec<(f32, u32)> {
    let mut front = vec![(f32::INFINITY, NO_POINT); pane.size[0] as usize * pane.size[1] as usize];
    let to_view = pane.axes.transpose();
    for (index, (&position, &spacing)) in cloud.positions.iter().zip(&cloud.spacing).enumerate() {
        let view = to_view * (position - pane.eye);
        let scale = pane.focal / view.z;
        let at = Vec2::new(view.x, view.y) * scale + pane.middle();
        square(&mut front, pane.size, at, spacing * scale, (view.z, index as u32));
    }
    front
}

/// Every n-th point along a space-filling curve, about `points` of them. Each stands for n.
pub(super) fn thinned(cloud: &Cloud, points: usize) -> Cloud {
    let step = cloud.len().div_ceil(points.max(1)).max(1);
    let order = spatial_order(&cloud.positions);
    let sources: Vec<u32> = order.iter().skip(step / 2).step_by(step).map(|&(_, _, index)| index).collect();
    let growth = (step as f32).sqrt();
    let pick = |from: &[Vec3]| sources.iter().map(|&n| from[n as usize]).collect();
    Cloud {
        positions: pick(&cloud.positions),
        colors: pick(&cloud.colors),
        normals: pick(&cloud.normals),
        spacing: sources.iter().map(|&n| cloud.spacing[n as usize] * growth).collect(),
        ..Cloud::default()
    }
}

impl Scouts {
    /// Places on a grid over the cloud's box that see the cloud in many directions and do not touch it.
    pub(super) fn send(whole: &Cloud) -> Self {
        let cloud = thinned(whole, POINTS);
        let mut sketches: Vec<Sketch> = places(&cloud).into_par_iter().map(|eye| Sketch::take(&cloud, eye)).collect();
        // Where no place is surrounded, as in a scan from one side, the more surrounded half will do.
        let mut shares: Vec<f32> = sketches.iter().map(Sketch::surrounded).collect();
        shares.sort_unstable_by(f32::total_cmp);
        let least = shares.get(shares.len() / 2).copied().unwrap_or(0.0).min(SURROUNDED);
        sketches.retain(|sketch| sketch.surrounded() >= least);
        Self { cloud, sketches }
    }
}

/// Middles of the cells of a grid over the cloud's box.
fn places(cloud: &Cloud) -> Vec<Vec3> {
    let (low, high) = bounds(&cloud.positions);
    let extent = (high - low).max(Vec3::splat(1e-6));
    // Cells as cubic as whole numbers allow.
    let mut cells = UVec3::ONE;
    loop {
        let widest = (extent / cells.as_vec3()).to_array();
        let axis = (0..3).max_by(|&a, &b| widest[a].total_cmp(&widest[b])).unwrap_or(0);
        let mut finer = cells;
        finer[axis] += 1;
        if finer.element_product() > PLACES {
            break;
        }
        cells = finer;
    }
    let place = |n: u32| {
        let cell = UVec3::new(n % cells.x, n / cells.x % cells.y, n / (cells.x * cells.y));
        low + extent * (cell.as_vec3() + 0.5) / cells.as_vec3()
    };
    (0..cells.element_product()).map(place).collect()
}
