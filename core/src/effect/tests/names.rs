extern crate std;
use std::vec::Vec;

use crate::body::{Segment, Side};
use crate::effect::{Effect, PARAMETERS_MAX, Place};

fn everywhere() -> impl Iterator<Item = (Effect, Place)> {
    Effect::ALL.into_iter().flat_map(|effect| effect.places().iter().map(move |place| (effect, *place)))
}

#[test]
fn names_map_back_to_their_effects() {
    for (index, effect) in Effect::ALL.into_iter().enumerate() {
        assert_eq!(effect as usize, index);
        assert_eq!(Effect::from_name(effect.name()), Some(effect));
    }
    assert_eq!(Effect::from_name("hand load"), None);
}

#[test]
fn parameters_have_units_and_priors() {
    for (effect, place) in everywhere() {
        for shape in [0.0, 20.0] {
            let parameters = effect.parameters_of(shape);
            assert_eq!(parameters.len(), effect.parameters().len());
            assert!((1..=PARAMETERS_MAX).contains(&parameters.len()));
            let sigma = effect.prior_sigma(place, shape);
            for (index, parameter) in parameters.iter().enumerate() {
                assert!(sigma[index] > 0.0 && parameter.prior_sigma > 0.0, "{}", effect.name());
                let suffix = match parameter.unit {
                    "1" => "",
                    unit => unit,
                };
                let suffix = suffix.replace('/', "_per_").replace(' ', "_").to_lowercase();
                assert!(parameter.name.ends_with(&suffix), "{} {}", effect.name(), parameter.name);
            }
            assert!(sigma[parameters.len()..].iter().all(|sigma| *sigma == 0.0));
        }
    }
}

/// The prior must extend beyond the smallest size of interest, or the effect could never be named.
#[test]
fn one_sigma_of_the_prior_is_of_interest() {
    for (effect, place) in everywhere() {
        let shapes = if effect == Effect::PlateDrift { [0.0, 20.0] } else { [0.0; 2] };
        for shape in shapes {
            let size = effect.size(shape, &effect.prior_sigma(place, shape));
            assert!(size > effect.smallest_of_interest(), "{} {place:?}: {size}", effect.name());
        }
    }
    assert_eq!(Effect::PlateLowpass.size(0.0, &[0.0; PARAMETERS_MAX]), 0.0);
}

#[test]
fn families_are_symmetric_and_exclude_the_effect_itself() {
    for (effect, place) in everywhere() {
        for (other, there) in effect.family(place) {
            assert!(other.is_family_of(there, effect, place), "{} {}", effect.name(), other.name());
            assert!((other, there) != (effect, place));
        }
    }
}

#[test]
fn the_families_of_the_table_are_declared() {
    let family = |effect: Effect, place: Place| effect.family(place).collect::<Vec<_>>();
    let on = Place::Segment;
    let offset = family(Effect::PlateOffset, Place::Whole);
    assert_eq!(offset, [(Effect::UnbalancedParameters, on(Segment::Pelvis))]);
    assert_eq!(family(Effect::PlateYaw, Place::Whole), [(Effect::SuitHeadingDrift, Place::Whole)]);
    let lag = family(Effect::SuitLag, Place::Whole);
    assert_eq!(lag, [(Effect::PlateLowpass, Place::Whole), (Effect::Inertia, Place::Whole)]);
    let belt = family(Effect::WornMass, on(Segment::Pelvis));
    let thighs = [Segment::RightUpperLeg, Segment::LeftUpperLeg].map(|leg| (Effect::WornMass, on(leg)));
    assert_eq!(belt, [thighs[0], thighs[1], (Effect::ForceGain, Place::Whole)]);
    let load = family(Effect::HandLoad, Place::Hand(Side::Right));
    let arm = (Effect::WornMass, on(Segment::RightForearm));
    assert_eq!(load, [(Effect::HandContact, Place::Hand(Side::Right)), arm]);
    assert!(family(Effect::PlateGain, Place::Whole).is_empty());
    assert!(Effect::WornMass.accepts(on(Segment::Neck)) && !Effect::PlateGain.accepts(on(Segment::Neck)));
}
