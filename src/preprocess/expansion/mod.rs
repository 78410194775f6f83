//! From a cloud of low dynamic range and one HDR photo to an HDR cloud (Sabbadin 2019, 4).

pub mod poisson;

/// Which part of a colour the expansion changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Transfer {
    /// Each channel by itself.
    #[default]
    Rgb,
    /// Luminance alone: a point keeps the proportions of its LDR colour.
    Luminance,
}
