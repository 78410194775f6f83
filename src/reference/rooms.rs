//! Rooms described in code: rectangles that reflect diffusely and may emit.

use glam::{Quat, Vec2, Vec3};

use crate::{Error, Result};

/// A checkered or planked surface: fields of `size` alternate between the rectangle's albedo and this one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Checker {
    /// Reflectance of every other field, 0 to 1.
    pub albedo: Vec3,
    /// Size of a field along `edge_u` and `edge_v`, metres.
    pub size: Vec2,
}

/// A rectangle, seen from the side that `edge_u x edge_v` points to; its back is black.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// One corner, world space, metres.
    pub corner: Vec3,
    /// From that corner to the next, metres.
    pub edge_u: Vec3,
    /// From that corner to the other next, metres; perpendicular to `edge_u`.
    pub edge_v: Vec3,
    /// Diffuse reflectance, 0 to 1.
    pub albedo: Vec3,
    /// A second reflectance in a pattern.
    pub checker: Option<Checker>,
    /// Emitted radiance, the same in all directions.
    pub emission: Vec3,
}

impl Rectangle {
    /// A surface of one colour that does not emit.
    pub fn new(corner: Vec3, edge_u: Vec3, edge_v: Vec3, albedo: Vec3) -> Self {
        Self { corner, edge_u, edge_v, albedo, checker: None, emission: Vec3::ZERO }
    }

    /// Unit normal of the front.
    pub fn normal(&self) -> Vec3 {
        self.edge_u.cross(self.edge_v).normalize_or_zero()
    }

    /// Square metres.
    pub fn area(&self) -> f32 {
        self.edge_u.cross(self.edge_v).length()
    }

    /// The four corners.
    pub fn corners(&self) -> [Vec3; 4] {
        let (c, u, v) = (self.corner, self.edge_u, self.edge_v);
        [c, c + u, c + v, c + u + v]
    }

    /// The middle.
    pub fn centre(&self) -> Vec3 {
        self.at(0.5, 0.5)
    }

    /// The point at (u, v), each 0 to 1.
    pub fn at(&self, u: f32, v: f32) -> Vec3 {
        self.corner + self.edge_u * u + self.edge_v * v
    }

    /// Reflectance at (u, v), each 0 to 1.
    pub fn albedo_at(&self, u: f32, v: f32) -> Vec3 {
        let Some(checker) = self.checker else { return self.albedo };
        let column = (u * self.edge_u.length() / checker.size.x).floor();
        let row = (v * self.edge_v.length() / checker.size.y).floor();
        if (column + row).rem_euclid(2.0) < 0.5 { self.albedo } else { checker.albedo }
    }
}

/// A place made of rectangles, Y up, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Room {
    /// All surfaces. They may pass through each other but must not lie in each other.
    pub surfaces: Vec<Rectangle>,
}

impl Room {
    /// [`Error::Argument`] about the first surface that cannot be rendered.
    pub fn check(&self) -> Result<()> {
        for (index, surface) in self.surfaces.iter().enumerate() {
            let second = surface.checker.map_or(Vec3::ZERO, |checker| checker.albedo);
            let reflects = |albedo: Vec3| albedo.min_element() >= 0.0 && albedo.max_element() <= 1.0;
            let problem = if !surface.corners().iter().all(|c| c.is_finite()) || surface.normal() == Vec3::ZERO {
                "has no area or is not finite"
            } else if surface.edge_u.normalize().dot(surface.edge_v.normalize()).abs() > 1e-4 {
                "has edges that are not perpendicular"
            } else if !(reflects(surface.albedo) && reflects(second)) {
                "has an albedo outside 0 to 1"
            } else if surface.checker.is_some_and(|checker| checker.size.min_element() <= 0.0 || checker.size.is_nan())
            {
                "has a checker without size"
            } else if !(surface.emission.is_finite() && surface.emission.min_element() >= 0.0) {
                "has an emission that is negative or not finite"
            } else {
                continue;
            };
            return Err(Error::Argument(format!("room: surface {index} {problem}")));
        }
        Ok(())
    }

    /// Adds a surface; returns it for further changes.
    fn add(&mut self, corner: Vec3, edge_u: Vec3, edge_v: Vec3, albedo: Vec3) -> &mut Rectangle {
        let index = self.surfaces.len();
        self.surfaces.push(Rectangle::new(corner, edge_u, edge_v, albedo));
        &mut self.surfaces[index]
    }

    /// Adds the chosen faces of a block that stands on `foot`, the middle of its bottom, and is turned about +Y.
    fn add_block(&mut self, foot: Vec3, size: Vec3, turn_degrees: f32, albedo: Vec3, faces: &[Face]) {
        let turn = Quat::from_rotation_y(turn_degrees.to_radians());
        for face in faces {
            let (corner, edge_u, edge_v) = face.of_unit_block();
            let place = |p: Vec3| turn * (p * size);
            self.add(foot + place(corner), place(edge_u), place(edge_v), albedo);
        }
    }

    /// Adds a lamp that hangs with its top at `top`: a block whose underside emits.
    fn add_lamp(&mut self, top: Vec3, size: Vec3, emission: Vec3) {
        let white = Vec3::splat(0.75);
        self.add_block(top - Vec3::Y * size.y, size, 0.0, white, Face::HANGING);
        let underside = self.surfaces.len() - 1;
        self.surfaces[underside].emission = emission;
    }

    /// Adds a wall with a window: four strips around an opening, its reveal, and the pane at its far end.
    fn add_wall_with_window(&mut self, wall: Rectangle, window: Window) {
        let (length_u, length_v) = (wall.edge_u.length(), wall.edge_v.length());
        let (u, v, back) = (wall.edge_u / length_u, wall.edge_v / length_v, -wall.normal() * window.depth);
        let (low, high) = (window.low, window.low + window.size);
        let at = |x: f32, y: f32| wall.corner + u * x + v * y;
        let mut strip = |x0: f32, y0: f32, x1: f32, y1: f32| {
            self.add(at(x0, y0), u * (x1 - x0), v * (y1 - y0), wall.albedo);
        };
        strip(0.0, 0.0, length_u, low.y);
        strip(0.0, high.y, length_u, length_v);
        strip(0.0, low.y, low.x, high.y);
        strip(high.x, low.y, length_u, high.y);

        let (size_u, size_v) = (u * window.size.x, v * window.size.y);
        let white = Vec3::splat(0.75);
        self.add(at(low.x, low.y), size_u, back, white);
        self.add(at(low.x, high.y), back, size_u, white);
        self.add(at(low.x, low.y), back, size_v, white);
        self.add(at(high.x, low.y), size_v, back, white);
        self.add(at(low.x, low.y) + back, size_u, size_v, Vec3::splat(0.1)).emission = window.emission;
    }
}

/// An opening in a wall, in metres along the wall's edges.
struct Window {
    low: Vec2,
    size: Vec2,
    depth: f32,
    emission: Vec3,
}

/// One face of a block.
#[derive(Clone, Copy)]
enum Face {
    Left,
    Right,
    Bottom,
    Top,
    Back,
    Front,
}

impl Face {
    const SIDES: &[Self] = &[Self::Left, Self::Right, Self::Back, Self::Front];
    /// A block on the floor: its bottom would lie in the floor.
    const STANDING: &[Self] = &[Self::Left, Self::Right, Self::Back, Self::Front, Self::Top];
    const HANGING: &[Self] = &[Self::Left, Self::Right, Self::Back, Self::Front, Self::Bottom];
    /// A beam along Z between two walls.
    const BEAM: &[Self] = &[Self::Left, Self::Right, Self::Bottom, Self::Top];

    /// (corner, edge_u, edge_v) on a block of size 1 whose bottom has its middle at 0; the front looks outwards.
    fn of_unit_block(self) -> (Vec3, Vec3, Vec3) {
        let low = Vec3::new(-0.5, 0.0, -0.5);
        let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
        match self {
            Self::Left => (low, z, y),
            Self::Right => (low + x, y, z),
            Self::Bottom => (low, x, z),
            Self::Top => (low + y, z, x),
            Self::Back => (low, y, x),
            Self::Front => (low + z, x, y),
        }
    }
}

/// A closed room of 4 x 2.8 x 5 m about x = z = 0 with three blocks, a small warm lamp under the ceiling and a bluish
/// window. An object has its place about (0, 1, 0).
pub fn toy_room() -> Room {
    let (low, high) = (Vec3::new(-2.0, 0.0, -2.5), Vec3::new(2.0, 2.8, 2.5));
    let (x, y, z) = (Vec3::X * 4.0, Vec3::Y * 2.8, Vec3::Z * 5.0);
    let white = Vec3::new(0.74, 0.73, 0.70);
    let mut room = Room::default();
    let planks = Checker { albedo: Vec3::new(0.33, 0.21, 0.12), size: Vec2::new(1.25, 0.2) };
    room.add(low, z, x, Vec3::new(0.46, 0.31, 0.19)).checker = Some(planks);
    room.add(low + y, x, z, Vec3::splat(0.8));
    room.add(low, y, z, Vec3::new(0.66, 0.12, 0.09));
    room.add(low + x, z, y, Vec3::new(0.10, 0.42, 0.45));
    room.add(high - x - y, y, x, white);
    let window = Window {
        low: Vec2::new(0.45, 0.8),
        size: Vec2::new(1.3, 1.8),
        depth: 0.12,
        emission: Vec3::new(3.0, 4.1, 5.6),
    };
    room.add_wall_with_window(Rectangle::new(low, x, y, white), window);

    room.add_lamp(Vec3::new(0.75, 2.8, 0.35), Vec3::new(0.3, 0.06, 0.3), Vec3::new(56.0, 48.0, 36.0));
    let standing = Face::STANDING;
    room.add_block(Vec3::new(1.15, 0.0, -1.45), Vec3::new(0.9, 0.85, 0.9), 27.0, Vec3::new(0.72, 0.66, 0.55), standing);
    room.add_block(Vec3::new(-1.6, 0.0, 0.95), Vec3::new(0.65, 1.7, 1.0), 0.0, Vec3::new(0.20, 0.27, 0.48), standing);
    room.add_block(Vec3::new(1.1, 0.0, 1.55), Vec3::new(0.55, 0.45, 0.5), -18.0, Vec3::new(0.75, 0.55, 0.12), standing);
    room
}

/// A box of 2 x 2 x 2 m on the floor about x = z = 0 that is open at +Z, with a red wall at -X, a green one at +X, a tall
/// and a short block (after Goral et al. 1984). Nothing emits.
pub fn cornell_box() -> Room {
    let low = Vec3::new(-1.0, 0.0, -1.0);
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let white = Vec3::splat(0.73);
    let mut room = Room::default();
    room.add(low, z, x, white);
    room.add(low + y, x, z, white);
    room.add(low, x, y, white);
    room.add(low, y, z, Vec3::new(0.63, 0.065, 0.05));
    room.add(low + x, z, y, Vec3::new(0.14, 0.45, 0.091));
    let standing = Face::STANDING;
    room.add_block(Vec3::new(-0.34, 0.0, -0.36), Vec3::new(0.58, 1.2, 0.58), 17.0, white, standing);
    room.add_block(Vec3::new(0.36, 0.0, 0.3), Vec3::new(0.58, 0.58, 0.58), -17.0, white, standing);
    room
}

/// A colonnade of 12 x 6 x 20 m about x = z = 0: a nave with skylights between two aisles, balconies with balusters
/// above them, a tall window and many lamps; several hundred rectangles.
pub fn hall() -> Room {
    let low = Vec3::new(-6.0, 0.0, -10.0);
    let (x, y, z) = (Vec3::X * 12.0, Vec3::Y * 6.0, Vec3::Z * 20.0);
    let (stone, plaster) = (Vec3::new(0.58, 0.52, 0.43), Vec3::new(0.72, 0.68, 0.60));
    let mut room = Room::default();
    let tiles = Checker { albedo: Vec3::new(0.22, 0.12, 0.10), size: Vec2::splat(0.8) };
    room.add(low, z, x, Vec3::new(0.62, 0.58, 0.50)).checker = Some(tiles);
    room.add(low, y, z, Vec3::new(0.62, 0.30, 0.20));
    room.add(low + x, z, y, Vec3::new(0.25, 0.38, 0.52));
    room.add(low + z, y, x, plaster);
    hall_openings(&mut room, plaster);
    for side in [-1.0, 1.0] {
        hall_side(&mut room, side, stone);
    }
    room
}

/// The hall's skylights and its tall window at -Z.
fn hall_openings(room: &mut Room, plaster: Vec3) {
    let low = Vec3::new(-6.0, 0.0, -10.0);
    let (x, y) = (Vec3::X * 12.0, Vec3::Y * 6.0);
    let panel = Vec3::Z * (20.0 / 3.0);
    for n in [0.0, 1.0, 2.0] {
        let skylight = Window {
            low: Vec2::new(4.6, 1.7),
            size: Vec2::new(2.8, 3.2),
            depth: 0.5,
            emission: Vec3::new(7.0, 9.0, 12.0),
        };
        room.add_wall_with_window(Rectangle::new(low + y + panel * n, x, panel, plaster), skylight);
    }
    let window =
        Window { low: Vec2::new(4.5, 1.2), size: Vec2::new(3.0, 3.6), depth: 0.4, emission: Vec3::new(6.0, 5.6, 5.0) };
    room.add_wall_with_window(Rectangle::new(low, x, y, plaster), window);
}

/// One aisle of the hall, at -X or +X as `side` is -1 or 1: eight pillars, a balcony on them, lamps below it.
fn hall_side(room: &mut Room, side: f32, stone: Vec3) {
    let inner = if side < 0.0 { Face::Right } else { Face::Left };
    let slab = [Face::Bottom, Face::Top, inner];
    room.add_block(Vec3::new(4.35 * side, 3.2, 0.0), Vec3::new(3.3, 0.25, 20.0), 0.0, Vec3::splat(0.6), &slab);
    for n in 0_u8..8 {
        let z = 2.5 * f32::from(n) - 8.75;
        let foot = |x: f32, y: f32| Vec3::new(x * side, y, z);
        room.add_block(foot(3.0, 0.0), Vec3::new(0.9, 0.35, 0.9), 0.0, stone, Face::STANDING);
        // two square shafts, one turned, make a fluted one
        room.add_block(foot(3.0, 0.35), Vec3::new(0.5, 2.55, 0.5), 0.0, stone, Face::SIDES);
        room.add_block(foot(3.0, 0.35), Vec3::new(0.5, 2.55, 0.5), 45.0, stone, Face::SIDES);
        room.add_block(foot(3.0, 2.9), Vec3::new(0.8, 0.3, 0.8), 0.0, stone, Face::HANGING);
        room.add_block(foot(3.15, 3.45), Vec3::new(0.36, 2.55, 0.36), 0.0, stone, Face::SIDES);
    }
    let wood = Vec3::new(0.30, 0.17, 0.09);
    for n in 0_u8..40 {
        let foot = Vec3::new(2.85 * side, 3.45, 0.5 * f32::from(n) - 9.75);
        room.add_block(foot, Vec3::new(0.07, 0.75, 0.07), 0.0, wood, Face::SIDES);
    }
    room.add_block(Vec3::new(2.85 * side, 4.2, 0.0), Vec3::new(0.14, 0.1, 20.0), 0.0, wood, Face::BEAM);
    for z in [-7.5, -2.5, 2.5, 7.5] {
        room.add_lamp(Vec3::new(4.6 * side, 3.2, z), Vec3::new(0.35, 0.08, 0.35), Vec3::new(60.0, 42.0, 22.0));
    }
}
