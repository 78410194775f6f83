//! The directions in which visibility is sampled, in packets of neighbours.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};

use super::packet::{LANES, Lanes, Packet};
use crate::scene::harmonics::basis;

/// How many directions a request for `samples` gives: a full grid of strata.
pub(super) fn count(samples: u32) -> u32 {
    let (rows, columns) = grid(samples);
    rows * columns
}

/// Strata in height and azimuth. Cells of 2 / rows by 2 pi / columns are about square at the equator.
fn grid(samples: u32) -> (u32, u32) {
    let rows = (f64::from(samples) / PI).sqrt().round().max(1.0) as u32;
    (rows, samples.max(1).div_ceil(rows))
}

/// Unit vectors over the whole sphere, one in each of [`count`] strata of equal solid angle: Archimedes' theorem makes
/// heights and azimuths uniform. The place inside of the stratum follows the R2 sequence (Roberts, "The Unreasonable
/// Effectiveness of Quasirandom Sequences", 2018): without it all directions would lie on few circles, and walls along
/// an axis would cover all of a circle or nothing of it.
fn stratified(samples: u32) -> Vec<DVec3> {
    let (rows, columns) = grid(samples);
    let direction = |index: u32| {
        let along = |step: f64, from: f64| (from + step * f64::from(index)).fract();
        let (x, y) = (along(0.754_877_666_246_692_8, 0.5), along(0.569_840_290_998_053_3, 0.5));
        let height = 1.0 - 2.0 * (f64::from(index / columns) + x) / f64::from(rows);
        let (sine, cosine) = (TAU * (f64::from(index % columns) + y) / f64::from(columns)).sin_cos();
        let across = (1.0 - height * height).max(0.0).sqrt();
        DVec3::new(across * sine, height, across * cosine)
    };
    (0..rows * columns).map(direction).collect()
}

/// All directions, with the basis functions there.
pub(super) struct Directions {
    /// Neighbours, all in one octant.
    pub(super) packets: Vec<Packet>,
    /// [`LANES`] rows a packet of `order * order` basis functions each.
    basis: Vec<f32>,
    /// Length of a row.
    functions: usize,
}

impl Directions {
    pub(super) fn new(samples: u32, order: usize) -> Self {
        let functions = order * order;
        let mut octants: [Vec<DVec3>; 8] = Default::default();
        for direction in stratified(samples) {
            octants[octant(direction)].push(direction);
        }
        let mut all = Self { packets: Vec::new(), basis: Vec::new(), functions };
        for octant in &mut octants {
            gather_neighbours(octant);
            for lanes in octant.chunks(LANES) {
                let at = |lane: usize| lanes[lane.min(lanes.len() - 1)];
                all.packets.push(Packet::new(std::array::from_fn(|lane| at(lane).as_vec3()), lanes.len()));
                all.basis.extend(
                    (0..LANES).flat_map(|lane| basis(at(lane)).into_iter().take(functions).map(|value| value as f32)),
                );
            }
        }
        all
    }

    /// The basis functions at a lane's direction.
    pub(super) fn basis(&self, packet: usize, lane: usize) -> &[f32] {
        &self.basis[(packet * LANES + lane) * self.functions..][..self.functions]
    }

    /// One over the sum of the cosines with a unit normal; 0 where all directions are below its horizon.
    pub(super) fn share(&self, normal: Vec3) -> f32 {
        let lane = |(cosine, end): (f32, f32)| if end > 0.0 { cosine } else { 0.0 };
        let sums = self.packets.iter().filter_map(|packet| packet.above(normal)).map(|(cosines, ends)| {
            let lanes = |lanes: Lanes| lanes.into_iter().flat_map(|group| group.to_array());
            lanes(cosines).zip(lanes(ends)).map(lane).sum::<f32>()
        });
        let sum: f32 = sums.sum();
        if sum > 0.0 { sum.recip() } else { 0.0 }
    }
}

/// Which of the components are negative, as bits.
fn octant(direction: DVec3) -> usize {
    Vec3::is_negative_bitmask(direction.as_vec3()) as usize
}

/// Orders directions so that every [`LANES`] of them are neighbours: halves along the wider axis, again and again. A
/// curve through a regular grid would not do, since its cells are slivers at the poles.
fn gather_neighbours(directions: &mut [DVec3]) {
    if directions.len() <= LANES {
        return;
    }
    let low = directions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = directions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let axis = (high - low).max_position();
    // All but the last packet are full.
    let middle = (directions.len() / 2).next_multiple_of(LANES);
    directions.sort_unstable_by(|a, b| a[axis].total_cmp(&b[axis]));
    let (near, far) = directions.split_at_mut(middle);
    gather_neighbours(near);
    gather_neighbours(far);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_stratum_has_one_direction_and_each_direction_one_lane() {
        for samples in [1, 2, 3, 9, 100, 900, 2500] {
            let all = Directions::new(samples, 3);
            let count = count(samples);
            assert!(count >= samples && count <= samples + samples.isqrt() + 1, "{samples}: {count}");
            let (rows, columns) = grid(samples);
            let mut seen = vec![0; count as usize];
            for (number, packet) in all.packets.iter().enumerate() {
                let from_all_sides = [Vec3::X, Vec3::NEG_X].map(|normal| packet.above(normal));
                for lane in 0..LANES {
                    let direction = packet.direction(lane);
                    assert!(direction.is_normalized());
                    assert!((all.basis(number, lane)[2] - (0.75 / PI).sqrt() as f32 * direction.y).abs() < 1e-6);
                    let mut ends = from_all_sides.iter().flatten().map(|(_, ends)| ends[lane / 4][lane % 4]);
                    if ends.any(|end| end > 0.0) {
                        let row = (f64::from(0.5 - 0.5 * direction.y) * f64::from(rows)) as u32;
                        let turn = f64::from(direction.x.atan2(direction.z)).rem_euclid(TAU) / TAU;
                        seen[(row * columns + (turn * f64::from(columns)) as u32) as usize] += 1;
                    }
                }
            }
            assert!(seen.iter().all(|&count| count == 1), "{samples}: {seen:?}");
        }
    }

    #[test]
    fn packets_are_narrow() {
        let all = Directions::new(2500, 1);
        let width = |packet: &Packet| {
            let middle = (0..LANES).map(|lane| packet.direction(lane)).sum::<Vec3>().normalize();
            (0..LANES).map(|lane| packet.direction(lane).angle_between(middle)).fold(0.0, f32::max)
        };
        let mean = all.packets.iter().map(width).sum::<f32>() / all.packets.len() as f32;
        // 16 cells of a regular grid, four by four, reach 0.20 from their middle
        assert!(mean < 0.25, "{mean}");
    }
}
