//! How long each step of a piece of work took.

use std::time::Instant;

/// Wall-clock seconds by step, in order.
#[derive(Default)]
pub(super) struct Clock {
    pub(super) steps: Vec<(&'static str, f64)>,
}

impl Clock {
    /// Does `work` and notes its time.
    pub(super) fn time<T>(&mut self, step: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.steps.push((step, start.elapsed().as_secs_f64()));
        result
    }
}
