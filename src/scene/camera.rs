//! A pinhole camera.

use glam::{Mat4, Vec3, Vec4};

/// Pinhole camera; image row 0 is at the top.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Eye, world space.
    pub from: Vec3,
    /// Point in the middle of the image, world space.
    pub at: Vec3,
    /// Vertical field of view, radians.
    pub fov_y: f32,
}

impl Camera {
    /// Frames a sphere: looks at its centre from a little above and to the side, far enough for all of it to be seen.
    pub fn framing(centre: Vec3, radius: f32) -> Self {
        let fov_y = 30.0_f32.to_radians();
        let distance = radius / (0.5 * fov_y).sin() * 1.05;
        Self { from: centre + Vec3::new(0.3, 0.25, 1.0).normalize() * distance, at: centre, fov_y }
    }

    /// (right, up, forward), orthonormal, world space. Up is +Y unless the view is along it.
    pub fn basis(&self) -> (Vec3, Vec3, Vec3) {
        let forward = (self.at - self.from).normalize_or(Vec3::NEG_Z);
        let up_hint = if forward.y.abs() > 0.9999 { Vec3::NEG_Z } else { Vec3::Y };
        let right = forward.cross(up_hint).normalize();
        (right, right.cross(forward), forward)
    }

    /// World to Vulkan's clip space: y down, depth 0 at `near` and 1 at `far`, both in metres.
    pub fn clip_from_world(&self, aspect: f32, near: f32, far: f32) -> Mat4 {
        let (right, up, forward) = self.basis();
        let view = Mat4::from_cols(
            Vec4::new(right.x, up.x, -forward.x, 0.0),
            Vec4::new(right.y, up.y, -forward.y, 0.0),
            Vec4::new(right.z, up.z, -forward.z, 0.0),
            Vec4::new(-right.dot(self.from), -up.dot(self.from), forward.dot(self.from), 1.0),
        );
        let f = 1.0 / (0.5 * self.fov_y).tan();
        let depth = far / (near - far);
        let projection = Mat4::from_cols(
            Vec4::new(f / aspect, 0.0, 0.0, 0.0),
            Vec4::new(0.0, -f, 0.0, 0.0),
            Vec4::new(0.0, 0.0, depth, -1.0),
            Vec4::new(0.0, 0.0, near * depth, 0.0),
        );
        projection * view
    }

    /// Unit direction through the centre of pixel (x, y) of a `width` x `height` image.
    pub fn ray_direction(&self, x: u32, y: u32, width: u32, height: u32) -> Vec3 {
        let (right, up, forward) = self.basis();
        let tan = (0.5 * self.fov_y).tan();
        let sx = (2.0 * (x as f32 + 0.5) / width as f32 - 1.0) * tan * width as f32 / height as f32;
        let sy = (1.0 - 2.0 * (y as f32 + 0.5) / height as f32) * tan;
        (forward + sx * right + sy * up).normalize()
    }
}
