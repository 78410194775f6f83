//! The lamps of a view, how their light is found, and what a scene file says about both.

use glam::DVec3;

use crate::Error;
use crate::formats::scene_file::LampTable;
use crate::frames::Method;
use crate::frames::lamps::{AlbedoFrom, Brush, LampSettings, Surfaces};
use crate::scene::Lamp;

/// Lamps that are not in the scan, and how their light is found in still pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct LampChoice {
    /// In the coordinates of the cloud's file.
    pub lamps: Vec<Lamp>,
    /// Times that their light is reflected.
    pub bounces: u32,
    /// Virtual point lights a bounce.
    pub vpls: u32,
    /// Side of the blocks of pixels that share all of these.
    pub interleave: u32,
    /// Texels along a side of a light's shadow map.
    pub ism_size: u32,
    /// Steps that fill a map's holes.
    pub ism_fill: u32,
    /// What the scan's surfaces are made of.
    pub surfaces: Surfaces,
    /// ... those of some colours.
    pub brushes: Vec<Brush>,
    /// Where the points' albedo comes from.
    pub albedo: AlbedoFrom,
    /// Share of the scan's own light that stays; by technique for `None` ([`LampChoice::share`]).
    pub scan_light: Option<f64>,
}

impl Default for LampChoice {
    fn default() -> Self {
        let LampSettings { bounces, vpls, interleave, ism_size, ism_fill, surfaces, brushes, albedo, .. } =
            LampSettings::default();
        let (lamps, scan_light) = (Vec::new(), None);
        Self { lamps, bounces, vpls, interleave, ism_size, ism_fill, surfaces, brushes, albedo, scan_light }
    }
}

impl LampChoice {
    /// Steps of pull and push that can be asked for: more than maps have levels.
    const ISM_FILL: std::ops::RangeInclusive<u32> = 0..=16;
    /// Shares of the scan's own light that can be asked for.
    const SCAN_LIGHT: std::ops::RangeInclusive<f64> = 0.0..=1e9;

    /// Settings of pictures, but for their size.
    pub fn settings(&self) -> LampSettings {
        let Self { bounces, vpls, interleave, ism_size, ism_fill, surfaces, albedo, .. } = *self;
        let brushes = self.brushes.clone();
        LampSettings {
            bounces,
            vpls,
            interleave,
            ism_size,
            ism_fill,
            surfaces,
            brushes,
            albedo,
            ..LampSettings::default()
        }
    }

    /// Share of the scan's own light that stays: all of it unless something else is said, but none where the lamps' light is
    /// all that is looked at.
    pub fn share(&self, method: Method) -> f32 {
        self.scan_light.unwrap_or(if method == Method::Lamps { 0.0 } else { 1.0 }) as f32
    }

    /// The lamps in the space of a cloud whose `origin` was subtracted.
    pub(super) fn relative_to(&self, origin: DVec3) -> Vec<Lamp> {
        self.lamps.iter().map(|lamp| lamp.relative_to(origin)).collect()
    }

    /// The lamps of a scene file; an error names the key.
    pub(super) fn of_table(table: &LampTable) -> Result<Self, String> {
        let mut lamps = Vec::new();
        for (text, number) in table.list.iter().zip(1..) {
            lamps.push(text.parse().map_err(|problem| format!("lamps.list, entry {number}: {problem}"))?);
        }
        let mut choice = Self { lamps, ..Self::default() };
        // One after the other, so that the first that makes no sense is the one that is named.
        let Self { bounces, vpls, interleave, ism_size, ism_fill, .. } = &mut choice;
        let given = [
            ("bounces", bounces, table.bounces),
            ("vpls", vpls, table.vpls),
            ("interleave", interleave, table.interleave),
            ("ism_size", ism_size, table.ism_size),
            ("ism_fill", ism_fill, table.ism_fill),
        ];
        for (key, own, value) in given {
            let Some(value) = value else { continue };
            *own = value;
            check(key, value)?;
        }
        if let Some(text) = &table.surfaces {
            choice.surfaces = text.parse().map_err(|problem| format!("lamps.surfaces: {problem}"))?;
        }
        for (text, number) in table.brushes.iter().zip(1..) {
            let brush = text.parse().map_err(|problem| format!("lamps.brushes, entry {number}: {problem}"))?;
            choice.brushes.push(brush);
        }
        Brush::check_all(&choice.brushes).map_err(|problem| format!("lamps.brushes: {problem}"))?;
        if let Some(text) = &table.albedo_from {
            choice.albedo = text.parse().map_err(|problem| format!("lamps.albedo_from: {problem}"))?;
        }
        if let Some(share) = table.scan_light.filter(|share| !Self::SCAN_LIGHT.contains(share)) {
            return Err(format!("lamps.scan_light is {share}, which is no share of light"));
        }
        choice.scan_light = table.scan_light;
        Ok(choice)
    }

    /// What a scene file says.
    pub(super) fn to_table(&self) -> LampTable {
        if *self == Self::default() {
            return LampTable::default();
        }
        LampTable {
            list: self.lamps.iter().map(Lamp::to_string).collect(),
            bounces: Some(self.bounces),
            vpls: Some(self.vpls),
            interleave: Some(self.interleave),
            ism_size: Some(self.ism_size),
            ism_fill: Some(self.ism_fill),
            surfaces: Some(self.surfaces.to_string()),
            brushes: self.brushes.iter().map(Brush::to_string).collect(),
            albedo_from: Some(self.albedo.to_string()),
            scan_light: self.scan_light,
        }
    }
}

/// Whether a setting makes sense by itself.
fn check(key: &str, value: u32) -> Result<(), String> {
    let default = LampSettings::default();
    let settings = match key {
        "bounces" => LampSettings { bounces: value, ..default },
        "vpls" => LampSettings { vpls: value, ..default },
        "interleave" => LampSettings { interleave: value, ..default },
        "ism_size" => LampSettings { ism_size: value, ..default },
        _ if LampChoice::ISM_FILL.contains(&value) => default,
        _ => return Err(format!("lamps.{key} is {value}; it is at most {}", LampChoice::ISM_FILL.end())),
    };
    settings.check().map_err(|error: Error| format!("lamps.{key}: {error}"))
}
