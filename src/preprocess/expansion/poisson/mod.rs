//! Gives points without a valid HDR colour one whose gradients are those of the LDR colours (Sabbadin 2019, 4.2), after
//! Perez, Gangnet, Blake: "Poisson Image Editing", 2003.
//!
//! Solved is the correction D = H - L instead of H itself: with it the LDR gradients drop out of Eq. 2, what is left is
//! |N_p| D(p) = sum of D(q) over all neighbours q, and D(p) is nothing but the mean of its neighbours'.

mod conjugate_gradient;
mod graph;
mod multigrid;
mod neighbours;
mod sparse;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use self::graph::System;
use self::multigrid::Multigrid;
use self::neighbours::{Search, Sites};
use super::Transfer;
use crate::compare::luminance;
use crate::preprocess::clock::Clock;
use crate::{Error, Result};

/// k of Sabbadin 2019, 4.2.
pub const DEFAULT_NEIGHBOURS: usize = 16;
/// Most neighbours that a point may have.
pub const MOST_NEIGHBOURS: usize = 64;

/// Largest coordinate and radiance that is accepted, as everywhere: squares stay finite in f32.
const LARGEST: f32 = 1e15;

/// A cloud whose HDR colours are known in part.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a> {
    /// All points of the cloud.
    pub positions: &'a [Vec3],
    /// L: the linear LDR colour of each.
    pub low: &'a [Vec3],
    /// Omega: whether the HDR colour of each is to be found.
    pub unknown: &'a [bool],
    /// Known points that tell nothing about unknown ones, and are left out of Eq. 2; empty where all count.
    pub silent: &'a [bool],
    /// k: how many nearest points are a point's neighbours, 1 to [`MOST_NEIGHBOURS`].
    pub neighbours: usize,
}

/// What [`solve`] did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoissonReport {
    /// Points whose colour was to be found.
    pub unknowns: usize,
    /// Parts that these fall into, with no edge of the graph between any two.
    pub components: usize,
    /// Points of parts without any known neighbour, ascending: they keep their LDR colour.
    pub filled: Vec<u32>,
    /// Points that Eq. 2 gives a channel below zero, which has become zero.
    pub clamped: usize,
    /// Iterations of the conjugate gradient.
    pub iterations: usize,
    /// |b - A x| / |b|, of the worst channel.
    pub residual: f64,
    /// Wall-clock seconds of each step, in order.
    pub seconds: Vec<(&'static str, f64)>,
}

/// Replaces the colour of every unknown point in `high`, which holds H of the known ones; what it holds for unknown ones
/// is not looked at. Results are finite and not negative, and the same to the byte whatever the number of threads.
/// `progress` hears from 0 to 1.
///
/// With [`Transfer::Luminance`] one system is solved for the luminance (Rec. 709), and a point gets its LDR colour scaled
/// to it, grey if that is black; with [`Transfer::Rgb`] one for each channel.
///
/// Where no known point is a neighbour of any point of a connected part, H = L + c solves Eq. 2 for every c; c is 0.
///
/// # Errors
///
/// [`Error::Argument`] for slices of different lengths, a number of neighbours out of range, and for values that are used
/// and not finite or beyond 1e15. [`Error::Limit`] for more than 2^32 - 1 points.
pub fn solve(
    problem: &Problem,
    transfer: Transfer,
    high: &mut [Vec3],
    progress: &(dyn Fn(f32) + Sync),
) -> Result<PoissonReport> {
    problem.check(high)?;
    match transfer {
        Transfer::Rgb => problem.solve(high, progress, |color| color.as_dvec3().to_array(), |_, found| found.into()),
        Transfer::Luminance => problem.solve(high, progress, |color| [f64::from(luminance(color))], recolored),
    }
}

/// An LDR colour scaled to a luminance; grey if it has none itself.
fn recolored(low: Vec3, [found]: [f64; 1]) -> DVec3 {
    let own = f64::from(luminance(low));
    if own > 0.0 { low.as_dvec3() * (found / own) } else { DVec3::splat(found) }
}

impl Problem<'_> {
    fn check(&self, high: &[Vec3]) -> Result<()> {
        let points = self.positions.len();
        let lengths =
            [("LDR colours", self.low.len()), ("HDR colours", high.len()), ("unknown flags", self.unknown.len())];
        let lengths =
            lengths.into_iter().chain((!self.silent.is_empty()).then_some(("silent flags", self.silent.len())));
        if let Some((name, len)) = lengths.clone().find(|(_, len)| *len != points) {
            return Err(Error::Argument(format!("Poisson: {len} {name} for {points} points; give one each")));
        }
        if !(1..=MOST_NEIGHBOURS).contains(&self.neighbours) {
            let k = self.neighbours;
            return Err(Error::Argument(format!("Poisson: {k} neighbours a point; give 1 to {MOST_NEIGHBOURS}")));
        }
        if points > u32::MAX as usize {
            return Err(Error::Limit(format!("a cloud holds at most {} points, not {points}", u32::MAX)));
        }
        let usable = |value: Vec3| value.abs().max_element() <= LARGEST && !value.is_nan();
        let wrong = (0..points).into_par_iter().find_map_first(|point| {
            let high = if self.unknown[point] { Vec3::ZERO } else { high[point] };
            let values = [("position", self.positions[point]), ("LDR colour", self.low[point]), ("HDR colour", high)];
            values.into_iter().find(|(_, value)| !usable(*value)).map(|(name, value)| (point, name, value))
        });
        match wrong {
            Some((point, name, value)) => Err(Error::Argument(format!(
                "Poisson: the {name} of point {point} is {value}; all must be finite and at most {LARGEST:e}"
            ))),
            None => Ok(()),
        }
    }

    /// `channels` takes a colour apart into what is solved; `color` makes one of a point's LDR colour and its solution.
    fn solve<const C: usize>(
        &self,
        high: &mut [Vec3],
        progress: &(dyn Fn(f32) + Sync),
        channels: impl Fn(Vec3) -> [f64; C] + Sync,
        color: impl Fn(Vec3, [f64; C]) -> DVec3 + Sync,
    ) -> Result<PoissonReport> {
        let mut clock = Clock::default();
        let sites = clock.time("sites", || Sites::new(self.positions, self.unknown));
        let known = &*high;
        let search = Search {
            positions: self.positions,
            sites: &sites,
            silent: self.silent,
            neighbours: self.neighbours,
            value: |point: usize| {
                let (high, low) = (channels(known[point]), channels(self.low[point]));
                std::array::from_fn(|c| high[c] - low[c])
            },
        };
        let rows = clock.time("neighbours", || search.rows::<C>(&|part| progress(0.4 * part)))?;
        let System { matrix, right, start, stranded, components } = clock.time("graph", || System::new(rows));
        progress(0.5);
        let mut correction = start;
        let multigrid = clock.time("multigrid", || Multigrid::new(matrix));
        progress(0.6);
        let solved = clock.time("conjugate gradient", || {
            conjugate_gradient::solve(&multigrid, &right, &mut correction, &|part| progress(0.6 + 0.4 * part))
        });
        progress(1.0);

        let sites = &sites.of_points;
        let unknown = || (0..sites.len()).filter(|&point| sites[point] != neighbours::KNOWN);
        let mut clamped = 0;
        for point in unknown() {
            let site = sites[point] as usize;
            let low = channels(self.low[point]);
            let found: [f64; C] = std::array::from_fn(|c| low[c] + correction[site][c]);
            clamped += usize::from(found.iter().any(|&value| value < 0.0));
            high[point] = if stranded[site] {
                self.low[point].max(Vec3::ZERO)
            } else {
                color(self.low[point], found).clamp(DVec3::ZERO, DVec3::splat(f64::from(f32::MAX))).as_vec3()
            };
        }
        Ok(PoissonReport {
            unknowns: unknown().count(),
            components,
            filled: unknown().filter(|&point| stranded[sites[point] as usize]).map(|point| point as u32).collect(),
            clamped,
            iterations: solved.iterations,
            residual: solved.residual,
            seconds: clock.steps,
        })
    }
}
