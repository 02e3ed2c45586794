//! The stored blocks: all of a short recording, an evenly decimated subset of a long one.

use super::options::Options;
use crate::block::{Block, Phase};

/// Blocks of all phases.
#[derive(Debug)]
pub(super) struct Store {
    phases: [PhaseStore; 3],
}

/// One phase's blocks: every `stride`-th of the completed ones.
#[derive(Debug)]
struct PhaseStore {
    blocks: Vec<Block>,
    max: usize,
    stride: usize,
    completed: usize,
}

impl Store {
    /// Each phase has its own quota, so that hours of work do not displace the poses: one quarter for poses, one
    /// quarter for the reference if there is one, the rest for work.
    pub(super) fn new(options: &Options) -> Store {
        let quarter = options.blocks_max / 4;
        let work = if options.spans_s.reference.is_some() { 2 * quarter } else { 3 * quarter };
        Store { phases: [quarter, quarter, work].map(PhaseStore::new) }
    }

    fn phase(&mut self, phase: Phase) -> &mut PhaseStore {
        let [identify, reference, work] = &mut self.phases;
        match phase {
            Phase::Identify => identify,
            Phase::Reference => reference,
            Phase::Work => work,
        }
    }

    /// Counts a completed block of a phase; returns whether it is to be stored.
    pub(super) fn accepts(&mut self, phase: Phase) -> bool {
        let store = self.phase(phase);
        store.completed += 1;
        (store.completed - 1).is_multiple_of(store.stride)
    }

    /// Stores a block for which `accepts` returned true.
    pub(super) fn push(&mut self, block: Block) {
        self.phase(block.phase).push(block);
    }

    /// All stored blocks, by time.
    pub(super) fn into_blocks(self) -> Vec<Block> {
        let mut blocks: Vec<Block> = self.phases.into_iter().flat_map(|store| store.blocks).collect();
        blocks.sort_by(|a, b| a.observation.time_s.total_cmp(&b.observation.time_s));
        blocks
    }
}

impl PhaseStore {
    fn new(max: usize) -> PhaseStore {
        PhaseStore { blocks: Vec::new(), max: max.max(2), stride: 1, completed: 0 }
    }

    fn push(&mut self, block: Block) {
        if self.blocks.len() >= self.max {
            // Decimate by two: drop every second block, and accept only every second new one.
            let mut keep = false;
            self.blocks.retain(|_| {
                keep = !keep;
                keep
            });
            self.stride *= 2;
        }
        self.blocks.push(block);
    }
}
