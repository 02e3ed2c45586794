//! `segment_heading`: the suit shows one segment turned too far left about the upright: iron near its sensor.

use super::geometry::{AXES, Moving, cross};
use super::{Columns, Observation, Parameter, Place};

pub(super) const PARAMETERS: [Parameter; 1] =
    [Parameter { name: "psi_rad", unit: "rad", prior_sigma: 12.0 * core::f64::consts::PI / 180.0 }];

/// Column: the segment's arm, turned back.
pub(super) fn columns(place: Place, o: &Observation) -> Columns {
    let Place::Segment(segment) = place else { return Columns::zero(PARAMETERS.len()) };
    let arm = o.arm(segment);
    let [_, _, up] = AXES;
    let back = Moving { at: cross(arm.at, up), acceleration: cross(arm.acceleration, up) };
    Columns::of(&[o.of_shift(back)])
}
