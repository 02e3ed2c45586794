//! `plate_offset`: error of the plate's configured position, which shifts every CoP.

use super::geometry::Column;
use super::{Columns, Parameter};

pub(super) const PARAMETERS: [Parameter; 2] = [
    Parameter { name: "dx_m", unit: "m", prior_sigma: 0.015 },
    Parameter { name: "dy_m", unit: "m", prior_sigma: 0.015 },
];

/// Columns: displacement of measured CoPs forward and left of the true ones.
pub(super) fn columns() -> Columns {
    Columns::of(&[Column::of_cop([1.0, 0.0]), Column::of_cop([0.0, 1.0])])
}
