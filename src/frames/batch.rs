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
