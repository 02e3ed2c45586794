//! Forward selection: the best explanation that passes every check, then the next, conditioned on it; then backward
//! elimination.

use equipoise_core::effect::Effect;

use crate::candidate::{Candidate, Scope};
use crate::evidence::Estimate;
use crate::finding::{Candidate as Considered, SetAside};
use crate::gram::Gram;
use crate::refine;
use crate::sanity::{
    from_cop_alone, is_too_small, no_better_than_a_gain, objection, only_by_forces, unproven,
};
use crate::trials::{Trial, trials};
use crate::windows::{self, GAIN_OVER_WHOLE, Windows};

/// Maximum number of named effects.
const EFFECTS_MAX: usize = 4;
/// Maximum number of negligible effects counted as errors of the sensors.
const TRIFLES_MAX: usize = 6;
/// Number of best hypotheses that are checked in each step before giving up.
const CHECKED: usize = 8;
/// Onset and end of an effect take up to this time, s.
const EDGE_S: f64 = 1.2;
/// Rivals within this many log odds, or within this fraction of the winner's, explain the data equally well.
pub(crate) const RIVAL: (f64, f64) = (5.0, 0.05);

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
struct Way {
    name: String,
    log_odds: f64,
    what: What,
}

enum What {
    Term(usize),
    Part(Candidate),
}

/// Selects the effects that the data require, one after the other.
pub(crate) fn select(gram: &mut Gram<'_>, windows: &Windows, threshold: f64) -> Selection {
    let mut selection = Selection::default();
    let mut leak = 0.0_f64;
    let mut blurred = 0;
    while selection.accepted.len() < EFFECTS_MAX {
        let ways = ways(gram, windows, &selection);
        let considered = considered(&ways);
        let may_blur = blurred < TRIFLES_MAX;
        match first_that_stands(gram, &ways, threshold.max(leak), may_blur, &mut selection) {
            Answer::Stands(term, log_odds) => {
                let name = gram.terms[term].candidate.as_ref().map(Candidate::name).unwrap_or_default();
                leak = leak.max(leaks(gram, &selection.terms(), term, log_odds));
                selection.set_aside.retain(|other| other.name != name);
                selection.accepted.push(Accepted { term, name, log_odds, considered });
                forgive(gram, &selection.terms());
            }
            Answer::Trifle(candidate, value) => {
                blurred += 1;
                blur(gram, &candidate, &value);
            }
            Answer::Nothing => {
                selection.considered = considered;
                break;
            }
        }
    }
    go_back(gram, &mut selection, threshold);
    selection
}

/// Result of one search over the hypotheses.
enum Answer {
    /// An accepted term, with its log odds.
    Stands(usize, f64),
    /// A negligible effect, with its parameters, explains more than all relevant ones.
    Trifle(Candidate, Vec<f64>),
    /// No hypothesis passes.
    Nothing,
}

/// Counts a negligible effect as one more error of the sensors: it must not support any other conclusion.
fn blur(gram: &mut Gram<'_>, candidate: &Candidate, value: &[f64]) {
    let columns = gram.whitened(candidate.count(), |block| candidate.columns(gram.rows, block));
    for (column, value) in columns.iter().zip(value) {
        if *value != 0.0 {
            gram.count_as_error(column, value.abs());
        }
    }
}

/// All hypotheses, best first: the whole work, or a part of it where the gain suffices.
fn ways(gram: &Gram<'_>, windows: &Windows, selection: &Selection) -> Vec<Way> {
    let terms = selection.terms();
    let given = gram.given(&terms);
    let known: Vec<&Candidate> =
        terms.iter().filter_map(|&term| gram.terms[term].candidate.as_ref()).collect();
    let is_known = |candidate: &Candidate| known.iter().any(|known| overlap(known, candidate));
    let of_trial =
        |trial: Trial| Way { name: trial.name, log_odds: trial.log_odds, what: What::Term(trial.term) };
    let mut ways: Vec<Way> = trials(gram, &given)
        .into_iter()
        .filter(|trial| !gram.terms[trial.term].candidate.as_ref().is_some_and(&is_known))
        .map(of_trial)
        .collect();
    for part in windows.best(gram, &terms) {
        let name = part.candidate.name();
        // An accepted effect may act again at another time, but not twice at once.
        if is_known(&part.candidate) {
            continue;
        }
        let whole = ways.iter_mut().find(|way| way.name == name);
        match whole {
            // Once the effect is known, its time span requires less evidence; here a wrong effect must not be accepted
            // by fitting edges.
            Some(whole)
                if matches!(whole.what, What::Term(_))
                    && part.same_name > whole.log_odds + GAIN_OVER_WHOLE =>
            {
                let log_odds = whole.log_odds.max(part.log_odds);
                *whole = Way { name, log_odds, what: What::Part(part.candidate) };
            }
            None if part.log_odds > part.of_whole + GAIN_OVER_WHOLE => {
                ways.push(Way { name, log_odds: part.log_odds, what: What::Part(part.candidate) });
            }
            _ => {}
        }
    }
    ways.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
    ways
}

/// Whether two are the same effect at the same time; an apparent turn of a segment has one cause.
fn overlap(one: &Candidate, other: &Candidate) -> bool {
    let turns = |candidate: &Candidate| {
        matches!(
            candidate.effect,
            Effect::SegmentHeading | Effect::SegmentMisalignment | Effect::UnbalancedParameters
        )
    };
    let are_alike = one.name() == other.name() || (turns(one) && turns(other) && one.place == other.place);
    are_alike
        && match (one.scope, other.scope) {
            (Scope::Span(one_s), Scope::Span(other_s)) => one_s[0] < other_s[1] && other_s[0] < one_s[1],
            _ => true,
        }
}

fn considered(ways: &[Way]) -> Vec<Considered> {
    ways.iter()
        .take(CHECKED)
        .map(|way| Considered { name: way.name.clone(), log_odds: way.log_odds })
        .collect()
}

/// The best hypothesis that passes all checks; those ranked before it are rejected.
fn first_that_stands(
    gram: &mut Gram<'_>,
    ways: &[Way],
    least: f64,
    may_blur: bool,
    selection: &mut Selection,
) -> Answer {
    let terms = selection.terms();
    let mut trifle: Option<(f64, Answer)> = None;
    for way in ways.iter().take(CHECKED).take_while(|way| way.log_odds > least) {
        let before = gram.terms.len();
        let term = match &way.what {
            What::Term(term) => refine::refine(gram, *term, &terms),
            What::Part(candidate) => {
                let exact = windows::refine(gram, candidate, &terms);
                let term = gram.add_candidate(exact);
                refine::refine(gram, term, &terms)
            }
        };
        let why = unproven(gram, term, way.log_odds)
            .or_else(|| is_of_a_push(gram, selection, term, way.log_odds))
            .or_else(|| why_not(gram, &terms, term, way.log_odds));
        let Some(why) = why else {
            return match trifle {
                Some((odds, trifle)) if odds > way.log_odds + RIVAL.0.max(RIVAL.1 * odds) => {
                    gram.truncate(before);
                    trifle
                }
                _ => Answer::Stands(term, way.log_odds),
            };
        };
        if trifle.is_none() && may_blur {
            trifle = as_trifle(gram, &terms, term).map(|answer| (way.log_odds, answer));
        }
        gram.truncate(before);
        let known = selection.set_aside.iter().any(|other| other.name == way.name);
        if !known {
            let (name, log_odds) = (way.name.clone(), way.log_odds);
            selection.set_aside.push(SetAside { name, log_odds, why });
        }
    }
    trifle.map_or(Answer::Nothing, |(_, trifle)| trifle)
}

/// A push is never constant: a weight in addition to a push must reach this fraction of the push's evidence.
const OF_A_PUSH: f64 = 0.12;

fn is_of_a_push(gram: &Gram<'_>, selection: &Selection, term: usize, log_odds: f64) -> Option<String> {
    let candidate = gram.terms[term].candidate.as_ref()?;
    let is_push = |accepted: &&Accepted| {
        let known = gram.terms[accepted.term].candidate.as_ref();
        known.is_some_and(|known| known.effect == Effect::HandContact)
    };
    let push = selection.accepted.iter().find(is_push)?;
    (weighs(candidate) && log_odds < OF_A_PUSH * push.log_odds)
        .then(|| "may as well be that the push varies".to_owned())
}

/// Whether an effect acts like a weight.
fn weighs(candidate: &Candidate) -> bool {
    matches!(candidate.effect, Effect::WornMass | Effect::HandLoad | Effect::HandContact | Effect::ForceGain)
}

/// A hypothesis rejected only because it is too small.
fn as_trifle(gram: &Gram<'_>, accepted: &[usize], term: usize) -> Option<Answer> {
    let candidate = gram.terms[term].candidate.as_ref()?;
    let value = last_of(gram, accepted, term)?.value;
    is_too_small(candidate, &value).then(|| Answer::Trifle(candidate.clone(), value))
}

fn why_not(gram: &Gram<'_>, accepted: &[usize], term: usize, log_odds: f64) -> Option<String> {
    let Some(estimate) = last_of(gram, accepted, term) else { return Some("cannot be fitted".to_owned()) };
    let candidate = gram.terms[term].candidate.as_ref()?;
    if let Some(why) = objection(candidate, &estimate.value) {
        return Some(why);
    }
    if takes_back(gram, accepted, candidate, &estimate.value) {
        return Some("would take back what was named already".to_owned());
    }
    if no_better_than_a_gain(gram, accepted, term) {
        return Some("only its weight speaks for it: a gain of the force explains the same".to_owned());
    }
    only_by_forces(gram, accepted, term, log_odds)
        .then(|| "only the forces speak for it, not the centre of pressure".to_owned())
}

/// Whether a weight is negative next to a named one: removing a load that was just added is implausible. A push may
/// have any direction.
fn takes_back(gram: &Gram<'_>, accepted: &[usize], candidate: &Candidate, value: &[f64]) -> bool {
    let known = accepted.iter().filter_map(|&term| gram.terms[term].candidate.as_ref());
    let is_less = weighs(candidate) && candidate.effect != Effect::HandContact && value[0] < 0.0;
    is_less && known.into_iter().any(weighs)
}

/// Parameters of one term, fitted together with the accepted ones.
pub(crate) fn last_of(gram: &Gram<'_>, accepted: &[usize], term: usize) -> Option<Estimate> {
    let all: Vec<usize> = accepted.iter().copied().filter(|&other| other != term).chain([term]).collect();
    let estimate = gram.estimate(&all)?;
    let from = estimate.value.len() - gram.terms[term].count;
    Some(Estimate { value: estimate.value[from..].to_vec(), sigma: estimate.sigma[from..].to_vec() })
}

/// Spurious evidence elsewhere that an effect's own model error may cause, in log odds: a fraction of its evidence from
/// the centre of pressure. The force detects a weight with much more evidence, which does not move the pressure.
fn leaks(gram: &Gram<'_>, accepted: &[usize], term: usize, log_odds: f64) -> f64 {
    let share = match gram.terms[term].candidate.as_ref().map(|candidate| candidate.effect) {
        Some(Effect::HandContact) => 0.1,
        Some(Effect::SegmentHeading | Effect::SegmentMisalignment) => 0.08,
        _ => 0.01,
    };
    share * from_cop_alone(gram, accepted, term).clamp(0.0, log_odds)
}

/// Marginalises a deviation of the newest effect from its equation: its strength may vary by some per cent.
fn forgive(gram: &mut Gram<'_>, accepted: &[usize]) {
    let Some(&term) = accepted.last() else { return };
    let Some(candidate) = gram.terms[term].candidate.clone() else { return };
    let Some(estimate) = last_of(gram, accepted, term) else { return };
    let (share, pieces) = if candidate.effect == Effect::HandContact { (0.25, 40) } else { (0.03, 12) };
    let rows = gram.rows;
    let (Some(first_s), last_s) =
        ((rows.work_from < rows.len()).then(|| rows.time_s(rows.work_from)), rows.time_s(rows.len() - 1))
    else {
        return;
    };
    let piece_s = (last_s - first_s + 1e-6) / f64::from(pieces);
    let mut hats: Vec<(f64, f64, f64)> =
        (0..pieces).map(|piece| (first_s + (f64::from(piece) + 0.5) * piece_s, piece_s, share)).collect();
    if let Scope::Span(edges_s) = candidate.scope {
        hats.extend(edges_s.map(|edge_s| (edge_s, EDGE_S, 1.0)));
    }
    for (middle_s, piece_s, share) in hats {
        let columns = gram.whitened(1, |block| {
            let near = (1.0 - (rows.time_s(block) - middle_s).abs() / piece_s).max(0.0);
            let (cop_m, force_n) = if near > 0.0 && block >= rows.work_from {
                candidate.columns(rows, block).times(&padded(&estimate.value))
            } else {
                ([0.0; 2], [0.0; 3])
            };
            let mut columns = equipoise_core::effect::Columns::zero(1);
            columns.cop_m[0] = cop_m.map(|value| near * value);
            columns.force_n[0] = force_n.map(|value| near * value);
            columns
        });
        gram.forgive(&columns[0], share);
    }
}

/// Pads the values to the maximum number of parameters of an effect.
pub(crate) fn padded(value: &[f64]) -> [f64; equipoise_core::effect::PARAMETERS_MAX] {
    let mut all = [0.0; equipoise_core::effect::PARAMETERS_MAX];
    all.iter_mut().zip(value).for_each(|(all, value)| *all = *value);
    all
}

/// Backward elimination: removes effects that the others explain by now.
fn go_back(gram: &Gram<'_>, selection: &mut Selection, threshold: f64) {
    let mut index = 0;
    while selection.accepted.len() > 1 && index < selection.accepted.len() {
        let all = selection.terms();
        let rest: Vec<usize> = all.iter().copied().filter(|&term| term != all[index]).collect();
        let gain = gram.log_odds(&all) - gram.log_odds(&rest);
        if gain < 0.5 * threshold {
            let gone = selection.accepted.remove(index);
            let name = gram.terms[gone.term].candidate.as_ref().map(Candidate::name).unwrap_or_default();
            let why = "what was found after it explains the same".to_owned();
            selection.set_aside.push(SetAside { name, log_odds: gain, why });
        } else {
            index += 1;
        }
    }
}
