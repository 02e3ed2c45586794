//! What a wrong orientation of one segment does to the turning of the body: all that hangs on the segment is seen in
//! another place, and accelerates otherwise, so the angular momentum's rate is another one.

use super::Observation;
use super::geometry::{Moving, cross, sum};
use crate::body::Segment;

/// Where the centre of pressure goes by the turning of the body, m, if every arm from the segment's origin to what hangs
/// on it is lengthened by `moved(arm)`; per unit of it, beside all that is lengthened by `all(arm)` together.
///
/// `L̇ = Σ m (r − c) × (r̈ − c̈)` with `Δr`, `Δr̈` of every distal centre; where the body as a whole goes does not matter.
/// How segments turn about their own centres is left as it is.
pub(super) fn turning_m(
    o: &Observation,
    segment: Segment,
    moved: impl Fn(Moving) -> Moving,
    all: impl Fn(Moving) -> Moving,
) -> [f64; 2] {
    let centres = Segment::ALL.map(|each| o.point_on(each, o.centre_m[each.index()]));
    let still = Moving { at: [0.0; 3], acceleration: [0.0; 3] };
    let shares = || o.mass_share.iter().zip(&centres);
    let middle = shares().fold(still, |middle, (share, centre)| middle.plus(centre.times(*share)));
    let mut rate = [0.0; 3];
    let (mut shift, mut shift_of_all) = (still, still);
    for each in Segment::ALL.into_iter().filter(|each| each.is_distal_to(segment)) {
        let share = o.mass_share[each.index()];
        let arm = o.arm_to(segment, each);
        let (own, other) = (moved(arm), all(arm));
        let from_middle = centres[each.index()].plus(middle.times(-1.0));
        rate = sum(rate, moment(share, own.at, sum(from_middle.acceleration, other.acceleration)));
        rate = sum(rate, moment(share, from_middle.at, own.acceleration));
        shift = shift.plus(own.times(share));
        shift_of_all = shift_of_all.plus(other.times(share));
    }
    let [x, y, _] = sum(rate, moment(-1.0, shift.at, shift_of_all.acceleration));
    let specific = o.specific_force_m_per_s2();
    [-y / specific, x / specific]
}

fn moment(share: f64, at: [f64; 3], acceleration: [f64; 3]) -> [f64; 3] {
    cross(at, acceleration).map(|part| share * part)
}

impl Observation {
    /// From a segment's origin to what moves a distal segment's centre when the first one turns: its own centre, or the
    /// joint that the distal one hangs on.
    fn arm_to(&self, segment: Segment, distal: Segment) -> Moving {
        let mut child = distal;
        if child == segment {
            return self.turned(segment, self.centre_m[segment.index()]);
        }
        while let Some(parent) = child.parent().filter(|parent| *parent != segment) {
            child = parent;
        }
        self.origin(child).plus(self.origin(segment).times(-1.0))
    }
}
