//! Scores of the whole catalogue at once, conditioned on the accepted effects, and the scores reached by chance.

use std::f64::consts::TAU;

use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::candidate::Candidate;
use crate::constants::{CHANCE_QUANTILE, SEEDS};
use crate::evidence::{Conditioned, log_odds, log_sum_exp};
use crate::gram::Gram;
use crate::linear::Factor;

/// An explanation, over all its shapes and times.
#[derive(Debug, Clone)]
pub(crate) struct Trial {
    /// Name with place.
    pub(crate) name: String,
    /// Log Bayes factor of adding it, averaged over its variants.
    pub(crate) log_odds: f64,
    /// The best of its variants.
    pub(crate) term: usize,
}

/// All explanations, best first.
pub(crate) fn trials(gram: &Gram<'_>, conditioned: &Conditioned) -> Vec<Trial> {
    let mut list: Vec<(Trial, Vec<f64>)> = Vec::new();
    for (index, term) in gram.terms.iter().enumerate() {
        let Some(candidate) = term.candidate.as_ref().filter(|_| !term.is_derived) else { continue };
        let score = conditioned.log_odds(term) + term.log_prior;
        let name = candidate.name();
        match list.last_mut().filter(|(trial, _)| trial.name == name) {
            Some((trial, scores)) => {
                if scores.iter().all(|&other| other < score) {
                    trial.term = index;
                }
                scores.push(score);
            }
            None => list.push((Trial { name, log_odds: 0.0, term: index }, vec![score])),
        }
    }
    let mut trials: Vec<Trial> =
        list.into_iter().map(|(trial, scores)| Trial { log_odds: log_sum_exp(&scores), ..trial }).collect();
    trials.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
    trials
}

/// The log odds that the best candidate of the catalogue exceeds by chance in one of a hundred clean sessions
/// ([`CHANCE_QUANTILE`]): the residual is drawn from the noise model itself, in whitened space, where it is white.
pub(crate) fn chance_level(gram: &Gram<'_>, draws: usize) -> f64 {
    let count = gram.with_residual.len();
    let trace: f64 = (0..count).map(|i| gram.products[i][i]).sum();
    if count == 0 || trace <= 0.0 {
        return 0.0;
    }
    // Columns differ by orders of magnitude, so the correlation matrix is factored.
    let scale: Vec<f64> = (0..count).map(|i| gram.products[i][i].max(1e-12 * trace).sqrt()).collect();
    let correlation = DMatrix::from_fn(count, count, |i, j| {
        gram.products[i][j] / (scale[i] * scale[j]) + if i == j { 1e-8 } else { 0.0 }
    });
    let Some(factor) = Factor::of(&correlation) else { return 0.0 };
    let mut random = Pcg64Mcg::seed_from_u64(SEEDS[0]);
    let mut best: Vec<f64> = (0..draws).map(|_| best_of_draw(gram, &factor, &scale, &mut random)).collect();
    best.sort_by(f64::total_cmp);
    let index = (draws as f64 * CHANCE_QUANTILE) as usize;
    best.get(index.min(draws.saturating_sub(1))).copied().unwrap_or(0.0)
}

fn best_of_draw(gram: &Gram<'_>, factor: &Factor, scale: &[f64], random: &mut Pcg64Mcg) -> f64 {
    let white: Vec<f64> = scale.iter().map(|_| normal(random)).collect();
    let lower = factor.lower();
    let mut with_residual = vec![0.0; scale.len()];
    for (j, &value) in white.iter().enumerate() {
        for i in j..scale.len() {
            with_residual[i] += lower[(i, j)] * value * scale[i];
        }
    }
    let mut by_name: Vec<(Option<String>, Vec<f64>)> = Vec::new();
    for term in gram.terms.iter().filter(|term| !term.is_derived) {
        let first = term.first;
        let of = |i: usize, j: usize| gram.products[first + i][first + j];
        let score = log_odds(&of, &|i| with_residual[first + i], &term.mean, &term.sigma) + term.log_prior;
        let key = term.candidate.as_ref().filter(|_| term.log_prior < 0.0).map(Candidate::name);
        match by_name.last_mut().filter(|(last, _)| key.is_some() && *last == key) {
            Some((_, scores)) => scores.push(score),
            None => by_name.push((key, vec![score])),
        }
    }
    by_name.iter().map(|(_, scores)| log_sum_exp(scores)).fold(f64::NEG_INFINITY, f64::max)
}

/// Standard normal (Box and Muller).
pub(crate) fn normal(random: &mut Pcg64Mcg) -> f64 {
    let [radius, angle] = random.random::<[f64; 2]>();
    (-2.0 * (1.0 - radius).ln()).sqrt() * (TAU * angle).cos()
}
