//! Loads and contacts, as they act on the body: masses carried along by a segment, whose weight and inertia are a force
//! on it, and forces on a hand.

use super::geometry::{AXES, Column, Moving};
use super::{Columns, Observation, Parameter, Place};
use crate::GRAVITY_M_PER_S2;
use crate::body::{Segment, Side};

/// The parameters of a carried mass with their prior: 1-σ of the mass, kg, and of its first moment on each axis, kg m.
const fn mass(mass_kg: f64, moment_kg_m: f64) -> [Parameter; 4] {
    [
        Parameter { name: "mass_kg", unit: "kg", prior_sigma: mass_kg },
        Parameter { name: "mx_kg_m", unit: "kg m", prior_sigma: moment_kg_m },
        Parameter { name: "my_kg_m", unit: "kg m", prior_sigma: moment_kg_m },
        Parameter { name: "mz_kg_m", unit: "kg m", prior_sigma: moment_kg_m },
    ]
}

/// Columns of one kilogram at a point of a segment, and of one kilogram metre of first moment about it on each of the
/// segment's axes.
///
/// Exact for a point mass. Its moment of inertia (kg m²), which acts only in rotation, is neglected.
fn carried(o: &Observation, segment: Segment, point: Moving) -> [Column; 4] {
    let force = |Moving { acceleration: [x, y, z], .. }: Moving| [-x, -y, -z];
    let [x, y, z] = force(point);
    let weight = [x, y, z - GRAVITY_M_PER_S2];
    let [forward, left, up] = AXES.map(|axis| {
        let aside = o.turned(segment, axis);
        o.of_force(point.at, force(aside)).plus(o.of_moved_force(aside.at, weight))
    });
    [o.of_force(point.at, weight), forward, left, up]
}

pub(super) const HAND_LOAD: [Parameter; 4] = mass(5.0, 0.2);
/// 1-σ of the mass in both hands, kg.
pub(super) const BOTH_HANDS_SIGMA_KG: f64 = 8.0;
/// 1-σ of the distance of a load's centre from the grip, on each axis, m.
pub(super) const GRIP_ARM_SIGMA_M: f64 = 0.04;

/// `hand_load`: a mass in a hand, or one shared equally by both. Columns: the mass, then its first moment about the
/// grip in the hand's axes; for both hands, half each.
pub(super) fn hand_load(place: Place, o: &Observation) -> Columns {
    let one = |side: Side| carried(o, side.hand(), o.grip(side));
    match place {
        Place::Hand(side) => Columns::of(&one(side)),
        Place::BothHands => {
            let [left, right] = Side::BOTH.map(one);
            let both: [Column; 4] = core::array::from_fn(|index| left[index].plus(right[index]).times(0.5));
            Columns::of(&both)
        }
        _ => Columns::zero(HAND_LOAD.len()),
    }
}

pub(super) const WORN_MASS: [Parameter; 4] = mass(5.0, 0.3);

/// `worn_mass`: a mass fixed to a segment: tools on a belt, a backpack, a cuff. Columns: the mass at the segment's
/// centre of mass, then its first moment about it in the segment's axes.
pub(super) fn worn_mass(place: Place, o: &Observation) -> Columns {
    let Place::Segment(segment) = place else { return Columns::zero(WORN_MASS.len()) };
    let centre = o.point_on(segment, o.centre_m[segment.index()]);
    Columns::of(&carried(o, segment, centre))
}

/// 1-σ of the mass worn on a segment, kg: larger for the trunk than for limbs.
pub(super) fn worn_mass_sigma_kg(segment: Segment) -> f64 {
    match segment {
        Segment::T8 => 8.0,
        Segment::Pelvis | Segment::L5 | Segment::L3 | Segment::T12 => 5.0,
        _ => 1.5,
    }
}

/// 1-σ of the distance of a worn mass from the segment's centre, on each axis, m.
pub(super) fn worn_arm_sigma_m(segment: Segment) -> f64 {
    match segment {
        Segment::T8 => 0.22,
        Segment::Pelvis | Segment::L5 | Segment::L3 | Segment::T12 => 0.16,
        _ => 0.06,
    }
}

pub(super) const HAND_CONTACT: [Parameter; 3] = [
    Parameter { name: "fx_n", unit: "N", prior_sigma: 30.0 },
    Parameter { name: "fy_n", unit: "N", prior_sigma: 30.0 },
    Parameter { name: "fz_n", unit: "N", prior_sigma: 60.0 },
];

/// `hand_contact`: a contact pushes or supports a hand; the force is constant in the station world. Columns: the force
/// on the body along each axis of the world, at the grip. Leaning on a bench is `fz_n` > 0.
pub(super) fn hand_contact(place: Place, o: &Observation) -> Columns {
    let Place::Hand(side) = place else { return Columns::zero(HAND_CONTACT.len()) };
    let grip = o.grip(side);
    Columns::of(&AXES.map(|axis| o.of_force(grip.at, axis)))
}
