//! Compiles GLSL with shaderc. The build script has this file too, so it uses nothing of the crate.

use std::fs;
use std::path::{Path, PathBuf};

use shaderc::{
    CompileOptions, Compiler, EnvVersion, IncludeType, OptimizationLevel, ResolvedInclude, ShaderKind, SpirvVersion,
    TargetEnv,
};

/// The stage by the file's ending; include-only files end in `.glsl` and have none.
fn kind_of(file: &Path) -> Option<ShaderKind> {
    match file.extension()?.to_str()? {
        "vert" => Some(ShaderKind::Vertex),
        "geom" => Some(ShaderKind::Geometry),
        "frag" => Some(ShaderKind::Fragment),
        "comp" => Some(ShaderKind::Compute),
        _ => None,
    }
}

/// Compiles an entry point below `root` to the bytes of SPIR-V 1.5; `None` for files that are only included.
///
/// # Errors
/// What the compiler says, with file and line.
pub(crate) fn compile(root: &Path, file: &Path) -> Option<Result<Vec<u8>, String>> {
    kind_of(file).map(|kind| compile_kind(root, file, kind))
}

fn compile_kind(root: &Path, file: &Path, kind: ShaderKind) -> Result<Vec<u8>, String> {
    let compiler = Compiler::new().map_err(|e| e.to_string())?;
    let source = fs::read_to_string(file).map_err(|e| format!("{}: {e}", file.display()))?;
    let mut options = CompileOptions::new().map_err(|e| e.to_string())?;
    options.set_target_env(TargetEnv::Vulkan, EnvVersion::Vulkan1_3 as u32);
    options.set_target_spirv(SpirvVersion::V1_5);
    // Names and lines stay, for captures and for binding buffers by name.
    options.set_generate_debug_info();
    // Also drops what an included file declares and the entry point does not use.
    options.set_optimization_level(OptimizationLevel::Performance);
    options.set_warnings_as_errors();
    options.set_include_callback(|requested, _kind: IncludeType, _from, _depth| {
        let path: PathBuf = root.join(requested);
        let content = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(ResolvedInclude { resolved_name: path.display().to_string(), content })
    });
    compiler
        .compile_into_spirv(&source, kind, &file.display().to_string(), "main", Some(&options))
        .map(|artifact| artifact.as_binary_u8().to_vec())
        .map_err(|e| e.to_string())
}
