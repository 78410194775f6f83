//! Light probes that change over time (Hajisharif, Kronander, Miandji and Unger 2012, *Real-time Image Based Lighting
//! with Streaming HDR-light Probe Sequences*): how a picture of a probe becomes a panorama ([`mapping`]), which
//! panorama a frame number stands for ([`sequence`]), how frames are decoded ahead ([`stream`]) of the clock that plays
//! them ([`playback`]).

mod circle;
mod files;
pub mod mapping;
pub mod playback;
mod resample;
pub mod sequence;
pub mod stream;

pub use mapping::{Mapping, Unwrapper, unwrap};
pub use playback::{Late, Playback};
pub use sequence::{CrossFade, ProbeSequence, SequenceOptions};
pub use stream::{ProbeFrame, ProbeSource, ProbeStream, StreamOptions, StreamStats};
