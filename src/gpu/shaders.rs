//! The compiled shaders, by the name of their file below `glsl/`.

use crate::{Error, Result};

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

/// SPIR-V words of an entry point, e.g. `"traverse/traverse.geom"`.
///
/// # Errors
/// When there is no such file below `glsl/`.
pub fn spirv(name: &str) -> Result<Vec<u32>> {
    let (_, bytes) = TABLE
        .iter()
        .find(|(known, _)| *known == name)
        .ok_or_else(|| Error::Argument(format!("no shader is named {name}")))?;
    Ok(bytes.chunks_exact(4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]])).collect())
}

/// Names of all entry points.
pub fn names() -> impl Iterator<Item = &'static str> {
    TABLE.iter().map(|(name, _)| *name)
}
