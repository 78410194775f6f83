//! `relume bench`: measurements.

mod lamp_bridge;
mod lamps;
mod microbuffers;
mod pbgi;
mod points;
mod probes;
mod tables;
mod truth;

use crate::Result;

#[derive(Debug, clap::Subcommand)]
pub(super) enum Verb {
    /// Time and memory of every technique over viewports and micro-buffers: the paper's Table 3
    Pbgi(pbgi::Args),
    /// Error and time over the size of micro-buffers, ours and the paper's
    Microbuffers(microbuffers::Args),
    /// Error against time for every technique and size, by images of an independent path tracer
    Truth(truth::Args),
    /// Time of the point renderer's passes over the size of the cloud: Bouchiba et al. 2018, Table 1
    Points(points::Args),
    /// Projection, streams and transfer of light probes: Hajisharif et al. 2012, Tables 1 and 2
    Probes(probes::Args),
    /// A cloud in the light of a lamp, over bounces, lights and maps: Preiner 2010, Figures 10 and 11
    Lamps(lamps::Args),
}

pub(super) fn run(verb: &Verb) -> Result<()> {
    match verb {
        Verb::Pbgi(args) => pbgi::run(args),
        Verb::Microbuffers(args) => microbuffers::run(args),
        Verb::Truth(args) => truth::run(args),
        Verb::Points(args) => points::run(args),
        Verb::Probes(args) => probes::run(args),
        Verb::Lamps(args) => lamps::run(args),
    }
}

/// The middle one of some values; the upper of two.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
