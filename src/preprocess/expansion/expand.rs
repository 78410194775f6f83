//! All steps of an expansion, in order.

use std::time::Instant;

use glam::{UVec2, Vec2, Vec3};
use rayon::prelude::*;

use super::matching::{self, Exposed};
use super::network::Network;
use super::poisson::{self, Problem};
use super::reprojection::{Expanded, Gathered};
use super::scouts::Scouts;
use super::shots::Shot;
use super::tone::{self, Banterle, Landis};
use super::{
    Expansion, Inputs, Options, Origin, Places, Report, ShotPictures, Strategy, Transfer, exposure, places,
    registration,
};
use crate::compare::luminance;
use crate::scene::Picture;
use crate::{Error, Result};

/// Faces of the pictures are no larger than this.
const PICTURE_FACE: u32 = 512;
/// More of the over-exposed points than this share without a likeness in the photo deserve a warning.
const UNLIKE: f32 = 0.25;
/// More of them than this share in no shot deserve one too.
const UNSEEN: f32 = 0.25;
/// A photo whose brightest pixel is less than this many times the cloud's white can expand nothing.
const LEAST_RANGE: f32 = 1.5;
/// Exponent of Landis' ramp.
const LANDIS_ALPHA: f32 = 2.0;

/// Expands a cloud. `progress` hears the name of the step and its share that is done.
///
/// # Errors
/// [`Error::Argument`] where all points are over-exposed, where no shot sees any point, where PatchMatch has no photo, or
/// where the photo is black or smaller than a patch.
pub fn expand(inputs: Inputs, options: &Options, progress: &(dyn Fn(&'static str, f32) + Sync)) -> Result<Expansion> {
    let mut run = Run { inputs, options, progress, report: Report::default(), pictures: Vec::new() };
    run.report.points = inputs.cloud.len();
    let over: Vec<bool> = inputs.cloud.colors.iter().map(|&c| luminance(c) > options.threshold).collect();
    run.report.over_exposed = over.iter().filter(|over| **over).count();
    run.check()?;
    let mut expansion = Expansion {
        colors: inputs.cloud.colors.clone(),
        origins: vec![Origin::Kept; over.len()],
        report: Report::default(),
        pictures: Vec::new(),
    };
    if run.report.over_exposed > 0 {
        run.expose()?;
        if options.strategy.takes_shots() {
            run.by_shots(&over, &mut expansion)?;
        } else {
            run.by_points(&over, &mut expansion);
        }
    }
    expansion.report = run.report;
    expansion.pictures = run.pictures;
    Ok(expansion)
}

struct Run<'a> {
    inputs: Inputs<'a>,
    options: &'a Options,
    progress: &'a (dyn Fn(&'static str, f32) + Sync),
    report: Report,
    pictures: Vec<ShotPictures>,
}

impl Run<'_> {
    fn check(&self) -> Result<()> {
        let wrong = |problem: String| Err(Error::Argument(problem));
        let Report { points, over_exposed, .. } = self.report;
        if points > 0 && over_exposed == points {
            return wrong(format!(
                "all {points} points are over-exposed (luminance above {}): none is left to tell the exposure by",
                self.options.threshold
            ));
        }
        let least = patch_side();
        match self.inputs.photo {
            None if self.options.strategy == Strategy::PatchMatch => {
                wrong("patchmatch needs an HDR photo; without one there are landis, banterle and network".into())
            }
            Some(photo) if photo.width < least || photo.height < least => wrong(format!(
                "the photo has {}x{} pixels; a patch alone has {least}x{least}",
                photo.width, photo.height
            )),
            Some(photo) if photo.rgb.iter().all(|&c| luminance(c) <= 0.0) => {
                wrong("the photo is all black: it tells nothing about light".into())
            }
            _ => Ok(()),
        }
    }

    /// Runs a step and notes its time.
    fn timed<T>(&mut self, name: &'static str, step: impl FnOnce(&mut Self) -> T) -> T {
        (self.progress)(name, 0.0);
        let start = Instant::now();
        let result = step(self);
        let seconds = start.elapsed().as_secs_f64();
        match self.report.seconds.iter_mut().find(|(other, _)| *other == name) {
            Some((_, sum)) => *sum += seconds,
            None => self.report.seconds.push((name, seconds)),
        }
        (self.progress)(name, 1.0);
        result
    }

    /// Histograms; the registration needs scouts and comes with them.
    fn expose(&mut self) -> Result<()> {
        let Some(photo) = self.inputs.photo else { return Ok(()) };
        if self.options.alpha.is_some() {
            self.report.alpha = self.options.alpha;
            return Ok(());
        }
        let exposure = self.timed("exposure", |run| exposure::match_histograms(photo, &run.inputs.cloud.colors));
        let exposure = exposure.ok_or_else(|| Error::Argument("the photo is all black".into()))?;
        self.report.alpha = Some(exposure.alpha);
        self.report.exposure = Some(exposure);
        let brightest = photo.rgb.iter().map(|c| c.max_element()).fold(0.0, f32::max);
        if brightest * self.report.alpha.unwrap_or(1.0) < LEAST_RANGE {
            self.report.warnings.push(format!(
                "the photo's brightest is {:.2} times the white of the cloud: it has no more range than the cloud",
                brightest * self.report.alpha.unwrap_or(1.0)
            ));
        }
        Ok(())
    }

    fn register(&mut self, scouts: &Scouts) {
        let Some(photo) = self.inputs.photo.filter(|_| self.options.alpha.is_none()) else { return };
        let found = self.timed("registration", |run| registration::register(run.inputs.cloud, scouts, photo));
        match found {
            Some(found) => self.report.alpha = Some(found.alpha),
            None => self.report.warnings.push(
                "the photo was not found in the cloud: its exposure is known from histograms alone, which may be off by \
                 a quarter where it shows brighter or darker parts than the cloud has"
                    .into(),
            ),
        }
        self.report.registration = found;
    }

    /// Luminance of what is brightest.
    fn maximum(&self) -> f32 {
        let brightest = |photo: &Picture| photo.rgb.iter().map(|&c| luminance(c)).fold(0.0, f32::max);
        let of_photo = self.inputs.photo.zip(self.report.alpha).map(|(photo, alpha)| brightest(photo) * alpha);
        of_photo.unwrap_or(self.options.maximum).max(1.0)
    }

    fn by_points(&mut self, over: &[bool], expansion: &mut Expansion) {
        if self.inputs.photo.is_some() {
            let scouts = self.timed("scouts", |run| Scouts::send(run.inputs.cloud));
            self.register(&scouts);
        }
        let maximum = self.maximum();
        let cloud = self.inputs.cloud;
        let points: Vec<u32> = (0..cloud.len() as u32).filter(|&n| over[n as usize]).collect();
        let luminances: Vec<f32> = cloud.colors.iter().map(|&c| luminance(c)).collect();
        let expanded = self.timed("expansion", |run| match run.options.strategy {
            Strategy::BanterlePoints => {
                tone::banterle(&cloud.positions, &luminances, &points, Banterle::with_maximum(maximum))
            }
            _ => tone::landis(&over_only(&luminances, &points), run.landis(maximum)),
        });
        for (&point, expanded) in points.iter().zip(expanded) {
            let point = point as usize;
            expansion.colors[point] *= expanded / luminances[point];
            expansion.origins[point] = Origin::Projected;
        }
    }

    fn landis(&self, maximum: f32) -> Landis {
        Landis { alpha: LANDIS_ALPHA, threshold: self.options.threshold, maximum }
    }

    fn by_shots(&mut self, over: &[bool], expansion: &mut Expansion) -> Result<()> {
        let cloud = self.inputs.cloud;
        let scouts = self.timed("scouts", |run| Scouts::send(run.inputs.cloud));
        self.register(&scouts);
        self.report.shots = match &self.options.places {
            Places::At(places) => places.clone(),
            Places::Auto(count) => self.timed("places", |run| places::choose(run.inputs.cloud, &scouts, over, *count)),
        };
        if self.report.shots.is_empty() {
            return Err(Error::Argument(
                "no place inside of the cloud sees an over-exposed point: give one by --shots X,Y,Z".into(),
            ));
        }
        drop(scouts);
        let own;
        let network = match (self.options.strategy, self.inputs.network) {
            (Strategy::Network, None) => {
                own = Network::built_in()?;
                Some(&own)
            }
            (_, given) => given,
        };
        let photo = self.inputs.photo.zip(self.report.alpha);
        let exposed = photo.map(|(photo, alpha)| Exposed::new(photo, alpha, self.options.shot_size));
        let mut gathered = Gathered::new(over);
        let mut costs = Vec::new();
        let count = self.report.shots.len();
        for index in 0..count {
            let eye = self.report.shots[index];
            let shot = self.timed("shots", |run| {
                let Options { shot_size, shots_by, .. } = *run.options;
                Shot::take(cloud, eye, shot_size, shots_by)
            });
            let faces =
                self.timed("expansion", |run| run.expand_shot(&shot, over, exposed.as_ref(), network, index))?;
            self.timed("projection", |_| gathered.add(cloud, &shot, &faces));
            costs.extend(faces.iter().flat_map(|face| face.costs.iter().copied().filter(|cost| cost.is_finite())));
            if self.options.pictures {
                self.pictures.push(shot_pictures(self.inputs, over, &shot, &faces));
            }
        }
        self.report.median_cost = median(costs);
        let (unseen, unmatched) = gathered.missing();
        (self.report.unseen, self.report.unmatched) = (unseen, unmatched);
        if unseen == self.report.over_exposed {
            return Err(Error::Argument(format!(
                "none of the {count} shots sees any of the {unseen} over-exposed points: they stand elsewhere, or inside of something"
            )));
        }
        self.warn();
        self.finish(over, &gathered, expansion)
    }

    fn warn(&mut self) {
        let Report { over_exposed, unseen, unmatched, .. } = self.report;
        let share = |part: usize, whole: usize| part as f32 / whole.max(1) as f32;
        if self.options.strategy == Strategy::PatchMatch && share(unmatched, over_exposed - unseen) > UNLIKE {
            let percent = 100.0 * share(unmatched, over_exposed - unseen);
            self.report.warnings.push(format!(
                "{percent:.0} % of the over-exposed points have no likeness in the photo: it does not show what they show, \
                 and they keep about the light of their surroundings; a photo with those lamps or windows would tell"
            ));
        }
        if share(unseen, over_exposed) > UNSEEN {
            let percent = 100.0 * share(unseen, over_exposed);
            self.report.warnings.push(format!(
                "{percent:.0} % of the over-exposed points are seen in no shot: more shots, or better places, would see them"
            ));
        }
    }

    /// What a point gets, and what its neighbours must tell.
    fn finish(&mut self, over: &[bool], gathered: &Gathered, expansion: &mut Expansion) -> Result<()> {
        let cloud = self.inputs.cloud;
        let transfer = if self.options.strategy.knows_colors() { self.options.transfer } else { Transfer::Luminance };
        let mut unknown = vec![false; cloud.len()];
        for (point, mean) in gathered.means() {
            let point = point as usize;
            let low = cloud.colors[point];
            match mean {
                Some(color) => {
                    expansion.origins[point] = Origin::Projected;
                    expansion.colors[point] = match transfer {
                        Transfer::Rgb => color,
                        Transfer::Luminance => low * (luminance(color) / luminance(low)),
                    };
                }
                None => unknown[point] = true,
            }
        }
        // Deviation from Sabbadin 2019, Eq. 2: well-exposed points are no boundary. The LDR gradient from a clipped point to
        // the wall beside it is not the HDR one, only a lower bound; a lamp's rim would come out at half of its light.
        let silent: Vec<bool> = over.iter().map(|over| !over).collect();
        let problem = Problem {
            positions: &cloud.positions,
            low: &cloud.colors,
            unknown: &unknown,
            silent: &silent,
            neighbours: self.options.neighbours,
        };
        let solved = self.timed("poisson", |run| {
            poisson::solve(&problem, transfer, &mut expansion.colors, &|done| (run.progress)("poisson", done))
        })?;
        for (origin, _) in expansion.origins.iter_mut().zip(&unknown).filter(|(_, unknown)| **unknown) {
            *origin = Origin::Solved;
        }
        for &point in &solved.filled {
            expansion.origins[point as usize] = Origin::Filled;
        }
        self.report.solved = solved.unknowns - solved.filled.len();
        self.report.filled = solved.filled.len();
        self.report.iterations = solved.iterations;
        self.report.residual = solved.residual;
        Ok(())
    }

    fn expand_shot(
        &mut self,
        shot: &Shot,
        over: &[bool],
        photo: Option<&Exposed>,
        network: Option<&Network>,
        index: usize,
    ) -> Result<Vec<Expanded>> {
        let maximum = self.maximum();
        let shots = self.report.shots.len();
        let mut faces = Vec::new();
        for face in 0..6 {
            (self.progress)("expansion", (index * 6 + face) as f32 / (6 * shots) as f32);
            let wanted = matching::wanted(shot, face, over);
            if !wanted.contains(&true) {
                faces.push(Expanded::nothing(wanted.len()));
                continue;
            }
            faces.push(match (self.options.strategy, photo, network) {
                (Strategy::PatchMatch, Some(photo), _) => {
                    let seed = self.options.seed.wrapping_add(6 * index as u64);
                    let threshold = self.options.match_threshold;
                    let (expanded, compared) =
                        matching::expand((self.inputs.cloud, shot, face), photo, &wanted, threshold, seed);
                    self.report.compared += compared;
                    expanded
                }
                (Strategy::Network, _, Some(network)) => {
                    let picture = self.face_picture(shot, face);
                    let colors = network.expand(&picture, Some(&wanted), &|_| ())?.rgb;
                    Expanded::equal(colors, &wanted)
                }
                _ => self.by_operator(shot, face, &wanted, maximum),
            });
        }
        Ok(faces)
    }

    /// A face in the cloud's colours; black where there is no point.
    fn face_picture(&self, shot: &Shot, face: usize) -> Picture {
        let color = |&point: &u32| self.inputs.cloud.colors.get(point as usize).copied().unwrap_or(Vec3::ZERO);
        let rgb = shot.faces[face].point.iter().map(color).collect();
        Picture { width: shot.size, height: shot.size, rgb }
    }

    fn by_operator(&self, shot: &Shot, face: usize, wanted: &[bool], maximum: f32) -> Expanded {
        let picture = self.face_picture(shot, face);
        let luminances: Vec<f32> = picture.rgb.iter().map(|&c| luminance(c)).collect();
        let pixels: Vec<u32> = (0..wanted.len() as u32).filter(|&n| wanted[n as usize]).collect();
        let expanded = match self.options.strategy {
            Strategy::Banterle => {
                let place = |n: u32| Vec3::new((n % shot.size) as f32, (n / shot.size) as f32, 0.0);
                let at: Vec<Vec3> = (0..luminances.len() as u32).map(place).collect();
                tone::banterle(&at, &luminances, &pixels, Banterle::with_maximum(maximum))
            }
            _ => tone::landis(&over_only(&luminances, &pixels), self.landis(maximum)),
        };
        let mut colors = picture.rgb;
        for (&pixel, expanded) in pixels.iter().zip(expanded) {
            let pixel = pixel as usize;
            colors[pixel] *= expanded / luminances[pixel].max(f32::MIN_POSITIVE);
        }
        Expanded::equal(colors, wanted)
    }
}

/// Pixels along a side of a patch.
fn patch_side() -> u32 {
    super::patchmatch::SIDE as u32
}

fn over_only(luminances: &[f32], wanted: &[u32]) -> Vec<f32> {
    wanted.iter().map(|&n| luminances[n as usize]).collect()
}

fn median(mut values: Vec<f32>) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// Pictures of a shot, its faces three in a row.
fn shot_pictures(inputs: Inputs, over: &[bool], shot: &Shot, faces: &[Expanded]) -> ShotPictures {
    let side = shot.size.min(PICTURE_FACE);
    let (width, height) = (3 * side, 2 * side);
    // (face, pixel of it) of every pixel.
    let places: Vec<(usize, usize)> = (0..width * height)
        .map(|n| {
            let (x, y) = (n % width, n / width);
            let at = UVec2::new(x % side, y % side) * shot.size / side;
            ((y / side * 3 + x / side) as usize, (at.y * shot.size + at.x) as usize)
        })
        .collect();
    let point = |&(face, pixel): &(usize, usize)| shot.faces[face].point[pixel];
    let color = |place: &(usize, usize)| inputs.cloud.colors.get(point(place) as usize).copied().unwrap_or(Vec3::ZERO);
    let is_over = |place: &(usize, usize)| over.get(point(place) as usize).copied().unwrap_or(false);
    let picture = |color: &(dyn Fn(&(usize, usize)) -> Vec3 + Sync)| Picture {
        width,
        height,
        rgb: places.par_iter().map(color).collect(),
    };
    let expanded = picture(&|place| match faces[place.0].weights[place.1] > 0.0 && is_over(place) {
        true => faces[place.0].colors[place.1],
        false => color(place),
    });
    let matched = picture(&|place| {
        let face = &faces[place.0];
        match face.places.get(place.1).filter(|_| is_over(place) && face.costs[place.1].is_finite()) {
            Some(found) => found.clamp(Vec2::ZERO, Vec2::ONE).extend(face.costs[place.1].min(1.0)),
            None => Vec3::splat(0.2 * luminance(color(place)).min(1.0)),
        }
    });
    let has_places = faces.iter().any(|face| !face.places.is_empty());
    ShotPictures {
        width,
        height,
        points: places.iter().map(point).collect(),
        expanded,
        matched: has_places.then_some(matched),
    }
}
