//! The Poisson fill (Sabbadin 2019, 4.2): known fields come back, Eqs. 2 and 3 hold, and no input makes a NaN.

use std::sync::Mutex;

use glam::{DVec3, Vec3, vec3};
use rayon::ThreadPoolBuilder;
use relume::Error;
use relume::preprocess::expansion::Transfer;
use relume::preprocess::expansion::poisson::{DEFAULT_NEIGHBOURS, PoissonReport, Problem, solve};

/// Numbers from 0 to 1, the same every time (Knuth's linear congruential generator).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }
}

/// A cloud, its two colours a point and what is unknown of the second.
#[derive(Clone)]
struct Scene {
    positions: Vec<Vec3>,
    low: Vec<Vec3>,
    high: Vec<Vec3>,
    unknown: Vec<bool>,
}

impl Scene {
    /// A wavy sheet of `side` x `side` scattered points over a square of one metre, with the same LDR grey everywhere.
    fn sheet(side: usize, high: impl Fn(Vec3) -> Vec3, unknown: impl Fn(Vec3) -> bool) -> Self {
        let mut random = Random(2019);
        let mut place = |at: usize| (at as f32 + 0.9 * random.next()) / side as f32;
        let positions: Vec<Vec3> = (0..side * side)
            .map(|at| {
                let (x, z) = (place(at % side), place(at / side));
                vec3(x, 0.05 * (6.0 * x).sin(), z)
            })
            .collect();
        Self {
            low: vec![Vec3::splat(0.5); positions.len()],
            high: positions.iter().map(|&p| high(p)).collect(),
            unknown: positions.iter().map(|&p| unknown(p)).collect(),
            positions,
        }
    }

    /// The same with other LDR colours.
    fn with_low(mut self, low: impl Fn(Vec3) -> Vec3) -> Self {
        self.low = self.positions.iter().map(|&p| low(p)).collect();
        self
    }

    /// `high` with unknown colours that would show if they were looked at, solved.
    fn try_solve(&self, transfer: Transfer) -> relume::Result<(Vec<Vec3>, PoissonReport)> {
        let mut high = self.high.clone();
        high.iter_mut().zip(&self.unknown).filter(|(_, unknown)| **unknown).for_each(|(high, _)| *high = Vec3::NAN);
        let report = solve(&self.problem(), transfer, &mut high, &|_| {})?;
        Ok((high, report))
    }

    fn solve(&self, transfer: Transfer) -> (Vec<Vec3>, PoissonReport) {
        let (high, report) = self.try_solve(transfer).expect("a solution");
        assert!(high.iter().all(|color| color.is_finite() && color.min_element() >= 0.0), "{report:?}");
        assert_eq!(report.unknowns, self.unknown.iter().filter(|&&unknown| unknown).count());
        assert!(report.residual < 1e-6, "{report:?}");
        for (point, color) in high.iter().enumerate().filter(|(point, _)| !self.unknown[*point]) {
            assert_eq!(*color, self.high[point], "the known point {point} has changed");
        }
        (high, report)
    }

    fn problem(&self) -> Problem<'_> {
        let (positions, low, unknown) = (&self.positions, &self.low, &self.unknown);
        Problem { positions, low, unknown, silent: &[], neighbours: DEFAULT_NEIGHBOURS }
    }

    fn unknowns(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.unknown.len()).filter(|&point| self.unknown[point])
    }

    /// Root mean square of the difference to the true `high` over the unknown points, over the range of the true ones.
    fn relative_rms(&self, found: &[Vec3]) -> f64 {
        let squares: f64 = self.unknowns().map(|p| (found[p] - self.high[p]).as_dvec3().length_squared()).sum();
        let (low, high) = range(&self.high);
        (squares / 3.0 / self.unknowns().count() as f64).sqrt() / f64::from((high - low).max_element())
    }
}

/// Least and greatest value of each channel.
fn range(colors: &[Vec3]) -> (Vec3, Vec3) {
    colors.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &c| (low.min(c), high.max(c)))
}

/// Radiances from 1 to 9, smooth, another one in each channel.
fn smooth(p: Vec3) -> Vec3 {
    let wave = (3.0 * p.x).sin() * (4.0 * p.z).cos();
    Vec3::splat(5.0) + vec3(3.0 * wave, 4.0 * (2.0 * p.x - p.z).sin(), 2.0 * wave + 2.0 * p.x)
}

/// Seven holes, the largest of them 14 cm wide, so that the field is nearly harmonic within, and one point in twenty.
fn holes(p: Vec3) -> bool {
    let hole = |i: usize| {
        let at = vec3((0.37 * i as f32).fract() * 0.8 + 0.1, p.y, (0.61 * i as f32).fract() * 0.8 + 0.1);
        p.distance(at) < 0.07 / (1.0 + 0.3 * i as f32)
    };
    (0..7).any(hole) || (p.x * 7919.0).fract() < 0.05
}

/// A hole in the middle.
fn middle(p: Vec3) -> bool {
    vec3(p.x - 0.5, 0.0, p.z - 0.5).length() < 0.3
}

/// Eq. 2 as it stands, with H and L, solved by Gauss and Seidel over neighbours found by looking at all points.
/// Neighbours of unknown points are mutual, as in `solve`.
fn reference(scene: &Scene, k: usize) -> Vec<DVec3> {
    let points = scene.positions.len();
    let mut edges = vec![Vec::new(); points];
    for p in scene.unknowns() {
        let distance = |q: usize| (scene.positions[p].as_dvec3() - scene.positions[q].as_dvec3()).length_squared();
        let mut others: Vec<usize> = (0..points).filter(|&q| q != p).collect();
        others.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)));
        for &q in &others[..k] {
            edges[p].push(q);
            if scene.unknown[q] {
                edges[q].push(p);
            }
        }
    }
    for around in &mut edges {
        around.sort_unstable();
        around.dedup();
    }
    let low = |p: usize| scene.low[p].as_dvec3();
    let start = |p: usize| if scene.unknown[p] { DVec3::ZERO } else { scene.high[p].as_dvec3() };
    let mut high: Vec<DVec3> = (0..points).map(start).collect();
    for _ in 0..20_000 {
        for p in scene.unknowns() {
            let sum: DVec3 = edges[p].iter().map(|&q| high[q] + low(p) - low(q)).sum();
            high[p] = sum / edges[p].len() as f64;
        }
    }
    high
}

#[test]
fn a_smooth_field_comes_back_in_the_holes() {
    // LDR colours without gradients, clipped ones, and such as have the field's own gradients.
    let scene = Scene::sheet(200, smooth, holes);
    let flat = scene.solve(Transfer::Rgb);
    let clipped = scene.clone().with_low(|p| smooth(p).min(Vec3::ONE)).solve(Transfer::Rgb);
    let equal = scene.clone().with_low(|p| 0.25 * smooth(p)).solve(Transfer::Rgb);
    let exact = scene.clone().with_low(|p| smooth(p) - 1.0).solve(Transfer::Rgb);
    for (name, (high, report), most) in
        [("flat", flat, 0.01), ("clipped", clipped, 0.01), ("a quarter", equal, 0.01), ("exact", exact, 1e-6)]
    {
        let error = scene.relative_rms(&high);
        println!("{name}: {} unknowns in {} parts, error {error:.2e}", report.unknowns, report.components);
        assert!(error < most, "{name}: {error}");
        assert!(report.filled.is_empty(), "{name}");
    }
}

#[test]
fn luminance_alone_keeps_the_ldr_hue() {
    let tint = vec3(0.9, 0.5, 0.2);
    let gray = |p: Vec3| Vec3::splat(smooth(p).x);
    let scene = Scene::sheet(120, |p| gray(p) * tint, holes).with_low(|_| 0.5 * tint);
    let (high, _) = scene.solve(Transfer::Luminance);
    let error = scene.relative_rms(&high);
    assert!(error < 0.01, "{error}");

    // Black has no hue: grey of the luminance around.
    let white = Scene::sheet(60, gray, middle);
    let black = white.clone().with_low(|p| if middle(p) { Vec3::ZERO } else { Vec3::splat(0.5) });
    let (high, _) = black.solve(Transfer::Luminance);
    assert!(black.unknowns().all(|p| high[p].x == high[p].y && high[p].y == high[p].z), "not grey");
    assert!(black.unknowns().any(|p| high[p].x > 1.0));
}

#[test]
fn without_gradients_it_is_harmonic() {
    let scene = Scene::sheet(120, |p| 10.0 * smooth(p), middle);
    let (high, report) = scene.solve(Transfer::Rgb);
    assert_eq!(report.clamped, 0);
    let near = |p: Vec3| vec3(p.x - 0.5, 0.0, p.z - 0.5).length() < 0.4;
    let rim: Vec<Vec3> =
        (0..high.len()).filter(|&p| !middle(scene.positions[p]) && near(scene.positions[p])).map(|p| high[p]).collect();
    let (least, most) = range(&rim);
    for p in scene.unknowns() {
        assert!(high[p].cmpge(least).all() && high[p].cmple(most).all(), "{} at {}", high[p], scene.positions[p]);
    }
    // A linear field is harmonic; the scattered points leave a little.
    let linear = Scene::sheet(120, |p| Vec3::splat(2.0) + vec3(p.x, p.z, p.x - p.z), middle);
    let error = linear.relative_rms(&linear.solve(Transfer::Rgb).0);
    assert!(error < 0.01, "{error}");
}

#[test]
fn it_solves_equation_2_as_a_plain_solver_does() {
    let low = |p: Vec3| Vec3::splat(0.5) + 0.4 * vec3((40.0 * p.x).sin(), (50.0 * p.z).cos(), (30.0 * p.x * p.z).sin());
    let scene = Scene::sheet(30, smooth, middle).with_low(low);
    let expected = reference(&scene, DEFAULT_NEIGHBOURS);
    let (high, report) = scene.solve(Transfer::Rgb);
    assert!(report.unknowns > 200, "{}", report.unknowns);
    for p in scene.unknowns() {
        let error = (high[p].as_dvec3() - expected[p]).abs().max_element();
        assert!(error < 1e-5, "point {p}: {} instead of {}", high[p], expected[p]);
    }
}

#[test]
fn two_hundred_thousand_unknowns_take_few_iterations() {
    // Nothing but the rim is known: the worst case for an iterative solver.
    let inside = |x: f32| (0.01..0.99).contains(&x);
    let scene = Scene::sheet(457, |p| Vec3::splat(2.0) + vec3(p.x, p.z, p.x - p.z), |p| inside(p.x) && inside(p.z));
    let (high, report) = scene.solve(Transfer::Rgb);
    println!("{} unknowns, {} iterations, residual {:.1e}", report.unknowns, report.iterations, report.residual);
    assert!(report.unknowns > 195_000, "{}", report.unknowns);
    assert!(report.iterations <= 40, "{}", report.iterations);
    let error = scene.relative_rms(&high);
    assert!(error < 0.01, "{error}");
}

#[test]
fn one_known_point_lights_the_whole_cloud() {
    let first = Scene::sheet(150, |_| Vec3::splat(7.5), |_| true);
    let mut scene = first.clone();
    scene.unknown[75] = false;
    let (high, report) = scene.solve(Transfer::Rgb);
    assert_eq!((report.components, report.filled.len(), report.iterations), (1, 0, 0));
    assert!(high.iter().all(|color| (*color - 7.5).abs().max_element() < 1e-5), "{:?}", range(&high));
}

#[test]
fn threads_change_no_byte() {
    let scene = Scene::sheet(200, smooth, middle).with_low(|p| smooth(p).min(Vec3::ONE));
    for transfer in [Transfer::Rgb, Transfer::Luminance] {
        let with = |threads: usize| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
            let (high, report) = pool.install(|| scene.solve(transfer));
            (high, PoissonReport { seconds: Vec::new(), ..report })
        };
        let one = with(1);
        assert!(one == with(2) && one == with(5), "{transfer:?}");
    }
}

#[test]
fn sparse_and_dense_regions_find_their_neighbours() {
    // Next to a fine patch a sheet so coarse that cubes which suit the patch hold none of a point's neighbours.
    let rest = Scene::sheet(14, |p| Vec3::splat(2.0) + vec3(p.x, p.z, 1.0), middle);
    let mut scene = rest.clone();
    let patch = Scene::sheet(200, |_| Vec3::splat(3.0), |p| p.x > 0.5);
    scene.positions.extend(patch.positions.iter().map(|p| 1e-3 * *p + vec3(1.1, 0.0, 0.0)));
    scene.low.extend(&patch.low);
    scene.high.extend(&patch.high);
    scene.unknown.extend(&patch.unknown);
    let ((together, _), (alone, _)) = (scene.solve(Transfer::Rgb), rest.solve(Transfer::Rgb));
    for p in rest.unknowns() {
        assert!((together[p] - alone[p]).abs().max_element() < 1e-5, "point {p}");
    }
    let error = scene.unknowns().skip_while(|&p| p < rest.positions.len()).map(|p| (together[p].x - 3.0).abs());
    assert!(error.fold(0.0, f32::max) < 1e-3);
}

#[test]
fn copies_of_a_point_count_once() {
    let single = Scene::sheet(60, smooth, middle);
    let (expected, _) = single.solve(Transfer::Rgb);
    let mut scene = single.clone();
    for _ in 1..20 {
        scene.positions.extend(&single.positions);
        scene.low.extend(&single.low);
        scene.high.extend(&single.high);
        scene.unknown.extend(&single.unknown);
    }
    let (found, report) = scene.solve(Transfer::Rgb);
    assert!(report.filled.is_empty());
    for (p, color) in found.iter().enumerate() {
        let once = expected[p % expected.len()];
        assert!((*color - once).abs().max_element() < 1e-5, "point {p}: {color} instead of {once}");
    }
    // A known copy settles its unknown ones, each with its own LDR colour.
    let center = single.unknowns().next().expect("an unknown point");
    let mut scene = single.clone();
    scene.positions.extend([single.positions[center]; 2]);
    scene.low.extend([Vec3::splat(0.25), Vec3::splat(0.5)]);
    scene.high.extend([Vec3::ZERO, Vec3::splat(8.0)]);
    scene.unknown.extend([true, false]);
    let (found, _) = scene.solve(Transfer::Rgb);
    assert_eq!((found[center], found[single.positions.len()]), (Vec3::splat(8.0), Vec3::splat(7.75)));
}

#[test]
fn a_part_without_known_neighbours_keeps_its_ldr_colours() {
    let mut scene = Scene::sheet(60, smooth, middle);
    let island = Scene::sheet(10, |_| Vec3::splat(9.0), |_| true);
    let shore = scene.positions.len();
    scene.positions.extend(island.positions.iter().map(|p| *p + vec3(50.0, 0.0, 0.0)));
    scene.low.extend(island.positions.iter().map(|p| vec3(p.x, 0.5, p.z)));
    scene.high.extend(&island.high);
    scene.unknown.extend(&island.unknown);
    for transfer in [Transfer::Rgb, Transfer::Luminance] {
        let (high, report) = scene.solve(transfer);
        assert_eq!(report.components, 2);
        assert!(report.filled.iter().copied().eq(shore as u32..scene.positions.len() as u32));
        assert_eq!(high[shore..], scene.low[shore..]);
        assert!(scene.unknowns().take(10).all(|p| high[p].x > 1.0));
    }
}

#[test]
fn what_would_be_negative_is_zero() {
    // The LDR colours fall by 5 towards the middle of a hole in HDR colours of 1.
    let scene = Scene::sheet(60, |_| Vec3::ONE, middle).with_low(|p| Vec3::splat(if middle(p) { 1.0 } else { 6.0 }));
    let (high, report) = scene.solve(Transfer::Rgb);
    let zeros = scene.unknowns().filter(|&p| high[p] == Vec3::ZERO).count();
    assert!(report.clamped > 100 && zeros == report.clamped, "{} clamped, {zeros} zeros", report.clamped);
}

#[test]
fn extreme_values_stay_finite() {
    let scene = Scene::sheet(40, smooth, middle);
    for (scale, offset, light) in [
        (1e12, 1e12, 1e15),
        (1e15, 0.0, 1.0),
        (1e-30, 0.0, 1e-30),
        (1e-3, 1e9, 1e15),
        (0.0, 1.0, 1e15),
        (1.0, 0.0, f32::MIN_POSITIVE),
    ] {
        let mut scene = scene.clone();
        scene
            .positions
            .iter_mut()
            .for_each(|p| *p = (*p * scale + offset).clamp(Vec3::splat(-1e15), Vec3::splat(1e15)));
        scene.high.iter_mut().for_each(|color| *color = *color * 0.1 * light);
        for transfer in [Transfer::Rgb, Transfer::Luminance] {
            scene.solve(transfer);
        }
        // One point very far from all others, as the first and as the last.
        scene.positions[0] = Vec3::splat(-1e15);
        scene.solve(Transfer::Rgb);
        scene.unknown[0] = true;
        scene.positions.reverse();
        scene.unknown.reverse();
        scene.high.reverse();
        scene.solve(Transfer::Luminance);
    }
}

#[test]
fn the_smallest_clouds_work() {
    let whole = Scene::sheet(20, smooth, |_| true);
    let (high, report) = whole.solve(Transfer::Rgb);
    assert_eq!((high, report.filled.len(), report.components), (whole.low.clone(), 400, 1));
    let known = Scene::sheet(20, smooth, |_| false);
    let (high, report) = known.solve(Transfer::Luminance);
    assert_eq!((high, report.components, report.iterations), (known.high.clone(), 0, 0));

    let point = |unknown: &[bool]| Scene {
        positions: (0..unknown.len()).map(|i| Vec3::X * i as f32).collect(),
        low: vec![Vec3::splat(0.5); unknown.len()],
        high: vec![Vec3::splat(2.0); unknown.len()],
        unknown: unknown.to_vec(),
    };
    for (unknown, expected) in [
        (&[][..], &[][..]),
        (&[false], &[2.0]),
        (&[true], &[0.5]),
        (&[true, false], &[2.0, 2.0]),
        (&[true, false, true], &[2.0, 2.0, 2.0]),
    ] {
        for transfer in [Transfer::Rgb, Transfer::Luminance] {
            let (high, _) = point(unknown).solve(transfer);
            assert_eq!(high.len(), expected.len());
            assert!(
                high.iter().zip(expected).all(|(a, b)| (*a - *b).abs().max_element() < 1e-6),
                "{unknown:?}: {high:?}"
            );
        }
    }
}

#[test]
fn wrong_arguments_are_refused_in_one_line() {
    let good = Scene::sheet(10, smooth, middle);
    let refuse = |change: &dyn Fn(&mut Scene), neighbours: usize, part: &str| {
        let mut scene = good.clone();
        change(&mut scene);
        let mut high = scene.high.clone();
        let problem = Problem { neighbours, ..scene.problem() };
        match solve(&problem, Transfer::Rgb, &mut high, &|_| {}) {
            Err(Error::Argument(line)) => assert!(line.contains(part) && !line.contains('\n'), "{line}"),
            other => panic!("{part}: {other:?}"),
        }
        assert!(
            high.iter().zip(&scene.high).all(|(a, b)| a.to_array().map(f32::to_bits) == b.to_array().map(f32::to_bits))
        );
    };
    refuse(&|scene| scene.low.truncate(99), 16, "99 LDR colours for 100 points");
    refuse(&|scene| scene.high.truncate(99), 16, "99 HDR colours for 100 points");
    refuse(&|scene| scene.unknown.truncate(99), 16, "99 unknown flags for 100 points");
    refuse(&|scene| scene.positions[5].y = f32::NAN, 16, "position of point 5");
    refuse(&|scene| scene.positions[5].y = 2e15, 16, "position of point 5");
    refuse(&|scene| scene.low[7].x = f32::INFINITY, 16, "LDR colour of point 7");
    refuse(&|scene| scene.high[0].z = -f32::INFINITY, 16, "HDR colour of point 0");
    refuse(&|_| {}, 0, "0 neighbours");
    refuse(&|_| {}, usize::MAX, "give 1 to 64");
}

#[test]
fn progress_goes_up_to_one() {
    let scene = Scene::sheet(100, smooth, holes);
    let heard = Mutex::new(Vec::new());
    let mut high = scene.high.clone();
    let listen = |part: f32| heard.lock().expect("no panic before").push(part);
    solve(&scene.problem(), Transfer::Rgb, &mut high, &listen).expect("a solution");
    let heard = heard.into_inner().expect("no panic before");
    assert!(heard.len() > 5 && heard.is_sorted() && heard[0] >= 0.0 && heard.last() == Some(&1.0), "{heard:?}");
}
