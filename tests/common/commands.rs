//! relume as a person runs it.

use std::process::Output;

use assert_cmd::Command;

/// What a command line gives.
pub fn relume(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_relume")).args(arguments).output().expect("relume runs")
}

/// What it says, on both streams.
pub fn succeeds(arguments: &[&str]) -> String {
    let output = relume(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// One line that holds `expected`, and exit code 2.
pub fn refused(arguments: &[&str], expected: &str) {
    let output = relume(arguments);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert!(message.contains(expected), "{arguments:?}: {message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{arguments:?}: {message}");
}
