//! What a verb prints on standard output.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write};

use crate::{Error, Result};

/// Prints one line, as `println!` does, but gives an error where that panics: `say!("{count} points")?`.
macro_rules! say {
    ($($part:tt)*) => {
        $crate::cli::output::line(format_args!($($part)*))
    };
}
pub(super) use say;

/// Writes one line. A reader that went away, such as `head`, wanted no more and is no error.
pub(super) fn line(text: Arguments<'_>) -> Result<()> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Error::file("standard output", format!("cannot be written: {error}")))
        }
        _ => Ok(()),
    }
}
