//! The scan behind and before the object. This is the one place where the viewer gets its backdrop from.

use crate::frames::Frame;
use crate::frames::points::PointDisplay;
use crate::scene::Camera;

/// The scan and the object in one picture.
pub struct Backdrop {
    /// Linear radiance of every pixel, the object among the points by depth.
    pub composed: Vec<[f32; 3]>,
}

/// The scan, displayed so, with the lit `frame` in it; `None` where nothing is to be shown, and the ground is plain.
///
/// Compositing has no passes yet: whatever is asked for, there is no backdrop.
pub fn backdrop(_display: Option<PointDisplay>, _frame: &Frame, _camera: &Camera) -> Option<Backdrop> {
    None
}
