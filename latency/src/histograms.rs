//! One fixed-bound histogram per stage; nothing allocates after construction.

use equipoise_core::message::CycleRecord;
use hdrhistogram::Histogram;

use crate::stage::{NotRecorded, Stage};

/// Smallest value distinguished from zero, ns.
pub const LOWEST_NS: u64 = 1;
/// Largest value, ns; longer times are recorded as this value.
pub const HIGHEST_NS: u64 = 10_000_000_000;
/// Significant decimal digits of every recorded value.
pub const DIGITS: u8 = 3;

/// Times of one stage, and the number of cycles that lack a value.
#[derive(Debug, Clone)]
pub struct StageHistogram {
    /// Times, ns.
    pub times_ns: Histogram<u64>,
    /// Cycles without one of the two stamps.
    pub missing: u64,
    /// Cycles whose stage ended before it began.
    pub reversed: u64,
}

/// Counts of the cycles themselves.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CycleCounts {
    /// Cycle records received.
    pub cycles: u64,
    /// Cycle records lost, from the gaps in `CycleRecord::cycle`.
    pub cycles_lost: u64,
    /// Slots that the loop skipped during the interval.
    pub slots_skipped: u64,
    /// Skipped slots that lie in a gap of the records, so that their lateness is unavailable.
    pub slots_skipped_unplaced: u64,
    /// Cycles that finished after the next one was due.
    pub deadlines_missed: u64,
}

/// Histograms of every stage over one interval or one run. About 200 KiB per stage, allocated at construction.
#[derive(Debug, Clone)]
pub struct PathHistograms {
    stages: [StageHistogram; Stage::COUNT],
    counts: CycleCounts,
    last: Option<Last>,
}

/// Values of the previous record from which gaps and skipped slots are computed.
#[derive(Debug, Clone, Copy)]
struct Last {
    cycle: u64,
    slots_skipped: u64,
}

impl Default for PathHistograms {
    fn default() -> Self {
        Self::new()
    }
}

impl PathHistograms {
    /// Empty histograms, 1 ns to 10 s with 3 digits.
    pub fn new() -> Self {
        let stages = core::array::from_fn(|_| StageHistogram {
            times_ns: Histogram::new_with_bounds(LOWEST_NS, HIGHEST_NS, DIGITS)
                .expect("the bounds are constants that hdrhistogram accepts"),
            missing: 0,
            reversed: 0,
        });
        PathHistograms { stages, counts: CycleCounts::default(), last: None }
    }

    /// Records one cycle. Never allocates; at most `10 s / period` steps.
    ///
    /// A late loop runs fewer cycles exactly when it is slow (coordinated omission). So every slot skipped before this
    /// cycle is recorded too, with the lateness it had when the loop resumed.
    pub fn record(&mut self, record: &CycleRecord) {
        self.counts.cycles += 1;
        self.counts.deadlines_missed += u64::from(record.deadline_missed != 0);
        let skipped = self.skipped_before(record);
        for stage in Stage::ALL {
            let histogram = &mut self.stages[stage.index()];
            match stage.time_ns(record) {
                None => {}
                Some(Err(NotRecorded::Missing)) => histogram.missing += 1,
                Some(Err(NotRecorded::Reversed)) => histogram.reversed += 1,
                Some(Ok(time_ns)) => {
                    histogram.times_ns.saturating_record(time_ns);
                    if stage.starts_when_due() {
                        record_skipped(&mut histogram.times_ns, time_ns, record.period_ns, skipped);
                    }
                }
            }
        }
    }

    /// Slots skipped between the previous record and this one; 0 if a gap in the records makes their position
    /// ambiguous.
    fn skipped_before(&mut self, record: &CycleRecord) -> u64 {
        let now = Last { cycle: record.cycle, slots_skipped: record.slots_skipped };
        let Some(last) = self.last.replace(now) else { return 0 };
        // A decrease means that the daemon restarted; its counts start at 0 again.
        if now.cycle <= last.cycle || now.slots_skipped < last.slots_skipped {
            return 0;
        }
        let skipped = now.slots_skipped - last.slots_skipped;
        let lost = now.cycle - last.cycle - 1;
        self.counts.slots_skipped += skipped;
        self.counts.cycles_lost += lost;
        if lost > 0 {
            self.counts.slots_skipped_unplaced += skipped;
            return 0;
        }
        skipped
    }

    /// The histogram of one stage.
    pub fn stage(&self, stage: Stage) -> &StageHistogram {
        &self.stages[stage.index()]
    }

    /// Counts of the cycles themselves.
    pub fn counts(&self) -> CycleCounts {
        self.counts
    }

    /// Clears all values except those needed to detect a gap across the interval's boundary. Does not allocate.
    pub fn start_interval(&mut self) {
        for stage in &mut self.stages {
            stage.times_ns.reset();
            (stage.missing, stage.reversed) = (0, 0);
        }
        self.counts = CycleCounts::default();
    }

    /// Adds an interval to a total. Does not allocate.
    pub fn add(&mut self, interval: &PathHistograms) {
        for (total, part) in self.stages.iter_mut().zip(&interval.stages) {
            let added = total.times_ns.add(&part.times_ns);
            debug_assert!(added.is_ok(), "all histograms have the same bounds");
            total.missing += part.missing;
            total.reversed += part.reversed;
        }
        let (total, part) = (&mut self.counts, &interval.counts);
        total.cycles += part.cycles;
        total.cycles_lost += part.cycles_lost;
        total.slots_skipped += part.slots_skipped;
        total.slots_skipped_unplaced += part.slots_skipped_unplaced;
        total.deadlines_missed += part.deadlines_missed;
    }
}

/// Records the `skipped` slots before a cycle: the n-th slot before it was due `n` periods earlier.
fn record_skipped(times_ns: &mut Histogram<u64>, time_ns: u64, period_ns: u64, skipped: u64) {
    if period_ns == 0 {
        return;
    }
    // Beyond this number every value saturates, so the rest is recorded in one call.
    let distinct = skipped.min(HIGHEST_NS / period_ns);
    for n in 1..=distinct {
        times_ns.saturating_record(time_ns.saturating_add(n.saturating_mul(period_ns)));
    }
    // Recording a value zero times would still make it the maximum.
    if skipped > distinct {
        times_ns.saturating_record_n(HIGHEST_NS, skipped - distinct);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn cycle(number: u64, slots_skipped: u64, lateness_ns: u64) -> CycleRecord {
        let due_ns = 1_000_000 * (number + slots_skipped);
        CycleRecord {
            cycle: number,
            due_ns,
            woken_ns: due_ns + lateness_ns,
            slots_skipped,
            period_ns: 1_000_000,
            ..Zeroable::zeroed()
        }
    }

    #[test]
    fn the_maximum_is_the_lateness_of_the_first_skipped_period() {
        let mut histograms = PathHistograms::new();
        histograms.record(&cycle(1, 0, 10_000));
        histograms.record(&cycle(2, 3, 20_000));
        let max_ns = histograms.stage(Stage::LoopWake).times_ns.max();
        assert!((3_020_000..3_030_000).contains(&max_ns), "{max_ns}");
    }

    #[test]
    fn a_stall_shows_in_the_percentiles_once_per_skipped_period() {
        let mut histograms = PathHistograms::new();
        for number in 1..=9_900 {
            histograms.record(&cycle(number, 0, 50_000));
        }
        histograms.record(&cycle(9_901, 100, 50_000));
        let wake = &histograms.stage(Stage::LoopWake).times_ns;
        assert_eq!(wake.len(), 9_901 + 100);
        let p999 = wake.value_at_quantile(0.999);
        assert!((89_000_000..=92_000_000).contains(&p999), "{p999}");
        assert_eq!(histograms.counts().slots_skipped, 100);
    }

    #[test]
    fn stages_without_stamps_are_counted_and_not_recorded() {
        let mut histograms = PathHistograms::new();
        histograms.record(&cycle(1, 0, 5));
        let compute = histograms.stage(Stage::LoopCompute);
        assert_eq!((compute.times_ns.len(), compute.missing, compute.reversed), (0, 1, 0));
        assert_eq!(histograms.stage(Stage::SuitWait).missing, 0, "no sample was taken, none is missing");
    }

    #[test]
    fn a_gap_or_a_restart_of_the_loop_invents_no_lateness() {
        let mut histograms = PathHistograms::new();
        histograms.record(&cycle(10, 0, 5));
        histograms.record(&cycle(20, 3, 5));
        histograms.record(&cycle(1, 0, 5));
        assert_eq!(histograms.stage(Stage::LoopWake).times_ns.len(), 3);
        let counts = histograms.counts();
        assert_eq!((counts.cycles_lost, counts.slots_skipped_unplaced), (9, 3));
    }

    #[test]
    fn absurd_stamps_neither_panic_nor_take_long() {
        let mut histograms = PathHistograms::new();
        histograms.record(&cycle(1, 0, 5));
        let absurd = CycleRecord {
            cycle: 2,
            due_ns: 1,
            woken_ns: u64::MAX,
            slots_skipped: u64::MAX,
            period_ns: 1_000_000,
            ..Zeroable::zeroed()
        };
        histograms.record(&absurd);
        assert!(histograms.stage(Stage::LoopWake).times_ns.max() >= HIGHEST_NS);
    }

    #[test]
    fn intervals_add_up_to_the_total() {
        let (mut total, mut interval) = (PathHistograms::new(), PathHistograms::new());
        for number in 1..=100 {
            interval.record(&cycle(number, number / 50, 1_000 * number));
            if number % 10 == 0 {
                total.add(&interval);
                interval.start_interval();
            }
        }
        assert_eq!(total.counts().cycles, 100);
        assert_eq!(total.counts().cycles_lost, 0);
        assert_eq!(total.stage(Stage::LoopWake).times_ns.len(), 102);
    }
}
