//! Precomputed radiance transfer of an object: what of the distant light around it arrives at each vertex, past the
//! object's own shadows, as spherical harmonics (Hajisharif et al., "Real-time Image Based Lighting with Streaming
//! HDR-light Probe Sequences", 2012, 3.3; Sloan et al., "Precomputed Radiance Transfer", 2002).
//!
//! The irradiance at a vertex is the product of its transfer with the coefficients of the light, both in the object's
//! own space, and the radiance of its diffuse part is that times albedo / pi (Eqs. 4 and 14).

mod albedo;
mod bvh;
mod directions;
mod packet;

use std::f32::consts::PI;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::scene::harmonics::{COSINE_LOBE, MOST_COEFFICIENTS, MOST_ORDER, band, basis};
use crate::scene::{Object, Vertex};
use crate::{Error, Result};
use albedo::Albedo;
use bvh::Bvh;
use directions::Directions;
use packet::{BLOCKED, LANES, NO_RAY};

/// How far above its vertex a ray begins, in diagonals of the object's bounds. Rounding moves a surface by some 1e-7 of
/// them, which must not shadow it; what lies closer than 1e-5 of them touches, as far as light is concerned.
const OFFSET: f32 = 1e-5;

/// Vertices that one task does: few enough to share the work evenly, and neighbours, which meet the same triangles.
const TASK: usize = 32;

/// What to compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransferOptions {
    /// Bands of the spherical harmonics, in [`TransferOptions::ORDER`].
    pub order: usize,
    /// Directions a vertex over the whole sphere, in [`TransferOptions::SAMPLES`]; rounded up to a full grid of strata.
    pub samples: u32,
    /// How often light is reflected by the object on its way to a vertex, in [`TransferOptions::BOUNCES`].
    pub bounces: u32,
    /// Whether the object shadows itself. Without, there are no bounces either.
    pub visibility: bool,
}

impl TransferOptions {
    /// Possible orders.
    pub const ORDER: std::ops::RangeInclusive<usize> = 1..=MOST_ORDER;
    /// Possible numbers of directions.
    pub const SAMPLES: std::ops::RangeInclusive<u32> = 1..=1_000_000;
    /// Possible numbers of bounces.
    pub const BOUNCES: std::ops::RangeInclusive<u32> = 0..=64;

    /// Whether all values are in range.
    ///
    /// # Errors
    /// [`Error::Argument`] that names the first value which is not.
    pub fn check(&self) -> Result<()> {
        let wrong = |what, value: &dyn std::fmt::Display, range: &dyn std::fmt::Debug| {
            Err(Error::Argument(format!("{what}: {value} is not in {range:?}")))
        };
        if !Self::ORDER.contains(&self.order) {
            return wrong("order of the transfer", &self.order, &Self::ORDER);
        }
        if !Self::SAMPLES.contains(&self.samples) {
            return wrong("directions of the transfer", &self.samples, &Self::SAMPLES);
        }
        if !Self::BOUNCES.contains(&self.bounces) {
            return wrong("bounces of the transfer", &self.bounces, &Self::BOUNCES);
        }
        if self.bounces > 0 && !self.visibility {
            return Err(Error::Argument(
                "bounces of the transfer need visibility: light is reflected by occluders".into(),
            ));
        }
        Ok(())
    }

    /// [`Transfer::samples`] of what these options give.
    pub fn samples_used(&self) -> u32 {
        if self.visibility { directions::count(self.samples) } else { 0 }
    }
}

impl Default for TransferOptions {
    /// The paper's (4.2): order 4, 2,500 directions, no bounces.
    fn default() -> Self {
        Self { order: 4, samples: 2500, bounces: 0, visibility: true }
    }
}

/// The transfer of all vertices of an object, without albedo and without 1 / pi.
#[derive(Clone, Debug, PartialEq)]
pub struct Transfer {
    /// Bands of the spherical harmonics.
    pub order: usize,
    /// Directions that were sampled a vertex; 0 without visibility.
    pub samples: u32,
    /// Bounces that are part of it.
    pub bounces: u32,
    /// Whether the object shadows itself.
    pub visibility: bool,
    /// 1, or 3 (red, green, blue) where light has been reflected by coloured surfaces.
    pub channels: usize,
    /// Number of vertices.
    pub vertices: usize,
    /// `order * order` coefficients of each channel, `channels` of each vertex: that of basis function k
    /// ([`mod@crate::scene::harmonics`]) for channel c of vertex v is at `(v * channels + c) * order * order + k`.
    pub coefficients: Vec<f32>,
}

impl Transfer {
    /// The coefficients of a channel of a vertex.
    pub fn of(&self, vertex: usize, channel: usize) -> &[f32] {
        let functions = self.order * self.order;
        &self.coefficients[(vertex * self.channels + channel) * functions..][..functions]
    }
}

/// Computes the transfer of `object` for light from infinity. `progress` is called with the share that is done, 0 to
/// 1, from many threads, so that a smaller share may come after a larger one. The result depends on nothing but object
/// and options. Vertices with a normal of zero or a coordinate that is not finite get nothing.
///
/// Fragments that an alpha mask leaves out block light all the same.
///
/// # Errors
/// [`Error::Argument`] where an option is out of range, [`Error::Limit`] for objects of more than 2^30 triangles.
pub fn compute(object: &Object, options: &TransferOptions, progress: &(dyn Fn(f32) + Sync)) -> Result<Transfer> {
    options.check()?;
    let triangles = object.indices.len() / 3;
    if triangles > 1 << 30 {
        return Err(Error::Limit(format!("the object has {triangles} triangles, a transfer takes at most 2^30")));
    }
    let mut transfer = Transfer {
        order: options.order,
        samples: options.samples_used(),
        bounces: options.bounces,
        visibility: options.visibility,
        channels: if options.bounces == 0 { 1 } else { 3 },
        vertices: object.vertices.len(),
        coefficients: Vec::new(),
    };
    let functions = options.order * options.order;
    if !options.visibility {
        transfer.coefficients = vec![0.0; transfer.vertices * functions];
        let vertices = object.vertices.par_iter();
        transfer.coefficients.par_chunks_mut(functions).zip(vertices).for_each(|(out, vertex)| {
            if let Some(normal) = usable_normal(vertex) {
                unshadowed(normal, out);
            }
        });
        progress(1.0);
        return Ok(transfer);
    }
    let scene = Scene::new(object, options);
    let done = AtomicUsize::new(0);
    let tasks = transfer.vertices.div_ceil(TASK) * (1 + options.bounces as usize);
    let step = || progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f32 / tasks as f32);
    let mut direct = vec![0.0; transfer.vertices * functions];
    scene.for_each_vertex(&mut direct, &step, |vertex, out| scene.direct(vertex, out));
    if options.bounces == 0 {
        transfer.coefficients = direct;
        return Ok(transfer);
    }
    // Bounce by bounce: each gathers what the one before it left on the surfaces.
    let albedo = Albedo::new(object);
    let mut last: Vec<f32> = direct.chunks_exact(functions).flat_map(|grey| [grey; 3]).flatten().copied().collect();
    drop(direct);
    transfer.coefficients = last.clone();
    for _ in 0..options.bounces {
        let mut next = vec![0.0; last.len()];
        scene.for_each_vertex(&mut next, &step, |vertex, out| scene.reflected(vertex, &albedo, &last, out));
        transfer.coefficients.par_iter_mut().zip(&next).for_each(|(sum, part)| *sum += part);
        last = next;
    }
    Ok(transfer)
}

/// The unit normal of a vertex, where it has one.
fn usable_normal(vertex: &Vertex) -> Option<Vec3> {
    let normal = vertex.normal.as_dvec3().normalize_or_zero();
    // Infinite normals become NaN.
    (normal.length_squared() > 0.5 && vertex.position.is_finite()).then(|| normal.as_vec3())
}

/// The transfer of a surface that nothing shadows: the cosine lobe about its normal.
fn unshadowed(normal: Vec3, out: &mut [f32]) {
    let values = basis(normal.as_dvec3());
    for (k, out) in out.iter_mut().enumerate() {
        *out = (COSINE_LOBE[band(k)] * values[k]) as f32;
    }
}

/// [`Scene::inwards`], for vertices at `places`.
fn inwards(object: &Object, places: &[Vec3]) -> Vec<Vec3> {
    let mut sums = vec![(Vec3::ZERO, 0.0_f32); places.len()];
    for triangle in object.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|corner| triangle[corner] as usize);
        let middle = (places[a] + places[b] + places[c]) / 3.0;
        for corner in [a, b, c] {
            sums[corner].0 += (middle - places[corner]).normalize_or_zero();
            sums[corner].1 += 1.0;
        }
    }
    sums.into_iter().map(|(sum, count)| sum / count.max(1.0)).collect()
}

/// An object ready to be traced: moved and scaled so that the diagonal of its bounds is 1 and its middle 0, since f32
/// has few digits left a million metres from the origin.
struct Scene<'a> {
    object: &'a Object,
    bvh: Bvh,
    directions: Directions,
    middle: DVec3,
    scale: f64,
    /// A vertex's mean direction to the middles of its triangles. Rays begin a little to that side: in a crease between
    /// two walls a vertex of the one lies in the plane of the other, where rays can't tell its sides apart.
    inwards: Vec<Vec3>,
}

impl<'a> Scene<'a> {
    fn new(object: &'a Object, options: &TransferOptions) -> Self {
        let finite = object.vertices.iter().map(|vertex| vertex.position.as_dvec3()).filter(|p| p.is_finite());
        let (low, high) =
            finite.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        let diagonal = (high - low).length();
        let scale = if diagonal.is_finite() && diagonal > 0.0 { diagonal.recip() } else { 1.0 };
        let directions = Directions::new(options.samples, options.order);
        let mut scene =
            Self { object, bvh: Bvh::new(&[]), directions, middle: 0.5 * (low + high), scale, inwards: Vec::new() };
        let corners: Vec<Vec3> = object.vertices.par_iter().map(|vertex| scene.place(vertex)).collect();
        let triangle = |indices: &[u32]| [0, 1, 2].map(|corner: usize| corners[indices[corner] as usize]);
        let triangles: Vec<[Vec3; 3]> = object.indices.par_chunks_exact(3).map(triangle).collect();
        scene.bvh = Bvh::new(&triangles);
        scene.inwards = inwards(object, &corners);
        scene
    }

    /// Where a vertex is among the triangles.
    fn place(&self, vertex: &Vertex) -> Vec3 {
        ((vertex.position.as_dvec3() - self.middle) * self.scale).as_vec3()
    }

    /// Calls `each` with every vertex and its part of `values`, in parallel; `step` after each
    /// task.
    fn for_each_vertex(&self, values: &mut [f32], step: &(dyn Fn() + Sync), each: impl Fn(usize, &mut [f32]) + Sync) {
        let Some(size) = values.len().checked_div(self.object.vertices.len()) else { return };
        values.par_chunks_mut(size * TASK).enumerate().for_each(|(task, values)| {
            for (n, values) in values.chunks_exact_mut(size).enumerate() {
                each(task * TASK + n, values);
            }
            step();
        });
    }

    /// Where the rays of a vertex begin, and its normal.
    fn start(&self, vertex: usize) -> Option<(Vec3, Vec3)> {
        let normal = usable_normal(&self.object.vertices[vertex])?;
        let along = self.inwards[vertex].reject_from_normalized(normal);
        Some((self.place(&self.object.vertices[vertex]) + OFFSET * (normal + along), normal))
    }

    /// The transfer of light that arrives directly.
    ///
    /// A deviation from Hajisharif 2012, Eq. 8, which sums over the directions that are free. What the same directions
    /// make of the surface without occluders is off by a known amount, since that transfer is known exactly. As much of
    /// it is taken off as the free directions have part in it: a control variate, with the factor that makes the
    /// variance least (Glasserman 2003, 4.1). Vertices that see everything, or nothing, are exact for any number of
    /// directions. Directions weigh pi over the sum of their cosines, not 4 pi / N: then no light is lost or made
    /// between what arrives directly and by reflections, however few directions there are.
    fn direct(&self, vertex: usize, out: &mut [f32]) {
        let Some((origin, normal)) = self.start(vertex) else { return };
        // Sums over all directions above the horizon and over the blocked ones: coefficients, and squares of cosines.
        let mut sums = [([0.0; MOST_COEFFICIENTS], 0.0); 2];
        for (number, packet) in self.directions.packets.iter().enumerate() {
            let Some((cosine, mut ends)) = packet.above(normal) else { continue };
            self.bvh.occlude(packet, origin, &mut ends);
            for lane in 0..LANES {
                let (weight, end) = (cosine[lane / 4][lane % 4], ends[lane / 4][lane % 4]);
                let counted = [end != NO_RAY, end == BLOCKED];
                for ((values, squares), _) in sums.iter_mut().zip(counted).filter(|(_, counted)| *counted) {
                    let basis = self.directions.basis(number, lane);
                    values.iter_mut().zip(basis).for_each(|(value, basis)| *value += weight * basis);
                    *squares += weight * weight;
                }
            }
        }
        let [(all, all_squares), (blocked, blocked_squares)] = sums;
        let free = if all_squares > 0.0 { 1.0 - blocked_squares / all_squares } else { 1.0 };
        let weight = PI * self.directions.share(normal);
        unshadowed(normal, out);
        for (out, (all, blocked)) in out.iter_mut().zip(all.into_iter().zip(blocked)) {
            *out = free * *out + weight * ((1.0 - free) * all - blocked);
        }
    }

    /// The transfer of light that arrives by one more reflection than in `last`, three channels a vertex.
    fn reflected(&self, vertex: usize, albedo: &Albedo, last: &[f32], out: &mut [f32]) {
        let Some((origin, normal)) = self.start(vertex) else { return };
        let functions = out.len() / 3;
        let weight = self.directions.share(normal);
        for packet in &self.directions.packets {
            let Some((cosine, ends)) = packet.above(normal) else { continue };
            let hits = self.bvh.closest(packet, origin, ends);
            for lane in 0..LANES {
                let distance = hits.distance[lane / 4][lane % 4];
                if !(distance > 0.0 && distance < f32::INFINITY) {
                    continue;
                }
                let (triangle, weights) = (hits.number[lane], hits.weights[lane]);
                let corners = &self.object.indices[3 * triangle as usize..][..3];
                let front: Vec3 = (0..3).map(|n| self.object.vertices[corners[n] as usize].normal * weights[n]).sum();
                // Transfer is that of the side which the normals look to: the back is black.
                if front.dot(packet.direction(lane)) >= 0.0 {
                    continue;
                }
                let color = albedo.at(triangle, weights) * (weight * cosine[lane / 4][lane % 4]);
                for (&corner, share) in corners.iter().zip(weights) {
                    let light = &last[corner as usize * 3 * functions..][..3 * functions];
                    let planes = out.chunks_exact_mut(functions).zip(light.chunks_exact(functions));
                    for ((out, light), color) in planes.zip(color.to_array()) {
                        out.iter_mut().zip(light).for_each(|(out, light)| *out += share * color * light);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
