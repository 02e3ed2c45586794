//! Errors of held-out blocks for each method, and their table.

use std::fmt;

use crate::replay::output::seconds_since;
use crate::replay::score::{Pair, SampleSelection, Scored, difference, rms_mm};

/// One held-out block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// First and last suit sample time, ns; exclusive of the last.
    pub span_ns: [u64; 2],
    /// Number of quasi-static samples.
    pub samples: usize,
    /// Held poses and motion samples from which the model of the other blocks was identified.
    pub poses_used: u64,
    /// Error of the table alone, mm RMS x and y; `None` without samples.
    pub table_mm: Option<[f64; 2]>,
    /// Error of the table with the mean offset of the other blocks.
    pub offset_mm: Option<[f64; 2]>,
    /// Error of the model identified from the other blocks.
    pub identified_mm: Option<[f64; 2]>,
}

/// All blocks, and the total over their samples.
#[derive(Debug, Clone, PartialEq)]
pub struct CrossValidation {
    /// Selection of samples.
    pub selection: SampleSelection,
    /// Every block in order.
    pub blocks: Vec<Block>,
    /// Total over all samples, each predicted by the other blocks; `poses_used` is the mean.
    pub overall: Block,
    pub(super) started_ns: u64,
}

/// Errors of samples for each method, m.
#[derive(Default)]
pub(super) struct ErrorSamples {
    table_m: Vec<[f64; 2]>,
    offset_m: Vec<[f64; 2]>,
    identified_m: Vec<[f64; 2]>,
}

impl ErrorSamples {
    pub(super) fn of(table: &[Scored], frozen: &[Scored], [begin_ns, end_ns]: [u64; 2]) -> ErrorSamples {
        let inside = |scored: &&Scored| (begin_ns..end_ns).contains(&scored.time_ns);
        let others = table.iter().filter(|scored| !inside(scored));
        let (mut sum, mut count) = ([0.0; 2], 0.0_f64);
        for error in others.map(Scored::table_error_m) {
            sum = [sum[0] + error[0], sum[1] + error[1]];
            count += 1.0;
        }
        let offset = sum.map(|sum| sum / count.max(1.0));
        let table_m: Vec<_> = table.iter().filter(inside).map(Scored::table_error_m).collect();
        ErrorSamples {
            offset_m: table_m.iter().map(|error| difference(*error, offset)).collect(),
            identified_m: frozen.iter().filter(inside).map(Scored::identified_error_m).collect(),
            table_m,
        }
    }

    pub(super) fn extend(&mut self, other: ErrorSamples) {
        self.table_m.extend(other.table_m);
        self.offset_m.extend(other.offset_m);
        self.identified_m.extend(other.identified_m);
    }

    pub(super) fn block(&self, span_ns: [u64; 2], poses_used: u64) -> Block {
        let rms = |errors: &[[f64; 2]]| rms_mm(errors.iter().copied());
        Block {
            span_ns,
            samples: self.table_m.len(),
            poses_used,
            table_mm: rms(&self.table_m),
            offset_mm: rms(&self.offset_m),
            identified_mm: rms(&self.identified_m),
        }
    }
}

impl fmt::Display for CrossValidation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "cross-validation: each block is predicted by a model of the others; unloaded CoP error of samples"
        )?;
        writeln!(f, "{}, mm RMS forward (x) / sideways (y):", self.selection)?;
        let names = ["table alone", "table + offset", "identified"];
        let [table, offset, identified] = names;
        writeln!(
            f,
            "  {:<20} {:>7}  {table:>15}  {offset:>15}  {identified:>15}  {:>6}",
            "block", "samples", "learnt"
        )?;
        for block in &self.blocks {
            let [begin_s, end_s] = block.span_ns.map(|time_ns| seconds_since(self.started_ns, time_ns));
            line(f, &format!("{begin_s:.1} s – {end_s:.1} s"), block)?;
        }
        line(f, "all", &self.overall)
    }
}

fn line(f: &mut fmt::Formatter<'_>, name: &str, block: &Block) -> fmt::Result {
    let [table, offset, identified] =
        [block.table_mm, block.offset_mm, block.identified_mm].map(|rms| Pair(rms).to_string());
    writeln!(
        f,
        "  {name:<20} {:>7}  {table:>15}  {offset:>15}  {identified:>15}  {:>6}",
        block.samples, block.poses_used
    )
}
