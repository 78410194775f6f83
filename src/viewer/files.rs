//! Opens what is dropped on the window, and saves the scene.

use std::path::Path;

use super::controller::Controller;
use super::loader::Part;
use super::state::{ProbeChoice, ViewState};
use crate::{Error, Result};

impl Controller {
    pub(super) fn save(&mut self) -> Result<()> {
        let [_, _, width, height] = self.area.map(|side| side as u32);
        let state = ViewState { size: (width > 0 && height > 0).then_some([width, height]), ..self.state.clone() };
        state.write(&self.scene_path)?;
        self.status = format!("{} is saved", self.scene_path.display());
        Ok(())
    }

    /// Opens a cloud, an object, a far field or a scene, by the file's name, and a folder as light probes.
    ///
    /// # Errors
    /// [`Error::File`] for other files, and for a scene that cannot be read.
    pub fn open(&mut self, path: &Path) -> Result<()> {
        self.failed = None;
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        let kind = match extension.as_str() {
            _ if path.is_dir() => Part::Probes,
            "ply" if has_faces(path) => Part::Object,
            "ply" | "pcd" | "las" | "laz" | "bsh" => Part::Cloud,
            "gltf" | "glb" | "obj" => Part::Object,
            "exr" | "hdr" => Part::Environment,
            "toml" => {
                let state = ViewState::read(path)?;
                self.undo = Some(std::mem::replace(&mut self.state, state));
                (self.scene_path, self.lamp) = (path.to_owned(), 0);
                self.status = format!("{} is open", path.display());
                return Ok(());
            }
            _ => {
                return Err(Error::file(
                    path,
                    "is none of .ply .pcd .las .laz .bsh, .gltf .glb .obj, .exr .hdr and .toml, and no folder of .exr .hdr",
                ));
            }
        };
        self.undo = Some(self.state.clone());
        match kind {
            Part::Cloud => {
                self.state.cloud = Some(path.to_owned());
                // Coordinates of another place.
                (self.state.placement.at, self.state.viewpoint) = (None, None);
            }
            Part::Object => {
                self.state.object = Some(path.to_owned());
                (self.state.placement.scale, self.state.placement.turn) = (1.0, 0.0);
            }
            Part::Environment => (self.state.environment, self.state.probes) = (Some(path.to_owned()), None),
            Part::Probes => {
                (self.state.environment, self.state.probes) = (None, Some(ProbeChoice::new(path)));
                self.state.playing = true;
            }
        }
        Ok(())
    }
}

/// Whether a PLY file holds a mesh, by its header.
fn has_faces(path: &Path) -> bool {
    use std::io::Read;
    let mut header = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(1 << 14).read_to_end(&mut header));
    let text = String::from_utf8_lossy(&header);
    let header = text.split("end_header").next().unwrap_or_default();
    let faces = header.lines().find_map(|line| line.trim().strip_prefix("element face "));
    read.is_ok() && faces.and_then(|count| count.trim().parse::<u64>().ok()).is_some_and(|count| count > 0)
}
