//! Work on the CPU, once a scene: normals, spacing, the cloud's dynamic range, the hierarchy. Knows no GPU.

mod clock;
pub mod directional_light;
pub mod distance_field;
pub mod expansion;
pub mod hierarchy;
pub mod neighbours;
pub mod normals;
pub mod panorama_room;
pub mod point_chunks;
pub mod simplify;
pub mod spacing;
pub mod transfer;
