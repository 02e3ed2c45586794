//! `force_gain`: the vertical force is stretched. Force and moments alike, so the centre of pressure stays.

use super::geometry::Column;
use super::{Columns, Observation, Parameter};

pub(super) const PARAMETERS: [Parameter; 1] = [Parameter { name: "k", unit: "1", prior_sigma: 0.01 }];

/// Column: measured is `1 + k` times true.
pub(super) fn columns(o: &Observation) -> Columns {
    Columns::of(&[Column { cop_m: [0.0; 2], force_n: [0.0, 0.0, o.force_predicted_n[2]] }])
}
