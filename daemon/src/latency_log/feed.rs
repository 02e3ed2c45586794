//! Ring of fixed size from egress to the latency log: egress never waits, allocates or makes a system call.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use rtrb::{Consumer, Producer, RingBuffer};

use crate::rings::Outcome;

/// One second of cycles at 1 kHz: the longest tolerable stall of the disk.
pub const CAPACITY: usize = 1024;

/// Egress's end; dropping it closes the ring.
#[derive(Debug)]
pub struct Feed {
    outcomes: Producer<Outcome>,
    dropped: Arc<AtomicU64>,
}

/// The latency log's end.
#[derive(Debug)]
pub struct Drain {
    outcomes: Consumer<Outcome>,
    dropped: Arc<AtomicU64>,
}

/// Creates both ends of a ring.
pub fn feed(slots: usize) -> (Feed, Drain) {
    let (producer, consumer) = RingBuffer::new(slots);
    let dropped = Arc::new(AtomicU64::new(0));
    (Feed { outcomes: producer, dropped: Arc::clone(&dropped) }, Drain { outcomes: consumer, dropped })
}

impl Feed {
    /// Passes an outcome on. A full ring keeps its content, since a gap at the end can be detected by cycle number; the
    /// outcome is counted as dropped.
    pub fn push(&mut self, outcome: Outcome) {
        if self.outcomes.push(outcome).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl Drain {
    /// The oldest outcome in the ring.
    pub fn pop(&mut self) -> Option<Outcome> {
        self.outcomes.pop().ok()
    }

    /// Outcomes dropped because the ring was full, since the start.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Whether no outcome will follow those in the ring.
    pub fn is_closed(&self) -> bool {
        self.outcomes.is_abandoned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::message::{CycleRecord, State};

    #[test]
    fn a_full_ring_drops_counts_and_keeps_the_order_of_the_rest() {
        let (mut feed, mut drain) = feed(4);
        for cycle in 1..=10 {
            feed.push(Outcome {
                state: State::zeroed(),
                record: CycleRecord { cycle, ..CycleRecord::zeroed() },
            });
        }
        assert_eq!(drain.dropped(), 6);
        assert!(!drain.is_closed());
        drop(feed);
        assert!(drain.is_closed());
        let remaining: Vec<u64> =
            std::iter::from_fn(|| drain.pop()).map(|outcome| outcome.record.cycle).collect();
        assert_eq!(remaining, [1, 2, 3, 4]);
    }
}
