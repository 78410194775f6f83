//! A list of inputs in a text file, played through the same handlers as those of a window: for tests and for pictures.
//!
//! One command a line; `#` starts a comment. Places are pixels of the window.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use glam::DVec3;

use super::controller::{Button, Controller, Flight, Input};
use super::lamp_control::NewLamp;
use crate::scene::{Lamp, LampKind};
use crate::{Error, Result};

/// Longest that a script waits for a picture.
const PATIENCE: Duration = Duration::from_secs(240);

/// A command of a script.
#[derive(Clone, Debug, PartialEq)]
enum Command {
    /// `wait-still`: until the newest view is shown as well as was asked for.
    WaitStill,
    /// `wait-status TEXT`: until the status line holds the text.
    WaitStatus(String),
    /// `wait SECONDS`
    Wait(Duration),
    /// `frames N`: until the window has shown so many more frames.
    Frames(u64),
    /// `drag X,Y X,Y STEPS [left|middle|right] [ctrl] [shift] [alt]`
    Drag { from: [f32; 2], to: [f32; 2], steps: u32, button: Button, held: Held },
    /// `lamp add LAMP`, as `--lamp` has it.
    AddLamp(Lamp),
    /// `lamp new spot|point|sun`, as the panel's buttons do.
    NewLamp(NewLamp),
    /// `lamp move N at X,Y,Z` and `lamp move N to X,Y,Z`, the first lamp being 1.
    MoveLamp { number: usize, target: bool, place: DVec3 },
    /// `lamp remove N`
    RemoveLamp(usize),
    /// `wheel STEPS`
    Wheel(f32),
    /// `double-click X,Y`
    DoubleClick([f32; 2]),
    /// `fly w|a|s|d|q|e SECONDS`
    Fly(Flight, Duration),
    /// `play` and `pause`: light probes.
    Play(bool),
    /// `wait-frame N`: until the frame of the light probes that is shown has at least that number.
    WaitFrame(u64),
    /// `drop FILE`
    Drop(PathBuf),
    /// `resize WxH`
    Resize([u32; 2]),
    /// `minimise` and `restore`
    Minimise(bool),
    /// `panel`: shows or hides it.
    Panel,
    /// `screenshot STEM`: STEM.png and STEM.exr, of the finished picture.
    Screenshot(PathBuf),
    /// `capture`: for RenderDoc.
    Capture,
    /// `save FILE.toml`
    Save(PathBuf),
    /// `remember`: keeps the picture that is shown, for `expect-changed` and `expect-same`.
    Remember,
    /// `wait-change`: until another picture than the remembered one is shown.
    WaitChange,
    /// `expect-changed` (true) and `expect-same` (false)
    Expect { changed: bool },
    /// `expect-status TEXT`
    ExpectStatus(String),
    /// `rate`: prints how many moving pictures a second there were lately, and the frame of the light probes.
    Rate,
    /// `passes`: prints the milliseconds of the picture's passes.
    Passes,
    /// `lose window` and `lose renderer`: as if that device had been lost.
    Lose { window: bool },
    /// `quit`
    Quit,
}

/// Keys that are held during a drag.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Held {
    ctrl: bool,
    shift: bool,
    alt: bool,
}

/// What a script asks of the window beyond inputs.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Act {
    Resize([u32; 2]),
    Minimise(bool),
    TogglePanel,
    LoseWindow,
    LoseRenderer,
    /// A line for standard output.
    Say(String),
    Quit,
}

/// A script that is played.
pub(super) struct Script {
    path: PathBuf,
    /// Line numbers and commands, the next one first.
    commands: std::vec::IntoIter<(usize, Command)>,
    current: Option<Running>,
    remembered: Option<u64>,
}

struct Running {
    line: usize,
    command: Command,
    since: Instant,
    /// Steps that are done.
    done: u32,
    /// Frames that the window had shown at its start.
    frames: u64,
    /// Screenshots that there were.
    saved: usize,
}

impl Script {
    /// Reads a script.
    ///
    /// # Errors
    /// [`Error::File`] with the number of a line that is no command.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::file(path, format!("cannot be read: {e}")))?;
        let mut commands = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if !line.is_empty() {
                let command = parse(line)
                    .ok_or_else(|| Error::file(path, format!("line {}: {line:?} is no command", number + 1)))?;
                commands.push((number + 1, command));
            }
        }
        Ok(Self { path: path.to_owned(), commands: commands.into_iter(), current: None, remembered: None })
    }

    /// Whether frames are wanted although nothing changes.
    pub(super) fn wants_frames(&self) -> bool {
        matches!(self.current, Some(Running { command: Command::Frames(_), .. }))
    }

    /// Goes a step further; `frames` is how many the window has shown.
    ///
    /// # Errors
    /// An expectation that is not met, or a wait that takes too long.
    pub(super) fn step(&mut self, controller: &mut Controller, frames: u64) -> Result<Vec<Act>> {
        let mut acts = Vec::new();
        if self.current.is_none() {
            let Some((line, command)) = self.commands.next() else { return Ok(acts) };
            let saved = controller.saved.len();
            self.current = Some(Running { line, command, since: Instant::now(), done: 0, frames, saved });
        }
        let Some(mut running) = self.current.take() else { return Ok(acts) };
        let finished = self
            .go_on(&mut running, controller, frames, &mut acts)
            .map_err(|problem| Error::file(&self.path, format!("line {}: {problem}", running.line)))?;
        running.done += 1;
        if !finished {
            if running.since.elapsed() > PATIENCE {
                let status = &controller.status;
                return Err(Error::file(&self.path, format!("line {}: takes too long; {status}", running.line)));
            }
            self.current = Some(running);
        }
        Ok(acts)
    }

    /// Whether the command is done.
    fn go_on(
        &mut self,
        running: &mut Running,
        controller: &mut Controller,
        frames: u64,
        acts: &mut Vec<Act>,
    ) -> Result<bool, String> {
        let done = running.done;
        match &running.command {
            // Once more after the first look: a change that came in only now has been asked for then.
            Command::WaitStill => return Ok(done > 0 && controller.settled()),
            Command::WaitStatus(text) => return Ok(controller.status.contains(text)),
            Command::Wait(time) => return Ok(running.since.elapsed() >= *time),
            Command::Frames(count) => return Ok(frames >= running.frames + count),
            Command::Drag { from, to, steps, button, held: Held { ctrl, shift, alt } } => {
                if done == 0 {
                    controller.input(Input::Modifiers { shift: *shift, ctrl: *ctrl, alt: *alt });
                    controller.input(Input::Pointer(*from));
                    controller.input(Input::Press(*button));
                }
                let share = ((done + 1) as f32 / *steps as f32).min(1.0);
                controller.input(Input::Pointer([0, 1].map(|i| from[i] + (to[i] - from[i]) * share)));
                if done + 1 < *steps {
                    return Ok(false);
                }
                controller.input(Input::Release(*button));
                controller.input(Input::Modifiers { shift: false, ctrl: false, alt: false });
            }
            Command::AddLamp(lamp) => controller.add_lamp(*lamp),
            Command::NewLamp(kind) => controller.add_new_lamp(*kind),
            Command::MoveLamp { number, target, place } => {
                let lamp = known_lamp(controller, *number)?;
                let kind = match (lamp.kind, target) {
                    (LampKind::Spot { at, degrees, .. }, true) => LampKind::Spot { at, to: *place, degrees },
                    (LampKind::Spot { to, degrees, .. }, false) => LampKind::Spot { at: *place, to, degrees },
                    (LampKind::Point { .. }, false) => LampKind::Point { at: *place },
                    _ => return Err(format!("lamp {number} has no such place: {lamp}")),
                };
                controller.change_lamp(number - 1, Lamp { kind, ..lamp });
            }
            Command::RemoveLamp(number) => {
                known_lamp(controller, *number)?;
                controller.remove_lamp(number - 1);
            }
            Command::Wheel(steps) => controller.input(Input::Wheel(*steps)),
            Command::DoubleClick(at) => {
                controller.input(Input::Pointer(*at));
                for _ in 0..2 {
                    controller.input(Input::Press(Button::Left));
                    controller.input(Input::Release(Button::Left));
                }
            }
            Command::Fly(flight, time) => {
                let over = running.since.elapsed() >= *time;
                controller.input(Input::Fly(*flight, !over));
                return Ok(over);
            }
            Command::Play(on) => controller.input(Input::Play(*on)),
            Command::WaitFrame(number) => {
                return Ok(controller.picture.as_ref().is_some_and(|picture| picture.frame >= Some(*number)));
            }
            Command::Drop(path) => controller.input(Input::Drop(path.clone())),
            Command::Resize(size) => acts.push(Act::Resize(*size)),
            Command::Minimise(down) => acts.push(Act::Minimise(*down)),
            Command::Panel => acts.push(Act::TogglePanel),
            Command::Screenshot(stem) => {
                if done == 0 {
                    controller.screenshot(stem.clone());
                }
                return Ok(controller.saved.len() > running.saved);
            }
            Command::Capture => controller.input(Input::Capture),
            Command::Save(path) => {
                controller.scene_path.clone_from(path);
                controller.input(Input::Save);
            }
            Command::Remember => self.remembered = shown(controller),
            Command::WaitChange => return Ok(shown(controller) != self.remembered),
            Command::Expect { changed } => match shown(controller) {
                None => return Err("there is no picture".into()),
                now if (now != self.remembered) == *changed => {}
                _ if *changed => return Err("the picture has not changed".into()),
                _ => return Err("the picture has changed".into()),
            },
            Command::ExpectStatus(text) if controller.status.contains(text) => {}
            Command::ExpectStatus(text) => {
                return Err(format!("the status is {:?}, without {text:?}", controller.status));
            }
            Command::Passes => acts.push(Act::Say(passes(controller))),
            Command::Rate => acts.push(Act::Say(rate(controller))),
            Command::Lose { window: true } => acts.push(Act::LoseWindow),
            Command::Lose { window: false } => acts.push(Act::LoseRenderer),
            Command::Quit => acts.push(Act::Quit),
        }
        Ok(true)
    }
}

/// The lamp of a number from 1.
fn known_lamp(controller: &Controller, number: usize) -> Result<Lamp, String> {
    let lamp = number.checked_sub(1).and_then(|index| controller.state.lamps.lamps.get(index));
    lamp.copied().ok_or_else(|| format!("there is no lamp {number}"))
}

fn rate(controller: &Controller) -> String {
    let picture = controller.picture.as_ref();
    let (width, height, ms) = picture.map_or((0, 0, 0.0), |p| (p.width, p.height, p.ms));
    let frame = picture.and_then(|p| p.frame).map_or(String::new(), |frame| format!(", frame {frame}"));
    format!("{:.1} pictures a second, the last of {width}x{height} in {ms:.1} ms{frame}", controller.rate())
}

fn passes(controller: &Controller) -> String {
    let Some(picture) = &controller.picture else { return "no picture".into() };
    let profile = &picture.stats.profile;
    let parts = profile.passes.iter().map(|(name, pass)| format!("{name} {:.2} ({})", pass.gpu_ms, pass.runs));
    format!("passes: {:.2} ms in all; {}", profile.total_ms(), parts.collect::<Vec<_>>().join(", "))
}

/// A fingerprint of the picture.
fn shown(controller: &Controller) -> Option<u64> {
    controller.picture.as_ref().map(|picture| {
        let mut hasher = DefaultHasher::new();
        (picture.width, picture.height, &picture.rgba).hash(&mut hasher);
        hasher.finish()
    })
}

fn parse(line: &str) -> Option<Command> {
    let (verb, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    let rest = rest.trim();
    let words: Vec<&str> = rest.split_whitespace().collect();
    let file = || (!rest.is_empty()).then(|| PathBuf::from(rest));
    let text = || (!rest.is_empty()).then(|| rest.to_owned());
    Some(match (verb, words.as_slice()) {
        ("wait-still", []) => Command::WaitStill,
        ("wait-status", _) => Command::WaitStatus(text()?),
        ("wait", [time]) => Command::Wait(seconds(time)?),
        ("frames", [count]) => Command::Frames(count.parse().ok()?),
        ("drag", [from, to, steps, how @ ..]) => Command::Drag {
            from: place(from)?,
            to: place(to)?,
            steps: steps.parse().ok().filter(|steps| *steps > 0)?,
            button: match how.iter().find(|word| !["ctrl", "shift", "alt"].contains(*word)) {
                None | Some(&"left") => Button::Left,
                Some(&"middle") => Button::Middle,
                Some(&"right") => Button::Right,
                Some(_) => return None,
            },
            held: Held { ctrl: how.contains(&"ctrl"), shift: how.contains(&"shift"), alt: how.contains(&"alt") },
        },
        ("lamp", ["add", ..]) => Command::AddLamp(rest.strip_prefix("add")?.parse().ok()?),
        ("lamp", ["new", kind]) => Command::NewLamp(match *kind {
            "spot" => NewLamp::Spot,
            "point" => NewLamp::Point,
            "sun" => NewLamp::Sun,
            _ => return None,
        }),
        ("lamp", ["move", number, end @ ("at" | "to"), place]) => {
            let place: Vec<f64> = place.split(',').map(|part| part.parse().ok()).collect::<Option<_>>()?;
            let place = DVec3::from(<[f64; 3]>::try_from(place).ok()?);
            Command::MoveLamp { number: number.parse().ok()?, target: *end == "to", place }
        }
        ("lamp", ["remove", number]) => Command::RemoveLamp(number.parse().ok()?),
        ("wheel", [steps]) => Command::Wheel(steps.parse().ok().filter(|n: &f32| n.is_finite())?),
        ("double-click", [at]) => Command::DoubleClick(place(at)?),
        ("fly", [key, time]) => Command::Fly(
            match *key {
                "w" => Flight::Forward,
                "s" => Flight::Back,
                "a" => Flight::Left,
                "d" => Flight::Right,
                "e" => Flight::Up,
                "q" => Flight::Down,
                _ => return None,
            },
            seconds(time)?,
        ),
        ("play", []) => Command::Play(true),
        ("pause", []) => Command::Play(false),
        ("wait-frame", [number]) => Command::WaitFrame(number.parse().ok()?),
        ("drop", _) => Command::Drop(file()?),
        ("resize", [size]) => {
            let (width, height) = size.split_once('x')?;
            Command::Resize([width.parse().ok()?, height.parse().ok()?])
        }
        ("minimise", []) => Command::Minimise(true),
        ("restore", []) => Command::Minimise(false),
        ("panel", []) => Command::Panel,
        ("screenshot", _) => Command::Screenshot(file()?),
        ("capture", []) => Command::Capture,
        ("save", _) => Command::Save(file()?),
        ("remember", []) => Command::Remember,
        ("wait-change", []) => Command::WaitChange,
        ("expect-changed", []) => Command::Expect { changed: true },
        ("expect-same", []) => Command::Expect { changed: false },
        ("expect-status", _) => Command::ExpectStatus(text()?),
        ("rate", []) => Command::Rate,
        ("passes", []) => Command::Passes,
        ("lose", ["window"]) => Command::Lose { window: true },
        ("lose", ["renderer"]) => Command::Lose { window: false },
        ("quit", []) => Command::Quit,
        _ => return None,
    })
}

fn place(text: &str) -> Option<[f32; 2]> {
    let (x, y) = text.split_once(',')?;
    let number = |text: &str| text.parse().ok().filter(|n: &f32| n.is_finite());
    Some([number(x)?, number(y)?])
}

fn seconds(text: &str) -> Option<Duration> {
    text.parse().ok().and_then(|n| Duration::try_from_secs_f64(n).ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_read_and_others_refused() {
        let drag = parse("drag 1,2 3.5,4 10 middle ctrl").expect("a drag");
        let expected = Command::Drag {
            from: [1.0, 2.0],
            to: [3.5, 4.0],
            steps: 10,
            button: Button::Middle,
            held: Held { ctrl: true, ..Held::default() },
        };
        assert_eq!(drag, expected);
        let aimed = Command::MoveLamp { number: 2, target: true, place: DVec3::new(1.0, -2.0, 0.5) };
        assert_eq!(parse("lamp move 2 to 1,-2,0.5"), Some(aimed));
        let lamp = "point at=1,2,3 power=4";
        assert_eq!(parse(&format!("lamp add {lamp}")), lamp.parse().ok().map(Command::AddLamp));
        assert_eq!(parse("drop a file.ply"), Some(Command::Drop("a file.ply".into())));
        assert_eq!(parse("wait-frame 12"), Some(Command::WaitFrame(12)));
        assert_eq!(parse("fly w 0.5"), Some(Command::Fly(Flight::Forward, Duration::from_millis(500))));
        for wrong in [
            "drag 1,2 3 10",
            "drag 1,2 3,4 0",
            "wheel x",
            "jump",
            "resize 10",
            "wait -1",
            "wait-frame -1",
            "drop",
            "lose all",
            "lamp add point at=1,2,3",
            "lamp move 1 at 1,2",
            "lamp move 1 by 1,2,3",
            "lamp remove all",
        ] {
            assert_eq!(parse(wrong), None, "{wrong}");
        }
    }
}
