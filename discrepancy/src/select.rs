//! Forward selection: the best explanation that passes every check, then the next, conditioned on it; then backward
//! elimination.

use equipoise_core::effect::{Columns, Effect, PARAMETERS_MAX};

use crate::candidate::{Candidate, Scope};
use crate::constants::{
    CHECKED_MAX, CLEAR_LEAD, EFFECTS_MAX, ELIMINATION, MODEL_ERROR, MODEL_ERROR_AT_EDGES, NEGLIGIBLE_MAX,
    ONSET_S, RIVAL, THRESHOLD_INFLATION, WEIGHT_BY_CONTACT,
};
use crate::evidence::Estimate;
use crate::finding::{Candidate as Considered, SetAside};
use crate::gram::Gram;
use crate::plausibility::{
    implausibility, insufficient_evidence, is_by_forces_only, is_negligible, is_no_better_than_gain,
    log_odds_by_cop,
};
use crate::refine;
use crate::rows::Rows;
use crate::trials::{Trial, trials};
use crate::windows::{self, Windows};

/// An accepted effect.
#[derive(Debug, Clone)]
pub(crate) struct Accepted {
    /// The term in the Gram matrix.
    pub(crate) term: usize,
    /// Name with place.
    pub(crate) name: String,
    /// Log Bayes factor when it was accepted.
    pub(crate) log_odds: f64,
    /// All alternatives considered, best first.
    pub(crate) considered: Vec<Considered>,
}

/// Result of the selection.
#[derive(Debug, Clone, Default)]
pub(crate) struct Selection {
    /// Accepted effects, in the order of acceptance.
    pub(crate) accepted: Vec<Accepted>,
    /// Rejected explanations.
    pub(crate) set_aside: Vec<SetAside>,
    /// Candidates of the last step, in which none was accepted.
    pub(crate) considered: Vec<Considered>,
}

impl Selection {
    /// The accepted terms.
    pub(crate) fn terms(&self) -> Vec<usize> {
        self.accepted.iter().map(|accepted| accepted.term).collect()
    }
}

/// One hypothesis for the remaining residual.
struct Hypothesis {
    name: String,
    log_odds: f64,
    cause: Cause,
}

enum Cause {
    /// A term of the Gram matrix.
    Term(usize),
    /// A candidate in a part of the work.
    Part(Candidate),
}

/// Selects the effects that the data require, one after the other.
pub(crate) fn select(gram: &mut Gram<'_>, windows: &Windows, threshold: f64) -> Selection {
    let mut selection = Selection::default();
    let mut inflated = 0.0_f64;
    let mut negligible = 0;
    while selection.accepted.len() < EFFECTS_MAX {
        let hypotheses = hypotheses(gram, windows, &selection);
        let considered = considered(&hypotheses);
        let may_be_negligible = negligible < NEGLIGIBLE_MAX;
        match best_hypothesis(gram, &hypotheses, threshold.max(inflated), may_be_negligible, &mut selection) {
            Choice::Accepted(term, log_odds) => {
                let name = gram.terms[term].candidate.as_ref().map(Candidate::name).unwrap_or_default();
                inflated = inflated.max(threshold_inflation(gram, &selection.terms(), term, log_odds));
                selection.set_aside.retain(|other| other.name != name);
                selection.accepted.push(Accepted { term, name, log_odds, considered });
                marginalise_model_error(gram, &selection.terms());
            }
            Choice::Negligible(candidate, value) => {
                negligible += 1;
                add_sensor_noise(gram, &candidate, &value);
            }
            Choice::None => {
                selection.considered = considered;
                break;
            }
        }
    }
    eliminate_backward(gram, &mut selection, threshold);
    selection
}

/// Result of one step of the selection.
enum Choice {
    /// An accepted term, with its log odds.
    Accepted(usize, f64),
    /// A negligible effect, with its parameters, explains more than all relevant ones.
    Negligible(Candidate, Vec<f64>),
    /// No hypothesis passes.
    None,
}

/// Counts a negligible effect as one more error of the sensors: it must not support any other conclusion.
fn add_sensor_noise(gram: &mut Gram<'_>, candidate: &Candidate, value: &[f64]) {
    let columns = gram.whitened(candidate.count(), |block| candidate.columns(gram.rows, block));
    for (column, value) in columns.iter().zip(value) {
        if *value != 0.0 {
            gram.marginalise_sensor_error(column, value.abs());
        }
    }
}

/// All hypotheses, best first: the whole work, or a part of it where the gain suffices.
fn hypotheses(gram: &Gram<'_>, windows: &Windows, selection: &Selection) -> Vec<Hypothesis> {
    let terms = selection.terms();
    let conditioned = gram.conditioned_on(&terms);
    let accepted: Vec<&Candidate> =
        terms.iter().filter_map(|&term| gram.terms[term].candidate.as_ref()).collect();
    let is_accepted = |candidate: &Candidate| accepted.iter().any(|accepted| overlap(accepted, candidate));
    let of_trial = |Trial { name, log_odds, term }| Hypothesis { name, log_odds, cause: Cause::Term(term) };
    let mut hypotheses: Vec<Hypothesis> = trials(gram, &conditioned)
        .into_iter()
        .filter(|trial| !gram.terms[trial.term].candidate.as_ref().is_some_and(&is_accepted))
        .map(of_trial)
        .collect();
    for part in windows.best(gram, &terms) {
        let name = part.candidate.name();
        // An accepted effect may act again at another time, but not twice at once.
        if is_accepted(&part.candidate) {
            continue;
        }
        match hypotheses.iter_mut().find(|hypothesis| hypothesis.name == name) {
            // Once the effect is established, its time span requires less evidence; here a wrong effect must not be
            // accepted by fitting edges.
            Some(whole)
                if matches!(whole.cause, Cause::Term(_))
                    && part.log_odds_of_same > whole.log_odds + CLEAR_LEAD =>
            {
                let log_odds = whole.log_odds.max(part.log_odds);
                *whole = Hypothesis { name, log_odds, cause: Cause::Part(part.candidate) };
            }
            None if part.log_odds > part.log_odds_of_whole + CLEAR_LEAD => {
                let log_odds = part.log_odds;
                hypotheses.push(Hypothesis { name, log_odds, cause: Cause::Part(part.candidate) });
            }
            _ => {}
        }
    }
    hypotheses.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
    hypotheses
}

/// Whether two are the same effect at the same time; an apparent rotation of a segment has one cause.
fn overlap(one: &Candidate, other: &Candidate) -> bool {
    let rotates = |candidate: &Candidate| {
        matches!(
            candidate.effect,
            Effect::SegmentHeading | Effect::SegmentMisalignment | Effect::UnbalancedParameters
        )
    };
    let are_alike =
        one.name() == other.name() || (rotates(one) && rotates(other) && one.place == other.place);
    are_alike
        && match (one.scope, other.scope) {
            (Scope::Span(one_s), Scope::Span(other_s)) => one_s[0] < other_s[1] && other_s[0] < one_s[1],
            _ => true,
        }
}

fn considered(hypotheses: &[Hypothesis]) -> Vec<Considered> {
    hypotheses
        .iter()
        .take(CHECKED_MAX)
        .map(|hypothesis| Considered { name: hypothesis.name.clone(), log_odds: hypothesis.log_odds })
        .collect()
}

/// The best hypothesis that passes all checks; those ranked before it are set aside.
fn best_hypothesis(
    gram: &mut Gram<'_>,
    hypotheses: &[Hypothesis],
    threshold: f64,
    may_be_negligible: bool,
    selection: &mut Selection,
) -> Choice {
    let terms = selection.terms();
    let mut negligible: Option<(f64, Choice)> = None;
    let checked = hypotheses.iter().take(CHECKED_MAX);
    for hypothesis in checked.take_while(|hypothesis| hypothesis.log_odds > threshold) {
        let log_odds = hypothesis.log_odds;
        let terms_before = gram.terms.len();
        let term = match &hypothesis.cause {
            Cause::Term(term) => refine::refine(gram, *term, &terms),
            Cause::Part(candidate) => {
                let exact = windows::refine(gram, candidate, &terms);
                let term = gram.add_candidate(exact);
                refine::refine(gram, term, &terms)
            }
        };
        let Some(why) = objection(gram, selection, term, log_odds) else {
            return match negligible {
                Some((odds, negligible)) if odds > log_odds + RIVAL.0.max(RIVAL.1 * odds) => {
                    gram.truncate(terms_before);
                    negligible
                }
                _ => Choice::Accepted(term, log_odds),
            };
        };
        if negligible.is_none() && may_be_negligible {
            negligible = as_negligible(gram, &terms, term).map(|choice| (log_odds, choice));
        }
        gram.truncate(terms_before);
        if !selection.set_aside.iter().any(|other| other.name == hypothesis.name) {
            selection.set_aside.push(SetAside { name: hypothesis.name.clone(), log_odds, why });
        }
    }
    negligible.map_or(Choice::None, |(_, choice)| choice)
}

/// A hypothesis rejected only because it is negligible.
fn as_negligible(gram: &Gram<'_>, accepted: &[usize], term: usize) -> Option<Choice> {
    let candidate = gram.terms[term].candidate.as_ref()?;
    let value = estimate_last(gram, accepted, term)?.value;
    is_negligible(candidate, &value).then(|| Choice::Negligible(candidate.clone(), value))
}

/// Reason why a term is not accepted, if there is one.
fn objection(gram: &Gram<'_>, selection: &Selection, term: usize, log_odds: f64) -> Option<String> {
    let why = insufficient_evidence(gram, term, log_odds)
        .or_else(|| variation_of_contact(gram, selection, term, log_odds));
    if why.is_some() {
        return why;
    }
    let accepted = selection.terms();
    let Some(estimate) = estimate_last(gram, &accepted, term) else {
        return Some("cannot be fitted".to_owned());
    };
    let candidate = gram.terms[term].candidate.as_ref()?;
    if let Some(why) = implausibility(candidate, &estimate.value) {
        return Some(why);
    }
    if cancels_accepted(gram, &accepted, candidate, &estimate.value) {
        return Some("cancels an effect already named".to_owned());
    }
    if is_no_better_than_gain(gram, &accepted, term) {
        return Some("supported by its weight only: a gain of the force explains the same".to_owned());
    }
    is_by_forces_only(gram, &accepted, term, log_odds)
        .then(|| "supported by the forces only, not by the centre of pressure".to_owned())
}

/// A contact is never constant: a weight next to it may be its variation.
fn variation_of_contact(
    gram: &Gram<'_>,
    selection: &Selection,
    term: usize,
    log_odds: f64,
) -> Option<String> {
    let candidate = gram.terms[term].candidate.as_ref()?;
    let is_contact = |accepted: &&Accepted| {
        let candidate = gram.terms[accepted.term].candidate.as_ref();
        candidate.is_some_and(|candidate| candidate.effect == Effect::HandContact)
    };
    let contact = selection.accepted.iter().find(is_contact)?;
    (acts_as_weight(candidate) && log_odds < WEIGHT_BY_CONTACT * contact.log_odds)
        .then(|| "a varying push explains the same".to_owned())
}

/// Whether an effect acts like a weight.
fn acts_as_weight(candidate: &Candidate) -> bool {
    matches!(candidate.effect, Effect::WornMass | Effect::HandLoad | Effect::HandContact | Effect::ForceGain)
}

/// Whether a weight is negative next to a named one: removing a load that was just added is implausible. A contact may
/// have any direction.
fn cancels_accepted(gram: &Gram<'_>, accepted: &[usize], candidate: &Candidate, value: &[f64]) -> bool {
    let mut others = accepted.iter().filter_map(|&term| gram.terms[term].candidate.as_ref());
    let is_negative = acts_as_weight(candidate) && candidate.effect != Effect::HandContact && value[0] < 0.0;
    is_negative && others.any(acts_as_weight)
}

/// Parameters of one term, fitted together with the accepted ones.
pub(crate) fn estimate_last(gram: &Gram<'_>, accepted: &[usize], term: usize) -> Option<Estimate> {
    let all: Vec<usize> = accepted.iter().copied().filter(|&other| other != term).chain([term]).collect();
    let estimate = gram.estimate(&all)?;
    let from = estimate.value.len() - gram.terms[term].count;
    Some(Estimate { value: estimate.value[from..].to_vec(), sigma: estimate.sigma[from..].to_vec() })
}

/// Spurious evidence elsewhere that an effect's own model error may cause, in log odds: a fraction of its evidence from
/// the centre of pressure. The force detects a weight with much more evidence, which does not move the pressure.
fn threshold_inflation(gram: &Gram<'_>, accepted: &[usize], term: usize, log_odds: f64) -> f64 {
    let [contact, orientation, other] = THRESHOLD_INFLATION;
    let fraction = match gram.terms[term].candidate.as_ref().map(|candidate| candidate.effect) {
        Some(Effect::HandContact) => contact,
        Some(Effect::SegmentHeading | Effect::SegmentMisalignment) => orientation,
        _ => other,
    };
    fraction * log_odds_by_cop(gram, accepted, term).clamp(0.0, log_odds)
}

/// Marginalises deviations of the newest effect from its equation: its strength may vary by a fraction, and at its
/// edges by all of it.
fn marginalise_model_error(gram: &mut Gram<'_>, accepted: &[usize]) {
    let Some(&term) = accepted.last() else { return };
    let Some(candidate) = gram.terms[term].candidate.clone() else { return };
    let Some(estimate) = estimate_last(gram, accepted, term) else { return };
    let value = padded(&estimate.value);
    let rows = gram.rows;
    for (peak_s, half_s, fraction) in error_hats(rows, &candidate) {
        let columns = gram.whitened(1, |block| {
            let near = (1.0 - (rows.time_s(block) - peak_s).abs() / half_s).max(0.0);
            let (cop_m, force_n) = if near > 0.0 && block >= rows.work_from {
                candidate.columns(rows, block).times(&value)
            } else {
                ([0.0; 2], [0.0; 3])
            };
            let mut columns = Columns::zero(1);
            columns.cop_m[0] = cop_m.map(|value| near * value);
            columns.force_n[0] = force_n.map(|value| near * value);
            columns
        });
        gram.marginalise(&columns[0], fraction);
    }
}

/// Hat functions over the work in which the strength of an effect may deviate: peak, half width, s, and fraction, 1-σ.
fn error_hats(rows: &Rows<'_>, candidate: &Candidate) -> Vec<(f64, f64, f64)> {
    if rows.work_from >= rows.len() {
        return Vec::new();
    }
    let [contact, other] = MODEL_ERROR;
    let (fraction, pieces) = if candidate.effect == Effect::HandContact { contact } else { other };
    let (first_s, last_s) = (rows.time_s(rows.work_from), rows.time_s(rows.len() - 1));
    let piece_s = (last_s - first_s + 1e-6) / f64::from(pieces);
    let mut hats: Vec<(f64, f64, f64)> =
        (0..pieces).map(|piece| (first_s + (f64::from(piece) + 0.5) * piece_s, piece_s, fraction)).collect();
    if let Scope::Span(edges_s) = candidate.scope {
        hats.extend(edges_s.map(|edge_s| (edge_s, ONSET_S, MODEL_ERROR_AT_EDGES)));
    }
    hats
}

/// Pads the values to the maximum number of parameters of an effect.
pub(crate) fn padded(value: &[f64]) -> [f64; PARAMETERS_MAX] {
    let mut all = [0.0; PARAMETERS_MAX];
    all.iter_mut().zip(value).for_each(|(all, value)| *all = *value);
    all
}

/// Backward elimination: removes effects that the others explain by now.
fn eliminate_backward(gram: &Gram<'_>, selection: &mut Selection, threshold: f64) {
    let mut index = 0;
    while selection.accepted.len() > 1 && index < selection.accepted.len() {
        let all = selection.terms();
        let rest: Vec<usize> = all.iter().copied().filter(|&term| term != all[index]).collect();
        let gain = gram.log_odds(&all) - gram.log_odds(&rest);
        if gain < ELIMINATION * threshold {
            let removed = selection.accepted.remove(index);
            let name = gram.terms[removed.term].candidate.as_ref().map(Candidate::name).unwrap_or_default();
            let why = "effects accepted later explain the same".to_owned();
            selection.set_aside.push(SetAside { name, log_odds: gain, why });
        } else {
            index += 1;
        }
    }
}
