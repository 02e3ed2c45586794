//! `worn_mass`: a mass fixed to a segment: tools on a belt, a backpack, a cuff.

use super::{Columns, Observation, Parameter, Place, mass};
use crate::body::Segment;

pub(super) const PARAMETERS: [Parameter; 4] = mass::parameters(5.0, 0.3);

/// Columns: the mass at the segment's centre of mass, then its first moment about it in the segment's axes.
pub(super) fn columns(place: Place, o: &Observation) -> Columns {
    let Place::Segment(segment) = place else { return Columns::zero(PARAMETERS.len()) };
    let centre = o.point_on(segment, o.centre_m[segment.index()]);
    Columns::of(&mass::carried(o, segment, centre))
}

/// 1-σ of the mass worn on a segment, kg: larger for the trunk than for limbs.
pub(super) fn mass_sigma_kg(segment: Segment) -> f64 {
    match segment {
        Segment::T8 => 8.0,
        Segment::Pelvis | Segment::L5 | Segment::L3 | Segment::T12 => 5.0,
        _ => 1.5,
    }
}

/// 1-σ of its distance from the segment's centre, on each axis, m.
pub(super) fn arm_sigma_m(segment: Segment) -> f64 {
    match segment {
        Segment::T8 => 0.22,
        Segment::Pelvis | Segment::L5 | Segment::L3 | Segment::T12 => 0.16,
        _ => 0.06,
    }
}
