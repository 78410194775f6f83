//! Lights virtual objects with scanned places.
//!
//! The story, in the order in which data flows:
//!
//! 1. [`formats`] read a coloured point cloud, an object and a far field into [`scene`] types;
//!    [`probes`] have far fields that change over time, decoded ahead of the clock.
//! 2. [`preprocess`] estimates what the scan lacks (normals, spacing) and builds a bounding sphere hierarchy.
//! 3. [`gpu`] is a thin layer over Vulkan: device, memory, reflection, pipelines, barriers, profiler.
//! 4. [`passes`] hold one GPU pass a file; [`frames`] list the passes of a technique in order.
//! 5. [`mod@reference`] computes the same things slowly on the CPU, so that tests have something to trust.
//! 6. [`trace`] says when all of that happened, on one time line.
//! 7. [`compare`](mod@compare) tells how far two images are apart; [`cli`] is the command line over all of it,
//!    and [`viewer`] the window.
//!
//! World space is right-handed with +Y up, in metres; radiance is linear with Rec. 709 primaries, and 1.0 is the
//! white of an 8-bit cloud.

pub mod cli;
pub mod compare;
pub mod error;
pub mod formats;
pub mod frames;
pub mod gpu;
pub mod passes;
pub mod preprocess;
pub mod probes;
pub mod reference;
pub mod scene;
pub mod trace;
pub mod viewer;

pub use error::{Error, Result};
