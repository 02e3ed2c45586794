//! `segment_misalignment`: one segment's sensor is misaligned or has slipped: the suit reports `R_s exp(δ)` for `R_s`.

use super::geometry::{AXES, Column, Moving, chord, cross, sum};
use super::reoriented::turning_m;
use super::{Columns, Observation, Parameter, Place};
use crate::math;

const SIGMA_RAD: f64 = 8.0 * core::f64::consts::PI / 180.0;

pub(super) const PARAMETERS: [Parameter; 3] = [
    Parameter { name: "rx_rad", unit: "rad", prior_sigma: SIGMA_RAD },
    Parameter { name: "ry_rad", unit: "rad", prior_sigma: SIGMA_RAD },
    Parameter { name: "rz_rad", unit: "rad", prior_sigma: SIGMA_RAD },
];

/// Columns: the segment's arm ψ_s, rotated back about each of the segment's axes `e`: `−R_s (e × ψ_s)` for a small
/// rotation; for one that may be large (`about_rad`, δ), terms with the sum `R_s (exp(−δ) − 1) ψ_s` (Rodrigues).
pub(super) fn columns(place: Place, about_rad: [f64; 3], o: &Observation) -> Columns {
    let Place::Segment(segment) = place else { return Columns::zero(PARAMETERS.len()) };
    // Bones are rigid: in the segment's axes the attached parts do not move.
    let rows = &o.rotation[segment.index()];
    let (straight, aside) = chord(math::sqrt(about_rad.iter().map(|part| part * part).sum()));
    let moved = |arm: Moving, axis: [f64; 3]| {
        let [x, y, z] = arm.at;
        let fixed_m = [0, 1, 2].map(|axis| rows[0][axis] * x + rows[1][axis] * y + rows[2][axis] * z);
        let turned = cross(fixed_m, axis);
        let back = sum(turned.map(|part| straight * part), cross(turned, about_rad).map(|part| aside * part));
        o.turned(segment, back)
    };
    let arm = o.arm(segment);
    Columns::of(&AXES.map(|axis| {
        let turning_m = turning_m(o, segment, |arm| moved(arm, axis), |arm| moved(arm, about_rad));
        o.of_shift(moved(arm, axis)).plus(Column::of_cop(turning_m))
    }))
}
