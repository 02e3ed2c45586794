//! `plate_drift`: the CoP drifts, linearly, or exponentially towards an end as with a warming amplifier.

use super::geometry::Column;
use super::{Columns, Observation, Parameter};
use crate::math;

/// Parameters of a linear drift: 1-σ 5 mm per minute.
pub(super) const PARAMETERS: [Parameter; 2] = [
    Parameter { name: "vx_m_per_s", unit: "m/s", prior_sigma: 0.005 / 60.0 },
    Parameter { name: "vy_m_per_s", unit: "m/s", prior_sigma: 0.005 / 60.0 },
];
/// Parameters of a drift towards an end.
pub(super) const ENDING: [Parameter; 2] = [
    Parameter { name: "ax_m", unit: "m", prior_sigma: 0.012 },
    Parameter { name: "ay_m", unit: "m", prior_sigma: 0.012 },
];

/// Columns: `t`; with a time constant τ as the shape, s, `1 − e^(−t/τ)`.
pub(super) fn columns(tau_s: f64, o: &Observation) -> Columns {
    let time_s = o.time_s.max(0.0);
    let so_far = if tau_s > 0.0 { 1.0 - math::exp(-time_s / tau_s) } else { time_s };
    Columns::of(&[Column::of_cop([so_far, 0.0]), Column::of_cop([0.0, so_far])])
}
