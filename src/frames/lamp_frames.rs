//! What the light of lamps makes: pictures of a cloud, and what an object gets of it.

use glam::Vec3;

use super::Frame;
use super::points::{LitBy, PointFrame};
use crate::gpu::Profile;

/// A picture of a lit cloud, row by row from the top.
#[derive(Clone, Debug, Default)]
pub struct LampFrame {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Radiance that the lamps' light leaves the surface with, and depth along the view in metres; 0 where nothing is.
    pub color_depth: Vec<[f32; 4]>,
    /// The cloud's own colour there, and the same depth.
    pub own: Vec<[f32; 4]>,
    /// Times and counts by pass.
    pub profile: Profile,
    /// Wall time, milliseconds.
    pub wall_ms: f64,
}

impl LampFrame {
    /// Lights a picture of the same cloud from the same place, of whose own light `share` stays. Its silhouettes become
    /// those of the lit surface.
    pub fn add_to(&self, points: &mut PointFrame, share: f32) {
        take_silhouettes(&mut points.color_depth, &self.own);
        points.lit = Some(LitBy { radiance: self.color_depth.clone(), share });
    }

    /// Whether any light falls on what is seen.
    pub fn is_lit(&self) -> bool {
        self.color_depth.iter().any(|[r, g, b, _]| r + g + b > 0.0)
    }
}

/// Where the surfaces of two pictures lie apart, that of the second.
pub(super) fn take_silhouettes(filled: &mut [[f32; 4]], own: &[[f32; 4]]) {
    const APART: f32 = 0.05;
    for (filled, own) in filled.iter_mut().zip(own) {
        if filled[3] > 0.0 && (filled[3] - own[3]).abs() > APART * filled[3] {
            *filled = *own;
        }
    }
}

/// What a lit picture shows, row by row from the top.
#[derive(Clone, Debug, Default)]
pub struct LampSurface {
    /// The cloud's own colour, and depth along the view in metres; 0 where nothing is.
    pub color_depth: Vec<[f32; 4]>,
    /// Unit normals, world space.
    pub normal: Vec<[f32; 4]>,
}

/// Light of the lamps on chosen points of the cloud.
#[derive(Clone, Debug, Default)]
pub struct PointLight {
    /// Radiance that the lamps' light leaves each point with, in their order.
    pub radiance: Vec<Vec3>,
    /// Times and counts by pass.
    pub profile: Profile,
    /// Wall time, milliseconds.
    pub wall_ms: f64,
}

/// Light of the lamps on the object itself, row by row from the top.
#[derive(Clone, Debug, Default)]
pub struct ObjectLight {
    /// Radiance that the object reflects of what comes straight from the lamps; w is 1 where it is.
    pub radiance: Vec<[f32; 4]>,
    /// Times and counts by pass.
    pub profile: Profile,
    /// Wall time, milliseconds.
    pub wall_ms: f64,
}

impl ObjectLight {
    /// Adds it to a picture of the same object from the same place.
    pub fn add_to(&self, frame: &mut Frame) {
        for (rgba, more) in frame.rgba.iter_mut().zip(&self.radiance).filter(|(rgba, _)| rgba[3] > 0.0) {
            (0..3).for_each(|channel| rgba[channel] += more[channel]);
        }
    }
}
