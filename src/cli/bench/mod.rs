//! Placeholder that the next step fills.
use crate::Result;
#[derive(Debug, clap::Subcommand)]
pub(super) enum Verb {}
pub(super) fn run(_verb: &Verb) -> Result<()> { Ok(()) }
