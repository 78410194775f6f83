//! Which tiles have buffers, and which of them light a block of 4 x 4 pixels.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{DVec3, Vec3, Vec4};

use super::batch::Coverage;
use crate::Result;
use crate::passes::Receiver;
use crate::passes::receivers::Receivers;
use crate::passes::tile_convolve::BlockTiles;
use crate::passes::tile_radiance::octahedral_direction;

/// Level of the smallest tiles, 4 x 4 pixels, which are also the blocks that are lit at once.
pub(super) const FINEST: u32 = 2;

/// A tile's buffer.
#[derive(Clone, Copy, Debug)]
struct Tile {
    slot: u32,
    /// Mean parallax of its extent, in texels.
    parallax: f32,
}

/// The tiles of a region.
pub(super) struct TileMap {
    pixels: u32,
    tiles_x: u32,
    tiles_y: u32,
    /// By receiver slot from level [`FINEST`] on.
    tiles: Vec<Option<Tile>>,
    /// Spheres of positions, alike.
    spheres: Vec<[f32; 4]>,
    /// Cones of normals, alike.
    normals: Vec<[f32; 4]>,
}

/// Pairs of texels as directions, to pick those above a horizon.
pub(super) struct TexelPairs {
    directions: Vec<Vec3>,
    /// No part of a pair is farther than this from its direction, radians.
    reach: f32,
}

impl TexelPairs {
    /// The pairs of tiles with `size` texels along a side, in their order.
    pub(super) fn new(size: u32) -> Self {
        let at = |x: u32, y: u32| {
            let place = |v: u32| f64::from(v) / f64::from(size);
            DVec3::from(octahedral_direction(place(x), place(y))).as_vec3()
        };
        let pairs = (0..size * size / 2).map(|k| (2 * k % size, 2 * k / size));
        let corners = |x: u32, y: u32| [at(x, y), at(x + 2, y), at(x, y + 1), at(x + 2, y + 1)];
        let directions: Vec<Vec3> =
            pairs.clone().map(|(x, y)| corners(x, y).into_iter().sum::<Vec3>().normalize_or(Vec3::Z)).collect();
        let farthest = pairs
            .zip(&directions)
            .flat_map(|((x, y), middle)| corners(x, y).map(|corner| corner.dot(*middle)))
            .fold(1.0, f32::min);
        Self { directions, reach: farthest.clamp(-1.0, 1.0).acos() + 1e-3 }
    }

    /// Appends the pairs of which a part is above the horizon of a normal in the cone.
    fn append_facing(&self, cone: [f32; 4], list: &mut Vec<u16>) {
        let axis = Vec3::new(cone[0], cone[1], cone[2]);
        let angle = FRAC_PI_2 + cone[3].clamp(-1.0, 1.0).acos() + self.reach;
        let least = if angle >= PI { -2.0 } else { angle.cos() };
        let facing = self.directions.iter().enumerate().filter(|(_, direction)| axis.dot(**direction) > least);
        list.extend(facing.map(|(k, _)| k as u16));
    }
}

/// Tiles farther than this from a block, in radii of its own tile, light it less, and not at all from the second on: they
/// lie on other surfaces.
const NEAR: (f32, f32) = (2.5, 5.0);

/// A tile whose positions reach farther than this many times what it looks like from the eye shows two surfaces.
const GRAZING: f32 = 4.0;

impl TileMap {
    /// Reads a region's receivers, and widens their normals' cones by those of the tiles around, whose pixels they light
    /// too.
    pub(super) fn new(receivers: &Receivers, coverage: &Coverage) -> Result<Self> {
        let first = Receiver::new(FINEST, 0).slot(receivers.pixels);
        let count = (Receiver::slots(receivers.pixels) - first) as usize;
        let offset = u64::from(first) * 16;
        let map = Self {
            pixels: receivers.pixels,
            tiles_x: receivers.tiles_x,
            tiles_y: receivers.pixels / 256 / receivers.tiles_x,
            tiles: vec![None; count],
            spheres: receivers.spheres.download_at(offset, count)?,
            normals: receivers.cones.download_at(offset, count)?,
        };
        let cones = map.widened(coverage);
        receivers.cones.upload_at(offset, bytemuck::cast_slice(&cones))?;
        Ok(map)
    }

    fn at(&self, tile: Receiver) -> usize {
        (tile.slot(self.pixels) - Receiver::new(FINEST, 0).slot(self.pixels)) as usize
    }

    pub(super) fn insert(&mut self, tile: Receiver, slot: u32, parallax: f32) {
        let at = self.at(tile);
        self.tiles[at] = Some(Tile { slot, parallax });
    }

    /// Forgets a tile; returns its slot.
    pub(super) fn remove(&mut self, tile: Receiver) -> Option<u32> {
        let at = self.at(tile);
        self.tiles[at].take().map(|tile| tile.slot)
    }

    pub(super) fn parallax(&self, tile: Receiver) -> Option<f32> {
        self.tiles[self.at(tile)].map(|tile| tile.parallax)
    }

    /// Radius of a tile's sphere of positions, metres; of the tile as it looks from the eye where it shows a surface at a
    /// grazing angle, along which tiles blend as well as along others. `pixel` is the size of a pixel a metre away. What
    /// reaches much farther in depth are two surfaces.
    pub(super) fn extent(&self, tile: Receiver, eye: Vec3, pixel: f32) -> f32 {
        let sphere = Vec4::from(self.spheres[self.at(tile)]);
        let half_diagonal = std::f32::consts::FRAC_1_SQRT_2 * (1_u32 << tile.level()) as f32;
        let seen = half_diagonal * pixel * sphere.truncate().distance(eye);
        if sphere.w > GRAZING * seen { sphere.w } else { sphere.w.clamp(0.0, seen) }
    }

    /// Radius of a tile's sphere of positions, metres.
    pub(super) fn radius(&self, tile: Receiver) -> f32 {
        self.spheres[self.at(tile)][3].max(0.0)
    }

    /// Number of tiles.
    pub(super) fn tiles(&self) -> u64 {
        self.tiles.iter().flatten().count() as u64
    }

    /// Cones for the traversal: every tile, and those below it, has one that holds the normals of all pixels that it may
    /// light, which lie up to half a tile beyond its own.
    fn widened(&self, coverage: &Coverage) -> Vec<[f32; 4]> {
        const QUARTER: u32 = Receiver::TILE_LEVEL - 1;
        let mut cones = self.normals.clone();
        for tile in coverage.tiles() {
            let (x, y) = pixel_place(tile.index() << 8, self.tiles_x);
            let mut around = Vec::with_capacity(16);
            for k in 0..16 {
                let place = (i64::from(x) + 8 * (k % 4) - 8, i64::from(y) + 8 * (k / 4) - 8);
                let Some(pixel) = self.pixel(place.0, place.1) else { continue };
                let at = self.at(Receiver::new(QUARTER, pixel >> (2 * QUARTER)));
                if self.spheres[at][3] >= 0.0 {
                    around.push(self.normals[at]);
                }
            }
            let cone = cone_around(&around);
            let mut below = vec![tile];
            while let Some(receiver) = below.pop() {
                cones[self.at(receiver)] = cone;
                if receiver.level() > FINEST {
                    below.extend(receiver.children());
                }
            }
        }
        cones
    }

    /// Slot of a pixel of the region.
    fn pixel(&self, x: i64, y: i64) -> Option<u32> {
        let inside = x >= 0 && y >= 0 && x < i64::from(16 * self.tiles_x) && y < i64::from(16 * self.tiles_y);
        inside.then(|| pixel_slot(x as u32, y as u32, self.tiles_x))
    }

    /// The smallest tile with a buffer that holds a pixel of the region.
    fn holding(&self, x: i64, y: i64) -> Option<(Receiver, Tile)> {
        let pixel = self.pixel(x, y)?;
        (FINEST..=Receiver::TILE_LEVEL).find_map(|level| {
            let tile = Receiver::new(level, pixel >> (2 * level));
            self.tiles[self.at(tile)].map(|buffer| (tile, buffer))
        })
    }

    /// Covered blocks below the tiles that `wanted` picks, with the tiles that light each; and lists of the pairs of
    /// texels above their horizons.
    pub(super) fn blocks(
        &self,
        coverage: &Coverage,
        pairs: &TexelPairs,
        wanted: impl Fn(Receiver) -> bool,
    ) -> (Vec<u16>, Vec<BlockTiles>) {
        let (mut lists, mut blocks) = (Vec::new(), Vec::new());
        for tile in coverage.tiles().into_iter().filter(|tile| wanted(*tile)) {
            let first = lists.len();
            pairs.append_facing(self.normals[self.at(tile)], &mut lists);
            let list = [first as u32, (lists.len() - first) as u32];
            for block in tile.index() << 4..(tile.index() + 1) << 4 {
                let block = Receiver::new(FINEST, block);
                if coverage.pixels(block).next().is_none() {
                    continue;
                }
                let (x, y) = pixel_place(block.index() << 4, self.tiles_x);
                let Some((own, buffer)) = self.holding(i64::from(x), i64::from(y)) else { continue };
                // The part of a block that is lit lies in one square between the middles of four tiles: all of it, or
                // quadrants where tiles are as small as blocks.
                let parts = if own.level() == FINEST { 4 } else { 1 };
                blocks.extend((0..parts).map(|part| BlockTiles {
                    work: [block.index(), if parts == 4 { 15 << (4 * part) } else { 0xffff }, list[0], list[1]],
                    ..self.lights((x, y), (own, buffer), if parts == 4 { Some(part) } else { None })
                }));
            }
        }
        (lists, blocks)
    }

    /// The four tiles whose middles are around a block at a place, or around a quadrant of it, by bilinear weights; those
    /// on other surfaces count less.
    fn lights(&self, (x, y): (u32, u32), (own, buffer): (Receiver, Tile), quadrant: Option<u32>) -> BlockTiles {
        let side = 1_i64 << own.level();
        let (parts, part) = quadrant.map_or((1, [0, 0]), |q| (2, [q % 2, q / 2]));
        let size = 4 / parts;
        let first = [x + part[0] * size, y + part[1] * size].map(i64::from);
        let centre = |tile: Receiver| Vec4::from(self.spheres[self.at(tile)]).truncate();
        let middle = centre(Receiver::new(FINEST, pixel_slot(x, y, self.tiles_x) >> (2 * FINEST)));
        let reach = self.spheres[self.at(own)][3].max(1e-20);
        let [column, row] = first.map(|v| (v + side / 2).div_euclid(side) - 1);
        let mut tiles = BlockTiles { slots: [buffer.slot; 4], ..BlockTiles::default() };
        let mut present = [0.0; 4];
        for k in 0..4 {
            let (i, j) = (column + k % 2, row + k / 2);
            let Some((mut tile, mut buffer)) = self.holding(i * side + side / 2, j * side + side / 2) else { continue };
            if tile.level() < own.level() {
                // Of smaller tiles, the one next to the part that is lit.
                let half = i64::from(size / 2);
                let x = (first[0] + half).clamp(i * side, (i + 1) * side - 1);
                let y = (first[1] + half).clamp(j * side, (j + 1) * side - 1);
                (tile, buffer) = self.holding(x, y).unwrap_or((tile, buffer));
            }
            let apart = centre(tile).distance(centre(own)) / reach;
            tiles.slots[k as usize] = buffer.slot;
            let offset = centre(tile) - middle;
            (0..3).for_each(|axis| tiles.offsets[axis][k as usize] = offset[axis]);
            present[k as usize] = ((NEAR.1 - apart) / (NEAR.1 - NEAR.0)).clamp(0.0, 1.0);
        }
        // Weights at the part's corners.
        let at = |corner: i64| {
            let along = |first: i64, tile: i64, step: i64| {
                (first + i64::from(size) * step - tile * side - side / 2) as f32 / side as f32
            };
            let (u, v) = (along(first[0], column, corner % 2), along(first[1], row, corner / 2));
            let weights = Vec4::new((1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v) * Vec4::from(present);
            weights / weights.element_sum().max(1e-6)
        };
        let corners = [0, 1, 2, 3].map(at);
        let [a, b, c, d] = [
            corners[0],
            corners[1] - corners[0],
            corners[2] - corners[0],
            corners[3] - corners[2] - corners[1] + corners[0],
        ];
        tiles.middle = (a + 0.5 * (b + c) + 0.25 * d).into();
        // From the part's coordinates to the block's: t = parts * x - part.
        let (scale, [m, n]) = (parts as f32, part.map(|p| p as f32));
        tiles.constant = (a - b * m - c * n + d * (m * n)).into();
        tiles.along_x = (scale * (b - d * n)).into();
        tiles.along_y = (scale * (c - d * m)).into();
        tiles.along_both = (scale * scale * d).into();
        tiles
    }
}

/// A cone (axis, cosine of the half aperture) that contains others.
fn cone_around(cones: &[[f32; 4]]) -> [f32; 4] {
    let axis_of = |cone: &[f32; 4]| Vec3::new(cone[0], cone[1], cone[2]);
    let axis = cones.iter().map(axis_of).sum::<Vec3>().normalize_or(Vec3::Y);
    let angle = cones
        .iter()
        .map(|cone| axis.dot(axis_of(cone)).clamp(-1.0, 1.0).acos() + cone[3].clamp(-1.0, 1.0).acos())
        .fold(0.0, f32::max);
    [axis.x, axis.y, axis.z, (angle + 1e-3).min(PI).cos()]
}

/// Slot of a pixel of a region, in Morton order inside 16 x 16 tiles.
fn pixel_slot(x: u32, y: u32, tiles_x: u32) -> u32 {
    let spread = |v: u32| (0..4).map(|i| (v >> i & 1) << (2 * i)).sum::<u32>();
    (y / 16 * tiles_x + x / 16) * 256 + spread(x % 16) + 2 * spread(y % 16)
}

/// Place in the region of a pixel slot.
pub(super) fn pixel_place(slot: u32, tiles_x: u32) -> (u32, u32) {
    let (tile, code) = (slot / 256, slot % 256);
    let even_bits = |bits: u32| (0..4).map(|i| (bits >> (2 * i) & 1) << i).sum::<u32>();
    (tile % tiles_x * 16 + even_bits(code), tile / tiles_x * 16 + even_bits(code >> 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four by two whole tiles of a plane, all covered; the second tile is split.
    fn map() -> (TileMap, Coverage) {
        let (pixels, tiles_x) = (8 * 256, 4);
        let first = Receiver::new(FINEST, 0).slot(pixels);
        let count = (Receiver::slots(pixels) - first) as usize;
        let mut map = TileMap {
            pixels,
            tiles_x,
            tiles_y: 2,
            tiles: vec![None; count],
            spheres: vec![[0.0; 4]; count],
            normals: vec![[0.0, 0.0, 1.0, 1.0]; count],
        };
        for level in FINEST..=Receiver::TILE_LEVEL {
            for index in 0..pixels >> (2 * level) {
                let receiver = Receiver::new(level, index);
                let (x, y) = pixel_place(receiver.pixels().start, tiles_x);
                let half = 0.5 * (1_u32 << level) as f32;
                let at = map.at(receiver);
                map.spheres[at] = [x as f32 + half, y as f32 + half, 0.0, 1.5 * half];
            }
        }
        for tile in (0..8).map(|index| Receiver::new(Receiver::TILE_LEVEL, index)) {
            if tile.index() == 1 {
                for (k, child) in tile.children().into_iter().enumerate() {
                    map.insert(child, 100 + k as u32, 0.0);
                }
            } else {
                map.insert(tile, tile.index(), 0.0);
            }
        }
        (map, Coverage(vec![[u32::MAX; 8]; 8]))
    }

    /// Weight of each slot at a place in the block, 0 to 1.
    fn weights(block: &BlockTiles, x: f32, y: f32) -> Vec<(u32, f32)> {
        let mut sums: Vec<(u32, f32)> = Vec::new();
        for k in 0..4 {
            let weight = block.constant[k] + x * block.along_x[k] + y * block.along_y[k] + x * y * block.along_both[k];
            match sums.iter_mut().find(|(slot, _)| *slot == block.slots[k]) {
                Some((_, sum)) => *sum += weight,
                None => sums.push((block.slots[k], weight)),
            }
        }
        sums.retain(|(_, weight)| weight.abs() > 1e-5);
        sums.sort_unstable_by_key(|(slot, _)| *slot);
        sums
    }

    #[test]
    fn weights_add_up_to_one_and_meet_between_blocks() {
        let (map, coverage) = map();
        let (_, blocks) = map.blocks(&coverage, &TexelPairs::new(34), |_| true);
        assert_eq!(blocks.len(), 8 * 16);
        let at = |x: u32, y: u32| {
            let block = pixel_slot(4 * x, 4 * y, 4) >> 4;
            blocks.iter().find(|b| b.work[0] == block).expect("every block is covered")
        };
        for (x, y) in (0..16 * 8).map(|n| (n % 16, n / 16)) {
            for (u, v) in [(0.0, 0.0), (1.0, 0.0), (0.3, 0.8), (1.0, 1.0)] {
                let sum: f32 = weights(at(x, y), u, v).iter().map(|(_, weight)| weight).sum();
                assert!((sum - 1.0).abs() < 1e-5, "{sum} in block {x}, {y}");
            }
            // Away from the tile that is split, a block ends as its neighbour begins.
            if (8..15).contains(&x) {
                for v in [0.0, 0.5, 1.0] {
                    let (left, right) = (weights(at(x, y), 1.0, v), weights(at(x + 1, y), 0.0, v));
                    assert_eq!(left.len(), right.len(), "{left:?} beside {right:?} at {x}, {y}");
                    for ((a, first), (b, second)) in left.iter().zip(&right) {
                        assert!(a == b && (first - second).abs() < 1e-5, "{left:?} beside {right:?} at {x}, {y}");
                    }
                }
            }
        }
        // In the middle of a tile its own buffer counts alone.
        assert_eq!(weights(at(9, 1), 1.0, 1.0), [(2, 1.0)]);
        // The blocks of the split tile are lit by its parts, by then also by its neighbours.
        assert!(at(5, 1).slots.iter().all(|slot| (100..104).contains(slot)), "{:?}", at(5, 1));
        assert!(at(4, 1).slots.contains(&0), "{:?}", at(4, 1));
    }

    #[test]
    fn lists_hold_what_is_above_the_horizon() {
        let pairs = TexelPairs::new(34);
        let (mut narrow, mut all) = (Vec::new(), Vec::new());
        pairs.append_facing([0.0, 1.0, 0.0, 1.0], &mut narrow);
        pairs.append_facing([0.0, 1.0, 0.0, -1.0], &mut all);
        assert_eq!(all, (0..34 * 34 / 2).collect::<Vec<u16>>());
        // A half and a rim of about a pair.
        assert!((310..400).contains(&narrow.len()), "{}", narrow.len());
        for (k, direction) in pairs.directions.iter().enumerate() {
            assert!(direction.y < 0.0 || narrow.contains(&(k as u16)));
        }
    }

    #[test]
    fn a_cone_around_cones_contains_them() {
        let cones = [[0.0, 0.0, 1.0, 0.9], [0.6, 0.0, 0.8, 0.95], [0.0, 0.6, 0.8, 1.0]];
        let [x, y, z, cosine] = cone_around(&cones);
        for cone in cones {
            let between = Vec3::new(x, y, z).dot(Vec3::new(cone[0], cone[1], cone[2])).acos();
            assert!(between + cone[3].acos() <= cosine.acos());
        }
    }
}
