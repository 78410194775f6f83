//! One error type for the library. Every message is a single line that says which file or value is wrong,
//! what is wrong with it and, where that is not obvious, what would be right.

use std::path::{Path, PathBuf};

/// Everything that can go wrong in relume. The command line prints it on one line and exits with code 2.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file that cannot be read, understood or written.
    #[error("{}: {problem}", printable(path))]
    File {
        /// The file the problem is about.
        path: PathBuf,
        /// What is wrong, and what would be right.
        problem: String,
    },
    /// A flag or argument with an unusable value.
    #[error("{0}")]
    Argument(String),
    /// A device, a device feature or the Vulkan loader that is missing.
    #[error("{0}")]
    Device(String),
    /// Something does not fit a stated limit; the message names the number.
    #[error("{0}")]
    Limit(String),
    /// Work that [`crate::frames::Renderer::stop_when`] ended early.
    #[error("stopped")]
    Stopped,
    /// A Vulkan call that failed although its preconditions held.
    #[error("Vulkan: {call} failed: {result}")]
    Vulkan {
        /// The call, as the specification names it.
        call: &'static str,
        /// The result code.
        result: ash::vk::Result,
    },
}

/// `std::result::Result` with [`Error`] unless another is named.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A path on one line, whatever its name is made of.
pub(crate) fn printable(path: &Path) -> String {
    path.display().to_string().chars().map(|c| if c.is_control() { '?' } else { c }).collect()
}

impl Error {
    /// An [`Error::File`]; line breaks in `problem` are folded into one line.
    pub fn file(path: impl AsRef<Path>, problem: impl std::fmt::Display) -> Self {
        let problem = problem.to_string();
        Self::File { path: path.as_ref().to_owned(), problem: problem.split_whitespace().collect::<Vec<_>>().join(" ") }
    }
}
