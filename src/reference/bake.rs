//! Light maps of a room: the path tracer's answer stored at texels, so that it can be asked for millions of times.
//!
//! Irradiance is kept in two maps a surface. Direct light has shadow edges and gets fine texels; light that has
//! bounced is smooth and gets coarse ones with many samples each. Every bounce is one pass that gathers the room as
//! the pass before left it (final gathering after Ward et al. 1988 and Reichert 1992), so that a path's later bounces
//! are looked up and not traced again.

use std::f32::consts::PI;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::path_tracer::{PathTracer, lifted};
use super::rooms::{Rectangle, Room};
use super::sampling::{R2, cosine_direction};
use crate::scene::Cloud;
use crate::{Error, Result};

/// Coarse texels are this many times the size of fine ones.
const COARSE: f32 = 4.0;
/// All passes but the last may be noisier: the next one averages over them.
const ROUGH: u32 = 8;
/// More fine texels than this would need more than 1.5 GiB.
const MAX_TEXELS: f64 = 128e6;

/// A scan of more points than this would need more than 5 GiB.
const MAX_POINTS: usize = 1 << 27;

/// Receives how much of a job is done, 0 to 1; called from worker threads.
pub type Progress<'a> = &'a (dyn Fn(f32) + Sync);

/// How finely to bake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BakeOptions {
    /// Size of a texel of direct light, metres; texels of bounced light are four times as large. The spacing of the
    /// cloud that the room will be scanned into is fine enough.
    pub texel: f32,
    /// Shadow rays a texel of direct light.
    pub direct_samples: u32,
    /// Directions a texel of bounced light in the last pass; earlier passes take an eighth.
    pub bounced_samples: u32,
    /// Times that light is reflected.
    pub bounces: u32,
    /// Changes the noise and nothing else.
    pub seed: u64,
}

impl Default for BakeOptions {
    fn default() -> Self {
        Self { texel: 0.025, direct_samples: 64, bounced_samples: 1024, bounces: 12, seed: 1 }
    }
}

/// Irradiance over one rectangle, row by row along its `edge_v`.
#[derive(Clone, Debug, Default)]
struct LightMap {
    width: usize,
    height: usize,
    texels: Vec<Vec3>,
}

/// One texel of the map of `surface`.
#[derive(Clone, Copy)]
struct Texel {
    surface: usize,
    low: Vec2,
    size: Vec2,
}

impl Texel {
    /// (u, v) on the surface of a place in the texel, each 0 to 1.
    fn at(&self, place: Vec2) -> Vec2 {
        self.low + self.size * place
    }
}

/// A room with its light.
pub struct BakedRoom {
    pub(super) tracer: PathTracer,
    direct: Vec<LightMap>,
    bounced: Vec<LightMap>,
}

/// Bakes `room`; see [`BakeOptions`]. The result is the same on any number of threads.
///
/// [`Error::Argument`] for a room or options that make no sense, [`Error::Limit`] for too many texels.
pub fn bake(room: Room, options: &BakeOptions, progress: Progress) -> Result<BakedRoom> {
    if !(options.texel.is_finite() && options.texel > 0.0) {
        return Err(Error::Argument(format!("bake: texel size {} m, must be above 0", options.texel)));
    }
    let tracer = PathTracer::new(room)?;
    let texels =
        tracer.room().surfaces.iter().map(|s| f64::from(s.area())).sum::<f64>() / f64::from(options.texel).powi(2);
    if texels > MAX_TEXELS {
        return Err(Error::Limit(format!("bake: {texels:.0} texels, limit {MAX_TEXELS:.0}: take larger texels")));
    }

    let fine = empty_maps(tracer.room(), options.texel);
    let coarse = empty_maps(tracer.room(), options.texel * COARSE);
    // work in rays: the bar should move evenly
    let rough_samples = options.bounced_samples.div_ceil(ROUGH);
    let coarse_count: usize = coarse.iter().map(|map| map.texels.len()).sum();
    let fine_count: usize = fine.iter().map(|map| map.texels.len()).sum();
    let rough_passes = options.bounces.saturating_sub(1) as usize;
    let direct_work = fine_count as f32 * options.direct_samples as f32;
    let rough_work = coarse_count as f32 * rough_samples as f32;
    let last_work = coarse_count as f32 * options.bounced_samples as f32;
    let total = direct_work + rough_work * rough_passes as f32 + last_work;
    let part = |done: f32, work: f32| move |fraction: f32| progress(((done + fraction * work) / total).min(1.0));

    let mut baked = BakedRoom { tracer, direct: fine.clone(), bounced: coarse.clone() };
    baked.direct = fill(&baked.tracer, fine, &part(0.0, direct_work), |index, position, normal| {
        let sequence = R2::new(index, options.seed);
        let emitters = baked.tracer.emitters.seen_from(position, normal);
        let unobstructed = |direction, distance| baked.tracer.visible(position, direction, distance);
        emitters.irradiance(options.direct_samples, |n| sequence.square(n), unobstructed)
    });
    for pass in 0..options.bounces as usize {
        let last = pass == rough_passes;
        let samples = if last { options.bounced_samples } else { rough_samples };
        let done = direct_work + rough_work * pass as f32;
        let report = part(done, if last { last_work } else { rough_work });
        baked.bounced = fill(&baked.tracer, coarse.clone(), &report, |index, position, normal| {
            let sequence = R2::new(index, options.seed.wrapping_add(1 + pass as u64));
            let reflected = |n| baked.reflected(position, cosine_direction(normal, sequence.square(n)));
            // the cosine and pi cancel against the density
            (0..samples).map(reflected).sum::<Vec3>() * (PI / samples.max(1) as f32)
        });
    }
    progress(1.0);
    Ok(baked)
}

fn empty_maps(room: &Room, texel: f32) -> Vec<LightMap> {
    let count = |edge: Vec3| (edge.length() / texel).ceil().max(1.0) as usize;
    let map = |(width, height)| LightMap { width, height, texels: vec![Vec3::ZERO; width * height] };
    room.surfaces.iter().map(|surface| map((count(surface.edge_u), count(surface.edge_v)))).collect()
}

/// Fills maps with `irradiance(texel index, position, normal)`; hidden texels take after their neighbours, so that
/// what lies under a box does not darken its surroundings.
fn fill(
    tracer: &PathTracer,
    mut maps: Vec<LightMap>,
    progress: Progress,
    irradiance: impl Fn(u64, Vec3, Vec3) -> Vec3 + Sync,
) -> Vec<LightMap> {
    let texels: Vec<Texel> = maps.iter().enumerate().flat_map(|(surface, map)| map.places(surface)).collect();
    let at = |(index, texel): (usize, &Texel)| {
        let surface = &tracer.room().surfaces[texel.surface];
        let normal = surface.normal();
        // where the middle is hidden a corner may still look out of the wall
        let elsewhere = (0..8).map(|n| texel.at(R2::new(0, 0).square(n)));
        let mut places = std::iter::once(texel.at(Vec2::splat(0.5))).chain(elsewhere).map(|p| surface.at(p.x, p.y));
        let seen = places.find(|&position| !tracer.hidden(position, normal));
        seen.map(|position| irradiance(index as u64, lifted(position, normal), normal))
    };
    let mut values = parallel(&texels, progress, at).into_iter();
    for map in &mut maps {
        map.texels = spread(values.by_ref().take(map.width * map.height).collect(), map.width);
    }
    maps
}

/// `compute` of every item and its index, in order, on all threads.
pub(super) fn parallel<T: Sync, R: Send>(
    items: &[T],
    progress: Progress,
    compute: impl Fn((usize, &T)) -> R + Sync,
) -> Vec<R> {
    const CHUNK: usize = 256;
    let (done, total) = (AtomicUsize::new(0), items.len());
    let chunks = items.par_chunks(CHUNK).enumerate().map(|(chunk, items)| {
        let first = chunk * CHUNK;
        let results: Vec<R> = items.iter().enumerate().map(|(n, item)| compute((first + n, item))).collect();
        let done = done.fetch_add(results.len(), Ordering::Relaxed) + results.len();
        progress(done as f32 / total as f32);
        results
    });
    chunks.collect::<Vec<_>>().into_iter().flatten().collect()
}

/// Gives every unknown texel the mean of its known neighbours, ring by ring; black where nothing is known.
fn spread(mut texels: Vec<Option<Vec3>>, width: usize) -> Vec<Vec3> {
    let height = texels.len() / width.max(1);
    let mut unknown: Vec<usize> = (0..texels.len()).filter(|&n| texels[n].is_none()).collect();
    while !unknown.is_empty() && unknown.len() < texels.len() {
        let mean = |n: usize| {
            let (x, y) = (n % width, n / width);
            let around = (y.saturating_sub(1)..(y + 2).min(height))
                .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x));
            let (sum, count) = around
                .filter_map(|neighbour| texels[neighbour])
                .fold((Vec3::ZERO, 0.0_f32), |(sum, count), value| (sum + value, count + 1.0));
            (count > 0.0).then(|| (n, sum / count))
        };
        let found: Vec<_> = unknown.iter().filter_map(|&n| mean(n)).collect();
        for &(n, value) in &found {
            texels[n] = Some(value);
        }
        unknown.retain(|&n| texels[n].is_none());
    }
    texels.into_iter().map(Option::unwrap_or_default).collect()
}

impl LightMap {
    /// All texels, in order.
    fn places(&self, surface: usize) -> impl Iterator<Item = Texel> + use<> {
        let width = self.width;
        let size = Vec2::new(width as f32, self.height as f32).recip();
        let low = move |n: usize| Vec2::new((n % width) as f32, (n / width) as f32) * size;
        (0..width * self.height).map(move |n| Texel { surface, low: low(n), size })
    }

    /// Bilinear, clamped at the edges.
    fn sample(&self, u: f32, v: f32) -> Vec3 {
        let last = Vec2::new(self.width as f32 - 1.0, self.height as f32 - 1.0);
        let place = (Vec2::new(u * self.width as f32, v * self.height as f32) - 0.5).max(Vec2::ZERO).min(last);
        let (x0, y0) = (place.x as usize, place.y as usize);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let texel = |x: usize, y: usize| self.texels[y * self.width + x];
        let part = place.fract();
        texel(x0, y0).lerp(texel(x1, y0), part.x).lerp(texel(x0, y1).lerp(texel(x1, y1), part.x), part.y)
    }
}

/// Scanned points of all surfaces (position, normal, colour) as a cloud of `density` points a square metre.
pub(super) fn cloud_of(scanned: Vec<Vec<(Vec3, Vec3, Vec3)>>, density: f32) -> Cloud {
    let points = scanned.concat();
    Cloud {
        positions: points.iter().map(|p| p.0).collect(),
        normals: points.iter().map(|p| p.1).collect(),
        colors: points.iter().map(|p| p.2).collect(),
        spacing: vec![density.sqrt().recip(); points.len()],
        ..Cloud::default()
    }
}

impl BakedRoom {
    /// The room as it was given.
    pub fn room(&self) -> &Room {
        self.tracer.room()
    }

    /// The path tracer of the same room.
    pub fn tracer(&self) -> &PathTracer {
        &self.tracer
    }

    /// Radiance that leaves surface number `surface` at (u, v), without what it emits.
    pub(super) fn reflected_at(&self, surface: usize, u: f32, v: f32) -> Vec3 {
        let irradiance = self.direct[surface].sample(u, v) + self.bounced[surface].sample(u, v);
        self.room().surfaces[surface].albedo_at(u, v) * irradiance / PI
    }

    /// Radiance that leaves surface number `surface` at (u, v) in 0..1, in every direction of its front; black where
    /// there is no such surface.
    pub fn radiance_at(&self, surface: usize, u: f32, v: f32) -> Vec3 {
        let Some(rectangle) = self.room().surfaces.get(surface) else { return Vec3::ZERO };
        rectangle.emission + self.reflected_at(surface, u, v)
    }

    /// What the ray sees, without emission.
    fn reflected(&self, origin: Vec3, direction: Vec3) -> Vec3 {
        let hit = self.tracer.hit(origin, direction).filter(|hit| hit.front);
        hit.map_or(Vec3::ZERO, |hit| self.reflected_at(hit.surface, hit.u, hit.v))
    }

    /// Radiance that arrives at `origin` from `direction`: that of the first surface; zero when the ray leaves the
    /// room or meets the back of a surface.
    pub fn trace(&self, origin: Vec3, direction: Vec3) -> Vec3 {
        let hit = self.tracer.hit(origin, direction).filter(|hit| hit.front);
        hit.map_or(Vec3::ZERO, |hit| self.radiance_at(hit.surface, hit.u, hit.v))
    }

    /// Scans the room: about `points` points (within a percent), spread evenly by area over the surfaces that can be
    /// seen, with normals, HDR radiance (emitters included) and spacing: the square root of the area per point. More
    /// than 2^27 points are not made.
    pub fn sample_cloud(&self, points: usize, seed: u64) -> Cloud {
        let area = self.visible_area(seed);
        if points == 0 || area <= 0.0 {
            return Cloud::default();
        }
        let density = points.min(MAX_POINTS) as f32 / area;
        let surfaces: Vec<usize> = (0..self.room().surfaces.len()).collect();
        let scanned: Vec<Vec<(Vec3, Vec3, Vec3)>> =
            surfaces.par_iter().map(|&surface| self.scan(surface, density, seed)).collect();
        cloud_of(scanned, density)
    }

    /// Area that is not inside of a box, square metres.
    fn visible_area(&self, seed: u64) -> f32 {
        const PLACES: f32 = 100_000.0;
        let density = PLACES / self.room().surfaces.iter().map(Rectangle::area).sum::<f32>();
        let surfaces: Vec<usize> = (0..self.room().surfaces.len()).collect();
        let areas: Vec<f32> = surfaces
            .par_iter()
            .map(|&surface| {
                let (candidates, seen) = self.places(surface, density, seed);
                self.room().surfaces[surface].area() * seen.len() as f32 / candidates.max(1) as f32
            })
            .collect();
        areas.iter().sum()
    }

    /// (position, normal, radiance) of the points on one surface.
    fn scan(&self, surface: usize, density: f32, seed: u64) -> Vec<(Vec3, Vec3, Vec3)> {
        let rectangle = &self.room().surfaces[surface];
        let point = |place: Vec2| {
            (rectangle.at(place.x, place.y), rectangle.normal(), self.radiance_at(surface, place.x, place.y))
        };
        self.places(surface, density, seed).1.into_iter().map(point).collect()
    }

    /// `density` places a square metre on one surface: how many in all, and those that can be seen, as (u, v).
    fn places(&self, surface: usize, density: f32, seed: u64) -> (usize, Vec<Vec2>) {
        let rectangle = &self.room().surfaces[surface];
        let edges = Vec2::new(rectangle.edge_u.length(), rectangle.edge_v.length());
        // the sequence is even in a square: a long rectangle takes its part of one, or it would be stretched
        let side = edges.max_element();
        let count = (density * side * side).round() as u32;
        let sequence = R2::new(surface as u64, seed);
        let inside = (0..count).map(|n| sequence.square(n) * side / edges).filter(|p| p.x < 1.0 && p.y < 1.0);
        let inside: Vec<Vec2> = inside.collect();
        let seen = |p: &Vec2| !self.tracer.hidden(rectangle.at(p.x, p.y), rectangle.normal());
        (inside.len(), inside.iter().copied().filter(seen).collect())
    }
}
