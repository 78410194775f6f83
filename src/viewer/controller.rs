//! What mouse, keys, files and panel do to the view, and what the worker is asked for; knows no window.

use std::collections::{HashSet, VecDeque};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::{DVec3, Vec3};

use super::drag::{Drag, Grip};
use super::mailbox::{Command, Mailbox, Request};
use super::messages::{Picture, Stage};
use super::state::ViewState;
use super::{camera_control as control, pick};
use crate::gpu::context::ValidationLog;
use crate::preprocess::hierarchy::Hierarchy;
use crate::scene::{Camera, LampKind, Viewpoint};
use crate::{Error, Result};

/// After so long without a change the view counts as still.
const SETTLED: Duration = Duration::from_millis(150);
/// Two clicks in this time, at about one place, are a double click.
const DOUBLE_CLICK: Duration = Duration::from_millis(400);
/// Flying goes this many times the distance to the view's middle a second.
const FLY_SPEED: f32 = 0.7;
/// The picture rate is counted over this time.
const RATE_WINDOW: Duration = Duration::from_secs(2);

/// A button of the mouse.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Button {
    /// Orbits, or drags the object or a lamp.
    Left,
    /// Pans.
    Middle,
    /// Looks about.
    Right,
}

/// Keys that fly.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Flight {
    /// W
    Forward,
    /// S
    Back,
    /// A
    Left,
    /// D
    Right,
    /// E
    Up,
    /// Q
    Down,
}

/// What comes in from a window, or from a script in its place. Places are pixels of the window.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    /// The mouse is there.
    Pointer([f32; 2]),
    /// A button went down.
    Press(Button),
    /// A button came up.
    Release(Button),
    /// Steps of the wheel, away from the hand positive.
    Wheel(f32),
    /// A flying key went down or came up.
    Fly(Flight, bool),
    /// Shift, Ctrl and Alt are held.
    Modifiers {
        /// Shift.
        shift: bool,
        /// Ctrl.
        ctrl: bool,
        /// Alt.
        alt: bool,
    },
    /// A file was dropped on the window, or opened.
    Drop(PathBuf),
    /// The scene is to be saved where it came from.
    Save,
    /// The scene is to be read again from its file.
    Reopen,
    /// Light probes are to be played, or to stay at the frame that is shown.
    Play(bool),
    /// PNG and EXR of the picture, in the working directory.
    Screenshot,
    /// A capture for RenderDoc, which the viewer must have been started under.
    Capture,
}

/// State of the viewer but for its window.
pub struct Controller {
    /// What is to be seen.
    pub state: ViewState,
    /// The picture that is shown.
    pub picture: Option<Picture>,
    /// One line about what happened last.
    pub status: String,
    /// What is being loaded, and how far that is.
    pub loading: Option<(String, f32)>,
    /// The renderer's device.
    pub device: String,
    /// What went wrong with shaders.
    pub shader_error: Option<String>,
    /// Where the scene is saved.
    pub scene_path: PathBuf,
    /// Why the viewer has to end.
    pub fatal: Option<Error>,
    /// Where the picture is in the window: left, top, width, height; pixels.
    pub area: [f32; 4],
    /// The lamp that the mouse moves, counted from 0.
    pub lamp: usize,
    mailbox: Arc<Mailbox>,
    pub(super) logs: Vec<Arc<ValidationLog>>,
    pub(super) origin: DVec3,
    pub(super) hierarchy: Option<Arc<Hierarchy>>,
    pub(super) object_bounds: Option<(Vec3, Vec3)>,
    /// Paths that are loaded.
    pub(super) loaded: ViewState,
    pointer: [f32; 2],
    shift: bool,
    ctrl: bool,
    alt: bool,
    flying: HashSet<Flight>,
    drag: Option<Drag>,
    last_click: Option<(Instant, [f32; 2])>,
    moved: Option<Instant>,
    pub(super) sent: Option<Request>,
    /// When moving pictures came to the screen.
    rate: VecDeque<Instant>,
    ticked: Instant,
    /// Screenshots that were written.
    pub saved: Vec<PathBuf>,
    pub(super) failed: Option<u64>,
    /// The state before a file was opened that is not loaded yet.
    pub(super) undo: Option<ViewState>,
}

impl Controller {
    /// For a view of the given state.
    pub fn new(state: ViewState, mailbox: Arc<Mailbox>, scene_path: PathBuf) -> Self {
        Self {
            state,
            picture: None,
            status: String::new(),
            loading: None,
            device: String::new(),
            shader_error: None,
            scene_path,
            fatal: None,
            area: [0.0; 4],
            lamp: 0,
            mailbox,
            logs: Vec::new(),
            origin: DVec3::ZERO,
            hierarchy: None,
            object_bounds: None,
            loaded: ViewState::default(),
            pointer: [0.0; 2],
            shift: false,
            ctrl: false,
            alt: false,
            flying: HashSet::new(),
            drag: None,
            last_click: None,
            moved: None,
            sent: None,
            rate: VecDeque::new(),
            ticked: Instant::now(),
            saved: Vec::new(),
            failed: None,
            undo: None,
        }
    }

    /// The picture has come to the screen.
    pub fn shown(&mut self) {
        if self.picture.as_ref().is_some_and(|picture| picture.stage == Stage::Moving) {
            self.rate.push_back(Instant::now());
        }
    }

    /// Whether a drag goes on that began on the picture.
    pub fn dragging(&self) -> bool {
        self.drag.is_some()
    }

    /// Does what an input asks for.
    pub fn input(&mut self, input: Input) {
        match input {
            Input::Pointer(at) => self.pointer_to(at),
            Input::Press(button) => self.press(button),
            Input::Release(button) => {
                if self.drag.as_ref().is_some_and(|drag| drag.button == button) {
                    self.drag = None;
                }
            }
            Input::Wheel(steps) => self.move_camera(|camera, _| control::zoom(camera, steps)),
            Input::Fly(flight, true) => {
                self.flying.insert(flight);
            }
            Input::Fly(flight, false) => {
                self.flying.remove(&flight);
            }
            Input::Modifiers { shift, ctrl, alt } => (self.shift, self.ctrl, self.alt) = (shift, ctrl, alt),
            Input::Drop(path) => self.tell(|own| own.open(&path)),
            Input::Save => self.tell(Self::save),
            Input::Reopen => {
                let path = self.scene_path.clone();
                self.tell(|own| own.open(&path));
            }
            Input::Play(on) => match self.state.probes {
                Some(_) => self.state.playing = on,
                None => self.status = "there are no light probes to play".into(),
            },
            Input::Capture => self.mailbox.command(Command::Capture),
            Input::Screenshot => {
                let free =
                    |stem: &PathBuf| !stem.with_extension("png").exists() && !stem.with_extension("exr").exists();
                let stem = (1..10_000).map(|n| PathBuf::from(format!("relume-{n:04}"))).find(free);
                match stem {
                    Some(stem) => self.screenshot(stem),
                    None => self.status = "there are 9999 screenshots here already".into(),
                }
            }
        }
    }

    /// Asks for a screenshot by that name, without an ending.
    pub fn screenshot(&mut self, stem: PathBuf) {
        self.mailbox.command(Command::Screenshot(stem));
    }

    /// Asks the worker for something else.
    pub fn command(&mut self, command: Command) {
        self.mailbox.command(command);
    }

    fn tell(&mut self, work: impl FnOnce(&mut Self) -> Result<()>) {
        if let Err(error) = work(self) {
            self.status = error.to_string();
        }
    }

    /// The camera in the space of the hierarchy.
    pub fn camera(&self) -> Option<Camera> {
        self.state.viewpoint.map(|viewpoint| viewpoint.camera(self.origin))
    }

    /// The view is another one, and may go on changing.
    pub fn touch(&mut self) {
        self.moved = Some(Instant::now());
    }

    fn move_camera(&mut self, change: impl FnOnce(&Camera, f32) -> Camera) {
        let Some(viewpoint) = self.state.viewpoint else { return };
        let camera = change(&viewpoint.camera(self.origin), self.area[3].max(1.0));
        if camera.from.is_finite() && camera.at.is_finite() {
            self.state.viewpoint = Some(Viewpoint { fov: viewpoint.fov, ..Viewpoint::of(&camera, self.origin) });
            self.touch();
        }
    }

    fn press(&mut self, button: Button) {
        let now = Instant::now();
        let last = self.last_click.take();
        if button == Button::Left {
            let near = |[x, y]: [f32; 2]| (x - self.pointer[0]).hypot(y - self.pointer[1]) < 6.0;
            if last.is_some_and(|(time, place)| now - time < DOUBLE_CLICK && near(place)) {
                if let Some(point) = self.under_pointer() {
                    self.move_camera(|camera, _| control::focus(camera, point));
                }
                return;
            }
            self.last_click = Some((now, self.pointer));
        }
        let Some(camera) = self.camera() else { return };
        let place = self.in_picture(self.pointer);
        let on_object = button == Button::Left && self.object_at(place).is_some();
        let grip = match button {
            Button::Middle => Grip::Pan,
            Button::Right => Grip::Look,
            Button::Left if self.alt && self.chosen_lamp().is_some() => {
                match self.chosen_lamp().map(|lamp| lamp.kind) {
                    Some(LampKind::Spot { .. }) if !self.shift => Grip::LampTarget,
                    _ => Grip::LampPlace,
                }
            }
            Button::Left if on_object && self.ctrl && self.shift => Grip::Scale,
            Button::Left if on_object && self.ctrl => Grip::Turn,
            Button::Left if on_object && !self.shift => match self.base_in_picture(&camera) {
                Some(base) => Grip::Move { offset: [base[0] - place[0], base[1] - place[1]] },
                None => Grip::Orbit,
            },
            Button::Left if self.shift => Grip::Pan,
            Button::Left => Grip::Orbit,
        };
        self.drag = Some(Drag { button, grip });
    }

    fn pointer_to(&mut self, at: [f32; 2]) {
        let [dx, dy] = [at[0] - self.pointer[0], at[1] - self.pointer[1]];
        self.pointer = at;
        let Some(Drag { grip, .. }) = self.drag else { return };
        if dx == 0.0 && dy == 0.0 {
            return;
        }
        // A drag is no click.
        self.last_click = None;
        let placement = &mut self.state.placement;
        match grip {
            Grip::Orbit => self.move_camera(|camera, height| control::orbit(camera, dx, dy, height)),
            Grip::Pan => self.move_camera(|camera, height| control::pan(camera, dx, dy, height)),
            Grip::Look => self.move_camera(|camera, height| control::look(camera, dx, dy, height)),
            Grip::Turn => {
                placement.turn = (placement.turn + f64::from(dx) * 0.5) % 360.0;
                self.touch();
            }
            Grip::Scale => {
                placement.scale = (placement.scale * (-f64::from(dy) * 0.01).exp()).clamp(1e-6, 1e6);
                self.touch();
            }
            Grip::Move { offset } => self.move_object(offset),
            Grip::LampTarget => self.aim_lamp(self.in_picture(at)),
            Grip::LampPlace => self.shift_lamp([dx, dy]),
        }
    }

    /// Puts the object's base on what lies under the pointer.
    fn move_object(&mut self, offset: [f32; 2]) {
        let (Some(camera), Some(base)) = (self.camera(), self.base()) else { return };
        let place = self.in_picture(self.pointer);
        let place = [place[0] + offset[0], place[1] + offset[1]];
        let direction = control::ray(&camera, place, [self.area[2], self.area[3]]);
        let surface = self.hierarchy.as_ref().and_then(|hierarchy| pick::surface(hierarchy, camera.from, direction));
        let Some(target) = super::drag::target(surface, camera.from, direction, base) else { return };
        let at = self.state.placement.at.unwrap_or(self.origin);
        self.state.placement.at = Some(at + (target - base).as_dvec3());
        self.touch();
    }

    /// Middle of the object's underside, in the space of the hierarchy.
    fn base(&self) -> Option<Vec3> {
        let (low, high) = self.object_bounds?;
        Some(self.state.placement.world_from_object(self.origin).transform_point3(base(low, high)))
    }

    fn base_in_picture(&self, camera: &Camera) -> Option<[f32; 2]> {
        control::project(camera, self.base()?, [self.area[2], self.area[3]])
    }

    /// A place of the window, as pixels from the picture's upper left corner.
    fn in_picture(&self, at: [f32; 2]) -> [f32; 2] {
        [at[0] - self.area[0], at[1] - self.area[1]]
    }

    /// Where the object is seen at a place of the picture.
    fn object_at(&self, [x, y]: [f32; 2]) -> Option<Vec3> {
        let picture = self.picture.as_ref()?;
        let [_, _, width, height] = self.area;
        let column = (x / width.max(1.0) * picture.width as f32) as usize;
        let row = (y / height.max(1.0) * picture.height as f32) as usize;
        if x < 0.0 || y < 0.0 || column >= picture.width as usize || row >= picture.height as usize {
            return None;
        }
        let [x, y, z, seen] = *picture.position.get(row * picture.width as usize + column)?;
        (seen > 0.0).then(|| Vec3::new(x, y, z))
    }

    /// The object or the scan under the pointer, whichever is nearer.
    fn under_pointer(&self) -> Option<Vec3> {
        let camera = self.camera()?;
        let place = self.in_picture(self.pointer);
        let direction = control::ray(&camera, place, [self.area[2], self.area[3]]);
        let scan = self.hierarchy.as_ref().and_then(|hierarchy| pick::surface(hierarchy, camera.from, direction));
        let scan = scan.map(|hit| hit.position);
        let nearer = |a: Vec3, b: Vec3| if a.distance(camera.from) < b.distance(camera.from) { a } else { b };
        match (self.object_at(place), scan) {
            (Some(object), Some(scan)) => Some(nearer(object, scan)),
            (object, scan) => object.or(scan),
        }
    }

    /// Flies on, and asks the worker for what has changed. Returns how long nothing need be done if nothing comes in.
    pub fn tick(&mut self, now: Instant) -> Option<Duration> {
        let seconds = (now - self.ticked).as_secs_f32().min(0.1);
        self.ticked = now;
        if !self.flying.is_empty() {
            let key = |flight| f32::from(u8::from(self.flying.contains(&flight)));
            let motion = Vec3::new(
                key(Flight::Right) - key(Flight::Left),
                key(Flight::Up) - key(Flight::Down),
                key(Flight::Forward) - key(Flight::Back),
            );
            self.move_camera(|camera, _| {
                control::fly(camera, motion * camera.from.distance(camera.at) * FLY_SPEED * seconds)
            });
        }
        while self.rate.front().is_some_and(|time| now - *time > RATE_WINDOW) {
            self.rate.pop_front();
        }
        let size = [self.area[2], self.area[3]].map(|side| side.round() as u32);
        let moving = self.moved.is_some_and(|time| now - time < SETTLED);
        if size.contains(&0) {
            return None;
        }
        let news = self
            .sent
            .as_ref()
            .is_none_or(|sent| sent.state != self.state || sent.size != size || (sent.moving && !moving));
        // What only changes the size or the display is no motion.
        if news {
            let number = self.sent.as_ref().map_or(1, |sent| sent.number + 1);
            let request = Request { number, state: self.state.clone(), size, moving };
            self.mailbox.show(request.clone());
            self.sent = Some(request);
        }
        if !self.flying.is_empty() {
            Some(Duration::from_millis(15))
        } else if moving {
            Some(SETTLED)
        } else {
            None
        }
    }

    /// Whether the newest view is shown as well as was asked for, or could not be.
    pub fn settled(&self) -> bool {
        let Some(sent) = &self.sent else { return false };
        let up_to_date = sent.state == self.state && !sent.moving && self.loading.is_none();
        let shown = self.picture.as_ref().is_some_and(|p| p.number == sent.number && p.stage == Stage::Finished);
        up_to_date && (shown || !self.state.complete() || self.failed.is_some_and(|number| number + 1 >= sent.number))
    }

    /// Moving pictures a second, lately; 0 when nothing moves.
    pub fn rate(&self) -> f64 {
        match (self.rate.front(), self.rate.back()) {
            (Some(first), Some(last)) if last > first => (self.rate.len() - 1) as f64 / (*last - *first).as_secs_f64(),
            _ => 0.0,
        }
    }

    /// Everything that validation layers have said.
    pub fn validation_messages(&self) -> Vec<String> {
        self.logs.iter().flat_map(|log| log.messages()).collect()
    }
}

/// Middle of the underside of bounds.
pub(super) fn base(low: Vec3, high: Vec3) -> Vec3 {
    Vec3::new(0.5 * (low.x + high.x), low.y, 0.5 * (low.z + high.z))
}
