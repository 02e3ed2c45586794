//! `plate_height`: the walking surface lies higher above the sensor than was configured.

use super::geometry::Column;
use super::{Columns, Observation, Parameter};

pub(super) const PARAMETERS: [Parameter; 1] = [Parameter { name: "dz_m", unit: "m", prior_sigma: 0.05 }];

/// Column: minus horizontal over vertical force. The device's moments are taken to a height that is too low by `dz_m`
/// ([`crate::message::GroundSample::cop_m`]: `x = (z F_x − M_y)/F_z`), so the centre is missed by `−dz F_xy/F_z`.
pub(super) fn columns(o: &Observation) -> Columns {
    let [x, y, z] = if o.slope_is_measured { o.force_measured_n } else { o.force_predicted_n };
    Columns::of(&[Column::of_cop([-x / z, -y / z])])
}
