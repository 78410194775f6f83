//! Mipmapped and hybrid: pairs go through the geometry shader and transform feedback.

use std::sync::Arc;

use super::FrameStats;
use super::region::Region;
use super::renderer::Outcome;
use super::tile_map::FINEST;
use crate::Result;
use crate::gpu::{Context, Recorder};
use crate::passes::bin::{BatchCounters, BinPass, PreparePass};
use crate::passes::refine::RefinePass;
use crate::passes::traverse::{FeedbackBuffers, PAIR_BYTES, TraversePass};
use crate::passes::{CutRules, GpuHierarchy, Receiver, Traversal};

/// The passes and buffers of both techniques.
pub(super) struct Feedback {
    context: Arc<Context>,
    traverse: TraversePass,
    prepare: PreparePass,
    refinement: Option<Refinement>,
    bin: BinPass,
    buffers: FeedbackBuffers,
    counters: BatchCounters,
    iterations: u32,
    /// Pairs of the cut that a tile has had so far, for sizing batches: most, rounded up.
    pairs_per_tile: f64,
    /// Technique `shared`: tiles have lists of a fixed size.
    lists: Option<TileLists>,
}

/// Lists of tiles.
struct TileLists {
    /// Nodes in all of them.
    nodes: u32,
    /// Nodes in one.
    capacity: u32,
}

/// What hybrid has beside.
struct Refinement {
    pass: RefinePass,
    prepare: PreparePass,
}

/// Nodes in a tile's list, at first.
const FIRST_LIST: u32 = 4096;

/// Bytes that one pair of capacity costs: ping, pong, done, the sorted nodes, and hybrid's cut.
pub(super) fn bytes_per_pair(hybrid: bool) -> u64 {
    3 * PAIR_BYTES + 4 + if hybrid { PAIR_BYTES } else { 0 }
}

impl Feedback {
    pub(super) fn new(
        context: &Arc<Context>,
        hybrid: bool,
        rules: CutRules,
        hierarchy: &GpuHierarchy,
        capacity: u32,
    ) -> Result<Self> {
        let iterations = TraversePass::iterations(hierarchy);
        let refinement = hybrid
            .then(|| -> Result<Refinement> {
                Ok(Refinement {
                    pass: RefinePass::new(context, rules, if rules.shared { 1 } else { capacity })?,
                    prepare: PreparePass::new(context, hybrid, false)?,
                })
            })
            .transpose()?;
        Ok(Self {
            context: context.clone(),
            traverse: TraversePass::new(context, hybrid, rules)?,
            prepare: PreparePass::new(context, hybrid, true)?,
            refinement,
            bin: BinPass::new(context)?,
            buffers: FeedbackBuffers::new(context, capacity, iterations)?,
            counters: BatchCounters::new(context)?,
            iterations,
            pairs_per_tile: if rules.shared { 500.0 } else { 12_000.0 },
            lists: None,
        })
    }

    /// With lists for tiles, `nodes` in all.
    pub(super) fn with_lists(mut self, nodes: u32) -> Self {
        self.lists = Some(TileLists { nodes, capacity: FIRST_LIST.min(nodes) });
        self
    }

    /// Tiles of the next batch.
    pub(super) fn batch_tiles(&self) -> usize {
        let lists = self.lists.as_ref().map_or(usize::MAX, |lists| (lists.nodes / lists.capacity) as usize);
        ((f64::from(self.buffers.capacity) / (1.3 * self.pairs_per_tile)).max(1.0) as usize).min(lists)
    }

    /// The passes of a batch, in order.
    pub(super) fn cut(
        &mut self,
        hierarchy: &GpuHierarchy,
        region: &Region,
        receivers: &[Receiver],
        constants: Traversal,
        stats: &mut FrameStats,
    ) -> Result<Outcome> {
        let list_capacity = self.lists.as_ref().map_or(0, |lists| lists.capacity);
        let constants = Traversal { capacity: self.buffers.capacity, list_capacity, ..constants };
        let bindings = region.lists.bindings(region.receivers.bindings(hierarchy.bindings()));
        let BatchCounters { counts, arguments } = &self.counters;
        let done_counter = &self.buffers.done_counter;

        let mut recorder = Recorder::new(&self.context)?;
        // No receiver has a list yet, or empty ones, nothing is counted.
        match self.lists {
            None => region.lists.clear(&mut recorder),
            Some(_) => region.lists.reserve(Receiver::new(FINEST, 0), receivers, constants.pixels, list_capacity)?,
        }
        self.counters.clear(&mut recorder);
        // Pairs go round until none is left; those that are done come out of the second stream.
        let queries =
            self.traverse.record(&mut recorder, &self.buffers, &bindings, receivers, constants, self.iterations)?;
        let mut sets = vec![self.prepare.record(&mut recorder, done_counter, counts, arguments, constants)?];
        let mut cut = &self.buffers.done;
        if let Some(Refinement { pass, prepare }) = &self.refinement {
            // Hybrid: what came out is refined depth first.
            sets.push(pass.record(&mut recorder, bindings, &self.buffers.done, counts, arguments, constants)?);
            sets.push(prepare.record(&mut recorder, done_counter, counts, arguments, constants)?);
            cut = &pass.cut;
        }
        if self.lists.is_none() {
            // Every receiver's nodes side by side.
            sets.extend(self.bin.record(&mut recorder, cut, &region.lists, counts, arguments, constants)?);
        }
        recorder.finish(&mut stats.profile)?;
        drop(sets);

        let traversed = queries.read()?;
        let counted = self.counters.read()?;
        let full = match &mut self.lists {
            None => counted.cut > self.buffers.capacity,
            Some(lists) => {
                let full = counted.placed > lists.capacity;
                if full {
                    lists.capacity = counted.placed.next_power_of_two().min(lists.nodes);
                }
                full
            }
        };
        if traversed.overflowed || full {
            return Ok(Outcome::Overflowed);
        }
        if receivers.iter().all(|r| r.level() == Receiver::TILE_LEVEL) {
            let cut = if self.lists.is_some() { 0 } else { counted.cut };
            let most = u64::from(cut).max(traversed.pairs_done).max(traversed.peak_pairs) as f64;
            self.pairs_per_tile = most / receivers.len() as f64 + 1.0;
        }
        stats.visited_pairs += traversed.pairs_in + u64::from(counted.visited);
        let iterations = stats.pairs_by_iteration.len().max(traversed.by_iteration.len());
        stats.pairs_by_iteration.resize(iterations, 0);
        for (sum, pairs) in stats.pairs_by_iteration.iter_mut().zip(&traversed.by_iteration) {
            *sum += pairs;
        }
        let mut count = |pass, counts: &[_]| self.context.count(&mut stats.profile, pass, counts);
        count(self.traverse.name, &[("pairs_in", traversed.pairs_in), ("pairs_out", traversed.pairs_done)]);
        if self.refinement.is_some() {
            let [handed, visited, cut] = [counted.handed, counted.visited, counted.cut].map(u64::from);
            count("refine", &[("pairs_in", handed), ("visited_pairs", visited), ("pairs_out", cut)]);
        }
        if self.lists.is_none() {
            count("bin", &[("pairs_in", u64::from(counted.cut))]);
        }
        stats.peak_feedback_bytes =
            stats.peak_feedback_bytes.max((2 * traversed.peak_pairs + traversed.pairs_done) * PAIR_BYTES);
        Ok(Outcome::Done)
    }
}
