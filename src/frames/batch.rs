//! Batches: the receivers that a traversal starts from, and the entries that the raster passes fill.

use crate::passes::Receiver;

/// Covered pixels of a region, one bit each in Morton order, eight words a tile.
pub(super) struct Coverage(pub(super) Vec<[u32; 8]>);

impl Coverage {
    /// Tiles with at least one covered pixel.
    pub(super) fn tiles(&self) -> Vec<Receiver> {
        self.0
            .iter()
            .enumerate()
            .filter(|(_, words)| words.iter().any(|w| *w != 0))
            .map(|(tile, _)| Receiver::new(Receiver::TILE_LEVEL, tile as u32))
            .collect()
    }

    fn is_covered(&self, pixel: u32) -> bool {
        self.0[pixel as usize / 256][pixel as usize % 256 / 32] >> (pixel % 32) & 1 == 1
    }

    /// Covered pixels below a receiver.
    pub(super) fn pixels(&self, receiver: Receiver) -> impl Iterator<Item = u32> + '_ {
        receiver.pixels().filter(|p| self.is_covered(*p))
    }

    /// Covered pixels below all receivers.
    pub(super) fn count(&self, receivers: &[Receiver]) -> u64 {
        receivers.iter().map(|r| self.pixels(*r).count() as u64).sum()
    }

    /// Entries of the raster passes: blocks of 2 x 2 pixels, index in the high bits and the pixels wanted in the low
    /// four.
    pub(super) fn blocks(&self, receivers: &[Receiver]) -> Vec<u32> {
        let mut blocks: Vec<u32> = Vec::new();
        for receiver in receivers {
            let mut last = None;
            for pixel in self.pixels(*receiver) {
                let bit = 1 << (pixel & 3);
                match blocks.last_mut() {
                    Some(block) if last == Some(pixel >> 2) => *block |= bit,
                    _ => blocks.push(pixel >> 2 << 4 | bit),
                }
                last = Some(pixel >> 2);
            }
        }
        blocks
    }

    /// Two halves of a batch that overflowed, or the covered parts of its only receiver; empty when that is a pixel.
    pub(super) fn split(&self, batch: &[Receiver]) -> Vec<Vec<Receiver>> {
        match batch {
            [] => Vec::new(),
            [one] if one.level() == 0 => Vec::new(),
            [one] => one
                .children()
                .into_iter()
                .filter(|child| self.pixels(*child).next().is_some())
                .map(|child| vec![child])
                .collect(),
            many => {
                let (first, second) = many.split_at(many.len() / 2);
                vec![first.to_vec(), second.to_vec()]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn coverage() -> Coverage {
        let mut words = [0; 8];
        words[0] = 0b1001_0000_0000_0110;
        words[7] = 1 << 31;
        Coverage(vec![[0; 8], words])
    }

    #[test]
    fn blocks_hold_each_covered_pixel_once() {
        let coverage = coverage();
        let tiles = coverage.tiles();
        assert_eq!(tiles, [Receiver::new(4, 1)]);
        assert_eq!(coverage.count(&tiles), 5);
        let blocks = coverage.blocks(&tiles);
        assert_eq!(blocks, [64 << 4 | 0b0110, 67 << 4 | 0b1001, 127 << 4 | 0b1000]);
    }

    #[test]
    fn splitting_ends_at_pixels_and_loses_none() {
        let coverage = coverage();
        let mut work = vec![coverage.tiles()];
        let mut pixels = Vec::new();
        while let Some(batch) = work.pop() {
            let parts = coverage.split(&batch);
            if parts.is_empty() {
                assert!(batch.iter().all(|r| r.level() == 0));
                pixels.extend(batch.iter().map(|r| r.index()));
            }
            work.extend(parts);
        }
        pixels.sort_unstable();
        assert_eq!(pixels, coverage.pixels(Receiver::new(4, 1)).collect::<Vec<_>>());
    }
}
