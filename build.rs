//! Compiles every GLSL entry point under `glsl/` to SPIR-V 1.5 and writes a table of them for `gpu::shaders`.
//! An error in a shader fails the build with the file and line that shaderc names.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

use shaderc::{
    CompileOptions, Compiler, EnvVersion, IncludeType, OptimizationLevel, ResolvedInclude, ShaderKind, SpirvVersion,
    TargetEnv,
};

fn main() {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR")).join("glsl");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    // A changed, new or removed file anywhere below glsl/, included files among them, runs this again.
    println!("cargo::rerun-if-changed=glsl");

    let mut files = Vec::new();
    collect(&root, &mut files);
    files.sort();

    let compiler = Compiler::new().expect("shaderc starts");
    let mut failed = false;
    let mut table =
        String::from("/// (name, SPIR-V) of every entry point.\npub(crate) static TABLE: &[(&str, &[u8])] = &[\n");
    for file in &files {
        let Some(kind) = kind_of(file) else { continue };
        let name = file.strip_prefix(&root).expect("collected below the root").to_string_lossy().replace('\\', "/");
        match compile(&compiler, &root, file, kind) {
            Ok(words) => {
                let target = out.join(format!("{}.spv", name.replace('/', ".")));
                fs::write(&target, words).expect("OUT_DIR is writable");
                writeln!(table, "    ({name:?}, include_bytes!({target:?})),").expect("writing to a string");
            }
            Err(message) => {
                failed = true;
                for line in message.lines() {
                    println!("cargo::error={line}");
                }
            }
        }
    }
    table.push_str("];\n");
    fs::write(out.join("shaders.rs"), table).expect("OUT_DIR is writable");
    if failed {
        std::process::exit(1);
    }
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("glsl/ is readable") {
        let path = entry.expect("glsl/ is readable").path();
        if path.is_dir() {
            collect(&path, files);
        } else {
            files.push(path);
        }
    }
}

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

fn compile(compiler: &Compiler, root: &Path, file: &Path, kind: ShaderKind) -> Result<Vec<u8>, String> {
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
        let path = root.join(requested);
        let content = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(ResolvedInclude { resolved_name: path.display().to_string(), content })
    });
    compiler
        .compile_into_spirv(&source, kind, &file.display().to_string(), "main", Some(&options))
        .map(|artifact| artifact.as_binary_u8().to_vec())
        .map_err(|e| e.to_string())
}
