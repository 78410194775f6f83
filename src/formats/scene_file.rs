//! Scene files: what is shown, from where and how, as TOML that a person can write. Paths are relative to the file.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{read_bytes, whole};
use crate::{Error, Result};

/// Largest scene file that is read, bytes: a mistaken drop of something else is not taken apart.
const MOST_BYTES: u64 = 1 << 20;

/// Contents of a scene file. What is left out is chosen as on the command line; names and ranges are those of the flags
/// of `relume render`, and are checked where they are used.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Cloud or saved hierarchy.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cloud: Option<PathBuf>,
    /// The cloud's up axis: `y`, `z` or `-y`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<String>,
    /// Object.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object: Option<PathBuf>,
    /// Lat-long far field.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment: Option<PathBuf>,
    /// Width and height, pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
    /// Light probes beyond the scan, in the place of the far field.
    #[serde(default, skip_serializing_if = "is_default")]
    pub probes: ProbeTable,
    /// Lamps that are not in the scan.
    #[serde(default, skip_serializing_if = "is_default")]
    pub lamps: LampTable,
    /// Where the object stands.
    #[serde(default, skip_serializing_if = "is_default")]
    pub placement: PlacementTable,
    /// From where it is seen.
    #[serde(default, skip_serializing_if = "is_default")]
    pub camera: CameraTable,
    /// How it is lit.
    #[serde(default, skip_serializing_if = "is_default")]
    pub render: RenderTable,
    /// How the picture is shown.
    #[serde(default, skip_serializing_if = "is_default")]
    pub display: DisplayTable,
}

/// `[probes]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProbeTable {
    /// File, folder or pattern.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub path: Option<PathBuf>,
    /// `lat-long`, `mirror-ball` or `angular`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mapping: Option<String>,
    /// Turn about +Y, degrees a second.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turn: Option<f64>,
    /// Frames a second.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
    /// File, folder or pattern of what they fade into.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cross_fade: Option<PathBuf>,
    /// What the viewer does with frames for which there was no time: `drop` or `wait`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub late: Option<String>,
    /// Whether the viewer plays them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub playing: Option<bool>,
}

/// `[lamps]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LampTable {
    /// As `--lamp` takes them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub list: Vec<String>,
    /// Times that their light is reflected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bounces: Option<u32>,
    /// Virtual point lights a bounce.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vpls: Option<u32>,
    /// Side of the blocks of pixels that share all of these.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interleave: Option<u32>,
    /// Texels along a side of a light's shadow map.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ism_size: Option<u32>,
    /// Steps of pull and push that fill its holes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ism_fill: Option<u32>,
    /// What the scan is made of, as `--surfaces` takes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surfaces: Option<String>,
    /// What colours are made of, as `--brush` takes it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub brushes: Vec<String>,
    /// `colour` or `constant:V`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub albedo_from: Option<String>,
    /// Share of the scan's own light that stays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scan_light: Option<f64>,
}

/// `[placement]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlacementTable {
    /// Where the object's origin goes, in the cloud's coordinates, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at: Option<[f64; 3]>,
    /// Scale about the object's own origin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Turn about +Y and the object's own origin, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turn: Option<f64>,
    /// Where the object's +Y points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
}

/// `[camera]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraTable {
    /// Eye, in the cloud's coordinates, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<[f64; 3]>,
    /// Point in the middle of the picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at: Option<[f64; 3]>,
    /// Vertical field of view, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fov: Option<f64>,
}

/// `[render]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RenderTable {
    /// `draft`, `normal` or `high`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<String>,
    /// `classic`, `mipmapped`, `hybrid`, `shared`, `probes` or `lamps`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub technique: Option<String>,
    /// Micro-pixels along a side.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub microbuffer: Option<u32>,
    /// `file`, `diffuse:ALBEDO` or `metal:ALPHA`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub material: Option<String>,
}

/// `[display]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DisplayTable {
    /// Stops.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure: Option<f64>,
    /// `srgb`, `filmic` or `agx`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tone: Option<String>,
    /// `none`, `raw`, `filled`, `normals`, `headlight` or `eye-dome`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<String>,
}

impl SceneFile {
    /// All of its paths.
    fn paths(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        let Self { cloud, object, environment, probes, .. } = self;
        [cloud, object, environment, &mut probes.path, &mut probes.cross_fade].into_iter().flatten()
    }
}

fn is_default<T: Default + PartialEq>(table: &T) -> bool {
    *table == T::default()
}

/// Reads a scene file; its paths come back relative to the working directory, or absolute.
///
/// # Errors
/// [`Error::File`] where it cannot be read, is no TOML, or has a key or a type of value that it should not have: the
/// message names line and key.
pub fn read(path: &Path) -> Result<SceneFile> {
    if std::fs::metadata(path).is_ok_and(|data| data.len() > MOST_BYTES) {
        return Err(Error::file(path, "is too large for a scene file, which has at most 1 MiB"));
    }
    let text = String::from_utf8(read_bytes(path)?).map_err(|_| Error::file(path, "is no text"))?;
    let mut scene: SceneFile = toml::from_str(&text).map_err(|e| Error::file(path, explain(&text, &e)))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    scene.paths().for_each(|file| *file = folder.join(&file));
    let SceneFile { placement, camera, display, probes, lamps, .. } = &scene;
    let vectors = [
        ("placement.at", placement.at),
        ("placement.up", placement.up),
        ("camera.from", camera.from),
        ("camera.at", camera.at),
    ];
    let numbers = [
        ("placement.scale", placement.scale),
        ("placement.turn", placement.turn),
        ("camera.fov", camera.fov),
        ("display.exposure", display.exposure),
        ("probes.turn", probes.turn),
        ("probes.rate", probes.rate),
        ("lamps.scan_light", lamps.scan_light),
    ];
    let vectors = vectors.into_iter().flat_map(|(key, v)| v.into_iter().flatten().map(move |n| (key, n)));
    let numbers = numbers.into_iter().filter_map(|(key, n)| n.map(|n| (key, n)));
    match vectors.chain(numbers).find(|(_, n)| !n.is_finite()) {
        Some((key, n)) => Err(Error::file(path, format!("{key} is {n}, which is not a finite number"))),
        None => Ok(scene),
    }
}

/// Line and key of what the parser complains about, and its complaint.
fn explain(text: &str, error: &toml::de::Error) -> String {
    let message = error.message();
    let Some(span) = error.span() else { return message.to_owned() };
    let start = span.start.min(text.len());
    let before = text.get(..start).unwrap_or("");
    let line_number = before.lines().count().max(1) + usize::from(before.ends_with('\n'));
    let line = text.lines().nth(line_number - 1).unwrap_or("");
    match line.split_once('=') {
        Some((key, _)) => format!("line {line_number}, key {}: {message}", super::excerpt(key)),
        None => format!("line {line_number}: {message}"),
    }
}

/// Writes a scene file, whole or not at all; paths below the file's folder become relative to it.
///
/// # Errors
/// [`Error::File`] where it cannot be written.
pub fn write(path: &Path, scene: &SceneFile) -> Result<()> {
    let mut scene = scene.clone();
    let folder = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    let folder = folder.canonicalize().map_err(|e| Error::file(path, format!("cannot be written: {e}")))?;
    for file in scene.paths() {
        // A file whose folder went away keeps the name that it had.
        if let Some(whole) = canonical(file) {
            *file = whole.strip_prefix(&folder).map(Path::to_owned).unwrap_or(whole);
        }
    }
    let text = toml::to_string(&scene).map_err(|e| Error::file(path, format!("cannot be written: {e}")))?;
    whole::write(path, |file| {
        std::io::Write::write_all(file, text.as_bytes())
            .map_err(|e| Error::file(path, format!("cannot be written: {e}")))
    })
}

/// The whole path of a file, or of a pattern, which is no file itself.
fn canonical(path: &Path) -> Option<PathBuf> {
    let beside = || {
        let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
        Some(folder.canonicalize().ok()?.join(path.file_name()?))
    };
    path.canonicalize().ok().or_else(beside)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(text: &str) -> String {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, text).expect("a file");
        read(&path).expect_err("a bad scene").to_string()
    }

    #[test]
    fn what_is_written_comes_back_with_paths_beside_the_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("scene.toml");
        std::fs::write(folder.path().join("room.ply"), "").expect("a file");
        let scene = SceneFile {
            cloud: Some(folder.path().join("room.ply")),
            probes: ProbeTable { path: Some(folder.path().join("p.##.exr")), turn: Some(-0.1), ..Default::default() },
            size: Some([640, 360]),
            lamps: LampTable {
                list: vec!["point at=0.1,-2,1e6 power=3".into(), "sun direction=0,-1,0 power=1".into()],
                scan_light: Some(0.1),
                ..Default::default()
            },
            placement: PlacementTable { at: Some([0.1, -2.0, 1e6 + 0.125]), turn: Some(25.0), ..Default::default() },
            render: RenderTable { material: Some("metal:0.25".into()), ..Default::default() },
            ..SceneFile::default()
        };
        write(&path, &scene).expect("a scene file");
        let text = std::fs::read_to_string(&path).expect("text");
        assert!(text.contains("cloud = \"room.ply\"") && text.contains("path = \"p.##.exr\""), "{text}");
        assert_eq!(read(&path).expect("a scene"), scene);
    }

    #[test]
    fn errors_name_line_and_key() {
        let unknown = message("cloud = \"a.ply\"\nclowd = \"b.ply\"\n");
        assert!(unknown.contains("scene.toml") && unknown.contains("clowd") && unknown.contains("line 2"), "{unknown}");
        let kind = message("[camera]\nfov = \"wide\"\n");
        assert!(kind.contains("line 2, key fov"), "{kind}");
        assert!(message("[camera]\nfov = nan\n").contains("camera.fov is NaN"));
        assert!(message("[lamps]\nscan_light = inf\n").contains("lamps.scan_light is inf"));
        assert!(message("[lamps]\nvpls = -16\n").contains("line 2, key vpls"));
        assert!(message("cloud = ").contains("line 1"));
    }
}
