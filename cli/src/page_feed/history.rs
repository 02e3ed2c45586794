//! History of an identification's numbers, for an engineer's page that is opened late.

use std::collections::VecDeque;

use equipoise_core::body::Segment;
use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::State;
use equipoise_core::time::seconds;
use serde::Serialize;
use serde_json::{Value, json};

/// Ten minutes of two points a second.
const POINTS_MAX: usize = 1200;

/// What the filter holds, after one cycle.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Parameters {
    cycle: u64,
    /// When it was read, CLOCK_MONOTONIC, s: the clock of the states' `t`.
    #[serde(rename = "t")]
    t_s: f64,
    /// The first raw parameter of Φ that each follows: segment and axis.
    names: Vec<String>,
    /// θ, m.
    theta_m: Vec<f64>,
    /// Square root of P_jj, m.
    sigma_m: Vec<f64>,
}

impl Parameters {
    /// Reads the filter from a copy of the loop's memory received at `t_s`; `None` before the first body.
    pub(super) fn of(checkpoint: &Checkpoint, t_s: f64) -> Option<Parameters> {
        let worker = &checkpoint.memory()?.identification;
        let (filter, count) = (&worker.filter, worker.filter.count());
        let name = |parameter: usize| {
            let raw = Segment::ALL.iter().flat_map(|segment| (0..3).map(move |axis| (*segment, axis)));
            raw.into_iter()
                .find(|(segment, axis)| worker.reduction.raw_row(*segment, *axis).0[parameter] != 0.0)
                .map_or_else(String::new, |(segment, axis)| {
                    format!("{} {}", segment.name(), ["x", "y", "z"][axis])
                })
        };
        (count > 0).then(|| Parameters {
            cycle: checkpoint.cycle,
            t_s,
            names: (0..count).map(name).collect(),
            theta_m: filter.theta_m()[..count].to_vec(),
            sigma_m: (0..count).map(|index| filter.variance_m2(index).sqrt()).collect(),
        })
    }
}

#[derive(Debug, Clone, Copy)]
struct Point {
    t_s: f64,
    variance_max_m2: f64,
    cop_sigma_m: f64,
    nis: f64,
    poses: u32,
    motion_samples: u32,
}

/// The last ten minutes of one identification of one worker.
#[derive(Debug, Default)]
pub(super) struct History {
    /// Id of the worker; empty if unnamed.
    subject: String,
    points: VecDeque<Point>,
    parameters: VecDeque<Parameters>,
}

impl History {
    /// Discards the history of another worker.
    pub(super) fn set_subject(&mut self, subject: &str) {
        if self.subject != subject {
            *self = History { subject: subject.to_owned(), ..History::default() };
        }
    }

    /// One point more.
    pub(super) fn push(&mut self, state: &State) {
        let t_s = seconds(state.time_ns);
        // The clock is shared by all daemons and decreases only if the computer restarted while this page kept running.
        if self.points.back().is_some_and(|last| last.t_s >= t_s) {
            return;
        }
        // Fewer poses or samples: identification began again.
        let began_again =
            |last: &Point| state.poses_used < last.poses || state.motion_samples_used < last.motion_samples;
        if self.points.back().is_some_and(began_again) {
            self.points.clear();
            self.parameters.clear();
        }
        self.points.push_back(Point {
            t_s,
            variance_max_m2: state.variance_max_m2,
            cop_sigma_m: state.predicted_cop_sigma_m,
            nis: state.nis,
            poses: state.poses_used,
            motion_samples: state.motion_samples_used,
        });
        if self.points.len() > POINTS_MAX {
            self.points.pop_front();
        }
    }

    /// What the filter held once more.
    pub(super) fn push_parameters(&mut self, parameters: Parameters) {
        let last = self.parameters.back();
        // Different names indicate another reduction, and a lower cycle another daemon: discard the old history.
        if last.is_some_and(|last| last.names != parameters.names || last.cycle > parameters.cycle) {
            self.parameters.clear();
        }
        self.parameters.push_back(parameters);
        if self.parameters.len() > POINTS_MAX {
            self.parameters.pop_front();
        }
    }

    /// What the filter held last.
    pub(super) fn newest_parameters(&self) -> Option<&Parameters> {
        self.parameters.back()
    }

    /// Columns; unavailable numbers are null.
    pub(super) fn to_json(&self) -> Value {
        let column = |of: fn(&Point) -> f64| -> Vec<Option<f64>> {
            self.points.iter().map(of).map(|value| Some(value).filter(|value| *value > 0.0)).collect()
        };
        json!({
            "t": column(|point| point.t_s),
            "variance_max_m2": column(|point| point.variance_max_m2),
            "predicted_cop_sigma_m": column(|point| point.cop_sigma_m),
            "nis": column(|point| point.nis),
            "poses_used": self.points.iter().map(|point| point.poses).collect::<Vec<_>>(),
            "motion_samples_used": self.points.iter().map(|point| point.motion_samples).collect::<Vec<_>>(),
            "parameters": self.parameters,
        })
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    fn parameters(cycle: u64, name: &str) -> Parameters {
        Parameters { cycle, t_s: 0.0, names: vec![name.to_owned()], theta_m: vec![0.1], sigma_m: vec![0.01] }
    }

    #[test]
    fn ten_minutes_are_stored_in_increasing_time() {
        let mut history = History::default();
        for half_second in 0..2 * POINTS_MAX as u64 {
            history.push(&State { time_ns: 1 + half_second * 500_000_000, ..State::zeroed() });
        }
        history.push(&State { time_ns: 1, ..State::zeroed() });
        let json = history.to_json();
        assert_eq!(json["t"].as_array().map(Vec::len), Some(POINTS_MAX));
        assert_eq!(json["t"][POINTS_MAX - 1].as_f64().map(f64::round), Some(1200.0));
        assert!(json["nis"][0].is_null(), "what was never said is no zero");
    }

    #[test]
    fn one_picture_holds_one_filter() {
        let mut history = History::default();
        history.push_parameters(parameters(5, "Pelvis x"));
        history.push_parameters(parameters(9, "Pelvis x"));
        assert_eq!(history.parameters.len(), 2);
        history.push_parameters(parameters(12, "Pelvis y"));
        assert_eq!(history.parameters.len(), 1);
        history.push_parameters(parameters(3, "Pelvis y"));
        assert_eq!(history.parameters.len(), 1);
    }

    #[test]
    fn one_picture_holds_one_identification_of_one_worker() {
        let state = |second: u64, poses_used, motion_samples_used| State {
            time_ns: second * 1_000_000_000,
            poses_used,
            motion_samples_used,
            ..State::zeroed()
        };
        for (next, points) in [(state(2, 5, 9), 2), (state(2, 4, 9), 1), (state(2, 5, 8), 1)] {
            let mut history = History::default();
            history.set_subject("anon-1");
            history.push(&state(1, 5, 9));
            history.push_parameters(parameters(5, "Pelvis x"));
            history.push(&next);
            assert_eq!((history.points.len(), history.parameters.len()), (points, points - 1));
            history.set_subject("anon-1");
            assert_eq!(history.points.len(), points);
            history.set_subject("anon-2");
            assert_eq!((history.points.len(), history.parameters.len()), (0, 0));
        }
    }

    #[test]
    fn an_empty_memory_has_no_parameters() {
        assert!(Parameters::of(&bytemuck::zeroed_box::<Checkpoint>(), 0.0).is_none());
    }
}
