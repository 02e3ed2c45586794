//! Groups of a state's keys, in the order of the JSON; what invalidates a value is stated here.

use equipoise_core::body::Joint;
use equipoise_core::cycle::{BodyRejection, BodySource};
use equipoise_core::message::state::{AccelerationSource, FootOutlineSource, SharingSource, Unavailable};
use equipoise_core::message::{GroundDevice, State, Validity};
use serde::Serialize;

use super::{all_finite, finite, named, positive, worst_joint};

/// Body and body model.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Body {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) mass_kg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    body_source: Option<&'static str>,
    foot_outline_source: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    body_rejected: Option<&'static str>,
}

impl Body {
    pub(super) fn of(state: &State) -> Body {
        Body {
            mass_kg: state.unless(Validity::MASS_UNKNOWN, state.mass_kg).and_then(finite),
            body_source: BodySource::from_number(state.body_source)
                .filter(|source| *source != BodySource::Unknown)
                .map(BodySource::name),
            foot_outline_source: FootOutlineSource::from_number(state.foot_outline_source)
                .map_or("unknown", FootOutlineSource::name),
            body_rejected: BodyRejection::from_number(state.body_rejected)
                .filter(|refusal| *refusal != BodyRejection::None)
                .map(BodyRejection::name),
        }
    }
}

/// Centre of pressure and centre of mass.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Motion {
    #[serde(skip_serializing_if = "Option::is_none")]
    cop_measured: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cop_measured_sigma: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cop_estimated: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cop_sigma: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) com: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) suit_com: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) acceleration_source: Option<&'static str>,
}

impl Motion {
    pub(super) fn of(state: &State) -> Motion {
        Motion {
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
        }
    }
}

/// Forces on the person, and the load that they imply.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Forces {
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
}

impl Forces {
    pub(super) fn of(state: &State) -> Forces {
        let lifted = |value: f64| state.unless(Validity::INVALIDATES_LIFTED_MASS, value).and_then(finite);
        Forces {
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
        }
    }
}

/// Distribution of the load over hands and feet, and its distance.
#[derive(Debug, Clone, Serialize)]
pub(super) struct LoadPosition {
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
}

impl LoadPosition {
    pub(super) fn of(state: &State) -> LoadPosition {
        LoadPosition {
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
        }
    }
}

/// State of the filter and of the alignment of the streams.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Filter {
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
}

impl Filter {
    pub(super) fn of(state: &State) -> Filter {
        let skew = |value: f64| (state.suit_skew_sigma_s > 0.0).then_some(value).and_then(finite);
        Filter {
            variance_max_m2: positive(state.variance_max_m2),
            predicted_cop_sigma_m: positive(state.predicted_cop_sigma_m),
            nis: positive(state.nis),
            prior_inflation: positive(state.prior_inflation),
            pose_mismatch_rad: state.pose_mismatch_rad().and_then(finite),
            suit_skew_s: skew(state.suit_skew_s),
            suit_skew_sigma_s: skew(state.suit_skew_sigma_s),
        }
    }
}

/// Low back: load now, and dose over the shift.
#[derive(Debug, Clone, Serialize)]
pub(super) struct LowBack {
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
}

impl LowBack {
    pub(super) fn of(state: &State) -> LowBack {
        let back = |value: f64| state.unless(Validity::INVALIDATES_LOW_BACK, value).and_then(finite);
        LowBack {
            l5s1_moment_nm: back(state.l5s1_moment_nm),
            l5s1_moment_sigma_nm: back(state.l5s1_moment_sigma_nm),
            l5s1_compression_n: back(state.l5s1_compression_n),
            l5s1_compression_sigma_n: back(state.l5s1_compression_sigma_n),
            lifts: state.lifts,
            dose_damage: finite(state.dose_damage),
            dose_probability: finite(state.dose_probability),
        }
    }
}

/// The joint closest to its limit, and how to relieve it.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Advice {
    #[serde(skip_serializing_if = "Option::is_none")]
    worst_joint: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    advice_direction: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    advice_gain_nm_per_cm: Option<f64>,
}

impl Advice {
    pub(super) fn of(state: &State) -> Advice {
        let advised = state.advice_direction != [0.0; 3];
        Advice {
            worst_joint: worst_joint(state).map(Joint::name),
            advice_direction: state
                .unless(Validity::INVALIDATES_TORQUES, state.advice_direction)
                .filter(|_| advised)
                .and_then(all_finite),
            advice_gain_nm_per_cm: state
                .unless(Validity::INVALIDATES_TORQUES, state.advice_gain_nm_per_cm)
                .filter(|_| advised)
                .and_then(finite),
        }
    }
}
