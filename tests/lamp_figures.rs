//! `relume evaluate lamps` as a person runs it.

use std::process::Output;

use assert_cmd::Command;
use tempfile::TempDir;

fn relume(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_relume")).args(arguments).output().expect("relume runs")
}

#[test]
fn all_figures_are_written_and_show_something() {
    let folder = TempDir::new().expect("a folder");
    let out = folder.path().join("new/figures");
    let text = out.display().to_string();
    let output = relume(&["evaluate", "lamps", "--out", &text, "--size", "48x32", "--points", "20000"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    for name in ["bounces.png", "interleaving.png", "indirect-shadow.png", "caustics.png"] {
        assert!(said.contains(name), "{said}");
        let sheet = image::open(out.join(name)).expect(name).to_luma8();
        // Pictures are brighter than the ground and not of one colour.
        let mut bright: Vec<u8> = sheet.pixels().map(|pixel| pixel.0[0]).filter(|value| *value > 60).collect();
        bright.sort_unstable();
        bright.dedup();
        assert!(sheet.width() > 256 && bright.len() > 20, "{name}: {} greys", bright.len());
    }
    assert_eq!(std::fs::read_dir(&out).expect("a folder").count(), 4);
}

#[test]
fn what_cannot_be_drawn_is_refused_on_one_line() {
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("taken");
    std::fs::write(&file, "mine").expect("a file");
    let file = file.display().to_string();
    let here = folder.path().display().to_string();
    for (arguments, word) in [
        (&["--out", &file][..], "taken"),
        (&["--out", &here, "--points", "3"], "3"),
        (&["--out", &here, "--size", "0x5"], "0x5"),
    ] {
        let output = relume(&[&["evaluate", "lamps"], arguments].concat());
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(word) && message.trim_end().lines().count() == 1, "{message}");
    }
}
