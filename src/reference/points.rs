//! The operators of the point renderer, plain and slow (Bouchiba et al. 2018, section 3): what tests hold the GPU's
//! against. View space is x right, y down, z away from the eye; a z of 0 means that there is no point.

use glam::{IVec2, Vec2, Vec3};

use crate::scene::Camera;

/// A pinhole camera as the operators need it.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// The camera.
    pub camera: Camera,
    /// Width of the image, pixels.
    pub width: usize,
    /// Height of the image, pixels.
    pub height: usize,
    /// s_0, metres.
    pub spacing: f32,
}

impl View {
    /// Distance to the image plane in pixels.
    pub fn focal(&self) -> f32 {
        0.5 * self.height as f32 / (0.5 * self.camera.fov_y).tan()
    }

    /// Direction through a place in the image, view space, with z of 1.
    pub fn ray(&self, place: Vec2) -> Vec3 {
        let middle = 0.5 * Vec2::new(self.width as f32, self.height as f32);
        ((place - middle) / self.focal()).extend(1.0)
    }

    /// World to view space.
    pub fn view_from_world(&self, position: Vec3) -> Vec3 {
        let (right, up, forward) = self.camera.basis();
        let from_eye = position - self.camera.from;
        Vec3::new(from_eye.dot(right), -from_eye.dot(up), from_eye.dot(forward))
    }

    /// A direction, view to world space.
    pub fn world_from_view(&self, direction: Vec3) -> Vec3 {
        let (right, up, forward) = self.camera.basis();
        right * direction.x - up * direction.y + forward * direction.z
    }

    fn centre(&self, index: usize) -> Vec2 {
        Vec2::new((index % self.width) as f32 + 0.5, (index / self.width) as f32 + 0.5)
    }
}

/// One level of a pyramid: positions in view space and weights.
#[derive(Clone, Debug, Default)]
pub struct Level {
    /// Width, texels.
    pub width: usize,
    /// Height, texels.
    pub height: usize,
    /// Position.
    pub position: Vec<Vec3>,
    /// 1 for what is known, 0 for a hole, -1 for the background.
    pub weight: Vec<f32>,
}

impl Level {
    fn new(width: usize, height: usize) -> Self {
        Self { width, height, position: vec![Vec3::ZERO; width * height], weight: vec![0.0; width * height] }
    }

    /// Index of a texel, `None` outside.
    fn at(&self, place: IVec2) -> Option<usize> {
        let inside = place.min_element() >= 0 && place.x < self.width as i32 && place.y < self.height as i32;
        inside.then(|| place.y as usize * self.width + place.x as usize)
    }

    fn place(&self, index: usize) -> IVec2 {
        IVec2::new((index % self.width) as i32, (index / self.width) as i32)
    }

    fn clamped(&self, place: IVec2) -> usize {
        let place = place.clamp(IVec2::ZERO, IVec2::new(self.width as i32 - 1, self.height as i32 - 1));
        place.y as usize * self.width + place.x as usize
    }
}

/// The nearest point of every pixel, on the ray through the pixel's centre.
pub fn project(points: &[Vec3], view: &View) -> Level {
    let mut level = Level::new(view.width, view.height);
    for &point in points {
        let place = view.view_from_world(point);
        if place.z < 2.0 * view.spacing {
            continue;
        }
        let at = place.truncate() / place.z * view.focal() + 0.5 * Vec2::new(view.width as f32, view.height as f32);
        let Some(index) = level.at(at.floor().as_ivec2()) else { continue };
        if level.position[index].z == 0.0 || place.z < level.position[index].z {
            level.position[index] = view.ray(view.centre(index)) * place.z;
        }
    }
    level
}

/// A level and all coarser ones: of four points the nearest (3.1.1).
pub fn point_pyramid(finest: Level) -> Vec<Level> {
    let mut levels = vec![finest];
    while let Some(finer) = levels.last().filter(|level| level.width > 1 || level.height > 1) {
        let mut level = Level::new(finer.width.div_ceil(2), finer.height.div_ceil(2));
        for index in 0..level.position.len() {
            let corner = 2 * level.place(index);
            let four = FOUR.map(|side| finer.at(corner + side).map_or(Vec3::ZERO, |k| finer.position[k]));
            let nearest = four.into_iter().filter(|p| p.z > 0.0).min_by(|a, b| a.z.total_cmp(&b.z));
            level.position[index] = nearest.unwrap_or_default();
        }
        levels.push(level);
    }
    levels
}

/// Right, down, and both.
const FOUR: [IVec2; 4] = [IVec2::new(0, 0), IVec2::new(1, 0), IVec2::new(0, 1), IVec2::new(1, 1)];
/// The eight sectors (Figure 3).
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

/// Visibility by the pyramidal neighbourhood that adapts to depth (3.1.2): weight 1 for a visible point, 0 for a hole,
/// -1 for the background.
pub fn hidden_points(levels: &[Level], view: &View) -> Level {
    let mut result = levels[0].clone();
    for index in 0..result.position.len() {
        let pixel = result.place(index);
        let point = levels[0].position[index];
        let empty = point.z == 0.0;
        let point = if empty { view.ray(view.centre(index)) * (1e6 * view.spacing) } else { point };
        let coarse = levels.iter().enumerate().skip(4).find_map(|(k, level)| {
            level.at(pixel >> k as i32).map(|at| level.position[at].z).filter(|depth| *depth > 0.0)
        });
        let visible = coarse.is_none_or(|depth| {
            // Eq. 1 with s_hpr = 10 s_0; the ring of level l reaches to 2^(l + 1) pixels.
            let last = ((10.0 * view.spacing * view.focal() / depth).log2().floor() - 1.0).max(0.0) as usize;
            let mut least = [Some(2.0_f32); 8];
            for (k, level) in levels.iter().enumerate().take(last + 1) {
                for (sector, side) in RING.into_iter().enumerate() {
                    let at = level.at((pixel >> k as i32) + side);
                    match at.map(|at| level.position[at]).filter(|neighbour| neighbour.z > 0.0) {
                        Some(neighbour) => {
                            let value = occlusion(point, neighbour);
                            least[sector] = Some(least[sector].map_or(value, |known| known.min(value)));
                        }
                        // A sector that the image's border cuts off does not count.
                        None if at.is_none() && least[sector] == Some(2.0) => least[sector] = None,
                        None => {}
                    }
                }
            }
            let known: Vec<f32> = least.into_iter().flatten().collect();
            known.iter().sum::<f32>() >= 0.1 * known.len() as f32
        });
        result.position[index] = if empty || !visible { Vec3::ZERO } else { point };
        result.weight[index] = match (empty, visible) {
            (false, true) => 1.0,
            (true, true) => -1.0,
            _ => 0.0,
        };
    }
    result
}

/// 0 for a neighbour right in front of the point, 1 beside it, 2 behind it.
fn occlusion(point: Vec3, neighbour: Vec3) -> f32 {
    let to = neighbour - point;
    let lengths = (to.length_squared() * neighbour.length_squared()).sqrt();
    if lengths > 0.0 { 1.0 + to.dot(neighbour) / lengths } else { 2.0 }
}

/// Depths within this share of the nearest belong to one surface.
const SAME_SURFACE: f32 = 0.05;

/// Mean of the front surface among weighted samples, and the sum of their weights, at most 1.
fn combine(samples: [(Vec3, f32); 4], shares: [f32; 4]) -> (Vec3, f32) {
    let front = samples.iter().filter(|s| s.1 > 0.0).map(|s| s.0.z).fold(1e30, f32::min);
    let (mut position, mut weight) = (Vec3::ZERO, 0.0);
    for ((p, w), share) in samples.into_iter().zip(shares) {
        if w > 0.0 && p.z <= front * (1.0 + SAME_SURFACE) {
            position += p * (w * share);
            weight += w * share;
        }
    }
    if weight > 0.0 { (position / weight, weight.min(1.0)) } else { (Vec3::ZERO, 0.0) }
}

/// All levels of the filled surface (3.2).
pub fn pull_push(visible: Level) -> Vec<Level> {
    let mut levels = vec![visible];
    while let Some(finer) = levels.last().filter(|level| level.width > 1 || level.height > 1) {
        let mut level = Level::new(finer.width.div_ceil(2), finer.height.div_ceil(2));
        for index in 0..level.position.len() {
            let corner = 2 * level.place(index);
            let sample =
                |side| finer.at(corner + side).map_or((Vec3::ZERO, 0.0), |k| (finer.position[k], finer.weight[k]));
            (level.position[index], level.weight[index]) = combine(FOUR.map(sample), [1.0; 4]);
        }
        levels.push(level);
    }
    for k in (0..levels.len() - 1).rev() {
        let (fine, coarse) = levels.split_at_mut(k + 1);
        let (fine, coarse) = (&mut fine[k], &coarse[0]);
        for index in 0..fine.position.len() {
            let weight = fine.weight[index];
            if !(0.0..1.0).contains(&weight) {
                continue;
            }
            let pixel = fine.place(index);
            let side = 2 * (pixel & IVec2::ONE) - IVec2::ONE;
            let sample = |step: IVec2| {
                let at = coarse.clamped((pixel >> 1) + side * step);
                (coarse.position[at], coarse.weight[at])
            };
            let (mean, found) = combine(FOUR.map(sample), [9.0, 3.0, 3.0, 1.0].map(|share| share / 16.0));
            if found <= 0.0 {
                continue;
            }
            let own = fine.position[index];
            let same = (own.z - mean.z).abs() <= SAME_SURFACE * own.z.min(mean.z);
            fine.position[index] = match () {
                () if weight == 0.0 => mean,
                () if same => mean.lerp(own, weight),
                () => own,
            };
            fine.weight[index] = 1.0;
        }
    }
    levels
}
