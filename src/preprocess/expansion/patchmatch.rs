//! Nearest neighbour fields between two images by the generalised PatchMatch of Barnes, Shechtman, Goldman and
//! Finkelstein, "The Generalized PatchMatch Correspondence Algorithm", 2010: for every pixel the place, angle and scale
//! at which the other image looks most alike, found by random guesses that spread to neighbours.
//!
//! Two things differ from the paper, both for what is over-exposed. A patch is compared on its own level of an image
//! pyramid and on all coarser ones, because the inside of a clipped lamp looks like the inside of a clipped window, and
//! only what surrounds them tells which is which. And only pixels that are asked for are matched.
//!
//! Parallel and yet always the same: rows are worked on in bands of fixed height; inside of a band matches spread in
//! scan order, across its borders from the pass before; every guess has its own random number by its place.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec4};
use rayon::prelude::*;

use super::pyramid::{Level, Pyramid};

/// Half the side of a patch, without its centre: 7 x 7 pixels.
pub const RADIUS: i32 = 3;
/// Side of a patch.
pub const SIDE: usize = 2 * RADIUS as usize + 1;
/// Rows that one task works on.
const BAND: usize = 16;
/// The finest levels, this many, hold nearly all pixels and start from what coarser ones found: one pass, guesses near by,
/// and none for flat patches.
const FINE_LEVELS: usize = 2;
/// First window of guesses on them, as a share of the second image.
const NEAR: f32 = 1.0 / 16.0;
/// Patches whose texels differ by less than this tell nothing about where they belong: they follow the coarser level and
/// their neighbours.
const FLAT: f32 = 1e-3;
/// What a level counts for against the next finer one.
const CONTEXT: f32 = 0.7;
/// What it costs where all of the other patch is unknown, as beyond the edge of a photo; less where less is.
const UNKNOWN: f32 = 0.5;
/// Share of a patch that must be valid on both sides.
const LEAST_VALID: f32 = 0.4;
/// What a match costs that cannot be.
const NONE: f32 = f32::INFINITY;

/// How to search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Scales from 1 / this to this are tried, at most 2.
    pub largest_scale: f32,
    /// Passes over a level.
    pub passes: u32,
    /// Random guesses a pixel on the coarsest level, which has nothing to start from.
    pub first_guesses: u32,
    /// Seed of all guesses.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self { largest_scale: 2.0, passes: 3, first_guesses: 512, seed: 1 }
    }
}

/// Where a pixel of the first image is found in the second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Match {
    /// Pixel of the second image, (0, 0) in the centre of its first pixel.
    pub at: Vec2,
    /// Anticlockwise where y points up, radians, from -pi to pi.
    pub angle: f32,
    /// Pixels of the second image for one of the first, as a logarithm of base 2.
    pub log_scale: f32,
    /// Sum of squared differences over the 7 x 7 pixels (Sabbadin 2019, 4.1), the mean over the channels and over the
    /// pyramid's levels, of which each counts for 0.7 of the next finer one. What is invalid does not count. Infinite where
    /// nothing was found.
    pub cost: f32,
}

impl Match {
    /// The second image's step for one pixel to the right of the first.
    fn step(&self) -> Vec2 {
        Vec2::from_angle(self.angle) * self.log_scale.exp2()
    }
}

/// The nearest neighbour field.
#[derive(Clone, Debug)]
pub struct Field {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width * height` matches; those of pixels that were not asked for have an infinite cost.
    pub matches: Vec<Match>,
    /// Patches that were compared.
    pub compared: u64,
}

/// Finds the field of the first image's level 0, coarse to fine. `inner` of the first image are its pixels, from
/// `offset` on: what lies around them is context only. `wanted` has `inner.x * inner.y` flags.
pub fn search(
    (first, offset, inner): (&Pyramid, u32, (u32, u32)),
    second: &Pyramid,
    wanted: &[bool],
    options: &Options,
) -> Field {
    let coarsest = first.levels.len().min(second.levels.len()) - 1;
    let mut masks = vec![Mask { width: inner.0, height: inner.1, set: wanted.to_vec() }];
    for level in 0..coarsest {
        masks.push(masks[level].halved());
    }
    let mut field: Option<Vec<Match>> = None;
    let mut compared = 0;
    for level in (0..=coarsest).rev() {
        let mask = &masks[level];
        let offset = offset >> level;
        let weight_of = |n: usize| match mask.set[n] {
            true => {
                let (x, y) = (n as u32 % mask.width, n as u32 / mask.width);
                weight(first, (level, coarsest), x + offset, y + offset)
            }
            false => 0.0,
        };
        let weights = (0..mask.set.len()).into_par_iter().map(weight_of).collect();
        let is_searched = |n: usize| {
            let (x, y) = (n as u32 % mask.width, n as u32 / mask.width);
            mask.set[n]
                && (level >= FINE_LEVELS.min(coarsest) || !is_flat(&first.levels[level], x + offset, y + offset))
        };
        let searched = (0..mask.set.len()).into_par_iter().map(is_searched).collect();
        let task = Task { first, second, level, coarsest, offset, mask, searched, weights, options: *options };
        let mut matches = match field {
            None => task.guess(&mut compared),
            Some(above) => task.refine(&above, &masks[level + 1], &mut compared),
        };
        for pass in 0..if task.is_fine() { 1 } else { options.passes } {
            matches = task.pass(pass, &matches, &mut compared);
        }
        field = Some(matches);
    }
    Field { width: inner.0, height: inner.1, matches: field.unwrap_or_default(), compared }
}

/// Which pixels are asked for.
struct Mask {
    width: u32,
    height: u32,
    set: Vec<bool>,
}

impl Mask {
    fn has(&self, x: u32, y: u32) -> bool {
        x < self.width && y < self.height && self.set[(y * self.width + x) as usize]
    }

    /// A coarser pixel is asked for where one of its four is.
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let any = |n: u32| {
            let (x, y) = (2 * (n % width), 2 * (n / width));
            self.has(x, y) || self.has(x + 1, y) || self.has(x, y + 1) || self.has(x + 1, y + 1)
        };
        Self { width, height, set: (0..width * height).map(any).collect() }
    }
}

/// One level of the search.
struct Task<'a> {
    first: &'a Pyramid,
    second: &'a Pyramid,
    level: usize,
    coarsest: usize,
    /// Pixels of context before the first pixel, at this level.
    offset: u32,
    mask: &'a Mask,
    /// Those pixels of the mask whose patch tells more than the coarser level's did.
    searched: Vec<bool>,
    /// [`weight`] of every pixel that is asked for.
    weights: Vec<f32>,
    options: Options,
}

impl Task<'_> {
    /// Calls `f` for all wanted pixels of all rows in parallel; it gets (x, y, number of compared patches).
    fn for_each(&self, compared: &mut u64, f: impl Fn(u32, u32, &mut u64) -> Match + Sync) -> Vec<Match> {
        let mut matches = vec![Match { cost: NONE, ..Match::default() }; self.mask.set.len()];
        let width = self.mask.width as usize;
        let counts: Vec<u64> = matches
            .par_chunks_mut(width)
            .enumerate()
            .map(|(y, row)| {
                let mut count = 0;
                for (x, found) in row.iter_mut().enumerate().filter(|(x, _)| self.mask.set[y * width + x]) {
                    *found = f(x as u32, y as u32, &mut count);
                }
                count
            })
            .collect();
        *compared += counts.iter().sum::<u64>();
        matches
    }

    /// The best of many guesses.
    fn guess(&self, compared: &mut u64) -> Vec<Match> {
        self.for_each(compared, |x, y, count| {
            let mut random = self.random(x, y, u32::MAX);
            let mut best = Match { cost: NONE, ..Match::default() };
            for _ in 0..self.options.first_guesses {
                let level = &self.second.levels[self.level];
                let at = Vec2::new(random.next() * level.width as f32, random.next() * level.height as f32) - 0.5;
                let angle = (2.0 * random.next() - 1.0) * PI;
                let log_scale = (2.0 * random.next() - 1.0) * self.options.largest_scale.log2();
                self.take_better(x, y, Match { at, angle, log_scale, ..Match::default() }, &mut best, count);
            }
            best
        })
    }

    /// What the coarser level found, at twice the size.
    fn refine(&self, above: &[Match], mask: &Mask, compared: &mut u64) -> Vec<Match> {
        self.for_each(compared, |x, y, count| {
            let from = above[(y / 2 * mask.width + x / 2) as usize];
            // A pixel's centre lies a quarter of the coarser pixel away from its centre.
            let off = Vec2::new(x as f32, y as f32) * 0.5 + 0.25 - 0.5 - Vec2::new((x / 2) as f32, (y / 2) as f32);
            let at = (from.at + from.step().rotate(off) + 0.5) * 2.0 - 0.5;
            let level = &self.second.levels[self.level];
            let most = Vec2::new(level.width as f32, level.height as f32) - 0.5;
            let at = at.clamp(Vec2::splat(-0.5), most);
            let mut best = Match { cost: NONE, ..Match::default() };
            self.take_better(x, y, Match { at, ..from }, &mut best, count);
            best
        })
    }

    /// Matches spread to neighbours, then are bettered by guesses around them. Even passes go down, odd ones up.
    fn pass(&self, pass: u32, before: &[Match], compared: &mut u64) -> Vec<Match> {
        let mut after = before.to_vec();
        let width = self.mask.width as usize;
        let counts: Vec<u64> = after
            .par_chunks_mut(BAND * width)
            .enumerate()
            .map(|(band, rows)| {
                let mut count = 0;
                let top = band * BAND;
                let back = pass % 2 == 1;
                let size = rows.len();
                for n in 0..size {
                    let n = if back { size - 1 - n } else { n };
                    let (x, y) = (n % width, top + n / width);
                    if !self.mask.set[y * width + x] {
                        continue;
                    }
                    let mut best = rows[n];
                    // (neighbour, step from it to here)
                    let sideways = if back { (x + 1 < width).then_some(n + 1) } else { (x > 0).then(|| n - 1) };
                    let along = if back { n + width } else { n.wrapping_sub(width) };
                    let step = if back { -1.0 } else { 1.0 };
                    if let Some(near) = sideways {
                        self.spread(x, y, (rows[near], Vec2::new(step, 0.0)), &mut best, &mut count);
                    }
                    let near = rows.get(along).copied().or_else(|| {
                        // In the next band, as it was before this pass.
                        let row = if back { y + 1 } else { y.wrapping_sub(1) };
                        before.get(row.wrapping_mul(width).wrapping_add(x)).copied()
                    });
                    if let Some(near) = near {
                        self.spread(x, y, (near, Vec2::new(0.0, step)), &mut best, &mut count);
                    }
                    if self.searched[y * width + x] {
                        self.guess_around(x, y, pass, &mut best, &mut count);
                    }
                    rows[n] = best;
                }
                count
            })
            .collect();
        *compared += counts.iter().sum::<u64>();
        after
    }

    fn is_fine(&self) -> bool {
        self.level < FINE_LEVELS.min(self.coarsest)
    }

    fn spread(&self, x: usize, y: usize, (near, step): (Match, Vec2), best: &mut Match, count: &mut u64) {
        if near.cost < NONE {
            let at = near.at + near.step().rotate(step);
            self.take_better(x as u32, y as u32, Match { at, ..near }, best, count);
        }
    }

    /// Guesses in windows that shrink by half, in all four dimensions at once (Barnes 2010, 3.2).
    fn guess_around(&self, x: usize, y: usize, pass: u32, best: &mut Match, count: &mut u64) {
        let mut random = self.random(x as u32, y as u32, pass);
        let level = &self.second.levels[self.level];
        let all = level.width.max(level.height) as f32;
        let most = self.options.largest_scale.log2();
        let mut share = if self.is_fine() { NEAR } else { 1.0 };
        while share * all > 0.2 {
            let mut around = |reach: f32| (2.0 * random.next() - 1.0) * reach * share;
            let at = best.at + Vec2::new(around(all), around(all));
            let angle = best.angle + around(PI);
            let log_scale = (best.log_scale + around(2.0 * most)).clamp(-most, most);
            let angle = angle - TAU * (angle / TAU).round();
            self.take_better(x as u32, y as u32, Match { at, angle, log_scale, ..Match::default() }, best, count);
            share *= 0.5;
        }
    }

    fn random(&self, x: u32, y: u32, pass: u32) -> Random {
        let place = u64::from(y) << 32 | u64::from(x);
        Random(mix(mix(self.options.seed ^ (self.level as u64) << 48 ^ u64::from(pass)).wrapping_add(place)))
    }

    fn take_better(&self, x: u32, y: u32, guess: Match, best: &mut Match, count: &mut u64) {
        if self.second.levels[self.level].holds(guess.at) {
            *count += 1;
            let found = self.difference(x, y, guess, best.cost);
            if found.cost < best.cost {
                *best = found;
            }
        }
    }

    /// Calls `f` with the texels of both patches of one level, row by row.
    #[inline(always)]
    fn walk(&self, (x, y): (u32, u32), guess: &Match, step: Vec2, level: usize, mut f: impl FnMut(Vec4, Vec4)) {
        let scale = 1.0 / (1u32 << (level - self.level)) as f32;
        let here = (Vec2::new((x + self.offset) as f32, (y + self.offset) as f32) + 0.5) * scale;
        // The first image's patch lies on texels, a little beside the pixel on coarser levels; so must the second's.
        let (column, row) = (here.x as i32, here.y as i32);
        let beside = Vec2::new(column as f32 + 0.5, row as f32 + 0.5) - here;
        let down = step.perp();
        let centre = (guess.at + 0.5) * scale - 0.5 + step.rotate(beside);
        let (first, second) = (&self.first.levels[level], &self.second.levels[level]);
        for dy in -RADIUS..=RADIUS {
            let texels = first.row(column - RADIUS, row + dy, SIDE);
            let start = centre + down * dy as f32 - step * RADIUS as f32;
            second.samples(start, step, SIDE, |n, sample| f(texels[n], sample));
        }
    }

    /// What a level of the pyramid counts for.
    fn share(&self, level: usize) -> f32 {
        CONTEXT.powi((level - self.level) as i32)
    }

    /// A guess with its cost. Coarse levels first: most guesses end there.
    fn difference(&self, x: u32, y: u32, guess: Match, most: f32) -> Match {
        let whole = self.weights[(y * self.mask.width + x) as usize];
        let step = guess.step();
        let texels = (3 * SIDE * SIDE) as f32;
        // Whatever is not valid can only make the mean larger.
        let (mut sum, mut weight, limit) = (0.0, 0.0, most * 3.0 * whole);
        for level in (self.level..=self.coarsest).rev() {
            let (mut total, mut valid) = (Vec4::ZERO, 0.0);
            self.walk((x, y), &guess, step, level, |a, b| {
                let both = a.w * b.w;
                let difference = a - b;
                total += difference * difference * both;
                valid += both;
            });
            sum += (total.x + total.y + total.z) * self.share(level);
            weight += valid * self.share(level);
            if sum >= limit {
                return Match { cost: NONE, ..guess };
            }
        }
        let share = 3.0 * weight / (texels * whole);
        if share < LEAST_VALID {
            return Match { cost: NONE, ..guess };
        }
        let cost = sum / (3.0 * whole * share) + UNKNOWN * (1.0 - share).max(0.0);
        Match { cost, ..guess }
    }
}

/// Sum of the validity of a pixel's patches on all its levels, in patches: what differences are divided by.
fn weight(first: &Pyramid, (level, coarsest): (usize, usize), x: u32, y: u32) -> f32 {
    let of_level = |j: usize| {
        let shrink = j - level;
        let (column, row) = ((x >> shrink) as i32, (y >> shrink) as i32);
        let texels = (-RADIUS..=RADIUS).flat_map(|dy| first.levels[j].row(column - RADIUS, row + dy, SIDE));
        texels.map(|texel| texel.w).sum::<f32>() * CONTEXT.powi(shrink as i32)
    };
    (level..=coarsest).map(of_level).sum::<f32>() / (SIDE * SIDE) as f32
}

/// True where all texels of a patch are alike.
fn is_flat(level: &Level, x: u32, y: u32) -> bool {
    let (column, row) = (x as i32, y as i32);
    let middle = level.texel(column, row);
    let texels = (-RADIUS..=RADIUS).flat_map(|dy| level.row(column - RADIUS, row + dy, SIDE));
    texels.into_iter().all(|texel| (*texel - middle).abs().max_element() < FLAT)
}

/// Numbers from 0 to 1 (Vigna's SplitMix64, 2015).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        (mix(self.0) >> 40) as f32 / (1u32 << 24) as f32
    }
}

/// A number that looks random for every number.
fn mix(mut z: u64) -> u64 {
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}
