//! `plate_gain`: gain error of the CoP about the world's origin, separately for each axis.

use super::geometry::Column;
use super::{Columns, Observation, Parameter};

pub(super) const PARAMETERS: [Parameter; 2] = [
    Parameter { name: "kx", unit: "1", prior_sigma: 0.05 },
    Parameter { name: "ky", unit: "1", prior_sigma: 0.05 },
];

/// Columns: measured = `1 + k` times true.
pub(super) fn columns(o: &Observation) -> Columns {
    let [x, y] = o.cop_predicted_m;
    Columns::of(&[Column::of_cop([x, 0.0]), Column::of_cop([0.0, y])])
}
