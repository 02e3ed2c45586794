//! `unbalanced_parameters`: the person is no longer the identified subject: one segment's φ has changed.

use super::geometry::AXES;
use super::{Columns, Observation, Parameter, Place};

pub(super) const PARAMETERS: [Parameter; 3] = [
    Parameter { name: "dx_m", unit: "m", prior_sigma: 0.03 },
    Parameter { name: "dy_m", unit: "m", prior_sigma: 0.03 },
    Parameter { name: "dz_m", unit: "m", prior_sigma: 0.03 },
];

/// Columns: a metre of φ along each of the segment's axes, `R_s`.
pub(super) fn columns(place: Place, o: &Observation) -> Columns {
    let Place::Segment(segment) = place else { return Columns::zero(PARAMETERS.len()) };
    Columns::of(&AXES.map(|axis| o.of_shift(o.turned(segment, axis))))
}
