//! `relume evaluate`: how well a step of the pipeline does where the truth is known.

mod expansion;
mod lamps;
mod probes;
pub(super) mod scenes;

use clap::Subcommand;

use crate::Result;

#[derive(Debug, Subcommand)]
pub(super) enum Verb {
    /// The paper's Table 2: clouds with known HDR colours, exposed, clamped and expanded by every strategy
    Expansion(expansion::Args),
    /// Pictures of an object in the light of a probe: with and without shadows, over directions and sizes, turning
    Probes(probes::Args),
    /// Pictures of clouds in the light of lamps: bounces, interleaving, indirect shadows, caustics
    Lamps(lamps::Args),
}

pub(super) fn run(verb: &Verb) -> Result<()> {
    match verb {
        Verb::Expansion(args) => expansion::run(args),
        Verb::Probes(args) => probes::run(args),
        Verb::Lamps(args) => lamps::run(args),
    }
}
