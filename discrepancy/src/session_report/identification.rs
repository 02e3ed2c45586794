//! Progress of the identification, pose by pose.

use equipoise_core::message::State;
use equipoise_core::pose_suggestion::library::LIBRARY;

/// Accuracy of the model after a number of poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Number of poses used.
    pub poses: u32,
    /// Time of the last of them, s since the start of the recording.
    pub time_s: f64,
    /// The pose suggested just before.
    pub requested: Option<&'static str>,
    /// Predicted 1-σ of the CoP over the library, m; `None` while unavailable.
    pub cop_sigma_m: Option<f64>,
    /// Largest variance of a parameter (the paper's P_jj), m².
    pub variance_max_m2: Option<f64>,
    /// Normalised innovation squared of this pose, 2 degrees of freedom.
    pub nis: Option<f64>,
}

/// Progress of the whole identification.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Identification {
    /// The model before the first pose of this recording, then one row for each pose.
    pub poses: Vec<Pose>,
    /// Time at which the identification ended, s; the start of the recording if it ended before; `None` while it is open
    /// or was opened again.
    pub converged_s: Option<f64>,
    /// Whether a command, not the stop rule, ended it.
    pub stopped: bool,
    /// Whether the subject was identified at the start of the recording or when loaded.
    pub identified_before: bool,
    /// Number of resets in the recording.
    pub resets: u32,
    /// Motion samples used.
    pub motion_samples: u32,
    /// Final prior inflation; 1 without inflation.
    pub prior_inflation: Option<f64>,
    last: Option<Last>,
}

/// The previous state.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Last {
    poses: u32,
    requested: Option<&'static str>,
    is_identified: bool,
}

impl Identification {
    /// Adds one state; `stopped` if a command ended the identification since the previous state.
    pub fn ingest(&mut self, state: &State, time_s: f64, stopped: bool) {
        let requested = LIBRARY.get(state.suggested_pose as usize).map(|posture| posture.name);
        match self.last {
            None => {
                self.identified_before = state.converged != 0;
                self.add_pose(state, time_s, None);
            }
            Some(Last { poses, .. }) if state.poses_used < poses => {
                self.resets += 1;
                self.poses.clear();
                self.reopen();
                self.add_pose(state, time_s, None);
            }
            Some(Last { poses, requested, .. }) if state.poses_used > poses => {
                self.add_pose(state, time_s, requested);
            }
            // The filter has no estimate until the body is available; its first one is the prior.
            Some(_) => {
                if let Some(last) = self.poses.last_mut().filter(|pose| pose.cop_sigma_m.is_none()) {
                    *last = Pose {
                        time_s: last.time_s,
                        requested: last.requested,
                        ..pose_of(state, time_s, None)
                    };
                }
            }
        }
        let is_identified = state.converged != 0;
        if !is_identified && self.last.is_some_and(|last| last.is_identified) {
            self.reopen();
        }
        if is_identified && self.converged_s.is_none() {
            (self.converged_s, self.stopped) = (Some(time_s), stopped);
        }
        self.motion_samples = state.motion_samples_used;
        self.prior_inflation = positive(state.prior_inflation);
        self.last = Some(Last { poses: state.poses_used, requested, is_identified });
    }

    fn reopen(&mut self) {
        (self.converged_s, self.stopped, self.identified_before) = (None, false, false);
    }

    fn add_pose(&mut self, state: &State, time_s: f64, requested: Option<&'static str>) {
        self.poses.push(pose_of(state, time_s, requested));
    }
}

fn pose_of(state: &State, time_s: f64, requested: Option<&'static str>) -> Pose {
    Pose {
        poses: state.poses_used,
        time_s,
        requested,
        cop_sigma_m: positive(state.predicted_cop_sigma_m),
        variance_max_m2: positive(state.variance_max_m2),
        nis: positive(state.nis).filter(|_| state.poses_used > 0),
    }
}

fn positive(value: f64) -> Option<f64> {
    (value.is_finite() && value > 0.0).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn every_pose_is_a_row_with_the_requested_pose() {
        let mut found = Identification::default();
        let state = |poses_used, sigma_m, suggested_pose| State {
            poses_used,
            predicted_cop_sigma_m: sigma_m,
            suggested_pose,
            ..State::zeroed()
        };
        found.ingest(&state(0, 0.0, u32::MAX), 0.0, false);
        found.ingest(&state(0, 0.02, 1), 1.0, false);
        found.ingest(&state(1, 0.01, 2), 2.0, false);
        found.ingest(&State { converged: 1, ..state(2, 0.004, u32::MAX) }, 3.0, false);
        let poses: Vec<_> =
            found.poses.iter().map(|pose| (pose.poses, pose.cop_sigma_m, pose.requested)).collect();
        let names = [1, 2].map(|index: usize| Some(LIBRARY[index].name));
        assert_eq!(poses, [(0, Some(0.02), None), (1, Some(0.01), names[0]), (2, Some(0.004), names[1])]);
        assert_eq!((found.converged_s, found.identified_before, found.resets), (Some(3.0), false, 0));
        found.ingest(&state(0, 0.02, 1), 4.0, false);
        assert_eq!((found.poses.len(), found.converged_s, found.resets), (1, None, 1));
        found.ingest(&State { converged: 1, ..state(1, 0.02, 1) }, 5.0, true);
        assert_eq!((found.converged_s, found.stopped), (Some(5.0), true), "stopped by a command");
        let mut estimates = Identification::default();
        estimates.ingest(&State { converged: 1, ..state(9, 0.004, u32::MAX) }, 0.0, false);
        assert!(estimates.identified_before);
        estimates.ingest(&state(0, 0.02, 1), 1.0, false);
        assert!(
            !estimates.identified_before && estimates.converged_s.is_none(),
            "a reset clears the estimate"
        );
    }

    #[test]
    fn an_identification_that_was_opened_again_is_not_identified() {
        let mut found = Identification::default();
        let state = |converged| State { converged, poses_used: 9, ..State::zeroed() };
        found.ingest(&state(1), 0.0, false);
        found.ingest(&state(0), 1.0, false);
        assert_eq!((found.converged_s, found.identified_before, found.resets), (None, false, 0));
        found.ingest(&state(1), 2.0, true);
        assert_eq!((found.converged_s, found.stopped), (Some(2.0), true));
        found.ingest(&state(0), 3.0, false);
        found.ingest(&state(1), 4.0, false);
        assert_eq!((found.converged_s, found.stopped), (Some(4.0), false));
    }
}
