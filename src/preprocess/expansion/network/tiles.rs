//! Tiles that cover a picture and overlap, with the weights by which they blend.

use std::ops::Range;

/// Where tiles start: multiples of this, so that a network which halves its input up to four times sees the same pairs
/// of pixels in every tile.
const STEP: usize = 16;
/// Overlap of neighbours where tiles are large, in pixels.
const OVERLAP: usize = 64;

/// Tiles of one size on a picture. Near the border of a tile a network guesses what lies beyond, so there a tile counts
/// for nothing where it has a neighbour; then its weight rises to 1.
pub(super) struct Tiles {
    /// Rows, and columns.
    axes: [Axis; 2],
}

/// The tiles along one axis.
struct Axis {
    /// Pixels of the picture.
    length: usize,
    /// Pixels of a tile.
    tile: usize,
    overlap: usize,
    starts: Vec<usize>,
}

impl Axis {
    fn new(length: usize, tile: usize) -> Self {
        let overlap = (tile / 4).min(OVERLAP);
        // The last tile ends at the picture's end, or up to a step beyond it.
        let last = length.saturating_sub(tile).next_multiple_of(STEP);
        let mut starts: Vec<usize> = (0..last).step_by(tile - overlap).collect();
        starts.push(last);
        Self { length, tile, overlap, starts }
    }

    /// Weight of the tile that starts at `start` for a pixel of it; zero in the outer quarter of an overlap.
    fn weight(&self, start: usize, pixel: usize) -> f32 {
        let ramp = |inside: usize| {
            let quarter = self.overlap as f32 / 4.0;
            ((inside as f32 + 0.5 - quarter) / (2.0 * quarter).max(1.0)).clamp(0.0, 1.0)
        };
        let before = if start == 0 { 1.0 } else { ramp(pixel - start) };
        let after = if start + self.tile >= self.length { 1.0 } else { ramp(start + self.tile - 1 - pixel) };
        before * after
    }

    /// The picture's pixels in the tile that starts at `start`.
    fn pixels(&self, start: usize) -> Range<usize> {
        start..(start + self.tile).min(self.length)
    }
}

impl Tiles {
    /// Tiles of `size` on a picture; both are height and width in pixels.
    pub(super) fn new(picture: [usize; 2], size: [usize; 2]) -> Self {
        Self { axes: [0, 1].map(|axis| Axis::new(picture[axis], size[axis])) }
    }

    /// Pixels of a tile.
    pub(super) fn pixels(&self) -> usize {
        self.axes[0].tile * self.axes[1].tile
    }

    /// First row and column of each tile that counts for one of the wanted pixels, or of every tile; none where the
    /// picture is empty.
    pub(super) fn needed(&self, wanted: Option<&[bool]>) -> Vec<[usize; 2]> {
        let every = self.axes[0].starts.iter().flat_map(|&y| self.axes[1].starts.iter().map(move |&x| [y, x]));
        every
            .filter(|&origin| {
                let mut needed = false;
                self.visit(origin, |_, pixel, _| needed |= wanted.is_none_or(|flags| flags[pixel]));
                needed
            })
            .collect()
    }

    /// Calls `each` with the index in the tile, the index in the picture and the weight of every pixel that the tile
    /// counts for.
    pub(super) fn visit(&self, origin: [usize; 2], mut each: impl FnMut(usize, usize, f32)) {
        let [rows, columns] = &self.axes;
        let across: Vec<f32> = columns.pixels(origin[1]).map(|x| columns.weight(origin[1], x)).collect();
        for y in rows.pixels(origin[0]) {
            let down = rows.weight(origin[0], y);
            for (i, weight) in across.iter().map(|across| across * down).enumerate().filter(|(_, w)| *w > 0.0) {
                each((y - origin[0]) * columns.tile + i, y * columns.length + origin[1] + i, weight);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pixel gets a result, whatever the sizes; and far inside of an overlap, from one tile alone.
    #[test]
    fn tiles_cover_pictures() {
        for length in [1, 7, 16, 100, 255, 256, 257, 449, 1000, 1024] {
            for tile in [8, 16, 30, 100, 256] {
                let tiles = Tiles::new([length, 3], [tile, tile]);
                let mut sums = vec![0.0; 3 * length];
                for origin in tiles.needed(None) {
                    tiles.visit(origin, |at, pixel, weight| {
                        assert!(at < tile * tile);
                        sums[pixel] += weight;
                    });
                }
                assert!(sums.iter().all(|&sum| sum >= 0.49), "{length} {tile}: {sums:?}");
            }
        }
        assert_eq!(Tiles::new([1024, 1024], [256, 256]).needed(None).len(), 25);
        assert!(Tiles::new([0, 0], [256, 256]).needed(None).is_empty());
    }

    /// A wanted pixel needs all tiles that count for it, and no other.
    #[test]
    fn tiles_without_wanted_pixels_are_skipped() {
        let tiles = Tiles::new([448, 448], [256, 256]);
        let mut wanted = vec![false; 448 * 448];
        // In both tiles, but too near the border of the second one.
        wanted[10 * 448 + 200] = true;
        assert_eq!(tiles.needed(Some(&wanted)), [[0, 0]]);
        wanted[10 * 448 + 224] = true;
        assert_eq!(tiles.needed(Some(&wanted)), [[0, 0], [0, 192]]);
    }
}
