//! `suit_heading_drift`: the whole suit rotates left about the vertical, by gyroscope drift.

use super::geometry::{Column, leftward};
use super::{Columns, Observation, Parameter};

/// 1-σ: 4° per minute.
pub(super) const PARAMETERS: [Parameter; 1] = [Parameter {
    name: "rate_rad_per_s",
    unit: "rad/s",
    prior_sigma: 4.0 * core::f64::consts::PI / 180.0 / 60.0,
}];

/// Column: the suit's part of the prediction is rotated left about the standing feet by rate times time, so it is
/// rotated back.
pub(super) fn columns(o: &Observation) -> Columns {
    let by_suit_m = o.cop_by_suit_m();
    let from_feet_m = [0, 1].map(|axis| by_suit_m[axis] - o.feet_m[axis]);
    let [x, y, _] = o.force_predicted_n;
    let [push_x, push_y] = leftward([x, y]);
    let cop_m = leftward(from_feet_m).map(|part| -part);
    Columns::of(&[Column { cop_m, force_n: [-push_x, -push_y, 0.0] }.times(o.time_s)])
}
