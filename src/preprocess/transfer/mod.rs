//! Placeholder until the branch is merged.

/// Transfer.
#[derive(Clone, Debug)]
pub struct Transfer {
    /// Bands.
    pub order: usize,
    /// Directions.
    pub samples: u32,
    /// Bounces.
    pub bounces: u32,
    /// 1 or 3.
    pub channels: usize,
    /// Vertices.
    pub vertices: usize,
    /// Coefficients.
    pub coefficients: Vec<f32>,
}
