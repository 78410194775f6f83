//! Structural similarity: Wang, Bovik, Sheikh and Simoncelli, "Image Quality Assessment: From Error Visibility to
//! Structural Similarity", 2004. Windows are weighted by the mask too, so that a background dilutes nothing.

use rayon::prelude::*;

/// The paper's Gaussian window: 11 pixels wide, sigma 1.5.
const RADIUS: usize = 5;
const SIGMA: f32 = 1.5;
/// The paper's (K L)^2 for values in 0..1.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Mean similarity of two images of `width` over the pixels in `mask`; windows are cut off at the image's and the
/// mask's border and renormalised.
pub(super) fn ssim(a: &[f32], b: &[f32], width: usize, mask: &[usize]) -> f64 {
    let height = a.len() / width.max(1);
    // weight and weighted first and second moments; blurring is separable
    let mut moments = vec![[0.0_f32; 6]; a.len()];
    for &n in mask {
        let (x, y) = (a[n], b[n]);
        moments[n] = [1.0, x, y, x * x, y * y, x * y];
    }
    let moments = blur(&moments, |n| (n % width, width), 1);
    let moments = blur(&moments, |n| (n / width, height), width);
    let similarity = |n: &usize| {
        let [weight, sums @ ..] = moments[*n];
        let [x, y, xx, yy, xy] = sums.map(|sum| f64::from(sum / weight));
        let (variance_x, variance_y, covariance) = (xx - x * x, yy - y * y, xy - x * y);
        (2.0 * x * y + C1) * (2.0 * covariance + C2) / ((x * x + y * y + C1) * (variance_x + variance_y + C2))
    };
    mask.iter().map(similarity).sum::<f64>() / mask.len().max(1) as f64
}

/// One Gaussian pass; `place` gives a pixel's coordinate along the axis and the axis' length, `step` the distance of
/// neighbours in the list.
fn blur(values: &[[f32; 6]], place: impl Fn(usize) -> (usize, usize) + Sync, step: usize) -> Vec<[f32; 6]> {
    let weights: [f32; RADIUS + 1] = std::array::from_fn(|n| (-0.5 * (n as f32 / SIGMA).powi(2)).exp());
    let blurred = |n: usize| {
        let (at, length) = place(n);
        let mut sum = [0.0; 6];
        for other in at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(length) {
            let weight = weights[at.abs_diff(other)];
            let value = &values[n - at * step + other * step];
            sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += weight * value);
        }
        sum
    };
    (0..values.len()).into_par_iter().map(blurred).collect()
}
