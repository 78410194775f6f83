//! Random and low-discrepancy numbers, and directions made of them. Everything is a pure function of (what, which
//! sample, seed), so that results don't depend on the order in which threads come by.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

/// SplitMix64 (Steele et al. 2014): a counter run through a mixing function.
pub(crate) struct Random {
    state: u64,
}

impl Random {
    /// The stream of item `item` under `seed`.
    pub(crate) fn new(item: u64, seed: u64) -> Self {
        Self { state: mix(mix(seed).wrapping_add(item)) }
    }

    /// 64 random bits.
    fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.state)
    }

    /// Uniform in [0, 1).
    pub(super) fn uniform(&mut self) -> f32 {
        unit((self.bits() >> 32) as u32)
    }

    /// Uniform in the unit square.
    pub(crate) fn square(&mut self) -> Vec2 {
        Vec2::new(self.uniform(), self.uniform())
    }
}

/// SplitMix64's finaliser: every input bit changes about half of the output bits.
fn mix(value: u64) -> u64 {
    let value = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let value = (value ^ (value >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let value = (value ^ (value >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ (value >> 31)
}

/// The upper 24 bits as a number in [0, 1); more would round up to 1.
fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// The R2 sequence (Martin Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018) with a random
/// shift: even over the square, for any number of samples. Kept in 0.32 fixed point, where wrapping is exact.
#[derive(Clone, Copy)]
pub(super) struct R2 {
    shift: [u32; 2],
}

impl R2 {
    /// A shift of its own for item `item` under `seed`.
    pub(super) fn new(item: u64, seed: u64) -> Self {
        let bits = Random::new(item, seed).bits();
        Self { shift: [bits as u32, (bits >> 32) as u32] }
    }

    /// Sample number `index`, in the unit square.
    pub(super) fn square(&self, index: u32) -> Vec2 {
        // 2^32 / g and 2^32 / g^2, where g = 1.3247... is the plastic number
        let x = self.shift[0].wrapping_add(index.wrapping_mul(3_242_174_889));
        let y = self.shift[1].wrapping_add(index.wrapping_mul(2_447_445_414));
        Vec2::new(unit(x), unit(y))
    }
}

/// Two unit vectors that complete `normal` to a right-handed frame (Duff et al. 2017).
pub(super) fn tangents(normal: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0_f32.copysign(normal.z);
    let a = -1.0 / (sign + normal.z);
    let b = normal.x * normal.y * a;
    (
        Vec3::new(1.0 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x),
        Vec3::new(b, sign + normal.y * normal.y * a, -normal.y),
    )
}

/// A point of the unit square to a direction about `normal` with density cosine / pi.
pub(super) fn cosine_direction(normal: Vec3, square: Vec2) -> Vec3 {
    let (radius, angle) = (square.x.sqrt(), TAU * square.y);
    let (t, b) = tangents(normal);
    let height = (1.0 - square.x).max(0.0).sqrt();
    (t * (radius * angle.cos()) + b * (radius * angle.sin()) + normal * height).normalize_or(normal)
}

/// Density of [`cosine_direction`].
pub(super) fn cosine_density(cosine: f32) -> f32 {
    cosine.max(0.0) / PI
}
