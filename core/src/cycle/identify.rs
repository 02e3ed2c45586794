//! Stage `identify`: updates of the subject's identification by an instant. No parameter is updated under a load.
//!
//! Three functions on the same state, each after the stage whose output it needs: [`weigh`] after the prediction,
//! [`update_from_static_pose`] after the estimate, [`update_from_motion`] after the residual.

use core::ops::Deref;

use bytemuck::{Pod, Zeroable};

use super::body_motion::NoiseSigma;
use super::cop_estimate::Estimate;
use super::differentiate::Instant;
use super::ground::Ground;
use super::identification::Identification;
use super::loading::SUPPORT_MARGIN_M;
use super::outputs::Outputs;
use super::prediction::Prediction;
use super::residual::{MOTION_ROW_EVERY_NS, ROWS_PER_INDEPENDENT, Residual};
use super::settings::{Method, Motion, Settings};
use super::stillness::Stillness;
use super::{foot_outline, support};
use crate::GRAVITY_M_PER_S2;
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::message::Component;
use crate::motion::History;
use crate::sesc::PARAMETERS;
use crate::sesc::reduction::Rows;
use crate::static_pose::{PoseStatistics, Window};

/// Maximum shear of a static body, as a fraction of its weight; more means an external horizontal force.
const SHEAR_RATIO_MAX: f64 = 0.02;
/// Exceeded with a probability of 0.001 for two degrees of freedom.
const NIS_OUTLIER: f64 = 13.8;

/// Updates of the filter by motion samples.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct MotionUpdates {
    /// Time of the last one, ns.
    last_ns: u64,
    /// Their number for this subject.
    pub(super) used: u64,
}

/// The subject with the stance and the mass of the instant.
#[derive(Clone, Copy)]
pub(super) struct Weighed<'a>(&'a Identification);

/// The subject after the update by a static pose.
#[derive(Clone, Copy)]
pub(super) struct Identified<'a>(&'a Identification);

impl<'a> Identified<'a> {
    /// The subject for the newest sample, which updates nothing.
    pub(super) fn newest(subject: &'a Identification) -> Identified<'a> {
        Identified(subject)
    }
}

impl Deref for Weighed<'_> {
    type Target = Identification;

    fn deref(&self) -> &Identification {
        self.0
    }
}

impl Deref for Identified<'_> {
    type Target = Identification;

    fn deref(&self) -> &Identification {
        self.0
    }
}

/// Applies the stance of the instant, and weighs the body unless its mass comes from another source.
pub(super) fn weigh<'a>(
    settings: &Settings,
    subject: &'a mut Identification,
    instant: &Instant,
    ground: &Ground,
    prediction: &Prediction,
) -> Weighed<'a> {
    let snapshot = &instant.snapshot;
    if subject.has_body() {
        subject.update_stance(snapshot.stance, snapshot.stance_sigma_m, settings);
    }
    if subject.has_body() && prediction.is_measured {
        weigh_measured(settings, subject, instant, ground, prediction);
    }
    Weighed(subject)
}

fn weigh_measured(
    settings: &Settings,
    subject: &mut Identification,
    instant: &Instant,
    ground: &Ground,
    prediction: &Prediction,
) {
    let Instant { snapshot, pose, .. } = instant;
    let supported = instant.place_is_lost || is_supported(settings, instant, pose, ground.reading.cop_m);
    let body = &prediction.body;
    let vertical_n = snapshot.ground.force_n[2] - prediction.terms_force_n[2];
    let unloaded_n = ground.unloaded_force_n(subject, body.specific_force_m_per_s2);
    let loaded = subject.mass_kg > 0.0 && (vertical_n - unloaded_n).abs() > prediction.load_limit_n;
    // A mass discarded after the identification is still needed.
    let is_wanted = subject.identifying == 1 || subject.mass_kg <= 0.0;
    if loaded || !supported || !instant.both_feet_stand() || !is_wanted {
        return;
    }
    let inertia_n = vertical_n * body.suit_acceleration_m_per_s2[2] / body.specific_force_m_per_s2;
    let sigma_n = prediction.vertical_sigma_n(inertia_n.abs());
    subject.weigh(vertical_n, body.specific_force_m_per_s2, sigma_n, instant.step_s, settings);
}

fn is_supported(settings: &Settings, instant: &Instant, pose: &Pose<StationWorld>, cop_m: [f64; 2]) -> bool {
    let outlines = foot_outline::both(pose, instant.suit_body.as_ref(), settings.height_m);
    support::is_supported(pose, cop_m, &outlines, SUPPORT_MARGIN_M)
}

/// Updates the filter with one more static pose if no load is carried.
pub(super) fn update_from_static_pose<'a>(
    settings: &Settings,
    subject: &'a mut Identification,
    window: &Window,
    instant: &Instant,
    ground: &Ground,
    prediction: &Prediction,
    estimate: &Estimate,
) -> Identified<'a> {
    if let Some(statistics) = &prediction.static_pose
        && is_supported(settings, instant, &estimate.on_plate, statistics.cop_m)
        && !instant.place_is_lost
        && instant.both_feet_stand()
        && subject.mass_kg > 0.0
    {
        update_from_window(settings, subject, window, instant, ground, prediction, statistics);
    }
    Identified(subject)
}

fn update_from_window(
    settings: &Settings,
    subject: &mut Identification,
    window: &Window,
    instant: &Instant,
    ground: &Ground,
    prediction: &Prediction,
    statistics: &PoseStatistics,
) {
    let sample = &instant.snapshot.ground;
    let weight_n = ground.unloaded_force_n(subject, GRAVITY_M_PER_S2);
    // The paper has no load threshold.
    let tolerance_n = match settings.motion {
        Motion::Paper => settings.static_pose.weight_fraction * weight_n,
        Motion::Compensated { .. } => {
            (settings.static_pose.weight_fraction * weight_n).min(settings.load_threshold_n)
        }
    };
    let [x, y] = [0, 1].map(|axis| sample.force_n[axis] - prediction.terms_force_n[axis]);
    // Only shear reveals an external horizontal force; without shear it stays undetected.
    let has_external_force = sample.measures(Component::Shear)
        && (math::hypot([x, y]) > SHEAR_RATIO_MAX * weight_n || prediction.sigma.has_external_force);
    let unloaded = (statistics.vertical_n - weight_n).abs() < tolerance_n && !has_external_force;
    let wanted = subject.has_body() && subject.identifying == 1 && !subject.has_used(window, settings);
    if wanted && unloaded {
        let lasting_m =
            [0, 1].map(|axis| math::hypot([ground.sigma.lasting_cop_m, prediction.body.shift_m(axis)]));
        subject.update_from_pose(window, statistics, lasting_m, settings);
    }
}

/// Residual of an instant, and what it was computed from.
#[derive(Clone, Copy)]
pub(super) struct MotionInput<'a> {
    pub(super) outputs: &'a Outputs<'a>,
    pub(super) residual: &'a Residual,
    /// Errors of the compensation, with the residual of this instant.
    pub(super) sigma: &'a NoiseSigma,
    pub(super) history: &'a History,
}

/// Updates with the moment rows `(B_xy − s B_z) Φ = CoP − x0_xy + s x0_z − turning` (DESIGN §4); R increases with the
/// motion.
pub(super) fn update_from_motion(
    settings: &Settings,
    subject: &mut Identification,
    updates: &mut MotionUpdates,
    input: &MotionInput<'_>,
) {
    let MotionInput { outputs: Outputs { instant, ground, stillness, prediction, .. }, sigma, .. } = input;
    let is_steady = instant.both_feet_stand() || !settings.suit_drifts;
    let is_due = instant.snapshot.time_ns.saturating_sub(updates.last_ns) >= MOTION_ROW_EVERY_NS;
    // The static equation does not apply to a moving body, not even for its position.
    if !is_steady || !is_due || (settings.motion == Motion::Paper && !stillness.is_static) {
        return;
    }
    updates.last_ns = instant.snapshot.time_ns;
    let (pose, body) = (&instant.pose, &prediction.body);
    let rows = subject.reduction.rows(pose, body.slope);
    let drift_m2 = subject.drift_variance_m2(pose, settings);
    let cop_m = core::array::from_fn(|axis| {
        ground.reading.cop_m[axis] - body.cop_beyond_rows_m(axis) - prediction.terms_cop_m[axis]
    });
    let floor = settings.measurement_sigma_m * settings.measurement_sigma_m;
    let one_m2: [f64; 2] = core::array::from_fn(|axis| {
        let (moving_m, lasting_m) = (sigma.cop_m[axis], ground.sigma.lasting_cop_m);
        drift_m2[axis] + floor + moving_m * moving_m + lasting_m * lasting_m
    });
    let variance_m2 = one_m2.map(|variance_m2| ROWS_PER_INDEPENDENT * variance_m2);
    let nis = normalised_innovation_squared(subject, &rows, cop_m, variance_m2);
    subject.update_misfit(&rows, cop_m, one_m2, 1.0);
    // Reject outliers: contacts and stumbles violate the model.
    if nis >= NIS_OUTLIER {
        return;
    }
    if !accepts_motion(settings, subject, stillness) {
        // After identification the subject still steps about: update the stance offset and keep θ.
        subject.update_stance_offset(&rows, cop_m, variance_m2);
    } else if subject.update_from_cop(&rows, cop_m, variance_m2).is_some() {
        updates.used = (updates.used + 1).min(u64::from(u32::MAX));
        update_from_shear(settings, subject, input);
        if subject.identifying == 1 {
            subject.finish_row(settings);
        }
    }
    subject.update_predicted_cop_sigma(settings);
}

fn normalised_innovation_squared(
    subject: &Identification,
    rows: &Rows,
    cop_m: [f64; 2],
    variance_m2: [f64; 2],
) -> f64 {
    let predicted_m = subject.predict_cop_m(rows);
    let theta_m2 = subject.cop_variance_m2(rows);
    (0..2)
        .map(|axis| {
            let innovation_m: f64 = cop_m[axis] - predicted_m[axis];
            innovation_m * innovation_m / (theta_m2[axis] + variance_m2[axis])
        })
        .sum()
}

/// Whether motion may update the filter: requested, compensated, and no static pose.
fn accepts_motion(settings: &Settings, subject: &Identification, stillness: &Stillness) -> bool {
    let is_requested = subject.identifying == 1 || (settings.passive && subject.identified == 1);
    settings.method == Method::StaticAndDynamic
        && settings.motion != Motion::Paper
        && is_requested
        && !stillness.is_static
}

/// Updates with the force rows `d²(x0 + BΦ)/dt² = F_xy/M` (DESIGN §4), if shear is measured.
fn update_from_shear(settings: &Settings, subject: &mut Identification, input: &MotionInput<'_>) {
    let Motion::Compensated { half_window_ns } = settings.motion else { return };
    let sample = &input.outputs.instant.snapshot.ground;
    let [x_n, y_n, _] = sample.force_n;
    if !sample.measures(Component::Shear) || (x_n, y_n) == (0.0, 0.0) {
        return;
    }
    let mut sum = Rows { h: [[0.0; PARAMETERS]; 2], offset_m: [0.0; 2] };
    let reduction = &subject.reduction;
    let complete = input.history.differentiate_twice(half_window_ns, |weight, near| {
        let rows = reduction.rows(&near.pose(), [0.0; 2]);
        for axis in 0..2 {
            sum.offset_m[axis] += weight * (rows.offset_m[axis] - near.station_from_suit_m[axis]);
            for (sum, value) in sum.h[axis].iter_mut().zip(&rows.h[axis]) {
                *sum += weight * value;
            }
        }
    });
    let sigma = input.sigma.acceleration_m_per_s2();
    if complete {
        let variance = ROWS_PER_INDEPENDENT * sigma * sigma;
        subject.update_from_force(&sum, input.residual.body_acceleration_m_per_s2, variance);
    }
}
