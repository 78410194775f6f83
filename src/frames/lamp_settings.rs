//! What pictures of lit clouds depend on besides cloud, camera and lamps.

use crate::passes::lamp_view::Materials;
use crate::scene::surfaces::{AlbedoFrom, Brush, Surfaces};
use crate::{Error, Result};

/// Everything that the picture of a lit cloud depends on besides cloud, camera and lamps.
#[derive(Clone, Debug, PartialEq)]
pub struct LampSettings {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Times that light is reflected; 0 for direct light alone.
    pub bounces: u32,
    /// Virtual point lights a bounce, a multiple of 16.
    pub vpls: u32,
    /// Side of the blocks of pixels that share all lights among them: 1, 2 or 4.
    pub interleave: u32,
    /// Texels along a side of a light's shadow map, a power of two.
    pub ism_size: u32,
    /// Steps of pull and push that fill its holes.
    pub ism_fill: u32,
    /// Points that a map gets at least, by as many rounds over the cloud as that takes.
    pub ism_points: u32,
    /// Pixels along a side of a lamp's view, a power of two.
    pub light_size: u32,
    /// Most points that views of lamps and camera are made of; fewer are a thinner cloud.
    pub most_points: Option<u64>,
    /// What surfaces are made of that no brush is about.
    pub surfaces: Surfaces,
    /// What surfaces of chosen colours are made of; the first that fits wins, at most [`Brush::MOST`].
    pub brushes: Vec<Brush>,
    /// Where the albedos of points come from.
    pub albedo: AlbedoFrom,
    /// Most bytes of device objects.
    pub memory_budget: u64,
}

impl Default for LampSettings {
    fn default() -> Self {
        Self {
            width: 512,
            height: 512,
            bounces: 2,
            vpls: 256,
            interleave: 2,
            ism_size: 32,
            ism_fill: 2,
            ism_points: 4096,
            light_size: 512,
            most_points: None,
            surfaces: Surfaces::default(),
            brushes: Vec::new(),
            albedo: AlbedoFrom::default(),
            memory_budget: super::Settings::DEFAULT_BUDGET,
        }
    }
}

impl LampSettings {
    /// Bounces that can be asked for.
    pub const BOUNCES: std::ops::RangeInclusive<u32> = 0..=8;
    /// Lights that can be asked for.
    pub const VPLS: std::ops::RangeInclusive<u32> = 16..=16_384;
    /// Sizes of shadow maps that can be asked for.
    pub const ISM_SIZE: std::ops::RangeInclusive<u32> = 8..=256;
    /// Most views of lamps at once, of which a point takes six.
    pub const MOST_VIEWS: usize = 64;

    /// Bytes of device objects that do not depend on the cloud: five images of the camera, those of a lamp, and all maps
    /// with their coarser levels.
    pub(super) fn bytes(&self) -> u64 {
        let [width, height, vpls, ism_size, light] =
            [self.width, self.height, self.vpls, self.ism_size, self.light_size].map(u64::from);
        width * height * 7 * 16 + light * light * 6 * 16 + vpls * ism_size * ism_size * 16 / 3
    }

    pub(super) fn materials(&self) -> Materials<'_> {
        Materials { surfaces: self.surfaces, brushes: &self.brushes, albedo: self.albedo }
    }

    /// Whether any surface has a mirror's lobe.
    pub(super) fn glossy(&self) -> bool {
        self.surfaces.specular > 0.0 || self.brushes.iter().any(|brush| brush.surfaces.specular > 0.0)
    }

    /// [`Error::Limit`] where objects of that size do not fit the budget.
    pub(super) fn check_budget(&self) -> Result<()> {
        let needed = self.bytes();
        if needed > self.memory_budget {
            return Err(Error::Limit(format!(
                "{}x{} pixels and {} shadow maps of {4}x{4} texels need {3} MiB, the memory budget is {5} MiB",
                self.width,
                self.height,
                self.vpls,
                needed.div_ceil(1 << 20),
                self.ism_size,
                self.memory_budget >> 20
            )));
        }
        Ok(())
    }

    /// Whether they make sense.
    ///
    /// # Errors
    /// [`Error::Argument`] about the first setting that does not.
    pub fn check(&self) -> Result<()> {
        let Self { bounces, vpls, interleave, ism_size, light_size, .. } = *self;
        let problem = if !Self::BOUNCES.contains(&bounces) {
            format!("{bounces} bounces of light; at most {}", Self::BOUNCES.end())
        } else if !Self::VPLS.contains(&vpls) || vpls % 16 != 0 {
            let (low, high) = (Self::VPLS.start(), Self::VPLS.end());
            format!("{vpls} virtual point lights; a multiple of 16 from {low} to {high}")
        } else if ![1, 2, 4].contains(&interleave) {
            format!("an interleaving of {interleave}; it is 1, 2 or 4")
        } else if !Self::ISM_SIZE.contains(&ism_size) || !ism_size.is_power_of_two() {
            let (low, high) = (Self::ISM_SIZE.start(), Self::ISM_SIZE.end());
            format!("shadow maps of {ism_size} texels a side; a power of two from {low} to {high}")
        } else if !(16..=2048).contains(&light_size) || !light_size.is_power_of_two() {
            format!("views of lamps of {light_size} pixels a side; a power of two from 16 to 2048")
        } else {
            let materials = self.surfaces.check().map_err(|problem| format!("surfaces: {problem}"));
            let materials = materials.and_then(|()| Brush::check_all(&self.brushes)).and_then(|()| self.albedo.check());
            return materials.map_err(Error::Argument);
        };
        Err(Error::Argument(problem))
    }
}
