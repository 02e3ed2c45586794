//! `plate_height`: error of the configured height of the walking surface above the sensor; positive if it is higher.

use super::geometry::Column;
use super::{Columns, Observation, Parameter};

pub(super) const PARAMETERS: [Parameter; 1] = [Parameter { name: "dz_m", unit: "m", prior_sigma: 0.05 }];

/// Column: minus horizontal over vertical force. The device's moments refer to a height that is too low by `dz_m`
/// ([`crate::message::GroundSample::cop_m`]: `x = (z F_x − M_y)/F_z`), so the CoP has the error `−dz F_xy/F_z`.
pub(super) fn columns(o: &Observation) -> Columns {
    let [x, y, z] = if o.slope_is_measured { o.force_measured_n } else { o.force_predicted_n };
    Columns::of(&[Column::of_cop([-x / z, -y / z])])
}
