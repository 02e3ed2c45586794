//! Stage `residual`: the difference between measurement and prediction while no load is carried. It measures the error
//! of the compensation and the force offset; the registration and the identification are updated with it.

use super::identify::Identified;
use super::outputs::Outputs;
use super::settings::Settings;
use crate::motion::{ForceSigma, Unloaded};

/// Minimum interval between motion samples that update the filter, ns …
pub(super) const MOTION_ROW_EVERY_NS: u64 = 100_000_000;
/// … and the number of them that carry the information of one: errors of a motion last about half a second.
pub(super) const ROWS_PER_INDEPENDENT: f64 = 5.0;
/// After a longer gap, whether the hands are empty is unknown, s.
const GAP_MAX_S: f64 = 0.2;

/// Residual of an instant without a load.
#[derive(Debug, Clone, Copy)]
pub(super) struct Residual {
    /// Vertical external force, N, and its 1-σ.
    pub(super) delta_f_n: f64,
    pub(super) sigma: ForceSigma,
    /// Measured minus estimated CoP, m.
    pub(super) cop_error_m: [f64; 2],
    /// The body's own horizontal acceleration in use: without the forces of the model's terms, m/s².
    pub(super) body_acceleration_m_per_s2: [f64; 2],
}

/// Determines whether no load is carried, and the residual then.
pub(super) fn residual(
    settings: &Settings,
    state: &mut Unloaded,
    outputs: &Outputs<'_>,
    subject: Identified<'_>,
) -> Option<Residual> {
    let Outputs { instant, ground, prediction, estimate, withheld, .. } = *outputs;
    let overload = outputs.overload.filter(|_| prediction.is_measured && !withheld.is_unsynchronised());
    let Some(overload) = overload else {
        state.clear();
        return None;
    };
    if subject.mass_kg <= 0.0 || !subject.has_body() {
        return None;
    }
    if instant.step_s > GAP_MAX_S {
        state.clear();
    }
    let sigma = ForceSigma { at_rest_n: ground.sigma.force_n, by_motion_n: prediction.sigma.vertical_n };
    // A step below the plate's assumed σ, such as a tool in a pocket, belongs to the force offset.
    let gate = ForceSigma { at_rest_n: sigma.at_rest_n.max(settings.force_sigma_n), ..sigma };
    let delta_f_n = overload.delta_f_n;
    state.update(delta_f_n, instant.step_s, settings.load_threshold_n, gate).then(|| Residual {
        delta_f_n,
        sigma,
        cop_error_m: [0, 1].map(|axis| ground.reading.cop_m[axis] - estimate.cop_m[axis]),
        body_acceleration_m_per_s2: [0, 1].map(|axis| {
            prediction.body.acceleration_m_per_s2(axis) - prediction.terms_force_n[axis] / subject.mass_kg
        }),
    })
}
