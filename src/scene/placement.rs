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
    /// Turn about the object's own +Y and origin, degrees.
    pub turn: f64,
    /// Where the object's +Y points: across the surface that it stands on. Any length but zero.
    pub up: DVec3,
}

impl Default for Placement {
    fn default() -> Self {
        Self { at: None, scale: 1.0, turn: 0.0, up: DVec3::Y }
    }
}

impl Placement {
    /// The transform into the space of a cloud whose `origin` was subtracted.
    pub fn world_from_object(&self, origin: DVec3) -> Affine3A {
        let at = self.at.map_or(DVec3::ZERO, |at| at - origin);
        // Whole turns are taken off before f32 could lose what is left of them.
        let turn = Quat::from_rotation_y((self.turn % 360.0).to_radians() as f32);
        let tilt = Quat::from_rotation_arc(Vec3::Y, self.up.normalize_or(DVec3::Y).as_vec3());
        Affine3A::from_scale_rotation_translation(Vec3::splat(self.scale as f32), tilt * turn, at.as_vec3())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_object_is_turned_about_its_own_axis_and_then_stood_up() {
        let up = DVec3::new(0.0, 3.0, 4.0);
        let placement = Placement { at: Some(DVec3::new(1.0, 2.0, 3.0)), scale: 2.0, turn: 360.0 + 90.0, up };
        let place = placement.world_from_object(DVec3::new(1.0, 0.0, 0.0));
        let close = |a: Vec3, b: Vec3| assert!(a.distance(b) < 1e-5, "{a} instead of {b}");
        close(place.transform_point3(Vec3::ZERO), Vec3::new(0.0, 2.0, 3.0));
        close(place.transform_vector3(Vec3::Y), Vec3::new(0.0, 1.2, 1.6));
        // A quarter turn takes +Z to +X, which stays where it is when +Y is tilted towards +Z.
        close(place.transform_vector3(Vec3::Z), Vec3::new(2.0, 0.0, 0.0));
        close(Placement::default().world_from_object(DVec3::ZERO).transform_vector3(Vec3::Y), Vec3::Y);
    }
}
