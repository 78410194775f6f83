//! Slow and plain: what the fast paths are held against.
//!
//! [`rooms`] describes places in code, [`path_tracer`] lights them, [`bake`](mod@bake) stores that light so that it
//! can be looked up, scanned as a point cloud and gathered at the pixels of an object ([`gather`](mod@gather)).
//! [`harmonics`] sums over panoramas; [`patches`] compares patches of images.

pub mod bake;
mod bvh;
pub mod caustics;
pub mod cut;
mod emitters;
pub mod gather;
pub mod harmonics;
pub mod lamps;
pub mod patches;
pub mod path_tracer;
pub mod points;
pub mod rooms;
pub(crate) mod sampling;
pub mod shapes;
pub mod transfer;
