//! A [`State`] as JSON: one object, the same for `replay --out x.jsonl`, `status --json` and the page.
//!
//! # The contract
//!
//! Keys are in the order of [`StateJson`]'s fields, so equal states have equal bytes. The key of an invalid value is
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

mod joints;
pub mod schema;
#[cfg(test)]
pub(crate) mod tests;

use equipoise_core::body::Joint;
use equipoise_core::cycle::{BodyRejection, BodySource};
use equipoise_core::message::state::{AccelerationSource, FootOutlineSource, SharingSource, Unavailable};
use equipoise_core::message::{GroundDevice, State, Validity};
use equipoise_core::overload::Level;
use serde::Serialize;

use joints::{Joints, PerJoint};

/// A state, ready to be written as one JSON object. Fields are in the order of the keys.
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
    #[serde(skip_serializing_if = "Option::is_none")]
    mass_kg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    body_source: Option<&'static str>,
    foot_outline_source: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    body_rejected: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cop_measured: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cop_measured_sigma: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cop_estimated: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cop_sigma: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    com: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    suit_com: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    acceleration_source: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    ground_force_n: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    vertical_force_n: Option<f64>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    ground_devices: Vec<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    delta_f_n: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    delta_f_sigma_n: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lifted_mass_kg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lifted_mass_sigma_kg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    foot_load_fraction: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    foot_load_fraction_sigma: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sharing_source: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    hand_load_fraction: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    hand_load_fraction_sigma: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    load_hand_distance_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    reach_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    reach_sigma_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    variance_max_m2: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    predicted_cop_sigma_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    nis: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    prior_inflation: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pose_mismatch_rad: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    suit_skew_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    suit_skew_sigma_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    l5s1_moment_nm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    l5s1_moment_sigma_nm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    l5s1_compression_n: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    l5s1_compression_sigma_n: Option<f64>,
    lifts: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    dose_damage: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dose_probability: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    worst_joint: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    advice_direction: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    advice_gain_nm_per_cm: Option<f64>,
    fatigue: PerJoint<'a>,
    #[serde(skip_serializing_if = "Option::is_none")]
    joints: Option<Joints<'a>>,
}

impl<'a> StateJson<'a> {
    /// The state at `t_s` seconds of the caller's clock: a recording's own time, or CLOCK_MONOTONIC when live.
    pub fn new(state: &'a State, t_s: f64) -> StateJson<'a> {
        let back = |value: f64| state.unless(Validity::INVALIDATES_LOW_BACK, value).and_then(finite);
        let lifted = |value: f64| state.unless(Validity::INVALIDATES_LIFTED_MASS, value).and_then(finite);
        let skew = |value: f64| (state.suit_skew_sigma_s > 0.0).then_some(value).and_then(finite);
        let advised = state.advice_direction != [0.0; 3];
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
            mass_kg: state.unless(Validity::MASS_UNKNOWN, state.mass_kg).and_then(finite),
            body_source: BodySource::from_number(state.body_source)
                .filter(|source| *source != BodySource::Unknown)
                .map(BodySource::name),
            foot_outline_source: FootOutlineSource::from_number(state.foot_outline_source)
                .map_or("unknown", FootOutlineSource::name),
            body_rejected: BodyRejection::from_number(state.body_rejected)
                .filter(|refusal| *refusal != BodyRejection::None)
                .map(BodyRejection::name),
            cop_measured: state
                .unless(Validity::INVALIDATES_COP_MEASURED, state.cop_measured_m)
                .and_then(all_finite),
            cop_measured_sigma: state
                .unless(Validity::INVALIDATES_COP_MEASURED, state.cop_measured_sigma_m)
                .filter(|sigma_m| sigma_m.iter().all(|sigma_m| *sigma_m > 0.0))
                .and_then(all_finite),
            cop_estimated: state
                .unless(Validity::INVALIDATES_COP_ESTIMATED, state.cop_estimated_m)
                .and_then(all_finite),
            cop_sigma: state
                .unless(Validity::INVALIDATES_COP_ESTIMATED, state.cop_sigma_m)
                .and_then(all_finite),
            com: state.unless(Validity::INVALIDATES_COM, state.com_m).and_then(all_finite),
            suit_com: state.suit_com_m().and_then(all_finite),
            acceleration_source: state
                .unless(Validity::INVALIDATES_COM, state.acceleration_source)
                .and_then(AccelerationSource::from_number)
                .map(AccelerationSource::name),
            ground_force_n: state
                .unless(Validity::INVALIDATES_GROUND_FORCE, state.ground_force_n)
                .filter(|_| state.provides(Unavailable::Shear))
                .and_then(all_finite),
            vertical_force_n: state
                .unless(Validity::INVALIDATES_GROUND_FORCE, state.ground_force_n[2])
                .and_then(finite),
            ground_devices: named(
                GroundDevice::NAMES.map(|(bit, name)| (bit as u32, name)),
                state.unless(Validity::INVALIDATES_GROUND_FORCE, state.ground_devices).unwrap_or(0),
            ),
            delta_f_n: state.unless(Validity::INVALIDATES_DELTA_F, state.delta_f_n).and_then(all_finite),
            delta_f_sigma_n: state
                .unless(Validity::INVALIDATES_DELTA_F, state.delta_f_sigma_n)
                .and_then(positive),
            lifted_mass_kg: lifted(state.lifted_mass_kg),
            lifted_mass_sigma_kg: lifted(state.lifted_mass_sigma_kg),
            foot_load_fraction: state
                .unless(Validity::INVALIDATES_TORQUES, state.foot_load_fraction)
                .and_then(all_finite),
            foot_load_fraction_sigma: state
                .unless(Validity::INVALIDATES_TORQUES, state.foot_load_fraction_sigma)
                .and_then(finite),
            sharing_source: state
                .unless(Validity::INVALIDATES_TORQUES, state.sharing_source)
                .and_then(SharingSource::from_number)
                .map(SharingSource::name),
            hand_load_fraction: state
                .unless(Validity::INVALIDATES_TORQUES, state.hand_load_fraction)
                .and_then(all_finite),
            hand_load_fraction_sigma: state
                .unless(Validity::INVALIDATES_TORQUES, state.hand_load_fraction_sigma)
                .and_then(finite),
            load_hand_distance_m: state
                .unless(Validity::INVALIDATES_LOAD_HAND_DISTANCE, state.load_hand_distance_m)
                .and_then(finite),
            reach_m: state.unless(Validity::INVALIDATES_TORQUES, state.reach_m).and_then(finite),
            reach_sigma_m: state.unless(Validity::INVALIDATES_TORQUES, state.reach_sigma_m).and_then(finite),
            variance_max_m2: positive(state.variance_max_m2),
            predicted_cop_sigma_m: positive(state.predicted_cop_sigma_m),
            nis: positive(state.nis),
            prior_inflation: positive(state.prior_inflation),
            pose_mismatch_rad: state.pose_mismatch_rad().and_then(finite),
            suit_skew_s: skew(state.suit_skew_s),
            suit_skew_sigma_s: skew(state.suit_skew_sigma_s),
            l5s1_moment_nm: back(state.l5s1_moment_nm),
            l5s1_moment_sigma_nm: back(state.l5s1_moment_sigma_nm),
            l5s1_compression_n: back(state.l5s1_compression_n),
            l5s1_compression_sigma_n: back(state.l5s1_compression_sigma_n),
            lifts: state.lifts,
            dose_damage: finite(state.dose_damage),
            dose_probability: finite(state.dose_probability),
            worst_joint: worst_joint(state).map(Joint::name),
            advice_direction: state
                .unless(Validity::INVALIDATES_TORQUES, state.advice_direction)
                .filter(|_| advised)
                .and_then(all_finite),
            advice_gain_nm_per_cm: state
                .unless(Validity::INVALIDATES_TORQUES, state.advice_gain_nm_per_cm)
                .filter(|_| advised)
                .and_then(finite),
            fatigue: PerJoint(&state.fatigue),
            joints: state.unless(Validity::INVALIDATES_TORQUES, Joints(state)),
        }
    }

    /// The same without what a body is alone: its mass, and where its centre is.
    #[must_use]
    pub fn without_body(self) -> StateJson<'a> {
        StateJson { mass_kg: None, com: None, suit_com: None, acceleration_source: None, ..self }
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
