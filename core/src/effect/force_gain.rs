//! `force_gain`: gain error of the vertical force. Force and moments scale alike, so the CoP does not change.

use super::geometry::Column;
use super::{Columns, Observation, Parameter};

pub(super) const PARAMETERS: [Parameter; 1] = [Parameter { name: "k", unit: "1", prior_sigma: 0.01 }];

/// Column: measured = `1 + k` times true.
pub(super) fn columns(o: &Observation) -> Columns {
    Columns::of(&[Column { cop_m: [0.0; 2], force_n: [0.0, 0.0, o.force_predicted_n[2]] }])
}
