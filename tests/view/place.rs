//! A display, a folder with things to show, and the viewer on them.
#![allow(unreachable_pub, reason = "a module of a test")]

use std::fmt::Write as _;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use glam::{Vec3, vec3};
use relume::formats::bsh::{self, BshInfo};
use relume::formats::image::{ExrLayers, write_exr};
use relume::scene::Cloud;
use tempfile::TempDir;

use crate::common::{ball, box_cloud, build};

/// A display of its own, closed at the end.
pub struct Display {
    server: Child,
    pub name: String,
}

impl Display {
    /// `None`, with a message, where Xvfb is not installed.
    pub fn open() -> Option<Self> {
        let server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1024x768x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let mut server = match server {
            Ok(server) => server,
            Err(error) => {
                eprintln!("skipped: Xvfb does not start ({error}); tools/setup installs it");
                return None;
            }
        };
        let mut number = String::new();
        let output = server.stdout.take().expect("a pipe");
        BufReader::new(output).read_line(&mut number).expect("a display number");
        Some(Self { server, name: format!(":{}", number.trim()) })
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// A folder with a scanned box and a ball.
pub struct Place(TempDir);

impl Place {
    pub fn new() -> Self {
        let place = Self(TempDir::new().expect("a folder"));
        let shade = |p: Vec3, _| vec3(0.3, 0.5, 0.7) * (1.6 + p.x) + if p.y > 0.9 { 2.0 } else { 0.0 };
        let cloud = box_cloud(vec3(1.5, 1.0, 1.5), 3000, shade);
        let info = BshInfo { points: cloud.len() as u64, ..BshInfo::default() };
        bsh::write(&place.path("room.bsh"), &build(&cloud), info).expect("a hierarchy");
        // Without its ceiling.
        let keep: Vec<usize> = (0..cloud.len()).filter(|&i| cloud.positions[i].y < 0.9).collect();
        let open = Cloud {
            positions: keep.iter().map(|&i| cloud.positions[i]).collect(),
            normals: keep.iter().map(|&i| cloud.normals[i]).collect(),
            colors: keep.iter().map(|&i| cloud.colors[i]).collect(),
            spacing: keep.iter().map(|&i| cloud.spacing[i]).collect(),
            ..Cloud::default()
        };
        let info = BshInfo { points: open.len() as u64, ..BshInfo::default() };
        bsh::write(&place.path("open.bsh"), &build(&open), info).expect("a hierarchy");
        let mut ply = format!("ply\nformat ascii 1.0\nelement vertex {}\n", cloud.len());
        for name in ["x", "y", "z", "red", "green", "blue"] {
            writeln!(ply, "property float {name}").expect("text");
        }
        ply += "end_header\n";
        for (p, c) in cloud.positions.iter().zip(&cloud.colors) {
            writeln!(ply, "{} {} {} {} {} {}", p.x, p.y, p.z, c.z, c.y, c.x).expect("text");
        }
        std::fs::write(place.path("other.ply"), ply).expect("a cloud");
        for (name, radius) in [("ball.obj", 0.25), ("small.obj", 0.12)] {
            let object = ball(radius);
            let mut text = String::new();
            for vertex in &object.vertices {
                let Vec3 { x, y, z } = vertex.position;
                writeln!(text, "v {x} {y} {z}").expect("text");
            }
            for t in object.indices.chunks_exact(3) {
                writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).expect("text");
            }
            std::fs::write(place.path(name), text).expect("an object");
        }
        place
    }

    pub fn folder(&self) -> &Path {
        self.0.path()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a panorama of 64x32 texels, whose light is that of a place from 0 to 1 along both sides.
    pub fn probe(&self, name: &str, light: impl Fn(f32, f32) -> Vec3) {
        self.probe_of(64, name, light);
    }

    /// The same with another width.
    pub fn probe_of(&self, width: u32, name: &str, light: impl Fn(f32, f32) -> Vec3) {
        let height = width / 2;
        let texel = |i: u32| light((i % width) as f32 / width as f32, (i / width) as f32 / height as f32);
        let rgb: Vec<Vec3> = (0..width * height).map(texel).collect();
        write_exr(&self.path(name), &ExrLayers { width, height, rgb: &rgb, alpha: None, groups: &[] }).expect("an EXR");
    }

    pub fn command(&self, display: &str, arguments: &[&str], script: &str) -> Command {
        std::fs::write(self.path("script"), script).expect("a script");
        let mut command = Command::new(env!("CARGO_BIN_EXE_relume"));
        command.current_dir(self.0.path()).env("DISPLAY", display).env_remove("WAYLAND_DISPLAY");
        command.arg("view").args(arguments).args(["--script", "script"]);
        command
    }

    /// Plays a script in a window with room and ball; it must end well.
    pub fn plays(&self, display: &Display, arguments: &[&str], script: &str) -> String {
        let scene = ["--cloud", "room.bsh", "--object", "ball.obj", "--size", "160x120"];
        let output = self.command(&display.name, &[&scene, arguments].concat(), script).output().expect("relume runs");
        said(&output)
    }
}

pub fn said(output: &Output) -> String {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{}\n{}", text(&output.stderr), text(&output.stdout));
    text(&output.stdout)
}

/// One line that holds all of `parts`, and exit code 2.
pub fn refused(output: &Output, parts: &[&str]) {
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    for part in parts {
        assert!(message.contains(part), "{part} in {message}");
    }
}
