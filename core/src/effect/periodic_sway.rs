//! `periodic_sway`: breathing or sway that the suit does not measure.

use super::geometry::Column;
use super::{Columns, Observation, Parameter};
use crate::math;

pub(super) const PARAMETERS: [Parameter; 4] = [
    Parameter { name: "sine_x_m", unit: "m", prior_sigma: 0.002 },
    Parameter { name: "cosine_x_m", unit: "m", prior_sigma: 0.002 },
    Parameter { name: "sine_y_m", unit: "m", prior_sigma: 0.002 },
    Parameter { name: "cosine_y_m", unit: "m", prior_sigma: 0.002 },
];

/// Columns: sine and cosine at the shape's frequency, Hz, forward and then sideways.
pub(super) fn columns(frequency_hz: f64, o: &Observation) -> Columns {
    let (sine, cosine) = math::sin_cos(core::f64::consts::TAU * frequency_hz * o.time_s);
    Columns::of(&[[sine, 0.0], [cosine, 0.0], [0.0, sine], [0.0, cosine]].map(Column::of_cop))
}
