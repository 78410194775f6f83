//! Captures for RenderDoc, through its in-application API.

use std::path::PathBuf;
use std::ptr::null;

use renderdoc::{RenderDoc, V110};

use crate::{Error, Result};

/// RenderDoc, which this process was started under.
pub struct Capture(RenderDoc<V110>);

impl Capture {
    /// Finds the RenderDoc that the process was started under. It has to be there before a device is opened, which it
    /// watches from then on.
    ///
    /// # Errors
    /// [`Error::Device`] where there is none, with how to start one.
    pub fn attach() -> Result<Self> {
        // It looks for a library that is loaded already, and loads none.
        RenderDoc::new().map(Self).map_err(|_| {
            Error::Device(
                "a capture needs RenderDoc: start relume under it, by its window or by \
                 'renderdoccmd capture -w -d . -c /absolute/path relume ...' (tools/capture does)"
                    .into(),
            )
        })
    }

    /// Captures everything that `frame` submits, and returns the capture's file beside its result.
    ///
    /// # Errors
    /// Those of `frame`, and [`Error::Device`] when RenderDoc writes no file.
    pub fn frame<T>(&mut self, frame: impl FnOnce() -> Result<T>) -> Result<(T, PathBuf)> {
        let before = self.0.get_num_captures();
        // Whatever device and window there are.
        self.0.start_frame_capture(null(), null());
        let result = frame();
        self.0.end_frame_capture(null(), null());
        let result = result?;
        let file = (self.0.get_num_captures() > before).then(|| self.0.get_capture(before)).flatten();
        match file {
            Some((file, _)) => Ok((result, file)),
            None => Err(Error::Device("RenderDoc wrote no capture; its log says why".into())),
        }
    }
}
