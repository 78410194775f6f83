//! Files: one module a format, readers and writers. Readers allocate no more than the file can back; writers make
//! files that appear whole or not at all.

pub mod bsh;
mod checked;
pub mod cloud;
pub mod color;
pub mod expanded;
pub mod image;
pub mod las;
pub mod object;
pub mod pcd;
pub mod ply;
mod points;
pub mod prt;
pub mod scene_file;
pub mod source;
mod table;
pub mod tone;
pub mod whole;

use std::path::Path;

use crate::{Error, Result};

/// An error where `path` cannot be opened, or is a folder or a device, which may never end.
fn check_regular(path: &Path) -> Result<()> {
    let unreadable = |e: &dyn std::fmt::Display| Error::file(path, format!("cannot be read: {e}"));
    match std::fs::metadata(path).map_err(|e| unreadable(&e))? {
        data if data.is_file() => Ok(()),
        data if data.is_dir() => Err(unreadable(&"it is a folder")),
        _ => Err(unreadable(&"it is no regular file")),
    }
}

/// The whole file in memory.
fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    check_regular(path)?;
    std::fs::read(path).map_err(|e| Error::file(path, format!("cannot be read: {e}")))
}

/// The file name's extension in lower case; empty where there is none.
fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// The beginning of a line of the file, fit for a message: whatever is not printable is a question mark.
fn excerpt(line: &str) -> String {
    line.trim().chars().take(60).map(|c| if c.is_control() { '?' } else { c }).collect()
}
