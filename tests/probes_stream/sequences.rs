//! Which panorama a frame number stands for.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use exr::prelude::{
    Encoding, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes, SpecificChannels, Vec2, WritableImage, f16,
};
use glam::Vec3;
use relume::Error;
use relume::formats::image::{read_far_field, read_photo, read_probe};
use relume::probes::{CrossFade, Mapping, ProbeFrame, ProbeSequence, ProbeStream, SequenceOptions, StreamOptions};
use relume::scene::FarField;

use crate::{folder, problems, says, uneven, write};

fn open(path: impl AsRef<Path>) -> ProbeSequence {
    ProbeSequence::open(path.as_ref(), &SequenceOptions::default()).unwrap()
}

fn refused(path: PathBuf, parts: &[&str]) {
    says(&ProbeSequence::open(&path, &SequenceOptions::default()).unwrap_err(), parts);
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
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| (at.0 as u32, at.1 as u32, 1 << 24));
    Image::from_channels((4, 2), channels).write().to_file(&path).unwrap();
    let picture = read_probe(&path).unwrap();
    assert_eq!(picture.at(3, 1), Vec3::new(3.0, 1.0, (1 << 24) as f32));
    assert_eq!(picture, read_photo(&path).unwrap());
    let half = |value: usize| f16::from_f32(value as f32);
    // A crop of half floats that begins left of the frame and ends below it.
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| (half(at.0), half(at.1), half(7)));
    let attributes = LayerAttributes { layer_position: Vec2(-2, 3), ..LayerAttributes::default() };
    let layer = Layer::new((5, 3), attributes, Encoding::FAST_LOSSLESS, channels);
    let window = IntegerBounds::new((0, 0), (8, 4));
    Image::new(ImageAttributes::new(window), layer).write().to_file(&path).unwrap();
    let picture = read_probe(&path).unwrap();
    let expected = [0.0, 2.0, 3.0, 4.0, 0.0].map(|x| if x > 0.0 { Vec3::new(x, 0.0, 7.0) } else { Vec3::ZERO });
    assert_eq!(picture.rgb[23..28], expected);
    assert_eq!(picture, read_photo(&path).unwrap());
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
    lamp[4 * 16] = Vec3::ONE;
    write(&path, (16, 8), &lamp);
    for (turn, side) in [(90.0, Vec3::X), (-90.0, Vec3::NEG_X), (450.0, Vec3::X)] {
        let options = SequenceOptions { turn, ..SequenceOptions::default() };
        let turned = ProbeSequence::open(&path, &options).unwrap().frame(25).unwrap();
        assert!(turned.sample(side).x > 0.2 && turned.sample(-side).x == 0.0 && turned.sample(Vec3::Z).x == 0.0);
    }
    // Three texels in 99 frames, which come to 3.0000000000000004: nothing leaks into the texel beside the lamp.
    let options = SequenceOptions { turn: 22.5 * 3.0 * 25.0 / 99.0, ..SequenceOptions::default() };
    let turned = ProbeSequence::open(&path, &options).unwrap().frame(99).unwrap();
    let lit: Vec<usize> = (0..128).filter(|&index| turned.radiance[index] != Vec3::ZERO).collect();
    assert_eq!((lit, turned.radiance[4 * 16 + 13]), (vec![4 * 16 + 13], Vec3::ONE));
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
    // Two sequences with an end: that of the one that ends first.
    for name in ["t.5.exr", "t.6.exr"] {
        write(&at(name), (8, 4), &[Vec3::ZERO; 32]);
    }
    assert_eq!(ProbeSequence::open(&at("s.#.exr"), &fade("t.#.exr", 4..=6)).unwrap().frames(), Some(4..=6));
    // Another size, of one file and of several: brought to the first's with its light, and turned along.
    let enlarged = uneven(5).iter().flat_map(|&v| [v; 4]).collect::<Vec<_>>();
    for name in ["large.exr", "large.0.exr", "large.1.exr", "large.2.exr"] {
        write(&at(name), (32, 16), &enlarged);
    }
    let large = SequenceOptions { height: Some(4), ..SequenceOptions::default() };
    let mut large = ProbeSequence::open(&at("large.exr"), &large).unwrap().frame(0).unwrap();
    large.radiance.chunks_exact_mut(8).for_each(|row| row.rotate_left(1));
    let halfway: Vec<Vec3> = large.radiance.iter().map(|texel| Vec3::ONE.lerp(*texel, 0.5)).collect();
    for (to, frames, expected) in [
        ("large.exr", 0..=2, &halfway),
        ("large.#.exr", 0..=2, &halfway),
        ("large.exr", 0..=1, &large.radiance),
        ("large.#.exr", 0..=1, &large.radiance),
    ] {
        let options = SequenceOptions { turn: 45.0, rate: 1.0, ..fade(to, frames) };
        let mixed = ProbeSequence::open(&at("a.exr"), &options).unwrap().frame(1).unwrap();
        assert_eq!((mixed.width, mixed.height, &mixed.radiance), (8, 4, expected), "{to}");
    }
}
