//! Lamps as views: their G-buffers in one atlas, and the importance pyramid over it (Preiner 2010, 4.1 and 4.2).

use std::sync::Arc;

use ash::vk;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::operator::Operator;
use super::surfel_view::SurfelViewPass;
use crate::Result;
use crate::gpu::{Bindings, Buffer, Context, Recorder};
use crate::scene::{AlbedoFrom, Brush, Camera, Lamp, LampKind, Surfaces};

/// Push constants of all lamp passes (`glsl/shared/lamp_pass.glsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LampPass {
    /// Eye, world space.
    pub eye: [f32; 3],
    /// Distance to the image plane, pixels.
    pub focal: f32,
    /// To the right, unit length.
    pub right: [f32; 3],
    /// Width of the camera's image, pixels.
    pub width: u32,
    /// Down in the image, unit length.
    pub down: [f32; 3],
    /// Height of the camera's image, pixels.
    pub height: u32,
    /// Away from the eye, unit length.
    pub forward: [f32; 3],
    /// Virtual point lights.
    pub vpls: u32,
    /// Views of all lamps.
    pub views: u32,
    /// View that a pass writes.
    pub view: u32,
    /// Pixels along a side of a lamp's view, a power of two.
    pub light_size: u32,
    /// Views along a side of their atlas, a power of two.
    pub side: u32,
    /// Texels along a side of a shadow map, a power of two.
    pub ism_size: u32,
    /// Level that a pass writes.
    pub level: u32,
    /// 1, 2 or 4.
    pub interleave: u32,
    /// Bounce, from 0 on.
    pub bounce: u32,
    /// First point of a dispatch in its buffer.
    pub first: u32,
    /// Points of a dispatch.
    pub count: u32,
    /// Number in the cloud of the buffer's first point.
    pub base: u32,
    /// Points of the cloud.
    pub points: u32,
    /// From a point's place along the cloud to the light that it serves.
    pub offset: u32,
    /// From the spacing of a point to that of the points of one map.
    pub spread: f32,
    /// Albedo or GGX alpha of an object ([`super::convolve::MaterialChoice::parameter`]).
    pub material: f32,
}

impl LampPass {
    /// The same for a camera's image.
    pub fn seen_by(self, camera: &Camera, width: u32, height: u32) -> Self {
        let (right, up, forward) = camera.basis();
        Self {
            eye: camera.from.into(),
            focal: focal(camera, height),
            right: right.into(),
            width,
            down: (-up).into(),
            height,
            forward: forward.into(),
            ..self
        }
    }

    /// Round `round` of `rounds` of the points over the lights: each point serves another light.
    pub(super) fn in_round(self, round: u32, rounds: u32) -> Self {
        Self { offset: round * self.vpls / rounds, ..self }
    }

    /// Pixels of the camera's image.
    pub fn pixels(&self) -> u32 {
        self.width * self.height
    }

    /// Texels along a side of the atlas.
    fn atlas(&self) -> u32 {
        self.side * self.light_size
    }
}

/// Pixels.
fn focal(camera: &Camera, height: u32) -> f32 {
    0.5 * height as f32 / (0.5 * camera.fov_y).tan()
}

/// What the surfaces of a cloud are made of.
#[derive(Clone, Copy, Debug)]
pub struct Materials<'a> {
    /// Where no brush fits.
    pub surfaces: Surfaces,
    /// By colour; the first that fits wins.
    pub brushes: &'a [Brush],
    /// Where albedos come from.
    pub albedo: AlbedoFrom,
}

impl Materials<'_> {
    /// Texels of any number of brushes.
    const TEXELS: usize = 2 + 3 * Brush::MOST;

    /// As `glsl/common/lamp_setup.glsl` reads them; `area` is what each virtual point light has of the cloud.
    fn texels(&self, area: f32) -> Vec<[f32; 4]> {
        let Surfaces { diffuse, specular, shininess } = self.surfaces;
        let constant = match self.albedo {
            AlbedoFrom::Colour => 0.0,
            AlbedoFrom::Constant(albedo) => albedo,
        };
        let mut texels = vec![[area, constant, self.brushes.len() as f32, 0.0], [diffuse, specular, shininess, 0.0]];
        for Brush { from, to, surfaces: Surfaces { diffuse, specular, shininess } } in self.brushes {
            let (from, to) = (from.extend(0.0).into(), to.extend(0.0).into());
            texels.extend([from, to, [*diffuse, *specular, *shininess, 0.0]]);
        }
        texels.resize(Self::TEXELS, [0.0; 4]);
        texels
    }
}

/// One perspective view of a lamp: a spot and a sun have one, a point six.
///
/// The paper's section 6 proposes two paraboloids for points; six views need no projection that the point passes do not
/// have, and keep their pixels alike. A sun's view is that of a far eye, which sees it as wide as the real sun is.
#[derive(Clone, Copy, Debug)]
pub struct LampView {
    /// Where it looks from and how wide; the image is a square.
    pub camera: Camera,
    lamp: Lamp,
}

/// Distance of a sun's eye in radii of the cloud: the tangent of the sun's own radius on the sky.
const SUN_DISTANCE: f32 = 212.0;

impl LampView {
    /// All views of a lamp over a cloud with this bounding sphere, in images of `size` pixels a side.
    pub fn of_lamp(lamp: &Lamp, (centre, radius): (Vec3, f32), size: u32) -> Vec<Self> {
        let view = |from: Vec3, direction: Vec3, slope: f32| Self {
            camera: Camera { from, at: from + direction, fov_y: 2.0 * slope.atan() },
            lamp: *lamp,
        };
        // A pixel around the rim, for the shadow map's filter.
        let margin = 1.0 + 4.0 / size as f32;
        match lamp.kind {
            LampKind::Spot { at, .. } => vec![view(at.as_vec3(), lamp.direction(), lamp.half_angle().tan() * margin)],
            LampKind::Point { at } => {
                let axes = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];
                axes.into_iter().map(|direction| view(at.as_vec3(), direction, 1.0)).collect()
            }
            LampKind::Sun { .. } => {
                let (direction, radius) = (lamp.direction(), radius.max(1e-3));
                let from = centre - direction * (SUN_DISTANCE * radius);
                let eye = view(from, direction, margin / (SUN_DISTANCE - 1.0));
                // `at` one metre away would be lost in the coordinates of a far eye.
                vec![Self { camera: Camera { at: centre, ..eye.camera }, ..eye }]
            }
        }
    }

    /// As `load_lamp_view` reads it.
    fn texels(&self, size: u32) -> [[f32; 4]; 5] {
        let (right, up, forward) = self.camera.basis();
        let (kind, cone) = match self.lamp.kind {
            LampKind::Spot { .. } => (0.0, self.lamp.half_angle().cos()),
            LampKind::Point { .. } => (1.0, -1.0),
            LampKind::Sun { .. } => (2.0, -1.0),
        };
        [
            self.camera.from.extend(focal(&self.camera, size)).into(),
            right.extend(cone).into(),
            (-up).extend(kind).into(),
            forward.extend(0.0).into(),
            self.lamp.strength().extend(0.0).into(),
        ]
    }
}

/// The atlas, the pyramid and what fills them.
pub struct LampViewPass {
    setup: Buffer,
    places: Buffer,
    normals: Buffer,
    colors: Buffer,
    importance: Buffer,
    copy: Operator,
    pyramid: Operator,
}

impl LampViewPass {
    /// Room for `side` x `side` views of `size` x `size` pixels, both powers of two, whose G-buffers are in `surface`
    /// one after the other.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, surface: &SurfelViewPass, size: u32, side: u32) -> Result<Self> {
        let texels = u64::from(size * side).pow(2);
        let four = vk::Format::R32G32B32A32_SFLOAT;
        let buffer = |name| Buffer::with_texels(context, name, texels * 16, four);
        let (places, normals, colors) = (buffer("lamp places")?, buffer("lamp normals")?, buffer("lamp colours")?);
        let importance = Buffer::with_texels(context, "importance", texels.div_ceil(3) * 16, vk::Format::R32_SFLOAT)?;
        let setup = Buffer::with_texels(
            context,
            "lamp setup",
            (Materials::TEXELS as u64 + 5 * u64::from(side * side)) * 16,
            four,
        )?;
        let bindings = Bindings::new()
            .buffer("lamp_setup", &setup)
            .and(surface.bindings())
            .buffer("lamp_places_out", &places)
            .buffer("lamp_normals_out", &normals)
            .buffer("lamp_colors_out", &colors)
            .buffer("importance", &importance)
            .buffer("importance_out", &importance);
        let copy = Operator::new(context, "lamp_view/lamp_view.comp", &[], &bindings)?;
        let pyramid = Operator::new(context, "lamp_view/pyramid.comp", &[], &bindings)?;
        Ok(Self { setup, places, normals, colors, importance, copy, pyramid })
    }

    /// The buffers under the names that shaders use.
    pub fn bindings(&self) -> Bindings<'_> {
        Bindings::new()
            .buffer("lamp_setup", &self.setup)
            .buffer("lamp_places", &self.places)
            .buffer("lamp_normals", &self.normals)
            .buffer("lamp_colors", &self.colors)
            .buffer("importance", &self.importance)
    }

    /// What passes change of views that are in the atlas, under the names that shaders use.
    pub(super) fn output_bindings(&self) -> Bindings<'_> {
        Bindings::new().buffer("lamp_places_out", &self.places).buffer("importance_out", &self.importance)
    }

    /// Tells the device about the views and materials; `area` is what each virtual point light has of the cloud, square
    /// metres.
    ///
    /// # Errors
    /// When a Vulkan call fails.
    pub fn set_up(&self, views: &[LampView], materials: Materials<'_>, area: f32, size: u32) -> Result<()> {
        let mut texels = materials.texels(area);
        texels.extend(views.iter().flat_map(|view| view.texels(size)));
        self.setup.upload(bytemuck::cast_slice(&texels))
    }

    /// Empties the atlas: cells without a view have no importance.
    pub fn clear(&self, recorder: &mut Recorder) {
        super::fill(recorder, "clear lamp views", &[(&self.places, 0), (&self.importance, 0)]);
    }

    /// Puts what was drawn into the atlas as view `pass.view`.
    ///
    /// # Errors
    /// When the view is larger than a dispatch.
    pub fn copy(&self, recorder: &mut Recorder, pass: LampPass) -> Result<()> {
        self.copy.record(recorder, "lamp view", &pass, pass.light_size * pass.light_size)
    }

    /// Sums of importance up to the whole atlas.
    ///
    /// # Errors
    /// When the atlas is larger than a dispatch.
    pub fn pyramid(&self, recorder: &mut Recorder, pass: LampPass) -> Result<()> {
        for level in 1..=pass.atlas().trailing_zeros() {
            let size = pass.atlas() >> level;
            self.pyramid.record(recorder, "importance", &LampPass { level, ..pass }, size * size)?;
        }
        Ok(())
    }
}
