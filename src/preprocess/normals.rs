//! Normals by plane fitting: Hoppe, DeRose, Duchamp, McDonald, Stuetzle: "Surface Reconstruction from Unorganized
//! Points", 1992, section 3.2. Orientation is simpler than theirs: every normal looks towards one known point.

use glam::{DMat3, DVec3, Vec3};

use super::neighbours::{self, Neighbourhood};
use crate::Result;

/// Unit normals: of the plane through the `k` nearest neighbours (16 suits scans), on the side of `towards` (the
/// scanner's place, or any point in front of all surfaces). Where the neighbours span no plane (one point, or all on
/// a line), the direction that faces `towards` best without contradicting them.
///
/// # Errors
/// [`crate::Error::Limit`] when there are more than 2^32 - 1 points.
pub fn estimate(positions: &[Vec3], k: usize, towards: Vec3) -> Result<Vec<Vec3>> {
    neighbours::map(positions, k, |around| fit(around, towards))
}

/// The normal at one position.
pub(super) fn fit(around: &Neighbourhood, towards: Vec3) -> Vec3 {
    let view = (towards.as_dvec3() - around.position.as_dvec3()).normalize_or(DVec3::Y);
    let count = (around.offsets.len() + 1) as f64;
    let mean = around.offsets.iter().sum::<DVec3>() / count;
    // The position itself is at offset zero.
    let covariance = around.offsets.iter().fold(outer(-mean), |sum, &offset| sum + outer(offset - mean));
    let ([smallest, middle, largest], [normal, _, along]) = eigen(covariance);
    let normal = if !(largest > 0.0 && smallest.is_finite()) {
        view
    } else if middle <= 1e-12 * largest {
        // A line: of all directions across it the one that faces the viewer most.
        (view - view.dot(along) * along).normalize_or(along.any_orthonormal_vector())
    } else {
        normal
    };
    let facing = if normal.dot(view) < 0.0 { -normal } else { normal };
    facing.as_vec3().normalize_or(Vec3::Y)
}

/// v v^T.
fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Eigenvalues of a symmetric matrix, ascending, and their unit eigenvectors: cyclic Jacobi rotations (Golub and
/// Van Loan, "Matrix Computations", 8.5). A closed form would be faster and loses the small eigenvalue's digits on
/// exactly the flat neighbourhoods that scans consist of.
fn eigen(matrix: DMat3) -> ([f64; 3], [DVec3; 3]) {
    let mut a = matrix.to_cols_array_2d();
    let mut v = DMat3::IDENTITY.to_cols_array();
    for _sweep in 0..12 {
        let off_diagonal = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
        if off_diagonal <= 1e-15 * (a[0][0].abs() + a[1][1].abs() + a[2][2].abs()) {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            let r = 3 - p - q;
            let (apq, arp, arq) = (a[p][q], a[r][p], a[r][q]);
            a[p][p] -= t * apq;
            a[q][q] += t * apq;
            (a[p][q], a[q][p]) = (0.0, 0.0);
            let (rp, rq) = (c * arp - s * arq, s * arp + c * arq);
            (a[r][p], a[p][r], a[r][q], a[q][r]) = (rp, rp, rq, rq);
            // Columns of v are the eigenvectors.
            for row in 0..3 {
                let (vp, vq) = (v[3 * p + row], v[3 * q + row]);
                v[3 * p + row] = c * vp - s * vq;
                v[3 * q + row] = s * vp + c * vq;
            }
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
    let column = |i: usize| DVec3::new(v[3 * i], v[3 * i + 1], v[3 * i + 2]);
    (order.map(|i| a[i][i]), order.map(column))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_reconstruct_the_matrix() {
        let a = DMat3::from_cols_array(&[4.0, 1.0, -2.0, 1.0, 3.0, 0.5, -2.0, 0.5, 1.5]);
        let (values, vectors) = eigen(a);
        assert!(values[0] <= values[1] && values[1] <= values[2]);
        for (value, vector) in values.iter().zip(vectors) {
            assert!((a * vector - *value * vector).length() < 1e-12);
            assert!((vector.length() - 1.0).abs() < 1e-12);
        }
    }
}
