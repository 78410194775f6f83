//! Where an object stands and from where it is seen, in the coordinates of the cloud's file.

use glam::{Affine3A, DVec3, Quat, Vec3};

use super::Camera;

/// Place, size and turn of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Where the object's origin goes, in the cloud's coordinates with +Y up, metres; where the file puts it for `None`.
    pub at: Option<DVec3>,
    /// Scale about the object's own origin.
    pub scale: f64,
    /// Turn about +Y and the object's own origin, degrees.
    pub turn: f64,
}

impl Default for Placement {
    fn default() -> Self {
        Self { at: None, scale: 1.0, turn: 0.0 }
    }
}

impl Placement {
    /// The transform into the space of a cloud whose `origin` was subtracted.
    pub fn world_from_object(&self, origin: DVec3) -> Affine3A {
        let at = self.at.map_or(DVec3::ZERO, |at| at - origin);
        Affine3A::from_scale_rotation_translation(
            Vec3::splat(self.scale as f32),
            // Whole turns are taken off before f32 could lose what is left of them.
            Quat::from_rotation_y((self.turn % 360.0).to_radians() as f32),
            at.as_vec3(),
        )
    }
}

/// A camera in the coordinates of the cloud's file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Eye, metres.
    pub from: DVec3,
    /// Point in the middle of the picture, metres.
    pub at: DVec3,
    /// Vertical field of view, degrees.
    pub fov: f64,
}

impl Viewpoint {
    /// The camera in the space of a cloud whose `origin` was subtracted.
    pub fn camera(&self, origin: DVec3) -> Camera {
        Camera {
            from: (self.from - origin).as_vec3(),
            at: (self.at - origin).as_vec3(),
            fov_y: self.fov.to_radians() as f32,
        }
    }

    /// The viewpoint of such a camera.
    pub fn of(camera: &Camera, origin: DVec3) -> Self {
        Self {
            from: camera.from.as_dvec3() + origin,
            at: camera.at.as_dvec3() + origin,
            fov: f64::from(camera.fov_y).to_degrees(),
        }
    }
}
