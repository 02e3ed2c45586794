//! A [`State`] as JSON: one object, the same for `replay --out x.jsonl`, `status --json` and the page.
//!
//! # The contract
//!
//! Keys are in the order of the fields, so equal states have equal bytes. The key of an invalid value is
//! **absent**: never `null`, never `NaN`, never an outdated value. Always present: `t`, `cycle`, `phase`, `valid`,
//! `static_pose`, `converged`, `poses_used`, `stance`, `motion_samples_used`, `group_delay_ns`, and the sums over the
//! shift: `lifts`, `dose_damage`, `dose_probability`, `fatigue`.
//!
//! `valid` lists the names of the raised flags ([`Validity::NAMES`]). It is **empty if all values are valid**:
//! `"valid":[]` is the normal case, `"valid":["suit_stale"]` the reason of a fault.
//!
//! | key | unit | absent when |
//! |---|---|---|
//! | `suit_age_ns`, `ground_age_ns` | ns | no sample has arrived |
//! | `suggested_pose` | index into the pose library | none is suggested |
//! | `unavailable`: quantities that the sensors do not provide (`suit_com`, `shear`) | names | all are provided |
//! | `mass_kg` | kg | the mass is unavailable |
//! | `body_source`: source of the segment lengths (`poses`, `null_pose`, `stored`) | | they are unavailable |
//! | `foot_outline_source`: source of the foot outlines (`stature`, `suit`) | | never |
//! | `body_rejected`: reason why the suit's null pose is not used | name | it is used, or none was sent |
//! | `motion_samples_used` | count | never |
//! | `group_delay_ns`: delay of the results behind the newest suit sample | ns | never |
//! | `cop_measured`, `cop_measured_sigma` | m, world x and y | the plate is silent, or the feet are off it |
//! | `cop_estimated`, `cop_sigma`, `com` | m | the suit is silent or implausible |
//! | `suit_com`: centre of mass computed by the suit's software, world | m | as `com`, or the suit does not send it |
//! | `acceleration_source` (`positions`, `suit`) | | as `com` |
//! | `ground_force_n` | N | the plate is silent or faulty, or shear is not measured |
//! | `vertical_force_n` | N | the plate is silent or faulty |
//! | `ground_devices`: devices in the ground sample (`plate`, `second_plate`, `insoles`) | names | as `vertical_force_n`, or unavailable |
//! | `delta_f_n` (x and y: always 0, not published), `delta_f_sigma_n` (vertical) | N | as `cop_measured`, or mass or body is unavailable |
//! | `lifted_mass_kg`, `lifted_mass_sigma_kg` | kg | as `delta_f_n`, or too little load, or moving |
//! | `foot_load_fraction` (left, right), `foot_load_fraction_sigma`, `sharing_source` (`geometry`, `measured`) | 0 to 1 | any flag is raised |
//! | `hand_load_fraction` (left, right), `hand_load_fraction_sigma` | 0 to 1 | any flag is raised |
//! | `load_hand_distance_m` | m | any flag except `load_not_at_hands` is raised |
//! | `reach_m`, `reach_sigma_m`: load from the midpoint of the ankles | m | any flag is raised |
//! | `variance_max_m2`, `predicted_cop_sigma_m`, `nis`, `prior_inflation` | m², m, 1, 1 | the filter has not computed it |
//! | `pose_mismatch_rad` | rad | no pose is suggested, or the suit is silent or implausible |
//! | `suit_skew_s`, `suit_skew_sigma_s` | s | the motion has not determined the skew |
//! | `l5s1_moment_nm`, `l5s1_moment_sigma_nm` | N m | any flag except `below_load_threshold` is raised |
//! | `l5s1_compression_n`, `l5s1_compression_sigma_n` | N | as `l5s1_moment_nm` |
//! | `lifts`, `dose_damage` (1: failure), `dose_probability` (0 to 1) | count, 1, 1 | never |
//! | `worst_joint`: MVN name of the joint closest to its limit | | any flag is raised |
//! | `advice_direction`: unit vector, world axes | 1 | as `worst_joint`, or no motion of the load relieves it |
//! | `advice_gain_nm_per_cm` | N m/cm | as `advice_direction` |
//! | `fatigue` | MVN name → 0 to 1 | never |
//! | `joints` | MVN name → `torque_nm` (world axes), `sigma_nm`, `level`, `limit_nm`, `fatigue` | any flag is raised |
//!
//! The `level` of a joint is `none`, `green`, `orange`, `red`, `above_max`, or `undecided` if the uncertainty of the
//! torque covers two levels.

mod groups;
mod joints;
pub mod schema;
#[cfg(test)]
pub(crate) mod tests;

use equipoise_core::body::Joint;
use equipoise_core::message::state::Unavailable;
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;
use serde::Serialize;

use groups::{Advice, Body, Filter, Forces, LoadPosition, LowBack, Motion};
use joints::{Joints, PerJoint};

/// A state, ready to be written as one JSON object. Fields, also those of flattened groups, are in the order of the keys.
#[derive(Debug, Clone, Serialize)]
pub struct StateJson<'a> {
    t: f64,
    cycle: u64,
    phase: &'static str,
    valid: Vec<&'static str>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    unavailable: Vec<&'static str>,
    static_pose: bool,
    converged: bool,
    poses_used: u32,
    stance: u32,
    motion_samples_used: u32,
    group_delay_ns: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    suggested_pose: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    suit_age_ns: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    ground_age_ns: Option<u64>,
    #[serde(flatten)]
    body: Body,
    #[serde(flatten)]
    motion: Motion,
    #[serde(flatten)]
    forces: Forces,
    #[serde(flatten)]
    load_position: LoadPosition,
    #[serde(flatten)]
    filter: Filter,
    #[serde(flatten)]
    low_back: LowBack,
    #[serde(flatten)]
    advice: Advice,
    fatigue: PerJoint<'a>,
    #[serde(skip_serializing_if = "Option::is_none")]
    joints: Option<Joints<'a>>,
}

impl<'a> StateJson<'a> {
    /// The state at `t_s` seconds of the caller's clock: a recording's own time, or CLOCK_MONOTONIC when live.
    pub fn new(state: &'a State, t_s: f64) -> StateJson<'a> {
        StateJson {
            t: t_s,
            cycle: state.cycle,
            phase: state.phase_name(),
            valid: state.validity().names().collect(),
            unavailable: named(Unavailable::NAMES.map(|(bit, name)| (bit as u32, name)), state.unavailable),
            static_pose: state.static_pose != 0,
            converged: state.converged != 0,
            poses_used: state.poses_used,
            stance: state.stance,
            motion_samples_used: state.motion_samples_used,
            group_delay_ns: state.group_delay_ns,
            suggested_pose: Some(state.suggested_pose).filter(|pose| *pose != u32::MAX),
            suit_age_ns: (state.suit_sample_time_ns != 0).then_some(state.suit_age_ns),
            ground_age_ns: (state.ground_age_ns != u64::MAX).then_some(state.ground_age_ns),
            body: Body::of(state),
            motion: Motion::of(state),
            forces: Forces::of(state),
            load_position: LoadPosition::of(state),
            filter: Filter::of(state),
            low_back: LowBack::of(state),
            advice: Advice::of(state),
            fatigue: PerJoint(&state.fatigue),
            joints: state.unless(Validity::INVALIDATES_TORQUES, Joints(state)),
        }
    }

    /// The same without what a body is alone: its mass, and where its centre is.
    #[must_use]
    pub fn without_body(mut self) -> StateJson<'a> {
        self.body.mass_kg = None;
        (self.motion.com, self.motion.suit_com, self.motion.acceleration_source) = (None, None, None);
        self
    }

    /// The object as text, without a line break.
    pub fn to_text(&self) -> serde_json::Result<String> {
        serde_json::to_string(self)
    }
}

/// The names of the bits that are set.
fn named<const N: usize>(names: [(u32, &'static str); N], bits: u32) -> Vec<&'static str> {
    names.into_iter().filter(|(bit, _)| bits & bit != 0).map(|(_, name)| name).collect()
}

/// The public name of an overload level's number.
pub fn level_name(number: u32) -> &'static str {
    Level::from_number(number).map_or("unknown", Level::name)
}

/// The joint that comes closest to its limit; `None` while torques are withheld.
pub(crate) fn worst_joint(state: &State) -> Option<Joint> {
    let index = state.unless(Validity::INVALIDATES_TORQUES, state.worst_joint)?;
    Joint::ALL.get(index as usize).copied()
}

// JSON has no NaN: serde_json would write `null`. Messages never contain NaN; if one did, the key would be left out.
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
