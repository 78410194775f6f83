//! Placeholder that the next step fills.
use crate::Result;
#[derive(Debug, clap::Args)]
pub(super) struct Args {}
pub(super) fn run(_args: &Args) -> Result<()> { Ok(()) }
