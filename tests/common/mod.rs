//! Scenes and helpers that several tests share; all data is generated here.
#![allow(dead_code, unreachable_pub, reason = "every test binary uses a part")]

pub mod commands;

use std::path::PathBuf;
use std::sync::Arc;

use glam::{Vec3, vec3};
use relume::frames::{Settings, Technique};
use relume::gpu::{Context, ContextOptions};
use relume::preprocess::hierarchy::{self, BuildOptions, Hierarchy};
use relume::scene::{Cloud, Material, Object, Primitive, Vertex};

/// A device with the validation layer, which must stay silent.
pub struct Device(pub Arc<Context>);

impl Device {
    pub fn new() -> Self {
        Self(Context::new(&ContextOptions { device: None, validation: true }).expect("a device with validation"))
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        let messages = self.0.validation.messages();
        if !std::thread::panicking() {
            assert!(messages.is_empty(), "validation: {messages:#?}");
        }
    }
}

/// The folder of real data and independent images, which are not part of the project and which RELUME_SHARED names;
/// `None`, with a plain word about it, where there is none.
pub fn shared(test: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("RELUME_SHARED").filter(|name| !name.is_empty()).map(PathBuf::from);
    if folder.is_none() {
        eprintln!("{test}: skipped, because RELUME_SHARED is not set");
    }
    folder
}

/// Numbers from 0 to 1, the same in every run (Steele et al. 2014, SplitMix64).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1_u64 << 24) as f32
    }

    pub fn vector(&mut self) -> Vec3 {
        vec3(self.next(), self.next(), self.next())
    }
}

/// Points spread evenly over the inside of a box of the given half extents around the origin, about `count` of them.
pub fn box_cloud(half: Vec3, count: usize, color: impl Fn(Vec3, Vec3) -> Vec3) -> Cloud {
    let area = 8.0 * (half.x * half.y + half.y * half.z + half.z * half.x);
    let spacing = (area / count as f32).sqrt();
    let mut cloud = Cloud::default();
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let columns = (2.0 * half[u] / spacing).round().max(1.0) as usize;
        let rows = (2.0 * half[v] / spacing).round().max(1.0) as usize;
        let cell = (2.0 * half[u] / columns as f32) * (2.0 * half[v] / rows as f32);
        for side in [-1.0, 1.0] {
            for i in 0..columns * rows {
                let mut p = Vec3::ZERO;
                p[axis] = side * half[axis];
                p[u] = half[u] * (2.0 * ((i % columns) as f32 + 0.5) / columns as f32 - 1.0);
                p[v] = half[v] * (2.0 * ((i / columns) as f32 + 0.5) / rows as f32 - 1.0);
                let mut n = Vec3::ZERO;
                n[axis] = -side;
                cloud.positions.push(p);
                cloud.normals.push(n);
                cloud.colors.push(color(p, n));
                cloud.spacing.push(cell.sqrt());
            }
        }
    }
    cloud
}

/// Points, normals, colours and spacings with no order at all, inside a ball with a hole in the middle.
pub fn random_cloud(count: usize, seed: u64) -> Cloud {
    let mut random = Random(seed);
    let mut cloud = Cloud::default();
    while cloud.len() < count {
        let p = random.vector() * 4.0 - 2.0;
        if !(0.6..2.0).contains(&p.length()) {
            continue;
        }
        cloud.positions.push(p);
        cloud.normals.push((random.vector() * 2.0 - 1.0 - 0.5 * p).normalize_or(Vec3::Y));
        cloud.colors.push(random.vector() * (1.0 + 20.0 * random.next().powi(8)));
        cloud.spacing.push(0.01 + 0.05 * random.next());
    }
    cloud
}

pub fn build(cloud: &Cloud) -> Hierarchy {
    hierarchy::build(cloud, &BuildOptions::default()).expect("a cloud that builds").0
}

/// A sphere around the origin, as a grid of latitudes and longitudes.
pub fn ball(radius: f32) -> Object {
    const ROWS: u32 = 48;
    const COLUMNS: u32 = 96;
    let mut object = Object { materials: vec![Material::default()], ..Object::default() };
    for i in 0..(ROWS + 1) * (COLUMNS + 1) {
        let (row, column) = (i / (COLUMNS + 1), i % (COLUMNS + 1));
        let theta = std::f32::consts::PI * row as f32 / ROWS as f32;
        let phi = std::f32::consts::TAU * column as f32 / COLUMNS as f32;
        let normal = vec3(theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos());
        object.vertices.push(Vertex { position: normal * radius, normal, ..Vertex::default() });
        if row < ROWS && column < COLUMNS {
            let (a, b) = (i, i + COLUMNS + 1);
            object.indices.extend([a, b, a + 1, a + 1, b, b + 1]);
        }
    }
    object.primitives.push(Primitive { indices: 0..object.indices.len() as u32, material: 0 });
    object
}

/// Small and quick.
pub fn settings() -> Settings {
    Settings {
        technique: Technique::Hybrid,
        width: 48,
        height: 40,
        microbuffer: 16,
        memory_budget: 256 << 20,
        ..Settings::default()
    }
}
