//! Detects that a worker holds a part with both hands in a static pose, and measures the limit ratio there.

use nalgebra::Vector3;

use super::experience::{Experience, LimitRatio};
use super::worst::{HandFractions, worst};
use super::{Body, FootPlacement, PLACE_MAX_M, Part, WIDTH_M, predict, unfatigued};
use crate::body::{JOINTS, Joint, Side};
use crate::math;
use crate::message::{State, Validity};
use crate::overload::load_position::AHEAD_M;
use crate::static_pose::SPAN_NS;

/// Largest computed cosine of a hand's slope that counts as a level hand: above 1, because the load may be farther ahead
/// of the grip than [`AHEAD_M`] (1-σ 14 mm).
const COSINE_MAX: f64 = 1.2;
/// Fraction of the load in one hand below which the other hand alone holds it: assumed.
const ETA_MIN: f64 = 0.1;

/// A part that was held.
#[derive(Debug, Clone, Copy)]
pub struct Hold {
    /// The part, with the distance between the hands.
    pub part: Part,
    /// The feet.
    pub feet: FootPlacement,
    /// Middle between the grips, world, m.
    pub position_m: Vector3<f64>,
    /// Limit ratio of the worst joint.
    pub measured: LimitRatio,
    /// Fatigue of the joints at that time.
    pub fatigue: [f64; JOINTS],
}

impl Hold {
    /// Adds the hold to the experience with this body, of this stature (m). Returns whether it was added: not where the
    /// prediction calls it infeasible.
    pub fn add_to(&self, experience: &mut Experience, body: &Body, height_m: f64) -> bool {
        let body = Body { fatigue: self.fatigue, ..*body };
        let place_m = self.feet.place_m(self.position_m, height_m);
        predict(&body, &self.feet, &self.part, self.position_m)
            .is_ok_and(|it| experience.observe(place_m, it.worst_ratio.value, self.measured))
    }
}

/// Detects holds in a sequence of states: one for each time that a part is carried, the first one.
#[derive(Debug, Clone, Copy, Default)]
pub struct HoldDetector {
    /// Sample time of the newest state, ns.
    newest_ns: u64,
    /// Sample time at which the present hold began, and its stance.
    since: Option<(u64, u32)>,
    /// The hold of this part is detected already.
    is_detected: bool,
}

impl HoldDetector {
    /// Ingests a state; `grip_m` are the grip points of the left and right hand, from the wrist, hand's axes, m. States may be
    /// missing for one window of the static pose detector, which each static pose covers; after a longer gap, or a step
    /// backward, the hold begins again.
    ///
    /// Returns a hold once static pose and load cover two windows of the static pose detector without a common sample
    /// (0.6 s) in one stance, with every torque valid and the load in both hands.
    pub fn ingest(&mut self, state: &State, grip_m: &[[f64; 3]; 2]) -> Option<Hold> {
        let step_ns = state.suit_sample_time_ns.checked_sub(self.newest_ns);
        self.newest_ns = state.suit_sample_time_ns;
        if step_ns.is_none_or(|step_ns| step_ns > SPAN_NS) {
            self.since = None;
        }
        if state.validity().any_of(Validity::BELOW_LOAD_THRESHOLD) {
            self.is_detected = false;
        }
        let is_held = state.valid == 0 && state.static_pose == 1 && is_in_both_hands(state);
        if !is_held || self.since.is_some_and(|(_, stance)| stance != state.stance) {
            self.since = None;
        }
        if !is_held || self.is_detected {
            return None;
        }
        let (since_ns, _) = *self.since.get_or_insert((state.suit_sample_time_ns, state.stance));
        if state.suit_sample_time_ns.saturating_sub(since_ns) < SPAN_NS {
            return None;
        }
        let hold = hold(state, grip_m)?;
        self.is_detected = true;
        Some(hold)
    }
}

/// Whether both hands hold the load, as predictions assume; they include all fractions.
fn is_in_both_hands(state: &State) -> bool {
    state.hand_load_fraction.iter().all(|eta| *eta >= ETA_MIN)
}

/// A hand that holds a part.
#[derive(Clone, Copy)]
struct Hand {
    /// Grip point, world, m.
    grip_m: Vector3<f64>,
    /// Slope of the hand, rad ([`Part::slope_rad`]); `None`: in line with the forearm.
    slope_rad: Option<f64>,
}

impl Hand {
    /// The hand of a state, computed from the torque of the wrist because states have no orientations. The torque is η ΔF
    /// times the horizontal distance from the wrist to the load: that of the grip, which is `to_grip_m` from the wrist,
    /// plus [`AHEAD_M`]. If no slope explains the torque, the hand is in line with the forearm.
    fn of(state: &State, side: Side, to_grip_m: f64) -> Hand {
        let hand = side.hand();
        let [elbow_m, wrist_m] =
            [hand.index() - 1, hand.index()].map(|segment| Vector3::from(state.segment_origin_m[segment]));
        let forearm_m = wrist_m - elbow_m;
        let in_line = Hand {
            grip_m: wrist_m + forearm_m * (to_grip_m / forearm_m.norm().max(f64::EPSILON)),
            slope_rad: None,
        };
        let wrist = Joint::ALL.into_iter().find(|joint| joint.segment() == hand);
        let [torque_x, torque_y, _] = wrist.map_or([0.0; 3], |wrist| state.torque_nm[wrist.index()]);
        let carried_n = state.hand_load_fraction[side as usize] * state.delta_f_n[2];
        // (x, y, 0) × (0, 0, −F) = (−y F, x F, 0), which the wrist balances.
        let lever = Vector3::new(-torque_y, torque_x, 0.0) / carried_n;
        let cosine = (lever.norm() - AHEAD_M) / to_grip_m;
        if !(0.0..=COSINE_MAX).contains(&cosine) {
            return in_line;
        }
        // A slope up and one down have the same lever: use the one nearer to the forearm's.
        let sign = if forearm_m.z > 0.0 { -1.0 } else { 1.0 };
        let slope_rad = sign * math::acos(cosine.min(1.0));
        let sine = sign * math::sqrt((1.0 - cosine * cosine).max(0.0));
        let along = lever.normalize() * cosine.min(1.0) - Vector3::z() * sine;
        Hand { grip_m: wrist_m + along * to_grip_m, slope_rad: Some(slope_rad) }
    }
}

/// The hold of a state; `None` if the hands are where no part is planned.
fn hold(state: &State, grip_m: &[[f64; 3]; 2]) -> Option<Hold> {
    let held = Side::BOTH.map(|side| Hand::of(state, side, grip_m[side as usize][1].abs()));
    let grip_m = held.map(|hand| hand.grip_m);
    let slope_rad = match held.map(|hand| hand.slope_rad) {
        [Some(left), Some(right)] => Some(0.5 * (left + right)),
        _ => None,
    };
    let width_m = (grip_m[0] - grip_m[1]).norm();
    let feet = FootPlacement::of_segments(&state.segment_origin_m);
    let position_m = 0.5 * (grip_m[0] + grip_m[1]);
    let is_planned = WIDTH_M.contains(&width_m) && (position_m - feet.middle_m()).amax() <= PLACE_MAX_M;
    let ratio = core::array::from_fn(|joint| {
        let limit_nm = state.torque_limit_nm[joint] * unfatigued(state.fatigue[joint]);
        let torque_nm = Vector3::from(state.torque_nm[joint]).norm();
        LimitRatio { value: torque_nm / limit_nm, sigma: state.torque_sigma_nm[joint] / limit_nm }
    });
    let hands = HandFractions { eta: state.hand_load_fraction, sigma: state.hand_load_fraction_sigma };
    let measured = worst(&ratio, &hands)?.ratio;
    let part =
        Part { mass_kg: state.lifted_mass_kg, mass_sigma_kg: state.lifted_mass_sigma_kg, width_m, slope_rad };
    is_planned.then_some(Hold { part, feet, position_m, measured, fatigue: state.fatigue })
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;
    use crate::body::Skeleton;

    const GRIP_M: [[f64; 3]; 2] = [[0.0, 0.09, 0.0], [0.0, -0.09, 0.0]];

    /// A part held with the arms stretched forward, 1 m apart at the shoulders.
    fn held(time_ms: u64) -> State {
        let mut state = State {
            suit_sample_time_ns: time_ms * 1_000_000,
            static_pose: 1,
            stance: 3,
            hand_load_fraction: [0.47, 0.53],
            lifted_mass_kg: 6.0,
            lifted_mass_sigma_kg: 0.2,
            torque_limit_nm: [100.0; JOINTS],
            segment_origin_m: Skeleton::nominal(1.77).t_pose_m(),
            ..State::zeroed()
        };
        for (side, y_m) in Side::BOTH.into_iter().zip([0.2, -0.2]) {
            let hand = side.hand().index();
            state.segment_origin_m[hand - 1] = [0.1, y_m, 1.2];
            state.segment_origin_m[hand] = [0.3, y_m, 1.2];
        }
        state.torque_nm[4] = [3.0, 4.0, 0.0];
        (state.torque_nm[7], state.torque_sigma_nm[7], state.fatigue[7]) = ([0.0, 20.0, 0.0], 2.0, 0.5);
        state
    }

    #[test]
    fn the_limit_ratio_of_the_worst_joint_is_measured_where_the_hands_are() {
        let mut detector = HoldDetector::default();
        assert!((0..6).all(|step| detector.ingest(&held(1000 + 50 * step), &GRIP_M).is_none()));
        let hold = detector.ingest(&held(1310), &GRIP_M).unwrap();
        assert!((hold.position_m - Vector3::new(0.39, 0.0, 1.2)).norm() < 1e-12, "{hold:?}");
        assert!((hold.part.width_m - 0.4).abs() < 1e-12 && hold.part.mass_kg == 6.0);
        // 20 N m of 100 N m, which fatigue has halved.
        assert!((hold.measured.value - 0.4).abs() < 1e-12 && (hold.measured.sigma - 0.04).abs() < 1e-12);
    }

    #[test]
    fn the_torque_of_the_wrists_gives_the_slope_of_the_hands() {
        let slope_rad = 0.8_f64;
        let held = |time_ms: u64| {
            let mut state = held(time_ms);
            state.delta_f_n[2] = 60.0;
            for (side, name) in Side::BOTH.into_iter().zip(["LeftWrist", "RightWrist"]) {
                let lever_m = 0.09 * slope_rad.cos() + AHEAD_M;
                let carried_n = state.hand_load_fraction[side as usize] * 60.0;
                // The load pulls down in front of the wrist: the wrist balances it about the axis to the right.
                state.torque_nm[Joint::named(name).unwrap().index()] = [0.0, -lever_m * carried_n, 0.0];
            }
            state
        };
        let mut detector = HoldDetector::default();
        let holds = (0..10).filter_map(|step| detector.ingest(&held(1000 + 50 * step), &GRIP_M));
        let hold = holds.into_iter().next().unwrap();
        assert!((hold.part.slope_rad.unwrap() - slope_rad).abs() < 1e-9, "{hold:?}");
        let expected_m = Vector3::new(0.3 + 0.09 * slope_rad.cos(), 0.0, 1.2 - 0.09 * slope_rad.sin());
        assert!((hold.position_m - expected_m).norm() < 1e-9, "{hold:?}");
    }

    #[test]
    fn a_hold_begins_again_after_a_gap_or_a_step_backward() {
        for restart_ms in [1400, 900] {
            let mut detector = HoldDetector::default();
            for time_ms in [1000, 1050, restart_ms, restart_ms + 50, restart_ms + 250] {
                assert!(detector.ingest(&held(time_ms), &GRIP_M).is_none(), "{time_ms}");
            }
            assert!(detector.ingest(&held(restart_ms + 310), &GRIP_M).is_some());
        }
    }

    #[test]
    fn a_part_counts_once_until_it_is_put_down() {
        let mut detector = HoldDetector::default();
        let count = |detector: &mut HoldDetector, from_ms: u64| {
            (0..40).filter(|step| detector.ingest(&held(from_ms + 50 * step), &GRIP_M).is_some()).count()
        };
        assert_eq!(count(&mut detector, 0), 1);
        let moving = State { static_pose: 0, ..held(2000) };
        assert!(detector.ingest(&moving, &GRIP_M).is_none());
        assert_eq!(count(&mut detector, 2100), 0);
        let put_down = State { valid: Validity::BELOW_LOAD_THRESHOLD.0, ..held(4200) };
        assert!(detector.ingest(&put_down, &GRIP_M).is_none());
        assert_eq!(count(&mut detector, 4300), 1);
    }

    #[test]
    fn interrupted_one_handed_and_invalid_holds_are_not_used() {
        let changes: [fn(&mut State); 4] = [
            |state| state.static_pose = 0,
            |state| state.valid = Validity::MODEL_CHANGED.0,
            |state| state.hand_load_fraction = [0.05, 0.95],
            |state| state.stance += state.cycle as u32,
        ];
        for (number, change) in changes.into_iter().enumerate() {
            let mut detector = HoldDetector::default();
            for step in 0..40 {
                let mut state = State { cycle: step / 4, ..held(50 * step) };
                // Every 200 ms, or always.
                if step % 4 == 3 || number == 3 {
                    change(&mut state);
                }
                assert!(detector.ingest(&state, &GRIP_M).is_none(), "{number} {step}");
            }
        }
    }
}
