//! Shots by the operators of the point renderer (Bouchiba et al. 2018, section 3) on indices instead of colours: points
//! of one pixel each, hidden point removal, and holes filled from pyramid levels with the point that is nearest in the
//! image among those on the front surface.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{IVec2, Vec2, Vec3};
use rayon::prelude::*;

use super::shots::{Face, NO_POINT, Pane};
use crate::scene::Cloud;

/// s_hpr, in spacings.
const SIZE: f32 = 10.0;
/// Mean occlusion below which a point is hidden.
const THRESHOLD: f32 = 0.1;
/// The level that serves as a coarse depth map.
const COARSE: usize = 4;
/// Depths within this share of the nearest belong to one surface.
const SAME_SURFACE: f32 = 0.05;
/// Points of one parallel task.
const CHUNK: usize = 1 << 14;
/// The eight sectors of the neighbourhood (Figure 3).
const RING: [IVec2; 8] = [
    IVec2::new(1, 0),
    IVec2::new(1, 1),
    IVec2::new(0, 1),
    IVec2::new(-1, 1),
    IVec2::new(-1, 0),
    IVec2::new(-1, -1),
    IVec2::new(0, -1),
    IVec2::new(1, -1),
];

/// Indices of points on a grid; [`NO_POINT`] where there is none.
struct Level {
    size: IVec2,
    point: Vec<u32>,
}

impl Level {
    fn at(&self, place: IVec2) -> Option<u32> {
        let inside = place.min_element() >= 0 && place.cmplt(self.size).all();
        inside.then(|| self.point[(place.y * self.size.x + place.x) as usize])
    }

    fn place(&self, index: usize) -> IVec2 {
        IVec2::new(index as i32 % self.size.x, index as i32 / self.size.x)
    }
}

/// A cloud as a pane sees it.
struct Seen<'a> {
    cloud: &'a Cloud,
    pane: &'a Pane,
    spacing: f32,
}

impl Seen<'_> {
    /// Position in the pane's space.
    fn view(&self, point: u32) -> Vec3 {
        self.pane.axes.transpose() * (self.cloud.positions[point as usize] - self.pane.eye)
    }

    /// Place in pixels.
    fn at(&self, view: Vec3) -> Vec2 {
        view.truncate() / view.z * self.pane.focal + self.pane.middle()
    }

    /// Level 0: the nearest point of each pixel.
    fn nearest(&self) -> Level {
        let [width, height] = self.pane.size;
        let keys: Vec<AtomicU64> = (0..width * height).map(|_| AtomicU64::new(u64::MAX)).collect();
        (0..self.cloud.len().div_ceil(CHUNK)).into_par_iter().for_each(|chunk| {
            for index in chunk * CHUNK..((chunk + 1) * CHUNK).min(self.cloud.len()) {
                let view = self.view(index as u32);
                let at = self.at(view);
                // A point nearer than two spacings is no part of a picture.
                let inside = at.cmpge(Vec2::ZERO).all() && at.cmplt(2.0 * self.pane.middle()).all();
                if view.z > 2.0 * self.spacing && inside {
                    let pixel = at.as_uvec2();
                    // Bits of positive floats order as the floats do.
                    let key = u64::from(view.z.to_bits()) << 32 | index as u64;
                    keys[(pixel.y * width + pixel.x) as usize].fetch_min(key, Ordering::Relaxed);
                }
            }
        });
        // The lower half of what was never written is NO_POINT.
        let point = keys.into_iter().map(|key| key.into_inner() as u32).collect();
        Level { size: IVec2::new(width as i32, height as i32), point }
    }

    /// A level and all coarser ones: of four points the nearest.
    fn pyramid(&self, finest: Level) -> Vec<Level> {
        let mut levels = vec![finest];
        while let Some(finer) = levels.last().filter(|level| level.size.max_element() > 1) {
            let size = (finer.size + 1) / 2;
            let mut coarser = Level { size, point: vec![NO_POINT; size.element_product() as usize] };
            let point = (0..coarser.point.len()).into_par_iter().map(|index| {
                let corner = 2 * coarser.place(index);
                let four = [0, 1, 2, 3].map(|k| finer.at(corner + IVec2::new(k & 1, k >> 1)).unwrap_or(NO_POINT));
                let depth = |point: &u32| self.view(*point).z;
                let nearest = four.into_iter().filter(|p| *p != NO_POINT).min_by(|a, b| depth(a).total_cmp(&depth(b)));
                nearest.unwrap_or(NO_POINT)
            });
            coarser.point = point.collect();
            levels.push(coarser);
        }
        levels
    }

    /// Whether a pixel's point, or the far plane where there is none, is visible (3.1.2, Eq. 1).
    fn visible(&self, levels: &[Level], index: usize) -> bool {
        let pixel = levels[0].place(index);
        let point = match levels[0].point[index] {
            NO_POINT => self.pane.ray(pixel.x as u32, pixel.y as u32) * (1e6 * self.spacing),
            point => self.view(point),
        };
        let coarse = levels.iter().enumerate().skip(COARSE).find_map(|(k, level)| {
            level.at(pixel >> k as i32).filter(|point| *point != NO_POINT).map(|point| self.view(point).z)
        });
        let Some(depth) = coarse else { return true };
        let last = ((SIZE * self.spacing * self.pane.focal / depth).log2().floor() - 1.0).max(0.0) as usize;
        let mut least = [Some(2.0_f32); 8];
        for (k, level) in levels.iter().enumerate().take(last + 1) {
            for (sector, side) in RING.into_iter().enumerate() {
                match level.at((pixel >> k as i32) + side) {
                    // A sector that the border cuts off does not count.
                    None if least[sector] == Some(2.0) => least[sector] = None,
                    None | Some(NO_POINT) => {}
                    Some(neighbour) => {
                        let neighbour = self.view(neighbour);
                        let to = neighbour - point;
                        let lengths = (to.length_squared() * neighbour.length_squared()).sqrt();
                        let value = if lengths > 0.0 { 1.0 + to.dot(neighbour) / lengths } else { 2.0 };
                        least[sector] = Some(least[sector].map_or(value, |known| known.min(value)));
                    }
                }
            }
        }
        let known: Vec<f32> = least.into_iter().flatten().collect();
        known.iter().sum::<f32>() >= THRESHOLD * known.len() as f32
    }

    /// The point nearest to `pixel` in the image among those of `candidates` on the front surface.
    fn closest(&self, pixel: Vec2, candidates: [u32; 4]) -> u32 {
        let views = candidates.map(|point| (point != NO_POINT).then(|| self.view(point)));
        let front = views.iter().flatten().map(|view| view.z).fold(f32::INFINITY, f32::min);
        let off = |view: Vec3| self.at(view).distance_squared(pixel);
        views
            .iter()
            .zip(candidates)
            .filter_map(|(view, point)| {
                view.filter(|view| view.z <= front * (1.0 + SAME_SURFACE)).map(|view| (off(view), point))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
            .map_or(NO_POINT, |(_, point)| point)
    }

    /// Level 0 with all holes filled.
    fn filled(&self, visible: Level, background: &[bool]) -> Level {
        let mut levels = self.pyramid(visible);
        for k in (0..levels.len() - 1).rev() {
            let (fine, coarse) = levels.split_at_mut(k + 1);
            let (fine, coarse) = (&mut fine[k], &coarse[0]);
            let scale = (1 << k) as f32;
            let point = (0..fine.point.len()).into_par_iter().map(|index| {
                if fine.point[index] != NO_POINT || (k == 0 && background[index]) {
                    return fine.point[index];
                }
                let place = fine.place(index);
                let side = 2 * (place & IVec2::ONE) - IVec2::ONE;
                let around = [0, 1, 2, 3].map(|n: i32| {
                    let at: IVec2 = (place >> 1) + side * IVec2::new(n & 1, n >> 1);
                    coarse.at(at.clamp(IVec2::ZERO, coarse.size - 1)).unwrap_or(NO_POINT)
                });
                self.closest((place.as_vec2() + 0.5) * scale, around)
            });
            fine.point = point.collect();
        }
        levels.swap_remove(0)
    }
}

/// A face of a shot: the point that each pixel shows, and the depth of its plane there.
pub(super) fn render(cloud: &Cloud, pane: &Pane) -> Face {
    let mut sorted = cloud.spacing.clone();
    let middle = sorted.len() / 2;
    let spacing = if sorted.is_empty() { 1.0 } else { *sorted.select_nth_unstable_by(middle, f32::total_cmp).1 };
    let seen = Seen { cloud, pane, spacing };
    let levels = seen.pyramid(seen.nearest());
    let visible: Vec<bool> =
        (0..levels[0].point.len()).into_par_iter().map(|index| seen.visible(&levels, index)).collect();
    let Level { size, point } = &levels[0];
    let background: Vec<bool> = point.iter().zip(&visible).map(|(p, visible)| *p == NO_POINT && *visible).collect();
    let kept = point.iter().zip(&visible).map(|(p, visible)| if *visible { *p } else { NO_POINT }).collect();
    let point = seen.filled(Level { size: *size, point: kept }, &background).point;
    let depth = point.iter().enumerate().map(|(index, point)| match *point {
        NO_POINT => f32::INFINITY,
        point => {
            let (view, normal) = (seen.view(point), pane.axes.transpose() * cloud.normals[point as usize]);
            let ray = pane.ray(index as u32 % pane.size[0], index as u32 / pane.size[0]);
            let planar = normal.dot(view) / normal.dot(ray);
            // A grazing plane goes anywhere.
            let reach = 2.0 * cloud.spacing[point as usize];
            if planar.is_nan() { view.z } else { planar.clamp(view.z - reach, view.z + reach) }
        }
    });
    Face { depth: depth.collect(), point }
}
