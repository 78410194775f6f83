//! Work on the CPU, once a scene: normals, spacing, the hierarchy. Knows no GPU.

pub mod hierarchy;
pub mod neighbours;
pub mod normals;
pub mod spacing;
