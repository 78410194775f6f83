//! From what any scan file holds to a valid [`Cloud`].

use std::path::Path;

use glam::{DVec3, Vec3};

use super::table::Table;
use crate::scene::Cloud;
use crate::{Error, Result};

/// Coordinates beyond this many metres are no measurement (and their squares would leave f32).
const FARTHEST: f64 = 1e12;

/// Radiance beyond this is no measurement either (the hierarchy's sums would leave f32).
pub(super) const BRIGHTEST: f32 = 1e15;

/// The points of a file, coordinates still in f64.
pub(super) struct Points {
    pub(super) positions: Vec<DVec3>,
    /// Linear, as many as positions.
    pub(super) colors: Vec<Vec3>,
    /// As in the file; as many as positions, or none.
    pub(super) normals: Vec<Vec3>,
    pub(super) viewpoint: Option<DVec3>,
    /// True where the format marks missing points by NaN, so that they deserve no warning.
    pub(super) gaps_are_normal: bool,
}

impl Points {
    /// Reads the usual columns. The error for missing ones names what is there and what is expected.
    pub(super) fn from_table(path: &Path, table: &Table) -> Result<Self> {
        let positions = table.positions().ok_or_else(|| {
            Error::file(path, format!("has no coordinates: expected x, y, z among its properties ({})", table.names()))
        })?;
        let colors = table.colors().ok_or_else(|| {
            let expected =
                "red, green, blue (or r, g, b; diffuse_red, diffuse_green, diffuse_blue; packed rgb or rgba)";
            Error::file(path, format!("has no colours: expected {expected} among its properties ({})", table.names()))
        })?;
        let normals = table.normals().unwrap_or_default();
        Ok(Self { positions, colors, normals, viewpoint: None, gaps_are_normal: false })
    }

    /// Drops invalid points, clamps negative colours, unitises normals (unusable ones become zero) and moves the
    /// origin where f32 would lose detail: (cloud, the rows that its points have in the file).
    pub(super) fn into_cloud(self, path: &Path) -> Result<(Cloud, Vec<usize>)> {
        let total = self.positions.len();
        if total == 0 {
            return Err(Error::file(path, "holds no points"));
        }
        let valid = |i: &usize| {
            self.positions[*i].abs().max_element() <= FARTHEST && self.colors[*i].abs().max_element() <= BRIGHTEST
        };
        // `max_element` passes over NaN, so that is asked separately.
        let kept: Vec<usize> =
            (0..total).filter(|i| self.positions[*i].is_finite() && self.colors[*i].is_finite() && valid(i)).collect();
        if kept.is_empty() {
            return Err(Error::file(
                path,
                format!(
                    "holds {total} points, but none with finite position and colour (up to 1e12 m and a radiance of 1e15)"
                ),
            ));
        }
        if kept.len() < total && !self.gaps_are_normal {
            let dropped = total - kept.len();
            tracing::warn!(
                "{}: dropped {dropped} of {total} points: not finite, or beyond all measure",
                path.display()
            );
        }
        let origin = origin_of(kept.iter().map(|&i| self.positions[i]));
        let unit = |n: Vec3| n.normalize_or_zero();
        let mut cloud = Cloud {
            positions: kept.iter().map(|&i| (self.positions[i] - origin).as_vec3()).collect(),
            colors: kept.iter().map(|&i| self.colors[i].max(Vec3::ZERO)).collect(),
            normals: Vec::new(),
            spacing: Vec::new(),
            origin,
            viewpoint: self.viewpoint.filter(|v| v.is_finite()).map(|v| (v - origin).as_vec3()),
        };
        if self.normals.len() == total {
            cloud.normals = kept.iter().map(|&i| unit(self.normals[i])).collect();
            if cloud.normals.iter().all(|n| *n == Vec3::ZERO) {
                cloud.normals.clear();
            }
        }
        Ok((cloud, kept))
    }
}

/// What to subtract before rounding to f32: nothing, or the middle of the bounding box in whole metres where the
/// coordinates reach beyond 10 km or a thousand times the extent (f32 has 24 bits: less than a millimetre of detail,
/// or less than 14 bits for the whole scan).
fn origin_of(positions: impl Iterator<Item = DVec3>) -> DVec3 {
    let (lo, hi) = positions.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
    let magnitude = lo.abs().max(hi.abs()).max_element();
    let extent = (hi - lo).max_element();
    let loses_detail = magnitude > 1e4 || (extent > 0.0 && magnitude > 1e3 * extent);
    if loses_detail { (0.5 * (lo + hi)).round() } else { DVec3::ZERO }
}
