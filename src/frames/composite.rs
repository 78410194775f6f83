//! The object in front of and behind the scan, by depth.

use glam::Vec3;
use rayon::prelude::*;

use super::Frame;
use super::points::PointFrame;
use crate::scene::{Camera, FarField};

/// What lies behind the object, and before it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Backdrop<'a> {
    /// The scan.
    pub points: Option<&'a PointFrame>,
    /// What is seen where neither scan nor object is.
    pub environment: Option<&'a FarField>,
    /// The scan hides the object where it is nearer by more than this, metres.
    pub tolerance: f32,
}

/// A picture of object and backdrop, row by row from the top.
#[derive(Clone, Debug, Default)]
pub struct Composite {
    /// Linear radiance.
    pub rgb: Vec<Vec3>,
    /// 1 where anything is seen.
    pub alpha: Vec<f32>,
    /// 1 where the object is seen.
    pub object: Vec<f32>,
    /// The backdrop alone, in the object's shadow; empty without one.
    pub backdrop: Vec<Vec3>,
}

/// Puts a lit object into its backdrop; both pictures have the same size.
pub fn compose(frame: &Frame, camera: &Camera, backdrop: Backdrop<'_>) -> Composite {
    let (_, _, forward) = camera.basis();
    let (width, has_backdrop) = (frame.width.max(1), backdrop.points.is_some() || backdrop.environment.is_some());
    let pixels: Vec<(Vec3, f32, f32, Vec3)> = (0..frame.rgba.len())
        .into_par_iter()
        .map(|at| {
            let [r, g, b, covered] = frame.rgba[at];
            let [x, y, z, _] = frame.position[at];
            let depth = (Vec3::new(x, y, z) - camera.from).dot(forward);
            let scan = backdrop.points.map_or([0.0; 4], |points| points.color_depth[at]);
            let (behind, filled) = match (scan, backdrop.environment) {
                ([r, g, b, depth], _) if depth > 0.0 => {
                    let left = backdrop.points.and_then(|points| points.shadow.get(at)).map_or([1.0; 4], |left| *left);
                    let own = Vec3::new(r * left[0], g * left[1], b * left[2]);
                    let lit = backdrop.points.and_then(|points| points.lit.as_ref());
                    (lit.map_or(own, |lit| own * lit.share + Vec3::from_slice(&lit.radiance[at])), 1.0)
                }
                (_, Some(far)) => {
                    let (x, y) = (at as u32 % width, at as u32 / width);
                    (far.sample(camera.ray_direction(x, y, frame.width, frame.height)), 1.0)
                }
                _ => (Vec3::ZERO, 0.0),
            };
            let seen = covered > 0.0 && (scan[3] == 0.0 || depth <= scan[3] + backdrop.tolerance);
            if seen { (Vec3::new(r, g, b), 1.0, 1.0, behind) } else { (behind, filled, 0.0, behind) }
        })
        .collect();
    Composite {
        rgb: pixels.iter().map(|p| p.0).collect(),
        alpha: pixels.iter().map(|p| p.1).collect(),
        object: pixels.iter().map(|p| p.2).collect(),
        backdrop: if has_backdrop { pixels.iter().map(|p| p.3).collect() } else { Vec::new() },
    }
}
