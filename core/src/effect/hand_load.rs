//! `hand_load`: a mass in a hand, or one shared equally by both.

use super::geometry::Column;
use super::{Columns, Observation, Parameter, Place, mass};
use crate::body::Side;

pub(super) const PARAMETERS: [Parameter; 4] = mass::parameters(5.0, 0.2);
/// 1-σ of the mass in both hands, kg.
pub(super) const BOTH_HANDS_SIGMA_KG: f64 = 8.0;
/// 1-σ of the distance of a load's centre from the grip, on each axis, m.
pub(super) const ARM_SIGMA_M: f64 = 0.04;

/// Columns: the mass, then its first moment about the grip in the hand's axes; for both hands, half each.
pub(super) fn columns(place: Place, o: &Observation) -> Columns {
    let one = |side: Side| mass::carried(o, side.hand(), o.grip(side));
    match place {
        Place::Hand(side) => Columns::of(&one(side)),
        Place::BothHands => {
            let [left, right] = Side::BOTH.map(one);
            let both: [Column; 4] = core::array::from_fn(|index| left[index].plus(right[index]).times(0.5));
            Columns::of(&both)
        }
        _ => Columns::zero(PARAMETERS.len()),
    }
}
