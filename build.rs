//! Compiles every GLSL entry point under `glsl/` to SPIR-V 1.5 and writes a table of them for `gpu::shaders`.
//! An error in a shader fails the build with the file and line that shaderc names.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

#[path = "src/gpu/compile.rs"]
mod compile;

fn main() {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR")).join("glsl");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    // A changed, new or removed file anywhere below glsl/, included files among them, runs this again.
    println!("cargo::rerun-if-changed=glsl");
    println!("cargo::rerun-if-changed=src/gpu/compile.rs");

    let mut files = Vec::new();
    collect(&root, &mut files);
    files.sort();

    let mut failed = false;
    let mut table =
        String::from("/// (name, SPIR-V) of every entry point.\npub(crate) static TABLE: &[(&str, &[u8])] = &[\n");
    for file in &files {
        let Some(compiled) = compile::compile(&root, file) else { continue };
        let name = file.strip_prefix(&root).expect("collected below the root").to_string_lossy().replace('\\', "/");
        match compiled {
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
