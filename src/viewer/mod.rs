//! The desktop viewer. The window (`window`, `presenter`, `swapchain`, `panel`) shows pictures and takes inputs; what
//! they mean is in `controller`; `worker` loads and renders on a thread of its own, and the window never waits for it.

pub mod backdrop;
pub mod camera_control;
pub mod controller;
mod develop;
mod drag;
mod files;
pub mod lamp_control;
mod lamp_panel;
mod lamp_renderers;
mod lamps;
mod loader;
pub mod mailbox;
pub mod messages;
pub mod pace;
mod panel;
pub mod pick;
mod player;
mod presenter;
mod probe_renderers;
mod renderers;
mod script;
pub mod state;
mod swapchain;
mod transfers;
mod window;
pub mod worker;

pub use state::ViewState;
pub use window::{Options, run};
