//! What a person has chosen to see, and its scene file.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use glam::DVec3;

use crate::formats::cloud::Up;
use crate::formats::scene_file::{self, CameraTable, DisplayTable, PlacementTable, ProbeTable, RenderTable, SceneFile};
use crate::formats::tone::ToneCurve;
use crate::frames::points::PointDisplay;
use crate::frames::{MaterialChoice, Method, Quality, Settings, Technique};
use crate::probes::{CrossFade, Late, Mapping, ProbeSequence, SequenceOptions};
use crate::scene::{Placement, Viewpoint};
use crate::{Error, Result};

pub use super::lamps::LampChoice;

/// Enums with a name for each value.
pub trait Named: Copy + PartialEq + Sized + 'static {
    /// Values and their names, as files and menus have them.
    const NAMES: &'static [(Self, &'static str)];

    /// The value's name.
    fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(value, _)| *value == self).map_or("", |(_, name)| name)
    }

    /// The value of that name.
    fn named(text: &str) -> Option<Self> {
        Self::NAMES.iter().find(|(_, name)| *name == text).map(|(value, _)| *value)
    }
}

impl Named for ToneCurve {
    const NAMES: &'static [(Self, &'static str)] =
        &[(Self::Srgb, "srgb"), (Self::Filmic, "filmic"), (Self::Agx, "agx")];
}

impl Named for Option<PointDisplay> {
    const NAMES: &'static [(Self, &'static str)] = &[
        (None, "none"),
        (Some(PointDisplay::Raw), "raw"),
        (Some(PointDisplay::Filled), "filled"),
        (Some(PointDisplay::Normals), "normals"),
        (Some(PointDisplay::Headlight), "headlight"),
        (Some(PointDisplay::EyeDome), "eye-dome"),
    ];
}

impl Named for Up {
    const NAMES: &'static [(Self, &'static str)] = &[(Self::Y, "y"), (Self::Z, "z"), (Self::MinusY, "-y")];
}

/// In a sequence without end the cross-fade takes so long, seconds.
const FADE: f64 = 10.0;

/// Light probes, and how they are played.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeChoice {
    /// File, folder or pattern, as [`ProbeSequence::open`] has it.
    pub path: PathBuf,
    /// What the probes' pictures show.
    pub mapping: Mapping,
    /// Turn of the light about +Y, degrees a second.
    pub turn: f64,
    /// Frames a second.
    pub rate: f64,
    /// What they fade into.
    pub cross_fade: Option<PathBuf>,
    /// What happens to frames for which there was no time.
    pub late: Late,
}

impl ProbeChoice {
    /// Probes as their files have them.
    pub fn new(path: &Path) -> Self {
        let SequenceOptions { mapping, turn, rate, .. } = SequenceOptions::default();
        Self { path: path.to_owned(), mapping, turn, rate, cross_fade: None, late: Late::default() }
    }

    /// Opens the sequence; a cross-fade takes all frames of one that ends, and ten seconds of one that does not.
    ///
    /// # Errors
    /// Those of [`ProbeSequence::open`].
    pub fn open(&self) -> Result<ProbeSequence> {
        let options = |cross_fade| SequenceOptions {
            mapping: self.mapping,
            turn: self.turn,
            rate: self.rate,
            cross_fade,
            ..SequenceOptions::default()
        };
        let sequence = ProbeSequence::open(&self.path, &options(None))?;
        let Some(to) = self.cross_fade.clone() else { return Ok(sequence) };
        let frames = sequence.frames().unwrap_or(0..=(FADE * self.rate).ceil() as u64);
        ProbeSequence::open(&self.path, &options(Some(CrossFade { to, frames })))
    }
}

/// Everything that a picture depends on but its size.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewState {
    /// Cloud or saved hierarchy.
    pub cloud: Option<PathBuf>,
    /// The cloud's up axis.
    pub up: Up,
    /// Object.
    pub object: Option<PathBuf>,
    /// Far field.
    pub environment: Option<PathBuf>,
    /// Light probes, in the place of a far field.
    pub probes: Option<ProbeChoice>,
    /// Whether probes that change are played.
    pub playing: bool,
    /// Lamps that are not in the scan.
    pub lamps: LampChoice,
    /// Where the object stands.
    pub placement: Placement,
    /// From where it is seen; the object is framed for `None`.
    pub viewpoint: Option<Viewpoint>,
    /// Quality of still pictures.
    pub quality: Quality,
    /// Technique of still pictures; by quality for `None`.
    pub technique: Option<Method>,
    /// Micro-pixels along a side in still pictures; by quality for `None`.
    pub microbuffer: Option<u32>,
    /// What the object is made of.
    pub material: MaterialChoice,
    /// Exposure, stops.
    pub exposure: f32,
    /// Tone curve.
    pub tone: ToneCurve,
    /// Display of the scan's points; they are not shown for `None`.
    pub points: Option<PointDisplay>,
    /// Size of the picture that a scene file asks for, pixels.
    pub size: Option<[u32; 2]>,
}

impl Default for ViewState {
    fn default() -> Self {
        Self {
            cloud: None,
            up: Up::Y,
            object: None,
            environment: None,
            probes: None,
            playing: true,
            lamps: LampChoice::default(),
            placement: Placement::default(),
            viewpoint: None,
            quality: Quality::default(),
            technique: None,
            microbuffer: None,
            material: MaterialChoice::File,
            exposure: 0.0,
            tone: ToneCurve::default(),
            points: Some(PointDisplay::default()),
            size: None,
        }
    }
}

/// Places beyond this many metres are refused, as on the command line.
const FARTHEST: f64 = 1e12;
/// Scales and exposures beyond this are refused.
const LARGEST: f64 = 1e9;
/// Most pixels of a picture.
const MOST_PIXELS: u64 = 1 << 26;

impl ViewState {
    /// Reads a scene file and checks all values.
    ///
    /// # Errors
    /// [`Error::File`], naming the key that is wrong.
    pub fn read(path: &Path) -> Result<Self> {
        let file = scene_file::read(path)?;
        Self::of_file(&file).map_err(|problem| Error::file(path, problem))
    }

    /// Writes a scene file.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        scene_file::write(path, &self.to_file())
    }

    fn of_file(file: &SceneFile) -> Result<Self, String> {
        let SceneFile { placement, camera, render, display, .. } = file;
        let default = Self::default();
        let within = |key: &str, n: f64, low: f64, high: f64| {
            if (low..=high).contains(&n) {
                Ok(n)
            } else {
                Err(format!("{key} is {n}, which is not from {low} to {high}"))
            }
        };
        let number = |key: &str, n: Option<f64>, low: f64, high: f64, default: f64| {
            n.map_or(Ok(default), |n| within(key, n, low, high))
        };
        let vector = |key: &str, v: Option<[f64; 3]>| {
            v.map(|v| {
                v.into_iter().try_for_each(|n| within(key, n, -FARTHEST, FARTHEST).map(|_| ()))?;
                Ok::<_, String>(DVec3::from(v))
            })
            .transpose()
        };
        let fov = number("camera.fov", camera.fov, 0.1, 170.0, 30.0)?;
        let viewpoint = match (vector("camera.from", camera.from)?, vector("camera.at", camera.at)?) {
            (Some(from), Some(at)) if from.distance(at) <= 1e-6 * (1.0 + at.length()) => {
                return Err("camera.from and camera.at are the same point".into());
            }
            (Some(from), Some(at)) => Some(Viewpoint { from, at, fov }),
            (None, None) if camera.fov.is_none() => None,
            _ => return Err("camera.from and camera.at go together".into()),
        };
        let microbuffer = match render.microbuffer {
            Some(n) if !Settings::MICROBUFFER.contains(&n) || n % 2 == 1 => {
                return Err(format!("render.microbuffer is {n}, which is not an even size from 8 to 64"));
            }
            size => size,
        };
        let size = match file.size {
            Some([width, height])
                if width.min(height) == 0 || width.max(height) > 32_768 || pixels(width, height) > MOST_PIXELS =>
            {
                return Err(format!("size is {width} x {height}, which is no size of a picture"));
            }
            size => size,
        };
        let probes = match (probe_choice(&file.probes)?, &file.environment) {
            (Some(_), Some(_)) => return Err("environment and probes.path exclude each other".into()),
            (probes, _) => probes,
        };
        if let Some(ProbeChoice { turn, rate, .. }) = &probes {
            within("probes.turn", *turn, -LARGEST, LARGEST)?;
            within("probes.rate", *rate, 1.0 / LARGEST, LARGEST)?;
        }
        Ok(Self {
            cloud: file.cloud.clone(),
            up: named("up", file.up.as_deref(), default.up)?,
            object: file.object.clone(),
            environment: file.environment.clone(),
            probes,
            playing: file.probes.playing.unwrap_or(default.playing),
            lamps: LampChoice::of_table(&file.lamps)?,
            placement: Placement {
                at: vector("placement.at", placement.at)?,
                scale: number("placement.scale", placement.scale, 1.0 / LARGEST, LARGEST, 1.0)?,
                turn: number("placement.turn", placement.turn, -LARGEST, LARGEST, 0.0)?,
                up: match vector("placement.up", placement.up)? {
                    Some(up) if up.length() <= 1e-9 => return Err("placement.up has no length".into()),
                    up => up.unwrap_or(DVec3::Y),
                },
            },
            viewpoint,
            quality: parsed("render.quality", render.quality.as_deref())?.unwrap_or_default(),
            technique: parsed("render.technique", render.technique.as_deref())?,
            microbuffer,
            material: parsed("render.material", render.material.as_deref())?.unwrap_or(default.material),
            exposure: number("display.exposure", display.exposure, -LARGEST, LARGEST, 0.0)? as f32,
            tone: named("display.tone", display.tone.as_deref(), default.tone)?,
            points: named("display.points", display.points.as_deref(), default.points)?,
            size,
        })
    }

    fn to_file(&self) -> SceneFile {
        SceneFile {
            cloud: self.cloud.clone(),
            up: Some(self.up.name().to_owned()),
            object: self.object.clone(),
            environment: self.environment.clone(),
            probes: self.probes.as_ref().map_or_else(ProbeTable::default, |probes| ProbeTable {
                path: Some(probes.path.clone()),
                mapping: Some(probes.mapping.name().to_owned()),
                turn: Some(probes.turn),
                rate: Some(probes.rate),
                cross_fade: probes.cross_fade.clone(),
                late: Some(probes.late.name().to_owned()),
                playing: Some(self.playing),
            }),
            size: self.size,
            lamps: self.lamps.to_table(),
            placement: PlacementTable {
                at: self.placement.at.map(|at| at.to_array()),
                scale: Some(self.placement.scale),
                turn: Some(self.placement.turn),
                up: Some(self.placement.up.to_array()),
            },
            camera: self.viewpoint.map_or_else(CameraTable::default, |v| CameraTable {
                from: Some(v.from.to_array()),
                at: Some(v.at.to_array()),
                fov: Some(v.fov),
            }),
            render: RenderTable {
                quality: Some(self.quality.name().to_owned()),
                technique: self.technique.map(|t| t.name().to_owned()),
                microbuffer: self.microbuffer,
                material: Some(self.material.to_string()),
            },
            display: DisplayTable {
                exposure: Some(f64::from(self.exposure)),
                tone: Some(self.tone.name().to_owned()),
                points: Some(self.points.name().to_owned()),
            },
        }
    }

    /// The same without what only changes how a finished picture is shown.
    pub(super) fn without_display(&self) -> Self {
        let Self { exposure, tone, size, playing, .. } = Self::default();
        Self { exposure, tone, size, playing, ..self.clone() }
    }

    /// How still pictures are lit, with a scan or without, on a device that can do all techniques or only classic.
    pub(super) fn method(&self, scan: bool, feedback: bool) -> Method {
        match self.technique {
            _ if !scan => Method::Probes,
            Some(Method::Probes) => Method::Probes,
            _ if self.scan_alone() => Method::Lamps,
            _ if !feedback => Method::Cloud(Technique::Classic),
            Some(method @ Method::Cloud(_)) => method,
            Some(Method::Lamps) | None => Method::Cloud(self.quality.settings().technique),
        }
    }

    /// Whether the scan alone is shown in the light of lamps.
    pub(super) fn scan_alone(&self) -> bool {
        self.technique == Some(Method::Lamps) && self.cloud.is_some() && !self.lamps.lamps.is_empty()
    }

    /// The lamps, where they light anything: not where only probes do.
    pub(super) fn lit_by(&self, method: Method) -> Option<&LampChoice> {
        (self.cloud.is_some() && method != Method::Probes && !self.lamps.lamps.is_empty()).then_some(&self.lamps)
    }

    /// Whether there is an object and something that lights it, or a scan that lamps light.
    pub fn complete(&self) -> bool {
        let lit = self.cloud.is_some() || self.environment.is_some() || self.probes.is_some();
        self.scan_alone() || (self.object.is_some() && lit)
    }
}

/// The probes of a scene file, but for the range of their numbers.
fn probe_choice(table: &ProbeTable) -> Result<Option<ProbeChoice>, String> {
    let Some(path) = &table.path else {
        return if *table == ProbeTable::default() { Ok(None) } else { Err("probes.path is missing".into()) };
    };
    let default = ProbeChoice::new(path);
    Ok(Some(ProbeChoice {
        mapping: parsed("probes.mapping", table.mapping.as_deref())?.unwrap_or(default.mapping),
        turn: table.turn.unwrap_or(default.turn),
        rate: table.rate.unwrap_or(default.rate),
        cross_fade: table.cross_fade.clone(),
        late: parsed("probes.late", table.late.as_deref())?.unwrap_or(default.late),
        ..default
    }))
}

fn pixels(width: u32, height: u32) -> u64 {
    u64::from(width) * u64::from(height)
}

fn named<T: Named>(key: &str, text: Option<&str>, default: T) -> Result<T, String> {
    let Some(text) = text else { return Ok(default) };
    T::named(text).ok_or_else(|| {
        let names: Vec<&str> = T::NAMES.iter().map(|(_, name)| *name).collect();
        format!("{key} is {text:?}; there are {}", names.join(", "))
    })
}

fn parsed<T: FromStr<Err: fmt::Display>>(key: &str, text: Option<&str>) -> Result<Option<T>, String> {
    text.map(|text| text.parse().map_err(|problem| format!("{key}: {problem}"))).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_survives_its_file_to_the_bit() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("scene.toml");
        let state = ViewState {
            cloud: Some("/no/such/room.ply".into()),
            placement: Placement {
                at: Some(DVec3::new(0.1, 1.0 / 3.0, -4e6)),
                scale: 0.3,
                turn: -77.7,
                up: DVec3::new(0.0, 0.8, 0.6),
            },
            viewpoint: Some(Viewpoint { from: DVec3::new(1.0, 0.2, 1e-7), at: DVec3::ONE * 0.7, fov: 40.0 }),
            probes: Some(ProbeChoice {
                path: "/no/such/probe.##.exr".into(),
                mapping: Mapping::Angular,
                turn: -1.0 / 3.0,
                rate: 23.976,
                cross_fade: Some("/no/such/night".into()),
                late: Late::Wait,
            }),
            playing: false,
            lamps: LampChoice {
                lamps: [
                    "spot at=0.1,-2.2,1e-7 to=500000.3,0,0.7 power=0.3 angle=33.3 color=0.1,0.7,1e-3",
                    "point at=1,2,3 power=7.1",
                    "sun direction=0.3,-1,0.1 power=1e-3",
                ]
                .map(|text| text.parse().expect("a lamp"))
                .to_vec(),
                bounces: 3,
                vpls: 48,
                interleave: 4,
                ism_size: 16,
                ism_fill: 0,
                surfaces: "diffuse=0.7 specular=0.1 shininess=33.3".parse().expect("surfaces"),
                brushes: vec!["from=0,0.1,0 to=0.3,1,1 diffuse=0.3 specular=0.7".parse().expect("a brush")],
                albedo: "constant:0.3".parse().expect("an albedo"),
                scan_light: Some(1.0 / 3.0),
            },
            technique: Some(Method::Probes),
            microbuffer: Some(12),
            material: MaterialChoice::Metal(0.1),
            exposure: -1.3,
            tone: ToneCurve::Filmic,
            points: Some(PointDisplay::EyeDome),
            size: Some([320, 200]),
            up: Up::MinusY,
            ..ViewState::default()
        };
        state.write(&path).expect("a file");
        assert_eq!(ViewState::read(&path).expect("a scene"), state);
    }

    #[test]
    fn values_out_of_range_are_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("scene.toml");
        for (text, expected) in [
            ("[placement]\nscale = -1.0", "placement.scale"),
            ("[camera]\nfrom = [0, 0, 0]", "camera.at"),
            ("[camera]\nfrom = [0, 0, 0]\nat = [0, 0, 0]", "same point"),
            ("[render]\nmicrobuffer = 7", "render.microbuffer"),
            ("[render]\ntechnique = \"best\"", "render.technique"),
            ("[probes]\nturn = 1", "probes.path is missing"),
            ("[probes]\npath = \"p\"\nrate = 0", "probes.rate"),
            ("[probes]\npath = \"p\"\nmapping = \"flat\"", "probes.mapping"),
            ("[probes]\npath = \"p\"\nlate = \"never\"", "probes.late"),
            ("environment = \"e.exr\"\n[probes]\npath = \"p\"", "exclude each other"),
            (
                "[lamps]\nlist = [\"sun direction=0,-1,0 power=1\", \"spot at=0,0,0 to=0,1,0 power=1\"]",
                "lamps.list, entry 2",
            ),
            ("[lamps]\nlist = [\"lantern\"]", "begins with spot"),
            ("[lamps]\nbounces = 9", "lamps.bounces"),
            ("[lamps]\nvpls = 17", "lamps.vpls"),
            ("[lamps]\ninterleave = 3", "lamps.interleave"),
            ("[lamps]\nism_size = 12", "lamps.ism_size"),
            ("[lamps]\nism_fill = 99", "lamps.ism_fill"),
            ("[lamps]\nscan_light = -1", "lamps.scan_light"),
            ("[lamps]\nsurfaces = \"diffuse=2\"", "lamps.surfaces"),
            ("[lamps]\nbrushes = [\"from=0,0,0\"]", "lamps.brushes, entry 1"),
            ("[lamps]\nalbedo_from = \"light\"", "lamps.albedo_from"),
            ("[lamps]\nbrightness = 1", "brightness"),
            ("[display]\ntone = \"nice\"", "there are srgb, filmic"),
            ("size = [0, 9]", "size"),
            ("up = \"down\"", "up"),
        ] {
            std::fs::write(&path, text).expect("a file");
            let message = ViewState::read(&path).expect_err(text).to_string();
            assert!(message.contains("scene.toml") && message.contains(expected), "{message}");
        }
    }
}
