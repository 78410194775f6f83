//! Classic: every pixel walks the hierarchy alone.

use std::sync::Arc;

use super::renderer::{Batch, Outcome, Region};
use super::{FrameStats, Settings};
use crate::Result;
use crate::gpu::{Buffer, Context, Recorder};
use crate::passes::classic::{ClassicCounts, ClassicPass};
use crate::passes::{GpuHierarchy, Traversal};

/// The technique's passes and buffers.
pub(super) struct Classic {
    context: Arc<Context>,
    walk: ClassicPass,
    /// Nodes that all lists of a batch hold.
    capacity: u32,
    /// Nodes that one pixel's list holds; grows when a pixel wants more.
    list: u32,
}

/// Bytes that one node of capacity costs.
pub(super) const BYTES_PER_NODE: u64 = 4;

impl Classic {
    pub(super) fn new(context: &Arc<Context>, settings: &Settings, capacity: u32) -> Result<Self> {
        // A pixel's cut has about two nodes a micro-pixel.
        let list = (3 * settings.microbuffer * settings.microbuffer).min(capacity);
        Ok(Self { context: context.clone(), walk: ClassicPass::new(context, settings.paper)?, capacity, list })
    }

    /// Pixels of the next batch.
    pub(super) fn batch_pixels(&self) -> usize {
        (self.capacity / self.list).max(1) as usize
    }

    /// The passes of a batch, in order.
    pub(super) fn cut(
        &mut self,
        hierarchy: &GpuHierarchy,
        region: &Region,
        batch: &Batch,
        constants: Traversal,
        stats: &mut FrameStats,
    ) -> Result<Outcome> {
        let entries = &batch.entries;
        let zero = ClassicCounts { entries: entries.len() as u32, ..ClassicCounts::default() };
        let counts = Buffer::from_slice(&self.context, "classic counts", &[zero])?;
        let constants = Traversal { capacity: self.list, ..constants };

        let mut recorder = Recorder::new(&self.context)?;
        // No receiver has a list yet.
        region.lists.clear(&mut recorder);
        // Every pixel walks the hierarchy and writes its own list.
        let set = self.walk.record(
            &mut recorder,
            region.receivers.bindings(hierarchy.bindings()),
            &region.lists,
            (&batch.entry_buffer, zero.entries),
            &counts,
            constants,
        )?;
        recorder.finish(&mut stats.profile)?;
        drop(set);

        let counts = counts.download::<ClassicCounts>(1)?[0];
        if counts.longest > self.list {
            let wanted = counts.longest.next_power_of_two();
            if counts.longest > self.capacity {
                return Ok(Outcome::TooSmall { needed: u64::from(counts.longest), capacity: self.capacity });
            }
            self.list = wanted.min(self.capacity);
            return Ok(Outcome::Overflowed);
        }
        stats.visited_pairs += u64::from(counts.visited);
        stats.profile.count("traverse (classic)", "visited_nodes", u64::from(counts.visited));
        stats.profile.count("traverse (classic)", "pairs_out", u64::from(counts.cut));
        Ok(Outcome::Done)
    }
}
