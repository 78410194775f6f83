//! Inverse tone mapping operators, which expand luminance by rule, without any photo's help (Sabbadin 2019, 6.2).
//!
//! Both work on samples in space, so that they serve for the pixels of a shot as well as for the points of the cloud.

use glam::Vec3;
use rayon::prelude::*;

/// Parameters of Landis' operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landis {
    /// Exponent of the ramp.
    pub alpha: f32,
    /// Luminance from which on values are expanded.
    pub threshold: f32,
    /// What the brightest luminance is multiplied by.
    pub maximum: f32,
}

/// Expanded luminances (Landis 2002, "Production-Ready Global Illumination", as in Banterle et al. 2017, 6.2): from the
/// threshold to the largest of all, `L (1 - w) + maximum L w` with `w = ((L - threshold) / (largest - threshold))^alpha`.
pub fn landis(luminances: &[f32], options: Landis) -> Vec<f32> {
    let Landis { alpha, threshold, maximum } = options;
    let largest = luminances.iter().copied().fold(threshold, f32::max);
    let range = largest - threshold;
    let expanded = |luminance: f32| {
        if luminance < threshold {
            return luminance;
        }
        let weight = if range > 0.0 { ((luminance - threshold) / range).powf(alpha) } else { 1.0 };
        luminance * (1.0 - weight) + maximum * luminance * weight
    };
    luminances.par_iter().map(|&luminance| expanded(luminance)).collect()
}

/// Parameters of Banterle's operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Banterle {
    /// Luminance that white becomes.
    pub maximum: f32,
    /// Slope of the curve: the luminance that the inverted operator maps to white; above 1.
    pub white: f32,
    /// Lights that the expand map is estimated from; a power of two.
    pub lights: usize,
    /// How far a light reaches in the expand map, as a share of the largest extent of all samples.
    pub reach: f32,
}

impl Banterle {
    /// The parameters for a maximum luminance; the operator's authors let the slope follow it.
    pub fn with_maximum(maximum: f32) -> Self {
        Self { maximum, white: maximum.max(1.01), lights: 1024, reach: 0.03 }
    }
}

/// Reinhard's global operator inverted (Banterle et al. 2006, "Inverse Tone Mapping", Eq. 4): 0 for black, `maximum`
/// for white.
pub fn inverse_reinhard(luminance: f32, maximum: f32, white: f32) -> f32 {
    let below = luminance - 1.0;
    // At luminance 1 the root is 2 / white.
    0.5 * maximum * white * (below + (below * below + 4.0 * luminance / (white * white)).sqrt())
}

/// Expanded luminances (Banterle et al. 2006): the inverted operator where the expand map says that light comes from,
/// the luminance itself elsewhere, and a mixture between. Only those of `wanted`, in its order; all samples are looked
/// at for the map. Samples are taken to stand for equal areas.
pub fn banterle(at: &[Vec3], luminances: &[f32], wanted: &[u32], options: Banterle) -> Vec<f32> {
    let inverse = |n: u32| inverse_reinhard(luminances[n as usize].clamp(0.0, 1.0), options.maximum, options.white);
    let map = expand_map(at, luminances, wanted, options);
    let mixed = |(&n, share): (&u32, f32)| inverse(n) * share + luminances[n as usize] * (1.0 - share);
    wanted.iter().zip(map).map(mixed).collect()
}

/// Samples that the median cut looks at, at most.
const CUT_SAMPLES: usize = 1 << 16;

/// The expand map, 0 to 1 (Banterle et al. 2006): density of the lights of a median cut of the expanded luminance.
fn expand_map(at: &[Vec3], luminances: &[f32], wanted: &[u32], options: Banterle) -> Vec<f32> {
    let step = at.len().div_ceil(CUT_SAMPLES).max(1);
    let mut samples: Vec<(Vec3, f32)> = (0..at.len())
        .step_by(step)
        .map(|n| (at[n], inverse_reinhard(luminances[n].clamp(0.0, 1.0), options.maximum, options.white)))
        .filter(|(_, power)| *power > 0.0)
        .collect();
    let (low, high) = extent(at.iter().copied());
    let reach = options.reach * (high - low).max_element();
    let mut lights = Vec::with_capacity(options.lights);
    median_cut(&mut samples, options.lights, &mut lights);
    let density = |&n: &u32| {
        let place = at[n as usize];
        let near = |&(light, power): &(Vec3, f32)| {
            let share = 1.0 - light.distance_squared(place) / (reach * reach);
            // Epanechnikov's kernel.
            if share > 0.0 { power * share } else { 0.0 }
        };
        lights.iter().map(near).sum::<f32>()
    };
    let densities: Vec<f32> = wanted.par_iter().map(density).collect();
    let largest = densities.iter().copied().fold(0.0, f32::max);
    densities.into_iter().map(|d| if largest > 0.0 { d / largest } else { 0.0 }).collect()
}

fn extent(places: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    places.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), place| (low.min(place), high.max(place)))
}

/// Debevec 2005, "A Median Cut Algorithm for Light Probe Sampling": halves of equal power, cut across the longest side;
/// each last part becomes a light in its centre of power.
fn median_cut(samples: &mut [(Vec3, f32)], count: usize, lights: &mut Vec<(Vec3, f32)>) {
    let power: f64 = samples.iter().map(|(_, power)| f64::from(*power)).sum();
    if samples.is_empty() || power <= 0.0 {
        return;
    }
    if count <= 1 || samples.len() == 1 {
        let centre = samples.iter().map(|(p, power)| p.as_dvec3() * f64::from(*power)).sum::<glam::DVec3>() / power;
        lights.push((centre.as_vec3(), power as f32));
        return;
    }
    let (low, high) = extent(samples.iter().map(|(place, _)| *place));
    let sides = (high - low).to_array();
    let axis = (0..3).max_by(|&a, &b| sides[a].total_cmp(&sides[b])).unwrap_or(0);
    samples.sort_by(|a, b| a.0[axis].total_cmp(&b.0[axis]));
    let mut sum = 0.0;
    let half = samples.iter().position(|(_, part)| {
        sum += f64::from(*part);
        sum >= 0.5 * power
    });
    let (left, right) = samples.split_at_mut((half.unwrap_or(0) + 1).min(samples.len() - 1));
    median_cut(left, count / 2, lights);
    median_cut(right, count / 2, lights);
}
