//! Real spherical harmonics: the low frequencies of functions on the sphere (Hajisharif 2012, 3.1, Eqs. 5 to 7).
//!
//! The polar axis is +Y, that of panoramas, and azimuths count from +Z towards +X. There is no Condon-Shortley phase, so
//! that the three functions of band 1 are `sqrt(3 / 4 pi)` times x, y and z. A function of order n has n^2 coefficients:
//! bands l from 0 to n - 1, and in each of them degrees m from -l to l, at index `l * l + l + m`.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3};

/// Bands of the highest order.
pub const MOST_ORDER: usize = 5;
/// Coefficients of the highest order.
pub const MOST_COEFFICIENTS: usize = MOST_ORDER * MOST_ORDER;

/// Values of all basis functions, or coefficients of one function.
pub type Harmonics = [f64; MOST_COEFFICIENTS];

/// Place of degree `m` of band `l`.
pub fn index(l: usize, m: isize) -> usize {
    (l * l + l).wrapping_add_signed(m)
}

/// Band of the coefficient at an index.
pub fn band(index: usize) -> usize {
    index.isqrt()
}

/// `K_l^m P_l^m(cosine)` for `m >= 0`, with the root of two that Eq. 5's K has for `m > 0`; at index `l * l + l + m`, and
/// again at `l * l + l - m`. `cosine` is that of the angle from the polar axis.
pub fn polar(cosine: f64) -> Harmonics {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let mut values = [0.0; MOST_COEFFICIENTS];
    // P_m^m = (2m - 1)!! sin^m, without the phase (-1)^m.
    let mut diagonal = 1.0;
    for m in 0..MOST_ORDER {
        if m > 0 {
            diagonal *= (2 * m - 1) as f64 * sine;
        }
        let (mut before, mut current) = (0.0, diagonal);
        for l in m..MOST_ORDER {
            if l > m {
                let next = ((2 * l - 1) as f64 * cosine * current - (l + m - 1) as f64 * before) / (l - m) as f64;
                (before, current) = (current, next);
            }
            // (l - m)! / (l + m)!
            let ratio = (l - m + 1..=l + m).map(|n| n as f64).product::<f64>().recip();
            let twice = if m == 0 { 1.0 } else { 2.0 };
            let value = (twice * (2 * l + 1) as f64 / (4.0 * PI) * ratio).sqrt() * current;
            values[index(l, m as isize)] = value;
            values[index(l, -(m as isize))] = value;
        }
    }
    values
}

/// All basis functions at a unit direction (Eq. 5).
pub fn basis(direction: DVec3) -> Harmonics {
    let mut values = polar(direction.y.clamp(-1.0, 1.0));
    let azimuth = direction.x.atan2(direction.z);
    for m in 1..MOST_ORDER {
        let (sine, cosine) = (m as f64 * azimuth).sin_cos();
        for l in m..MOST_ORDER {
            values[index(l, m as isize)] *= cosine;
            values[index(l, -(m as isize))] *= sine;
        }
    }
    values
}

/// What a band of light is multiplied with to become a band of the irradiance that a surface without occluders gets, as
/// a function of its normal (Ramamoorthi and Hanrahan 2001, Eq. 8).
pub const COSINE_LOBE: [f64; MOST_ORDER] = [PI, 2.0 * PI / 3.0, PI / 4.0, 0.0, -PI / 24.0];

/// Weight of band `l` of a function of the given order in a Hanning window, against ringing (Sloan 2008).
pub fn hanning(l: usize, order: usize) -> f64 {
    0.5 + 0.5 * (PI * l as f64 / order as f64).cos()
}

/// The matrix, row by row, that takes coefficients of a function f to those of `w -> f(rotation^-1 w)`, for a rotation
/// matrix. Products of two basis functions are polynomials of degree 8, which the sums below integrate exactly.
pub fn rotation(rotation: DMat3) -> [Harmonics; MOST_COEFFICIENTS] {
    // Gauss-Legendre, five nodes: exact to degree 9.
    const NODES: [(f64, f64); 5] = [
        (0.0, 128.0 / 225.0),
        (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
        (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
        (0.906_179_845_938_664, 0.236_926_885_056_189_08),
        (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    ];
    const STEPS: usize = 9;
    let back = rotation.transpose();
    let mut matrix = [[0.0; MOST_COEFFICIENTS]; MOST_COEFFICIENTS];
    for (height, weight) in NODES {
        let across = (1.0 - height * height).sqrt();
        for step in 0..STEPS {
            let (sine, cosine) = (TAU * step as f64 / STEPS as f64).sin_cos();
            let direction = DVec3::new(across * sine, height, across * cosine);
            let (to, from) = (basis(direction), basis(back * direction));
            let share = weight * TAU / STEPS as f64;
            for (row, to) in matrix.iter_mut().zip(to) {
                row.iter_mut().zip(from).for_each(|(entry, from)| *entry += share * to * from);
            }
        }
    }
    // Bands do not mix: what is left between them is rounding.
    for (k, row) in matrix.iter_mut().enumerate() {
        for (j, entry) in row.iter_mut().enumerate() {
            if band(j) != band(k) {
                *entry = 0.0;
            }
        }
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-12, "{a} instead of {b}");
    }

    #[test]
    fn the_first_bands_are_the_known_polynomials() {
        let d = DVec3::new(0.48, -0.6, 0.64);
        let values = basis(d);
        close(values[0], (0.25 / PI).sqrt());
        let one = (0.75 / PI).sqrt();
        close(values[index(1, -1)], one * d.x);
        close(values[index(1, 0)], one * d.y);
        close(values[index(1, 1)], one * d.z);
        let two = (15.0 / (4.0 * PI)).sqrt();
        close(values[index(2, -2)], two * d.x * d.z);
        close(values[index(2, -1)], two * d.x * d.y);
        close(values[index(2, 0)], (5.0 / (16.0 * PI)).sqrt() * (3.0 * d.y * d.y - 1.0));
        close(values[index(2, 1)], two * d.y * d.z);
        close(values[index(2, 2)], 0.5 * two * (d.z * d.z - d.x * d.x));
        // Unsoeld: the sum of squares of a band is the same everywhere.
        for l in 0..MOST_ORDER {
            let sum: f64 = values[l * l..(l + 1) * (l + 1)].iter().map(|v| v * v).sum();
            close(sum, (2 * l + 1) as f64 / (4.0 * PI));
        }
    }

    #[test]
    fn no_rotation_changes_nothing_and_shows_that_the_basis_is_orthonormal() {
        for (k, row) in rotation(DMat3::IDENTITY).iter().enumerate() {
            row.iter().enumerate().for_each(|(j, entry)| close(*entry, if j == k { 1.0 } else { 0.0 }));
        }
    }

    #[test]
    fn a_rotated_function_has_rotated_values() {
        let turn = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1);
        let matrix = rotation(turn);
        let direction = DVec3::new(0.36, 0.48, -0.8);
        let (here, there) = (basis(direction), basis(turn * direction));
        for k in 0..MOST_COEFFICIENTS {
            // The coefficients of a basis function are one in its place and zeros: after the rotation, a column.
            let value: f64 = (0..MOST_COEFFICIENTS).map(|j| matrix[j][k] * there[j]).sum();
            close(value, here[k]);
        }
    }

    #[test]
    fn a_window_keeps_the_mean_and_fades_to_nothing() {
        close(hanning(0, 4), 1.0);
        close(hanning(4, 4), 0.0);
        assert!((1..4).all(|l| hanning(l, 4) < hanning(l - 1, 4)));
    }
}
