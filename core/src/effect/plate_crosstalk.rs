//! `plate_crosstalk`: each axis of the CoP contains a fraction of the other.

use super::geometry::Column;
use super::{Columns, Observation, Parameter};

pub(super) const PARAMETERS: [Parameter; 1] = [Parameter { name: "k", unit: "1", prior_sigma: 0.05 }];

/// Column: adds k times the other axis to each axis.
pub(super) fn columns(o: &Observation) -> Columns {
    let [x, y] = o.cop_predicted_m;
    Columns::of(&[Column::of_cop([y, x])])
}
