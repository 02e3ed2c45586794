//! Evaluates the estimated unloaded centre of pressure in quasi-static samples.

use std::fmt;

use equipoise_core::message::{State, Validity};

/// Length of a block of the summary, ns.
const BLOCK_NS: u64 = 10 * equipoise_core::time::NS_PER_S;

/// Selects the suit samples that count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleSelection {
    /// Static poses without a load.
    QuasiStatic,
    /// All samples with the feet on the plate, in motion too: only for data known to be without a load.
    AllUnloaded,
}

impl fmt::Display for SampleSelection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SampleSelection::QuasiStatic => "quasi-static and without a load",
            SampleSelection::AllUnloaded => "usable, with the feet on the plate",
        })
    }
}

/// One suit sample that counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scored {
    /// The suit's sample time, ns.
    pub time_ns: u64,
    /// Measured centre of pressure, world x and y, m.
    pub measured_m: [f64; 2],
    /// Predicted by the identified model, m.
    pub identified_m: [f64; 2],
    /// Predicted by the anthropometric table alone, m.
    pub table_m: [f64; 2],
}

impl Scored {
    /// The sample of a state, if it counts and all quantities are available.
    ///
    /// `table` is the state of the same cycle computed with the table's model.
    pub fn of(state: &State, table: &State, selection: SampleSelection) -> Option<Scored> {
        const INVALIDATING: Validity = Validity::INVALIDATES_COP_MEASURED
            .and(Validity::INVALIDATES_COP_ESTIMATED)
            .and(Validity::MASS_UNKNOWN)
            .and(Validity::CLOCK_UNSYNCHRONISED);
        let valid = state.validity();
        let unloaded = valid.any_of(Validity::BELOW_LOAD_THRESHOLD);
        // Zero σ: no model is available yet. Another sample: the table's motion window is not full again.
        let estimated = state.cop_sigma_m[0] > 0.0
            && table.cop_sigma_m[0] > 0.0
            && table.suit_sample_time_ns == state.suit_sample_time_ns;
        let is_selected = match selection {
            SampleSelection::QuasiStatic => state.static_pose == 1 && unloaded,
            SampleSelection::AllUnloaded => !valid.any_of(Validity::MOVING),
        };
        (is_selected && estimated && !valid.any_of(INVALIDATING)).then_some(Scored {
            time_ns: state.suit_sample_time_ns,
            measured_m: state.cop_measured_m,
            identified_m: state.cop_estimated_m,
            table_m: table.cop_estimated_m,
        })
    }

    /// Measured minus identified, m.
    pub fn identified_error_m(&self) -> [f64; 2] {
        difference(self.measured_m, self.identified_m)
    }

    /// Measured minus table, m.
    pub fn table_error_m(&self) -> [f64; 2] {
        difference(self.measured_m, self.table_m)
    }
}

/// `a − b`.
pub(super) fn difference(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

/// Root mean square of errors per axis, mm; `None` if there is none.
pub fn rms_mm(errors_m: impl Iterator<Item = [f64; 2]>) -> Option<[f64; 2]> {
    let (mut sum, mut count) = ([0.0; 2], 0.0);
    for error in errors_m {
        count += 1.0;
        for (sum, error) in sum.iter_mut().zip(error) {
            *sum += error * error;
        }
    }
    (count > 0.0).then(|| sum.map(|sum| 1e3 * f64::sqrt(sum / count)))
}

/// Table of a replay's errors, with a line for each block of 10 s that has samples.
#[derive(Debug, Clone, Copy)]
pub struct Blocks<'a> {
    /// All samples that count, in order.
    pub scored: &'a [Scored],
    /// Time origin, ns.
    pub started_ns: u64,
}

impl fmt::Display for Blocks<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.scored.is_empty() {
            return writeln!(f, "unloaded CoP error: no suit sample was quasi-static and without a load");
        }
        writeln!(f, "unloaded CoP error while quasi-static, mm RMS forward (x) / sideways (y):")?;
        writeln!(f, "  {:<20} {:>7}  {:>15}  {:>15}", "block", "samples", "identified", "table alone")?;
        let block_of = |scored: &Scored| scored.time_ns.saturating_sub(self.started_ns) / BLOCK_NS;
        for block in self.scored.chunk_by(|a, b| block_of(a) == block_of(b)) {
            let number = block_of(&block[0]);
            line(f, &format!("{} s – {} s", 10 * number, 10 * (number + 1)), block)?;
        }
        line(f, "all", self.scored)
    }
}

fn line(f: &mut fmt::Formatter<'_>, name: &str, scored: &[Scored]) -> fmt::Result {
    let identified = Pair(rms_mm(scored.iter().map(Scored::identified_error_m)));
    let table = Pair(rms_mm(scored.iter().map(Scored::table_error_m)));
    let (identified, table) = (identified.to_string(), table.to_string());
    writeln!(f, "  {name:<20} {:>7}  {identified:>15}  {table:>15}", scored.len())
}

/// Two numbers of a table, or dashes.
pub(super) struct Pair(pub(super) Option<[f64; 2]>);

impl fmt::Display for Pair {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some([x, y]) => write!(f, "{x:.2} / {y:.2}"),
            None => f.write_str("–"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_states_of_the_same_sample_are_compared() {
        let state = State {
            suit_sample_time_ns: 7,
            static_pose: 1,
            valid: Validity::BELOW_LOAD_THRESHOLD.0,
            cop_sigma_m: [0.01; 2],
            ..bytemuck::Zeroable::zeroed()
        };
        assert!(Scored::of(&state, &state, SampleSelection::QuasiStatic).is_some());
        let earlier = State { suit_sample_time_ns: 6, ..state };
        assert_eq!(Scored::of(&state, &earlier, SampleSelection::QuasiStatic), None);
    }

    #[test]
    fn root_mean_square_in_millimetres() {
        assert_eq!(rms_mm([[0.003, 0.0], [0.004, 0.001]].into_iter().cycle().take(4)).unwrap()[1], {
            1e3 * f64::sqrt(2.0 * 1e-6 / 4.0)
        });
        assert_eq!(rms_mm(std::iter::empty()), None);
    }

    #[test]
    fn blocks_are_distinguished_and_summed_up() {
        let at = |seconds: u64, x: f64| Scored {
            time_ns: 1_000_000_000 * (1 + seconds),
            measured_m: [x, 0.0],
            identified_m: [0.0; 2],
            table_m: [0.0, 0.002],
        };
        let scored = [at(1, 0.003), at(9, 0.003), at(25, 0.001)];
        let text = Blocks { scored: &scored, started_ns: 1_000_000_000 }.to_string();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 5, "{text}");
        assert!(lines[2].contains("0 s – 10 s") && lines[2].contains("3.00 / 0.00"), "{text}");
        assert!(lines[3].contains("20 s – 30 s") && lines[3].contains("1.00 / 0.00"), "{text}");
        assert!(lines[4].contains("2.52 / 0.00") && lines[4].contains("2.52 / 2.00"), "{text}");
    }
}
