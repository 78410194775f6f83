//! Which frame a clock asks for.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

/// What happens to frames for which there was no time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Late {
    /// They are left out: light keeps up with the clock.
    #[default]
    Drop,
    /// They are shown all the same, one after another, until the clock is caught up with.
    Wait,
}

impl Late {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Drop, Self::Wait];

    /// The name it has everywhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::Drop => "drop",
            Self::Wait => "wait",
        }
    }
}

impl fmt::Display for Late {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Late {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|late| late.name() == text)
            .ok_or_else(|| format!("{text:?} is nothing to do with late frames; there are drop and wait"))
    }
}

/// How a stream is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playback {
    /// Frames a second.
    pub rate: f64,
    /// What happens to frames for which there was no time.
    pub late: Late,
}

impl Playback {
    /// The frame that is due when `elapsed` has gone by since `first` was.
    pub fn due(&self, elapsed: Duration, first: u64) -> u64 {
        // A frame begins at a whole number of nanoseconds, which may be just before its time.
        first.saturating_add((elapsed.as_secs_f64() * self.rate + 1e-6) as u64)
    }

    /// The frame to ask a stream for when `elapsed` has gone by since `first` was due and `shown` is on screen; none
    /// while that one still is due.
    pub fn next(&self, elapsed: Duration, first: u64, shown: Option<u64>) -> Option<u64> {
        let due = self.due(elapsed, first);
        match (shown, self.late) {
            (Some(shown), _) if shown >= due => None,
            (_, Late::Drop) => Some(due),
            (Some(shown), Late::Wait) => Some(shown + 1),
            (None, Late::Wait) => Some(first),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_due_at_their_time() {
        for rate in [25.0, 30.0, 24.0, 23.976] {
            let playback = Playback { rate, late: Late::Drop };
            for frame in 0..2000_u64 {
                let start = Duration::from_secs_f64(frame as f64 / rate);
                assert_eq!(playback.due(start, 7), 7 + frame, "at the start of a frame, {rate} a second");
                assert_eq!(playback.due(start + Duration::from_millis(30), 7), 7 + frame, "{rate} a second");
            }
        }
        let slow = Playback { rate: 0.5, late: Late::Drop };
        assert_eq!([0.0, 1.9, 2.0, 5.0].map(|s| slow.due(Duration::from_secs_f64(s), 0)), [0, 0, 1, 2]);
    }

    #[test]
    fn late_frames_are_left_out_or_shown_all_the_same() {
        let at = Duration::from_millis;
        let drop = Playback { rate: 25.0, late: Late::Drop };
        assert_eq!(drop.next(at(0), 3, None), Some(3));
        assert_eq!(drop.next(at(39), 3, Some(3)), None);
        assert_eq!(drop.next(at(200), 3, Some(3)), Some(8));
        assert_eq!(drop.next(at(200), 3, Some(9)), None, "a frame that came instead of a damaged one");
        let wait = Playback { late: Late::Wait, ..drop };
        assert_eq!(wait.next(at(200), 3, None), Some(3));
        assert_eq!(wait.next(at(200), 3, Some(3)), Some(4));
        assert_eq!(wait.next(at(200), 3, Some(8)), None);
        assert_eq!(Late::ALL.map(|late| late.name().parse()), Late::ALL.map(Ok));
        assert!("x".parse::<Late>().is_err());
    }
}
