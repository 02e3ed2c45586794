//! Percentiles of every stage, for people (a table) and for programs (serde).

use core::fmt;

use serde::Serialize;

use crate::histograms::{HIGHEST_NS, PathHistograms};
use crate::stage::Stage;

/// Percentiles of one stage, ns. All 0 where `count` is 0.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct StageReport {
    /// The stage's public name.
    pub stage: &'static str,
    /// Its two stamps in words.
    pub definition: &'static str,
    /// Values recorded, those of skipped periods included.
    pub count: u64,
    /// Cycles that lacked a stamp.
    pub missing: u64,
    /// Cycles whose stage ended before it began.
    pub reversed: u64,
    /// Median.
    pub p50_ns: u64,
    /// 90th percentile.
    pub p90_ns: u64,
    /// 99th percentile.
    pub p99_ns: u64,
    /// 99.9th percentile.
    pub p99_9_ns: u64,
    /// 99.99th percentile.
    pub p99_99_ns: u64,
    /// Maximum; 10 s stands for 10 s and more.
    pub max_ns: u64,
}

/// What a run or an interval showed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Report {
    /// Cycle records seen.
    pub cycles: u64,
    /// Cycle records that never came.
    pub cycles_lost: u64,
    /// Periods the loop dropped whole.
    pub slots_skipped: u64,
    /// Cycles ready only after the next was due.
    pub deadlines_missed: u64,
    /// One row per stage, in the order of the path.
    pub stages: Vec<StageReport>,
}

impl Report {
    /// Reads the percentiles off.
    pub fn of(histograms: &PathHistograms) -> Report {
        let counts = histograms.counts();
        Report {
            cycles: counts.cycles,
            cycles_lost: counts.cycles_lost,
            slots_skipped: counts.slots_skipped,
            deadlines_missed: counts.deadlines_missed,
            stages: Stage::ALL.into_iter().map(|stage| stage_report(histograms, stage)).collect(),
        }
    }

    /// The row of one stage.
    pub fn stage(&self, stage: Stage) -> &StageReport {
        &self.stages[stage.index()]
    }
}

fn stage_report(histograms: &PathHistograms, stage: Stage) -> StageReport {
    let histogram = histograms.stage(stage);
    // hdrhistogram answers with the highest value of the bucket, which may lie above the bound.
    let at = |quantile: f64| histogram.times_ns.value_at_quantile(quantile).min(HIGHEST_NS);
    StageReport {
        stage: stage.name(),
        definition: stage.definition(),
        count: histogram.times_ns.len(),
        missing: histogram.missing,
        reversed: histogram.reversed,
        p50_ns: at(0.50),
        p90_ns: at(0.90),
        p99_ns: at(0.99),
        p99_9_ns: at(0.999),
        p99_99_ns: at(0.9999),
        max_ns: histogram.times_ns.max().min(HIGHEST_NS),
    }
}

/// A table in microseconds; a stage that never applied is left out.
impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<17} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10}",
            "stage (µs)", "p50", "p90", "p99", "p99.9", "p99.99", "max", "count"
        )?;
        for row in self.stages.iter().filter(|row| row.count + row.missing + row.reversed > 0) {
            write!(f, "{:<17}", row.stage)?;
            for ns in [row.p50_ns, row.p90_ns, row.p99_ns, row.p99_9_ns, row.p99_99_ns, row.max_ns] {
                write!(f, " {:>10.1}", ns as f64 * 1e-3)?;
            }
            write!(f, " {:>10}", row.count)?;
            if row.missing > 0 {
                write!(f, "  ({} without a stamp)", row.missing)?;
            }
            if row.reversed > 0 {
                write!(f, "  ({} reversed)", row.reversed)?;
            }
            writeln!(f)?;
        }
        writeln!(
            f,
            "{} cycles seen, {} not seen; {} periods skipped, {} deadlines missed",
            self.cycles, self.cycles_lost, self.slots_skipped, self.deadlines_missed
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::message::CycleRecord;

    #[test]
    fn the_table_shows_what_was_recorded_and_no_empty_rows() {
        let mut histograms = PathHistograms::new();
        for cycle in 1..=1_000 {
            let due_ns = cycle * 1_000_000;
            let woken_ns = due_ns + cycle * 1_000;
            histograms.record(&CycleRecord { cycle, due_ns, woken_ns, ..Zeroable::zeroed() });
        }
        let report = Report::of(&histograms);
        let wake = report.stage(Stage::LoopWake);
        let within = |ns: u64, expected: u64| ns.abs_diff(expected) * 1_000 <= expected;
        assert!(within(wake.p50_ns, 500_000) && within(wake.p99_ns, 990_000), "{wake:?}");
        assert!(within(wake.max_ns, 1_000_000) && wake.count == 1_000);
        let table = report.to_string();
        assert!(table.contains("loop.wake") && !table.contains("suit.wait"), "{table}");
        assert!(table.contains("1000 without a stamp"), "{table}");
    }
}
