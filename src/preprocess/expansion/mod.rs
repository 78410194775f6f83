//! From a cloud of low dynamic range and one HDR photo to an HDR cloud (Sabbadin 2019, 4).

pub mod network;
