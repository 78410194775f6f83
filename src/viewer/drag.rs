//! Drags that began on the picture.

use glam::Vec3;

use super::controller::Button;
use super::pick::Hit;

/// What a drag changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Grip {
    /// The camera, about what it looks at.
    Orbit,
    /// The camera, across the view.
    Pan,
    /// The direction of the view.
    Look,
    /// The object's place; where its base is seen from the pointer, pixels.
    Move { offset: [f32; 2] },
    /// The object's turn.
    Turn,
    /// The object's scale.
    Scale,
    /// What the chosen spot lights.
    LampTarget,
    /// Where the chosen lamp is.
    LampPlace,
}

/// A drag that goes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Drag {
    pub(super) button: Button,
    pub(super) grip: Grip,
}

/// Surfaces steeper than this carry nothing.
const LEVEL: f32 = 0.5;

/// Where an object's `base` goes when it is dragged to where a ray leads: onto the scan's surface if that can carry it,
/// else along the level plane through where it is.
pub(super) fn target(surface: Option<Hit>, eye: Vec3, direction: Vec3, base: Vec3) -> Option<Vec3> {
    if let Some(hit) = surface.filter(|hit| hit.normal.y.abs() > LEVEL && direction.y < 0.0) {
        return Some(hit.position);
    }
    let along = (base.y - eye.y) / direction.y;
    // A plane that is met far behind its horizon would throw the object out of sight.
    let farthest = 10.0 * base.distance(eye);
    (along.is_finite() && along > 0.0 && along < farthest).then(|| eye + direction * along)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_stand_on_what_carries_them() {
        let (eye, base) = (Vec3::new(0.0, 2.0, 3.0), Vec3::new(0.0, 0.5, 0.0));
        let direction = (Vec3::new(0.4, 1.0, 0.0) - eye).normalize();
        let hit = |normal| Hit { position: Vec3::new(0.4, 1.0, 0.0), normal, distance: 3.0 };
        assert_eq!(target(Some(hit(Vec3::Y)), eye, direction, base), Some(Vec3::new(0.4, 1.0, 0.0)));
        let beside = target(Some(hit(Vec3::Z)), eye, direction, base).expect("the plane");
        assert!((beside.y - 0.5).abs() < 1e-5 && beside.z < 0.0, "{beside}");
        assert_eq!(target(None, eye, Vec3::Y, base), None, "the sky carries nothing");
        assert_eq!(target(None, eye, Vec3::new(0.0, -1e-3, -1.0).normalize(), base), None, "nor does the horizon");
    }
}
