//! Explanations: sets of effects that act together, each with its own misfit, and their posterior probabilities.
//!
//! No effect acts exactly as its equation says: its strength varies over time, and its onset takes a while. Every
//! explanation therefore carries these deviations in its own covariance before it is compared with others. The size of
//! the misfit is not known; the evidence is averaged over a prior of it (MacKay, Neural Computation 4 (1992), 415–447).

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use equipoise_core::effect::{Columns, Effect};
use faer::Mat;

use crate::candidate::{Candidate, Scope, place_log_prior};
use crate::constants::{
    CHANGE_PRIOR, CHECKED_MAX, EFFECT_PRIOR, EVIDENCE_TEMPER, MISFIT_SCALES, MODEL_ERROR,
    MODEL_ERROR_AT_EDGES, NAMED_PROBABILITY, ONSET_S, OTHER_PRIOR, RIVAL_PROBABILITY_MIN,
};
use crate::evidence::{checked_log_odds, log_sum_exp};
use crate::gram::{Gram, whiten_each};
use crate::linear::{dot, inner};
use crate::plausibility::is_negligible;
use crate::rows::Rows;

/// An effect of an explanation.
#[derive(Debug, Clone)]
pub(crate) struct Member {
    /// The effect, refined.
    pub(crate) candidate: Candidate,
    /// Its parameters, fitted with the other effects of the explanation.
    pub(crate) value: Vec<f64>,
    /// Log Bayes factor when it was added to the others.
    pub(crate) log_odds: f64,
    /// Whether it is too small to be reported.
    pub(crate) is_negligible: bool,
    whitened: Rc<Whitened>,
}

/// Whitened columns of an effect.
#[derive(Debug, Default)]
struct Whitened {
    /// Its contribution.
    effect: Vec<f64>,
    /// Its own columns, then those of its misfit.
    columns: Vec<Vec<f64>>,
    /// Misfit of each column behind its own, 1-σ as a fraction.
    misfit: Vec<f64>,
}

impl Member {
    /// An effect with these parameters, and its deviations from its equation.
    pub(crate) fn new(gram: &Gram<'_>, candidate: Candidate, value: Vec<f64>, log_odds: f64) -> Member {
        let mut columns = gram.whitened(candidate.count(), |block| candidate.columns(gram.rows, block));
        let mut effect = vec![0.0; gram.residual.len()];
        for (column, value) in columns.iter().zip(&value) {
            effect.iter_mut().zip(column).for_each(|(sum, column)| *sum += value * column);
        }
        let (of_misfit, misfit): (Vec<Vec<f64>>, Vec<f64>) =
            misfit_columns(gram, &candidate, &value).into_iter().unzip();
        columns.extend(of_misfit);
        let is_negligible = is_negligible(&candidate, &value);
        Member {
            candidate,
            value,
            log_odds,
            is_negligible,
            whitened: Rc::new(Whitened { effect, columns, misfit }),
        }
    }

    /// The same with the parameters of another fit; its misfit keeps its size.
    pub(crate) fn refitted(&self, value: Vec<f64>) -> Member {
        Member { is_negligible: is_negligible(&self.candidate, &value), value, ..self.clone() }
    }

    /// Log prior of this effect at this place, with this shape and time span.
    fn log_prior(&self) -> f64 {
        let effect = self.candidate.effect;
        let places = effect.places().iter().map(|&place| place_log_prior(effect, place));
        let listed = EFFECT_PRIOR.iter().find(|(_, effects)| effects.contains(&effect));
        let prior = listed.map_or(OTHER_PRIOR, |(prior, _)| *prior);
        let hardly_changes = matches!(
            effect,
            Effect::PlateYaw
                | Effect::PlateGain
                | Effect::PlateCrosstalk
                | Effect::PlateHeight
                | Effect::ForceGain
                | Effect::PlateLowpass
                | Effect::SuitLag
        );
        let is_temporary = matches!(self.candidate.scope, Scope::Span(_));
        let of_span = if hardly_changes && is_temporary { CHANGE_PRIOR.ln() } else { 0.0 };
        of_span + (prior / (1.0 - prior)).ln() - log_sum_exp(&places.collect::<Vec<f64>>())
            + self.candidate.log_prior
    }
}

/// Whitened columns of an effect's misfit, and 1-σ of each as a fraction: hat functions over the work in which each
/// parameter may deviate by a fraction of the effect's size, and at onset and end by all of it.
pub(crate) fn misfit_columns(gram: &Gram<'_>, candidate: &Candidate, value: &[f64]) -> Vec<(Vec<f64>, f64)> {
    let rows = gram.rows;
    let count = candidate.count();
    // Size of the effect in units of the prior, since the parameters' units differ.
    let squares: f64 = value.iter().zip(&candidate.sigma).map(|(value, sigma)| (value / sigma).powi(2)).sum();
    let size = (squares / count as f64).sqrt();
    let columns_at: Vec<Columns> = (0..rows.len())
        .map(
            |block| {
                if block < rows.work_from { Columns::zero(count) } else { candidate.columns(rows, block) }
            },
        )
        .collect();
    let hats = hats(rows, candidate);
    let whitened = whiten_each(rows, gram.noise, hats.len() * count, |block, column| {
        let (peak_s, half_s, _) = hats[column / count];
        let parameter = column % count;
        let near = (1.0 - (rows.time_s(block) - peak_s).abs() / half_s).max(0.0);
        let scale = near * size * candidate.sigma[parameter];
        let at = &columns_at[block];
        (at.cop_m[parameter].map(|value| scale * value), at.force_n[parameter].map(|value| scale * value))
    });
    let fractions = hats.iter().flat_map(|&(_, _, fraction)| std::iter::repeat_n(fraction, count));
    whitened.into_iter().zip(fractions).collect()
}

/// Deviation of an effect from its equation, 1-σ as a fraction, and the number of pieces of the work.
pub(crate) fn model_error(effect: Effect) -> (f64, u32) {
    let [contact, other] = MODEL_ERROR;
    if effect == Effect::HandContact { contact } else { other }
}

/// Peak, half width, s, and 1-σ as a fraction of each deviation.
fn hats(rows: &Rows<'_>, candidate: &Candidate) -> Vec<(f64, f64, f64)> {
    if rows.work_from >= rows.len() {
        return Vec::new();
    }
    let (fraction, pieces) = model_error(candidate.effect);
    let (first_s, last_s) = (rows.time_s(rows.work_from), rows.time_s(rows.len() - 1));
    let piece_s = (last_s - first_s + 1e-6) / f64::from(pieces);
    let mut hats: Vec<(f64, f64, f64)> =
        (0..pieces).map(|piece| (first_s + (f64::from(piece) + 0.5) * piece_s, piece_s, fraction)).collect();
    if let Scope::Span(edges_s) = candidate.scope {
        hats.extend(edges_s.map(|edge_s| (edge_s, ONSET_S, MODEL_ERROR_AT_EDGES)));
    }
    hats
}

/// A set of effects that act together.
#[derive(Debug, Clone)]
pub(crate) struct Explanation {
    /// The effects, in the order in which they were added.
    pub(crate) members: Vec<Member>,
    /// Log posterior up to a constant; 0 without effects.
    pub(crate) log_posterior: f64,
}

impl Explanation {
    /// No effect.
    pub(crate) const NONE: Explanation = Explanation { members: Vec::new(), log_posterior: 0.0 };

    /// These effects together; `None` if they cannot be separated numerically.
    pub(crate) fn of(gram: &Gram<'_>, members: Vec<Member>) -> Option<Explanation> {
        let log_prior: f64 = members.iter().map(Member::log_prior).sum();
        let log_posterior = log_evidence(gram, &members)? + log_prior;
        log_posterior.is_finite().then_some(Explanation { members, log_posterior })
    }

    /// The same without columns, for the posterior: they occupy megabytes.
    pub(crate) fn without_columns(&self) -> Explanation {
        let bare = |member: &Member| Member { whitened: Rc::default(), ..member.clone() };
        Explanation { members: self.members.iter().map(bare).collect(), ..*self }
    }

    /// Names of its effects, sorted.
    pub(crate) fn key(&self) -> Vec<String> {
        let mut names: Vec<String> = self.members.iter().map(|member| member.candidate.name()).collect();
        names.sort();
        names
    }

    /// Names of those that are not negligible, each once.
    fn names(&self) -> Vec<String> {
        let relevant = self.members.iter().filter(|member| !member.is_negligible);
        let mut names: Vec<String> = relevant.map(|member| member.candidate.name()).collect();
        names.sort();
        names.dedup();
        names
    }
}

/// Log Bayes factor of some effects together, with their misfit, against none; averaged over the size of the misfit.
fn log_evidence(gram: &Gram<'_>, members: &[Member]) -> Option<f64> {
    let of_scales: Option<Vec<f64>> =
        MISFIT_SCALES.iter().map(|&scale| log_evidence_at(gram, members, scale)).collect();
    Some((log_sum_exp(&of_scales?) - (MISFIT_SCALES.len() as f64).ln()) / EVIDENCE_TEMPER)
}

/// The same with misfit of this size.
fn log_evidence_at(gram: &Gram<'_>, members: &[Member], scale: f64) -> Option<f64> {
    // Independent deviations of each row: a fraction of each effect's own contribution.
    let variance = |row: usize| {
        let of_member = |member: &Member| {
            let (fraction, _) = model_error(member.candidate.effect);
            (scale * fraction * member.whitened.effect[row]).powi(2)
        };
        1.0 + members.iter().map(of_member).sum::<f64>()
    };
    let variance: Vec<f64> = (0..gram.residual.len()).map(variance).collect();
    let weight: Vec<f64> = variance.iter().map(|variance| 1.0 / variance.sqrt()).collect();
    let columns: Vec<&Vec<f64>> =
        members.iter().flat_map(|member| &member.whitened.columns).chain([&gram.residual]).collect();
    let weighted =
        Mat::from_fn(weight.len(), columns.len(), |row, column| weight[row] * columns[column][row]);
    let products = inner(weighted.as_ref(), weighted.as_ref());
    let last = columns.len() - 1;
    let (mut mean, mut sigma) = (Vec::with_capacity(last), Vec::with_capacity(last));
    for Member { candidate, whitened, .. } in members {
        mean.extend(candidate.mean.iter().copied().chain(whitened.misfit.iter().map(|_| 0.0)));
        sigma.extend(
            candidate.sigma.iter().copied().chain(whitened.misfit.iter().map(|fraction| scale * fraction)),
        );
    }
    let log_det: f64 = variance.iter().map(|variance| variance.ln()).sum();
    let of_effects = checked_log_odds(&|i, j| products[(i, j)], &|i| products[(i, last)], &mean, &sigma)?;
    Some(of_effects + 0.5 * (dot(&gram.residual, &gram.residual) - products[(last, last)] - log_det))
}

/// The name of all effects with the same columns: a misaligned sensor is a changed φ of its segment.
fn class(name: &str) -> String {
    let [misaligned, unbalanced] =
        [Effect::SegmentMisalignment, Effect::UnbalancedParameters].map(Effect::name);
    name.replace(unbalanced, misaligned)
}

/// Whether two names stand for the same columns.
fn same_columns(one: &str, other: &str) -> bool {
    class(one) == class(other)
}

/// An explanation with fitted parameters, for predictions.
#[derive(Debug, Clone)]
pub(crate) struct Predictor {
    /// Names of its effects that are not negligible, sorted; one name for those with the same columns.
    pub(crate) names: Vec<String>,
    /// Probability of the explanation, relative to the other predictors.
    pub(crate) probability: f64,
    /// Its effects.
    pub(crate) effects: Vec<Candidate>,
    /// Parameters of all effects in sequence.
    pub(crate) value: Vec<f64>,
    /// Their covariance.
    pub(crate) covariance: Mat<f64>,
}

/// Posterior over explanations.
#[derive(Debug, Clone)]
pub(crate) struct Posterior {
    /// Explanations, most probable first.
    pub(crate) explanations: Vec<Explanation>,
    /// Their probabilities.
    probabilities: Vec<f64>,
}

impl Posterior {
    /// Of some explanations, at least one, most probable first.
    pub(crate) fn of(explanations: Vec<Explanation>) -> Posterior {
        let logs: Vec<f64> = explanations.iter().map(|one| one.log_posterior).collect();
        let total = log_sum_exp(&logs);
        Posterior { probabilities: logs.iter().map(|log| (log - total).exp()).collect(), explanations }
    }

    /// The most probable explanations, refitted by `fit`; those that cannot be fitted are left out. None if one explanation
    /// is certain: there is nothing to decide.
    pub(crate) fn predictors(
        &self,
        fit: impl Fn(&Explanation) -> Option<(Vec<f64>, Mat<f64>)>,
    ) -> Vec<Predictor> {
        if self.probabilities.first().is_some_and(|most| *most >= NAMED_PROBABILITY) {
            return Vec::new();
        }
        let mut predictors: Vec<Predictor> = self
            .explanations
            .iter()
            .zip(&self.probabilities)
            .take(CHECKED_MAX)
            .filter_map(|(explanation, &probability)| {
                let (value, covariance) = fit(explanation)?;
                let mut names: Vec<String> = explanation.names().iter().map(|name| class(name)).collect();
                names.sort();
                names.dedup();
                let effects = explanation.members.iter().map(|member| member.candidate.clone()).collect();
                Some(Predictor { names, probability, effects, value, covariance })
            })
            .collect();
        let total: f64 = predictors.iter().map(|predictor| predictor.probability).sum();
        predictors.iter_mut().for_each(|predictor| predictor.probability /= total);
        predictors
    }

    /// Names of all explanations, of effects that are not negligible.
    pub(crate) fn names(&self) -> BTreeSet<String> {
        self.explanations.iter().flat_map(Explanation::names).collect()
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
        let mut names = self.explanations.first().map(Explanation::names).unwrap_or_default();
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
        let each = self.explanations.iter().zip(&self.probabilities);
        let such = each.filter(|(explanation, _)| is_such(&explanation.names()));
        // The sum may exceed 1 by rounding.
        such.map(|(_, probability)| probability).sum::<f64>().min(1.0)
    }

    /// Names that act in explanations without this one, with a total probability above [`RIVAL_PROBABILITY_MIN`]; none
    /// that is established itself. Most probable first.
    pub(crate) fn rivals(&self, name: &str, established: &[String]) -> Vec<(String, f64)> {
        let mut instead: BTreeMap<String, f64> = BTreeMap::new();
        for (explanation, probability) in self.explanations.iter().zip(&self.probabilities) {
            let names = explanation.names();
            if !names.iter().any(|other| same_columns(other, name)) {
                for other in names {
                    *instead.entry(other).or_insert(0.0) += probability;
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

    fn explanation(effects: &[(Effect, Place)], weight: f64) -> Explanation {
        let member = |&(effect, place): &(Effect, Place)| Member {
            candidate: Candidate::new(effect, place, 0.0, Scope::Work),
            value: Vec::new(),
            log_odds: 0.0,
            is_negligible: false,
            whitened: Rc::default(),
        };
        Explanation { members: effects.iter().map(member).collect(), log_posterior: weight.ln() }
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
        is(posterior.of_name("hand_load right"), 0.7);
        // One name, since no data distinguish them.
        is(posterior.of_name("segment_misalignment T8"), 0.8);
        is(posterior.of_name("unbalanced_parameters T8"), 0.8);
        let rivals = posterior.rivals("hand_load right", &posterior.explanations[0].names());
        assert_eq!(rivals.len(), 1, "{rivals:?}");
        assert_eq!(rivals[0].0, "worn_mass RightForearm");
        is(rivals[0].1, 0.2);
        // Something carries the load in all explanations but the last; nothing replaces T8 in the last two.
        let best = posterior.explanations[0].names();
        is(posterior.of_name_or_rival("hand_load right", &best), 0.9);
        is(posterior.of_name_or_rival("segment_misalignment T8", &best), 0.8);
        assert!(posterior.established().is_empty());
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
        let established = posterior.established();
        assert_eq!(established, ["hand_load right"]);
        assert_eq!(posterior.rivals("hand_load right", &established)[0].0, "worn_mass RightForearm");
    }

    #[test]
    fn predictors_are_fitted_only_while_something_is_open() {
        let load = (Effect::HandLoad, Place::Hand(Side::Right));
        let of = |weight| Posterior::of(vec![explanation(&[load], weight), explanation(&[], 1.0 - weight)]);
        let certain = of(0.96).predictors(|_| panic!("nothing is to be fitted"));
        assert!(certain.is_empty());
        // The first cannot be fitted.
        let open = of(0.9).predictors(|one| one.members.is_empty().then(|| (Vec::new(), Mat::new())));
        assert_eq!(open.len(), 1);
        assert!(open[0].names.is_empty());
        is(open[0].probability, 1.0);
        assert!(of(0.9).predictors(|_| None).is_empty());
    }
}
