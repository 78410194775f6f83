//! How a camera follows a mouse and keys: plain functions from one camera to the next. Distances on the screen are
//! pixels, `height` is that of the picture.

use glam::{Quat, Vec3};

use crate::scene::Camera;

/// Views are kept this far from straight up and down, radians: there the picture would spin.
const POLE: f32 = 0.02;
/// A turn over the whole height of the picture, radians.
const ORBIT: f32 = std::f32::consts::PI;
/// A step of the wheel multiplies the distance by this.
const ZOOM: f32 = 0.88;

/// Direction `forward` turned by `yaw` about +Y and then raised by `pitch`, radians, short of the poles.
fn turned(forward: Vec3, yaw: f32, pitch: f32) -> Vec3 {
    let level = std::f32::consts::FRAC_PI_2 - POLE;
    let now = forward.y.clamp(-1.0, 1.0).asin();
    let raised = (now + pitch).clamp(-level, level);
    let flat = Vec3::new(forward.x, 0.0, forward.z).normalize_or(Vec3::NEG_Z);
    let flat = Quat::from_rotation_y(yaw) * flat;
    flat * raised.cos() + Vec3::Y * raised.sin()
}

/// Turns the eye about the point that it looks at.
pub fn orbit(camera: &Camera, dx: f32, dy: f32, height: f32) -> Camera {
    let forward = turned(camera.basis().2, -ORBIT * dx / height, -ORBIT * dy / height);
    Camera { from: camera.at - forward * camera.at.distance(camera.from), ..*camera }
}

/// Turns the view about the eye: what is under the mouse stays there, near the picture's middle.
pub fn look(camera: &Camera, dx: f32, dy: f32, height: f32) -> Camera {
    let pixel = 2.0 * (0.5 * camera.fov_y).tan() / height;
    let forward = turned(camera.basis().2, pixel * dx, pixel * dy);
    Camera { at: camera.from + forward * camera.at.distance(camera.from), ..*camera }
}

/// Moves the camera across the view: the point that it looks at follows the mouse.
pub fn pan(camera: &Camera, dx: f32, dy: f32, height: f32) -> Camera {
    let (right, up, _) = camera.basis();
    let metres = 2.0 * (0.5 * camera.fov_y).tan() * camera.at.distance(camera.from) / height;
    shifted(camera, (up * dy - right * dx) * metres)
}

/// Goes towards what is in the middle, or away for fewer than 0 steps.
pub fn zoom(camera: &Camera, steps: f32) -> Camera {
    let offset = (camera.from - camera.at) * ZOOM.powf(steps.clamp(-50.0, 50.0));
    // Not so near that f32 could no longer tell eye and middle apart, nor so far that it could not tell much else.
    let length = offset.length().clamp(1e-4 * (1.0 + camera.at.length()), 1e9);
    Camera { from: camera.at + offset.normalize_or(Vec3::Z) * length, ..*camera }
}

/// Moves through the scene: right, up and forward in metres.
pub fn fly(camera: &Camera, motion: Vec3) -> Camera {
    let (right, _, forward) = camera.basis();
    shifted(camera, right * motion.x + Vec3::Y * motion.y + forward * motion.z)
}

/// Brings a point into the middle, seen from the same direction and as far as it was.
pub fn focus(camera: &Camera, point: Vec3) -> Camera {
    let distance = point.distance(camera.from).max(1e-4 * (1.0 + point.length()));
    Camera { from: point - camera.basis().2 * distance, at: point, ..*camera }
}

fn shifted(camera: &Camera, by: Vec3) -> Camera {
    Camera { from: camera.from + by, at: camera.at + by, ..*camera }
}

/// Unit direction through a place of the picture, pixels from its upper left corner.
pub fn ray(camera: &Camera, [x, y]: [f32; 2], [width, height]: [f32; 2]) -> Vec3 {
    let (right, up, forward) = camera.basis();
    let tan = (0.5 * camera.fov_y).tan();
    let sx = (2.0 * x / width - 1.0) * tan * width / height;
    let sy = (1.0 - 2.0 * y / height) * tan;
    (forward + sx * right + sy * up).normalize()
}

/// Where a point of the world lies in the picture, pixels; None behind the eye.
pub fn project(camera: &Camera, point: Vec3, [width, height]: [f32; 2]) -> Option<[f32; 2]> {
    let (right, up, forward) = camera.basis();
    let offset = point - camera.from;
    let depth = offset.dot(forward);
    let scale = height / (2.0 * (0.5 * camera.fov_y).tan() * depth);
    (depth > 0.0).then(|| [0.5 * width + offset.dot(right) * scale, 0.5 * height - offset.dot(up) * scale])
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [f32; 2] = [640.0, 360.0];

    fn camera() -> Camera {
        Camera { from: Vec3::new(1.0, 2.0, 5.0), at: Vec3::new(0.5, 1.0, 0.0), fov_y: 0.8 }
    }

    fn close(a: Vec3, b: Vec3) -> bool {
        a.distance(b) < 1e-4
    }

    #[test]
    fn orbiting_keeps_the_middle_and_the_distance() {
        let turned = orbit(&camera(), 100.0, -40.0, SIZE[1]);
        assert_eq!(turned.at, camera().at);
        assert!((turned.from.distance(turned.at) - camera().from.distance(camera().at)).abs() < 1e-5);
        assert!(!close(turned.from, camera().from));
        assert!(close(orbit(&turned, -100.0, 40.0, SIZE[1]).from, camera().from), "and back");
        // Dragging to the right brings the left side of things forward.
        assert!(
            orbit(&camera(), 10.0, 0.0, SIZE[1]).from.dot(camera().basis().0) < camera().from.dot(camera().basis().0)
        );
    }

    #[test]
    fn no_drag_goes_over_the_poles() {
        for dy in [-1e4, 1e4] {
            let high = orbit(&camera(), 0.0, dy, SIZE[1]);
            assert!(high.basis().2.y.abs() < 0.9999 && high.from.is_finite());
            assert!(look(&camera(), 0.0, dy, SIZE[1]).basis().2.y.abs() < 0.9999);
        }
    }

    #[test]
    fn a_pan_moves_the_middle_with_the_mouse() {
        let moved = pan(&camera(), 30.0, -12.0, SIZE[1]);
        let [x, y] = project(&moved, camera().at, SIZE).expect("in front");
        assert!((x - 350.0).abs() < 0.01 && (y - 168.0).abs() < 0.01, "{x} {y}");
    }

    #[test]
    fn looking_about_leaves_the_eye() {
        let turned = look(&camera(), 20.0, 10.0, SIZE[1]);
        assert_eq!(turned.from, camera().from);
        let [x, y] = project(&turned, camera().at, SIZE).expect("in front");
        assert!((x - 340.0).abs() < 1.5 && (y - 190.0).abs() < 1.5, "{x} {y}");
    }

    #[test]
    fn zoom_changes_the_distance_and_never_meets_the_middle() {
        let near = zoom(&camera(), 1.0);
        assert!((near.from.distance(near.at) / camera().from.distance(camera().at) - ZOOM).abs() < 1e-5);
        let mut camera = camera();
        for _ in 0..1000 {
            camera = zoom(&camera, 5.0);
        }
        assert!(camera.from.distance(camera.at) > 1e-5 && camera.from.is_finite());
    }

    #[test]
    fn flying_takes_the_middle_along() {
        let moved = fly(&camera(), Vec3::new(0.0, 0.0, 2.0));
        assert!(close(moved.from - camera().from, camera().basis().2 * 2.0));
        assert!(close(moved.at - moved.from, camera().at - camera().from));
    }

    #[test]
    fn focus_puts_a_point_into_the_middle() {
        let point = Vec3::new(-1.0, 0.3, 1.0);
        let seen = focus(&camera(), point);
        let [x, y] = project(&seen, point, SIZE).expect("in front");
        assert!((x - 320.0).abs() < 0.01 && (y - 180.0).abs() < 0.01);
        assert!(close(seen.basis().2, camera().basis().2));
    }

    #[test]
    fn rays_go_through_what_is_projected() {
        let place = [123.0, 77.0];
        let point = camera().from + ray(&camera(), place, SIZE) * 3.0;
        let [x, y] = project(&camera(), point, SIZE).expect("in front");
        assert!((x - place[0]).abs() < 0.01 && (y - place[1]).abs() < 0.01);
        assert_eq!(project(&camera(), camera().from - camera().basis().2, SIZE), None);
    }
}
