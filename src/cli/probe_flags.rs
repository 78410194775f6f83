//! Flags that say which light probes there are.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use super::values;
use crate::Result;
use crate::probes::{CrossFade, Late, Mapping, ProbeSequence, SequenceOptions};
use crate::viewer::state::ProbeChoice;

#[derive(Clone, Debug, clap::Args)]
pub(super) struct ProbeArgs {
    /// Light probes beyond the scan: one .exr or .hdr, a folder of them, or a pattern such as 'probe.####.exr'
    #[arg(long, value_name = "PATTERN")]
    pub(super) probes: Option<PathBuf>,
    /// What the probes' pictures show: lat-long, mirror-ball or angular
    #[arg(long, value_name = "MAPPING", default_value = "lat-long")]
    pub(super) mapping: Mapping,
    /// Turn of the light about +Y, degrees a second, counter-clockwise seen from above
    #[arg(long, value_name = "DEG", value_parser = values::finite, default_value = "0", allow_hyphen_values = true)]
    pub(super) turn: f64,
    /// Frames a second
    #[arg(long, value_name = "FPS", value_parser = values::positive, default_value = "25", allow_hyphen_values = true)]
    pub(super) rate: f64,
    /// Probes that the light fades into, from the first frame to the last
    #[arg(long, value_name = "PATTERN")]
    pub(super) cross_fade: Option<PathBuf>,
}

impl ProbeArgs {
    /// Opens a sequence, whose cross-fade takes the given frames.
    pub(super) fn open(&self, path: &Path, fade: Option<RangeInclusive<u64>>) -> Result<ProbeSequence> {
        let fade = self.cross_fade.clone().zip(fade).map(|(to, frames)| CrossFade { to, frames });
        ProbeSequence::open(path, &self.options(fade))
    }

    /// The same flags as the viewer keeps them.
    pub(super) fn choice(&self, path: &Path, late: Late) -> ProbeChoice {
        let Self { mapping, turn, rate, ref cross_fade, .. } = *self;
        ProbeChoice { path: path.to_owned(), mapping, turn, rate, cross_fade: cross_fade.clone(), late }
    }

    /// The same flags as options of a sequence.
    pub(super) fn options(&self, cross_fade: Option<CrossFade>) -> SequenceOptions {
        SequenceOptions { mapping: self.mapping, turn: self.turn, rate: self.rate, cross_fade, ..Default::default() }
    }
}
