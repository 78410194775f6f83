//! Frames that are decoded ahead.

use std::collections::BTreeSet;
use std::sync::{Arc, Condvar, Mutex};
use std::task::Poll;
use std::time::{Duration, Instant};

use glam::Vec3;
use relume::Error;
use relume::probes::{
    CrossFade, Mapping, ProbeFrame, ProbeSequence, ProbeSource, ProbeStream, SequenceOptions, StreamOptions,
    StreamStats,
};
use relume::scene::FarField;

use crate::{folder, problems, says, uneven, write};

/// A source in memory: says what was begun, waits for a gate, and fails or panics where it is told to.
#[derive(Default)]
struct Fake {
    begun: Mutex<Vec<u64>>,
    /// Frames from this number on wait.
    closed_from: Mutex<Option<u64>>,
    opened: Condvar,
    damaged: BTreeSet<u64>,
    panicking: BTreeSet<u64>,
    /// Milliseconds that a frame takes.
    delay: Option<fn(u64) -> u64>,
    last: Option<u64>,
}

impl ProbeSource for Fake {
    fn frame(&self, number: u64) -> relume::Result<FarField> {
        self.begun.lock().unwrap().push(number);
        std::thread::sleep(Duration::from_millis(self.delay.map_or(0, |delay| delay(number))));
        let closed = self.closed_from.lock().unwrap();
        // A test that failed does not open the gate.
        let limit = Duration::from_secs(5);
        drop(self.opened.wait_timeout_while(closed, limit, |from| from.is_some_and(|from| number >= from)).unwrap());
        assert!(!self.panicking.contains(&number), "panic on purpose in frame {number}");
        if self.damaged.contains(&number) {
            return Err(Error::file("fake", format!("frame {number}")));
        }
        Ok(FarField { width: 1, height: 1, radiance: vec![Vec3::splat(number as f32)] })
    }

    fn frames(&self) -> Option<std::ops::RangeInclusive<u64>> {
        self.last.map(|last| 0..=last)
    }
}

impl Fake {
    fn open_gate(&self) {
        *self.closed_from.lock().unwrap() = None;
        self.opened.notify_all();
    }

    /// Frames begun, once nothing happened for a while.
    fn settled(&self) -> Vec<u64> {
        std::thread::sleep(Duration::from_millis(120));
        let mut begun = self.begun.lock().unwrap().clone();
        begun.sort_unstable();
        begun
    }
}

fn stream(source: &Arc<Fake>, ring: usize, threads: usize) -> ProbeStream {
    ProbeStream::start(Arc::clone(source), .., StreamOptions { ring, threads }).unwrap()
}

#[test]
fn the_ring_bounds_what_is_decoded_ahead() {
    for (ring, threads) in [(1, 4), (3, 1), (3, 8)] {
        let source = Arc::new(Fake::default());
        let mut stream = stream(&source, ring, threads);
        assert_eq!(source.settled(), (0..ring as u64).collect::<Vec<_>>());
        for taken in 1..4_u64 {
            assert_eq!(stream.next().unwrap().number, taken - 1);
            assert_eq!(source.settled(), (0..ring as u64 + taken).collect::<Vec<_>>());
        }
        assert_eq!(stream.stats().peak_alive, ring);
        assert_eq!(stream.stats().decoded, ring as u64 + 3);
    }
    // Frames in work count as well.
    let source = Arc::new(Fake { closed_from: Mutex::new(Some(0)), ..Fake::default() });
    let waiting = stream(&source, 2, 8);
    assert_eq!((source.settled(), waiting.stats().peak_alive), (vec![0, 1], 2));
    source.open_gate();
}

#[test]
fn late_frames_are_dropped_and_not_begun() {
    let source = Arc::new(Fake { closed_from: Mutex::new(Some(1)), damaged: [11].into(), ..Fake::default() });
    let mut stream = stream(&source, 2, 2);
    assert_eq!(source.settled(), [0, 1]);
    std::thread::scope(|scope| {
        // Frame 0 lies in the ring and 1 is in work while 10 is asked for.
        scope.spawn(|| {
            std::thread::sleep(Duration::from_millis(100));
            source.open_gate();
        });
        let frame = stream.at(10).unwrap();
        assert_eq!((frame.number, frame.panorama.radiance[0].x), (10, 10.0));
    });
    assert!(stream.stats().waited_ms > 50.0 && stream.stats().waited_ms < 5000.0, "{:?}", stream.stats());
    assert_eq!(stream.at(11).unwrap().number, 12, "the next good one");
    for again in [12, 11, 3] {
        assert_eq!(stream.at(again).unwrap().number, 12, "asked for {again}");
    }
    assert_eq!(stream.next().unwrap().number, 13);
    assert_eq!(source.settled(), [0, 1, 10, 11, 12, 13, 14, 15]);
    let StreamStats { decoded, dropped, damaged, peak_alive, .. } = stream.stats();
    assert_eq!((decoded, dropped, damaged, peak_alive), (7, 10, 1, 2));
    assert_eq!(problems(&mut stream), [11]);
}

#[test]
fn a_frame_that_is_not_there_yet_need_not_be_waited_for() {
    let source =
        Arc::new(Fake { closed_from: Mutex::new(Some(2)), damaged: [3].into(), last: Some(4), ..Fake::default() });
    let mut stream = stream(&source, 2, 2);
    assert_eq!(source.settled(), [0, 1]);
    let number = |poll: Poll<Option<ProbeFrame>>| poll.map(|frame| frame.map(|frame| frame.number));
    assert_eq!(
        [1, 0, 2, 2].map(|n| number(stream.poll(n))),
        [Poll::Ready(Some(1)), Poll::Ready(Some(1)), Poll::Pending, Poll::Pending]
    );
    source.open_gate();
    source.settled();
    assert_eq!(number(stream.poll(2)), Poll::Ready(Some(2)));
    source.settled();
    assert_eq!([3, 5].map(|n| number(stream.poll(n))), [Poll::Ready(Some(4)), Poll::Ready(None)]);
    assert_eq!(stream.take_problems().len(), 1);
}

#[test]
fn the_last_frame_ends_the_stream() {
    let source = Arc::new(Fake { last: Some(9), ..Fake::default() });
    let mut late = stream(&source, 4, 2);
    assert_eq!(late.at(9).unwrap().number, 9);
    assert_eq!((late.next(), late.at(10), late.stats().dropped), (None, None, 9));
    assert_eq!(late.at(9).unwrap().number, 9, "what was shown last stays");
    assert_eq!(stream(&source, 4, 2).at(u64::MAX), None);
    // A damaged frame that is skipped was not dropped.
    let source_with_hole = Arc::new(Fake { last: Some(9), damaged: [2].into(), ..Fake::default() });
    let mut with_hole = stream(&source_with_hole, 4, 2);
    assert_eq!(source_with_hole.settled(), [0, 1, 2, 3]);
    assert_eq!((with_hole.at(9).unwrap().number, with_hole.stats().dropped), (9, 8));
    let part = |frames: std::ops::Range<u64>| ProbeStream::start(source.clone(), frames, StreamOptions::default());
    assert_eq!(part(7..100).unwrap().map(|frame| frame.number).collect::<Vec<_>>(), [7, 8, 9]);
    assert!(matches!(part(10..20), Err(Error::Argument(_))) && matches!(part(4..4), Err(Error::Argument(_))));
    for (ring, threads) in [(0, 1), (1, 0)] {
        assert!(ProbeStream::start(source.clone(), .., StreamOptions { ring, threads }).is_err());
    }
}

#[test]
fn a_panic_is_a_problem_of_its_frame() {
    let panicking: BTreeSet<u64> = [0, 2, 3, 7].into();
    for threads in [1, 4] {
        let source = Arc::new(Fake { panicking: panicking.clone(), last: Some(7), ..Fake::default() });
        let mut stream = stream(&source, 3, threads);
        assert_eq!(stream.by_ref().map(|frame| frame.number).collect::<Vec<_>>(), [1, 4, 5, 6]);
        let mut found = stream.take_problems();
        found.sort_by_key(|problem| problem.0);
        assert_eq!(found.iter().map(|problem| problem.0).collect::<Vec<_>>(), [0, 2, 3, 7]);
        says(&found[1].1, &["frame 2", "panicked", "on purpose"]);
    }
}

#[test]
fn dropping_a_stream_ends_it_at_once() {
    let source = Arc::new(Fake { delay: Some(|_| 200), ..Fake::default() });
    let stream_of_slow_frames = stream(&source, 8, 2);
    std::thread::sleep(Duration::from_millis(50));
    let started = Instant::now();
    drop(stream_of_slow_frames);
    assert!(started.elapsed() < Duration::from_millis(1500), "it took {:?}", started.elapsed());
    assert_eq!(source.settled(), [0, 1], "only frames that were begun are waited for");
    assert_eq!(Arc::strong_count(&source), 1, "a thread still has the source");
    // Threads that sleep because the ring is full end too.
    let source = Arc::new(Fake::default());
    let full = stream(&source, 1, 1);
    source.settled();
    drop(full);
    assert_eq!(Arc::strong_count(&source), 1);
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let play = |threads| {
        // Later frames are often done before earlier ones.
        let delay: Option<fn(u64) -> u64> = Some(|number| number * 7919 % 5);
        let damaged: BTreeSet<u64> = (0..60).filter(|number| number % 7 == 3 || (40..50).contains(number)).collect();
        let source = Arc::new(Fake { delay, damaged, last: Some(59), ..Fake::default() });
        let mut stream = stream(&source, 4, threads);
        let frames: Vec<ProbeFrame> = stream.by_ref().collect();
        assert!(frames.iter().all(|frame| frame.panorama.radiance[0].x == frame.number as f32));
        (frames, problems(&mut stream))
    };
    let (frames, found) = play(1);
    assert_eq!((frames.len(), found.len()), (42, 18));
    assert_eq!((frames, found), play(4));
    // The same with files, a mapping, a turn and a fade.
    let dir = folder(&[]);
    for number in 0..6 {
        write(&dir.path().join(format!("{number}.exr")), (16, 8), &uneven(number));
    }
    let cross_fade = Some(CrossFade { to: dir.path().join("5.exr"), frames: 1..=4 });
    let options =
        SequenceOptions { mapping: Mapping::MirrorBall, turn: 100.0, cross_fade, ..SequenceOptions::default() };
    let play = |threads| {
        let sequence = Arc::new(ProbeSequence::open(dir.path(), &options).unwrap());
        ProbeStream::start(sequence, .., StreamOptions { threads, ..StreamOptions::default() })
            .unwrap()
            .collect::<Vec<_>>()
    };
    assert_eq!(play(1), play(4));
    assert_eq!(play(4).len(), 6);
}
