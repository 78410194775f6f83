//! `relume evaluate`: how well a step of the pipeline does where the truth is known.

mod expansion;
pub(super) mod scenes;

use clap::Subcommand;

use crate::Result;

#[derive(Debug, Subcommand)]
pub(super) enum Verb {
    /// The paper's Table 2: clouds with known HDR colours, exposed, clamped and expanded by every strategy
    Expansion(expansion::Args),
}

pub(super) fn run(verb: &Verb) -> Result<()> {
    match verb {
        Verb::Expansion(args) => expansion::run(args),
    }
}
