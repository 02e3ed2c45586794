//! Errors of the plate, as the deviation of its readings from the truth. Its low pass has a state:
//! [`super::plate_lowpass`].

use super::geometry::{Column, leftward};
use super::{Columns, Observation, Parameter};
use crate::math;

const fn gain(name: &'static str) -> Parameter {
    Parameter { name, unit: "1", prior_sigma: 0.05 }
}

pub(super) const OFFSET: [Parameter; 2] = [
    Parameter { name: "dx_m", unit: "m", prior_sigma: 0.015 },
    Parameter { name: "dy_m", unit: "m", prior_sigma: 0.015 },
];

/// `plate_offset`: error of the configured position. Columns: displacement of measured CoPs forward and left of the
/// true ones.
pub(super) fn offset() -> Columns {
    Columns::of(&[Column::of_cop([1.0, 0.0]), Column::of_cop([0.0, 1.0])])
}

pub(super) const YAW: [Parameter; 1] =
    [Parameter { name: "psi_rad", unit: "rad", prior_sigma: 4.0 * core::f64::consts::PI / 180.0 }];

/// `plate_yaw`: rotation to the left of the configured orientation, about the world's origin. Column: readings of a
/// plate rotated left are rotated right. Measured shear is rotated alike, so only the part of the prediction from the
/// suit is not.
pub(super) fn yaw(o: &Observation) -> Columns {
    let [x, y, _] = o.force_predicted_n;
    let [push_x, push_y] = leftward([x, y]);
    let cop_m = leftward(o.cop_by_suit_m()).map(|part| -part);
    Columns::of(&[Column { cop_m, force_n: [-push_x, -push_y, 0.0] }])
}

pub(super) const GAIN: [Parameter; 2] = [gain("kx"), gain("ky")];

/// `plate_gain`: gain error of the CoP about the world's origin, separately for each axis. Columns: measured = `1 + k`
/// times true.
pub(super) fn cop_gain(o: &Observation) -> Columns {
    let [x, y] = o.cop_predicted_m;
    Columns::of(&[Column::of_cop([x, 0.0]), Column::of_cop([0.0, y])])
}

pub(super) const CROSSTALK: [Parameter; 1] = [gain("k")];

/// `plate_crosstalk`. Column: adds k times the other axis of the CoP to each axis.
pub(super) fn crosstalk(o: &Observation) -> Columns {
    let [x, y] = o.cop_predicted_m;
    Columns::of(&[Column::of_cop([y, x])])
}

pub(super) const HEIGHT: [Parameter; 1] = [Parameter { name: "dz_m", unit: "m", prior_sigma: 0.05 }];

/// `plate_height`: error of the configured height of the walking surface above the sensor; positive if it is higher.
/// Column: minus horizontal over vertical force. The device's moments refer to a height that is too low by `dz_m`
/// ([`crate::message::GroundSample::cop_m`]: `x = (z F_x − M_y)/F_z`), so the CoP has the error `−dz F_xy/F_z`.
pub(super) fn height(o: &Observation) -> Columns {
    let [x, y, z] = if o.slope_is_measured { o.force_measured_n } else { o.force_predicted_n };
    Columns::of(&[Column::of_cop([-x / z, -y / z])])
}

pub(super) const FORCE_GAIN: [Parameter; 1] = [Parameter { name: "k", unit: "1", prior_sigma: 0.01 }];

/// `force_gain`: gain error of the vertical force. Force and moments scale alike, so the CoP does not change. Column:
/// measured = `1 + k` times true.
pub(super) fn force_gain(o: &Observation) -> Columns {
    Columns::of(&[Column { cop_m: [0.0; 2], force_n: [0.0, 0.0, o.force_predicted_n[2]] }])
}

/// Parameters of a linear drift: 1-σ 5 mm per minute.
pub(super) const DRIFT: [Parameter; 2] = [
    Parameter { name: "vx_m_per_s", unit: "m/s", prior_sigma: 0.005 / 60.0 },
    Parameter { name: "vy_m_per_s", unit: "m/s", prior_sigma: 0.005 / 60.0 },
];
/// Parameters of a drift towards an end.
pub(super) const ENDING_DRIFT: [Parameter; 2] = [
    Parameter { name: "ax_m", unit: "m", prior_sigma: 0.012 },
    Parameter { name: "ay_m", unit: "m", prior_sigma: 0.012 },
];

/// `plate_drift`: the CoP drifts, linearly, or exponentially towards an end as with a warming amplifier. Columns: `t`;
/// with a time constant τ as the shape, s, `1 − e^(−t/τ)`.
pub(super) fn drift(tau_s: f64, o: &Observation) -> Columns {
    let time_s = o.time_s.max(0.0);
    let so_far = if tau_s > 0.0 { 1.0 - math::exp(-time_s / tau_s) } else { time_s };
    Columns::of(&[Column::of_cop([so_far, 0.0]), Column::of_cop([0.0, so_far])])
}
