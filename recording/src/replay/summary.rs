//! Summary of a replay.

use std::fmt;

use equipoise_core::message::State;
use equipoise_core::message::state::Phase;

use super::fidelity::Fidelity;
use super::output::seconds_since;
use super::residual::Residual;
use super::samples::SkippedData;
use super::score::{Blocks, Scored};
use super::skipped_lines;

/// All phases in the order of their numbers.
const PHASES: [Phase; 4] = [Phase::Waiting, Phase::Identifying, Phase::Monitoring, Phase::Degraded];

/// Results of a replay.
#[derive(Debug, Clone)]
pub struct Summary {
    /// Cycles.
    pub cycles: u64,
    /// Time in each phase, by the phase's number, ns.
    pub phase_ns: [u64; PHASES.len()],
    /// Final number of held poses in the model.
    pub poses_used: u32,
    /// Final body mass, kg; 0 if unavailable.
    pub mass_kg: f64,
    /// Quasi-static suit samples without a load.
    pub scored: Vec<Scored>,
    /// Residual of the identified model.
    pub residual: Residual,
    /// Comparison with the live loop, if cycles were recorded.
    pub fidelity: Option<Fidelity>,
    /// Unused parts of the input.
    pub skipped: SkippedData,
    started_ns: u64,
    span_ns: Option<[u64; 2]>,
}

impl Summary {
    pub(super) fn new(started_ns: u64, residual_s: Option<[f64; 2]>) -> Summary {
        Summary {
            cycles: 0,
            phase_ns: [0; PHASES.len()],
            poses_used: 0,
            mass_kg: 0.0,
            scored: Vec::new(),
            residual: Residual::over(started_ns, residual_s),
            fidelity: None,
            skipped: SkippedData::default(),
            started_ns,
            span_ns: None,
        }
    }

    /// Adds one state, which represents `period_ns`.
    pub(super) fn ingest(&mut self, state: &State, period_ns: u64) {
        self.cycles += 1;
        self.residual.ingest(state);
        if let Some(phase_ns) = self.phase_ns.get_mut(state.phase as usize) {
            *phase_ns += period_ns;
        }
        self.poses_used = state.poses_used;
        self.mass_kg = state.mass_kg;
        let [first_ns, _] = self.span_ns.unwrap_or([state.time_ns; 2]);
        self.span_ns = Some([first_ns, state.time_ns]);
    }

    /// The summary as JSON.
    pub fn json(&self) -> serde_json::Value {
        let phases: serde_json::Map<String, serde_json::Value> = PHASES
            .iter()
            .zip(self.phase_ns)
            .map(|(phase, phase_ns)| (phase.name().to_owned(), (phase_ns as f64 / 1e9).into()))
            .collect();
        let span_s = self.span_ns.map(|span| span.map(|at| seconds_since(self.started_ns, at)));
        serde_json::json!({
            "cycles": self.cycles,
            "span_s": span_s,
            "phase_s": phases,
            "poses_used": self.poses_used,
            "mass_kg": (self.mass_kg > 0.0).then_some(self.mass_kg),
            "residual": self.residual,
            "whole": self.is_complete(),
            "rejected": self.skipped.rejected,
            "passed_over": self.skipped.ignored,
        })
    }

    /// Whether all data were used and every compared state was reproduced.
    pub fn is_complete(&self) -> bool {
        self.skipped.rejected.is_empty() && self.fidelity.as_ref().is_none_or(Fidelity::is_exact)
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [from_s, to_s] = self.span_ns.unwrap_or_default().map(|at| seconds_since(self.started_ns, at));
        writeln!(f, "{} cycles, t = {from_s:.3} s to {to_s:.3} s", self.cycles)?;
        let phases: Vec<String> = PHASES
            .iter()
            .zip(self.phase_ns)
            .filter(|(_, phase_ns)| *phase_ns > 0)
            .map(|(phase, phase_ns)| format!("{} {:.1} s", phase.name(), phase_ns as f64 / 1e9))
            .collect();
        writeln!(f, "phases: {}", if phases.is_empty() { "none".to_owned() } else { phases.join(", ") })?;
        let mass =
            if self.mass_kg > 0.0 { format!("{:.1} kg", self.mass_kg) } else { "not known".to_owned() };
        writeln!(f, "poses used: {}; body mass: {mass}", self.poses_used)?;
        write!(f, "{}", Blocks { scored: &self.scored, started_ns: self.started_ns })?;
        write!(f, "{}", self.residual)?;
        if let Some(fidelity) = &self.fidelity {
            write!(f, "{fidelity}")?;
        }
        f.write_str(&skipped_lines(&self.skipped))
    }
}
