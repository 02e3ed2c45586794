//! Tasks of a session: identification, check poses, a lift, work without a load.

use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{State, Validity};
use equipoise_core::pose_suggestion::Posture;
use equipoise_simulator::intention::{Arm, Intention};
use equipoise_simulator::motion::Worker;
use equipoise_simulator::repertoire::LIFTING;

use crate::mixtures::mixtures;
use crate::session::{Session, Snapshot};

/// Time that a worker takes to take a pose, s.
pub const POSE_S: f64 = 1.8;
/// A pose not accepted within this is replaced by another, s.
const PATIENCE_S: f64 = 6.0;
/// Duration of a static window when time leaps between poses, s: the window of 20 samples, and the margin that a
/// centred motion filter may require around it.
const WINDOW_S: f64 = 0.6;
/// Duration from one pose of work to the next at natural speed, s.
const NATURAL_S: f64 = 1.0;

/// Result of an identification.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Identified {
    /// Poses that entered the filter.
    pub poses: u32,
    /// Whether the stop rule was met; otherwise identification was stopped at the maximum number of poses.
    pub converged: bool,
    /// Its duration, s of simulated time.
    pub seconds: f64,
    /// The filter's predicted standard deviation of the centre of pressure, m.
    pub predicted_cop_sigma_m: f64,
    /// The largest P_jj, m².
    pub variance_max_m2: f64,
}

/// Whether centre of pressure is reported both as measured and as estimated.
pub fn publishes_cop(state: &State) -> bool {
    !state.validity().any_of(Validity::INVALIDATES_COP_MEASURED.and(Validity::INVALIDATES_COP_ESTIMATED))
}

/// Whether torques are reported.
pub fn publishes_torques(state: &State) -> bool {
    !state.validity().any_of(Validity::INVALIDATES_TORQUES)
}

impl Session {
    /// The worker takes the suggested poses until the stop rule is met or `max_poses` are used; every sample of the
    /// motion between them is measured. Afterwards the estimator monitors.
    pub fn identify(&mut self, max_poses: u32) -> Identified {
        self.identify_in_steps(max_poses, false, |_| {})
    }

    /// The same, skipping the motion between the poses: only a static window of each is measured.
    pub fn identify_by_windows(&mut self, max_poses: u32) -> Identified {
        self.identify_in_steps(max_poses, true, |_| {})
    }

    /// Identification, with a callback on the session after each pose used.
    pub fn identify_in_steps(
        &mut self,
        max_poses: u32,
        leaping: bool,
        mut after_each: impl FnMut(&Session),
    ) -> Identified {
        let start_s = self.now_s();
        // Segment lengths first, while standing; then a pose can be suggested.
        self.run_until(PATIENCE_S, |snapshot| snapshot.state.suggested_pose != u32::MAX);
        let mut refused = 0;
        while self.state().converged == 0 && self.state().poses_used < max_poses && refused < 50 {
            let library = self.settings().library;
            let suggested = self.state().suggested_pose as usize;
            // As a worker would: if a pose is not accepted, try another one.
            let Some(posture) = library.get((suggested + 7 * refused) % library.len().max(1)) else { break };
            if self.learn(posture, leaping) {
                refused = 0;
                after_each(self);
            } else {
                refused += 1;
            }
        }
        let converged = self.state().converged == 1;
        let identified = Identified {
            poses: self.state().poses_used,
            converged,
            seconds: self.now_s() - start_s,
            predicted_cop_sigma_m: self.state().predicted_cop_sigma_m,
            variance_max_m2: self.state().variance_max_m2,
        };
        if !converged {
            self.command(CommandKind::IdentifyStop);
        }
        identified
    }

    /// Takes a pose and holds it until it is used; gives up after a while.
    fn learn(&mut self, posture: &Posture, leaping: bool) -> bool {
        let used = self.state().poses_used;
        self.take_pose(posture, POSE_S);
        let hold_s = if leaping {
            self.leap(POSE_S + 0.1);
            2.0 * WINDOW_S
        } else {
            PATIENCE_S
        };
        self.run_until(hold_s, |snapshot| snapshot.state.poses_used > used)
    }

    /// Takes a pose as commanded, skipping the motion to it; `see` receives every state of the static worker.
    pub fn hold(&mut self, order: impl FnOnce(&mut Worker, f64), mut see: impl FnMut(&Snapshot)) {
        self.order(order);
        self.leap(POSE_S + 0.1);
        self.run(WINDOW_S, |snapshot| {
            if snapshot.state.static_pose == 1 {
                see(snapshot);
            }
        });
    }

    /// Holds `count` poses outside the library: mixtures by the subject's seed.
    pub fn hold_unknown(&mut self, count: usize, mut see: impl FnMut(&Snapshot)) {
        for mixture in mixtures(self.worker(), self.subject().seed, count) {
            self.hold(|worker, at_s| worker.intend(&mixture, at_s, POSE_S), &mut see);
        }
    }

    /// Centre of pressure in `count` poses outside the library.
    pub fn hold_out(&mut self, count: usize) -> CopErrors {
        let mut errors = CopErrors::default();
        self.hold_unknown(count, |snapshot| errors.add(snapshot));
        errors
    }

    /// The worker picks up a box, moves it and puts it down, as the demonstration does.
    pub fn lift(&mut self, mass_kg: f64, see: impl FnMut(&Snapshot)) {
        self.order(|worker, at_s| worker.lift_and_show(mass_kg, at_s));
        self.run(16.5, see);
    }

    /// The worker lifts a box from a table, carries it and puts it back, at natural speed, without a rest.
    pub fn lift_at_work(&mut self, mass_kg: f64, see: impl FnMut(&Snapshot)) {
        let [reach, close, stretched, raised, _] = LIFTING;
        let turned = |twist_deg: f64| Intention {
            pelvis_deg: [0.0, 0.0, 0.3 * twist_deg],
            trunk_twist_deg: twist_deg,
            ..close
        };
        let script = [reach, close, turned(30.0), turned(-30.0), stretched, close, raised, close, reach];
        let seconds = self.perform(&script, NATURAL_S);
        self.order(|worker, at_s| {
            worker.lift(mass_kg, at_s + NATURAL_S);
            worker.put_down(at_s + seconds - 0.5);
        });
        self.run(seconds + 1.0, see);
    }

    /// Bends, reaches and squats at natural speed without a load.
    pub fn work_unloaded(&mut self, see: impl FnMut(&Snapshot)) {
        let stand = Intention::STAND;
        let arm = |elevation_deg, forward_deg| Arm {
            elevation_deg,
            forward_deg,
            outward_deg: 40.0,
            elbow_deg: 15.0,
        };
        let [reach, close, stretched, raised, _] = LIFTING;
        let bend =
            Intention { pelvis_deg: [30.0, 0.0, 0.0], trunk_flex_deg: 30.0, ..stand.arms(arm(50.0, 85.0)) };
        let squat =
            Intention { pelvis_drop: 0.25, pelvis_deg: [30.0, 0.0, 0.0], ..stand.arms(arm(45.0, 85.0)) };
        let aside = Intention { right_arm: arm(85.0, 20.0), trunk_side_deg: 15.0, ..stand };
        let turned = Intention { trunk_twist_deg: 30.0, left_arm: arm(80.0, 80.0), ..stand };
        let script = [bend, stand, reach, raised, close, squat, stand, aside, turned, stretched, bend, stand];
        let seconds = self.perform(&script, NATURAL_S);
        self.run(seconds, see);
    }

    /// The worker stands up straight and remains so.
    pub fn stand(&mut self, seconds: f64) {
        self.perform(&[Intention::STAND], NATURAL_S);
        self.run(NATURAL_S + seconds, |_| {});
    }

    /// The worker marches on the spot.
    pub fn march(&mut self, steps: u32, see: impl FnMut(&Snapshot)) {
        let mut end_s = 0.0;
        self.order(|worker, at_s| end_s = worker.march_on_the_spot(at_s, steps));
        self.run(end_s - self.now_s(), see);
    }

    /// One intention after another, each started when the previous is reached; returns the total duration, s.
    fn perform(&mut self, script: &[Intention], each_s: f64) -> f64 {
        self.order(|worker, at_s| {
            for (index, intention) in script.iter().enumerate() {
                worker.intend(intention, at_s + index as f64 * each_s, each_s);
            }
        });
        script.len() as f64 * each_s
    }
}

/// Errors of the centre of pressure: model against plate.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CopErrors {
    /// Number of states.
    pub samples: u64,
    square_m2: [f64; 2],
    low_m: [f64; 2],
    high_m: [f64; 2],
}

impl CopErrors {
    /// Adds a state if it reports both.
    pub fn add(&mut self, snapshot: &Snapshot) {
        let state = snapshot.state;
        if !publishes_cop(state) {
            return;
        }
        for axis in 0..2 {
            let (measured, estimated) = (state.cop_measured_m[axis], state.cop_estimated_m[axis]);
            self.square_m2[axis] += (measured - estimated).powi(2);
            let first = self.samples == 0;
            self.low_m[axis] = if first { measured } else { self.low_m[axis].min(measured) };
            self.high_m[axis] = if first { measured } else { self.high_m[axis].max(measured) };
        }
        self.samples += 1;
    }

    /// Adds another sum.
    pub fn merge(&mut self, other: &CopErrors) {
        if self.samples == 0 || other.samples == 0 {
            *self = if self.samples == 0 { *other } else { *self };
            return;
        }
        self.samples += other.samples;
        for axis in 0..2 {
            self.square_m2[axis] += other.square_m2[axis];
            self.low_m[axis] = self.low_m[axis].min(other.low_m[axis]);
            self.high_m[axis] = self.high_m[axis].max(other.high_m[axis]);
        }
    }

    /// Root mean square per axis, forward and sideways, m.
    pub fn rms_m(&self) -> [f64; 2] {
        self.square_m2.map(|square| (square / self.samples.max(1) as f64).sqrt())
    }

    /// Root mean square distance, m.
    pub fn distance_rms_m(&self) -> f64 {
        let [x, y] = self.rms_m();
        x.hypot(y)
    }

    /// Range of the measured values per axis, m.
    pub fn range_m(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.high_m[axis] - self.low_m[axis])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subject::Subject;
    use equipoise_simulator::realism::Realism;

    #[test]
    fn who_says_what_is_measured_errs_by_nothing() {
        let subject = Subject { realism: Realism::IDEAL, ..Subject::random(2) };
        let mut session = Session::new(&subject, subject.settings());
        session.run(1.0, |_| {});
        let (mut perfect, mut off) = (CopErrors::default(), CopErrors::default());
        session.hold_unknown(2, |snapshot| {
            let mut state = *snapshot.state;
            state.cop_estimated_m = state.cop_measured_m;
            perfect.add(&Snapshot { state: &state, ..*snapshot });
            state.cop_estimated_m[1] += 0.003;
            off.add(&Snapshot { state: &state, ..*snapshot });
        });
        assert!(perfect.samples >= 20, "{}", perfect.samples);
        assert_eq!(perfect.distance_rms_m(), 0.0);
        assert!((off.distance_rms_m() - 0.003).abs() < 1e-12 && off.rms_m()[0] == 0.0);
    }

    #[test]
    fn a_lift_has_a_box_in_the_hands_and_work_without_a_load_has_none() {
        let subject = Subject::random(2);
        let mut session = Session::new(&subject, subject.settings());
        session.run(0.5, |_| {});
        let (mut lifted, mut all) = (0, 0);
        session.lift_at_work(6.0, |snapshot| {
            let truth = snapshot.truth();
            all += 1;
            lifted += u64::from(truth.body.load_kg == 6.0 && truth.overload_in_motion_nm[0].norm() > 1.0);
        });
        assert!(lifted * 2 > all, "{lifted} of {all}");
        session.stand(0.5);
        session.work_unloaded(|snapshot| assert_eq!(snapshot.worker.sample(snapshot.time_s).load_kg, 0.0));
    }
}
