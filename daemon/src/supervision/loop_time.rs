//! Monitors the progress of the loop: slots skipped at once, and whether it has stopped.

use std::fmt;

use equipoise_core::message::CycleRecord;
use equipoise_core::time::seconds;

/// Minimum length of a reported stall: both streams are stale by then, and a controller is affected.
pub(super) const STALL_NS: u64 = 50_000_000;
/// Time without a cycle after which the loop counts as stopped. Longer than any stall that ends by itself on a busy
/// machine, shorter than the watchdog's five seconds.
const HANG_AFTER_NS: u64 = 1_000_000_000;

/// The longest stall between two consecutive cycles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stall {
    /// The first cycle after it.
    pub(super) cycle: u64,
    /// Number of slots skipped.
    pub(super) slots: u64,
    /// Duration of these slots.
    pub(super) span_ns: u64,
}

impl fmt::Display for Stall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "the loop stood still for {:.0} ms before cycle {} ({} slots skipped): the machine was busy, stopped or \
             throttled; see `equipoise doctor`",
            1e3 * seconds(self.span_ns),
            self.cycle,
            self.slots
        )
    }
}

/// Evaluates the cycle records.
#[derive(Debug, Default)]
pub(super) struct LoopTime {
    /// Number of the last cycle, and the slots skipped until then.
    last: Option<(u64, u64)>,
    stall: Option<Stall>,
    quiet_ns: u64,
}

impl LoopTime {
    /// Ingests one record, in the order of the cycles. Stalls next to lost records are not detected.
    pub(super) fn ingest(&mut self, record: &CycleRecord) {
        let before = self.last.replace((record.cycle, record.slots_skipped));
        let Some((cycle, slots_skipped)) = before else { return };
        if record.cycle != cycle + 1 {
            return;
        }
        let slots = record.slots_skipped.saturating_sub(slots_skipped);
        let stall = Stall { cycle: record.cycle, slots, span_ns: slots * record.period_ns };
        if stall.span_ns >= STALL_NS && self.stall.is_none_or(|longest| longest.span_ns < stall.span_ns) {
            self.stall = Some(stall);
        }
    }

    /// The longest stall since the last call.
    pub(super) fn take_stall(&mut self) -> Option<Stall> {
        self.stall.take()
    }

    /// Whether there has been no cycle for too long; `gap_ns` is the time since the last call.
    pub(super) fn is_hanging(&mut self, has_records: bool, gap_ns: u64) -> bool {
        self.quiet_ns = if has_records { 0 } else { self.quiet_ns + gap_ns };
        self.quiet_ns >= HANG_AFTER_NS
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn record(cycle: u64, slots_skipped: u64) -> CycleRecord {
        CycleRecord { cycle, slots_skipped, period_ns: 1_000_000, ..CycleRecord::zeroed() }
    }

    #[test]
    fn only_slots_skipped_together_are_a_stall() {
        let mut time = LoopTime::default();
        // One skipped slot in each of a hundred cycles is lateness, not a stall.
        for cycle in 1..=100 {
            time.ingest(&record(cycle, cycle));
        }
        assert_eq!(time.take_stall(), None);
        time.ingest(&record(101, 149));
        assert_eq!(time.take_stall(), None, "49 ms");
        time.ingest(&record(102, 199));
        assert_eq!(time.take_stall(), Some(Stall { cycle: 102, slots: 50, span_ns: 50_000_000 }));
        assert_eq!(time.take_stall(), None, "reported once");
        time.ingest(&record(500, 999));
        assert_eq!(time.take_stall(), None, "cycles between them were not seen");
    }

    #[test]
    fn a_loop_that_hangs_is_reported_after_a_second() {
        let mut time = LoopTime::default();
        assert!(!time.is_hanging(true, 50_000_000));
        let updates = (0..100).take_while(|_| !time.is_hanging(false, 50_000_000)).count();
        assert_eq!(updates, 19);
        assert!(!time.is_hanging(true, 50_000_000));
    }
}
