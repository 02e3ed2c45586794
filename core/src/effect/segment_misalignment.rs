//! `segment_misalignment`: one segment's sensor sits crooked, or has slipped: the suit shows `R_s exp(δ)` for `R_s`.

use super::geometry::{AXES, cross};
use super::{Columns, Observation, Parameter, Place};

const SIGMA_RAD: f64 = 8.0 * core::f64::consts::PI / 180.0;

pub(super) const PARAMETERS: [Parameter; 3] = [
    Parameter { name: "rx_rad", unit: "rad", prior_sigma: SIGMA_RAD },
    Parameter { name: "ry_rad", unit: "rad", prior_sigma: SIGMA_RAD },
    Parameter { name: "rz_rad", unit: "rad", prior_sigma: SIGMA_RAD },
];

/// Columns: the segment's arm, turned back about each of the segment's axes: `−R_s (e × ψ_s)`.
pub(super) fn columns(place: Place, o: &Observation) -> Columns {
    let Place::Segment(segment) = place else { return Columns::zero(PARAMETERS.len()) };
    let [x, y, z] = o.arm(segment).at;
    // Bones are stiff: in the segment's axes the arm does not move.
    let rows = &o.rotation[segment.index()];
    let psi_m = [0, 1, 2].map(|axis| rows[0][axis] * x + rows[1][axis] * y + rows[2][axis] * z);
    Columns::of(&AXES.map(|axis| o.of_shift(o.turned(segment, cross(psi_m, axis)))))
}
