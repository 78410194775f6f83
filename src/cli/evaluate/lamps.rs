//! `relume evaluate lamps`: Figures 6, 9, 12 and 13 of Preiner 2010 as contact sheets.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{Vec3, vec3};

use crate::cli::output::say;
use crate::cli::{progress, values};
use crate::compare::{Image, Tile, contact_sheet, to_srgb8};
use crate::formats::image::write_png;
use crate::frames::lamps::{LampRenderer, LampSettings};
use crate::gpu::{Context, ContextOptions};
use crate::preprocess::point_chunks::PointChunks;
use crate::reference::caustics;
use crate::reference::path_tracer::PathTracer;
use crate::reference::rooms::{Room, cornell_box};
use crate::scene::{Camera, Cloud, Lamp};
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Args {
    /// Folder for the sheets, which is made
    #[arg(long, value_name = "FOLDER", default_value = "relume-lamps")]
    out: PathBuf,
    /// Size of a picture
    #[arg(long, value_name = "WxH", value_parser = values::size, allow_hyphen_values = true, default_value = "384x384")]
    size: (u32, u32),
    /// Points of every cloud
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1000..=20_000_000))]
    points: u32,
}

/// Lights of the caustics: lobes of polished metal are narrow.
const CAUSTIC_VPLS: u32 = 8192;
/// Under the ceiling, past the tall block.
const CEILING: &str = "spot at=0,1.9,0.4 to=0.1,0,-0.2 power=40 angle=80";
/// At the right wall, past the cube.
const WALL: &str = "spot at=-0.6,1.2,0.2 to=1,0.7,0.2 power=40 angle=40";
/// From the side over the rim of the ring onto its inside.
const ASIDE: &str = "spot at=-2.4,2,0 to=0.05,0.02,0 power=30 angle=26";
/// Along the floor into the mirror.
const ALONG: &str = "sun direction=-1,-0.04,0 power=2";
const BOX: Camera = Camera { from: Vec3::new(0.0, 1.0, 3.7), at: Vec3::new(0.0, 1.0, 0.0), fov_y: 0.7 };
const ABOVE: Camera = Camera { from: Vec3::new(-0.75, 1.9, 0.9), at: Vec3::new(0.05, 0.05, 0.0), fov_y: 0.7 };
const BESIDE: Camera = Camera { from: Vec3::new(2.0, 1.3, 1.5), at: Vec3::new(0.4, 0.2, 0.0), fov_y: 0.7 };

/// What all pictures have in common.
struct Studio<'a> {
    args: &'a Args,
    context: Arc<Context>,
    settings: LampSettings,
    bar: indicatif::ProgressBar,
}

/// Pictures of one cloud.
struct Shot<'a> {
    chunks: &'a Arc<PointChunks>,
    camera: &'a Camera,
    lamp: &'a str,
    /// Exposure, stops.
    stops: f32,
}

/// Pictures of all sheets.
const PICTURES: u64 = 4 + 9 + 2 + 4;

pub(super) fn run(args: &Args) -> Result<()> {
    let (width, height) = args.size;
    std::fs::create_dir_all(&args.out).map_err(|e| Error::file(&args.out, format!("cannot be made: {e}")))?;
    let context = Context::new(&ContextOptions::default())?;
    let settings = LampSettings { width, height, ..LampSettings::default() };
    let studio = Studio { args, context, settings, bar: progress::bar("pictures", PICTURES) };
    studio.bounces_and_interleaving()?;
    studio.indirect_shadow()?;
    studio.caustics()?;
    studio.bar.finish_and_clear();
    Ok(())
}

impl Studio<'_> {
    /// Figures 9 and 12.
    fn bounces_and_interleaving(&self) -> Result<()> {
        let chunks = self.scan(cornell_box())?;
        // A stop darker, for what the lamp shines at.
        let shot = Shot { chunks: &chunks, camera: &BOX, lamp: CEILING, stops: -1.0 };
        let tile = |interleave: u32, bounces: u32| {
            let settings = LampSettings { interleave, bounces, ..self.settings.clone() };
            let caption = format!("interleaved {interleave}x{interleave}");
            self.tile(&shot, settings, bounces_of(bounces), caption)
        };
        let tiles = (1..=4).map(|bounces| tile(1, bounces)).collect::<Result<Vec<_>>>()?;
        let lights = format!("{} lights", self.settings.vpls);
        self.sheet("bounces.png", &format!("Preiner 2010, Figure 9: {lights}"), 4, &tiles)?;
        let all = [1, 2, 4].into_iter().flat_map(|interleave| (1..=3).map(move |bounces| (interleave, bounces)));
        let tiles = all.map(|(interleave, bounces)| tile(interleave, bounces)).collect::<Result<Vec<_>>>()?;
        self.sheet("interleaving.png", &format!("Preiner 2010, Figure 12: {lights}"), 3, &tiles)
    }

    /// Figure 6: a cube that only a wall lights.
    fn indirect_shadow(&self) -> Result<()> {
        let mut room = cornell_box();
        let tall = 5..10;
        room.surfaces.drain(tall);
        let chunks = self.scan(room)?;
        let shot = Shot { chunks: &chunks, camera: &BOX, lamp: WALL, stops: 0.5 };
        let tiles = [0, 1].map(|bounces| {
            let settings = LampSettings { bounces, vpls: 1024, interleave: 1, ..self.settings.clone() };
            self.tile(&shot, settings, bounces_of(bounces), "a spot on the right wall".into())
        });
        let [direct, bounced] = tiles;
        self.sheet("indirect-shadow.png", "Preiner 2010, Figure 6: 1024 lights", 2, &[direct?, bounced?])
    }

    /// Figure 13: a ring, and a parabolic mirror.
    fn caustics(&self) -> Result<()> {
        let points = self.args.points as usize;
        let [ring, mirror] = [caustics::ring(points), caustics::parabolic_mirror(points)].map(|cloud| sorted(&cloud));
        let (ring, mirror) = (ring?, mirror?);
        let mut tiles = Vec::new();
        for (name, shot) in [
            ("ring", Shot { chunks: &ring, camera: &ABOVE, lamp: ASIDE, stops: -3.5 }),
            ("parabolic mirror", Shot { chunks: &mirror, camera: &BESIDE, lamp: ALONG, stops: 0.0 }),
        ] {
            for bounces in [0, 1] {
                let settings = LampSettings {
                    bounces,
                    vpls: CAUSTIC_VPLS,
                    interleave: 2,
                    brushes: vec![caustics::polished_gold()],
                    ..self.settings.clone()
                };
                tiles.push(self.tile(&shot, settings, format!("{name}, {}", bounces_of(bounces)), String::new())?);
            }
        }
        let title = format!("Preiner 2010, Figure 13: {CAUSTIC_VPLS} lights");
        self.sheet("caustics.png", &title, 2, &tiles)
    }

    fn scan(&self, room: Room) -> Result<Arc<PointChunks>> {
        sorted(&PathTracer::new(room)?.albedo_cloud(self.args.points as usize, 1))
    }

    fn tile(&self, shot: &Shot<'_>, settings: LampSettings, title: String, caption: String) -> Result<Tile> {
        let lamp: Lamp = shot.lamp.parse().map_err(Error::Argument)?;
        let frame = LampRenderer::new(&self.context, shot.chunks, settings)?.render(shot.camera, &[lamp])?;
        let rgb = frame.color_depth.iter().map(|[r, g, b, _]| vec3(*r, *g, *b)).collect();
        let image = to_srgb8(&Image::opaque(frame.width, frame.height, rgb)?, shot.stops)?;
        self.bar.inc(1);
        Ok(Tile { image, title, caption })
    }

    fn sheet(&self, name: &str, title: &str, columns: usize, tiles: &[Tile]) -> Result<()> {
        let sheet = contact_sheet(title, columns, tiles)?;
        let path = self.args.out.join(name);
        write_png(&path, sheet.width(), sheet.height(), &sheet)?;
        say!("{}", path.display())
    }
}

fn sorted(cloud: &Cloud) -> Result<Arc<PointChunks>> {
    PointChunks::new(cloud).map(Arc::new)
}

fn bounces_of(bounces: u32) -> String {
    match bounces {
        0 => "direct light".into(),
        1 => "1 bounce".into(),
        more => format!("{more} bounces"),
    }
}
