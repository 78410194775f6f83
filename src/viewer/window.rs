//! The window: winit's events in, egui's shapes and the worker's pictures out.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::{Window, WindowId};

use super::controller::{Button, Controller, Flight, Input};
use super::mailbox::Command;
use super::messages::Stage;
use super::panel;
use super::presenter::{Painting, Presenter, Shown};
use super::script::{Act, Script};
use super::state::ViewState;
use super::worker::{Worker, WriteFrame};
use crate::gpu::ContextOptions;
use crate::gpu::reload::Reload;
use crate::{Error, Result};

/// Windows narrower than this start without the panel, points.
const ROOM_FOR_PANEL: f32 = 900.0;
/// A script takes a step this often.
const SCRIPT_STEP: Duration = Duration::from_millis(8);
/// A presentation device that is lost is opened again so often without a frame in between.
const MOST_LOSSES: u32 = 3;

/// How the viewer starts.
pub struct Options {
    /// What to show first.
    pub state: ViewState,
    /// Where the scene is saved.
    pub scene_path: PathBuf,
    /// Size of the window, pixels.
    pub size: [u32; 2],
    /// Device and validation.
    pub context: ContextOptions,
    /// Close after so many frames.
    pub frames: Option<u64>,
    /// Inputs to be played.
    pub script: Option<PathBuf>,
    /// Writes the EXR of a screenshot.
    pub write_frame: WriteFrame,
    /// Shaders that may change.
    pub reload: Option<Reload>,
}

/// Opens the window and returns when it is closed.
///
/// # Errors
/// [`Error::Device`] without a display or a device, the first validation message if there was one, and what a script
/// expected in vain.
pub fn run(mut options: Options) -> Result<()> {
    let script = options.script.as_deref().map(Script::read).transpose()?;
    let events = EventLoop::<()>::with_user_event().build().map_err(no_display)?;
    let proxy = events.create_proxy();
    let worker = Worker::start(options.context.clone(), options.write_frame, options.reload.take(), move || {
        // A closed window needs no pictures.
        let _ = proxy.send_event(());
    })?;
    let controller = Controller::new(options.state.clone(), worker.mailbox(), options.scene_path.clone());
    let mut app = App {
        options,
        controller,
        worker: Some(worker),
        script,
        next_step: Instant::now(),
        view: None,
        egui: egui::Context::default(),
        redraw_at: None,
        shown: 0,
        losses: 0,
        panel: None,
        result: Ok(()),
    };
    events.run_app(&mut app).map_err(no_display)?;
    // Both devices are closed before their messages are counted.
    app.view = None;
    app.worker = None;
    app.result?;
    let messages = app.controller.validation_messages();
    match messages.first() {
        Some(first) => Err(Error::Device(format!("{} validation messages, the first: {first}", messages.len()))),
        None => Ok(()),
    }
}

fn no_display(error: impl std::fmt::Display) -> Error {
    let why = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    Error::Device(format!("no window could be opened (is there a display?): {why}"))
}

/// A window and what is drawn in it.
struct View {
    presenter: Option<Presenter>,
    egui: egui_winit::State,
    texture: Option<egui::TextureHandle>,
    /// The picture that the texture has.
    textured: Option<Textured>,
    window: Arc<Window>,
}

/// Number, size, stage, frame of the light probes and time of a picture.
type Textured = (u64, [u32; 2], Stage, Option<u64>, f64);

struct App {
    options: Options,
    controller: Controller,
    worker: Option<Worker>,
    script: Option<Script>,
    next_step: Instant,
    view: Option<View>,
    egui: egui::Context,
    /// When the window is to be drawn again.
    redraw_at: Option<Instant>,
    /// Frames that came to the screen.
    shown: u64,
    losses: u32,
    /// Whether the panel is open; by the window's width for `None`.
    panel: Option<bool>,
    result: Result<()>,
}

impl App {
    fn open(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let [width, height] = self.options.size;
        let attributes = Window::default_attributes()
            .with_title("relume")
            .with_inner_size(PhysicalSize::new(width, height))
            .with_min_inner_size(PhysicalSize::new(64, 64));
        let window = Arc::new(events.create_window(attributes).map_err(no_display)?);
        self.view = Some(self.view_of(window)?);
        self.redraw();
        Ok(())
    }

    /// Device and widgets for a window.
    fn view_of(&mut self, window: Arc<Window>) -> Result<View> {
        let ContextOptions { device, validation } = &self.options.context;
        let presenter = Presenter::new(&window, device.as_deref(), *validation)?;
        self.controller.logs.push(presenter.log());
        // Another device has none of the textures that an older context gave out.
        self.egui = egui::Context::default();
        let egui = egui_winit::State::new(
            self.egui.clone(),
            egui::ViewportId::ROOT,
            window.as_ref(),
            Some(window.scale_factor() as f32),
            window.theme(),
            Some(presenter.max_texture_side()),
        );
        Ok(View { presenter: Some(presenter), egui, texture: None, textured: None, window })
    }

    fn redraw(&mut self) {
        self.redraw_at = Some(Instant::now());
    }

    fn fail(&mut self, events: &ActiveEventLoop, error: Error) {
        if self.result.is_ok() {
            self.result = Err(error);
        }
        events.exit();
    }

    /// Runs the widgets and draws them.
    fn draw(&mut self) -> Result<()> {
        let Some(view) = &mut self.view else { return Ok(()) };
        let size = view.window.inner_size();
        if size.width == 0 || size.height == 0 {
            return Ok(());
        }
        let input = view.egui.take_egui_input(&view.window);
        let news = view.update_texture(&self.egui, &self.controller);
        let scale = egui_winit::pixels_per_point(&self.egui, &view.window);
        let open = self.panel.unwrap_or(size.width as f32 / scale >= ROOM_FOR_PANEL);
        let (controller, texture) = (&mut self.controller, view.texture.as_ref());
        let output = self.egui.run_ui(input, |ui| {
            if open {
                panel::show(ui, controller);
            }
            let area = ui.available_rect_before_wrap();
            let pixels = [area.left(), area.top(), area.width(), area.height()].map(|side| (side * scale).round());
            controller.area = pixels.map(|side| side.max(0.0));
            if let Some(texture) = texture {
                let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
                ui.painter().image(texture.id(), area, whole, egui::Color32::WHITE);
            }
            panel::overlay(ui, area, controller);
        });
        view.egui.handle_platform_output(&view.window, output.platform_output);
        let delay = output.viewport_output.get(&egui::ViewportId::ROOT).map(|viewport| viewport.repaint_delay);
        self.redraw_at = delay.and_then(|delay| Instant::now().checked_add(delay));
        let painting = Painting {
            primitives: self.egui.tessellate(output.shapes, output.pixels_per_point),
            textures: output.textures_delta,
            pixels_per_point: output.pixels_per_point,
        };
        let Some(presenter) = &mut view.presenter else { return Ok(()) };
        match presenter.draw([size.width, size.height], painting) {
            Ok(Shown::Yes) => {
                self.shown += 1;
                self.losses = 0;
                if news {
                    self.controller.shown();
                }
                Ok(())
            }
            Ok(Shown::No) => {
                self.redraw_at = Some(Instant::now() + Duration::from_millis(10));
                Ok(())
            }
            Err(Error::Vulkan { result, .. }) if is_loss(result) && self.losses < MOST_LOSSES => self.reopen(),
            Err(error) => Err(error),
        }
    }

    /// Opens the presentation device again.
    fn reopen(&mut self) -> Result<()> {
        self.losses += 1;
        self.controller.status = "the window's device was lost and is opened again".into();
        if let Some(mut view) = self.view.take() {
            // A surface has one device at a time.
            (view.texture, view.presenter) = (None, None);
            self.view = Some(self.view_of(view.window)?);
        }
        self.redraw();
        Ok(())
    }

    /// What the worker says, what the script does, what is to be asked for.
    fn go_on(&mut self, events: &ActiveEventLoop) -> Result<()> {
        while let Some(message) = self.worker.as_ref().and_then(Worker::message) {
            self.controller.message(message);
            self.redraw();
        }
        if let Some(error) = self.controller.fatal.take() {
            return Err(error);
        }
        let now = Instant::now();
        if let Some(script) = &mut self.script
            && now >= self.next_step
        {
            self.next_step = now + SCRIPT_STEP;
            let acts = script.step(&mut self.controller, self.shown)?;
            for act in acts {
                self.act(act, events)?;
            }
        }
        if self.options.frames.is_some() || self.script.as_ref().is_some_and(Script::wants_frames) {
            self.redraw();
        }
        let tick = self.controller.tick(Instant::now()).map(|delay| Instant::now() + delay);
        if self.redraw_at.is_some_and(|time| time <= Instant::now()) {
            self.redraw_at = None;
            self.draw()?;
        }
        if self.options.frames.is_some_and(|frames| self.shown >= frames) {
            events.exit();
        }
        let step = self.script.as_ref().map(|_| self.next_step);
        let next = [tick, step, self.redraw_at].into_iter().flatten().min();
        events.set_control_flow(next.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
        Ok(())
    }

    fn act(&mut self, act: Act, events: &ActiveEventLoop) -> Result<()> {
        let Some(view) = &self.view else { return Ok(()) };
        match act {
            Act::Resize([width, height]) => {
                // The window system answers with an event.
                let _ = view.window.request_inner_size(PhysicalSize::new(width, height));
            }
            Act::Minimise(down) => view.window.set_minimized(down),
            Act::TogglePanel => self.toggle_panel(),
            Act::LoseWindow => self.reopen()?,
            Act::LoseRenderer => self.controller.command(Command::LoseDevice),
            Act::Say(line) => {
                use std::io::Write;
                // Nobody may be listening.
                let _ = writeln!(std::io::stdout(), "{line}");
            }
            Act::Quit => events.exit(),
        }
        Ok(())
    }

    fn toggle_panel(&mut self) {
        let width = self.view.as_ref().map_or(0.0, |view| {
            view.window.inner_size().width as f32 / egui_winit::pixels_per_point(&self.egui, &view.window)
        });
        self.panel = Some(!self.panel.unwrap_or(width >= ROOM_FOR_PANEL));
        self.redraw();
    }

    fn key(&mut self, key: &KeyEvent) {
        let PhysicalKey::Code(code) = key.physical_key else { return };
        let pressed = key.state == ElementState::Pressed;
        let ctrl = self.egui.input(|input| input.modifiers.ctrl);
        let flight = match code {
            KeyCode::KeyW => Some(Flight::Forward),
            KeyCode::KeyS if !ctrl => Some(Flight::Back),
            KeyCode::KeyA => Some(Flight::Left),
            KeyCode::KeyD => Some(Flight::Right),
            KeyCode::KeyE => Some(Flight::Up),
            KeyCode::KeyQ => Some(Flight::Down),
            _ => None,
        };
        match code {
            _ if flight.is_some() => flight.into_iter().for_each(|f| self.controller.input(Input::Fly(f, pressed))),
            _ if !pressed || key.repeat => {}
            KeyCode::Space => self.controller.input(Input::Play(!self.controller.state.playing)),
            KeyCode::F11 => self.controller.input(Input::Capture),
            KeyCode::F12 => self.controller.input(Input::Screenshot),
            KeyCode::KeyS => self.controller.input(Input::Save),
            KeyCode::KeyO if ctrl => self.controller.input(Input::Reopen),
            KeyCode::KeyP | KeyCode::Tab => self.toggle_panel(),
            _ => return,
        }
        self.redraw();
    }
}

impl View {
    /// Gives the newest picture to the texture; false where it has it.
    fn update_texture(&mut self, egui: &egui::Context, controller: &Controller) -> bool {
        let Some(picture) = &controller.picture else { return false };
        let size = [picture.width, picture.height];
        let now = Some((picture.number, size, picture.stage, picture.frame, picture.ms));
        if self.textured == now {
            return false;
        }
        let side = egui.input(|input| input.max_texture_side);
        if size.iter().any(|length| *length as usize > side) {
            return false;
        }
        let known = self.textured.is_some_and(|(_, known, ..)| known == size);
        self.textured = now;
        let pixels = picture.rgba.chunks_exact(4).map(|c| egui::Color32::from_rgb(c[0], c[1], c[2])).collect();
        let image = egui::ColorImage::new(size.map(|length| length as usize), pixels);
        let options = egui::TextureOptions::LINEAR;
        match &mut self.texture {
            Some(texture) if known => texture.set_partial([0, 0], image, options),
            Some(texture) => texture.set(image, options),
            None => self.texture = Some(egui.load_texture("picture", image, options)),
        }
        true
    }
}

fn is_loss(result: ash::vk::Result) -> bool {
    [ash::vk::Result::ERROR_DEVICE_LOST, ash::vk::Result::ERROR_SURFACE_LOST_KHR].contains(&result)
}

impl ApplicationHandler<()> for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.view.is_none()
            && let Err(error) = self.open(events)
        {
            self.fail(events, error);
        }
    }

    fn user_event(&mut self, _events: &ActiveEventLoop, (): ()) {
        // Messages are read before the loop waits again.
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _window: WindowId, event: WindowEvent) {
        let Some(view) = &mut self.view else { return };
        let response = view.egui.on_window_event(&view.window, &event);
        // A drag that began on the picture changes no widget.
        if response.repaint && !self.controller.dragging() && event != WindowEvent::RedrawRequested {
            self.redraw_at = Some(Instant::now());
        }
        let taken = response.consumed;
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => {
                if let Some(presenter) = &mut view.presenter {
                    presenter.outdated();
                }
                self.redraw();
            }
            WindowEvent::RedrawRequested | WindowEvent::Occluded(false) => self.redraw(),
            WindowEvent::DroppedFile(path) => {
                self.controller.input(Input::Drop(path));
                self.redraw();
            }
            WindowEvent::ModifiersChanged(modifiers) => {
                let state = modifiers.state();
                let (shift, ctrl, alt) = (state.shift_key(), state.control_key(), state.alt_key());
                self.controller.input(Input::Modifiers { shift, ctrl, alt });
            }
            WindowEvent::CursorMoved { position, .. } => {
                self.controller.input(Input::Pointer([position.x as f32, position.y as f32]));
            }
            WindowEvent::MouseInput { state, button, .. } => {
                let button = match button {
                    MouseButton::Left => Button::Left,
                    MouseButton::Middle => Button::Middle,
                    MouseButton::Right => Button::Right,
                    _ => return,
                };
                match state {
                    ElementState::Pressed if !taken => self.controller.input(Input::Press(button)),
                    ElementState::Pressed => {}
                    ElementState::Released => self.controller.input(Input::Release(button)),
                }
            }
            WindowEvent::MouseWheel { delta, .. } if !taken => {
                let steps = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => lines,
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y as f32 / 40.0,
                };
                self.controller.input(Input::Wheel(steps));
            }
            WindowEvent::KeyboardInput { event, .. } => {
                let typing = self.egui.egui_wants_keyboard_input();
                if !typing || event.state == ElementState::Released {
                    self.key(&event);
                }
            }
            WindowEvent::Focused(false) => {
                // Releases go to another window now.
                for flight in [Flight::Forward, Flight::Back, Flight::Left, Flight::Right, Flight::Up, Flight::Down] {
                    self.controller.input(Input::Fly(flight, false));
                }
            }
            _ => {}
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        if let Err(error) = self.go_on(events) {
            self.fail(events, error);
        }
    }
}
