//! Which files a sequence is made of.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// The files of a sequence by frame number.
#[derive(Clone, Debug)]
pub(super) enum Files {
    /// One file for every frame.
    One(PathBuf),
    /// The files of a folder from 0, or those that match a pattern; never empty.
    Many {
        /// The folder or the pattern.
        path: PathBuf,
        /// Only these numbers have a file.
        files: BTreeMap<u64, PathBuf>,
    },
}

impl Files {
    /// The file, the folder's files, or the files whose names match the pattern `path`.
    ///
    /// # Errors
    /// [`Error::File`] where there is none, a pattern has two runs of `#`, or two files have one number.
    pub(super) fn find(path: &Path) -> Result<Self> {
        if path.is_dir() {
            return Self::folder(path);
        }
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        // A file may well be called `#1.exr`.
        if path.exists() {
            return Ok(Self::One(path.to_owned()));
        }
        if !name.contains('#') {
            return Err(Error::file(
                path,
                "does not exist: expected a file, a folder or a pattern like probe.####.exr",
            ));
        }
        Self::pattern(path, &name)
    }

    fn folder(path: &Path) -> Result<Self> {
        let mut names = names(path, path)?;
        // Names with a dot in front belong to other programs: half-written files, resource forks.
        names.retain(|name| {
            let kind = Path::new(name).extension().map(|kind| kind.to_string_lossy().to_lowercase());
            !name.starts_with('.') && kind.is_some_and(|kind| kind == "exr" || kind == "hdr")
        });
        names.sort_by(|a, b| natural(a, b));
        if names.is_empty() {
            return Err(Error::file(path, "has no .exr or .hdr files"));
        }
        let files = (0..).zip(names).map(|(number, name)| (number, path.join(name))).collect();
        Ok(Self::Many { path: path.to_owned(), files })
    }

    fn pattern(path: &Path, name: &str) -> Result<Self> {
        let before = name.find('#').unwrap_or_default();
        let digits = name[before..].bytes().take_while(|&byte| byte == b'#').count();
        let (prefix, suffix) = (&name[..before], &name[before + digits..]);
        if suffix.contains('#') {
            return Err(Error::file(path, "has two runs of #: expected one, as in probe.####.exr"));
        }
        let folder = match path.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        };
        let mut files = BTreeMap::new();
        for name in names(folder, path)? {
            let middle = name.strip_prefix(prefix).and_then(|rest| rest.strip_suffix(suffix)).unwrap_or_default();
            if middle.len() < digits || !middle.bytes().all(|byte| byte.is_ascii_digit()) {
                continue;
            }
            let Ok(number) = middle.parse() else {
                return Err(Error::file(folder.join(name), "has too large a number"));
            };
            if let Some(other) = files.insert(number, folder.join(&name)) {
                let other = other.file_name().unwrap_or_default().to_string_lossy().into_owned();
                return Err(Error::file(folder.join(name), format!("has the same frame number as {other}")));
            }
        }
        if files.is_empty() {
            return Err(Error::file(
                path,
                format!("matches no file; # stands for a digit, so {digits} or more of them"),
            ));
        }
        Ok(Self::Many { path: path.to_owned(), files })
    }

    /// First and last frame; none for one file, which is every frame's.
    pub(super) fn range(&self) -> Option<RangeInclusive<u64>> {
        match self {
            Self::One(_) => None,
            Self::Many { files, .. } => Some(*files.first_key_value()?.0..=*files.last_key_value()?.0),
        }
    }

    /// All files, in the order of their numbers.
    pub(super) fn all(&self) -> Vec<&Path> {
        match self {
            Self::One(path) => vec![path],
            Self::Many { files, .. } => files.values().map(PathBuf::as_path).collect(),
        }
    }

    /// The file of a frame.
    ///
    /// # Errors
    /// [`Error::File`] where it is missing.
    pub(super) fn of(&self, number: u64) -> Result<&Path> {
        match self {
            Self::One(path) => Ok(path),
            Self::Many { path, files } => match files.get(&number) {
                Some(file) => Ok(file),
                None => Err(Error::file(path, format!("has no frame {number}"))),
            },
        }
    }
}

/// Names of the files of a folder; errors are about `about`.
fn names(folder: &Path, about: &Path) -> Result<Vec<String>> {
    let unreadable =
        |e: std::io::Error| Error::file(about, format!("cannot be read: folder {}: {e}", folder.display()));
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        // Names that are not Unicode cannot be told from each other in a message: they match nothing.
        if let (true, Ok(name)) = (entry.path().is_file(), entry.file_name().into_string()) {
            names.push(name);
        }
    }
    Ok(names)
}

/// The order in which a person counts: runs of digits by their value, everything else by its characters.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a, b);
    while let (Some(l), Some(r)) = (left.chars().next(), right.chars().next()) {
        let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
        let (l_digits, r_digits) = (digits(left), digits(right));
        let order = if l_digits > 0 && r_digits > 0 {
            let l = left[..l_digits].trim_start_matches('0');
            let r = right[..r_digits].trim_start_matches('0');
            (left, right) = (&left[l_digits..], &right[r_digits..]);
            // Without zeros in front, the longer one is larger.
            l.len().cmp(&r.len()).then(l.cmp(r))
        } else {
            (left, right) = (&left[l.len_utf8()..], &right[r.len_utf8()..]);
            l.cmp(&r)
        };
        if order.is_ne() {
            return order;
        }
    }
    left.len().cmp(&right.len()).then_with(|| a.cmp(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn natural_order_counts() {
        let sorted = ["a", "a01", "a1", "a2b9", "a2b10", "a10", "b", "probe.9.exr", "probe.10.exr", "ä1"];
        for (i, a) in sorted.iter().enumerate() {
            for (j, b) in sorted.iter().enumerate() {
                assert_eq!(natural(a, b), i.cmp(&j), "{a} {b}");
            }
        }
    }
}
