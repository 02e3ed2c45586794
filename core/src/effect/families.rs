//! Which effects data cannot tell apart, or only some poses and motions can (`equipoise reconcile` asks for those).

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

/// Explanations that stand for each other; all of a row at any pair of its places.
const FAMILIES: [&[Member]; 8] = [
    // Until the feet turn, a shifted plate is a pelvis whose centre lies elsewhere.
    &[whole(Effect::PlateOffset), on(Effect::UnbalancedParameters, Segment::Pelvis)],
    // Only time tells a turned plate from a suit that turns, and only another place on the plate from one that turned.
    &[whole(Effect::PlateYaw), whole(Effect::SuitHeadingDrift)],
    // Two legs that move alike bear what the pelvis bears.
    &[
        on(Effect::WornMass, Segment::Pelvis),
        on(Effect::WornMass, Segment::RightUpperLeg),
        on(Effect::WornMass, Segment::LeftUpperLeg),
    ],
    // The centre of pressure of a backpack is that of a crooked sensor; the weight on the plate is not.
    &[on(Effect::WornMass, Segment::T8), on(Effect::SegmentMisalignment, Segment::T8)],
    // Elbow and wrist must move apart.
    &[hand(Effect::HandLoad, Side::Right), on(Effect::WornMass, Segment::RightForearm)],
    &[hand(Effect::HandLoad, Side::Left), on(Effect::WornMass, Segment::LeftForearm)],
    // Only fast motion tells one delay from another.
    &[whole(Effect::SuitLag), whole(Effect::PlateLowpass), whole(Effect::Inertia)],
    // An upright trunk turned about the upright is one turned about its own axis.
    &[on(Effect::SegmentHeading, Segment::T8), on(Effect::SegmentMisalignment, Segment::T8)],
];

impl Effect {
    /// Whether this effect here and that one there are declared as one family.
    pub fn is_family_of(self, place: Place, other: Effect, there: Place) -> bool {
        let (one, two) = ((self, place), (other, there));
        let listed = FAMILIES.iter().any(|family| family.contains(&one) && family.contains(&two));
        one != two && (listed || by_rule(one, two) || by_rule(two, one))
    }

    /// All that these data may not tell from this effect at this place, of the places that are asked about.
    pub fn family(self, place: Place) -> impl Iterator<Item = (Effect, Place)> {
        let everywhere = |effect: Effect| effect.places().iter().map(move |place| (effect, *place));
        Effect::ALL
            .into_iter()
            .flat_map(everywhere)
            .filter(move |&(other, there)| self.is_family_of(place, other, there))
    }
}

/// Families of every place alike.
fn by_rule((one, here): Member, (two, there): Member) -> bool {
    match (one, two) {
        // The vertical force alone does not say whether a plate reads too much or a body weighs more.
        (Effect::ForceGain, Effect::WornMass) => true,
        // `R (δ × φ)` is a changed φ: one and the same column.
        (Effect::SegmentMisalignment, Effect::UnbalancedParameters) => here == there,
        // A hand that is held up is a load that lifts, as long as its height stays.
        (Effect::HandContact, Effect::HandLoad) => here == there,
        _ => false,
    }
}
