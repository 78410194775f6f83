//! Holds the frame rate while things move: pictures get coarser when they take too long, and finer when there is time.

/// One pixel of a moving picture is this many of the window, along each side. What is coarser shows little and saves
/// little: most of such a picture's time goes with vertices, points and passes.
const DIVISORS: [u32; 4] = [1, 2, 3, 4];
/// A moving picture may take so long, milliseconds: 15 a second, and some time for the window.
const BUDGET_MS: f64 = 50.0;
/// Part of the time between two frames of light probes that a picture may take, and the least that it gets: at still
/// higher rates frames are left out, rather than that nothing can be seen.
const SHARE: f64 = 0.8;
const LEAST_MS: f64 = 20.0;
/// A finer picture must be expected to take less than this part of it.
const HEADROOM: f64 = 0.85;
/// So many pictures in a row must have left time for a finer one.
const PATIENCE: u32 = 6;
/// Part of a mean that one picture makes up.
const WEIGHT: f64 = 0.3;
/// Part of a picture's time that goes with its pixels, where nothing better is known.
const BY_PIXELS: f64 = 0.6;
/// What a level took is believed this much less with each picture of another level.
const FORGETTING: f64 = 0.995;

/// The controller.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    level: usize,
    /// Mean milliseconds of each level's pictures; 0 where there were none.
    means: [f64; DIVISORS.len()],
    /// Pictures in a row that left time for finer ones.
    calm: u32,
}

impl Default for Pace {
    /// Half the resolution at first.
    fn default() -> Self {
        Self { level: 1, means: [0.0; DIVISORS.len()], calm: 0 }
    }
}

impl Pace {
    /// Window pixels along a side of a picture's pixel.
    pub fn divisor(&self) -> u32 {
        DIVISORS[self.level]
    }

    /// Size of the next moving picture in a window's area of the given size.
    pub fn size(&self, [width, height]: [u32; 2]) -> [u32; 2] {
        [width, height].map(|side| side.div_ceil(self.divisor()).max(1))
    }

    /// Hears how long a moving picture took, milliseconds, and how many frames of light probes a second are played.
    pub fn observe(&mut self, ms: f64, rate: Option<f64>) {
        let budget = rate.map_or(BUDGET_MS, |rate| (SHARE * 1e3 / rate).clamp(LEAST_MS, BUDGET_MS));
        for (level, mean) in self.means.iter_mut().enumerate().filter(|(level, _)| *level != self.level) {
            // Times of finer levels shrink until they are tried again.
            *mean *= if level < self.level { FORGETTING } else { 1.0 };
        }
        let mean = &mut self.means[self.level];
        *mean = if *mean == 0.0 { ms } else { *mean + WEIGHT * (ms - *mean) };
        let mean = *mean;
        let last = DIVISORS.len() - 1;
        if mean > budget && ms > budget && self.level < last {
            self.calm = 0;
            // Two levels at once where one would not do.
            let next = self.level + 1;
            let coarser = if self.expected(next) > budget { (next + 1).min(last) } else { next };
            self.change(coarser);
        } else if self.level > 0 && self.expected(self.level - 1) < HEADROOM * budget {
            self.calm += 1;
            if self.calm >= PATIENCE {
                self.change(self.level - 1);
            }
        } else {
            self.calm = 0;
        }
    }

    fn change(&mut self, level: usize) {
        // What was measured here long ago starts afresh, what was expected is kept.
        self.means[level] = self.expected(level);
        (self.level, self.calm) = (level, 0);
    }

    /// Milliseconds that a picture of another level would take.
    fn expected(&self, level: usize) -> f64 {
        let now = self.means[self.level];
        let guess = now * (1.0 - BY_PIXELS + BY_PIXELS / self.ratio(level));
        // A finer one takes no less than this one.
        match self.means[level] {
            0.0 => guess,
            known if level < self.level => known.max(now),
            known => known.min(guess),
        }
    }

    /// How many times fewer pixels another level has.
    fn ratio(&self, level: usize) -> f64 {
        (f64::from(DIVISORS[level]) / f64::from(DIVISORS[self.level])).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Level after many pictures that take `fixed` ms and `per_pixel` ms a pixel of the whole window.
    fn settles(fixed: f64, full: f64) -> (u32, u32) {
        settles_at(None, fixed, full)
    }

    fn settles_at(rate: Option<f64>, fixed: f64, full: f64) -> (u32, u32) {
        let mut pace = Pace::default();
        let mut changes = 0;
        for frame in 0..200 {
            let before = pace.divisor();
            pace.observe(fixed + full / f64::from(before * before), rate);
            changes += u32::from(frame > 50 && pace.divisor() != before);
        }
        (pace.divisor(), changes)
    }

    #[test]
    fn quick_pictures_are_whole_and_slow_ones_coarse() {
        assert_eq!(settles(5.0, 10.0), (1, 0));
        assert_eq!(settles(5.0, 120.0), (2, 0));
        assert_eq!(settles(10.0, 300.0), (3, 0));
        assert_eq!(settles(30.0, 60.0), (2, 0), "most of the time does not go with the pixels");
        assert_eq!(settles(500.0, 1e5).0, 4, "no coarser than there is");
    }

    #[test]
    fn probes_are_played_at_their_rate() {
        assert_eq!(settles_at(Some(2.0), 5.0, 120.0), (2, 0), "no slower than without");
        assert_eq!(settles_at(Some(25.0), 5.0, 120.0), (3, 0));
        assert_eq!(settles_at(Some(1000.0), 5.0, 120.0), (3, 0), "not as coarse as can be");
    }

    #[test]
    fn sizes_are_never_empty() {
        let mut pace = Pace::default();
        (0..20).for_each(|_| pace.observe(1e4, None));
        assert_eq!(pace.size([640, 360]), [160, 90]);
        assert_eq!(pace.size([1, 3]), [1, 1]);
    }
}
