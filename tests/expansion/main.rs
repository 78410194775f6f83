//! Dynamic range by tone operators, exposures, PatchMatch and shots: each by itself, all of them from a photo to a cloud,
//! and what is refused. The network and the Poisson system have tests of their own.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod bad_input;
mod end_to_end;
mod exposure;
mod patchmatch;
mod room;
mod shots;
mod tone;

use std::path::PathBuf;

use glam::{Vec3, vec3};

/// Data that is not part of the project; `None`, with a plain word about it, where it is not at hand.
fn shared(test: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("RELUME_SHARED").filter(|name| !name.is_empty()).map(PathBuf::from);
    if folder.is_none() {
        eprintln!("{test}: skipped, because RELUME_SHARED is not set");
    }
    folder
}

/// What `work` gives on that many threads.
fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

fn bits(colors: &[Vec3]) -> Vec<[u32; 3]> {
    colors.iter().map(|color| color.to_array().map(f32::to_bits)).collect()
}

/// Root of the mean of the squares.
fn rms(values: impl IntoIterator<Item = f32>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0.0), |(sum, n), v| (sum + f64::from(v).powi(2), n + 1.0));
    f64::sqrt(sum / count)
}

fn median(mut values: Vec<f32>) -> f32 {
    values.sort_by(f32::total_cmp);
    values[values.len() / 2]
}

/// Numbers from 0 to 1, the same in every run (Steele et al. 2014, SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1_u64 << 24) as f32
    }

    fn vector(&mut self) -> Vec3 {
        vec3(self.next(), self.next(), self.next())
    }
}
