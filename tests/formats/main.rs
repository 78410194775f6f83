//! Readers and writers, on files that the tests make themselves; `real_data` looks at real ones where there are any.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod bad_clouds;
mod bad_others;
mod clouds;
#[path = "../common/mod.rs"]
mod common;
mod expanded;
mod images;
mod neighbours;
mod objects;
mod real_data;

use std::path::{Path, PathBuf};

use relume::Error;
use tempfile::TempDir;

fn temp() -> TempDir {
    TempDir::new().unwrap()
}

/// Puts a file into `dir`.
fn put(dir: &TempDir, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// What is wrong according to an error that must be about `path`, on one line that names it.
#[track_caller]
fn problem<T>(result: relume::Result<T>, path: &Path) -> String {
    let error = result.err().expect("bad input was accepted");
    let message = error.to_string();
    assert!(!message.contains('\n'), "more than one line: {message}");
    assert!(message.starts_with(&*path.to_string_lossy()), "does not name the file: {message}");
    match error {
        Error::File { path: named, problem } => {
            assert_eq!(named, path);
            problem
        }
        other => panic!("expected Error::File, got {other:?}"),
    }
}

/// Fails unless `text` contains all `parts`.
#[track_caller]
fn assert_says(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "'{text}' does not say '{part}'");
    }
}

/// Random numbers in 0..1 (xorshift, fixed seed).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }
}
