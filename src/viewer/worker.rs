//! The thread that loads and renders: it owns relume's device, and the window never waits for it.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ash::vk;

use super::backdrop::{Scan, composed};
use super::develop::develop;
use super::loader::Assets;
use super::mailbox::{Command, Job, Mailbox, Request};
use super::messages::{Loaded, Message, Picture, Stage};
use super::pace::Pace;
use super::player::Player;
use super::renderers::{Renderers, Shot};
use super::state::ViewState;
use super::transfers::News;
use crate::formats::image;
use crate::formats::tone::ToneCurve;
use crate::frames::composite::Composite;
use crate::frames::{Frame, Method};
use crate::gpu::reload::Reload;
use crate::gpu::{Capture, Context, ContextOptions, shaders};
use crate::scene::Camera;
use crate::{Error, Result};

/// Devices may be lost so often, one after the other, before the viewer gives up.
const MOST_LOSSES: u32 = 3;

/// Shader files are looked at this often.
const SHADER_CHECK: Duration = Duration::from_millis(300);

/// Writes a frame with its layers to an EXR file: frame, camera, the frame in its backdrop, stops, tone curve.
pub type WriteFrame = fn(&Path, &Frame, &Camera, &Composite, f32, ToneCurve) -> Result<()>;

/// The window's end of the thread.
pub struct Worker {
    mailbox: Arc<Mailbox>,
    messages: mpsc::Receiver<Message>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts the thread; `wake` is called after each message.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub fn start(
        options: ContextOptions,
        write_frame: WriteFrame,
        reload: Option<Reload>,
        wake: impl Fn() + Send + 'static,
    ) -> Result<Self> {
        let mailbox = Arc::new(Mailbox::default());
        let (sender, messages) = mpsc::channel();
        let theirs = mailbox.clone();
        let send = move |message| {
            // The window may be gone already.
            let _ = sender.send(message);
            wake();
        };
        let thread = std::thread::Builder::new()
            .name("renderer".into())
            .spawn(move || {
                let send = Box::new(send);
                // It watches devices that are opened later.
                let capture = Capture::attach();
                let mut thread = Thread { mailbox: theirs, send, options, write_frame, reload, capture, losses: 0 };
                if let Err(error) = thread.run() {
                    (thread.send)(Message::Fatal(error));
                }
            })
            .map_err(|e| Error::Device(format!("no thread could be started: {e}")))?;
        Ok(Self { mailbox, messages, thread: Some(thread) })
    }

    /// Where requests go.
    pub fn mailbox(&self) -> Arc<Mailbox> {
        self.mailbox.clone()
    }

    /// The next message, if there is one.
    pub fn message(&self) -> Option<Message> {
        self.messages.try_recv().ok()
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // A file that is being read is not waited for for long.
        const PATIENCE: Duration = Duration::from_secs(10);
        self.mailbox.quit();
        let Some(thread) = self.thread.take() else { return };
        let start = Instant::now();
        while !thread.is_finished() && start.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(2));
        }
        if thread.is_finished() {
            // A panic was reported by its own hook.
            let _ = thread.join();
        }
    }
}

/// The thread's own end.
struct Thread {
    mailbox: Arc<Mailbox>,
    send: Box<dyn Fn(Message) + Send>,
    options: ContextOptions,
    write_frame: WriteFrame,
    reload: Option<Reload>,
    /// RenderDoc, if the viewer was started under it.
    capture: Result<Capture>,
    losses: u32,
}

/// What is worked on.
struct Work {
    assets: Assets,
    renderers: Renderers,
    context: Arc<Context>,
    scan: Scan,
    request: Option<Request>,
    /// What the request still lacks.
    next: Option<Stage>,
    /// The last still frame, and the state and size that it shows.
    last: Option<Still>,
    shots: Vec<PathBuf>,
    /// The next frame is captured.
    capture: bool,
    pace: Pace,
}

struct Still {
    state: ViewState,
    size: [u32; 2],
    stage: Stage,
    /// [`Assets::light`] that it shows.
    light: u64,
    frame: Frame,
    camera: Camera,
    /// The frame in its backdrop.
    picture: Composite,
}

impl Thread {
    /// Works until the window is closed, over losses of the device.
    fn run(&mut self) -> Result<()> {
        let mut assets = Assets::default();
        let mut request = None;
        loop {
            let context = Context::new(&self.options)?;
            let log = context.validation.clone();
            (self.send)(Message::Device(context.capabilities.name.clone(), log, context.why_no_feedback()));
            let mut work = Work {
                assets,
                renderers: Renderers::new(context.clone()),
                context,
                scan: Scan::default(),
                next: None,
                request: None,
                last: None,
                shots: Vec::new(),
                capture: false,
                pace: Pace::default(),
            };
            if let Some(request) = request.take() {
                work.begin(request);
            }
            match self.work(&mut work) {
                Ok(()) => return Ok(()),
                Err(error) if is_loss(&error) && self.losses < MOST_LOSSES => {
                    self.losses += 1;
                    (self.send)(Message::Status("the renderer's device was lost and is opened again".into()));
                    (assets, request) = (work.assets, work.request);
                }
                Err(error) => return Err(error),
            }
        }
    }

    fn work(&mut self, work: &mut Work) -> Result<()> {
        loop {
            let idle = if self.reload.is_some() { SHADER_CHECK } else { Duration::from_secs(3600) };
            match self.mailbox.next(work.wait().min(idle)) {
                Job::Quit => return Ok(()),
                Job::View(request) => work.begin(*request),
                Job::Command(Command::Screenshot(path)) => {
                    work.shots.push(path);
                    // A moving picture is no screenshot.
                    if work.next.is_none() && work.last.as_ref().is_none_or(|still| still.stage != Stage::Finished) {
                        work.next = Some(Stage::Draft);
                    }
                    self.write_shots(work);
                }
                Job::Command(Command::Capture) => match &self.capture {
                    Ok(_) => {
                        (work.last, work.capture) = (None, true);
                        work.next = work.request.as_ref().map(|_| Stage::Finished);
                    }
                    Err(error) => (self.send)(Message::Status(error.to_string())),
                },
                Job::Command(Command::LoseDevice) => {
                    return Err(Error::Vulkan { call: "vkQueueSubmit", result: vk::Result::ERROR_DEVICE_LOST });
                }
                Job::Idle => {}
            }
            self.reload(work);
            self.transfer(work);
            if work.assets.advance(Instant::now()) {
                work.next = work.next.or(Some(Stage::Moving));
            }
            let (Some(stage), Some(request)) = (work.next, work.request.clone()) else { continue };
            match self.step(work, &request, stage) {
                Ok(()) => self.losses = 0,
                Err(Error::Stopped) => {}
                Err(error) if is_loss(&error) => return Err(error),
                Err(error) => {
                    work.next = None;
                    (self.send)(Message::RenderFailed(request.number, error.to_string()));
                }
            }
        }
    }

    /// Compiles shaders again where a file has changed; old ones stay where that fails.
    fn reload(&mut self, work: &mut Work) {
        let Some(reload) = &mut self.reload else { return };
        if !reload.changed() {
            return;
        }
        let compiled = reload.compile().and_then(|before| {
            work.renderers.rebuild(&work.assets).map_err(|error| {
                shaders::replace(before);
                error.to_string()
            })
        });
        if compiled.is_ok() {
            work.last = None;
            work.next = work.request.as_ref().map(|_| Stage::Draft);
        }
        (self.send)(Message::Shaders(compiled.err()));
    }

    /// Hears of the object's own transfer, while that is being made.
    fn transfer(&mut self, work: &mut Work) {
        let Some(news) = work.assets.transfers.news() else { return };
        let name = work.request.as_ref().and_then(|request| request.state.object.as_deref()?.file_name());
        let name = name.unwrap_or_default().to_string_lossy();
        let share = if let News::Share(share) = news { Some(share) } else { None };
        (self.send)(Message::Loading(share.map(|share| (format!("the light at each vertex of {name}"), share))));
        let Some(request) = &work.request else { return };
        match news {
            News::Share(_) => {}
            News::Made(unsaved) => {
                if let Some(error) = unsaved {
                    (self.send)(Message::Status(format!("the transfer is not kept: {error}")));
                }
                if !request.moving {
                    work.next = Some(Stage::Finished);
                }
            }
            News::Failed(error) => (self.send)(Message::RenderFailed(request.number, error.to_string())),
        }
    }

    /// One picture of a request.
    fn step(&mut self, work: &mut Work, request: &Request, stage: Stage) -> Result<()> {
        let start = Instant::now();
        if !self.load(work, &request.state)? {
            work.next = None;
            return Ok(());
        }
        let Some(viewpoint) = request.state.viewpoint else {
            // The window knows now what to frame, and asks again.
            work.next = None;
            return Ok(());
        };
        let camera = viewpoint.camera(work.assets.origin);
        let now = Instant::now();
        if let Some(probes) = work.assets.probes_mut() {
            probes.play(request.state.playing, now)?;
        }
        let method = request.state.method(work.assets.cloud.is_some(), work.context.why_no_feedback().is_none());
        let stage = work.stage(method, stage);
        if method == Method::Probes && !work.transfer(stage)? {
            // Once it is there, it is gone on.
            work.next = None;
            return Ok(());
        }
        let size = if stage == Stage::Moving { work.pace.size(request.size) } else { request.size };
        let shown = request.state.without_display();
        let known = work.last.take().filter(|still| still.finished(&shown, size, work.assets.light));
        let still = match known.filter(|_| stage != Stage::Moving) {
            Some(still) => still,
            None => {
                let stop = (stage != Stage::Moving).then(|| self.mailbox.stop());
                let Work { renderers, assets, .. } = work;
                let shot = Shot { method, stage, size, camera: &camera, stop };
                let mut render = || renderers.render(assets, &request.state, &shot);
                let mut frame = match &mut self.capture {
                    Ok(capture) if std::mem::take(&mut work.capture) => {
                        let (frame, file) = capture.frame(render)?;
                        (self.send)(Message::Status(format!("{} is captured", file.display())));
                        frame
                    }
                    _ => render()?,
                };
                let picture = work.composed(&request.state, &shot, &mut frame)?;
                Still { state: shown, size, stage, light: work.assets.light, frame, camera, picture }
            }
        };
        let Still { frame, picture, .. } = &still;
        let rgba = develop(picture, frame.width, request.state.exposure, request.state.tone);
        // Where the scan hides the object, it cannot be picked.
        let seen =
            |(position, object): (&[f32; 4], &f32)| [position[0], position[1], position[2], position[3] * object];
        let position = frame.position.iter().zip(&picture.object).map(seen).collect();
        let ms = start.elapsed().as_secs_f64() * 1e3;
        if stage == Stage::Moving {
            work.pace.observe(ms, work.assets.probes().and_then(Player::playing));
        }
        let stage = still.stage;
        (self.send)(Message::Picture(Box::new(Picture {
            number: request.number,
            stage,
            frame: work.assets.probes().and_then(Player::number),
            width: frame.width,
            height: frame.height,
            rgba,
            position,
            stats: frame.stats.clone(),
            ms,
        })));
        work.last = Some(still);
        self.write_shots(work);
        work.next = match stage {
            Stage::Draft => Some(Stage::Finished),
            // While probes are played, nobody asks for a still picture.
            Stage::Moving if !request.moving && !work.shots.is_empty() => Some(Stage::Draft),
            _ => None,
        };
        Ok(())
    }

    /// Makes sure of all files that a view needs; false where there is nothing to render yet.
    fn load(&mut self, work: &mut Work, state: &ViewState) -> Result<bool> {
        let send = &self.send;
        let mut loading = false;
        let loaded = work.assets.load(state, &mut |what, share| {
            loading = true;
            send(Message::Loading(Some((what.to_owned(), share))));
        });
        for line in work.assets.probes_mut().map(Player::problems).unwrap_or_default() {
            send(Message::Status(line));
        }
        let Assets { object, cloud, .. } = &work.assets;
        let lit = cloud.is_some() || work.assets.far_field().is_some();
        let complete = (object.is_some() && lit) || (cloud.is_some() && state.scan_alone());
        match loaded {
            Ok(new) => {
                if loading {
                    send(Message::Loading(None));
                }
                if !new.is_empty() {
                    send(Message::Loaded(Box::new(Loaded {
                        state: state.clone(),
                        origin: work.assets.origin,
                        hierarchy: cloud.as_ref().map(|(_, _, hierarchy)| hierarchy.clone()),
                        object_bounds: work.assets.object_bounds(),
                    })));
                    work.renderers.changed(&new);
                    work.scan.changed(&new);
                    work.last = None;
                }
                Ok(complete)
            }
            Err((part, error)) => {
                send(Message::Loading(None));
                send(Message::LoadFailed(part, error.to_string()));
                Ok(false)
            }
        }
    }

    /// Writes the screenshots that wait, once there is a picture for them.
    fn write_shots(&mut self, work: &mut Work) {
        let (Some(still), Some(request)) = (&work.last, &work.request) else { return };
        if still.stage != Stage::Finished {
            return;
        }
        for path in work.shots.drain(..) {
            let Still { frame, camera, picture, .. } = still;
            let ViewState { exposure, tone, .. } = request.state;
            let rgba = develop(picture, frame.width, exposure, tone);
            let written = image::write_png(&path.with_extension("png"), frame.width, frame.height, &rgba)
                .and_then(|()| (self.write_frame)(&path.with_extension("exr"), frame, camera, picture, exposure, tone));
            (self.send)(match written {
                Ok(()) => Message::Saved(path),
                Err(error) => Message::Status(error.to_string()),
            });
        }
    }
}

impl Work {
    fn begin(&mut self, request: Request) {
        self.next = Some(match request.moving {
            true => Stage::Moving,
            // What is finished already is only shown anew.
            false => {
                let shown = request.state.without_display();
                let last = self.last.as_ref();
                let finished = last.is_some_and(|still| still.finished(&shown, request.size, self.assets.light));
                if finished { Stage::Finished } else { Stage::Draft }
            }
        });
        self.request = Some(request);
    }

    /// The object in the scan, both in the light of the lamps; `frame` hears what the scan took.
    fn composed(&mut self, state: &ViewState, shot: &Shot<'_>, frame: &mut Frame) -> Result<Composite> {
        let Self { renderers, scan, context, assets, .. } = self;
        let profile = &mut frame.stats.profile;
        let points = match shot.method {
            Method::Lamps => Some(Cow::Owned(renderers.scan_alone(assets, state, shot)?)),
            Method::Cloud(_) | Method::Probes => scan.render(context, assets, state, shot)?.map(Cow::Borrowed),
        };
        if let Some(points) = &points {
            profile.add(&points.profile);
        }
        let points = match (points, renderers.lamp_light(assets, state, shot)?) {
            (Some(points), Some((light, share))) => {
                let mut points = points.into_owned();
                light.add_to(&mut points, share);
                profile.add(&light.profile);
                Some(Cow::Owned(points))
            }
            (points, _) => points,
        };
        Ok(composed(assets, frame, points.as_deref(), shot))
    }

    /// How long there is nothing to do, if nothing comes in.
    fn wait(&self) -> Duration {
        if self.next.is_some() {
            return Duration::ZERO;
        }
        let probes = self.assets.probes().and_then(|probes| probes.wait(Instant::now()));
        [probes, self.assets.transfers.wait()].into_iter().flatten().min().unwrap_or(Duration::MAX)
    }

    /// How good the next picture is to be, instead of `stage`.
    fn stage(&self, method: Method, stage: Stage) -> Stage {
        let playing = self.assets.probes().is_some_and(|probes| probes.playing().is_some());
        // What is to be kept is finished, whether it plays or not.
        let kept = self.capture || !self.shots.is_empty();
        match stage {
            Stage::Moving => Stage::Moving,
            _ if playing && kept => Stage::Finished,
            _ if playing => Stage::Moving,
            // Of technique probes, a draft is what there is before the object's own transfer.
            Stage::Draft if method == Method::Probes && self.assets.transfers.of(true).is_some() => Stage::Finished,
            // Its pictures have one quality.
            Stage::Draft if method == Method::Lamps => Stage::Finished,
            stage => stage,
        }
    }

    /// Makes sure of the transfer that a picture of technique probes needs; false while it is being made.
    fn transfer(&mut self, stage: Stage) -> Result<bool> {
        let Assets { transfers, object, simple_object, .. } = &mut self.assets;
        match (object, simple_object) {
            (Some((path, object)), _) if stage == Stage::Finished => {
                transfers.make(path, object)?;
                Ok(transfers.of(true).is_some())
            }
            (_, Some(simple)) => transfers.quick(simple).map(|_| true),
            (_, None) => Ok(false),
        }
    }
}

impl Still {
    /// Whether it is as good as can be for a state without display, a size and a light.
    fn finished(&self, shown: &ViewState, size: [u32; 2], light: u64) -> bool {
        self.stage == Stage::Finished && self.state == *shown && self.size == size && self.light == light
    }
}

fn is_loss(error: &Error) -> bool {
    matches!(error, Error::Vulkan { result: vk::Result::ERROR_DEVICE_LOST, .. })
}
