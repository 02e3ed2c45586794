//! Explanations: sets of effects that act together, each with its own misfit, and their posterior probabilities.
//!
//! No effect acts exactly as its equation says: its strength varies over time, and its onset takes a while. Every
//! explanation therefore carries these deviations in its own covariance before it is compared with others. The size of
//! the misfit is not known; the evidence is averaged over a prior of it (MacKay, Neural Computation 4 (1992), 415–447).

use std::rc::Rc;

use equipoise_core::effect::{Columns, Effect};
use nalgebra::DMatrix;

use crate::candidate::{Candidate, Scope, place_log_prior};
use crate::constants::{
    CHANGE_PRIOR, EFFECT_PRIOR, MISFIT_SCALES, MODEL_ERROR, MODEL_ERROR_AT_EDGES, ONSET_S, OTHER_PRIOR,
    OUTSIDE_PRIOR,
};
use crate::evidence::{checked_log_odds, log_sum_exp};
use crate::finding::Generic;
use crate::floor::root_mean;
use crate::generic::FittedEntry;
use crate::gram::{Gram, Term, whiten_each};
use crate::linear::{dot, inner};
use crate::plausibility::is_negligible;
use crate::posterior::OUTSIDE;
use crate::rows::Rows;
use crate::select::{estimate_last, padded};

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

/// Whitened columns of a part of an explanation.
#[derive(Debug, Default)]
struct Whitened {
    /// Its contribution.
    effect: Vec<f64>,
    /// Its own columns, then those of its misfit.
    columns: Vec<Vec<f64>>,
    /// Prior of its own parameters: mean and 1-σ.
    mean: Vec<f64>,
    sigma: Vec<f64>,
    /// Misfit of each column behind its own, 1-σ as a fraction; and of each row.
    misfit: Vec<f64>,
    misfit_of_row: f64,
}

impl Whitened {
    /// Of whitened columns with this prior, fitted parameters and misfit columns.
    fn of(
        mut columns: Vec<Vec<f64>>,
        [mean, sigma, value]: [Vec<f64>; 3],
        misfit: Vec<(Vec<f64>, f64)>,
        misfit_of_row: f64,
    ) -> Whitened {
        let mut effect = vec![0.0; columns.first().map_or(0, Vec::len)];
        for (column, value) in columns.iter().zip(&value) {
            effect.iter_mut().zip(column).for_each(|(sum, column)| *sum += value * column);
        }
        let (of_misfit, misfit): (Vec<Vec<f64>>, Vec<f64>) = misfit.into_iter().unzip();
        columns.extend(of_misfit);
        Whitened { effect, columns, mean, sigma, misfit, misfit_of_row }
    }
}

impl Member {
    /// An effect with these parameters, and its deviations from its equation.
    pub(crate) fn new(gram: &Gram<'_>, candidate: Candidate, value: Vec<f64>, log_odds: f64) -> Member {
        let columns = gram.whitened(candidate.count(), |block| candidate.columns(gram.rows, block));
        let misfit = misfit_columns(gram, &candidate, &value);
        let priors = [candidate.mean.clone(), candidate.sigma.clone(), value.clone()];
        let (misfit_of_row, _) = model_error(candidate.effect);
        let is_negligible = is_negligible(&candidate, &value);
        let whitened = Rc::new(Whitened::of(columns, priors, misfit, misfit_of_row));
        Member { candidate, value, log_odds, is_negligible, whitened }
    }

    /// A member without parameters and columns, for tests of names.
    #[cfg(test)]
    pub(crate) fn without_columns(candidate: Candidate) -> Member {
        let (value, whitened) = (Vec::new(), Rc::default());
        Member { candidate, value, log_odds: 0.0, is_negligible: false, whitened }
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

/// Marginalises the deviations of the newest term from its equation, of this size over that of the constants.
pub(crate) fn marginalise_misfit(gram: &mut Gram<'_>, terms: &[usize], term: usize, scale: f64) {
    let Some(candidate) = gram.terms[term].candidate.clone() else { return };
    let Some(estimate) = estimate_last(gram, terms, term) else { return };
    for (column, fraction) in misfit_columns(gram, &candidate, &estimate.value) {
        gram.marginalise(&column, scale * fraction);
    }
}

/// Whitened columns of an effect's misfit, and 1-σ of each as a fraction: hat functions over the work in which each
/// parameter may deviate by a fraction of the effect's size, and at onset and end by all of it.
fn misfit_columns(gram: &Gram<'_>, candidate: &Candidate, value: &[f64]) -> Vec<(Vec<f64>, f64)> {
    let rows = gram.rows;
    let columns_at: Vec<Columns> =
        (rows.work_from..rows.len()).map(|block| candidate.columns(rows, block)).collect();
    let edges_s = match candidate.scope {
        Scope::Span(edges_s) => Some(edges_s),
        _ => None,
    };
    misfit(gram, &columns_at, [&candidate.sigma, value], &hats(rows, model_error(candidate.effect), edges_s))
}

/// As [`misfit_columns`], from the effect's columns at every block of the work and the 1-σ of the priors and the values
/// of its parameters; `hats`: peak, s, half width, s, and 1-σ as a fraction, of each hat function.
fn misfit(
    gram: &Gram<'_>,
    columns_at: &[Columns],
    [sigma, value]: [&[f64]; 2],
    hats: &[(f64, f64, f64)],
) -> Vec<(Vec<f64>, f64)> {
    let (rows, count) = (gram.rows, sigma.len());
    // Size of the effect in units of the prior, since the parameters' units differ.
    let squares: f64 = value.iter().zip(sigma).map(|(value, sigma)| (value / sigma).powi(2)).sum();
    let size = (squares / count as f64).sqrt();
    let whitened = whiten_each(rows, gram.noise, hats.len() * count, |block, column| {
        let Some(at) = block.checked_sub(rows.work_from).map(|block| &columns_at[block]) else {
            return ([0.0; 2], [0.0; 3]);
        };
        let (peak_s, half_s, _) = hats[column / count];
        let parameter = column % count;
        let near = (1.0 - (rows.time_s(block) - peak_s).abs() / half_s).max(0.0);
        let scale = near * size * sigma[parameter];
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
fn hats(rows: &Rows<'_>, (fraction, pieces): (f64, u32), edges_s: Option<[f64; 2]>) -> Vec<(f64, f64, f64)> {
    if rows.work_from >= rows.len() {
        return Vec::new();
    }
    let (first_s, last_s) = (rows.time_s(rows.work_from), rows.time_s(rows.len() - 1));
    let piece_s = (last_s - first_s + 1e-6) / f64::from(pieces);
    let mut hats: Vec<(f64, f64, f64)> =
        (0..pieces).map(|piece| (first_s + (f64::from(piece) + 0.5) * piece_s, piece_s, fraction)).collect();
    hats.extend(edges_s.into_iter().flatten().map(|edge_s| (edge_s, ONSET_S, MODEL_ERROR_AT_EDGES)));
    hats
}

/// A term outside the catalogue that acts with the effects of an explanation.
#[derive(Debug, Clone)]
pub(crate) struct Outside {
    /// The term, with its log odds next to the effects.
    pub(crate) generic: Generic,
    /// Root mean square of its contribution in the work: centre of pressure x, y (m), vertical force (N).
    pub(crate) size: [f64; 3],
    log_prior: f64,
    whitened: Rc<Whitened>,
}

impl Outside {
    /// The best term of the library with its fitted parameters; `log_mean`: mean evidence of all terms over its own.
    pub(crate) fn new(gram: &Gram<'_>, term: FittedEntry<'_>, log_mean: f64) -> Outside {
        let hats = hats(gram.rows, term.model_error, None);
        let misfit = misfit(gram, term.columns_at, [term.sigma, &term.value], &hats);
        let contributions = || term.columns_at.iter().map(|columns| columns.times(&padded(&term.value)));
        let size = [
            root_mean(contributions().map(|(cop_m, _)| cop_m[0] * cop_m[0])),
            root_mean(contributions().map(|(cop_m, _)| cop_m[1] * cop_m[1])),
            root_mean(contributions().map(|(_, force_n)| force_n[2] * force_n[2])),
        ];
        let priors = [vec![0.0; term.sigma.len()], term.sigma.to_vec(), term.value];
        Outside {
            generic: term.generic,
            size,
            log_prior: (OUTSIDE_PRIOR / (1.0 - OUTSIDE_PRIOR)).ln() + log_mean,
            whitened: Rc::new(Whitened::of(term.columns, priors, misfit, term.model_error.0)),
        }
    }

    /// Without columns, for tests of names.
    #[cfg(test)]
    pub(crate) fn named(what: &str) -> Outside {
        let generic = Generic { what: what.to_owned(), log_odds: 0.0 };
        Outside { generic, size: [0.0; 3], log_prior: 0.0, whitened: Rc::default() }
    }
}

/// A set of effects that act together.
#[derive(Debug, Clone)]
pub(crate) struct Explanation {
    /// The effects, in the order in which they were added.
    pub(crate) members: Vec<Member>,
    /// Something outside the catalogue that acts as well.
    pub(crate) outside: Option<Outside>,
    /// Log posterior up to a constant; 0 without effects.
    pub(crate) log_posterior: f64,
    /// Log Bayes factor against no effect, as the noise model says.
    pub(crate) log_evidence: f64,
    /// Log prior odds against no effect.
    pub(crate) log_prior: f64,
    /// The most probable size of its misfit, over [`MODEL_ERROR`].
    pub(crate) misfit_scale: f64,
}

impl Explanation {
    /// No effect.
    pub(crate) const NONE: Explanation = Explanation {
        members: Vec::new(),
        outside: None,
        log_posterior: 0.0,
        log_evidence: 0.0,
        log_prior: 0.0,
        misfit_scale: 1.0,
    };

    /// These effects together; `None` if they cannot be separated numerically. The log posterior is preliminary: all
    /// evidence is divided by the number of effects plus one, as if no smaller set had any; [`Levels`] has the final one.
    pub(crate) fn of(gram: &Gram<'_>, members: Vec<Member>, outside: Option<Outside>) -> Option<Explanation> {
        let parts: Vec<&Whitened> = members
            .iter()
            .map(|member| &*member.whitened)
            .chain(outside.iter().map(|one| &*one.whitened))
            .collect();
        let log_prior: f64 = members.iter().map(Member::log_prior).sum();
        let log_prior = log_prior + outside.as_ref().map_or(0.0, |outside| outside.log_prior);
        let (log_evidence, misfit_scale) = log_evidence(gram, &parts)?;
        let log_posterior = log_evidence / (1.0 + parts.len() as f64) + log_prior;
        log_posterior.is_finite().then_some(Explanation {
            members,
            outside,
            log_posterior,
            log_evidence,
            log_prior,
            misfit_scale,
        })
    }

    /// Number of its effects, including something outside the catalogue.
    fn size(&self) -> usize {
        self.members.len() + usize::from(self.outside.is_some())
    }

    /// The Gram matrix with its effects and what is outside the catalogue as terms, the effects' misfit marginalised, and
    /// these terms.
    pub(crate) fn condition<'a>(&self, gram: &Gram<'a>) -> (Gram<'a>, Vec<usize>) {
        let mut conditioned = gram.clone();
        let mut terms = Vec::new();
        for member in &self.members {
            let term = conditioned.add_candidate(member.candidate.clone());
            terms.push(term);
            marginalise_misfit(&mut conditioned, &terms, term, self.misfit_scale);
        }
        if let Some(outside) = &self.outside {
            let Whitened { columns, mean, sigma, .. } = &*outside.whitened;
            let term = Term::generic(mean.clone(), sigma.clone());
            terms.push(conditioned.add(term, columns[..mean.len()].to_vec()));
        }
        (conditioned, terms)
    }

    /// Its effects with their columns again.
    pub(crate) fn members_with_columns(&self, gram: &Gram<'_>) -> Vec<Member> {
        let again = |member: &Member| {
            Member::new(gram, member.candidate.clone(), member.value.clone(), member.log_odds)
        };
        self.members.iter().map(again).collect()
    }

    /// The same without columns, for the posterior: they occupy megabytes. What is outside the catalogue keeps its own.
    pub(crate) fn without_columns(&self) -> Explanation {
        let without_whitened = |member: &Member| Member { whitened: Rc::default(), ..member.clone() };
        let outside = self.outside.as_ref().map(|one| {
            let Whitened { columns, mean, sigma, .. } = &*one.whitened;
            let columns = columns[..mean.len()].to_vec();
            let own = Whitened { columns, mean: mean.clone(), sigma: sigma.clone(), ..Whitened::default() };
            Outside { whitened: Rc::new(own), ..one.clone() }
        });
        Explanation { members: self.members.iter().map(without_whitened).collect(), outside, ..*self }
    }

    /// Whether another one begins with the names of its effects.
    pub(crate) fn is_prefix_of(&self, other: &Explanation) -> bool {
        let names = |one: &Explanation| -> Vec<String> {
            one.members.iter().map(|member| member.candidate.name()).collect()
        };
        names(other).starts_with(&names(self))
    }

    /// Names of its effects, sorted.
    pub(crate) fn key(&self) -> Vec<String> {
        let mut names: Vec<String> = self.members.iter().map(|member| member.candidate.name()).collect();
        names.extend(self.outside.iter().map(|outside| outside.generic.what.clone()));
        names.sort();
        names
    }

    /// Names of those that are not negligible, each once, and [`OUTSIDE`].
    pub(crate) fn names(&self) -> Vec<String> {
        let relevant = self.members.iter().filter(|member| !member.is_negligible);
        let mut names: Vec<String> = relevant.map(|member| member.candidate.name()).collect();
        names.extend(self.outside.iter().map(|_| OUTSIDE.to_owned()));
        names.sort();
        names.dedup();
        names
    }
}

/// Tempered evidence by number of effects.
///
/// Evidence is tempered because the noise model is not exact, and because with more effects more of the remaining residual
/// is their misfit. The evidence that `n` effects add to that of the most probable explanation by `n − 1` is divided by
/// `n + 1`: a function of the set, independent of the order in which the search added its effects.
#[derive(Debug)]
pub(crate) struct Levels {
    /// Log evidence and tempered log evidence of the most probable explanation of each size, from size 0.
    best: Vec<[f64; 2]>,
}

impl Levels {
    /// Levels of all explanations that are compared.
    pub(crate) fn of(all: &[Explanation]) -> Levels {
        let mut levels = Levels { best: vec![[0.0; 2]] };
        for size in 1..=all.iter().map(Explanation::size).max().unwrap_or(0) {
            let of_size = all.iter().filter(|one| one.size() == size);
            let best = of_size.max_by(|a, b| levels.log_posterior(a).total_cmp(&levels.log_posterior(b)));
            let level = best.map_or(levels.best[size - 1], |best| [best.log_evidence, levels.tempered(best)]);
            levels.best.push(level);
        }
        levels
    }

    /// Log posterior odds of one of them against no effect.
    pub(crate) fn log_posterior(&self, explanation: &Explanation) -> f64 {
        self.tempered(explanation) + explanation.log_prior
    }

    fn tempered(&self, explanation: &Explanation) -> f64 {
        let size = explanation.size();
        let Some(before) = size.checked_sub(1) else { return 0.0 };
        let [evidence, tempered] = self.best[before];
        tempered + (explanation.log_evidence - evidence) / (1.0 + size as f64)
    }
}

/// Log Bayes factor of some parts together, with their misfit, against none, averaged over the size of the misfit; and
/// its most probable size.
fn log_evidence(gram: &Gram<'_>, parts: &[&Whitened]) -> Option<(f64, f64)> {
    let of_scales: Option<Vec<f64>> =
        MISFIT_SCALES.iter().map(|&scale| log_evidence_at(gram, parts, scale)).collect();
    let of_scales = of_scales?;
    let (_, scale) = of_scales.iter().zip(MISFIT_SCALES).max_by(|a, b| a.0.total_cmp(b.0))?;
    Some((log_sum_exp(&of_scales) - (MISFIT_SCALES.len() as f64).ln(), scale))
}

/// The same with misfit of this size.
fn log_evidence_at(gram: &Gram<'_>, parts: &[&Whitened], scale: f64) -> Option<f64> {
    // Independent deviations of each row: a fraction of each part's own contribution.
    let variance = |row: usize| {
        let of_part = |part: &&Whitened| (scale * part.misfit_of_row * part.effect[row]).powi(2);
        1.0 + parts.iter().map(of_part).sum::<f64>()
    };
    let variance: Vec<f64> = (0..gram.residual.len()).map(variance).collect();
    let weight: Vec<f64> = variance.iter().map(|variance| 1.0 / variance.sqrt()).collect();
    let columns: Vec<&Vec<f64>> =
        parts.iter().flat_map(|part| &part.columns).chain([&gram.residual]).collect();
    let weighted =
        DMatrix::from_fn(weight.len(), columns.len(), |row, column| weight[row] * columns[column][row]);
    let products = inner(&weighted, &weighted);
    let last = columns.len() - 1;
    let (mut mean, mut sigma) = (Vec::with_capacity(last), Vec::with_capacity(last));
    for part in parts {
        mean.extend(part.mean.iter().copied().chain(part.misfit.iter().map(|_| 0.0)));
        sigma.extend(part.sigma.iter().copied().chain(part.misfit.iter().map(|fraction| scale * fraction)));
    }
    let log_det: f64 = variance.iter().map(|variance| variance.ln()).sum();
    let of_effects = checked_log_odds(&|i, j| products[(i, j)], &|i| products[(i, last)], &mean, &sigma)?;
    Some(of_effects + 0.5 * (dot(&gram.residual, &gram.residual) - products[(last, last)] - log_det))
}
