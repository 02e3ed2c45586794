//! Ring of fixed size from egress to the latency log: egress never waits, allocates or makes a system call.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crate::rings::{Outcome, Ring};

/// One second of cycles at 1 kHz: the longest tolerable stall of the disk.
pub const CAPACITY: usize = 1024;

#[derive(Debug)]
struct Shared {
    outcomes: Ring<Outcome>,
    dropped: AtomicU64,
    closed: AtomicBool,
}

/// Egress's end; dropping it closes the ring.
#[derive(Debug)]
pub struct Feed(Arc<Shared>);

/// The latency log's end.
#[derive(Debug)]
pub struct Drain(Arc<Shared>);

/// Creates both ends of a ring.
pub fn feed(slots: usize) -> (Feed, Drain) {
    let ring = Arc::new(Shared {
        outcomes: Ring::new(slots),
        dropped: AtomicU64::new(0),
        closed: AtomicBool::new(false),
    });
    (Feed(Arc::clone(&ring)), Drain(ring))
}

impl Feed {
    /// Passes an outcome on. A full ring keeps its content, since a gap at the end can be detected by cycle number; the
    /// outcome is counted as dropped.
    pub fn push(&self, outcome: Outcome) {
        if self.0.outcomes.push(outcome).is_err() {
            self.0.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.0.closed.store(true, Ordering::Release);
    }
}

impl Drain {
    /// The oldest outcome in the ring.
    pub fn pop(&self) -> Option<Outcome> {
        self.0.outcomes.pop()
    }

    /// Outcomes dropped because the ring was full, since the start.
    pub fn dropped(&self) -> u64 {
        self.0.dropped.load(Ordering::Relaxed)
    }

    /// Whether no outcome will follow those in the ring.
    pub fn is_closed(&self) -> bool {
        self.0.closed.load(Ordering::Acquire)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::message::{CycleRecord, State};

    #[test]
    fn a_full_ring_drops_counts_and_keeps_the_order_of_the_rest() {
        let (feed, drain) = feed(4);
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
