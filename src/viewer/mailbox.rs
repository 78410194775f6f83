//! What the window asks of the worker: the newest view wins, everything else waits in line.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::state::ViewState;

/// A view to be shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Counts up.
    pub number: u64,
    /// What to show.
    pub state: ViewState,
    /// Size of the window's area for it, pixels.
    pub size: [u32; 2],
    /// Whether it is about to change again: a quick picture is better than a good one.
    pub moving: bool,
}

/// Other work.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Write the still picture as `.png` and `.exr` beside each other; the name has no ending.
    Screenshot(PathBuf),
    /// Render the still picture again under RenderDoc's eyes.
    Capture,
    /// Behave as if the device had been lost.
    LoseDevice,
}

#[derive(Default)]
struct Contents {
    request: Option<Request>,
    commands: VecDeque<Command>,
    quit: bool,
}

/// What is next.
#[derive(Debug, PartialEq)]
pub(super) enum Job {
    Command(Command),
    View(Box<Request>),
    /// Nothing new.
    Idle,
    Quit,
}

/// The box between both threads.
#[derive(Default)]
pub struct Mailbox {
    contents: Mutex<Contents>,
    changed: Condvar,
    stop: Arc<AtomicBool>,
}

impl Mailbox {
    fn change(&self, change: impl FnOnce(&mut Contents)) {
        change(&mut self.contents.lock().unwrap_or_else(PoisonError::into_inner));
        self.stop.store(true, Ordering::Relaxed);
        self.changed.notify_one();
    }

    /// Replaces a view that is not begun, and ends the refinement of one that is.
    pub fn show(&self, request: Request) {
        self.change(|contents| contents.request = Some(request));
    }

    /// Adds other work.
    pub fn command(&self, command: Command) {
        self.change(|contents| contents.commands.push_back(command));
    }

    /// Asks the worker to end.
    pub fn quit(&self) {
        self.change(|contents| contents.quit = true);
    }

    /// True once something came in after the last [`Mailbox::next`].
    pub(super) fn stop(&self) -> Arc<AtomicBool> {
        self.stop.clone()
    }

    /// What is next; waits for it, but not for longer than `wait`.
    pub(super) fn next(&self, wait: Duration) -> Job {
        let end = Instant::now().checked_add(wait);
        let mut contents = self.contents.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            self.stop.store(false, Ordering::Relaxed);
            if contents.quit {
                return Job::Quit;
            }
            if let Some(request) = contents.request.take() {
                return Job::View(Box::new(request));
            }
            if let Some(command) = contents.commands.pop_front() {
                return Job::Command(command);
            }
            let left = end.map_or(wait, |end| end.saturating_duration_since(Instant::now()));
            if left.is_zero() {
                return Job::Idle;
            }
            contents = self.changed.wait_timeout(contents, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(number: u64) -> Request {
        Request { number, state: ViewState::default(), size: [1, 1], moving: true }
    }

    #[test]
    fn the_newest_view_wins_and_commands_follow_it() {
        let mailbox = Mailbox::default();
        assert_eq!(mailbox.next(Duration::ZERO), Job::Idle);
        mailbox.show(request(1));
        mailbox.command(Command::LoseDevice);
        mailbox.show(request(2));
        assert!(mailbox.stop().load(Ordering::Relaxed));
        assert_eq!(mailbox.next(Duration::MAX), Job::View(Box::new(request(2))));
        assert_eq!(mailbox.next(Duration::MAX), Job::Command(Command::LoseDevice));
        assert!(!mailbox.stop().load(Ordering::Relaxed));
        mailbox.show(request(3));
        mailbox.quit();
        assert_eq!(mailbox.next(Duration::MAX), Job::Quit);
    }
}
