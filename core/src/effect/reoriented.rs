//! Effect of one segment's wrong orientation on the rotation of the body: all distal segments have another position and
//! acceleration, which changes the rate of angular momentum.

use super::Observation;
use super::geometry::{Moving, cross, sum};
use crate::body::Segment;

/// Shift of the CoP by the rotation of the body, m, if every arm from the segment's origin to a distal part is changed
/// by `moved(arm)`; per unit, in addition to a common change of all of them by `all(arm)`.
///
/// `L̇ = Σ m (r − c) × (r̈ − c̈)` with `Δr`, `Δr̈` of every distal centre; a motion of the whole body has no effect.
/// The rotation of segments about their own centres is unchanged.
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
    /// Arm from a segment's origin to the point that moves a distal segment's centre when the first one rotates: its
    /// own centre, or the joint at which the distal one is attached.
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
