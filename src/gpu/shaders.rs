//! The compiled shaders, by the name of their file below `glsl/`.

use std::collections::BTreeMap;
use std::sync::{PoisonError, RwLock};

use crate::{Error, Result};

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

/// Entry points by name, and their words.
pub type Replaced = BTreeMap<String, Vec<u32>>;

/// What stands in the place of the built-in ones.
static REPLACED: RwLock<Replaced> = RwLock::new(BTreeMap::new());

/// Puts shaders in the place of the built-in ones of their names, for pipelines that are made from now on; returns what
/// stood there. An empty table brings the built-in ones back.
pub fn replace(table: Replaced) -> Replaced {
    std::mem::replace(&mut REPLACED.write().unwrap_or_else(PoisonError::into_inner), table)
}

/// SPIR-V words of an entry point, e.g. `"traverse/traverse.geom"`.
///
/// # Errors
/// When there is no such file below `glsl/`.
pub fn spirv(name: &str) -> Result<Vec<u32>> {
    if let Some(words) = REPLACED.read().unwrap_or_else(PoisonError::into_inner).get(name) {
        return Ok(words.clone());
    }
    let (_, bytes) = TABLE
        .iter()
        .find(|(known, _)| *known == name)
        .ok_or_else(|| Error::Argument(format!("no shader is named {name}")))?;
    Ok(words(bytes))
}

/// Words of little-endian bytes.
pub(super) fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]])).collect()
}

/// Names of all entry points.
pub fn names() -> impl Iterator<Item = &'static str> {
    TABLE.iter().map(|(name, _)| *name)
}
