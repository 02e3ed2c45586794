//! The scenes of the demonstration, and the measurements taken in each.

use std::time::Duration;

use equipoise_core::body::Joint;
use equipoise_core::message::state::Phase;
use equipoise_core::message::{State, Validity};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_simulator::simulation::SimulationHandle;
use nalgebra::Vector3;

/// The box of the paper, kg.
pub(super) const BOX_KG: f64 = 4.0;
/// The joints of the paper's Fig. 6 and the lower back: label and MVN name.
pub(super) const JOINTS_SHOWN: [(&str, &str); 6] = [
    ("hip", "RightHip"),
    ("knee", "RightKnee"),
    ("ankle", "RightAnkle"),
    ("shoulder", "RightShoulder"),
    ("elbow", "RightElbow"),
    ("lower_back", "L5S1"),
];
/// After this long without the pose being used, the person tries another one, s.
const TIMEOUT_S: f64 = 6.0;
/// Duration of each check pose, s; reaching it takes 1.8 s.
const CHECK_POSE_S: f64 = 3.2;
/// Number of check poses.
const CHECK_POSES: usize = 6;
/// From lifting the box to having put it down (16 s), plus 3.5 s with empty hands in which the lift is counted and
/// displayed, s.
const LIFT_S: f64 = 19.5;

/// Stage of the demonstration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scene {
    /// The sensors start.
    Begin,
    /// The person takes suggested poses.
    Identify,
    /// The person stands in poses that were not used for identification.
    Check,
    /// The person lifts the box.
    Lift,
    /// Done.
    Over,
}

impl Scene {
    pub(super) fn name(self) -> &'static str {
        match self {
            Scene::Begin => "waiting for the sensors",
            Scene::Identify => "identifying",
            Scene::Check => "checking the model",
            Scene::Lift => "lifting",
            Scene::Over => "done",
        }
    }
}

/// Sums for one joint while lifting.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct JointSums {
    pub(super) published_nm: f64,
    pub(super) true_nm: f64,
    pub(super) error_nm2: f64,
    pub(super) sigma_nm: f64,
    pub(super) true_max_nm: f64,
    pub(super) published_max_nm: f64,
}

/// Sums of a pair of centres of pressure, m.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CopSums {
    pub(super) samples: f64,
    pub(super) error_m2: [f64; 2],
}

impl CopSums {
    fn add(&mut self, state: &State) {
        self.samples += 1.0;
        for axis in 0..2 {
            self.error_m2[axis] += (state.cop_measured_m[axis] - state.cop_estimated_m[axis]).powi(2);
        }
    }
}

/// Smallest and largest measured centre of pressure per axis, m; `None` before the first.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CopRange(Option<[[f64; 2]; 2]>);

impl CopRange {
    fn add(&mut self, cop_m: [f64; 2]) {
        let [low, high] = self.0.unwrap_or([cop_m; 2]);
        self.0 = Some([
            [0, 1].map(|axis: usize| low[axis].min(cop_m[axis])),
            [0, 1].map(|axis: usize| high[axis].max(cop_m[axis])),
        ]);
    }

    /// From the smallest to the largest value, forward and sideways, m.
    pub(super) fn extent_m(&self) -> [f64; 2] {
        self.0.map_or([0.0; 2], |[low, high]| [0, 1].map(|axis: usize| high[axis] - low[axis]))
    }
}

/// The script with its progress and measurements.
#[derive(Debug)]
pub(super) struct Script {
    scene: Scene,
    scene_since_s: f64,
    duration_s: f64,
    suggested: u32,
    requested_since_s: f64,
    check_pose: usize,
    last_sample_ns: u64,
    requested: u64,
    pub(super) poses_used: u32,
    pub(super) identified_after_s: f64,
    pub(super) predicted_sigma_m: f64,
    pub(super) unloaded: CopSums,
    /// Range over the whole session.
    pub(super) cop_range: CopRange,
    pub(super) loaded_samples: f64,
    pub(super) delta_f_n: f64,
    pub(super) joints: [JointSums; JOINTS_SHOWN.len()],
}

impl Script {
    pub(super) fn new(duration: Duration) -> Script {
        Script {
            scene: Scene::Begin,
            scene_since_s: 0.0,
            duration_s: duration.as_secs_f64(),
            suggested: u32::MAX,
            requested_since_s: 0.0,
            check_pose: 0,
            last_sample_ns: 0,
            requested: 0,
            poses_used: 0,
            identified_after_s: 0.0,
            predicted_sigma_m: 0.0,
            unloaded: CopSums::default(),
            cop_range: CopRange::default(),
            loaded_samples: 0.0,
            delta_f_n: 0.0,
            joints: [JointSums::default(); JOINTS_SHOWN.len()],
        }
    }

    pub(super) fn scene(&self) -> Scene {
        self.scene
    }

    pub(super) fn poses_used(&self) -> u32 {
        self.poses_used
    }

    /// Reacts to one state.
    pub(super) fn update(&mut self, state: &State, person: &SimulationHandle, elapsed: Duration) {
        let now_s = elapsed.as_secs_f64();
        let fresh = state.suit_sample_time_ns != self.last_sample_ns;
        self.last_sample_ns = state.suit_sample_time_ns;
        self.poses_used = state.poses_used;
        if fresh && !state.validity().any_of(Validity::INVALIDATES_COP_MEASURED) {
            self.cop_range.add(state.cop_measured_m);
        }
        match self.scene {
            Scene::Begin => {
                if state.phase == Phase::Identifying as u32 {
                    self.enter(Scene::Identify, now_s);
                }
            }
            Scene::Identify => self.identify(state, person, now_s),
            Scene::Check => self.check(state, person, now_s, fresh),
            Scene::Lift => self.lift(state, person, now_s, fresh),
            Scene::Over => {}
        }
    }

    fn enter(&mut self, scene: Scene, now_s: f64) {
        self.scene = scene;
        self.scene_since_s = now_s;
    }

    fn identify(&mut self, state: &State, person: &SimulationHandle, now_s: f64) {
        if state.phase == Phase::Monitoring as u32 {
            self.identified_after_s = now_s;
            self.predicted_sigma_m = state.predicted_cop_sigma_m;
            self.enter(Scene::Check, now_s);
            self.assume_check_pose(person);
            return;
        }
        if state.suggested_pose != self.suggested {
            self.suggested = state.suggested_pose;
            self.requested_since_s = now_s;
            self.assume_pose(person, state.suggested_pose as usize);
        } else if now_s - self.requested_since_s > TIMEOUT_S {
            // If the suggested pose has no effect, the person tries another one.
            self.requested_since_s = now_s;
            self.assume_pose(person, (state.suggested_pose as usize + 7) % LIBRARY.len());
        }
    }

    fn assume_pose(&mut self, person: &SimulationHandle, pose: usize) {
        if person.take_pose(pose).is_ok() {
            self.requested |= 1 << pose.min(63);
        }
    }

    /// Poses that were never suggested check the model.
    fn assume_check_pose(&mut self, person: &SimulationHandle) {
        let unused = (0..LIBRARY.len()).filter(|pose| self.requested & (1 << pose) == 0);
        if let Some(pose) = unused.step_by(5).nth(self.check_pose).or(Some(self.check_pose)) {
            // Always valid: the index comes from the library.
            let _ = person.take_pose(pose);
        }
    }

    fn check(&mut self, state: &State, person: &SimulationHandle, now_s: f64, fresh: bool) {
        let invalid = state
            .validity()
            .any_of(Validity::INVALIDATES_COP_MEASURED.and(Validity::INVALIDATES_COP_ESTIMATED));
        if fresh && state.static_pose == 1 && !invalid {
            self.unloaded.add(state);
        }
        if now_s - self.scene_since_s > CHECK_POSE_S * (self.check_pose + 1) as f64 {
            self.check_pose += 1;
            if self.check_pose < CHECK_POSES {
                self.assume_check_pose(person);
            } else {
                person.lift_and_show(BOX_KG);
                self.enter(Scene::Lift, now_s);
            }
        }
    }

    fn lift(&mut self, state: &State, person: &SimulationHandle, now_s: f64, fresh: bool) {
        if fresh && !state.validity().any_of(Validity::INVALIDATES_TORQUES) {
            let time_s = (state.suit_sample_time_ns as f64 - person.start_ns() as f64) * 1e-9;
            let truth = person.truth_at(time_s);
            self.loaded_samples += 1.0;
            self.delta_f_n += state.delta_f_n[2];
            for (sums, (_, name)) in self.joints.iter_mut().zip(JOINTS_SHOWN) {
                let Some(joint) = Joint::named(name).map(Joint::index) else { continue };
                let published = Vector3::from(state.torque_nm[joint]);
                // The published torque includes motion, so compare it with the true torque in motion; the forces of
                // both feet act at the common centre of pressure, as in Eq. 15.
                let real = truth.overload_in_motion_nm[joint];
                sums.published_nm += published.norm();
                sums.true_nm += real.norm();
                sums.published_max_nm = sums.published_max_nm.max(published.norm());
                sums.true_max_nm = sums.true_max_nm.max(real.norm());
                sums.error_nm2 += (published - real).norm_squared();
                sums.sigma_nm += state.torque_sigma_nm[joint];
            }
        }
        if now_s - self.scene_since_s > LIFT_S || now_s > self.duration_s - 0.5 {
            self.enter(Scene::Over, now_s);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_of_the_cop_covers_all_values_and_is_zero_for_one() {
        let mut range = CopRange::default();
        assert_eq!(range.extent_m(), [0.0; 2]);
        range.add([0.5, 0.25]);
        assert_eq!(range.extent_m(), [0.0; 2]);
        range.add([0.75, -0.25]);
        range.add([0.625, 0.0]);
        assert_eq!(range.extent_m(), [0.25, 0.5]);
    }
}
