//! From a cloud of low dynamic range and one HDR photo to an HDR cloud (Sabbadin 2019, 4).

pub mod shots;
pub mod patchmatch;
pub mod pyramid;
pub mod exposure;
pub mod matching;
pub mod scouts;
pub mod registration;
