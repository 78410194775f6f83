//! Virtual point lights: the first from the lamps' views, the others from those before them (Preiner 2010, 4.2 and 4.5).

use std::sync::Arc;

use ash::vk;

use super::ism::IsmPass;
use super::lamp_view::{LampPass, LampViewPass};
use super::operator::Operator;
use crate::Result;
use crate::gpu::pipeline::DescriptorSet;
use crate::gpu::{Bindings, Buffer, Constant, Context, Recorder};
use crate::preprocess::point_chunks::CHUNK;

/// Points on the device with their normals, and how many the buffers before hold.
pub struct LitPoints<'a> {
    /// Positions and colours.
    pub points: &'a Buffer,
    /// Normals and spacings.
    pub surfels: &'a Buffer,
    /// Number of the first in the cloud.
    pub base: u32,
    /// Number of points.
    pub count: u32,
}

impl<'a> LitPoints<'a> {
    /// The buffers under the names that shaders use.
    pub(super) fn bindings(&self) -> Bindings<'a> {
        Bindings::new().buffer("points", self.points).buffer("surfels", self.surfels)
    }

    /// First and number of the points of each dispatch over all of them.
    pub(super) fn runs(&self) -> impl Iterator<Item = (u32, u32)> + use<> {
        const MOST: u32 = 1 << 22;
        let count = self.count;
        (0..count).step_by(MOST as usize).map(move |first| (first, MOST.min(count - first)))
    }

    /// The same over a share of the points that lies evenly among them: the first of each chunk.
    pub(super) fn thin_runs(&self, share: f32) -> Vec<(u32, u32)> {
        let (count, chunk) = (self.count, CHUNK as u32);
        if share >= 1.0 {
            return self.runs().collect();
        }
        let part = |first: u32| (first, ((count - first).min(chunk) as f32 * share).ceil() as u32);
        (0..count).step_by(CHUNK).map(part).collect()
    }

    /// `pass` over all of them.
    pub(super) fn dispatches(&self, pass: LampPass) -> Vec<(LampPass, u32)> {
        let of = |(first, count)| (LampPass { first, count, base: self.base, ..pass }, count);
        self.runs().map(of).collect()
    }
}

/// Eight texels of 16 bytes.
const BYTES: u64 = 128;

/// The lights.
pub struct VplBuffers {
    /// Those of this bounce and of the next, in turns.
    pub lights: [Buffer; 2],
}

impl VplBuffers {
    /// Room for `count` lights.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, count: u32) -> Result<Self> {
        let buffer =
            |name| Buffer::with_texels(context, name, u64::from(count) * BYTES, vk::Format::R32G32B32A32_SFLOAT);
        Ok(Self { lights: [buffer("lights")?, buffer("next lights")?] })
    }
}

/// Where lights lie.
pub struct VplPass {
    keys: Buffer,
    weights: Buffer,
    place: Operator,
    candidates: Operator,
    next: Operator,
    /// By buffer of points, then by which lights are the present ones.
    sets: Vec<[[DescriptorSet; 2]; 2]>,
}

impl VplPass {
    /// Makes the pipelines for `count` lights; `glossy` where surfaces have mirror lobes.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new<'a>(
        context: &Arc<Context>,
        (lights, count): (&VplBuffers, u32),
        (views, ism): (&LampViewPass, &IsmPass),
        points: &[LitPoints<'a>],
        glossy: bool,
    ) -> Result<Self> {
        let keys = Buffer::with_texels(context, "light keys", u64::from(count) * 8, vk::Format::R32G32_UINT)?;
        let weights = Buffer::with_texels(context, "light weights", u64::from(count) * 4, vk::Format::R32_UINT)?;
        let constants = [Constant::new(0, glossy)];
        let bindings = |buffer: &LitPoints<'a>, now: usize| {
            Bindings::new()
                .and(views.bindings())
                .buffer("vpl", &lights.lights[now])
                .buffer("vpl_out", &lights.lights[1 - now])
                .buffer("VplKeys", &keys)
                .buffer("vpl_taken", &keys)
                .buffer("VplWeights", &weights)
                .buffer("vpl_sums", &weights)
                .buffer("ism", &ism.depths)
                .and(buffer.bindings())
        };
        let first = bindings(&points[0], 1);
        let place = Operator::new(context, "vpl/place.comp", &[], &first)?;
        let candidates = Operator::new(context, "vpl/candidates.comp", &constants, &first)?;
        let next = Operator::new(context, "vpl/next.comp", &constants, &first)?;
        let mut sets = Vec::with_capacity(points.len());
        for buffer in points {
            let of = |now| -> Result<[DescriptorSet; 2]> {
                let bindings = bindings(buffer, now);
                Ok([candidates.set(&bindings)?, next.set(&bindings)?])
            };
            sets.push([of(0)?, of(1)?]);
        }
        Ok(Self { keys, weights, place, candidates, next, sets })
    }

    /// The first lights, into the first buffer.
    ///
    /// # Errors
    /// When there are more lights than a dispatch has.
    pub fn place(&self, recorder: &mut Recorder, pass: LampPass) -> Result<()> {
        self.place.record(recorder, "place lights", &pass, pass.vpls)
    }

    /// The lights of the next bounce from those in buffer `now`, into the other one: `rounds` rounds of all points, each
    /// of them a candidate for one light a round.
    ///
    /// # Errors
    /// When there are more points than a dispatch has.
    pub fn redistribute(
        &self,
        recorder: &mut Recorder,
        points: &[LitPoints<'_>],
        (pass, rounds): (LampPass, u32),
        now: usize,
    ) -> Result<()> {
        super::fill(recorder, "clear candidates", &[(&self.keys, 0), (&self.weights, 0)]);
        for round in 0..rounds {
            for (buffer, sets) in points.iter().zip(&self.sets) {
                // Between the rounds of the maps: a candidate is not asked of a map that was made of it.
                let dispatches = buffer.dispatches(pass.in_round(2 * round + 1, 2 * rounds));
                self.candidates.record_with(recorder, "candidates", &sets[now][0], &dispatches)?;
            }
        }
        for (buffer, sets) in points.iter().zip(&self.sets) {
            let constants = LampPass { base: buffer.base, count: buffer.count, ..pass };
            self.next.record_with(recorder, "next lights", &sets[now][1], &[(constants, pass.vpls)])?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preprocess::point_chunks::{CHUNK, PointChunks};
    use glam::Vec3;

    /// As `rank_in_chunk` in `glsl/common/light_of.glsl`.
    fn rank_in_chunk(mut index: usize, mut count: usize) -> usize {
        if count == CHUNK {
            return (index as u32).reverse_bits() as usize >> 16;
        }
        let (mut rank, mut bit) = (0, 1);
        while count > 1 {
            let even = count.div_ceil(2);
            if index >= even {
                index -= even;
                rank |= bit;
                count -= even;
            } else {
                count = even;
            }
            bit <<= 1;
        }
        rank
    }

    /// As `light_of` in the same.
    fn light_of(number: usize, pass: LampPass) -> usize {
        let first = number / CHUNK * CHUNK;
        let rank = rank_in_chunk(number - first, CHUNK.min(pass.points as usize - first));
        (first + rank + pass.offset as usize) % pass.vpls as usize
    }

    #[test]
    fn every_light_gets_every_nth_point_along_the_curve() {
        for count in [1, 2, 100, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK + 12_345] {
            // A line: x is the place along the curve.
            let line: Vec<Vec3> = (0..count).map(|n| Vec3::X * n as f32).collect();
            let chunks = PointChunks::from_points(&line, &vec![Vec3::ONE; count], &[]).expect("few points");
            for vpls in [16, 256, 1040, 16_384] {
                let pass = LampPass { points: count as u32, vpls, ..LampPass::default() };
                let mut places = vec![Vec::new(); vpls as usize];
                for (number, [x, ..]) in chunks.points.iter().enumerate() {
                    places[light_of(number, pass)].push(f32::from_bits(*x) as usize);
                }
                for (light, places) in places.iter_mut().enumerate() {
                    places.sort_unstable();
                    let expected: Vec<usize> = (light..count).step_by(vpls as usize).collect();
                    assert_eq!(*places, expected, "light {light} of {vpls}, {count} points");
                }
            }
        }
    }

    #[test]
    fn a_point_serves_other_lights_in_other_rounds() {
        let pass = LampPass { points: 1000, vpls: 48, ..LampPass::default() };
        for rounds in [1, 2, 7, 16] {
            let mut lights: Vec<usize> = (0..rounds).map(|round| light_of(123, pass.in_round(round, rounds))).collect();
            lights.sort_unstable();
            // As far from each other as so many can be.
            let gaps = lights.windows(2).map(|pair| pair[1] - pair[0]);
            assert!(gaps.min().unwrap_or(48) >= 48 / rounds as usize, "{lights:?} in {rounds} rounds");
        }
    }
}
