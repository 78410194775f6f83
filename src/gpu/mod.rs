//! A thin layer over Vulkan: device, memory, reflection, pipelines, barriers, profiler, captures.

pub mod capabilities;
pub mod capture;
mod clock;
#[cfg(feature = "hot-reload")]
pub mod compile;
pub mod context;
pub(crate) mod graphics;
pub mod memory;
pub mod pipeline;
pub mod recorder;
pub mod reflect;
pub mod reload;
pub mod shaders;
pub mod uses;

pub use capture::Capture;
pub use context::{Capabilities, Context, ContextOptions};
pub use memory::{Buffer, Image};
pub use pipeline::{Bindings, ComputePipeline, Constant};
pub use recorder::{Profile, Recorder};
pub use uses::Use;
