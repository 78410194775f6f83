//! The device's clock, and where its times lie on the CPU's.

use std::ops::Range;

use ash::{ext, vk};

use crate::trace::Trace;

/// The clock that a queue's timestamps are taken from.
pub(crate) struct GpuClock {
    /// Nanoseconds of a tick.
    period: f64,
    /// The bits of a timestamp that count; none where the queue has no timestamps.
    mask: u64,
    /// Reads the clock without a submission.
    calibrated: Option<ext::calibrated_timestamps::Device>,
}

/// Both clocks at one moment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reading {
    ticks: u64,
    /// Nanoseconds since the trace's start.
    cpu: u64,
}

/// Readings that the best one is taken of: between a moment before and one after it, a thread may lose its core.
const TRIES: usize = 4;

impl GpuClock {
    /// The clock of a queue whose timestamps have `bits` bits, of `period` nanoseconds a tick.
    pub(crate) fn new(period: f32, bits: u32, calibrated: Option<ext::calibrated_timestamps::Device>) -> Self {
        let mask = if bits >= 64 { u64::MAX } else { (1 << bits) - 1 };
        Self { period: f64::from(period), mask, calibrated }
    }

    /// Whether there are timestamps at all.
    pub(crate) fn exists(&self) -> bool {
        self.mask != 0
    }

    /// How passes get onto the CPU's time line.
    pub(crate) fn how(&self) -> &'static str {
        match (&self.calibrated, self.exists()) {
            (_, false) => "none: the device has no timestamps, so passes are not in the trace",
            (Some(_), _) => "calibrated: VK_EXT_calibrated_timestamps read both clocks at the end of every submission",
            (None, _) => "anchored: the last timestamp of a submission lies where its fence was seen",
        }
    }

    /// Nanoseconds from one timestamp to another, negative where the second is the earlier one.
    pub(crate) fn nanoseconds(&self, from: u64, to: u64) -> f64 {
        let (ahead, behind) = (to.wrapping_sub(from) & self.mask, from.wrapping_sub(to) & self.mask);
        if ahead <= behind { ahead as f64 * self.period } else { behind as f64 * -self.period }
    }

    /// Reads both clocks, where the device can.
    pub(crate) fn read(&self, trace: &Trace) -> Option<Reading> {
        let calibrated = self.calibrated.as_ref()?;
        let info = [vk::CalibratedTimestampInfoEXT::default().time_domain(vk::TimeDomainEXT::DEVICE)];
        let read = |_| {
            let before = trace.now();
            // SAFETY: the extension was enabled because the device reads this domain.
            let (ticks, _) = unsafe { calibrated.get_calibrated_timestamps(&info) }.ok()?;
            let after = trace.now();
            Some((after - before, Reading { ticks: ticks[0], cpu: before + (after - before) / 2 }))
        };
        (0..TRIES).filter_map(read).min_by_key(|(width, _)| *width).map(|(_, reading)| reading)
    }

    /// Where passes with the given begin and end stamps lie on the CPU's time line: in their order, none over another,
    /// and all within the `window` in which the CPU knows them to have run.
    pub(crate) fn place(&self, stamps: &[[u64; 2]], window: Range<u64>, reading: Option<Reading>) -> Vec<Range<u64>> {
        let Some([first, _]) = stamps.first() else { return Vec::new() };
        let mut end = 0.0;
        let since_first: Vec<[f64; 2]> = stamps
            .iter()
            .map(|pass| {
                let [from, to] = pass.map(|stamp| self.nanoseconds(*first, stamp));
                let begin = f64::max(from, end);
                end = f64::max(to, begin);
                [begin, end]
            })
            .collect();
        let (earliest, latest) = (window.start as f64, window.end as f64 - end);
        let start = match reading {
            Some(reading) => reading.cpu as f64 + self.nanoseconds(reading.ticks, *first),
            None => latest,
        };
        let start = start.min(latest).max(earliest);
        let place = |time: f64| ((start + time).round() as u64).min(window.end);
        since_first.into_iter().map(|[begin, end]| place(begin)..place(end)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks of 2 ns in 8 bits.
    fn clock() -> GpuClock {
        GpuClock::new(2.0, 8, None)
    }

    #[test]
    fn stamps_wrap_around() {
        let clock = clock();
        assert_eq!(clock.nanoseconds(250, 4), 20.0);
        assert_eq!(clock.nanoseconds(4, 250), -20.0);
        assert!(clock.exists() && !GpuClock::new(1.0, 0, None).exists());
    }

    #[test]
    fn passes_are_anchored_at_the_fence_or_by_a_reading() {
        let stamps = [[250, 255], [255, 4]];
        assert_eq!(clock().place(&stamps, 1000..1100, None), [1080..1090, 1090..1100]);
        let reading = |cpu| Some(Reading { ticks: 14, cpu });
        assert_eq!(clock().place(&stamps, 1000..1100, reading(1100)), [1060..1070, 1070..1080]);
        // A reading that is off by more than the window allows.
        assert_eq!(clock().place(&stamps, 1000..1100, reading(1000)), [1000..1010, 1010..1020]);
        assert_eq!(clock().place(&stamps, 1000..1100, reading(1200)), [1080..1090, 1090..1100]);
    }

    #[test]
    fn passes_never_overlap_nor_leave_the_window() {
        // The second begins before the first ends, the third runs backwards.
        let stamps = [[10, 20], [15, 30], [40, 35]];
        assert_eq!(clock().place(&stamps, 0..100, None), [40..60, 60..80, 100..100]);
        assert_eq!(clock().place(&stamps, 5..25, None), [5..25, 25..25, 25..25]);
        assert_eq!(clock().place(&[], 5..25, None), []);
    }
}
