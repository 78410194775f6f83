//! `relume render --scene FILE.toml`: what the scene says stands where the command line has no flag of that name.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::Result;
use crate::frames::Method;
use crate::viewer::ViewState;
use crate::viewer::state::{LampChoice, Named};

/// The arguments of `render`, those of a `--scene` among them; all others are returned as they are.
///
/// # Errors
/// A scene that cannot be read, or that has a value that makes no sense.
pub(super) fn expanded(mut arguments: Vec<OsString>) -> Result<Vec<OsString>> {
    if arguments.get(1).is_none_or(|verb| verb != "render") {
        return Ok(arguments);
    }
    let Some(path) = value_of(&arguments, "--scene") else { return Ok(arguments) };
    let mut state = ViewState::read(Path::new(&path))?;
    // Flags that may be given several times are added one by one: what counts is what was typed.
    let typed = arguments.clone();
    let given = |flag| typed.iter().skip(2).any(|argument| names(argument, flag));
    if let Some(technique) = value_of(&typed, "--technique") {
        state.technique = technique.to_string_lossy().parse().ok();
    }
    let lit = (given("--lamp") || !state.lamps.lamps.is_empty()) && (given("--cloud") || state.cloud.is_some());
    match state.technique {
        Some(Method::Lamps) if lit => (state.object, state.environment, state.probes) = (None, None, None),
        Some(Method::Lamps) => state.technique = None,
        _ => {}
    }
    let far = state.environment.is_some() || state.probes.is_some();
    // One kind of far field takes the place of the other.
    let (environment, probes) = (given("--environment"), given("--probes"));
    if environment {
        state.probes = None;
    }
    if probes {
        state.environment = None;
    }
    let mut all = flags(&state, far || environment || probes);
    if lit && state.technique != Some(Method::Probes) {
        all.extend(lamp_flags(&state.lamps));
    }
    for (flag, value) in all.into_iter().filter(|(flag, _)| !given(flag)) {
        arguments.push(flag.into());
        arguments.push(value);
    }
    Ok(arguments)
}

/// Lamps, and how their light is found.
fn lamp_flags(choice: &LampChoice) -> Vec<(&'static str, OsString)> {
    let LampChoice { lamps, bounces, vpls, interleave, ism_size, ism_fill, surfaces, brushes, albedo, scan_light } =
        choice;
    let mut flags: Vec<(&str, String)> = lamps.iter().map(|lamp| ("--lamp", lamp.to_string())).collect();
    flags.extend([
        ("--bounces", bounces.to_string()),
        ("--vpls", vpls.to_string()),
        ("--interleave", interleave.to_string()),
        ("--ism-size", ism_size.to_string()),
        ("--ism-fill", ism_fill.to_string()),
        ("--surfaces", surfaces.to_string()),
        ("--albedo-from", albedo.to_string()),
    ]);
    flags.extend(brushes.iter().map(|brush| ("--brush", brush.to_string())));
    flags.extend(scan_light.map(|share| ("--scan-light", share.to_string())));
    flags.into_iter().map(|(flag, value)| (flag, value.into())).collect()
}

/// Whether an argument is a flag, with or without a value behind `=`.
fn names(argument: &OsStr, flag: &str) -> bool {
    let argument = argument.to_string_lossy();
    argument.strip_prefix(flag).is_some_and(|rest| rest.is_empty() || rest.starts_with('='))
}

fn value_of(arguments: &[OsString], flag: &str) -> Option<OsString> {
    let at = arguments.iter().position(|argument| names(argument, flag))?;
    match arguments[at].to_string_lossy().split_once('=') {
        Some((_, value)) => Some(value.into()),
        None => arguments.get(at + 1).cloned(),
    }
}

/// Flags of `render` that say what a scene says, in front of a far field or of none.
fn flags(state: &ViewState, far: bool) -> Vec<(&'static str, OsString)> {
    let vector = |v: DVec3| format!("{},{},{}", v.x, v.y, v.z);
    let path = |path: &Option<PathBuf>| path.as_ref().map(|path| path.clone().into_os_string());
    let text = |text: String| Some(OsString::from(text));
    let viewpoint = state.viewpoint;
    let probes = state.probes.as_ref();
    let backdrop = match state.points {
        _ if state.technique == Some(Method::Lamps) => None,
        Some(_) if state.cloud.is_some() => Some("points"),
        _ if far => Some("environment"),
        _ => None,
    };
    let list = [
        ("--cloud", path(&state.cloud)),
        ("--object", path(&state.object)),
        ("--environment", path(&state.environment)),
        ("--probes", probes.map(|probes| probes.path.clone().into_os_string())),
        ("--mapping", probes.map(|probes| probes.mapping.name().into())),
        ("--turn", probes.map(|probes| probes.turn.to_string().into())),
        ("--rate", probes.map(|probes| probes.rate.to_string().into())),
        ("--cross-fade", probes.and_then(|probes| path(&probes.cross_fade))),
        ("--up", text(state.up.name().into())),
        ("--object-at", state.placement.at.map(|at| vector(at).into())),
        ("--object-scale", text(state.placement.scale.to_string())),
        ("--object-up", text(vector(state.placement.up))),
        ("--object-turn", text(state.placement.turn.to_string())),
        ("--camera-from", viewpoint.map(|v| vector(v.from).into())),
        ("--camera-at", viewpoint.map(|v| vector(v.at).into())),
        ("--fov", viewpoint.map(|v| v.fov.to_string().into())),
        ("--size", state.size.map(|[width, height]| format!("{width}x{height}").into())),
        ("--quality", text(state.quality.name().into())),
        ("--technique", state.technique.map(|technique| technique.name().into())),
        ("--microbuffer", state.microbuffer.map(|size| size.to_string().into())),
        ("--material", text(state.material.to_string())),
        ("--exposure", text(state.exposure.to_string())),
        ("--tone", text(state.tone.name().into())),
        ("--backdrop", backdrop.map(Into::into)),
        ("--points", state.points.map(|display| display.name().into())),
    ];
    list.into_iter().filter_map(|(flag, value)| value.map(|value| (flag, value))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_of_the_command_line_win() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("s.toml");
        std::fs::write(&path, "cloud = \"c.ply\"\n[placement]\nscale = 2.5\nturn = 10\n").expect("a file");
        let scene = format!("--scene={}", path.display());
        let given = ["relume", "render", &scene, "--object-turn=5", "--out", "x.png"].map(OsString::from).to_vec();
        let all = expanded(given.clone()).expect("arguments");
        let text: Vec<String> = all.iter().map(|a| a.to_string_lossy().into_owned()).collect();
        assert_eq!(all[..6], given[..]);
        let after = |flag: &str| text.iter().position(|a| a == flag).map(|at| text[at + 1].clone());
        assert_eq!(after("--object-scale").as_deref(), Some("2.5"));
        assert_eq!(after("--object-turn"), None);
        assert!(after("--cloud").is_some_and(|cloud| cloud.ends_with("c.ply") && cloud.len() > 5));
        std::fs::write(&path, "[probes]\npath = \"p.exr\"\nturn = 90.5\n").expect("a file");
        for (extra, turn, backdrop) in
            [("--stats=s.json", Some("90.5"), Some("environment")), ("--environment=e.exr", None, Some("environment"))]
        {
            let given = ["relume", "render", &scene, extra].map(OsString::from).to_vec();
            let all = expanded(given).expect("arguments");
            let after = |flag: &str| {
                let at = all.iter().position(|a| a == flag)?;
                Some(all[at + 1].to_string_lossy().into_owned())
            };
            assert_eq!((after("--turn").as_deref(), after("--backdrop").as_deref()), (turn, backdrop), "{extra}");
            assert_eq!(after("--probes").is_some(), turn.is_some(), "{extra}");
        }
        let lamps = "[lamps]\nlist = [\"point at=1,2,0.1 power=3\", \"sun direction=0,-1,0 power=2\"]\nvpls = 32\n";
        std::fs::write(&path, format!("cloud = \"c.ply\"\nobject = \"o.obj\"\n{lamps}")).expect("a file");
        let lamp = ["point at=1,2,0.1 power=3 color=1,1,1", "sun direction=0,-1,0 power=2 color=1,1,1"];
        for (extra, lamps, vpls) in [
            ("--out=x.png", &lamp[..], Some("32")),
            ("--vpls=64", &lamp[..], None),
            ("--lamp=point at=0,0,0 power=9", &[][..], Some("32")),
            ("--technique=probes", &[][..], None),
            ("--technique=lamps", &lamp[..], Some("32")),
        ] {
            let all = expanded(["relume", "render", &scene, extra].map(OsString::from).to_vec()).expect("arguments");
            let text: Vec<String> = all.iter().map(|a| a.to_string_lossy().into_owned()).collect();
            let after = |flag| text.windows(2).filter(move |pair| pair[0] == flag).map(|pair| pair[1].as_str());
            assert_eq!(after("--lamp").collect::<Vec<_>>(), lamps, "{extra}");
            assert_eq!(after("--vpls").next(), vpls, "{extra}");
            let alone = extra == "--technique=lamps";
            let (object, backdrop) = (after("--object").next(), after("--backdrop").next());
            assert_eq!((object.is_none(), backdrop.is_none()), (alone, alone), "{extra}");
        }
        let other = ["relume", "build", &scene].map(OsString::from).to_vec();
        assert_eq!(expanded(other.clone()).expect("arguments"), other);
    }
}
