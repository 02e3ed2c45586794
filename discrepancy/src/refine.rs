//! Refines the non-linear parameter of an effect beyond its grid: one-dimensional search of the evidence.

use equipoise_core::effect::Effect;

use crate::candidate::{Candidate, Scope, place_log_prior};
use crate::constants::{
    CURVATURE_STEP, CUTOFF_RANGE, DRIFT_RANGE_S, GOLDEN_STEPS, LAG_MIN_S, LAG_RANGE_S, LAGS_S,
    MOMENT_MASS_MIN_KG, ROTATION_SIGMA_MAX_RAD, ROTATION_STEPS, SHAPE_FACTOR_SIGMA, SIZE_TAIL, SWAY_RANGE_HZ,
};
use crate::evidence::{estimate, log_odds};
use crate::gram::Gram;

/// The refined term, added: its shape where it is not linear, and its prior as wide as the data require.
pub(crate) fn refine(gram: &mut Gram<'_>, term: usize, accepted: &[usize]) -> usize {
    let Some(candidate) = gram.terms[term].candidate.clone() else { return term };
    if matches!(candidate.effect, Effect::SegmentHeading | Effect::SegmentMisalignment) {
        return relinearised(gram, candidate, accepted);
    }
    let range = range(gram, &candidate, term, accepted);
    let wide = add_wide(gram, candidate.clone(), accepted);
    let Some([from, to]) = range else { return wide };
    // A prior that is too narrow would move the shape.
    let of_shape = gram.terms[wide].candidate.clone().unwrap_or_else(|| candidate.clone());
    gram.truncate(wide);
    let (directions, residual) = gram.directions_given(accepted);
    let score = |shape: f64| gram.score_candidate(&with_shape(&of_shape, shape), &directions, &residual);
    let best = golden_section(from, to, score);
    add_wide(gram, with_shape(&candidate, best), accepted)
}

/// Adds a candidate with the most probable width of its prior: sizes of effects have a heavy tail, and a narrow prior
/// would shrink a large one and leave the rest of it to others.
fn add_wide(gram: &mut Gram<'_>, mut candidate: Candidate, accepted: &[usize]) -> usize {
    let term = gram.add_candidate(candidate.clone());
    if candidate.is_shape_factor() {
        return term;
    }
    let all: Vec<usize> = accepted.iter().copied().chain([term]).collect();
    let columns = gram.columns_of(&all);
    let (mean, sigma) = gram.priors(&all);
    // The prior of a mass's first moment is already scaled by the mass.
    let widened = if candidate.effect.arm_sigma_m(candidate.place).is_some() { 1 } else { candidate.count() };
    let first = sigma.len() - candidate.count();
    let score = |(factor, weight): (f64, f64)| {
        let mut sigma = sigma.clone();
        sigma[first..first + widened].iter_mut().for_each(|sigma| *sigma *= factor);
        let products = |i: usize, j: usize| gram.products[columns[i]][columns[j]];
        log_odds(&products, &|i| gram.with_residual[columns[i]], &mean, &sigma) + weight.ln()
    };
    let is_rotation = matches!(candidate.effect, Effect::SegmentHeading | Effect::SegmentMisalignment);
    let possible =
        |&(factor, _): &(f64, f64)| !is_rotation || factor * candidate.sigma[0] <= ROTATION_SIGMA_MAX_RAD;
    let best = SIZE_TAIL.into_iter().filter(possible).max_by(|&a, &b| score(a).total_cmp(&score(b)));
    let Some((factor, weight)) = best else { return term };
    candidate.sigma[..widened].iter_mut().for_each(|sigma| *sigma *= factor);
    candidate.log_prior += weight.ln();
    gram.terms[term].sigma.clone_from(&candidate.sigma);
    gram.terms[term].log_prior = candidate.log_prior;
    gram.terms[term].candidate = Some(candidate);
    term
}

/// Fits a rotation repeatedly, linearised at the last fitted angle, until columns and angle agree.
fn relinearised(gram: &mut Gram<'_>, mut candidate: Candidate, accepted: &[usize]) -> usize {
    candidate.sigma = Candidate::new(candidate.effect, candidate.place, 0.0, candidate.scope).sigma;
    candidate.mean = vec![0.0; candidate.sigma.len()];
    // The prior is that of any angle again, not that of one component of the mixture of headings.
    if !matches!(candidate.scope, Scope::Span(_)) {
        candidate.log_prior = place_log_prior(candidate.effect, candidate.place);
    }
    for _ in 0..ROTATION_STEPS {
        let term = add_wide(gram, candidate.clone(), accepted);
        let Some(fitted) = crate::select::estimate_last(gram, accepted, term) else { return term };
        gram.truncate(term);
        candidate.about = crate::select::padded(&fitted.value);
    }
    add_wide(gram, candidate, accepted)
}

/// The same with another shape; its factor is then fixed.
fn with_shape(candidate: &Candidate, shape: f64) -> Candidate {
    let mut other = Candidate { shape, ..candidate.clone() };
    if other.is_shape_factor() {
        other.sigma = vec![SHAPE_FACTOR_SIGMA[1]];
    }
    other
}

/// Range of the shape; `None` where there is none.
fn range(gram: &Gram<'_>, candidate: &Candidate, term: usize, accepted: &[usize]) -> Option<[f64; 2]> {
    let shape = candidate.shape;
    match candidate.effect {
        Effect::SuitLag => {
            let all: Vec<usize> = accepted.iter().copied().chain([term]).collect();
            let factor = *gram.estimate(&all)?.value.last()?;
            let [first_s, .., last_s] = LAGS_S;
            let shape_s = (shape * factor).clamp(first_s, last_s);
            let [from, to] = [shape_s - LAG_RANGE_S, shape_s + LAG_RANGE_S];
            // A lag of the other sign is a different explanation.
            Some(if shape_s > 0.0 {
                [from.max(LAG_MIN_S), to.min(last_s)]
            } else {
                [from.max(first_s), to.min(-LAG_MIN_S)]
            })
        }
        Effect::PlateLowpass => Some([shape / CUTOFF_RANGE, shape * CUTOFF_RANGE]),
        Effect::PlateDrift if shape > 0.0 => Some(DRIFT_RANGE_S),
        Effect::PeriodicSway => Some([shape - SWAY_RANGE_HZ, shape + SWAY_RANGE_HZ]),
        _ => None,
    }
}

/// Argument of the maximum between two bounds, for a unimodal function.
fn golden_section(from: f64, to: f64, of: impl Fn(f64) -> f64) -> f64 {
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut from, mut to) = (from, to);
    let mut inner = [to - ratio * (to - from), from + ratio * (to - from)];
    let mut value = inner.map(&of);
    for _ in 0..GOLDEN_STEPS {
        if value[0] > value[1] {
            to = inner[1];
            inner = [to - ratio * (to - from), inner[0]];
            value = [of(inner[0]), value[0]];
        } else {
            from = inner[0];
            inner = [inner[1], from + ratio * (to - from)];
            value = [value[1], of(inner[1])];
        }
    }
    0.5 * (from + to)
}

/// 1-σ of a refined shape, from the curvature of the evidence.
pub(crate) fn shape_sigma(gram: &Gram<'_>, candidate: &Candidate, others: &[usize]) -> f64 {
    let (directions, residual) = gram.directions_given(others);
    let score = |shape: f64| gram.score_candidate(&with_shape(candidate, shape), &directions, &residual);
    let (step, fraction) = CURVATURE_STEP;
    let step = match candidate.effect {
        Effect::SuitLag | Effect::PeriodicSway => step,
        _ => fraction * candidate.shape.abs(),
    };
    let [below, here, above] = [-step, 0.0, step].map(|off| score(candidate.shape + off));
    let curvature = (2.0 * here - below - above) / (step * step);
    if curvature > 0.0 { 1.0 / curvature.sqrt() } else { candidate.shape.abs() }
}

/// Sets the prior 1-σ of each mass's first moment, kg m, to the mass, kg, times the prior 1-σ of its arm, m.
pub(crate) fn scale_moment_priors(gram: &mut Gram<'_>) {
    for index in 0..gram.terms.len() {
        let term = &gram.terms[index];
        let Some(candidate) = &term.candidate else { continue };
        let Some(arm_m) = candidate.effect.arm_sigma_m(candidate.place) else { continue };
        let first = term.first;
        let products = |_: usize, _: usize| gram.products[first][first];
        let with_residual = |_: usize| gram.with_residual[first];
        let Some(mass) = estimate(&products, &with_residual, &term.mean[..1], &term.sigma[..1]) else {
            continue;
        };
        let moment = arm_m * mass.value[0].abs().max(MOMENT_MASS_MIN_KG);
        gram.terms[index].sigma[1..].fill(moment);
        if let Some(candidate) = &mut gram.terms[index].candidate {
            candidate.sigma[1..].fill(moment);
        }
    }
}
