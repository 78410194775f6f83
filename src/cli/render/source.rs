//! The frames of a rendering, one after the other, with the light beyond the scan.

use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::Arc;

use super::sequence::{FrameNames, Journal};
use super::{Args, HarmonicsArgs};
use crate::probes::{ProbeStream, StreamOptions, StreamStats};
use crate::scene::FarField;
use crate::{Error, Result};

/// One frame to render.
pub(super) struct Next {
    pub(super) number: u64,
    /// What is beyond the scan.
    pub(super) far_field: Option<Arc<FarField>>,
    /// It is there already, and only its light counts, for the frames after it.
    pub(super) rendered: bool,
}

/// Frames in their order.
pub(super) struct Source {
    pub(super) frames: RangeInclusive<u64>,
    next: u64,
    environment: Option<Arc<FarField>>,
    stream: Option<ProbeStream>,
    pub(super) journal: Option<Journal>,
    /// Frames depend on those before them.
    smoothed: bool,
    /// The first frame that could not be read.
    problem: Option<Error>,
    given: bool,
}

impl Source {
    /// One frame, with an environment beyond the scan or nothing.
    pub(super) fn still(environment: Option<FarField>) -> Self {
        Self {
            frames: 0..=0,
            next: 0,
            environment: environment.map(Arc::new),
            stream: None,
            journal: None,
            smoothed: false,
            problem: None,
            given: false,
        }
    }

    /// The probes of a rendering.
    pub(super) fn open(args: &Args, path: &Path, names: &FrameNames) -> Result<Self> {
        let HarmonicsArgs { temporal, .. } = args.harmonics;
        let plain = args.probes.open(path, None)?;
        let frames = numbers(args, names, plain.frames())?;
        // What the light fades into depends on the frames that are asked for.
        let fades = args.probes.cross_fade.is_some();
        let sequence = if fades { args.probes.open(path, Some(frames.clone()))? } else { plain };
        let many = frames.start() < frames.end();
        // What the pictures depend on; the same line again goes on with them.
        let journal = many.then(|| Journal::open(names, &format!("{args:?}"))).transpose()?;
        let stream = ProbeStream::start(Arc::new(sequence), frames.clone(), StreamOptions::default())?;
        Ok(Self {
            next: *frames.start(),
            stream: Some(stream),
            journal,
            smoothed: temporal > 0.0,
            frames,
            ..Self::still(None)
        })
    }

    /// The next frame; none after the last one. Frames that cannot be read are left out, with a line each.
    ///
    /// # Errors
    /// Where there is not one that can be read.
    pub(super) fn next(&mut self) -> Result<Option<Next>> {
        while self.next <= *self.frames.end() {
            let wanted = self.next;
            if !self.smoothed && self.has(wanted) {
                self.next += 1;
                self.given = true;
                continue;
            }
            let Some(stream) = &mut self.stream else {
                self.next += 1;
                return Ok(Some(Next { number: wanted, far_field: self.environment.clone(), rendered: false }));
            };
            let frame = stream.at(wanted);
            for (number, error) in stream.take_problems() {
                if self.frames.start() == self.frames.end() {
                    return Err(error);
                }
                tracing::warn!("frame {number} is left out: {error}");
                self.problem.get_or_insert(error);
            }
            let Some(frame) = frame else { break };
            self.next = frame.number + 1;
            if frame.number != wanted && !self.smoothed && self.has(frame.number) {
                continue;
            }
            self.given = true;
            let rendered = self.has(frame.number);
            return Ok(Some(Next { number: frame.number, far_field: Some(frame.panorama), rendered }));
        }
        match self.problem.take().filter(|_| !self.given) {
            Some(error) => Err(error),
            None => Ok(None),
        }
    }

    fn has(&self, number: u64) -> bool {
        self.journal.as_ref().is_some_and(|journal| journal.has(number))
    }

    /// Frames that are there, of those that are wanted.
    pub(super) fn done(&self) -> u64 {
        self.next - self.frames.start()
    }

    /// What decoding took.
    pub(super) fn stats(&self) -> StreamStats {
        self.stream.as_ref().map(ProbeStream::stats).unwrap_or_default()
    }
}

/// The numbers of the frames to render, of probes that have `own`.
fn numbers(args: &Args, names: &FrameNames, own: Option<RangeInclusive<u64>>) -> Result<RangeInclusive<u64>> {
    let wanted = match (&args.frames, names.many(), &own) {
        (Some(frames), true, _) => frames.clone(),
        (Some(frames), false, _) if frames.start() == frames.end() => frames.clone(),
        (Some(_), false, _) => {
            return Err(Error::file(&args.out, "has no #### in its name for the numbers of the frames"));
        }
        (None, true, Some(own)) => own.clone(),
        (None, true, None) => {
            return Err(Error::Argument("a sequence of one probe has no end: say --frames A..B".into()));
        }
        (None, false, own) => {
            let first = own.as_ref().map_or(0, |own| *own.start());
            first..=first
        }
    };
    if let Some(own) = own.filter(|own| !own.contains(wanted.start()) || !own.contains(wanted.end())) {
        let ((first, last), (start, end)) = (wanted.into_inner(), own.into_inner());
        return Err(Error::Argument(format!("--frames {first}..{last}: the probes have {start} to {end}")));
    }
    Ok(wanted)
}
