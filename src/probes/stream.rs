//! Frames decoded ahead of the clock that plays them.
//!
//! Threads decode the frames of a source into a ring of a few, in the order of their numbers, and sleep while it is
//! full. What comes out of it, and in which order, does not depend on how many threads there are.

use std::collections::BTreeMap;
use std::num::NonZero;
use std::ops::{Bound, RangeBounds, RangeInclusive};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::Poll;
use std::thread::JoinHandle;
use std::time::Instant;

use super::ProbeSequence;
use crate::scene::FarField;
use crate::{Error, Result};

/// Where a stream has its frames from.
pub trait ProbeSource: Send + Sync + 'static {
    /// The panorama of a frame. Several threads ask at once, each for another number.
    ///
    /// # Errors
    /// Those of a damaged frame, which the stream leaves out and reports; so it does with one that panics.
    fn frame(&self, number: u64) -> Result<FarField>;

    /// The first and the last frame; none where every number has one.
    fn frames(&self) -> Option<RangeInclusive<u64>> {
        None
    }
}

impl ProbeSource for ProbeSequence {
    fn frame(&self, number: u64) -> Result<FarField> {
        Self::frame(self, number)
    }

    fn frames(&self) -> Option<RangeInclusive<u64>> {
        Self::frames(self)
    }
}

/// How far ahead a stream decodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamOptions {
    /// Frames that are decoded or being decoded at once, at least 1. Those that were taken do not count.
    pub ring: usize,
    /// Threads, at least 1; more than the ring has frames would never have work.
    pub threads: usize,
}

impl Default for StreamOptions {
    fn default() -> Self {
        Self { ring: 4, threads: std::thread::available_parallelism().map_or(1, NonZero::get) }
    }
}

/// One frame of a stream.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeFrame {
    /// Its number in the source.
    pub number: u64,
    /// Its light.
    pub panorama: Arc<FarField>,
}

/// What a stream did so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StreamStats {
    /// Frames that were decoded.
    pub decoded: u64,
    /// Frames that [`ProbeStream::at`] skipped, decoded or not.
    pub dropped: u64,
    /// Frames that could not be decoded.
    pub damaged: u64,
    /// Milliseconds that the taker waited for frames.
    pub waited_ms: f64,
    /// The most frames that were decoded or being decoded at once.
    pub peak_alive: usize,
}

/// A stream of frames, in order. The iterator waits for the next good frame and ends after the last one. Over a source
/// without end of which no frame is good, it never returns; nor may it be waited for on one of rayon's threads, which
/// a [`ProbeSequence`] needs.
#[derive(Debug)]
pub struct ProbeStream {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
    /// The frame that was taken last.
    last: Option<ProbeFrame>,
}

#[derive(Debug)]
struct Shared {
    state: Mutex<State>,
    /// Something in the state changed.
    changed: Condvar,
    ring: usize,
    /// The number after the last one.
    end: u64,
}

#[derive(Debug)]
struct State {
    /// What became of the frames that were begun and not taken.
    slots: BTreeMap<u64, Slot>,
    /// The frame that is taken next. Slots before it were skipped while threads were at them.
    wanted: u64,
    /// The frame that is begun next.
    begin: u64,
    closing: bool,
    problems: Vec<(u64, Error)>,
    stats: StreamStats,
}

#[derive(Debug)]
enum Slot {
    InWork,
    Decoded(Arc<FarField>),
    Damaged,
}

impl ProbeStream {
    /// Starts to decode `frames` of `source`, such as `0..=99`, or `10..` to its end; those beyond the source's own are
    /// left out.
    ///
    /// # Errors
    /// [`Error::Argument`] where no frames are left, the ring or the threads are 0, or a thread cannot be started.
    pub fn start<S: ProbeSource>(
        source: Arc<S>,
        frames: impl RangeBounds<u64>,
        options: StreamOptions,
    ) -> Result<Self> {
        let StreamOptions { ring, threads } = options;
        if ring == 0 || threads == 0 {
            return Err(Error::Argument(format!("{ring} frames by {threads} threads cannot be decoded ahead")));
        }
        let (first, end) = overlap(&frames, source.frames())?;
        let state = State {
            slots: BTreeMap::new(),
            wanted: first,
            begin: first,
            closing: false,
            problems: Vec::new(),
            stats: StreamStats::default(),
        };
        let shared = Arc::new(Shared { state: Mutex::new(state), changed: Condvar::new(), ring, end });
        let mut stream = Self { shared, threads: Vec::new(), last: None };
        for number in 0..threads.min(ring) {
            let (shared, source) = (Arc::clone(&stream.shared), Arc::clone(&source));
            let thread = std::thread::Builder::new()
                .name(format!("probe decoder {number}"))
                .spawn(move || shared.work(source.as_ref()))
                .map_err(|e| Error::Argument(format!("cannot start {threads} threads that decode probes: {e}")))?;
            stream.threads.push(thread);
        }
        Ok(stream)
    }

    /// For playing against a clock: the frame `number`, or the next good one after it, without what comes before. Of
    /// skipped frames no more are begun. A number that is not after the frame taken last gives that frame again. None
    /// after the last frame.
    pub fn at(&mut self, number: u64) -> Option<ProbeFrame> {
        if let Some(last) = self.known(number) {
            return Some(last);
        }
        self.shared.skip_to(number);
        self.next()
    }

    /// As [`Self::at`], but without waiting: pending while the frame is being decoded. Whoever asks for a later one each
    /// time may never get any.
    pub fn poll(&mut self, number: u64) -> Poll<Option<ProbeFrame>> {
        if let Some(last) = self.known(number) {
            return Poll::Ready(Some(last));
        }
        self.shared.skip_to(number);
        let found = self.shared.find(&mut self.shared.lock());
        if let Poll::Ready(Some(frame)) = &found {
            self.last = Some(frame.clone());
        }
        found
    }

    /// The frame taken last, where `number` is not after it.
    fn known(&self, number: u64) -> Option<ProbeFrame> {
        self.last.clone().filter(|last| number <= last.number)
    }

    /// Takes the frames that were damaged since the last call, by number, and what is wrong with them; in the order in
    /// which they were found.
    pub fn take_problems(&mut self) -> Vec<(u64, Error)> {
        std::mem::take(&mut self.shared.lock().problems)
    }

    /// What it did so far.
    pub fn stats(&self) -> StreamStats {
        self.shared.lock().stats
    }
}

impl Iterator for ProbeStream {
    type Item = ProbeFrame;

    fn next(&mut self) -> Option<ProbeFrame> {
        let frame = self.shared.take()?;
        self.last = Some(frame.clone());
        Some(frame)
    }
}

impl Drop for ProbeStream {
    fn drop(&mut self) {
        self.shared.lock().closing = true;
        self.shared.changed.notify_all();
        for thread in self.threads.drain(..) {
            // A decoder's panic was caught and reported; there is no other.
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        self.changed.wait(state).unwrap_or_else(PoisonError::into_inner)
    }

    /// The next good frame, none after the last one.
    fn take(&self) -> Option<ProbeFrame> {
        let started = Instant::now();
        let mut state = self.lock();
        let frame = loop {
            match self.find(&mut state) {
                Poll::Ready(frame) => break frame,
                Poll::Pending => state = self.wait(state),
            }
        };
        state.stats.waited_ms += started.elapsed().as_secs_f64() * 1e3;
        frame
    }

    /// The same without waiting.
    fn find(&self, state: &mut State) -> Poll<Option<ProbeFrame>> {
        loop {
            let number = state.wanted;
            if number >= self.end {
                return Poll::Ready(None);
            }
            let frame = match state.slots.get(&number) {
                None | Some(Slot::InWork) => return Poll::Pending,
                Some(Slot::Damaged) => None,
                Some(Slot::Decoded(panorama)) => Some(ProbeFrame { number, panorama: Arc::clone(panorama) }),
            };
            state.slots.remove(&number);
            state.wanted += 1;
            // The ring has moved on.
            self.changed.notify_all();
            if frame.is_some() {
                return Poll::Ready(frame);
            }
        }
    }

    /// Drops what comes before `number`, but for what threads are at: they drop that when they are done.
    fn skip_to(&self, number: u64) {
        let mut state = self.lock();
        let number = number.min(self.end);
        if number <= state.wanted {
            return;
        }
        let damaged = state.slots.range(state.wanted..number).filter(|(_, slot)| matches!(slot, Slot::Damaged)).count();
        state.stats.dropped += number - state.wanted - damaged as u64;
        state.slots.retain(|&at, slot| at >= number || matches!(slot, Slot::InWork));
        state.wanted = number;
        state.begin = state.begin.max(number);
        self.changed.notify_all();
    }

    /// What a thread does: decodes one frame after another.
    fn work(&self, source: &impl ProbeSource) {
        while let Some(number) = self.begin() {
            // A source that panicked is asked again only through `&self`, like one that another thread is at.
            let result = catch_unwind(AssertUnwindSafe(|| source.frame(number))).unwrap_or_else(|panic| {
                let text = panic.downcast_ref::<String>().map(String::as_str);
                let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
                Err(Error::Argument(format!("the decoder of frame {number} panicked: {text}")))
            });
            self.finish(number, result);
        }
    }

    /// Waits for room in the ring and gives the frame to decode; none when the thread is to end.
    fn begin(&self) -> Option<u64> {
        let mut state = self.lock();
        loop {
            let number = state.begin;
            if state.closing || number >= self.end {
                return None;
            }
            // Damaged frames hold no memory, but keep threads from running through a source that has no good ones.
            let alive = state.alive();
            if alive < self.ring && number - state.wanted < self.ring as u64 {
                state.slots.insert(number, Slot::InWork);
                state.begin += 1;
                state.stats.peak_alive = state.stats.peak_alive.max(alive + 1);
                return Some(number);
            }
            state = self.wait(state);
        }
    }

    fn finish(&self, number: u64, result: Result<FarField>) {
        // Made outside of the lock, as is the end of a frame that was skipped.
        let result = result.map(Arc::new);
        let mut state = self.lock();
        match &result {
            Ok(_) => state.stats.decoded += 1,
            Err(_) => state.stats.damaged += 1,
        }
        let late = number < state.wanted;
        if late {
            state.slots.remove(&number);
        }
        let slot = match result {
            Ok(panorama) => Slot::Decoded(panorama),
            Err(error) => {
                state.problems.push((number, error));
                Slot::Damaged
            }
        };
        let unused = if late { Some(slot) } else { state.slots.insert(number, slot) };
        drop(state);
        self.changed.notify_all();
        drop(unused);
    }
}

impl State {
    /// Frames that are decoded or being decoded.
    fn alive(&self) -> usize {
        self.slots.values().filter(|slot| !matches!(slot, Slot::Damaged)).count()
    }
}

/// The first of `frames` that the source has, and the number after the last.
fn overlap(frames: &impl RangeBounds<u64>, source: Option<RangeInclusive<u64>>) -> Result<(u64, u64)> {
    let start = match frames.start_bound() {
        Bound::Included(&start) => start,
        Bound::Excluded(&start) => start.saturating_add(1),
        Bound::Unbounded => 0,
    };
    let end = match frames.end_bound() {
        Bound::Included(&end) => end.saturating_add(1),
        Bound::Excluded(&end) => end,
        Bound::Unbounded => u64::MAX,
    };
    let own = source.unwrap_or(0..=u64::MAX);
    let (first, last) = (start.max(*own.start()), end.min(own.end().saturating_add(1)));
    if first >= last {
        let has = format!("the sequence has {} to {}", own.start(), own.end());
        return Err(Error::Argument(format!("no frames to play from {start} up to {end}: {has}")));
    }
    Ok((first, last))
}
