//! Flags and counters of the loop that several threads read.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crossbeam_utils::CachePadded;

/// Samples that ingress refused because their stamps are in the future, which indicates another clock.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Refused {
    /// Suit samples.
    pub suit: u64,
    /// Ground samples.
    pub ground: u64,
    /// How far in the future the last one was.
    pub ahead_ns: u64,
}

/// Stop request, state and counters of the loop.
///
/// Grouped by the thread that writes them, one cache line each: under `loop.busy_poll` other threads read `stop`
/// all the time, and would otherwise take the line of the loop's counter from it in every cycle.
#[derive(Debug, Default)]
pub struct LoopControl {
    /// Rarely written.
    run: CachePadded<RunFlags>,
    /// Written by the loop in every cycle.
    last_cycle: CachePadded<AtomicU64>,
    /// Written by ingress.
    rejected: CachePadded<RejectedInput>,
}

#[derive(Debug, Default)]
struct RunFlags {
    stop: AtomicBool,
    loop_running: AtomicBool,
}

#[derive(Debug, Default)]
struct RejectedInput {
    dropped: AtomicU64,
    refused_suit: AtomicU64,
    refused_ground: AtomicU64,
    ahead_ns: AtomicU64,
}

impl LoopControl {
    /// Requests all threads to end.
    pub fn stop(&self) {
        self.run.stop.store(true, Ordering::Relaxed);
    }

    /// Whether a stop was requested.
    pub fn is_stopping(&self) -> bool {
        self.run.stop.load(Ordering::Relaxed)
    }

    /// Marks the loop as running until the returned value is dropped, also by a panic; egress runs until then.
    pub fn mark_loop_running(&self) -> impl Drop + use<'_> {
        struct RunningGuard<'a>(&'a AtomicBool);
        impl Drop for RunningGuard<'_> {
            fn drop(&mut self) {
                self.0.store(false, Ordering::Release);
            }
        }
        self.run.loop_running.store(true, Ordering::Release);
        RunningGuard(&self.run.loop_running)
    }

    /// Whether the loop will produce no more outcomes: a stop was requested, and the loop has ended or never started.
    pub fn has_ended(&self) -> bool {
        self.is_stopping() && !self.run.loop_running.load(Ordering::Acquire)
    }

    /// Number of the newest cycle.
    pub fn last_cycle(&self) -> u64 {
        self.last_cycle.load(Ordering::Relaxed)
    }

    pub(super) fn set_last_cycle(&self, cycle: u64) {
        self.last_cycle.store(cycle, Ordering::Relaxed);
    }

    /// Number of input samples rejected by a full ring.
    pub fn input_dropped(&self) -> u64 {
        self.rejected.dropped.load(Ordering::Relaxed)
    }

    pub(super) fn count_dropped_input(&self) {
        self.rejected.dropped.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a suit sample that is withheld from the loop because its stamps are in the future.
    pub fn refuse_suit(&self, ahead_ns: u64) {
        self.refuse(&self.rejected.refused_suit, ahead_ns);
    }

    /// Counts such a ground sample.
    pub fn refuse_ground(&self, ahead_ns: u64) {
        self.refuse(&self.rejected.refused_ground, ahead_ns);
    }

    fn refuse(&self, stream: &AtomicU64, ahead_ns: u64) {
        stream.fetch_add(1, Ordering::Relaxed);
        self.rejected.ahead_ns.store(ahead_ns, Ordering::Relaxed);
    }

    /// Samples refused before the loop, since the start.
    pub fn refused(&self) -> Refused {
        Refused {
            suit: self.rejected.refused_suit.load(Ordering::Relaxed),
            ground: self.rejected.refused_ground.load(Ordering::Relaxed),
            ahead_ns: self.rejected.ahead_ns.load(Ordering::Relaxed),
        }
    }
}
