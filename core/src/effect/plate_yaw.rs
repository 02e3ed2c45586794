//! `plate_yaw`: rotation of the plate to the left of its configured orientation, about the world's origin.

use super::geometry::{Column, leftward};
use super::{Columns, Observation, Parameter};

pub(super) const PARAMETERS: [Parameter; 1] =
    [Parameter { name: "psi_rad", unit: "rad", prior_sigma: 4.0 * core::f64::consts::PI / 180.0 }];

/// Column: readings of a plate rotated left are rotated right. Measured shear is rotated alike, so only the part of the
/// prediction from the suit is not.
pub(super) fn columns(o: &Observation) -> Columns {
    let [x, y, _] = o.force_predicted_n;
    let [push_x, push_y] = leftward([x, y]);
    let cop_m = leftward(o.cop_by_suit_m()).map(|part| -part);
    Columns::of(&[Column { cop_m, force_n: [-push_x, -push_y, 0.0] }])
}
