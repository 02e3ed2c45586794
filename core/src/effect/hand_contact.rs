//! `hand_contact`: a contact pushes or supports a hand; the force is constant in the station world.

use super::geometry::AXES;
use super::{Columns, Observation, Parameter, Place};

pub(super) const PARAMETERS: [Parameter; 3] = [
    Parameter { name: "fx_n", unit: "N", prior_sigma: 30.0 },
    Parameter { name: "fy_n", unit: "N", prior_sigma: 30.0 },
    Parameter { name: "fz_n", unit: "N", prior_sigma: 60.0 },
];

/// Columns: the force on the body along each axis of the world, at the grip. Leaning on a bench is `fz_n` > 0.
pub(super) fn columns(place: Place, o: &Observation) -> Columns {
    let Place::Hand(side) = place else { return Columns::zero(PARAMETERS.len()) };
    let grip = o.grip(side);
    Columns::of(&AXES.map(|axis| o.of_force(grip.at, axis)))
}
