//! Flags about lamps that are not in the scan.

use super::values;
use crate::frames::lamps::{AlbedoFrom, Brush, LampSettings, Surfaces};
use crate::scene::Lamp;
use crate::viewer::state::LampChoice;

/// Lamps and how their light is found; what is not given is the default, or what the scene says.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct LampArgs {
    /// A lamp that is not in the scan, as often as there are lamps: "spot at=X,Y,Z to=X,Y,Z power=W angle=DEG
    /// [color=R,G,B]", "point at=X,Y,Z power=W" or "sun direction=X,Y,Z power=W"
    #[arg(long = "lamp", value_name = "LAMP", value_parser = str::parse::<Lamp>)]
    pub(super) lamps: Vec<Lamp>,
    /// Virtual point lights a bounce, a multiple of 16 [default: 256]
    #[arg(long, value_name = "N")]
    vpls: Option<u32>,
    /// Side of the blocks of pixels that share all these lights among them: 1, 2 or 4 [default: 2]
    #[arg(long, value_name = "N")]
    interleave: Option<u32>,
    /// Texels along a side of a light's imperfect shadow map, a power of two [default: 32]
    #[arg(long, value_name = "N")]
    ism_size: Option<u32>,
    /// Steps of pull and push that fill a map's holes [default: 2]
    #[arg(long, value_name = "N")]
    ism_fill: Option<u32>,
    /// What the scan's surfaces are made of: "[diffuse=D] [specular=S] [shininess=N]" [default: diffuse alone]
    #[arg(long, value_name = "SURFACES", value_parser = str::parse::<Surfaces>)]
    surfaces: Option<Surfaces>,
    /// ... those of the colours in a range, linear: "from=R,G,B to=R,G,B [diffuse=D] [specular=S] [shininess=N]"; up to
    /// eight, the first that fits wins
    #[arg(long = "brush", value_name = "BRUSH", value_parser = str::parse::<Brush>)]
    brushes: Vec<Brush>,
    /// Albedo of the scan's points: colour, which takes theirs, or constant:V
    #[arg(long, value_name = "FROM")]
    albedo_from: Option<AlbedoFrom>,
    /// Share of the scan's own light that stays, 0 for a dark room [default: 1; 0 with technique lamps]
    #[arg(long, value_name = "SHARE", value_parser = values::not_negative, allow_hyphen_values = true)]
    pub(super) scan_light: Option<f64>,
}

impl LampArgs {
    /// Whether any flag but `--lamp` is given.
    pub(super) fn any_setting(&self) -> bool {
        let Self { lamps: _, vpls, interleave, ism_size, ism_fill, surfaces, brushes, albedo_from, scan_light } = self;
        vpls.or(*interleave).or(*ism_size).or(*ism_fill).is_some()
            || scan_light.is_some()
            || surfaces.is_some()
            || !brushes.is_empty()
            || albedo_from.is_some()
    }

    /// Takes the place of what a scene says: all of its lamps, or single settings.
    pub(super) fn replace(&self, choice: &mut LampChoice, bounces: Option<u32>) {
        let Self { lamps, vpls, interleave, ism_size, ism_fill, surfaces, brushes, albedo_from, scan_light } = self;
        choice.surfaces = surfaces.unwrap_or(choice.surfaces);
        choice.albedo = albedo_from.unwrap_or(choice.albedo);
        if !brushes.is_empty() {
            choice.brushes.clone_from(brushes);
        }
        if !lamps.is_empty() {
            choice.lamps.clone_from(lamps);
        }
        for (own, flag) in [
            (&mut choice.bounces, bounces),
            (&mut choice.vpls, *vpls),
            (&mut choice.interleave, *interleave),
            (&mut choice.ism_size, *ism_size),
            (&mut choice.ism_fill, *ism_fill),
        ] {
            *own = flag.unwrap_or(*own);
        }
        choice.scan_light = scan_light.or(choice.scan_light);
    }

    /// For pictures of `width` x `height` pixels under a budget in bytes, after so many bounces.
    pub(super) fn settings(
        &self,
        (width, height): (u32, u32),
        bounces: Option<u32>,
        memory_budget: u64,
    ) -> LampSettings {
        let default = LampSettings::default();
        LampSettings {
            width,
            height,
            bounces: bounces.unwrap_or(default.bounces),
            vpls: self.vpls.unwrap_or(default.vpls),
            interleave: self.interleave.unwrap_or(default.interleave),
            ism_size: self.ism_size.unwrap_or(default.ism_size),
            ism_fill: self.ism_fill.unwrap_or(default.ism_fill),
            surfaces: self.surfaces.unwrap_or(default.surfaces),
            brushes: self.brushes.clone(),
            albedo: self.albedo_from.unwrap_or(default.albedo),
            memory_budget,
            ..default
        }
    }
}
