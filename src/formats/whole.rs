//! Outputs that appear whole or not at all.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::{Error, Result};

/// Writes `path` by way of a file beside it that is renamed into place at the end. When `write` fails, or the disk is
/// full, nothing is left behind and an older file at `path` stays as it was.
pub fn write(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> Result<()>) -> Result<()> {
    let name = path.file_name().ok_or_else(|| Error::file(path, "is not a file name"))?;
    let beside = path.with_file_name(format!(".{}.{}.part", name.to_string_lossy(), std::process::id()));
    let result = (|| {
        let file = File::create(&beside).map_err(|e| Error::file(path, format!("cannot be written: {e}")))?;
        let mut buffer = BufWriter::new(file);
        write(&mut buffer)?;
        buffer.flush().map_err(|e| Error::file(path, format!("cannot be written: {e}")))?;
        fs::rename(&beside, path).map_err(|e| Error::file(path, format!("cannot be written: {e}")))
    })();
    if result.is_err() {
        // The part may not exist; the error that matters is already in `result`.
        let _ = fs::remove_file(&beside);
    }
    result
}
