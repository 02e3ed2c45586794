//! Stage `estimate_cop`: centre of mass and centre of pressure of the unloaded body, and the body's place on the plate.

use nalgebra::Vector3;

use super::differentiate::Instant;
use super::ground::Ground;
use super::identification::StanceSigma;
use super::identify::Weighed;
use super::prediction::Prediction;
use super::registration::heading_sigma_m;
use super::settings::Settings;
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::sesc::centre_of_mass;

/// Estimates at one instant; zero without a body, except the pose.
#[derive(Debug, Clone, Copy)]
pub(super) struct Estimate {
    /// Centre of mass, m.
    pub(super) com_m: [f64; 3],
    /// CoP of the unloaded body in this motion, m, and its 1-σ per axis, m.
    pub(super) cop_m: [f64; 2],
    pub(super) cop_sigma_m: [f64; 2],
    /// Uncertainty of the stance offset.
    pub(super) stance: StanceSigma,
    /// Stance offset, m, and the pose with it: the offset applies to everything that is placed on the plate.
    pub(super) offset_m: [f64; 2],
    pub(super) on_plate: Pose<StationWorld>,
}

/// Estimates centre of mass and centre of pressure in this motion, each with its σ.
pub(super) fn estimate_cop(
    settings: &Settings,
    instant: &Instant,
    prediction: &Prediction,
    subject: Weighed<'_>,
) -> Estimate {
    let (pose, body) = (&instant.pose, &prediction.body);
    let offset_m = subject.stance_offset_m();
    let estimate = Estimate {
        com_m: [0.0; 3],
        cop_m: [0.0; 2],
        cop_sigma_m: [0.0; 2],
        stance: StanceSigma::default(),
        offset_m,
        on_plate: pose.displaced(offset_m),
    };
    if !subject.has_body() {
        return estimate;
    }
    let rows = subject.reduction.rows(pose, body.slope);
    let static_m = subject.predict_cop_m(&rows);
    let theta_m2 = subject.cop_variance_m2(&rows);
    let drift_m2 = subject.drift_variance_m2(pose, settings);
    let [x, y] = offset_m;
    let floor = settings.measurement_sigma_m * settings.measurement_sigma_m;
    // Unless shear is used, only the suit measures the body's acceleration; the contribution vanishes at rest.
    let unmeasured_m = if body.slope_is_measured {
        0.0
    } else {
        body.cop_sigma_by_acceleration_m(prediction.sigma.moving_acceleration_m_per_s2)
    };
    let cop_m =
        [0, 1].map(|axis| static_m[axis] + body.cop_beyond_rows_m(axis) + prediction.terms_cop_m[axis]);
    let heading_m = heading_sigma_m(pose, cop_m, instant.heading_sigma_rad);
    let variance_m2 = [0, 1].map(|axis: usize| {
        let moving = prediction.sigma.cop_m[axis];
        let by_body_m2 =
            theta_m2[axis] + drift_m2[axis] + floor + moving * moving + unmeasured_m * unmeasured_m;
        by_body_m2 + heading_m[axis] * heading_m[axis]
    });
    Estimate {
        com_m: (centre_of_mass(pose, &subject.phi()) + Vector3::new(x, y, 0.0)).into(),
        cop_m,
        cop_sigma_m: variance_m2.map(math::sqrt),
        stance: subject.stance_sigma(&rows, variance_m2),
        ..estimate
    }
}

/// Whether the readings of an implausible plate match this subject alone, without a load; `None` before the subject is
/// identified.
pub(super) fn weight_agreement(
    instant: &Instant,
    ground: &Ground,
    prediction: &Prediction,
    estimate: &Estimate,
    subject: Weighed<'_>,
) -> Option<bool> {
    let is_identified = subject.identified == 1 && subject.mass_kg > 0.0 && !instant.place_is_lost;
    let unloaded_n = ground.unloaded_force_n(&subject, prediction.body.specific_force_m_per_s2);
    let off_n = (instant.snapshot.ground.force_n[2] - prediction.terms_force_n[2] - unloaded_n).abs();
    let cop_agrees = (0..2).all(|axis| {
        let sigma_m = math::hypot([estimate.cop_sigma_m[axis], ground.sigma.cop_m]);
        (ground.reading.cop_m[axis] - estimate.cop_m[axis]).abs() < 3.0 * sigma_m
    });
    is_identified.then_some(off_n < prediction.load_limit_n && cop_agrees)
}
