//! `plate_offset`: the plate lies elsewhere than configured, so every centre of pressure is shifted.

use super::geometry::Column;
use super::{Columns, Parameter};

pub(super) const PARAMETERS: [Parameter; 2] = [
    Parameter { name: "dx_m", unit: "m", prior_sigma: 0.015 },
    Parameter { name: "dy_m", unit: "m", prior_sigma: 0.015 },
];

/// Columns: how far measured centres of pressure lie forward and left of the true ones.
pub(super) fn columns() -> Columns {
    Columns::of(&[Column::of_cop([1.0, 0.0]), Column::of_cop([0.0, 1.0])])
}
