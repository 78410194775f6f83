//! Binary files of relume's own, which end with a CRC-32 (IEEE) of all bytes before it.

use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};

use bytemuck::Pod;

use super::{check_regular, whole};
use crate::{Error, Result};

/// Bytes of the checksum.
pub(super) const CHECKSUM_BYTES: u64 = 4;

/// Writes all parts, one after the other, and their checksum. An older file at `path` is replaced only when the new one
/// is complete.
///
/// # Errors
/// [`Error::File`] when it cannot be written.
pub(super) fn write(path: &Path, parts: &[&[u8]]) -> Result<()> {
    whole::write(path, |out| {
        let mut checksum = crc32fast::Hasher::new();
        let mut put = |bytes: &[u8]| {
            checksum.update(bytes);
            out.write_all(bytes)
        };
        parts
            .iter()
            .try_for_each(|part| put(part))
            .and_then(|()| out.write_all(&checksum.finalize().to_le_bytes()))
            .map_err(|e| Error::file(path, format!("cannot be written: {e}")))
    })
}

/// A file that is read from its beginning, and the checksum of what has been.
pub(super) struct Reader {
    path: PathBuf,
    reader: BufReader<File>,
    checksum: crc32fast::Hasher,
    /// Length of the file, bytes.
    pub(super) length: u64,
}

impl Reader {
    /// # Errors
    /// [`Error::File`] where the file cannot be read.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let unreadable = |e: io::Error| Error::file(path, format!("cannot be read: {e}"));
        check_regular(path)?;
        let file = File::open(path).map_err(unreadable)?;
        let length = file.metadata().map_err(unreadable)?.len();
        let (reader, checksum) = (BufReader::new(file), crc32fast::Hasher::new());
        Ok(Self { path: path.to_owned(), reader, checksum, length })
    }

    /// The next value; `None`, and nothing is read, where the whole file is too short for it.
    pub(super) fn header<T: Pod>(&mut self) -> Result<Option<T>> {
        if self.length < size_of::<T>() as u64 {
            return Ok(None);
        }
        let mut header = T::zeroed();
        self.fill(bytemuck::bytes_of_mut(&mut header))?;
        Ok(Some(header))
    }

    /// The next `count` values, of which the caller knows that the file is long enough for them.
    pub(super) fn array<T: Pod>(&mut self, count: usize) -> Result<Vec<T>> {
        let mut values = bytemuck::zeroed_vec(count);
        self.fill(bytemuck::cast_slice_mut(&mut values))?;
        Ok(values)
    }

    /// Reads the checksum and says whether it is that of all before it.
    pub(super) fn ends_intact(mut self) -> Result<bool> {
        let computed = self.checksum.clone().finalize();
        let mut stored = [0; CHECKSUM_BYTES as usize];
        self.fill(&mut stored)?;
        Ok(u32::from_le_bytes(stored) == computed)
    }

    fn fill(&mut self, bytes: &mut [u8]) -> Result<()> {
        self.reader.read_exact(bytes).map_err(|e| Error::file(&self.path, format!("cannot be read: {e}")))?;
        self.checksum.update(bytes);
        Ok(())
    }
}
