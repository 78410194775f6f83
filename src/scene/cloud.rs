//! A coloured point cloud.

use glam::{DVec3, Vec3};

/// Points of a scanned place. All non-empty vectors have the same length.
#[derive(Clone, Debug, Default)]
pub struct Cloud {
    /// Positions in world space, metres, relative to [`Cloud::origin`]; always finite.
    pub positions: Vec<Vec3>,
    /// Linear Rec. 709 radiance; finite and non-negative.
    pub colors: Vec<Vec3>,
    /// Unit normals; empty until estimated where the file has none.
    pub normals: Vec<Vec3>,
    /// Distance between neighbours around each point, metres; empty until estimated. A point stands for a disc of
    /// this diameter squared in area, and for a sphere of this radius when it becomes a leaf of the hierarchy.
    pub spacing: Vec<f32>,
    /// What was subtracted from the file's coordinates, in f64, before they were rounded to f32. Zero unless the
    /// file's coordinates are so large that f32 would lose detail.
    pub origin: DVec3,
    /// Where the scanner stood, when the file says so (organised clouds, PCD VIEWPOINT), in the same space as
    /// `positions`.
    pub viewpoint: Option<Vec3>,
}

impl Cloud {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// True when there is no point.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }
}
