//! Shaders that change while the program runs: compiled again when a file does, and put back when they do not work.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::shaders;

/// Compiles an entry point below a folder to the bytes of SPIR-V; `None` for files that are only included.
pub type Compile = fn(&Path, &Path) -> Option<Result<Vec<u8>, String>>;

/// Watches a folder of shaders.
#[derive(Clone, Debug)]
pub struct Reload {
    root: PathBuf,
    compile: Compile,
    stamps: BTreeMap<PathBuf, SystemTime>,
}

impl Reload {
    /// Watches `root`, whose entry points have the names of [`shaders::names`], from how it is now.
    pub fn new(root: PathBuf, compile: Compile) -> Self {
        let stamps = stamps(&root);
        Self { root, compile, stamps }
    }

    /// Whether a file is new, changed or gone since the last call.
    pub fn changed(&mut self) -> bool {
        let now = stamps(&self.root);
        let changed = now != self.stamps;
        self.stamps = now;
        changed
    }

    /// Compiles all entry points and puts them in the place of those that there were, which it returns.
    ///
    /// # Errors
    /// What the compiler says about the first file with an error; nothing is replaced then.
    pub fn compile(&self) -> Result<shaders::Replaced, String> {
        let mut table = BTreeMap::new();
        for file in self.stamps.keys() {
            let name = file.strip_prefix(&self.root).unwrap_or(file).to_string_lossy().replace('\\', "/");
            match (self.compile)(&self.root, file) {
                None => {}
                Some(bytes) => {
                    table.insert(name, shaders::words(&bytes?));
                }
            }
        }
        Ok(shaders::replace(table))
    }
}

/// All files below a folder, and when each was last changed.
fn stamps(root: &Path) -> BTreeMap<PathBuf, SystemTime> {
    let mut found = BTreeMap::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        // What cannot be read now may be in the middle of being written; the next look tells.
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            match entry.metadata() {
                Ok(data) if data.is_dir() => folders.push(path),
                Ok(data) => {
                    found.insert(path, data.modified().unwrap_or(SystemTime::UNIX_EPOCH));
                }
                Err(_) => {}
            }
        }
    }
    found
}
