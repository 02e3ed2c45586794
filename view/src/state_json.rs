//! A [`State`] as JSON: one object, the same for `replay --out x.jsonl`, `status --json` and the page.
//!
//! # The contract
//!
//! Keys stand in the order of [`StateJson`]'s fields, so equal states are equal bytes. A key whose value must not be
//! used is **absent**: never `null`, never `NaN`, never a value held over. What is always there: `t`, `cycle`,
//! `phase`, `valid`, `static_pose`, `converged`, `poses_used`, `stance`, `motion_samples_used`, `group_delay_ns`, and what
//! has added up over the shift: `lifts`, `dose_damage`, `dose_probability`, `fatigue`.
//!
//! `valid` lists the names of the raised reasons ([`Validity::NAMES`]) why values are withheld. It is **empty when
//! every value may be used**: `"valid":[]` is the good case, `"valid":["suit_stale"]` says what is wrong.
//!
//! | key | unit | absent when |
//! |---|---|---|
//! | `suit_age_ns`, `ground_age_ns` | ns | no sample has come yet |
//! | `suggested_pose` | index into the pose library | none is asked for |
//! | `not_given`: what the station's sensors do not give (`suit_com`, `shear`) | names | they give all |
//! | `mass_kg` | kg | the mass is not known |
//! | `body_source`: where the bones come from (`poses`, `null_pose`, `stored`) | | the bones are not known |
//! | `sole_source`: where the soles' outline comes from (`stature`, `suit`) | | never |
//! | `body_refused`: why the suit's null pose is not used | name | it is used, or none was sent |
//! | `motion_samples_used` | count | never |
//! | `group_delay_ns`: how far the values lie behind the newest suit sample | ns | never |
//! | `cop_measured`, `cop_measured_sigma` | m, world x and y | the plate is silent, or the feet are off it |
//! | `cop_estimated`, `cop_sigma`, `com` | m | the suit is silent |
//! | `com_suit`: the suit maker's own centre of mass, station's world | m | the suit is silent, or does not send it |
//! | `acceleration_source` (`positions`, `suit`) | | as `com` |
//! | `ground_force_n` | N | the plate is silent or faulty, or shear is not measured |
//! | `vertical_force_n` | N | the plate is silent or faulty |
//! | `ground_devices`: what the ground's sample is made of (`plate`, `second_plate`, `insoles`) | names | as `vertical_force_n`, or it was not said |
//! | `delta_f_n`, `delta_f_sigma_n` (vertical) | N | as `cop_measured`, or the mass is not known |
//! | `lifted_mass_kg`, `lifted_mass_sigma_kg` | kg | as `delta_f_n`, or too little load, or moving |
//! | `zeta` (left, right), `zeta_sigma`, `sharing_source` (`geometry`, `measured`) | share | the plate or the suit is silent, or the feet are off the plate |
//! | `eta` (left, right), `eta_sigma` | share | any reason that spoils `load_distance_m`, or the load is not at the hands |
//! | `load_distance_m` | m | any of the above, not identified, moving, or too little load |
//! | `reach_m`, `reach_sigma_m`: load from the middle of the ankles | m | any reason at all |
//! | `variance_max_m2`, `predicted_cop_sigma_m`, `nis`, `prior_inflation` | m², m, 1, 1 | the filter has not said one yet |
//! | `pose_mismatch_rad` | rad | no pose is asked for, or the suit is silent |
//! | `suit_skew_s`, `suit_skew_sigma_s` | s | the motion has not shown the skew |
//! | `l5s1_moment_nm`, `l5s1_moment_sigma_nm` | N m | any reason but too little load |
//! | `l5s1_compression_n`, `l5s1_compression_sigma_n` | N | as `l5s1_moment_nm` |
//! | `lifts`, `dose_damage` (1: failure), `dose_probability` (0 to 1) | count, 1, 1 | never |
//! | `worst_joint`: MVN name of the joint closest to its limit | | any reason at all |
//! | `advice_direction`: unit vector, world axes | 1 | as `worst_joint`, or no motion of the load would help |
//! | `advice_gain_nm_per_cm` | N m/cm | as `advice_direction` |
//! | `fatigue` | MVN name → 0 to 1 | never |
//! | `joints` | MVN name → `torque_nm` (world axes), `sigma_nm`, `level`, `limit_nm`, `fatigue` | any reason at all |
//!
//! The `level` of a joint is `none`, `green`, `orange`, `red`, `above_max`, or `undecided` where the torque is not known
//! well enough to say which.

mod joints;
pub mod schema;
#[cfg(test)]
pub(crate) mod tests;

use equipoise_core::body::Joint;
use equipoise_core::cycle::{BodyRefusal, BodySource};
use equipoise_core::message::state::{AccelerationSource, NotGiven, SharingSource, SoleSource};
use equipoise_core::message::{GroundDevice, State, Validity};
use equipoise_core::overload::Level;
use serde::Serialize;

use joints::{Joints, PerJoint};

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
    #[serde(skip_serializing_if = "Vec::is_empty")]
    not_given: Vec<&'static str>,
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
    sole_source: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    body_refused: Option<&'static str>,
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
    com_suit: Option<[f64; 3]>,
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
    zeta: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    zeta_sigma: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sharing_source: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    eta: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    eta_sigma: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    load_distance_m: Option<f64>,
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
        let asked = state.suggested_pose != u32::MAX;
        let back = |value: f64| state.unless(Validity::SPOILS_BACK, value).and_then(finite);
        let lifted = |value: f64| state.unless(Validity::SPOILS_LIFTED_MASS, value).and_then(finite);
        let skew = |value: f64| (state.suit_skew_sigma_s > 0.0).then_some(value).and_then(finite);
        let advised = state.advice_direction != [0.0; 3];
        StateJson {
            t: t_s,
            cycle: state.cycle,
            phase: state.phase_name(),
            valid: state.validity().names().collect(),
            not_given: named(NotGiven::NAMES.map(|(bit, name)| (bit as u32, name)), state.not_given),
            static_pose: state.static_pose != 0,
            converged: state.converged != 0,
            poses_used: state.poses_used,
            stance: state.stance,
            motion_samples_used: state.motion_samples_used,
            group_delay_ns: state.group_delay_ns,
            suggested_pose: asked.then_some(state.suggested_pose),
            suit_age_ns: (state.suit_sample_time_ns != 0).then_some(state.suit_age_ns),
            ground_age_ns: (state.ground_age_ns != u64::MAX).then_some(state.ground_age_ns),
            mass_kg: state.unless(Validity::MASS_UNKNOWN, state.mass_kg).and_then(finite),
            body_source: BodySource::from_number(state.body_source)
                .filter(|source| *source != BodySource::Unknown)
                .map(BodySource::name),
            sole_source: SoleSource::from_number(state.sole_source).map_or("unknown", SoleSource::name),
            body_refused: BodyRefusal::from_number(state.body_refused)
                .filter(|refusal| *refusal != BodyRefusal::None)
                .map(BodyRefusal::name),
            cop_measured: state
                .unless(Validity::SPOILS_COP_MEASURED, state.cop_measured_m)
                .and_then(all_finite),
            cop_measured_sigma: state
                .unless(Validity::SPOILS_COP_MEASURED, state.cop_measured_sigma_m)
                .filter(|sigma_m| sigma_m.iter().all(|sigma_m| *sigma_m > 0.0))
                .and_then(all_finite),
            cop_estimated: state
                .unless(Validity::SPOILS_COP_ESTIMATED, state.cop_estimated_m)
                .and_then(all_finite),
            cop_sigma: state.unless(Validity::SPOILS_COP_ESTIMATED, state.cop_sigma_m).and_then(all_finite),
            com: state.unless(Validity::SPOILS_COM, state.com_m).and_then(all_finite),
            com_suit: state.suit_com_m().and_then(all_finite),
            acceleration_source: state
                .unless(Validity::SPOILS_COM, state.acceleration_source)
                .and_then(AccelerationSource::from_number)
                .map(AccelerationSource::name),
            ground_force_n: state
                .unless(Validity::SPOILS_GROUND_FORCE, state.ground_force_n)
                .filter(|_| state.gives(NotGiven::Shear))
                .and_then(all_finite),
            vertical_force_n: state
                .unless(Validity::SPOILS_GROUND_FORCE, state.ground_force_n[2])
                .and_then(finite),
            ground_devices: named(
                GroundDevice::NAMES.map(|(bit, name)| (bit as u32, name)),
                state.unless(Validity::SPOILS_GROUND_FORCE, state.ground_devices).unwrap_or(0),
            ),
            delta_f_n: state.unless(Validity::SPOILS_DELTA_F, state.delta_f_n).and_then(all_finite),
            delta_f_sigma_n: state.unless(Validity::SPOILS_DELTA_F, state.delta_f_sigma_n).and_then(positive),
            lifted_mass_kg: lifted(state.lifted_mass_kg),
            lifted_mass_sigma_kg: lifted(state.lifted_mass_sigma_kg),
            zeta: state.unless(SPOILS_ZETA, state.zeta).and_then(all_finite),
            zeta_sigma: state.unless(SPOILS_ZETA, state.zeta_sigma).and_then(finite),
            sharing_source: state
                .unless(SPOILS_ZETA, state.sharing_source)
                .and_then(SharingSource::from_number)
                .map(SharingSource::name),
            eta: state.unless(Validity::SPOILS_TORQUES, state.eta).and_then(all_finite),
            eta_sigma: state.unless(Validity::SPOILS_TORQUES, state.eta_sigma).and_then(finite),
            load_distance_m: state.unless(SPOILS_LOAD_DISTANCE, state.load_distance_m).and_then(finite),
            reach_m: state.unless(Validity::SPOILS_TORQUES, state.reach_m).and_then(finite),
            reach_sigma_m: state.unless(Validity::SPOILS_TORQUES, state.reach_sigma_m).and_then(finite),
            variance_max_m2: positive(state.variance_max_m2),
            predicted_cop_sigma_m: positive(state.predicted_cop_sigma_m),
            nis: positive(state.nis),
            prior_inflation: positive(state.prior_inflation),
            pose_mismatch_rad: state
                .unless(Validity::SUIT_STALE, state.pose_mismatch_rad)
                .filter(|_| asked)
                .and_then(finite),
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
                .unless(Validity::SPOILS_TORQUES, state.advice_direction)
                .filter(|_| advised)
                .and_then(all_finite),
            advice_gain_nm_per_cm: state
                .unless(Validity::SPOILS_TORQUES, state.advice_gain_nm_per_cm)
                .filter(|_| advised)
                .and_then(finite),
            fatigue: PerJoint(&state.fatigue),
            joints: state.unless(Validity::SPOILS_TORQUES, Joints(state)),
        }
    }

    /// The same without what a body is alone: its mass, and where its centre is.
    #[must_use]
    pub fn without_body(self) -> StateJson<'a> {
        StateJson { mass_kg: None, com: None, com_suit: None, acceleration_source: None, ..self }
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
    let index = state.unless(Validity::SPOILS_TORQUES, state.worst_joint)?;
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
