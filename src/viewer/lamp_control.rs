//! Lamps that a person adds, moves and removes.

use glam::{DVec3, Quat, Vec3};

use super::controller::Controller;
use super::{camera_control as control, pick};
use crate::scene::{Camera, Lamp, LampKind, Viewpoint};

impl Controller {
    /// The lamp that is chosen, if there is one.
    pub fn chosen_lamp(&self) -> Option<&Lamp> {
        self.state.lamps.lamps.get(self.lamp)
    }

    /// Adds a lamp that lights what is in the middle of the view, and chooses it.
    pub fn add_new_lamp(&mut self, kind: NewLamp) {
        let (Some(viewpoint), Some(camera)) = (self.state.viewpoint, self.camera()) else {
            self.status = "there is no view yet that a lamp could light".into();
            return;
        };
        let seen = self.scan_at(&camera, [0.5 * self.area[2], 0.5 * self.area[3]]).unwrap_or(viewpoint.at);
        self.add_lamp(added(kind, &viewpoint, seen));
    }

    /// Adds a lamp, and chooses it.
    pub fn add_lamp(&mut self, lamp: Lamp) {
        self.lamp = self.state.lamps.lamps.len();
        self.state.lamps.lamps.push(lamp);
        self.touch();
    }

    /// Puts a lamp in the place of that of a number, counted from 0, unless it could not shine.
    pub fn change_lamp(&mut self, number: usize, lamp: Lamp) {
        if let (Some(own), Ok(())) = (self.state.lamps.lamps.get_mut(number), lamp.check())
            && *own != lamp
        {
            *own = lamp;
            self.touch();
        }
    }

    /// Takes the lamp of that number away.
    pub fn remove_lamp(&mut self, number: usize) {
        let lamps = &mut self.state.lamps.lamps;
        if number < lamps.len() {
            lamps.remove(number);
            self.lamp = self.lamp.min(lamps.len().saturating_sub(1));
            self.touch();
        }
    }

    /// Lets the chosen spot light what of the scan is at a place of the picture.
    pub(super) fn aim_lamp(&mut self, place: [f32; 2]) {
        let (Some(lamp), Some(camera)) = (self.chosen_lamp().copied(), self.camera()) else { return };
        let LampKind::Spot { at, degrees, .. } = lamp.kind else { return };
        if let Some(to) = self.scan_at(&camera, place) {
            self.change_lamp(self.lamp, Lamp { kind: LampKind::Spot { at, to, degrees }, ..lamp });
        }
    }

    /// Moves the chosen lamp by so many pixels across the view.
    pub(super) fn shift_lamp(&mut self, pixels: [f32; 2]) {
        let (Some(lamp), Some(camera)) = (self.chosen_lamp(), self.camera()) else { return };
        let moved = shifted(lamp, &camera, pixels, (self.area[3].max(1.0), self.origin));
        self.change_lamp(self.lamp, moved);
    }

    /// The scan's surface at a place of the picture, in the coordinates of its file.
    fn scan_at(&self, camera: &Camera, place: [f32; 2]) -> Option<DVec3> {
        let direction = control::ray(camera, place, [self.area[2], self.area[3]]);
        let hit = pick::surface(self.hierarchy.as_ref()?, camera.from, direction)?;
        Some(hit.position.as_dvec3() + self.origin)
    }
}

/// Whole cone of a spot that is added, degrees.
const CONE: f32 = 60.0;
/// A point lamp that is added is this part of the way to what is seen.
const BEFORE: f64 = 0.75;

/// A lamp to begin with, for a view whose middle shows `seen`: it lights that as brightly as white paper is scanned.
fn added(kind: NewLamp, viewpoint: &Viewpoint, seen: DVec3) -> Lamp {
    let Viewpoint { from, .. } = *viewpoint;
    let kind = match kind {
        NewLamp::Spot => LampKind::Spot { at: from, to: seen, degrees: CONE },
        NewLamp::Point => LampKind::Point { at: from.lerp(seen, BEFORE) },
        NewLamp::Sun => LampKind::Sun { direction: seen - from },
    };
    let lamp = Lamp { kind, power: 1.0, color: Vec3::ONE };
    let distance = lamp.place().map_or(1.0, |at| at.distance(seen)) as f32;
    // pi W/m^2 makes white of a white surface.
    let power = std::f32::consts::PI * distance * distance / lamp.strength().x;
    // Two digits are easier to go on from.
    let step = 10.0_f32.powf(power.log10().floor() - 1.0);
    Lamp { power: ((power / step).round() * step).clamp(1e-6, 1e9), ..lamp }
}

/// Kinds of lamps that can be added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NewLamp {
    /// At the eye.
    Spot,
    /// Before what is in the middle of the view.
    Point,
    /// The way that one looks.
    Sun,
}

/// The lamp after a drag over `dx`, `dy` pixels of a picture `height` pixels high: its place follows the mouse across the
/// view, a sun turns.
fn shifted(lamp: &Lamp, camera: &Camera, [dx, dy]: [f32; 2], (height, origin): (f32, DVec3)) -> Lamp {
    let (right, up, forward) = camera.basis();
    let per_pixel = 2.0 * (0.5 * camera.fov_y).tan() / height;
    let kind = match lamp.kind {
        LampKind::Sun { direction } => {
            // A picture's height is half a turn, as for the camera.
            let angle = std::f32::consts::PI / height;
            let turn = Quat::from_axis_angle(Vec3::Y, angle * dx) * Quat::from_axis_angle(right, angle * dy);
            LampKind::Sun { direction: turn.as_dquat() * direction }
        }
        LampKind::Spot { at, .. } | LampKind::Point { at } => {
            let depth = ((at - origin).as_vec3() - camera.from).dot(forward);
            // One at the eye or behind it is moved as what is looked at.
            let farther = 0.1 * camera.at.distance(camera.from);
            let depth = if depth > farther { depth } else { camera.at.distance(camera.from) };
            let at = at + ((right * dx - up * dy) * (per_pixel * depth)).as_dvec3();
            match lamp.kind {
                LampKind::Spot { to, degrees, .. } => LampKind::Spot { at, to, degrees },
                _ => LampKind::Point { at },
            }
        }
    };
    Lamp { kind, ..*lamp }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn viewpoint() -> Viewpoint {
        Viewpoint { from: DVec3::new(5e5, 1.0, 3.0), at: DVec3::new(5e5, 1.0, 0.0), fov: 60.0 }
    }

    #[test]
    fn lamps_that_are_added_light_what_is_seen_as_white_paper() {
        let seen = DVec3::new(5e5, 1.0, -1.0);
        for kind in [NewLamp::Spot, NewLamp::Point, NewLamp::Sun] {
            let lamp = added(kind, &viewpoint(), seen);
            lamp.check().expect("a lamp");
            let origin = DVec3::X * 5e5;
            let light = lamp.relative_to(origin).incident((seen - origin).as_vec3()).expect("light");
            assert!((light.irradiance.x / std::f32::consts::PI - 1.0).abs() < 0.06, "{kind:?}: {light:?}");
            assert!(light.towards.z > 0.99, "{kind:?} shines away from the eye");
        }
    }

    #[test]
    fn a_lamp_follows_the_mouse_across_the_view() {
        let (origin, height) = (DVec3::X * 5e5, 360.0);
        let camera = viewpoint().camera(origin);
        let at = DVec3::new(5e5 + 0.5, 1.2, 1.0);
        for text in ["point at=500000.5,1.2,1 power=1", "spot at=500000.5,1.2,1 to=500000,0,0 power=1 angle=30"] {
            let lamp: Lamp = text.parse().expect("a lamp");
            assert_eq!(lamp.place(), Some(at));
            let project = |at: DVec3| {
                let place = (at - origin).as_vec3();
                crate::viewer::camera_control::project(&camera, place, [640.0, height]).expect("in front")
            };
            let moved = shifted(&lamp, &camera, [40.0, -25.0], (height, origin)).place().expect("a place");
            let ([x, y], [new_x, new_y]) = (project(at), project(moved));
            assert!((new_x - x - 40.0).abs() < 0.1 && (new_y - y + 25.0).abs() < 0.1, "{text}");
            assert!((moved.z - at.z).abs() < 1e-4);
        }
        let sun =
            shifted(&"sun direction=0,0,-1 power=1".parse().expect("a sun"), &camera, [90.0, 0.0], (height, origin));
        assert!(sun.direction().abs_diff_eq(Vec3::new(-0.5_f32.sqrt(), 0.0, -0.5_f32.sqrt()), 1e-5), "{sun}");
    }
}
