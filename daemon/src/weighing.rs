//! Why the weighing of a subject without a mass does not progress, as a sentence for people.

use equipoise_core::body::Side;
use equipoise_core::message::{State, Validity};
use equipoise_core::time::NS_PER_S;

/// Weighing takes a second of standing, or some seconds of squats: a longer wait has a reason, ns.
const WAIT_MAX_NS: u64 = 5 * NS_PER_S;
/// Maximum distance of the CoP from the line between the ankles, m: the toes of a long foot.
const FOOT_REACH_M: f64 = 0.25;

/// Flags under which a body is not weighed, in the order in which they are remedied.
const OBSTACLES: [(Validity, &str); 9] = [
    (Validity::SUIT_STALE, "the suit sends nothing"),
    (Validity::GROUND_STALE, "the plate sends nothing"),
    (Validity::PLATE_FAULT, "the plate reports a fault"),
    (Validity::GROUND_IMPLAUSIBLE, "the plate's values are implausible"),
    (Validity::SUIT_IMPLAUSIBLE, "the suit's poses are implausible"),
    (Validity::BODY_UNKNOWN, "the suit's bone lengths are unavailable"),
    (Validity::COP_NOT_MEASURED, "the plate measures no centre of pressure"),
    (Validity::FEET_OFF_PLATE, "no person stands on the plate"),
    (Validity::MOVING, "the motion is too quick or has gaps"),
];

/// The reason why the body of a state cannot be weighed, if the state shows one.
pub(crate) fn obstacle(state: &State) -> Option<String> {
    let valid = state.validity();
    if let Some((_, reason)) = OBSTACLES.iter().find(|(flag, _)| valid.any_of(*flag)) {
        return Some((*reason).to_owned());
    }
    // While the position is unavailable, weighing does not use it.
    let distance_m = distance_from_feet_m(state);
    (!valid.any_of(Validity::POSITION_UNKNOWN) && distance_m > FOOT_REACH_M).then(|| {
        format!(
            "the centre of pressure is {distance_m:.2} m from the feet: clear the plate and tare it, restart the suit \
             (its position is then estimated again), or register the plate again"
        )
    })
}

/// Horizontal distance of the measured CoP from the line between the ankles, m.
fn distance_from_feet_m(state: &State) -> f64 {
    let [left, right] = Side::BOTH.map(|side| state.segment_origin_m[side.foot().index()]);
    let along = [right[0] - left[0], right[1] - left[1]];
    let from_left = [state.cop_measured_m[0] - left[0], state.cop_measured_m[1] - left[1]];
    let square_m2 = (along[0] * along[0] + along[1] * along[1]).max(1e-9);
    let fraction = ((from_left[0] * along[0] + from_left[1] * along[1]) / square_m2).clamp(0.0, 1.0);
    (from_left[0] - fraction * along[0]).hypot(from_left[1] - fraction * along[1])
}

/// Observes how long a subject has been without a mass.
#[derive(Debug, Default)]
pub(crate) struct WeighingWatch {
    since_ns: Option<u64>,
}

impl WeighingWatch {
    /// Ingests a state; returns why the weighing does not progress, once it has lasted for long. A silent stream is an
    /// incident of its own.
    pub(crate) fn update(&mut self, state: &State) -> Option<String> {
        let valid = state.validity();
        let is_silent = valid.any_of(Validity::SUIT_STALE.and(Validity::GROUND_STALE));
        if !valid.any_of(Validity::MASS_UNKNOWN) || is_silent {
            self.since_ns = None;
            return None;
        }
        let lasts_ns = state.time_ns.saturating_sub(*self.since_ns.get_or_insert(state.time_ns));
        (lasts_ns >= WAIT_MAX_NS).then(|| {
            let reason = obstacle(state)
                .unwrap_or_else(|| "stand still on the plate with both feet and empty hands".to_owned());
            format!("not weighed for {} s: {reason}", lasts_ns / NS_PER_S)
        })
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    /// A state with feet 0.3 m apart, whose CoP is this far ahead of them, m.
    fn state(time_s: u64, ahead_m: f64, valid: Validity) -> State {
        let mut state = State { time_ns: time_s * NS_PER_S, valid: valid.0, ..State::zeroed() };
        for (side, y_m) in Side::BOTH.into_iter().zip([0.15, -0.15]) {
            state.segment_origin_m[side.foot().index()] = [0.5, y_m, 0.1];
        }
        state.cop_measured_m = [0.5 + ahead_m, 0.05];
        state
    }

    #[test]
    fn a_subject_who_is_not_weighed_for_long_has_a_reason() {
        let wait = Validity::MASS_UNKNOWN;
        for (ahead_m, flag, part) in [
            (0.1, Validity::default(), "stand still on the plate with both feet"),
            (0.4, Validity::default(), "0.40 m from the feet"),
            (0.4, Validity::POSITION_UNKNOWN, "stand still on the plate with both feet"),
            (0.4, Validity::FEET_OFF_PLATE, "no person stands on the plate"),
            (0.1, Validity::GROUND_IMPLAUSIBLE, "values are implausible"),
        ] {
            let mut watch = WeighingWatch::default();
            assert_eq!(watch.update(&state(100, ahead_m, wait.and(flag))), None, "{part}");
            assert_eq!(watch.update(&state(104, ahead_m, wait.and(flag))), None, "{part}");
            let reason = watch.update(&state(106, ahead_m, wait.and(flag))).unwrap();
            assert!(reason.starts_with("not weighed for 6 s: ") && reason.contains(part), "{reason}");
        }
    }

    #[test]
    fn the_wait_begins_again_with_a_mass_and_after_a_silence() {
        for other in [Validity::default(), Validity::MASS_UNKNOWN.and(Validity::SUIT_STALE)] {
            let mut watch = WeighingWatch::default();
            let mut reason = |time_s: u64, valid: Validity| watch.update(&state(time_s, 0.1, valid));
            assert_eq!(reason(100, Validity::MASS_UNKNOWN), None);
            assert_eq!(reason(110, other), None);
            assert_eq!(reason(111, Validity::MASS_UNKNOWN), None);
            assert!(reason(116, Validity::MASS_UNKNOWN).is_some());
        }
    }
}
