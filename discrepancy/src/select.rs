//! Selection of the effects that are reported: those of the most probable explanation.

use equipoise_config::model_file::Ask;
use equipoise_core::effect::{Effect, PARAMETERS_MAX};

use crate::ask::ask;
use crate::candidate::{Candidate, Scope};
use crate::constants::{CHECKED_MAX, CLEAR_LEAD, RIVAL_PROBABILITY_MIN};
use crate::evidence::Estimate;
use crate::explanation::{Explanation, Member, marginalise_misfit};
use crate::finding::{Candidate as Considered, Generic, SetAside};
use crate::generic::Library;
use crate::gram::Gram;
use crate::posterior::Posterior;
use crate::refine;
use crate::search::{cannot_act_together, reduced, search, with_outside};
use crate::trials::{Trial, trials};
use crate::windows::{self, Windows};

/// Reasons to set an effect aside.
const NOT_FITTED: &str = "cannot be fitted";
const NEGLIGIBLE: &str = "below the negligible size";
const NOT_ESTABLISHED: &str = "may as well be absent";

/// An effect of the most probable explanation.
#[derive(Debug, Clone)]
pub(crate) struct Accepted {
    /// The term in the Gram matrix.
    pub(crate) term: usize,
    /// Log Bayes factor when it was added.
    pub(crate) log_odds: f64,
    /// Probability of this name.
    pub(crate) probability: f64,
    /// Names that may stand in its place, most probable first.
    pub(crate) rivals: Vec<Considered>,
}

/// Result of the search.
#[derive(Debug, Clone, Default)]
pub(crate) struct Selection {
    /// Reported effects of the most probable explanation, by log odds.
    pub(crate) accepted: Vec<Accepted>,
    /// Rejected effects.
    pub(crate) set_aside: Vec<SetAside>,
    /// Effects by themselves, best first.
    pub(crate) considered: Vec<Considered>,
    /// Whether the data leave nothing to decide.
    pub(crate) is_decided: bool,
    /// Whether something outside the catalogue acts, and what it most probably is.
    pub(crate) is_outside: bool,
    pub(crate) outside: Option<Generic>,
    /// The next experiment.
    pub(crate) ask: Option<Ask>,
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

/// Searches the explanations; adds the effects of the most probable one to the Gram matrix, with their misfit.
pub(crate) fn select(gram: &mut Gram<'_>, windows: &Windows, library: &Library) -> Selection {
    let mut selection = Selection::default();
    let all = search(
        |explanation| extended(gram, windows, explanation, &mut selection),
        |explanation, known| reduced(gram, explanation, known),
    );
    let posterior = Posterior::of(with_outside(gram, library, all));
    selection.is_decided = posterior.names.is_decided();
    selection.is_outside = posterior.names.is_outside();
    selection.outside = posterior.outside();
    selection.ask = ask(gram, &posterior);
    accept(gram, &posterior, &mut selection);
    selection
}

/// Adds the effects of the most probable explanation to the Gram matrix. Negligible ones, and those that may as well be
/// absent, count as one more error of the sensors: they must not support any other conclusion.
fn accept(gram: &mut Gram<'_>, posterior: &Posterior, selection: &mut Selection) {
    let Some(best) = posterior.explanations.first() else { return };
    let established = posterior.names.established();
    let is_established =
        |member: &Member| !member.is_negligible && established.contains(&member.candidate.name());
    for member in best.members.iter().filter(|member| !is_established(member)) {
        if !member.is_negligible {
            let (name, why) = (member.candidate.name(), NOT_ESTABLISHED.to_owned());
            selection.set_aside.push(SetAside { name, log_odds: member.log_odds, why });
        }
        let columns =
            gram.whitened(member.candidate.count(), |block| member.candidate.columns(gram.rows, block));
        for (column, value) in columns.iter().zip(&member.value).filter(|(_, value)| **value != 0.0) {
            gram.marginalise_sensor_error(column, value.abs());
        }
    }
    for member in best.members.iter().filter(|member| is_established(member)) {
        let term = gram.add_candidate(member.candidate.clone());
        let name = member.candidate.name();
        let rival = |(name, probability): (String, f64)| Considered {
            log_odds: log_odds_alone(&selection.considered, &name),
            name,
            probability,
        };
        let rivals = posterior.names.rivals(&name, &established).into_iter().map(rival).collect();
        let probability = posterior.names.of_name(&name);
        selection.accepted.push(Accepted { term, log_odds: member.log_odds, probability, rivals });
        marginalise_misfit(gram, &selection.terms(), term, best.misfit_scale);
    }
    selection.accepted.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
    for considered in &mut selection.considered {
        considered.probability = posterior.names.of_name(&considered.name);
    }
    for name in posterior.names.all() {
        let probability = posterior.names.of_name(&name);
        let is_listed = selection.considered.iter().any(|considered| considered.name == name);
        if !is_listed && probability > RIVAL_PROBABILITY_MIN {
            selection.considered.push(Considered { name, log_odds: None, probability });
        }
    }
    selection
        .set_aside
        .retain(|other| other.why == NOT_ESTABLISHED || posterior.names.of_name(&other.name) == 0.0);
}

/// Log Bayes factor of an effect by itself, if it is among the best by itself.
fn log_odds_alone(considered: &[Considered], name: &str) -> Option<f64> {
    considered.iter().find(|considered| considered.name == name)?.log_odds
}

/// The explanation with each effect in addition that the data may require.
fn extended(
    gram: &Gram<'_>,
    windows: &Windows,
    explanation: &Explanation,
    selection: &mut Selection,
) -> Vec<Explanation> {
    let (mut conditioned, terms) = explanation.condition(gram);
    let hypotheses = hypotheses(&conditioned, windows, &terms);
    if explanation.members.is_empty() {
        selection.considered = considered(&hypotheses);
    }
    let mut children = Vec::new();
    for hypothesis in hypotheses.iter().take(CHECKED_MAX).filter(|hypothesis| hypothesis.log_odds > 0.0) {
        let Hypothesis { name, log_odds, cause } = hypothesis;
        let terms_before = conditioned.terms.len();
        let term = match cause {
            Cause::Term(term) => refine::refine(&mut conditioned, *term, &terms),
            Cause::Part(candidate) => {
                let exact = windows::refine(&conditioned, candidate, &terms);
                let term = conditioned.add_candidate(exact);
                refine::refine(&mut conditioned, term, &terms)
            }
        };
        let why = match members(&conditioned, explanation, &terms, term, *log_odds) {
            Ok(members) => {
                let is_negligible = members.last().is_some_and(|member| member.is_negligible);
                let child = Explanation::of(gram, members, None);
                let why =
                    if child.is_none() { Some(NOT_FITTED) } else { is_negligible.then_some(NEGLIGIBLE) };
                children.extend(child);
                why
            }
            Err(why) => Some(why),
        };
        if let Some(why) = why.filter(|_| selection.set_aside.iter().all(|other| other.name != *name)) {
            let why = why.to_owned();
            selection.set_aside.push(SetAside { name: name.clone(), log_odds: *log_odds, why });
        }
        conditioned.truncate(terms_before);
    }
    children
}

/// The effects of an explanation and one more, fitted together; or why they cannot act together.
fn members(
    gram: &Gram<'_>,
    explanation: &Explanation,
    terms: &[usize],
    term: usize,
    log_odds: f64,
) -> Result<Vec<Member>, &'static str> {
    let candidate = gram.terms[term].candidate.as_ref().ok_or(NOT_FITTED)?;
    let all: Vec<usize> = terms.iter().copied().chain([term]).collect();
    let mut values = gram.estimate(&all).ok_or(NOT_FITTED)?.value;
    let newest = values.split_off(values.len() - candidate.count());
    let mut members = Vec::with_capacity(all.len());
    for member in &explanation.members {
        let rest = values.split_off(member.candidate.count());
        members.push(member.refitted(std::mem::replace(&mut values, rest)));
    }
    members.push(Member::new(gram, candidate.clone(), newest, log_odds));
    cannot_act_together(&members).map_or(Ok(members), Err)
}

/// All hypotheses, best first: the whole work, or a part of it where the gain suffices.
fn hypotheses(gram: &Gram<'_>, windows: &Windows, terms: &[usize]) -> Vec<Hypothesis> {
    let conditioned = gram.conditioned_on(terms);
    let accepted: Vec<&Candidate> =
        terms.iter().filter_map(|&term| gram.terms[term].candidate.as_ref()).collect();
    let is_accepted = |candidate: &Candidate| accepted.iter().any(|accepted| overlap(accepted, candidate));
    let of_trial = |Trial { name, log_odds, term }| Hypothesis { name, log_odds, cause: Cause::Term(term) };
    let mut hypotheses: Vec<Hypothesis> = trials(gram, &conditioned)
        .into_iter()
        .filter(|trial| !gram.terms[trial.term].candidate.as_ref().is_some_and(&is_accepted))
        .map(of_trial)
        .collect();
    for part in windows.best(gram, terms) {
        let name = part.candidate.name();
        // An accepted effect may act again at another time, but not twice at once.
        let Some(candidate) =
            accepted.iter().try_fold(part.candidate, |part, other| without_overlap(part, other))
        else {
            continue;
        };
        match hypotheses.iter_mut().find(|hypothesis| hypothesis.name == name) {
            // Once the effect is established, its time span requires less evidence; here a wrong effect must not be
            // accepted by fitting edges.
            Some(whole)
                if matches!(whole.cause, Cause::Term(_))
                    && part.log_odds_of_same > whole.log_odds + CLEAR_LEAD =>
            {
                let log_odds = whole.log_odds.max(part.log_odds);
                *whole = Hypothesis { name, log_odds, cause: Cause::Part(candidate) };
            }
            None if part.log_odds > part.log_odds_of_whole + CLEAR_LEAD => {
                let log_odds = part.log_odds;
                hypotheses.push(Hypothesis { name, log_odds, cause: Cause::Part(candidate) });
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
    are_alike && one.scope.overlaps(other.scope)
}

/// The effect in the longer part of its time in which another one does not act, if both are the same and such a part is
/// long enough.
fn without_overlap(candidate: Candidate, other: &Candidate) -> Option<Candidate> {
    if !overlap(&candidate, other) {
        return Some(candidate);
    }
    let (Scope::Span([from_s, to_s]), Scope::Span([other_from_s, other_to_s])) =
        (candidate.scope, other.scope)
    else {
        return None;
    };
    let parts_s = [[from_s, other_from_s], [other_to_s, to_s]];
    let longest_s = parts_s.into_iter().max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
    let is_long_enough = longest_s[1] - longest_s[0] >= windows::shortest_s(candidate.effect);
    is_long_enough.then_some(Candidate { scope: Scope::Span(longest_s), ..candidate })
}

fn considered(hypotheses: &[Hypothesis]) -> Vec<Considered> {
    hypotheses
        .iter()
        .take(CHECKED_MAX)
        .map(|hypothesis| Considered {
            name: hypothesis.name.clone(),
            log_odds: Some(hypothesis.log_odds),
            probability: 0.0,
        })
        .collect()
}

/// Parameters of one term, fitted together with the accepted ones.
pub(crate) fn estimate_last(gram: &Gram<'_>, accepted: &[usize], term: usize) -> Option<Estimate> {
    let all: Vec<usize> = accepted.iter().copied().filter(|&other| other != term).chain([term]).collect();
    let estimate = gram.estimate(&all)?;
    let from = estimate.value.len() - gram.terms[term].count;
    Some(Estimate { value: estimate.value[from..].to_vec(), sigma: estimate.sigma[from..].to_vec() })
}

/// Pads the values to the maximum number of parameters of an effect.
pub(crate) fn padded(value: &[f64]) -> [f64; PARAMETERS_MAX] {
    let mut all = [0.0; PARAMETERS_MAX];
    all.iter_mut().zip(value).for_each(|(all, value)| *all = *value);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effect_may_act_again_where_it_does_not_act_yet() {
        let in_span = |span_s: [f64; 2]| {
            Candidate::new(Effect::ForceGain, equipoise_core::effect::Place::Whole, 0.0, Scope::Span(span_s))
        };
        let scope = |one: [f64; 2], other: [f64; 2]| {
            without_overlap(in_span(one), &in_span(other)).map(|candidate| candidate.scope)
        };
        assert_eq!(scope([0.0, 10.0], [20.0, 30.0]), Some(Scope::Span([0.0, 10.0])));
        assert_eq!(scope([0.0, 21.0], [20.0, 30.0]), Some(Scope::Span([0.0, 20.0])));
        assert_eq!(scope([29.0, 40.0], [20.0, 30.0]), Some(Scope::Span([30.0, 40.0])));
        assert_eq!(scope([19.0, 31.0], [20.0, 30.0]), None);
    }
}
