//! A [`State`] as JSON: one object, the same for `replay --out x.jsonl`, `status --json` and the page.
//!
//! # The contract
//!
//! Keys stand in the order of [`StateJson`]'s fields, so equal states are equal bytes. A key whose value must not be
//! used is **absent**: never `null`, never `NaN`, never a value held over. What is always there: `t`, `cycle`,
//! `phase`, `valid`, `static_pose`, `converged`, `poses_used`, `stance`.
//!
//! `valid` lists the names of the raised reasons ([`Validity::NAMES`]) why values are withheld. It is **empty when
//! every value may be used**: `"valid":[]` is the good case, `"valid":["suit_stale"]` says what is wrong.
//!
//! | key | unit | absent when |
//! |---|---|---|
//! | `suit_age_ns`, `ground_age_ns` | ns | no sample has come yet |
//! | `suggested_pose` | index into the pose library | none is asked for |
//! | `mass_kg` | kg | the mass is not known |
//! | `cop_measured` | m, world x and y | the plate is silent, or the feet are off it |
//! | `cop_estimated`, `cop_sigma`, `com` | m | the suit is silent |
//! | `ground_force_n` | N | the plate is silent or faulty |
//! | `delta_f_n` | N | as `cop_measured`, or the mass is not known |
//! | `zeta` (left, right) | share | the plate or the suit is silent, or the feet are off the plate |
//! | `eta` (left, right) | share | any reason that spoils `load_distance_m`, or the load is not at the hands |
//! | `load_distance_m` | m | any of the above, not identified, moving, or too little load |
//! | `variance_max_m2`, `predicted_cop_sigma_m`, `nis` | m², m, 1 | the filter has not said one yet |
//! | `pose_mismatch_rad` | rad | no pose is asked for, or the suit is silent |
//! | `joints` | MVN name → `torque_nm` (world axes), `sigma_nm`, `level` | any reason at all |

use equipoise_core::body::Joint;
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

/// What spoils the shares of the feet.
const SPOILS_ZETA: Validity = Validity::SPOILS_COP_MEASURED.and(Validity::SPOILS_COP_ESTIMATED);
/// What spoils the distance of the load from the hands. That it is far away does not: it is the evidence.
const SPOILS_LOAD_DISTANCE: Validity = Validity(Validity::SPOILS_TORQUES.0 & !Validity::LOAD_NOT_AT_HANDS.0);

/// A state, ready to be written as one JSON object. Fields are in the order of the keys.
#[derive(Debug, Clone, Serialize)]
pub struct StateJson<'a> {
    t: f64,
    cycle: u64,
    phase: &'static str,
    valid: Vec<&'static str>,
    static_pose: bool,
    converged: bool,
    poses_used: u32,
    stance: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    suggested_pose: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    suit_age_ns: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    ground_age_ns: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mass_kg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cop_measured: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cop_estimated: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cop_sigma: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    com: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    ground_force_n: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    delta_f_n: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    zeta: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    eta: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    load_distance_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    variance_max_m2: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    predicted_cop_sigma_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    nis: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pose_mismatch_rad: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    joints: Option<Joints<'a>>,
}

impl<'a> StateJson<'a> {
    /// The state at `t_s` seconds of the caller's clock: a recording's own time, or CLOCK_MONOTONIC when live.
    pub fn new(state: &'a State, t_s: f64) -> StateJson<'a> {
        let asked = state.suggested_pose != u32::MAX;
        StateJson {
            t: t_s,
            cycle: state.cycle,
            phase: state.phase_name(),
            valid: state.validity().names().collect(),
            static_pose: state.static_pose != 0,
            converged: state.converged != 0,
            poses_used: state.poses_used,
            stance: state.stance,
            suggested_pose: asked.then_some(state.suggested_pose),
            suit_age_ns: (state.suit_sample_time_ns != 0).then_some(state.suit_age_ns),
            ground_age_ns: (state.ground_age_ns != u64::MAX).then_some(state.ground_age_ns),
            mass_kg: state.unless(Validity::MASS_UNKNOWN, state.mass_kg).and_then(finite),
            cop_measured: state
                .unless(Validity::SPOILS_COP_MEASURED, state.cop_measured_m)
                .and_then(all_finite),
            cop_estimated: state
                .unless(Validity::SPOILS_COP_ESTIMATED, state.cop_estimated_m)
                .and_then(all_finite),
            cop_sigma: state.unless(Validity::SPOILS_COP_ESTIMATED, state.cop_sigma_m).and_then(all_finite),
            com: state.unless(Validity::SPOILS_COP_ESTIMATED, state.com_m).and_then(all_finite),
            ground_force_n: state
                .unless(Validity::SPOILS_GROUND_FORCE, state.ground_force_n)
                .and_then(all_finite),
            delta_f_n: state.unless(Validity::SPOILS_DELTA_F, state.delta_f_n).and_then(all_finite),
            zeta: state.unless(SPOILS_ZETA, state.zeta).and_then(all_finite),
            eta: state.unless(Validity::SPOILS_TORQUES, state.eta).and_then(all_finite),
            load_distance_m: state.unless(SPOILS_LOAD_DISTANCE, state.load_distance_m).and_then(finite),
            variance_max_m2: positive(state.variance_max_m2),
            predicted_cop_sigma_m: positive(state.predicted_cop_sigma_m),
            nis: positive(state.nis),
            pose_mismatch_rad: state
                .unless(Validity::SUIT_STALE, state.pose_mismatch_rad)
                .filter(|_| asked)
                .and_then(finite),
            joints: state.unless(Validity::SPOILS_TORQUES, Joints(state)),
        }
    }

    /// The object as text, without a line break.
    pub fn to_text(&self) -> serde_json::Result<String> {
        serde_json::to_string(self)
    }
}

/// The public name of an overload level's number.
pub fn level_name(number: u32) -> &'static str {
    Level::from_number(number).map_or("unknown", Level::name)
}

// JSON has no NaN: serde_json would write `null`. A message never holds one, and if it does, the key is left out.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn all_finite<const N: usize>(values: [f64; N]) -> Option<[f64; N]> {
    values.iter().all(|value| value.is_finite()).then_some(values)
}

/// Variances and squared innovations are zero only before the filter has said one.
fn positive(value: f64) -> Option<f64> {
    finite(value).filter(|value| *value > 0.0)
}

/// The joints of a state as an object, in MVN's order.
#[derive(Debug, Clone, Copy)]
struct Joints<'a>(&'a State);

#[derive(Serialize)]
struct JointJson {
    torque_nm: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    sigma_nm: Option<f64>,
    level: &'static str,
}

impl Serialize for Joints<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for joint in Joint::ALL {
            let index = joint.index();
            if let Some(torque_nm) = all_finite(self.0.torque_nm[index]) {
                let sigma_nm = finite(self.0.torque_sigma_nm[index]);
                let level = level_name(self.0.joint_level[index]);
                map.serialize_entry(joint.name(), &JointJson { torque_nm, sigma_nm, level })?;
            }
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::message::state::Phase;
    use serde_json::Value;

    fn monitoring() -> State {
        let mut state = State::zeroed();
        state.cycle = 7;
        state.phase = Phase::Monitoring as u32;
        state.suit_sample_time_ns = 1;
        state.suit_age_ns = 4_000_000;
        state.ground_age_ns = 900_000;
        state.static_pose = 1;
        state.converged = 1;
        state.poses_used = 12;
        state.stance = 2;
        state.suggested_pose = u32::MAX;
        state.mass_kg = 72.5;
        state.cop_measured_m = [0.0625, -0.01];
        state.cop_estimated_m = [0.03, -0.02];
        state.cop_sigma_m = [0.004, 0.005];
        state.com_m = [0.03, -0.02, 0.98];
        state.ground_force_n = [0.0, 0.0, 800.0];
        state.delta_f_n = [0.0, 0.0, 88.75];
        state.zeta = [0.5, 0.5];
        state.eta = [0.25, 0.75];
        state.load_distance_m = 0.02;
        state.variance_max_m2 = 0.0015;
        state.predicted_cop_sigma_m = 0.006;
        state.nis = 1.5;
        state.torque_nm = [[1.0, -2.5, 0.0]; 22];
        state.torque_sigma_nm = [0.75; 22];
        state.joint_level[0] = 4;
        state
    }

    fn parsed(state: &State) -> Value {
        serde_json::from_str(&StateJson::new(state, 0.25).to_text().unwrap()).unwrap()
    }

    #[test]
    fn a_withheld_state_is_exactly_this_text() {
        let mut state = monitoring();
        state.phase = Phase::Degraded as u32;
        state.valid = Validity::SUIT_STALE.and(Validity::FEET_OFF_PLATE).0;
        assert_eq!(
            StateJson::new(&state, 12.5).to_text().unwrap(),
            r#"{"t":12.5,"cycle":7,"phase":"degraded","valid":["suit_stale","feet_off_plate"],"static_pose":true,"#
                .to_owned()
                + r#""converged":true,"poses_used":12,"stance":2,"suit_age_ns":4000000,"ground_age_ns":900000,"#
                + r#""mass_kg":72.5,"ground_force_n":[0.0,0.0,800.0],"#
                + r#""variance_max_m2":0.0015,"predicted_cop_sigma_m":0.006,"nis":1.5}"#
        );
    }

    #[test]
    fn a_whole_state_is_exactly_this_text_up_to_the_second_joint() {
        let text = StateJson::new(&monitoring(), 12.5).to_text().unwrap();
        let expected = r#"{"t":12.5,"cycle":7,"phase":"monitoring","valid":[],"static_pose":true,"#
            .to_owned()
            + r#""converged":true,"poses_used":12,"stance":2,"suit_age_ns":4000000,"ground_age_ns":900000,"#
            + r#""mass_kg":72.5,"cop_measured":[0.0625,-0.01],"cop_estimated":[0.03,-0.02],"#
            + r#""cop_sigma":[0.004,0.005],"com":[0.03,-0.02,0.98],"ground_force_n":[0.0,0.0,800.0],"#
            + r#""delta_f_n":[0.0,0.0,88.75],"zeta":[0.5,0.5],"eta":[0.25,0.75],"load_distance_m":0.02,"#
            + r#""variance_max_m2":0.0015,"predicted_cop_sigma_m":0.006,"nis":1.5,"#
            + r#""joints":{"L5S1":{"torque_nm":[1.0,-2.5,0.0],"sigma_nm":0.75,"level":"above_max"},"#
            + r#""L4L3":{"torque_nm":[1.0,-2.5,0.0],"sigma_nm":0.75,"level":"none"},"#;
        assert_eq!(&text[..expected.len()], expected);
    }

    #[test]
    fn every_reason_alone_withholds_the_torques_and_names_itself() {
        for (reason, name) in Validity::NAMES {
            let mut state = monitoring();
            state.valid = reason.0;
            let json = parsed(&state);
            assert_eq!(json["valid"], serde_json::json!([name]));
            assert!(json.get("joints").is_none(), "{name}");
        }
    }

    #[test]
    fn the_distance_of_a_load_that_is_not_at_the_hands_is_told() {
        let mut state = monitoring();
        state.valid = Validity::LOAD_NOT_AT_HANDS.0;
        let json = parsed(&state);
        assert!(json.get("eta").is_none());
        assert_eq!(json["load_distance_m"], 0.02);
    }

    #[test]
    fn nothing_is_ever_null() {
        let mut state = monitoring();
        state.com_m[1] = f64::NAN;
        state.nis = f64::INFINITY;
        state.torque_nm[3][0] = f64::NAN;
        state.torque_sigma_nm[4] = f64::NAN;
        let text = StateJson::new(&state, 0.0).to_text().unwrap();
        assert!(!text.contains("null"), "{text}");
        let json = parsed(&state);
        assert!(json.get("com").is_none() && json["joints"].get("T9T8").is_none());
        assert!(json["joints"].get("T1C7").is_some_and(|joint| joint.get("sigma_nm").is_none()));
    }

    #[test]
    fn a_pose_is_mentioned_only_when_asked_for() {
        let mut state = monitoring();
        assert!(parsed(&state).get("pose_mismatch_rad").is_none());
        state.suggested_pose = 3;
        state.pose_mismatch_rad = 0.5;
        let json = parsed(&state);
        assert_eq!((&json["suggested_pose"], &json["pose_mismatch_rad"]), (&3.into(), &0.5.into()));
    }
}
