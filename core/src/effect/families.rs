//! Effects that data cannot distinguish, or only in some poses and motions (`equipoise reconcile` requests those).

use super::{Effect, Place};
use crate::body::{Segment, Side};

type Member = (Effect, Place);

const fn whole(effect: Effect) -> Member {
    (effect, Place::Whole)
}

const fn on(effect: Effect, segment: Segment) -> Member {
    (effect, Place::Segment(segment))
}

const fn hand(effect: Effect, side: Side) -> Member {
    (effect, Place::Hand(side))
}

/// Explanations that can replace each other; in each row, any two of its entries.
const FAMILIES: [&[Member]; 8] = [
    // Until the feet turn, a shift of the plate is equivalent to another centre of mass of the pelvis.
    &[whole(Effect::PlateOffset), on(Effect::UnbalancedParameters, Segment::Pelvis)],
    // Only time distinguishes a rotated plate from a rotating suit, and only another position on the plate from a suit
    // that has rotated.
    &[whole(Effect::PlateYaw), whole(Effect::SuitHeadingDrift)],
    // The mass on two legs that move alike is equivalent to a mass on the pelvis.
    &[
        on(Effect::WornMass, Segment::Pelvis),
        on(Effect::WornMass, Segment::RightUpperLeg),
        on(Effect::WornMass, Segment::LeftUpperLeg),
    ],
    // A backpack and a misaligned sensor have the same effect on the CoP; only the backpack changes the weight on the
    // plate.
    &[on(Effect::WornMass, Segment::T8), on(Effect::SegmentMisalignment, Segment::T8)],
    // To distinguish them, elbow and wrist must move separately.
    &[hand(Effect::HandLoad, Side::Right), on(Effect::WornMass, Segment::RightForearm)],
    &[hand(Effect::HandLoad, Side::Left), on(Effect::WornMass, Segment::LeftForearm)],
    // Only fast motion distinguishes one delay from another.
    &[whole(Effect::SuitLag), whole(Effect::PlateLowpass), whole(Effect::Inertia)],
    // For an upright trunk, rotation about the vertical equals rotation about its own axis.
    &[on(Effect::SegmentHeading, Segment::T8), on(Effect::SegmentMisalignment, Segment::T8)],
];

impl Effect {
    /// Whether the two effects at their places are listed as one family.
    pub fn is_family_of(self, place: Place, other: Effect, there: Place) -> bool {
        let (one, two) = ((self, place), (other, there));
        let listed = FAMILIES.iter().any(|family| family.contains(&one) && family.contains(&two));
        one != two && (listed || by_rule(one, two) || by_rule(two, one))
    }

    /// All effects at listed places that the data may not distinguish from this effect at this place.
    pub fn family(self, place: Place) -> impl Iterator<Item = (Effect, Place)> {
        let everywhere = |effect: Effect| effect.places().iter().map(move |place| (effect, *place));
        Effect::ALL
            .into_iter()
            .flat_map(everywhere)
            .filter(move |&(other, there)| self.is_family_of(place, other, there))
    }
}

/// Families that apply at every place.
fn by_rule((one, here): Member, (two, there): Member) -> bool {
    match (one, two) {
        // The vertical force alone does not distinguish a plate with too high readings from a heavier body.
        (Effect::ForceGain, Effect::WornMass) => true,
        // `R (δ × φ)` is equivalent to a changed φ: the same column.
        (Effect::SegmentMisalignment, Effect::UnbalancedParameters) => here == there,
        // A supported hand is equivalent to a lifting load as long as its height is constant.
        (Effect::HandContact, Effect::HandLoad) => here == there,
        _ => false,
    }
}
