//! Beam search over explanations: each is extended by every further effect that the data may require, and the most
//! probable results are extended again. An effect that was added first may be explained by effects added later, so
//! explanations without one of their effects are compared as well.

use std::collections::BTreeSet;

use equipoise_core::effect::Effect;

use crate::constants::{BEAM, CHECKED_MAX, MEMBERS_MAX};
use crate::explanation::{Explanation, Levels, Member, Outside};
use crate::generic::Library;
use crate::gram::Gram;
use crate::plausibility::impossibility;

/// All explanations that the search evaluates, without columns, most probable first. `extended` returns an explanation
/// with each further effect that the data may require; `reduced` returns it without each of its effects in turn, except
/// sets whose keys are already evaluated.
pub(crate) fn search(
    mut extended: impl FnMut(&Explanation) -> Vec<Explanation>,
    reduced: impl Fn(&Explanation, &BTreeSet<Vec<String>>) -> Vec<Explanation>,
) -> Vec<Explanation> {
    let mut all = vec![Explanation::NONE];
    let mut front = all.clone();
    let mut visited = BTreeSet::new();
    while !front.is_empty() {
        let mut changed: Vec<Changed> = Vec::new();
        for from in &front {
            visited.insert(from.key());
            if from.members.len() == MEMBERS_MAX {
                continue;
            }
            changed.extend(extended(from).into_iter().map(|explanation| Changed::new(explanation, from)));
        }
        all.extend(changed.iter().map(|one| one.explanation.without_columns()));
        let mut best = promising(changed, &all, &visited);
        let keys: BTreeSet<Vec<String>> = all.iter().map(Explanation::key).collect();
        for from in best.iter().map(|one| one.explanation.clone()).collect::<Vec<Explanation>>() {
            best.extend(reduced(&from, &keys).into_iter().map(|smaller| Changed::new(smaller, &from)));
        }
        all.extend(best.iter().map(|one| one.explanation.without_columns()));
        front = promising(best, &all, &visited).into_iter().map(|one| one.explanation).collect();
    }
    ranked(all)
}

/// An explanation and its origin, the explanation that was extended or reduced, without columns.
struct Changed {
    explanation: Explanation,
    from: Explanation,
}

impl Changed {
    fn new(explanation: Explanation, from: &Explanation) -> Changed {
        Changed { explanation, from: from.without_columns() }
    }
}

/// The explanations to extend: more probable than their origin, and at most the limit of [`BEAM`] below the best of all.
fn promising(changed: Vec<Changed>, all: &[Explanation], visited: &BTreeSet<Vec<String>>) -> Vec<Changed> {
    let (size_max, behind_max) = BEAM;
    let levels = Levels::of(all);
    let best = all.iter().map(|one| levels.log_posterior(one)).fold(0.0, f64::max);
    let mut rated: Vec<(f64, Changed)> = changed
        .into_iter()
        .map(|one| (levels.log_posterior(&one.explanation), one))
        .filter(|(log_posterior, one)| {
            *log_posterior > levels.log_posterior(&one.from).max(best - behind_max)
        })
        .collect();
    rated.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut keys = visited.clone();
    rated.retain(|(_, one)| keys.insert(one.explanation.key()));
    rated.truncate(size_max);
    rated.into_iter().map(|(_, one)| one).collect()
}

/// The best of those with the same effects, most probable first.
fn ranked(mut all: Vec<Explanation>) -> Vec<Explanation> {
    let levels = Levels::of(&all);
    for explanation in &mut all {
        explanation.log_posterior = levels.log_posterior(explanation);
    }
    all.sort_by(|a, b| b.log_posterior.total_cmp(&a.log_posterior));
    let mut keys = BTreeSet::new();
    all.retain(|explanation| keys.insert(explanation.key()));
    all
}

/// Adds explanations with a term outside the catalogue: to the most probable ones, and to each prefix of the first. All
/// terms of the library are one hypothesis: the best one represents it, with the mean evidence of all.
pub(crate) fn with_outside(
    gram: &Gram<'_>,
    library: &Library,
    mut all: Vec<Explanation>,
) -> Vec<Explanation> {
    let extended: Vec<Explanation> = all
        .iter()
        .enumerate()
        .filter(|(rank, explanation)| *rank < CHECKED_MAX || explanation.is_prefix_of(&all[0]))
        .filter_map(|(_, explanation)| {
            let (conditioned, terms) = explanation.condition(gram);
            let members = explanation.members_with_columns(gram);
            // As a part of this explanation, evidence is divided by the number of all parts plus one.
            let temper = 2.0 + members.len() as f64;
            let (term, log_mean) = library.best(&conditioned, &terms, temper)?;
            let extended = Explanation::of(gram, members, Some(Outside::new(gram, term, log_mean)))?;
            Some(extended.without_columns())
        })
        .collect();
    all.extend(extended);
    ranked(all)
}

/// An explanation without each of its effects in turn, refitted, except sets whose keys are in `known`.
pub(crate) fn reduced(
    gram: &Gram<'_>,
    explanation: &Explanation,
    known: &BTreeSet<Vec<String>>,
) -> Vec<Explanation> {
    let without = |omitted: usize| {
        let mut smaller = explanation.clone();
        smaller.members.remove(omitted);
        if known.contains(&smaller.key()) {
            return None;
        }
        let (conditioned, terms) = smaller.condition(gram);
        let mut values = conditioned.estimate(&terms)?.value.into_iter();
        let members: Vec<_> = smaller
            .members
            .iter()
            .map(|member| member.refitted(values.by_ref().take(member.candidate.count()).collect()))
            .collect();
        if cannot_act_together(&members).is_none() { Explanation::of(gram, members, None) } else { None }
    };
    (0..explanation.members.len()).filter_map(without).collect()
}

/// Why some effects with their parameters cannot act together, if they cannot; independent of their order.
pub(crate) fn cannot_act_together(members: &[Member]) -> Option<&'static str> {
    let alone = members.iter().find_map(|member| impossibility(&member.candidate, &member.value));
    alone
        .or_else(|| cancels_another(members).then_some("would cancel another effect of the same explanation"))
}

/// Whether a weight is negative while another one acts: removing a load that was just added is implausible. A contact may
/// have any direction.
fn cancels_another(members: &[Member]) -> bool {
    let acts_as_weight = |member: &&Member| {
        let effect = member.candidate.effect;
        matches!(effect, Effect::WornMass | Effect::HandLoad | Effect::HandContact | Effect::ForceGain)
    };
    let is_negative =
        |member: &Member| member.candidate.effect != Effect::HandContact && member.value[0] < 0.0;
    let weights: Vec<&Member> = members.iter().filter(acts_as_weight).collect();
    weights.iter().enumerate().any(|(index, one)| {
        let mut others = weights.iter().enumerate().filter(|(other, _)| *other != index);
        is_negative(one) && others.any(|(_, other)| one.candidate.scope.overlaps(other.candidate.scope))
    })
}

#[cfg(test)]
mod tests {
    use equipoise_core::body::{Segment, Side};
    use equipoise_core::effect::Place;

    use super::*;
    use crate::candidate::{Candidate, Scope};

    const EFFECTS: [(Effect, Place); 3] = [
        (Effect::WornMass, Place::Segment(Segment::T8)),
        (Effect::PlateLowpass, Place::Whole),
        (Effect::WornMass, Place::Segment(Segment::Pelvis)),
    ];

    /// An explanation by some effects: the last two have the evidence; the first explains part of it until both are added.
    fn explanation(effects: &[usize]) -> Explanation {
        let members = effects.iter().map(|&effect| {
            let (effect, place) = EFFECTS[effect];
            Member::without_columns(Candidate::new(effect, place, 0.0, Scope::Work))
        });
        let has = |effect: usize| effects.contains(&effect);
        let mass = if has(2) { 960.0 } else { 0.0_f64 };
        let stand_in = if has(0) { 1000.0 - 40.0 * f64::from(u8::from(has(2))) } else { 0.0 };
        let filter = match (has(1), has(0), has(2)) {
            (false, ..) => 0.0,
            (true, _, true) => 500.0,
            (true, ..) => 300.0,
        };
        let log_evidence = mass.max(stand_in) + filter + if has(0) && has(2) { 1.0 } else { 0.0 };
        let members: Vec<Member> = members.collect();
        let log_prior = -3.0 * members.len() as f64;
        Explanation { members, log_evidence, log_prior, ..Explanation::NONE }
    }

    fn indices(explanation: &Explanation) -> Vec<usize> {
        let of = |member: &Member| {
            let of_member = |&(effect, place): &(Effect, Place)| {
                (effect, place) == (member.candidate.effect, member.candidate.place)
            };
            EFFECTS.iter().position(of_member).unwrap()
        };
        explanation.members.iter().map(of).collect()
    }

    #[test]
    fn an_effect_that_stood_in_for_another_is_left_out_again() {
        let extended = |from: &Explanation| {
            let acting = indices(from);
            let further = (0..EFFECTS.len()).filter(|effect| !acting.contains(effect));
            further.map(|effect| explanation(&[acting.clone(), vec![effect]].concat())).collect()
        };
        let without_each = |from: &Explanation, _: &BTreeSet<Vec<String>>| {
            let acting = indices(from);
            let others = |omitted: usize| -> Vec<usize> {
                acting.iter().copied().filter(|&effect| effect != omitted).collect()
            };
            acting.iter().map(|&omitted| explanation(&others(omitted))).collect()
        };
        let of = |all: Vec<Explanation>| all[0].key();
        let expected = explanation(&[1, 2]).key();
        assert_eq!(of(search(extended, without_each)), expected);
        let kept = of(search(extended, |_, _| Vec::new()));
        assert_ne!(kept, expected);
    }

    #[test]
    fn the_order_in_which_effects_were_added_does_not_change_their_probability() {
        let all = [&[][..], &[0], &[2], &[0, 1], &[1, 2], &[2, 1]].map(explanation);
        let levels = Levels::of(&all);
        let [.., one, other] = all.each_ref().map(|one| levels.log_posterior(one));
        assert!((one - other).abs() < 1e-12, "{one} and {other}");
        // Half the evidence of one effect, and a third of what two add to the best of one.
        assert!((levels.log_posterior(&all[1]) - (500.0 - 3.0)).abs() < 1e-12);
        assert!((one - (500.0 + 460.0 / 3.0 - 6.0)).abs() < 1e-12, "{one}");
    }

    #[test]
    fn a_weight_that_cancels_another_is_impossible_in_any_order() {
        let member = |effect: Effect, place: Place, scope: Scope, value: f64| {
            let candidate = Candidate::new(effect, place, 0.0, scope);
            let mut all = vec![0.0; candidate.count()];
            all[0] = value;
            Member::without_columns(candidate).refitted(all)
        };
        let (t8, right) = (Place::Segment(Segment::T8), Place::Hand(Side::Right));
        let worn = |value: f64| member(Effect::WornMass, t8, Scope::Work, value);
        let load = || member(Effect::HandLoad, right, Scope::Work, 2.0);
        let push = || member(Effect::HandContact, right, Scope::Work, -20.0);
        let yaw = || member(Effect::PlateYaw, Place::Whole, Scope::Work, -0.1);
        let gain = |span_s, value: f64| member(Effect::ForceGain, Place::Whole, Scope::Span(span_s), value);
        let is_possible = |pair: [Member; 2]| {
            let [one, other] = pair.clone();
            let both = [cannot_act_together(&pair), cannot_act_together(&[other, one])];
            assert_eq!(both[0], both[1]);
            both[0].is_none()
        };
        assert!(!is_possible([worn(-1.5), load()]));
        assert!(!is_possible([worn(-1.5), push()]));
        assert!(!is_possible([gain([0.0, 20.0], -0.01), load()]));
        assert!(is_possible([worn(1.5), load()]));
        assert!(is_possible([load(), push()]));
        assert!(is_possible([worn(-1.5), yaw()]));
        // One after the other: a change of sign.
        assert!(is_possible([gain([0.0, 20.0], 0.01), gain([20.0, 40.0], -0.01)]));
    }
}
