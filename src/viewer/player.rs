//! Plays the light probes of a view: opens them, and knows which frame is due.

use std::collections::HashSet;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::task::Poll;
use std::time::{Duration, Instant};

use super::state::ProbeChoice;
use crate::probes::{Playback, ProbeFrame, ProbeSequence, ProbeSource, ProbeStream, StreamOptions};
use crate::scene::FarField;
use crate::{Error, Result};

/// Frames that are decoded ahead.
const RING: usize = 4;
/// A frame that is due and not decoded is looked for this often.
const DECODING: Duration = Duration::from_millis(3);
/// Longest time between two frames that is waited for at once.
const LONGEST: Duration = Duration::from_secs(3600);

/// A sequence that starts again from its first frame when it has ended: its frames are counted on, from 0.
struct Rounds {
    sequence: ProbeSequence,
    /// None for a sequence without end.
    frames: Option<RangeInclusive<u64>>,
}

impl Rounds {
    /// The number that a frame has in the sequence.
    fn number(&self, count: u64) -> u64 {
        self.frames.as_ref().map_or(count, |frames| frames.start() + count % (frames.end() - frames.start() + 1))
    }
}

impl ProbeSource for Rounds {
    fn frame(&self, count: u64) -> Result<FarField> {
        self.sequence.frame(self.number(count))
    }
}

/// Probes that are open.
pub(super) struct Player {
    choice: ProbeChoice,
    rounds: Arc<Rounds>,
    /// From the first time that it plays on.
    stream: Option<ProbeStream>,
    shown: ProbeFrame,
    /// Since when it plays, and which frame was shown then.
    since: Option<(Instant, u64)>,
    /// The frame that the stream was asked for and has not decoded yet.
    wanted: Option<u64>,
    /// Damaged frames that nobody has heard of yet.
    problems: Vec<(u64, Error)>,
    /// Those that somebody has.
    reported: HashSet<u64>,
}

impl Player {
    /// Opens probes, at the first good frame.
    ///
    /// # Errors
    /// Those of [`ProbeSequence::open`].
    pub(super) fn open(choice: &ProbeChoice) -> Result<Self> {
        let sequence = choice.open()?;
        let rounds = Rounds { frames: sequence.frames(), sequence };
        let last = rounds.frames.as_ref().map_or(0, |frames| frames.end() - frames.start());
        let mut problems = Vec::new();
        let mut count = 0;
        let panorama = loop {
            match rounds.frame(count) {
                Ok(panorama) => break Arc::new(panorama),
                Err(error) if count == last => return Err(error),
                Err(error) => problems.push((count, error)),
            }
            count += 1;
        };
        Ok(Self {
            choice: choice.clone(),
            rounds: Arc::new(rounds),
            stream: None,
            shown: ProbeFrame { number: count, panorama },
            since: None,
            wanted: None,
            problems,
            reported: HashSet::new(),
        })
    }

    /// What was opened.
    pub(super) fn choice(&self) -> &ProbeChoice {
        &self.choice
    }

    /// The light of the frame that is shown.
    pub(super) fn panorama(&self) -> &Arc<FarField> {
        &self.shown.panorama
    }

    /// The number of the frame that is shown, of probes that change.
    pub(super) fn number(&self) -> Option<u64> {
        self.changes().then(|| self.rounds.number(self.shown.number))
    }

    /// Whether one frame differs from another.
    fn changes(&self) -> bool {
        match &self.rounds.frames {
            Some(frames) => frames.start() < frames.end(),
            None => self.choice.turn != 0.0 || self.choice.cross_fade.is_some(),
        }
    }

    /// Frames a second, while it plays.
    pub(super) fn playing(&self) -> Option<f64> {
        self.since.map(|_| self.choice.rate)
    }

    /// Plays on from the frame that is shown, or stays at it.
    ///
    /// # Errors
    /// When the system has no threads left.
    pub(super) fn play(&mut self, on: bool, now: Instant) -> Result<()> {
        if !(on && self.changes()) {
            (self.since, self.wanted) = (None, None);
        } else if self.since.is_none() {
            if self.stream.is_none() {
                let options = StreamOptions { ring: RING, ..StreamOptions::default() };
                self.stream = Some(ProbeStream::start(self.rounds.clone(), self.shown.number + 1.., options)?);
            }
            self.since = Some((now, self.shown.number));
        }
        Ok(())
    }

    /// Takes the frame that is due; false where none is, or where it is not decoded yet.
    pub(super) fn advance(&mut self, now: Instant) -> bool {
        let (Some((since, first)), Some(stream)) = (self.since, &mut self.stream) else { return false };
        let playback = Playback { rate: self.choice.rate, late: self.choice.late };
        let due = || playback.next(now.saturating_duration_since(since), first, Some(self.shown.number));
        let Some(number) = self.wanted.or_else(due) else { return false };
        let frame = stream.poll(number);
        self.problems.extend(stream.take_problems());
        // A frame that was asked for is waited for: of later and later ones, none might ever be there in time.
        self.wanted = frame.is_pending().then_some(number);
        let Poll::Ready(Some(frame)) = frame else { return false };
        self.shown = frame;
        true
    }

    /// How long there is nothing to do; none while it does not play.
    pub(super) fn wait(&self, now: Instant) -> Option<Duration> {
        let (since, first) = self.since?;
        if self.wanted.is_some() {
            return Some(DECODING);
        }
        let next = Duration::try_from_secs_f64((self.shown.number + 1 - first) as f64 / self.choice.rate);
        Some(next.map_or(LONGEST, |next| next.saturating_sub(now.saturating_duration_since(since)).min(LONGEST)))
    }

    /// A line for each damaged frame that was met for the first time.
    pub(super) fn problems(&mut self) -> Vec<String> {
        let (rounds, reported) = (&self.rounds, &mut self.reported);
        let found = self.problems.drain(..).map(|(count, error)| (rounds.number(count), error));
        let new = found.filter(|(number, _)| reported.insert(*number));
        new.map(|(number, error)| format!("frame {number} is left out: {error}")).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::image::{ExrLayers, write_exr};
    use crate::probes::Late;
    use glam::Vec3;
    use std::path::Path;

    fn write(path: &Path, light: f32) {
        let rgb = [Vec3::splat(light); 8];
        write_exr(path, &ExrLayers { width: 4, height: 2, rgb: &rgb, alpha: None, groups: &[] }).expect("an EXR");
    }

    /// Numbers and light of the frames that are shown at these times; the decoders are waited for.
    fn played(player: &mut Player, start: Instant, seconds: &[f64]) -> Vec<(u64, f32)> {
        let at = |seconds: f64| start + Duration::from_secs_f64(seconds);
        let shown = seconds.iter().map(|&seconds| {
            while !player.advance(at(seconds)) && player.wanted.is_some() {
                std::thread::sleep(Duration::from_millis(1));
            }
            (player.number().expect("a sequence"), player.panorama().radiance[0].x)
        });
        shown.collect()
    }

    #[test]
    fn frames_follow_the_clock_round_and_round_and_over_damaged_ones() {
        let folder = tempfile::tempdir().expect("a folder");
        for number in 3..7 {
            write(&folder.path().join(format!("{number}.exr")), number as f32);
        }
        std::fs::write(folder.path().join("5.exr"), "no picture").expect("a file");
        let choice = ProbeChoice { rate: 10.0, ..ProbeChoice::new(&folder.path().join("#.exr")) };
        let mut player = Player::open(&choice).expect("probes");
        let start = Instant::now();
        assert_eq!((player.number(), player.wait(start)), (Some(3), None));
        assert!(!player.advance(start + Duration::from_secs(9)), "it does not play yet");
        player.play(true, start).expect("it plays");
        assert_eq!(player.wait(start), Some(Duration::from_millis(100)));
        let shown = played(&mut player, start, &[0.05, 0.1, 0.2, 0.35, 0.4, 0.5, 0.9]);
        assert_eq!(shown, [(3, 3.0), (4, 4.0), (6, 6.0), (6, 6.0), (3, 3.0), (4, 4.0), (4, 4.0)]);
        let lines = player.problems();
        assert!(lines.len() == 1 && lines[0].contains("frame 5") && lines[0].contains("5.exr"), "{lines:?}");
        // After a pause it goes on from where it was.
        player.play(false, start).expect("it stops");
        assert!(!player.advance(start + Duration::from_secs(9)));
        let later = start + Duration::from_secs(20);
        player.play(true, later).expect("it plays");
        assert_eq!(played(&mut player, later, &[0.05, 0.15, 0.2]), [(4, 4.0), (6, 6.0), (6, 6.0)]);
        assert!(player.problems().is_empty(), "each is told once");
    }

    #[test]
    fn late_frames_are_shown_where_they_are_waited_for() {
        let folder = tempfile::tempdir().expect("a folder");
        (0..9).for_each(|number| write(&folder.path().join(format!("{number}.exr")), number as f32));
        for (late, expected) in [(Late::Drop, 5), (Late::Wait, 1)] {
            let choice = ProbeChoice { rate: 10.0, late, ..ProbeChoice::new(folder.path()) };
            let mut player = Player::open(&choice).expect("probes");
            let start = Instant::now();
            player.play(true, start).expect("it plays");
            assert_eq!(played(&mut player, start, &[0.5]), [(expected, expected as f32)]);
        }
    }

    #[test]
    fn what_does_not_change_is_not_played() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("p.exr");
        write(&path, 1.0);
        let still = ProbeChoice::new(&path);
        for (choice, plays) in [
            (still.clone(), false),
            (ProbeChoice { turn: 1.0, ..still.clone() }, true),
            (ProbeChoice { cross_fade: Some(path.clone()), ..still.clone() }, true),
            // A folder of a single frame.
            (ProbeChoice { path: folder.path().to_owned(), ..still }, false),
        ] {
            let mut player = Player::open(&choice).expect("a probe");
            player.play(true, Instant::now()).expect("it plays");
            assert_eq!((player.playing().is_some(), player.number().is_some()), (plays, plays), "{choice:?}");
        }
        let gone = ProbeChoice::new(&folder.path().join("none"));
        assert!(Player::open(&gone).is_err());
    }
}
