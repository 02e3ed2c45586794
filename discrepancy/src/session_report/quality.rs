//! Data quality: phases, validity flags, gaps, losses, refusals.

use std::collections::BTreeMap;

use equipoise_core::message::state::Unavailable;
use equipoise_core::message::{AdapterHealth, State, Validity};

/// Number of phases.
const PHASES: usize = 4;

/// Data quality of a session.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Quality {
    /// Total duration of the states, s.
    pub observed_s: f64,
    /// Time in each phase, by its number, s.
    pub phase_s: [f64; PHASES],
    /// Duration of each validity flag, s, in the order of [`Validity::NAMES`].
    pub reason_s: Vec<f64>,
    /// Duration without any validity flag, s.
    pub all_valid_s: f64,
    /// Quantities that the station's sensors do not provide, by name.
    pub unavailable: Vec<&'static str>,
    /// Missing states between the first and the last.
    pub states_missing: u64,
    /// Number of daemon restarts.
    pub restarts: u64,
    /// Number of steps of the feet.
    pub stances: u32,
    /// Last health message of each adapter, by stream: 1 suit, 2 ground.
    pub adapters: BTreeMap<u32, AdapterHealth>,
    last_cycle: Option<u64>,
    last_stance: Option<u32>,
}

impl Quality {
    /// Adds one state, which represents `step_s`.
    pub fn ingest(&mut self, state: &State, step_s: f64) {
        self.observed_s += step_s;
        if let Some(phase_s) = self.phase_s.get_mut(state.phase as usize) {
            *phase_s += step_s;
        }
        self.reason_s.resize(Validity::NAMES.len(), 0.0);
        for ((reason, _), raised_s) in Validity::NAMES.iter().zip(&mut self.reason_s) {
            if state.validity().any_of(*reason) {
                *raised_s += step_s;
            }
        }
        if state.valid == 0 {
            self.all_valid_s += step_s;
        }
        for (what, name) in Unavailable::NAMES {
            if !state.provides(what) && !self.unavailable.contains(&name) {
                self.unavailable.push(name);
            }
        }
        match self.last_cycle.replace(state.cycle) {
            Some(last) if state.cycle <= last => self.restarts += 1,
            Some(last) => self.states_missing += state.cycle - last - 1,
            None => {}
        }
        if let Some(last) = self.last_stance.replace(state.stance) {
            self.stances += state.stance.saturating_sub(last);
        }
    }

    /// Ingests a health message; the last one suffices because its counts are totals.
    pub fn ingest_health(&mut self, health: &AdapterHealth) {
        self.adapters.insert(health.stream, *health);
    }

    /// The flag of a set that was raised for the longest time, and this time, s; `None` if none was raised.
    pub fn longest_of(&self, set: Validity) -> Option<(&'static str, f64)> {
        let raised = Validity::NAMES.iter().zip(&self.reason_s);
        let of_set = raised.filter(|((flag, _), raised_s)| set.any_of(*flag) && **raised_s > 0.0);
        of_set.map(|((_, name), raised_s)| (*name, *raised_s)).max_by(|(_, a), (_, b)| a.total_cmp(b))
    }

    /// The validity flags that were raised, with their durations, s.
    pub fn reasons(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let raised = Validity::NAMES.iter().zip(&self.reason_s).filter(|(_, raised_s)| **raised_s > 0.0);
        raised.map(|((_, name), raised_s)| (*name, *raised_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn reasons_gaps_and_restarts_are_counted() {
        let mut quality = Quality::default();
        for (cycle, valid) in [(1, 0), (2, 3), (5, 1), (1, 0)] {
            quality.ingest(&State { cycle, valid, phase: 2, ..State::zeroed() }, 0.5);
        }
        assert_eq!(quality.reasons().map(|(_, raised_s)| raised_s).collect::<Vec<_>>(), [1.0, 0.5]);
        assert_eq!(quality.longest_of(Validity::INVALIDATES_TORQUES), Some(("suit_stale", 1.0)));
        assert_eq!(quality.longest_of(Validity::GROUND_STALE), Some(("ground_stale", 0.5)));
        assert_eq!(quality.longest_of(Validity::MOVING), None);
        assert_eq!((quality.states_missing, quality.restarts), (2, 1));
        assert_eq!((quality.all_valid_s, quality.observed_s, quality.phase_s[2]), (1.0, 2.0, 2.0));
    }
}
