//! Light probes over time: sequences of files, and streams that decode them ahead.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use exr::prelude::{Image, SpecificChannels, WritableImage};
use glam::Vec3;
use relume::Error;
use relume::formats::image::{ExrLayers, read_far_field, read_photo, read_probe, write_exr};
use relume::probes::{
    CrossFade, Mapping, ProbeFrame, ProbeSequence, ProbeSource, ProbeStream, SequenceOptions, StreamOptions,
    StreamStats,
};
use relume::scene::FarField;
use tempfile::TempDir;

fn write(path: &Path, (width, height): (u32, u32), rgb: &[Vec3]) {
    write_exr(path, &ExrLayers { width, height, rgb, alpha: None, groups: &[] }).unwrap();
}

/// A folder of panoramas of 8x4 texels, each of one value.
fn folder(files: &[(&str, f32)]) -> TempDir {
    let dir = TempDir::new().unwrap();
    for &(name, value) in files {
        write(&dir.path().join(name), (8, 4), &[Vec3::splat(value); 32]);
    }
    dir
}

fn open(path: impl AsRef<Path>) -> ProbeSequence {
    ProbeSequence::open(path.as_ref(), &SequenceOptions::default()).unwrap()
}

fn refused(path: PathBuf, parts: &[&str]) {
    says(&ProbeSequence::open(&path, &SequenceOptions::default()).unwrap_err(), parts);
}

#[track_caller]
fn says(error: &Error, parts: &[&str]) {
    let text = error.to_string();
    assert!(!text.contains('\n') && parts.iter().all(|part| text.contains(part)), "{text:?} does not say {parts:?}");
}

/// The value of a panorama that has one.
fn value(panorama: &FarField) -> f32 {
    assert!(panorama.radiance.iter().all(|texel| *texel == panorama.radiance[0]));
    panorama.radiance[0].x
}

#[test]
fn patterns_take_numbers_from_names() {
    let names = ["p.0003.exr", "p.0005.exr", "p.10007.exr", "p.12.exr", "p.a123.exr", "p.0004.hdr", "q.0004.exr"];
    let files: Vec<(&str, f32)> = names.into_iter().zip([3.0, 5.0, 10007.0, 0.0, 0.0, 0.0, 0.0]).collect();
    let dir = folder(&files);
    let sequence = open(dir.path().join("p.####.exr"));
    assert_eq!(sequence.frames(), Some(3..=10007));
    for number in [3, 5, 10007] {
        assert_eq!(value(&sequence.frame(number).unwrap()), number as f32);
    }
    for hole in [0, 4, 12, 10008] {
        says(&sequence.frame(hole).unwrap_err(), &["p.####.exr", &format!("has no frame {hole}")]);
    }
    assert_eq!(open(dir.path().join("p.##.exr")).frames(), Some(3..=10007));
    write(&dir.path().join("p.00003.exr"), (8, 4), &[Vec3::ONE; 32]);
    refused(dir.path().join("p.####.exr"), &["p.0", "same frame number"]);
    // A stream reports the holes and goes on.
    let mut stream = ProbeStream::start(Arc::new(sequence), 2..=6, StreamOptions::default()).unwrap();
    assert_eq!(stream.by_ref().map(|frame| frame.number).collect::<Vec<_>>(), [3, 5]);
    assert_eq!(problems(&mut stream), [4, 6]);
}

#[test]
fn folders_count_in_natural_order() {
    let dir = folder(&[("f10.exr", 2.0), ("f9.EXR", 1.0), ("f1.exr", 0.0), (".f3.exr", 7.0)]);
    std::fs::write(dir.path().join("f2.txt"), "no frame").unwrap();
    std::fs::create_dir(dir.path().join("f3.exr")).unwrap();
    let sequence = open(&dir);
    assert_eq!(sequence.frames(), Some(0..=2));
    assert_eq!([0, 1, 2].map(|number| value(&sequence.frame(number).unwrap())), [0.0, 1.0, 2.0]);
    says(&sequence.frame(3).unwrap_err(), &["has no frame 3"]);
}

#[test]
fn what_is_no_sequence_is_refused() {
    let dir = folder(&[]);
    let at = |name: &str| dir.path().join(name);
    refused(dir.path().into(), &["no .exr or .hdr files"]);
    refused(at("none"), &["none", "does not exist"]);
    refused(at("none/p.##.exr"), &["p.##.exr", "cannot be read"]);
    refused(at("p.##.exr"), &["p.##.exr", "matches no file"]);
    refused(at("p##.##.exr"), &["two runs of #"]);
    std::fs::write(at("a.txt"), "x").unwrap();
    refused(at("a.txt"), &["a.txt", "expected .exr or .hdr"]);
    std::fs::write(at("p.01.exr"), "x").unwrap();
    refused(at("p.##.exr"), &["p.01.exr", "not a readable EXR"]);
    std::fs::write(at("p.99999999999999999999.exr"), "x").unwrap();
    refused(at("p.##.exr"), &["too large a number"]);
    let dir = folder(&[("a.exr", 1.0)]);
    for (turn, rate) in [(0.0, 0.0), (0.0, f64::NAN), (f64::INFINITY, 25.0), (1.0, -1.0)] {
        let options = SequenceOptions { turn, rate, ..SequenceOptions::default() };
        assert!(matches!(ProbeSequence::open(dir.path(), &options), Err(Error::Argument(_))), "{turn} {rate}");
    }
    for height in [0, 16385] {
        let options = SequenceOptions { height: Some(height), ..SequenceOptions::default() };
        says(&ProbeSequence::open(dir.path(), &options).unwrap_err(), &[&height.to_string(), "rows"]);
    }
}

#[test]
fn damaged_frames_and_those_of_another_size_are_left_out() {
    let dir = folder(&[("0.exr", 0.0), ("1.exr", 1.0), ("2.exr", 2.0), ("3.exr", 3.0), ("4.exr", 4.0)]);
    let cut = dir.path().join("1.exr");
    let bytes = std::fs::read(&cut).unwrap();
    write(&dir.path().join("3.exr"), (6, 3), &[Vec3::ONE; 18]);
    // Also in front, where the size of the sequence comes from.
    for damaged in [cut, dir.path().join("0.exr")] {
        std::fs::write(damaged, &bytes[..bytes.len() - 20]).unwrap();
    }
    for threads in [1, 3] {
        let options = StreamOptions { threads, ..StreamOptions::default() };
        let mut stream = ProbeStream::start(Arc::new(open(&dir)), .., options).unwrap();
        let frames: Vec<ProbeFrame> = stream.by_ref().collect();
        assert_eq!(frames.iter().map(|frame| value(&frame.panorama)).collect::<Vec<_>>(), [2.0, 4.0]);
        let mut problems = stream.take_problems();
        problems.sort_by_key(|problem| problem.0);
        let [(0, _), (1, short), (3, other)] = problems.as_slice() else { panic!("{problems:?}") };
        says(short, &["1.exr", "not a readable EXR"]);
        says(other, &["3.exr", "6x3", "8x4"]);
        assert!(stream.take_problems().is_empty(), "reported twice");
        assert_eq!((stream.stats().decoded, stream.stats().damaged), (2, 3));
    }
}

#[test]
fn one_file_is_every_frame() {
    let dir = folder(&[]);
    let path = dir.path().join("sky#.exr");
    let mut rgb: Vec<Vec3> = (0..32).map(|i| Vec3::splat(i as f32)).collect();
    rgb[3] = Vec3::new(-1.0, f32::NAN, 2.0);
    rgb[4] = Vec3::new(-1.0, 3.0, 2.0);
    rgb[5].z = f32::INFINITY;
    write(&path, (8, 4), &rgb);
    let (sequence, truth) = (open(&path), read_far_field(&path).unwrap());
    assert_eq!(truth.radiance[3..6], [Vec3::ZERO, Vec3::new(0.0, 3.0, 2.0), Vec3::ZERO]);
    std::fs::remove_file(&path).unwrap();
    assert_eq!((sequence.frames(), sequence.size()), (None, (8, 4)));
    for number in [0, 1, 1 << 60, u64::MAX] {
        assert_eq!(sequence.frame(number).unwrap(), truth);
    }
    let mut stream = ProbeStream::start(Arc::new(sequence), 1 << 40.., StreamOptions::default()).unwrap();
    assert_eq!(stream.nth(9).unwrap().number, (1 << 40) + 9);
}

#[test]
fn probes_of_one_pixel_and_of_whole_numbers() {
    let dir = folder(&[]);
    let path = dir.path().join("a.exr");
    write(&path, (1, 1), &[Vec3::new(1.0, 2.0, 3.0)]);
    for mapping in Mapping::ALL {
        let options = SequenceOptions { mapping, turn: 33.0, ..SequenceOptions::default() };
        let panorama = ProbeSequence::open(&path, &options).unwrap().frame(7).unwrap();
        assert!(panorama.radiance.iter().all(|texel| texel.abs_diff_eq(Vec3::new(1.0, 2.0, 3.0), 1e-5)), "{mapping}");
    }
    let channels = SpecificChannels::rgb(|at: exr::math::Vec2<usize>| (at.0 as u32, at.1 as u32, 1 << 24));
    Image::from_channels((4, 2), channels).write().to_file(&path).unwrap();
    let picture = read_probe(&path).unwrap();
    assert_eq!(picture.at(3, 1), Vec3::new(3.0, 1.0, (1 << 24) as f32));
    assert_eq!(picture, read_photo(&path).unwrap());
}

/// A panorama of 16x8 texels that has no symmetry.
fn uneven(seed: u32) -> Vec<Vec3> {
    (0..128_u32).map(|i| Vec3::from([1, 3, 7].map(|k| ((i * k + seed) * 37 % 101) as f32))).collect()
}

#[test]
fn light_turns_counter_clockwise_seen_from_above() {
    let dir = folder(&[]);
    let path = dir.path().join("a.exr");
    write(&path, (16, 8), &uneven(0));
    let still = open(&path).frame(0).unwrap();
    // A texel in four frames.
    let options = SequenceOptions { turn: 22.5, rate: 4.0, ..SequenceOptions::default() };
    let sequence = ProbeSequence::open(&path, &options).unwrap();
    for frame in [0_u64, 1, 4, 6, 40, 4 * 16 * 1_000_000_000 + 12] {
        let turned = sequence.frame(frame).unwrap();
        let angle = (frame % 64) as f32 / 4.0 * 22.5_f32.to_radians();
        for index in 0..40 {
            let direction =
                Vec3::new((index as f32).sin(), (index as f32 * 0.7).cos() * 0.9, (index as f32 * 1.9).cos());
            let back = glam::Quat::from_rotation_y(-angle) * direction.normalize();
            let (seen, truth) = (turned.sample(direction.normalize()), still.sample(back));
            // Between texels, the line is drawn twice.
            let bound = if frame % 4 == 0 { 0.02 } else { 30.0 };
            assert!((seen - truth).abs().max_element() < bound, "frame {frame}: {seen} instead of {truth}");
        }
        for (row, source) in turned.radiance.chunks_exact(16).zip(still.radiance.chunks_exact(16)) {
            let whole = (frame / 4 % 16) as usize;
            for column in 0..16 {
                let (left, right) = (source[(column + whole) % 16], source[(column + whole + 1) % 16]);
                assert_eq!(row[column], left.lerp(right, (frame % 4) as f32 / 4.0), "frame {frame}");
            }
        }
    }
    // What is at +Z goes to +X, as with an object's placement; and back with a negative turn.
    let mut lamp = vec![Vec3::ZERO; 128];
    (4..5).for_each(|row| lamp[row * 16] = Vec3::ONE);
    write(&path, (16, 8), &lamp);
    for (turn, side) in [(90.0, Vec3::X), (-90.0, Vec3::NEG_X), (450.0, Vec3::X)] {
        let options = SequenceOptions { turn, ..SequenceOptions::default() };
        let turned = ProbeSequence::open(&path, &options).unwrap().frame(25).unwrap();
        assert!(turned.sample(side).x > 0.2 && turned.sample(-side).x == 0.0 && turned.sample(Vec3::Z).x == 0.0);
    }
    // 7 texels in 3.3 s at a rate that no binary fraction is equal to.
    write(&path, (16, 8), &uneven(0));
    let options = SequenceOptions { turn: 22.5 * 7.0 / 3.3, rate: 30.0, ..SequenceOptions::default() };
    let turned = ProbeSequence::open(&path, &options).unwrap().frame(99).unwrap();
    assert_eq!(turned.radiance[3 * 16..3 * 16 + 9], still.radiance[3 * 16 + 7..4 * 16]);
}

#[test]
fn cross_fades_are_linear_in_radiance() {
    let dir = folder(&[("a.exr", 1.0), ("s.4.exr", 5.0), ("s.5.exr", 5.0), ("s.6.exr", 9.0), ("s.7.exr", 7.0)]);
    let at = |name: &str| dir.path().join(name);
    let fade = |to: &str, frames| {
        let cross_fade = Some(CrossFade { to: at(to), frames });
        SequenceOptions { cross_fade, ..SequenceOptions::default() }
    };
    let sequence = ProbeSequence::open(&at("a.exr"), &fade("s.#.exr", 3..=5)).unwrap();
    assert_eq!(sequence.frames(), Some(0..=7));
    let values = [0, 3, 4, 5, 6, 7].map(|number| value(&sequence.frame(number).unwrap()));
    assert_eq!(values, [1.0, 1.0, 3.0, 5.0, 9.0, 7.0]);
    let back = ProbeSequence::open(&at("s.#.exr"), &fade("a.exr", 5..=5)).unwrap();
    assert_eq!(back.frames(), Some(4..=7));
    assert_eq!([4, 5, 6].map(|number| value(&back.frame(number).unwrap())), [5.0, 1.0, 1.0]);
    for (to, frames) in [("s.#.exr", 2..=5), ("s.#.exr", 7..=9), ("s.#.exr", std::ops::RangeInclusive::new(5, 4))] {
        let error = ProbeSequence::open(&at("a.exr"), &fade(to, frames)).unwrap_err();
        assert!(matches!(error, Error::Argument(_)), "{error}");
    }
    // Another size: brought to the first's with its light, and turned along.
    write(&at("large.exr"), (32, 16), &uneven(5).iter().flat_map(|&v| [v; 4]).collect::<Vec<_>>());
    let options = SequenceOptions { turn: 45.0, rate: 1.0, ..fade("large.exr", 0..=2) };
    let mixed = ProbeSequence::open(&at("a.exr"), &options).unwrap();
    let large = SequenceOptions { height: Some(4), ..SequenceOptions::default() };
    let mut large = ProbeSequence::open(&at("large.exr"), &large).unwrap().frame(0).unwrap();
    large.radiance.chunks_exact_mut(8).for_each(|row| row.rotate_left(1));
    let halfway: Vec<Vec3> = large.radiance.iter().map(|texel| Vec3::ONE.lerp(*texel, 0.5)).collect();
    assert_eq!(mixed.frame(1).unwrap(), FarField { radiance: halfway, ..large });
}

fn problems(stream: &mut ProbeStream) -> Vec<u64> {
    let mut numbers: Vec<u64> = stream.take_problems().into_iter().map(|problem| problem.0).collect();
    numbers.sort_unstable();
    numbers
}

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
        drop(self.opened.wait_while(closed, |from| from.is_some_and(|from| number >= from)).unwrap());
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
fn the_last_frame_ends_the_stream() {
    let source = Arc::new(Fake { last: Some(9), ..Fake::default() });
    let mut late = stream(&source, 4, 2);
    assert_eq!(late.at(9).unwrap().number, 9);
    assert_eq!((late.next(), late.at(10), late.stats().dropped), (None, None, 9));
    assert_eq!(late.at(9).unwrap().number, 9, "what was shown last stays");
    assert_eq!(stream(&source, 4, 2).at(u64::MAX), None);
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
