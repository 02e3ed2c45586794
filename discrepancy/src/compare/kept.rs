//! The stored blocks: all of a short recording, an evenly decimated subset of a long one.

use super::options::Options;
use crate::block::{Block, Phase};

/// Blocks of all phases.
#[derive(Debug)]
pub(super) struct Kept {
    phases: [Share; 3],
}

/// One phase's blocks: every `stride`-th of the completed ones.
#[derive(Debug)]
struct Share {
    blocks: Vec<Block>,
    most: usize,
    stride: usize,
    shown: usize,
}

impl Kept {
    /// Each phase has its own quota, so that hours of work do not displace the poses: one quarter for poses, one
    /// quarter for the reference if there is one, the rest for work.
    pub(super) fn new(options: &Options) -> Kept {
        let quarter = options.blocks_max / 4;
        let work = if options.spans_s.reference.is_some() { 2 * quarter } else { 3 * quarter };
        Kept { phases: [quarter, quarter, work].map(Share::new) }
    }

    fn share(&mut self, phase: Phase) -> &mut Share {
        let [identify, reference, work] = &mut self.phases;
        match phase {
            Phase::Identify => identify,
            Phase::Reference => reference,
            Phase::Work => work,
        }
    }

    /// Counts a block of a phase; returns whether it is to be stored.
    pub(super) fn wants(&mut self, phase: Phase) -> bool {
        let share = self.share(phase);
        share.shown += 1;
        (share.shown - 1).is_multiple_of(share.stride)
    }

    /// Stores a block for which `wants` returned true.
    pub(super) fn push(&mut self, block: Block) {
        self.share(block.phase).push(block);
    }

    /// All stored blocks, by time.
    pub(super) fn into_blocks(self) -> Vec<Block> {
        let mut blocks: Vec<Block> = self.phases.into_iter().flat_map(|share| share.blocks).collect();
        blocks.sort_by(|a, b| a.observation.time_s.total_cmp(&b.observation.time_s));
        blocks
    }
}

impl Share {
    fn new(most: usize) -> Share {
        Share { blocks: Vec::new(), most: most.max(2), stride: 1, shown: 0 }
    }

    fn push(&mut self, block: Block) {
        if self.blocks.len() >= self.most {
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
