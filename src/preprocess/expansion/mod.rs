//! From a cloud of low dynamic range and one HDR photo to an HDR cloud (Sabbadin 2019, 4).
//!
//! [`expand`] is the way through: the photo's exposure ([`exposure`], refined by [`registration`] where the photo is found
//! in the cloud), shots of the cloud ([`shots`]), their over-exposed pixels expanded by one of the strategies ([`tone`],
//! [`network`], [`matching`] by [`patchmatch`]), the result projected on the points ([`reprojection`]), and what no shot
//! tells filled from its neighbours ([`poisson`]).

mod expand;
pub mod exposure;
mod matching;
pub mod network;
pub mod patchmatch;
mod places;
mod point_shots;
pub mod poisson;
pub mod pyramid;
pub mod registration;
mod reprojection;
mod scouts;
pub mod shots;
mod simplex;
pub mod tone;

use glam::Vec3;

pub use expand::expand;
pub use shots::ShotsBy;

use crate::scene::{Cloud, Picture};

/// How over-exposed areas are expanded (Sabbadin 2019, 4.1 and 6.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Strategy {
    /// By what looks alike in the photo (PMATCH).
    #[default]
    PatchMatch,
    /// Landis' operator on the shots (LANDIS).
    Landis,
    /// Banterle's operator on the shots (BANTERLE).
    Banterle,
    /// Landis' operator on the points (LANDISPC).
    LandisPoints,
    /// Banterle's operator on the points (BANTERLEPC).
    BanterlePoints,
    /// A neural network on the shots (EILER, ENDO).
    Network,
}

impl Strategy {
    /// All of them, in the order of Table 2.
    pub const ALL: [Self; 6] =
        [Self::Banterle, Self::Landis, Self::BanterlePoints, Self::LandisPoints, Self::Network, Self::PatchMatch];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::PatchMatch => "patchmatch",
            Self::Landis => "landis",
            Self::Banterle => "banterle",
            Self::LandisPoints => "landis-points",
            Self::BanterlePoints => "banterle-points",
            Self::Network => "network",
        }
    }

    /// True where it works on shots.
    pub fn takes_shots(self) -> bool {
        !matches!(self, Self::LandisPoints | Self::BanterlePoints)
    }

    /// The operators know luminance alone.
    pub fn knows_colors(self) -> bool {
        matches!(self, Self::Network | Self::PatchMatch)
    }
}

/// Which part of a colour the expansion changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Transfer {
    /// Each channel by itself.
    #[default]
    Rgb,
    /// Luminance alone: a point keeps the proportions of its LDR colour.
    Luminance,
}

/// Where shots are taken from.
#[derive(Clone, Debug, PartialEq)]
pub enum Places {
    /// As many as this, found by relume.
    Auto(usize),
    /// In the space of [`Cloud::positions`].
    At(Vec<Vec3>),
}

/// What goes in beside the options.
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    /// The cloud, with normals and spacing; linear colours, 1.0 is the LDR white.
    pub cloud: &'a Cloud,
    /// HDR photo of any part of the place.
    pub photo: Option<&'a Picture>,
    /// For [`Strategy::Network`]; the built-in one where it is `None`.
    pub network: Option<&'a network::Network>,
}

/// How to expand.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// The strategy.
    pub strategy: Strategy,
    /// What is transferred; operators that know luminance alone transfer only that.
    pub transfer: Transfer,
    /// The photo's exposure, where it is known.
    pub alpha: Option<f32>,
    /// Where shots are taken from.
    pub places: Places,
    /// Pixels along a side of a shot's faces.
    pub shot_size: u32,
    /// How they are rendered.
    pub shots_by: ShotsBy,
    /// t_l: points of a larger luminance are over-exposed.
    pub threshold: f32,
    /// t_h: matches of a larger cost are no matches.
    pub match_threshold: f32,
    /// k: neighbours of a point in the Poisson system.
    pub neighbours: usize,
    /// Luminance of what is brightest where no photo tells, for the operators.
    pub maximum: f32,
    /// Seed of the search.
    pub seed: u64,
    /// Keep pictures of all steps.
    pub pictures: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            strategy: Strategy::default(),
            transfer: Transfer::default(),
            alpha: None,
            places: Places::Auto(3),
            shot_size: 1024,
            shots_by: ShotsBy::default(),
            threshold: 0.9,
            match_threshold: 1.0,
            neighbours: poisson::DEFAULT_NEIGHBOURS,
            maximum: 10.0,
            seed: 1,
            pictures: false,
        }
    }
}

/// Where a point's colour comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Origin {
    /// Well exposed: its own.
    Kept = 0,
    /// An expanded shot, or an operator on the points.
    Projected = 1,
    /// Its neighbours (Eq. 2).
    Solved = 2,
    /// Nothing is known around it: its own, though over-exposed.
    Filled = 3,
}

/// What comes out.
#[derive(Clone, Debug)]
pub struct Expansion {
    /// Linear colours of all points, 1.0 is the LDR white.
    pub colors: Vec<Vec3>,
    /// Where each comes from.
    pub origins: Vec<Origin>,
    /// Numbers about it.
    pub report: Report,
    /// Where they were asked for: one of each shot.
    pub pictures: Vec<ShotPictures>,
}

/// Numbers about an expansion.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Points of the cloud.
    pub points: usize,
    /// Of these, over-exposed.
    pub over_exposed: usize,
    /// Of these, seen in no shot.
    pub unseen: usize,
    /// Of the seen ones, without a match that is good enough.
    pub unmatched: usize,
    /// Solved by Eq. 2.
    pub solved: usize,
    /// Left as they were.
    pub filled: usize,
    /// Median cost of the matches of the seen ones, with [`Strategy::PatchMatch`].
    pub median_cost: Option<f32>,
    /// Exposure by histograms, with a photo.
    pub exposure: Option<exposure::Exposure>,
    /// The photo's place, where it was found.
    pub registration: Option<registration::Registration>,
    /// Exposure that was used.
    pub alpha: Option<f32>,
    /// Places of the shots, in the space of [`Cloud::positions`].
    pub shots: Vec<Vec3>,
    /// Patches that were compared.
    pub compared: u64,
    /// Iterations of the solver.
    pub iterations: usize,
    /// Relative residual of Eq. 2.
    pub residual: f64,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Wall-clock seconds of each step, in order.
    pub seconds: Vec<(&'static str, f64)>,
}

/// Pictures of one shot: the six faces side by side, three in a row. All have the same size.
#[derive(Clone, Debug)]
pub struct ShotPictures {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Point that each pixel shows; [`shots::NO_POINT`] where there is none.
    pub points: Vec<u32>,
    /// Linear radiance after the expansion, before it is projected.
    pub expanded: Picture,
    /// With [`Strategy::PatchMatch`]: where in the photo each over-exposed pixel was found, its x in red, its y in green,
    /// cost over t_h in blue; the rest of the shot in dark grey.
    pub matched: Option<Picture>,
}
