//! The lag by which the loop paired both streams: states hold the measured skew only, not the lag in use.

use equipoise_adapters::recording::{Entry, RecordingHeader, TimedEntry};
use equipoise_core::message::State;

/// The lag in use over time, s: the suit's t corresponds to the ground's t − lag.
#[derive(Debug, Default)]
pub(super) struct LagHistory {
    /// Times, CLOCK_MONOTONIC ns, and the lag of the checkpoints.
    checkpoints: Vec<(u64, f64)>,
    /// Number of checkpoints before the newest state.
    passed: usize,
    /// Whether the streams were paired without a lag.
    is_fixed: bool,
    lag_s: Option<f64>,
    last_cycle: u64,
}

impl LagHistory {
    /// Ingests an entry of the samples: a checkpoint holds the lag.
    pub(super) fn ingest(&mut self, timed: &TimedEntry) {
        if let Entry::Checkpoint(checkpoint) = &timed.entry
            && let Some(memory) = checkpoint.memory()
        {
            self.checkpoints.push((timed.log_time_ns, memory.skew().lag_s()));
        }
    }

    /// The lag at the begin: 0 if the states were computed without a stored lag (`is_fresh`), otherwise that of the first
    /// checkpoint. `header` is that of the states.
    pub(super) fn begin(&mut self, is_fresh: bool, header: &RecordingHeader) {
        self.is_fixed = is_published_method(&header.config_toml);
        if is_fresh {
            self.checkpoints.clear();
        }
        self.checkpoints.sort_by_key(|(time_ns, _)| *time_ns);
        let first = self.checkpoints.first().map(|(_, lag_s)| *lag_s);
        self.lag_s = if is_fresh { Some(0.0) } else { first };
    }

    /// The lag of a state, s; `None` if it is unavailable. States must be in order.
    pub(super) fn at(&mut self, state: &State) -> Option<f64> {
        if self.is_fixed {
            return Some(0.0);
        }
        // A restarted daemon resumes from a stored lag.
        if state.cycle < self.last_cycle {
            self.lag_s = None;
        }
        self.last_cycle = state.cycle;
        while let Some((_, lag_s)) =
            self.checkpoints.get(self.passed).filter(|(time_ns, _)| *time_ns <= state.time_ns)
        {
            self.lag_s = Some(*lag_s);
            self.passed += 1;
        }
        // The loop applies each skew that is precise enough for publication, and keeps the last one.
        if state.suit_skew_sigma_s > 0.0 {
            self.lag_s = Some(state.suit_skew_s);
        }
        self.lag_s
    }
}

/// Whether a configuration has `motion = "paper"`, which applies no lag.
fn is_published_method(config_toml: &str) -> bool {
    let config: toml::Table = config_toml.parse().unwrap_or_default();
    let motion = config.get("overload").and_then(|overload| overload.get("motion"));
    motion.and_then(toml::Value::as_str) == Some("paper")
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    /// The lags of states at 1, 2, … with these skews and σ.
    fn lags(mut history: LagHistory, skews_s: &[[f64; 2]]) -> Vec<Option<f64>> {
        let state = |(index, [suit_skew_s, suit_skew_sigma_s]): (usize, &[f64; 2])| State {
            cycle: index as u64 + 1,
            time_ns: index as u64 + 1,
            suit_skew_s: *suit_skew_s,
            suit_skew_sigma_s: *suit_skew_sigma_s,
            ..State::zeroed()
        };
        skews_s.iter().enumerate().map(state).map(|state| history.at(&state)).collect()
    }

    fn history(is_fresh: bool, config_toml: &str) -> LagHistory {
        let checkpoints = vec![(2, 0.05), (4, 0.07)];
        let mut history = LagHistory { checkpoints, ..LagHistory::default() };
        history.begin(
            is_fresh,
            &RecordingHeader { config_toml: config_toml.to_owned(), ..RecordingHeader::default() },
        );
        history
    }

    #[test]
    fn a_resumed_lag_is_that_of_the_checkpoints_and_an_aged_skew_stays_in_use() {
        let unknown = [0.0; 2];
        let skews_s = [unknown, unknown, [0.06, 0.004], unknown, unknown];
        let resumed = lags(history(false, ""), &skews_s);
        assert_eq!(resumed, [Some(0.05), Some(0.05), Some(0.06), Some(0.07), Some(0.07)]);
        let fresh = lags(history(true, ""), &skews_s);
        assert_eq!(fresh, [Some(0.0), Some(0.0), Some(0.06), Some(0.06), Some(0.06)]);
    }

    #[test]
    fn the_published_method_has_no_lag() {
        let paper = history(false, "[overload]\nmotion = \"paper\"\n");
        assert_eq!(lags(paper, &[[0.06, 0.004]]), [Some(0.0)]);
    }

    #[test]
    fn after_a_restart_the_lag_is_unavailable_until_a_checkpoint() {
        let mut history = history(false, "");
        let mut at = |cycle, time_ns| history.at(&State { cycle, time_ns, ..State::zeroed() });
        assert_eq!([at(9, 2), at(1, 3), at(2, 4)], [Some(0.05), None, Some(0.07)]);
        let mut without = LagHistory::default();
        without.begin(false, &RecordingHeader::default());
        assert_eq!(without.at(&State::zeroed()), None);
    }
}
