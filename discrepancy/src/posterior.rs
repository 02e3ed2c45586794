//! Posterior probabilities of explanations and of the names in them.

use std::collections::{BTreeMap, BTreeSet};

use equipoise_core::effect::Effect;

use crate::constants::{CHECKED_MAX, NAMED_PROBABILITY, RIVAL_PROBABILITY_MIN, UNEXPLAINED_PROBABILITY};
use crate::evidence::log_sum_exp;
use crate::explanation::Explanation;
use crate::finding::Generic;

/// The name of all effects with the same columns: a misaligned sensor is a changed φ of its segment.
fn class(name: &str) -> String {
    let [misaligned, unbalanced] =
        [Effect::SegmentMisalignment, Effect::UnbalancedParameters].map(Effect::name);
    name.replace(unbalanced, misaligned)
}

/// Whether two names stand for the same columns.
pub(crate) fn same_columns(one: &str, other: &str) -> bool {
    class(one) == class(other)
}

/// The name of anything outside the catalogue.
pub(crate) const OUTSIDE: &str = "outside the catalogue";

/// A probable set of names, and what its most probable explanation predicts.
#[derive(Debug, Clone)]
pub(crate) struct Predictor<P> {
    /// Names of its effects that are not negligible, and [`OUTSIDE`], sorted; one name for those with the same columns.
    pub(crate) names: Vec<String>,
    /// Probability of the set, relative to the other predictors.
    pub(crate) probability: f64,
    /// Its prediction.
    pub(crate) prediction: P,
}

/// Sets of names that act together, and their probabilities.
#[derive(Debug, Clone)]
pub(crate) struct NameSets {
    /// Of each explanation: names of its effects that are not negligible, and [`OUTSIDE`].
    pub(crate) sets: Vec<Vec<String>>,
    /// Probability of each explanation.
    pub(crate) probabilities: Vec<f64>,
}

/// Posterior over explanations.
#[derive(Debug, Clone)]
pub(crate) struct Posterior {
    /// Explanations, most probable first.
    pub(crate) explanations: Vec<Explanation>,
    /// Their names.
    pub(crate) names: NameSets,
}

impl Posterior {
    /// Of some explanations, at least one, most probable first.
    pub(crate) fn of(explanations: Vec<Explanation>) -> Posterior {
        let logs: Vec<f64> = explanations.iter().map(|one| one.log_posterior).collect();
        let total = log_sum_exp(&logs);
        let probabilities = logs.iter().map(|log| (log - total).exp()).collect();
        let sets = explanations.iter().map(Explanation::names).collect();
        Posterior { explanations, names: NameSets { sets, probabilities } }
    }

    /// The most probable sets of names, each with the prediction of its most probable explanation; those without one are
    /// left out.
    pub(crate) fn predictors<P>(&self, predict: impl Fn(&Explanation) -> Option<P>) -> Vec<Predictor<P>> {
        let mut sets: Vec<(Vec<String>, f64, &Explanation)> = Vec::new();
        for (explanation, &probability) in self.explanations.iter().zip(&self.names.probabilities) {
            let mut names: Vec<String> = explanation.names().iter().map(|name| class(name)).collect();
            names.sort();
            names.dedup();
            match sets.iter_mut().find(|(set, ..)| *set == names) {
                Some((_, sum, _)) => *sum += probability,
                None => sets.push((names, probability, explanation)),
            }
        }
        sets.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut predictors: Vec<Predictor<P>> = sets
            .into_iter()
            .take(CHECKED_MAX)
            .filter_map(|(names, probability, explanation)| {
                Some(Predictor { names, probability, prediction: predict(explanation)? })
            })
            .collect();
        let total: f64 = predictors.iter().map(|predictor| predictor.probability).sum();
        if total <= 0.0 {
            return Vec::new();
        }
        predictors.iter_mut().for_each(|predictor| predictor.probability /= total);
        predictors
    }

    /// The most probable term outside the catalogue.
    pub(crate) fn outside(&self) -> Option<Generic> {
        let mut outside = self.explanations.iter().filter_map(|explanation| explanation.outside.as_ref());
        outside.next().map(|outside| outside.generic.clone())
    }
}

impl NameSets {
    /// All names.
    pub(crate) fn all(&self) -> BTreeSet<String> {
        self.sets.iter().flatten().cloned().collect()
    }

    /// Whether something outside the catalogue is more probable than not, or established like an effect of the most
    /// probable explanation.
    pub(crate) fn is_outside(&self) -> bool {
        self.of_name(OUTSIDE) >= UNEXPLAINED_PROBABILITY
            || self.established().iter().any(|name| name == OUTSIDE)
    }

    /// Whether the names are certain, or that there are none, or that something outside the catalogue acts.
    pub(crate) fn is_decided(&self) -> bool {
        let is_certain = |probability: f64| probability >= NAMED_PROBABILITY;
        let established = self.established();
        if self.is_outside() {
            is_certain(self.of_name(OUTSIDE))
        } else if established.is_empty() {
            is_certain(self.total(<[String]>::is_empty))
        } else {
            established.iter().all(|name| is_certain(self.of_name(name)))
        }
    }

    /// Probability that an effect of this name acts. Effects with the same columns count as one: no data distinguish
    /// them.
    pub(crate) fn of_name(&self, name: &str) -> f64 {
        self.total(|names| names.iter().any(|acting| same_columns(acting, name)))
    }

    /// Names of the most probable explanation that are established: the probability that the effect, or one in its
    /// place, acts is at least [`NAMED_PROBABILITY`]. The least probable is left out until all are: of two that may
    /// replace each other, one is then the other's rival.
    pub(crate) fn established(&self) -> Vec<String> {
        let most = self.probabilities.iter().enumerate().rev().max_by(|a, b| a.1.total_cmp(b.1));
        let mut names = most.map(|(most, _)| self.sets[most].clone()).unwrap_or_default();
        while let Some((least, probability)) = names
            .iter()
            .enumerate()
            .map(|(place, name)| (place, self.of_name_or_rival(name, &names)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            && probability < NAMED_PROBABILITY
        {
            names.remove(least);
        }
        names
    }

    /// Probability that an effect of this name, or one in its place, acts: of all explanations except those with nothing
    /// but others of some names.
    fn of_name_or_rival(&self, name: &str, names: &[String]) -> f64 {
        let is_other = |acting: &String| names.contains(acting) && !same_columns(acting, name);
        self.total(|acting| !acting.iter().all(is_other))
    }

    /// Probability of the explanations with such names.
    fn total(&self, is_such: impl Fn(&[String]) -> bool) -> f64 {
        let such = self.sets.iter().zip(&self.probabilities).filter(|(names, _)| is_such(names));
        // The sum may exceed 1 by rounding.
        such.map(|(_, probability)| probability).sum::<f64>().min(1.0)
    }

    /// Names that act in explanations without this one, with a total probability above [`RIVAL_PROBABILITY_MIN`]; none
    /// that is established itself. Most probable first.
    pub(crate) fn rivals(&self, name: &str, established: &[String]) -> Vec<(String, f64)> {
        let mut instead: BTreeMap<String, f64> = BTreeMap::new();
        for (names, probability) in self.sets.iter().zip(&self.probabilities) {
            if !names.iter().any(|other| same_columns(other, name)) {
                for other in names {
                    *instead.entry(other.clone()).or_insert(0.0) += probability;
                }
            }
        }
        let is_established = |other: &str| established.iter().any(|named| same_columns(named, other));
        let mut rivals: Vec<(String, f64)> = instead
            .into_iter()
            .filter(|(other, probability)| *probability > RIVAL_PROBABILITY_MIN && !is_established(other))
            .collect();
        rivals.sort_by(|a, b| b.1.total_cmp(&a.1));
        rivals
    }
}

#[cfg(test)]
mod tests {
    use equipoise_core::body::{Segment, Side};
    use equipoise_core::effect::Place;

    use super::*;
    use crate::candidate::{Candidate, Scope};
    use crate::explanation::{Member, Outside};

    fn explanation(effects: &[(Effect, Place)], weight: f64) -> Explanation {
        let member = |&(effect, place): &(Effect, Place)| {
            Member::without_columns(Candidate::new(effect, place, 0.0, Scope::Work))
        };
        let members = effects.iter().map(member).collect();
        Explanation { members, log_posterior: weight.ln(), ..Explanation::NONE }
    }

    fn is(value: f64, expected: f64) {
        assert!((value - expected).abs() < 1e-12, "{value} instead of {expected}");
    }

    #[test]
    fn probabilities_of_names_are_sums_over_explanations() {
        let load = (Effect::HandLoad, Place::Hand(Side::Right));
        let forearm = (Effect::WornMass, Place::Segment(Segment::RightForearm));
        let [misaligned, unbalanced] = [Effect::SegmentMisalignment, Effect::UnbalancedParameters]
            .map(|effect| (effect, Place::Segment(Segment::T8)));
        let posterior = Posterior::of(vec![
            explanation(&[load, misaligned], 0.4),
            explanation(&[load, unbalanced], 0.2),
            explanation(&[forearm, misaligned], 0.2),
            explanation(&[load], 0.1),
            explanation(&[], 0.1),
        ]);
        is(posterior.names.of_name("hand_load right"), 0.7);
        // One name, since no data distinguish them.
        is(posterior.names.of_name("segment_misalignment T8"), 0.8);
        is(posterior.names.of_name("unbalanced_parameters T8"), 0.8);
        let rivals = posterior.names.rivals("hand_load right", &posterior.explanations[0].names());
        assert_eq!(rivals.len(), 1, "{rivals:?}");
        assert_eq!(rivals[0].0, "worn_mass RightForearm");
        is(rivals[0].1, 0.2);
        // Something carries the load in all explanations but the last; nothing replaces T8 in the last two.
        let best = posterior.explanations[0].names();
        is(posterior.names.of_name_or_rival("hand_load right", &best), 0.9);
        is(posterior.names.of_name_or_rival("segment_misalignment T8", &best), 0.8);
        assert!(posterior.names.established().is_empty());
    }

    #[test]
    fn of_two_effects_that_replace_each_other_the_more_probable_one_is_established() {
        let load = (Effect::HandLoad, Place::Hand(Side::Right));
        let forearm = (Effect::WornMass, Place::Segment(Segment::RightForearm));
        let posterior = Posterior::of(vec![
            explanation(&[load, forearm], 0.4),
            explanation(&[load], 0.37),
            explanation(&[forearm], 0.2),
            explanation(&[], 0.03),
        ]);
        let established = posterior.names.established();
        assert_eq!(established, ["hand_load right"]);
        assert_eq!(posterior.names.rivals("hand_load right", &established)[0].0, "worn_mass RightForearm");
    }

    #[test]
    fn what_is_outside_the_catalogue_is_a_rival_of_every_name() {
        let load = (Effect::HandLoad, Place::Hand(Side::Right));
        let outside = Explanation { outside: Some(Outside::named("a spring")), ..explanation(&[], 0.3) };
        let posterior = Posterior::of(vec![explanation(&[load], 0.68), outside, explanation(&[], 0.02)]);
        is(posterior.names.of_name(OUTSIDE), 0.3);
        assert!(!posterior.names.is_outside());
        let established = posterior.names.established();
        assert_eq!(established, ["hand_load right"]);
        let rivals = posterior.names.rivals("hand_load right", &established);
        assert_eq!((rivals.len(), rivals[0].0.as_str()), (1, OUTSIDE));
        // Something acts, most probably none of the catalogue.
        let forearm = (Effect::WornMass, Place::Segment(Segment::RightForearm));
        let outside = Explanation { outside: Some(Outside::named("a spring")), ..explanation(&[], 0.45) };
        assert!(
            Posterior::of(vec![outside, explanation(&[load], 0.4), explanation(&[forearm], 0.15)])
                .names
                .is_outside()
        );
    }

    #[test]
    fn explanations_without_a_prediction_are_left_out() {
        let load = (Effect::HandLoad, Place::Hand(Side::Right));
        let posterior = Posterior::of(vec![explanation(&[load], 0.9), explanation(&[], 0.1)]);
        let some = posterior.predictors(|one| one.members.is_empty().then_some(()));
        assert_eq!(some.len(), 1);
        assert!(some[0].names.is_empty());
        is(some[0].probability, 1.0);
        assert!(posterior.predictors(|_| None::<()>).is_empty());
    }

    #[test]
    fn decided_are_certain_names_certainly_none_and_certainly_outside() {
        let sets = |each: &[(&[&str], f64)]| NameSets {
            sets: each.iter().map(|(names, _)| names.iter().map(|&name| name.to_owned()).collect()).collect(),
            probabilities: each.iter().map(|(_, probability)| *probability).collect(),
        };
        let (load, sway) = ("hand_load right", "periodic_sway");
        assert!(sets(&[(&[load], 0.96), (&[], 0.04)]).is_decided());
        assert!(!sets(&[(&[load], 0.9), (&[], 0.1)]).is_decided());
        // The load is certain, and the sway may as well be absent: the verdict is `named`.
        assert!(sets(&[(&[load, sway], 0.6), (&[load], 0.4)]).is_decided());
        assert!(sets(&[(&[], 0.96), (&[load], 0.04)]).is_decided());
        // The verdict is `none`, and a load is nearly as probable.
        assert!(!sets(&[(&[], 0.6), (&[load], 0.4)]).is_decided());
        assert!(!sets(&[(&[OUTSIDE], 0.6), (&[load], 0.4)]).is_decided());
        assert!(sets(&[(&[OUTSIDE, load], 0.6), (&[OUTSIDE], 0.4)]).is_decided());
        // The order of the sets is not that of their probabilities.
        assert!(sets(&[(&[load], 0.04), (&[sway], 0.96)]).is_decided());
    }
}
