//! A frame: one file a technique with the ordered list of its passes, and the renderer that cuts the work into pieces
//! that fit a memory budget.

mod batch;
pub mod composite;
mod feedback;
mod lamp_frames;
mod lamp_settings;
pub mod lamps;
mod pixels;
mod plan;
pub mod points;
pub mod probes;
mod region;
mod renderer;
mod scene;
mod shared;
mod tile_map;

use std::fmt;
use std::str::FromStr;

use crate::gpu::Profile;
pub use crate::passes::Paper;
pub use crate::passes::convolve::MaterialChoice;
use crate::{Error, Result};
pub use renderer::{CutPair, Renderer};
pub use scene::GpuScene;

/// How the cut of every pixel is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Technique {
    /// One invocation a pixel walks the whole hierarchy (Sabbadin 2019, 5.2).
    Classic,
    /// Pairs of nodes and receivers of the cone mipmap, refined by geometry shader alone (5.2.1).
    Mipmapped,
    /// The same until nodes are small, then depth first in compute (5.2.2).
    Hybrid,
    /// One cut and one buffer for all pixels of a tile of the cone mipmap; not in the paper.
    Shared,
}

impl Technique {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Classic, Self::Mipmapped, Self::Hybrid, Self::Shared];

    /// The name it has everywhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::Classic => "classic",
            Self::Mipmapped => "mipmapped",
            Self::Hybrid => "hybrid",
            Self::Shared => "shared",
        }
    }
}

impl fmt::Display for Technique {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Technique {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|t| t.name() == text)
            .ok_or_else(|| format!("{text:?} is no technique; there are classic, mipmapped, hybrid and shared"))
    }
}

/// A way of lighting an object, by its name on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(into = "String")]
pub enum Method {
    /// A cloud's light is gathered at each pixel.
    Cloud(Technique),
    /// Light from infinity alone, by spherical harmonics ([`probes`]).
    Probes,
    /// No object: the cloud itself in the light of lamps ([`lamps`]).
    Lamps,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Cloud(Technique::Classic),
        Self::Cloud(Technique::Mipmapped),
        Self::Cloud(Technique::Hybrid),
        Self::Cloud(Technique::Shared),
        Self::Probes,
        Self::Lamps,
    ];

    /// The name it has everywhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cloud(technique) => technique.name(),
            Self::Probes => "probes",
            Self::Lamps => "lamps",
        }
    }
}

impl From<Method> for String {
    fn from(method: Method) -> Self {
        method.name().to_owned()
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Method {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|method| method.name() == text).ok_or_else(|| {
            format!("{text:?} is no technique; there are classic, mipmapped, hybrid, shared, probes and lamps")
        })
    }
}

/// Technique, sizes and thresholds together, from curves of error over time (`bench truth`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// As quick as it gets while the light stays right.
    Draft,
    /// As good as a micro-buffer of 24x24 for each pixel, in a tenth of the time.
    #[default]
    Normal,
    /// Twice as good in three times the time.
    High,
}

impl Quality {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Draft, Self::Normal, Self::High];

    /// The name it has everywhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::Draft => "draft",
            Self::Normal => "normal",
            Self::High => "high",
        }
    }

    /// Settings of that quality.
    pub fn settings(self) -> Settings {
        let normal = Settings::default();
        match self {
            Self::Draft => Settings { microbuffer: 16, parallax: 2.0 * normal.parallax, sharp: false, ..normal },
            Self::Normal => normal,
            Self::High => Settings { microbuffer: 32, stop: 2.0, parallax: 0.5 * normal.parallax, ..normal },
        }
    }
}

impl FromStr for Quality {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|q| q.name() == text)
            .ok_or_else(|| format!("{text:?} is no quality; there are draft, normal and high"))
    }
}

/// Everything that a frame depends on besides scene and camera.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// How cuts are found.
    pub technique: Technique,
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Micro-pixels along a side: even, 8 to 64.
    pub microbuffer: u32,
    /// The paper's own ways.
    pub paper: Paper,
    /// What the object is made of.
    pub material: MaterialChoice,
    /// A node is rasterised when its solid angle is at most this many times a micro-pixel's (5.3: 4).
    pub stop: f64,
    /// Hybrid leaves the geometry shader at this many times a micro-pixel's solid angle (5.2.2: 32).
    pub switch: f64,
    /// Lobes narrower than a few micro-pixels get buffers of their own (never with the paper's ways).
    pub sharp: bool,
    /// Shared: tiles whose mean parallax is more than this many texels are split.
    pub parallax: f64,
    /// Most bytes of device objects at once.
    pub memory_budget: u64,
    /// Pairs that a feedback buffer holds; chosen from the budget where `None`.
    pub pair_capacity: Option<u32>,
}

impl Settings {
    /// Smallest and largest micro-buffer.
    pub const MICROBUFFER: std::ops::RangeInclusive<u32> = 8..=64;
    /// Default memory budget, bytes.
    pub const DEFAULT_BUDGET: u64 = 512 << 20;
    /// Default parallax of tiles, texels; the whole for diffuse surfaces, less for shinier ones.
    pub const DEFAULT_PARALLAX: f64 = 0.36;
}

impl Settings {
    /// Parallax of tiles for the material: shinier surfaces show more of it.
    pub(crate) fn tile_parallax(&self) -> f64 {
        let share = match self.material {
            MaterialChoice::Diffuse(_) => 1.0,
            MaterialChoice::File => 0.8,
            MaterialChoice::Metal(alpha) => 0.5 + 0.5 * f64::from(alpha),
        };
        self.parallax * share
    }

    /// GGX alpha below which lobes have buffers of their own, 0 for none: their width, about two alpha, is that of two
    /// and a half micro-pixels in the middle of a hemisphere's micro-buffer.
    pub(crate) fn sharp_alpha(&self) -> f32 {
        let possible = match self.material {
            MaterialChoice::Diffuse(_) => false,
            MaterialChoice::Metal(alpha) => alpha < 4.0 / self.microbuffer as f32,
            MaterialChoice::File => true,
        };
        if self.sharp && possible && self.paper == Paper::default() { 4.0 / self.microbuffer as f32 } else { 0.0 }
    }
}

impl Settings {
    /// [`Error::Argument`] or [`Error::Limit`] about the first setting that makes no sense.
    fn check(&self) -> Result<()> {
        let Self { width, height, microbuffer, .. } = *self;
        if width == 0 || height == 0 {
            return Err(Error::Argument(format!("the image is {width} x {height}; both sides must be at least 1")));
        }
        if width > 32_768 || height > 32_768 {
            return Err(Error::Limit(format!("the image is {width} x {height}; a side has at most 32768 pixels")));
        }
        if !Settings::MICROBUFFER.contains(&microbuffer) || microbuffer % 2 == 1 {
            return Err(Error::Argument(format!("a micro-buffer of {microbuffer} is not an even size from 8 to 64")));
        }
        if self.technique == Technique::Shared && self.paper != Paper::default() {
            return Err(Error::Argument(
                "technique shared has none of the paper's ways; take hybrid for --paper".into(),
            ));
        }
        if !(self.stop > 0.0 && self.switch >= self.stop) {
            return Err(Error::Argument(format!(
                "the thresholds are {} and {} micro-pixels; they must be positive and the second not below the first",
                self.stop, self.switch
            )));
        }
        Ok(())
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            technique: Technique::Shared,
            width: 512,
            height: 512,
            microbuffer: 24,
            paper: Paper::default(),
            material: MaterialChoice::File,
            stop: 4.0,
            switch: 32.0,
            sharp: true,
            parallax: Self::DEFAULT_PARALLAX,
            memory_budget: Self::DEFAULT_BUDGET,
            pair_capacity: None,
        }
    }
}

/// A finished image, row by row from the top.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Linear radiance; alpha is 1 on the object and 0 elsewhere.
    pub rgba: Vec<[f32; 4]>,
    /// World position, w as alpha.
    pub position: Vec<[f32; 4]>,
    /// World normal.
    pub normal: Vec<[f32; 4]>,
    /// Base colour and metallic.
    pub albedo: Vec<[f32; 4]>,
    /// What it took.
    pub stats: FrameStats,
}

impl Frame {
    /// One that shows no object.
    pub fn empty(width: u32, height: u32) -> Self {
        let nothing = vec![[0.0; 4]; width as usize * height as usize];
        let [rgba, position, normal, albedo] = [0; 4].map(|_| nothing.clone());
        Self { width, height, rgba, position, normal, albedo, stats: FrameStats::default() }
    }
}

/// What a frame took and did.
#[derive(Clone, Debug, Default)]
pub struct FrameStats {
    /// Pixels that show the object.
    pub covered_pixels: u64,
    /// Times and counts by pass.
    pub profile: Profile,
    /// [node, receiver] pairs looked at, in the geometry shader or in compute.
    pub visited_pairs: u64,
    /// Pairs that went into each iteration of the geometry shader, summed over batches; empty for classic.
    pub pairs_by_iteration: Vec<u64>,
    /// [node, pixel] pairs rasterised.
    pub rasterised_nodes: u64,
    /// Shared: tiles that light the image.
    pub tiles: u64,
    /// Pixels whose narrow lobes had buffers of their own.
    pub lobes: u64,
    /// Shared: pixels that were left to hybrid.
    pub per_pixel: u64,
    /// Batches of tiles that the traversal ran in.
    pub batches: u64,
    /// Batches that overflowed, were split and run again.
    pub splits: u64,
    /// Most bytes in transform feedback pairs at once.
    pub peak_feedback_bytes: u64,
    /// Bytes of micro-buffers alive at once.
    pub microbuffer_bytes: u64,
    /// Most bytes of device objects alive at once.
    pub device_bytes_peak: u64,
    /// Wall time from G-buffer to image, milliseconds.
    pub wall_ms: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_technique_has_its_name() {
        for method in Method::ALL {
            assert_eq!(method.name().parse(), Ok(method));
            assert_eq!(serde_json::to_value(method).expect("JSON"), method.name());
        }
        assert!("lamp".parse::<Method>().is_err());
    }
}
