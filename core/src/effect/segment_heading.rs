//! `segment_heading`: heading error of one segment, about the vertical, too far left if positive; caused by iron near
//! its sensor.

use super::geometry::{AXES, Column, Moving, chord, cross, sum};
use super::reoriented::turning_m;
use super::{Columns, Observation, Parameter, Place};

pub(super) const PARAMETERS: [Parameter; 1] =
    [Parameter { name: "psi_rad", unit: "rad", prior_sigma: 12.0 * core::f64::consts::PI / 180.0 }];

/// Column: the segment's arm, rotated back: `(R_z(−ψ) − 1) arm / ψ` for a ψ (`about_rad`) that may be large, `arm ×
/// e_z` for a small one.
pub(super) fn columns(place: Place, about_rad: f64, o: &Observation) -> Columns {
    let Place::Segment(segment) = place else { return Columns::zero(PARAMETERS.len()) };
    let arm = o.arm(segment);
    let [_, _, up] = AXES;
    let (straight, aside) = chord(about_rad);
    let back = |arm: [f64; 3]| {
        let turned = cross(arm, up);
        sum(turned.map(|part| straight * part), cross(turned, up).map(|part| about_rad * aside * part))
    };
    let moved = |arm: Moving| Moving { at: back(arm.at), acceleration: back(arm.acceleration) };
    let turning_m = turning_m(o, segment, moved, |arm| moved(arm).times(about_rad));
    Columns::of(&[o.of_shift(moved(arm)).plus(Column::of_cop(turning_m))])
}
