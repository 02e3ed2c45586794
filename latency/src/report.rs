//! Percentiles of every stage, for people (a table) and for programs (serde).

use core::fmt;
use std::borrow::Cow;

use hdrhistogram::Histogram;
use serde::Serialize;

use crate::histograms::{HIGHEST_NS, PathHistograms};
use crate::receipt::{ConsumerTimes, RECEIPT_STAGES};
use crate::stage::Stage;

/// Percentiles of one stage, ns. All 0 where `count` is 0.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct StageReport {
    /// The stage's public name; that of a consumer's stage begins with the consumer's.
    pub stage: Cow<'static, str>,
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

/// What one consumer showed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ConsumerReport {
    /// Its name.
    pub consumer: String,
    /// Its process.
    pub process_id: u32,
    /// States picked up.
    pub states: u64,
    /// States that it never saw.
    pub states_missed: u64,
    /// `CONSUMER.receipt`, `.from_due` and `.from_suit`.
    pub stages: Vec<StageReport>,
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
    /// The end of the path: every consumer that reports, by name.
    pub consumers: Vec<ConsumerReport>,
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
            consumers: Vec::new(),
        }
    }

    /// The same with what consumers saw.
    pub fn with_consumers(mut self, consumers: &[ConsumerTimes]) -> Report {
        self.consumers = consumers.iter().map(consumer_report).collect();
        self
    }

    /// The row of one stage.
    pub fn stage(&self, stage: Stage) -> &StageReport {
        &self.stages[stage.index()]
    }
}

fn consumer_report(consumer: &ConsumerTimes) -> ConsumerReport {
    let row = |((name, definition), times_ns)| {
        let stage = format!("{}.{name}", consumer.name);
        StageReport { stage: stage.into(), definition, ..percentiles(times_ns) }
    };
    ConsumerReport {
        consumer: consumer.name.clone(),
        process_id: consumer.process_id,
        states: consumer.states,
        states_missed: consumer.states_missed,
        stages: RECEIPT_STAGES.into_iter().zip(&consumer.times_ns).map(row).collect(),
    }
}

fn stage_report(histograms: &PathHistograms, stage: Stage) -> StageReport {
    let histogram = histograms.stage(stage);
    StageReport {
        stage: stage.name().into(),
        definition: stage.definition(),
        missing: histogram.missing,
        reversed: histogram.reversed,
        ..percentiles(&histogram.times_ns)
    }
}

fn percentiles(times_ns: &Histogram<u64>) -> StageReport {
    // hdrhistogram returns the highest value of the bucket, which may exceed the bound.
    let at = |quantile: f64| times_ns.value_at_quantile(quantile).min(HIGHEST_NS);
    StageReport {
        stage: "".into(),
        definition: "",
        count: times_ns.len(),
        missing: 0,
        reversed: 0,
        p50_ns: at(0.50),
        p90_ns: at(0.90),
        p99_ns: at(0.99),
        p99_9_ns: at(0.999),
        p99_99_ns: at(0.9999),
        max_ns: times_ns.max().min(HIGHEST_NS),
    }
}

/// A table in microseconds; a stage that never applied is left out.
impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let consumers = self.consumers.iter().flat_map(|consumer| &consumer.stages);
        let rows = || self.stages.iter().chain(consumers.clone()).filter(|row| row.applied());
        let width = rows().map(|row| row.stage.len()).max().unwrap_or(0).max(17);
        writeln!(
            f,
            "{:<width$} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10}",
            "stage (µs)", "p50", "p90", "p99", "p99.9", "p99.99", "max", "count"
        )?;
        for row in rows() {
            row.write(f, width)?;
        }
        writeln!(
            f,
            "{} cycles seen, {} not seen; {} periods skipped, {} deadlines missed",
            self.cycles, self.cycles_lost, self.slots_skipped, self.deadlines_missed
        )?;
        for consumer in &self.consumers {
            writeln!(
                f,
                "{} (process {}): {} states picked up, {} missed",
                consumer.consumer, consumer.process_id, consumer.states, consumer.states_missed
            )?;
        }
        Ok(())
    }
}

impl StageReport {
    fn applied(&self) -> bool {
        self.count + self.missing + self.reversed > 0
    }

    fn write(&self, f: &mut fmt::Formatter<'_>, width: usize) -> fmt::Result {
        write!(f, "{:<width$}", self.stage)?;
        for ns in [self.p50_ns, self.p90_ns, self.p99_ns, self.p99_9_ns, self.p99_99_ns, self.max_ns] {
            write!(f, " {:>10.1}", ns as f64 * 1e-3)?;
        }
        write!(f, " {:>10}", self.count)?;
        if self.missing > 0 {
            write!(f, "  ({} without a stamp)", self.missing)?;
        }
        if self.reversed > 0 {
            write!(f, "  ({} reversed)", self.reversed)?;
        }
        writeln!(f)
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
