//! Comparison of one finding with the truth.
//!
//! The oracle's gap is the gap that remains if the true effect is removed. With a clean twin of the session (the same
//! worker, noise and model without the hidden effect) it is the twin's gap before any effect is named. Without a twin it
//! is computed from the session's own gap before and the true size of the effect, `√(before² − effect²)`, but not below
//! the reported noise floor.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::families::{are_family, is_declared_for, same_columns};
use super::scenario::Performed;
use super::truth::{Outcome, Truth};

/// Names of an ambiguous finding with at least this probability belong to its set.
pub const RIVAL_PROBABILITY_MIN: f64 = 0.05;

/// The stated name of anything outside the catalogue.
const OUTSIDE: &str = "outside the catalogue";

/// Gap before and after, and noise floor, mm, in a finding.
const GAP: [&str; 3] = ["before_mm", "after_mm", "noise_floor_mm"];

/// Class of a session by its hidden effects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Class {
    /// One effect of the catalogue.
    Single,
    /// Two effects.
    Pair,
    /// No effect.
    Clean,
    /// One effect outside the catalogue.
    Outside,
}

/// A reported parameter and its true value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Compared {
    /// Label of the effect and name of the parameter.
    pub name: String,
    /// True value.
    pub truth: f64,
    /// Reported value.
    pub value: f64,
    /// Its 1-σ; 0 if value or σ is missing.
    pub sigma: f64,
}

impl Compared {
    /// Error over σ; infinite without a σ.
    pub fn error_over_sigma(&self) -> f64 {
        if self.sigma > 0.0 { (self.value - self.truth) / self.sigma } else { f64::INFINITY }
    }
}

/// An evaluated finding.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Name of the session.
    pub session: String,
    /// Kind of the session, as in [`super::ladder::deck`].
    pub kind: String,
    /// Its class.
    pub class: Class,
    /// Hidden effects: names with places.
    pub hidden: Vec<String>,
    /// Size of each over the nominal detectable size.
    pub sizes: Vec<f64>,
    /// Whether the effect was present during identification (`inertia`: false, since it belongs to the model).
    pub from_beginning: bool,
    /// Whether it acts in part of the work only, or changes its sign.
    pub comes_and_goes: bool,
    /// Whether the worker turned.
    pub turned: bool,
    /// `named`, `none`, `ambiguous`, `unexplained`, or `failed`.
    pub verdict: String,
    /// Named effects, strongest first.
    pub named: Vec<String>,
    /// Named effects, and for an ambiguous finding all names with at least [`RIVAL_PROBABILITY_MIN`].
    pub set: Vec<String>,
    /// Stated probability of each name.
    #[serde(default)]
    pub stated: BTreeMap<String, f64>,
    /// The strongest named effect is the hidden one, by name and place.
    pub exact: bool,
    /// Exact, or in the declared family, or in the set of an ambiguous finding.
    pub family: bool,
    /// Number of hidden effects that are named, exactly or by their family.
    pub found: usize,
    /// For an effect outside the catalogue: whether a declared substitute is named.
    pub declared: bool,
    /// Parameters of exactly named effects.
    pub parameters: Vec<Compared>,
    /// Gap before and after, and noise floor, mm, as the program reports them.
    pub gap_mm: [f64; 3],
    /// Gap of the oracle, mm.
    pub oracle_mm: f64,
    /// Run time of the program, s.
    pub seconds: f64,
    /// Length of the recording, s.
    pub length_s: f64,
    /// Error message if there is no finding.
    pub failure: Option<String>,
    /// Whether the program needs no experiment.
    #[serde(default)]
    pub decided: bool,
    /// Experiments that the program requested and received before this finding.
    #[serde(default)]
    pub experiments: Vec<Performed>,
}

/// Evaluates a printed finding; `twin_mm` is the gap before of the clean twin.
pub fn evaluate(
    truth: &Truth,
    printed: Result<&Value, &str>,
    twin_mm: Option<f64>,
    seconds: f64,
) -> Evaluation {
    let hidden: Vec<String> = truth.effects.iter().map(label_of).collect();
    let mut evaluated = Evaluation {
        session: truth.session.clone(),
        kind: truth.kind.clone(),
        class: class_of(truth),
        hidden,
        sizes: truth.effects.iter().map(|effect| effect.size).collect(),
        from_beginning: truth.effects.iter().any(|effect| effect.from_beginning && effect.name != "inertia"),
        comes_and_goes: truth.effects.iter().any(|effect| {
            let [from_s, to_s] = effect.span_s;
            effect.flips_at_s.is_some()
                || from_s > truth.spans.work[0] + 1.0
                || to_s < truth.spans.work[1] - 1.0
        }),
        turned: truth.turned,
        verdict: "failed".to_owned(),
        named: Vec::new(),
        set: Vec::new(),
        stated: BTreeMap::new(),
        exact: false,
        family: false,
        found: 0,
        declared: false,
        parameters: Vec::new(),
        gap_mm: [0.0; 3],
        oracle_mm: 0.0,
        seconds,
        length_s: truth.length_s,
        failure: None,
        decided: false,
        experiments: Vec::new(),
    };
    match printed {
        Ok(finding) if is_complete(finding) => evaluated.compare_with(truth, finding, twin_mm),
        Ok(_) => evaluated.failure = Some("the finding lacks its verdict or its gap".to_owned()),
        Err(failure) => evaluated.failure = Some(failure.to_owned()),
    }
    evaluated
}

/// Whether a finding has a verdict and the numbers of its gap.
fn is_complete(finding: &Value) -> bool {
    finding["verdict"].is_string() && GAP.iter().all(|key| finding["gap"][key].is_number())
}

fn label_of(effect: &super::truth::Hidden) -> String {
    if effect.is_in_catalogue() { effect.label() } else { effect.description.clone() }
}

fn class_of(truth: &Truth) -> Class {
    match truth.effects.as_slice() {
        [] => Class::Clean,
        [one] if !one.is_in_catalogue() => Class::Outside,
        [_] => Class::Single,
        _ => Class::Pair,
    }
}

/// Name with place of an effect in a finding.
fn reported_label(effect: &Value) -> String {
    let name = effect["name"].as_str().unwrap_or_default();
    let place = ["hand", "segment"].iter().find_map(|key| effect["where"][key].as_str());
    place.map_or(name.to_owned(), |place| format!("{name} {place}"))
}

impl Evaluation {
    fn compare_with(&mut self, truth: &Truth, finding: &Value, twin_mm: Option<f64>) {
        let effects = finding["effects"].as_array().map(Vec::as_slice).unwrap_or_default();
        self.verdict = finding["verdict"].as_str().unwrap_or("failed").to_owned();
        self.decided = finding["decided"].as_bool().unwrap_or(false);
        for label in effects.iter().map(reported_label) {
            // Count one effect in two spans, such as one with a flipped sign, once.
            if !self.named.contains(&label) {
                self.named.push(label);
            }
        }
        self.stated = stated(finding);
        self.set = self.named.clone();
        if self.verdict == "ambiguous" {
            let probable =
                self.stated.iter().filter(|(_, probability)| **probability >= RIVAL_PROBABILITY_MIN);
            self.set.extend(probable.map(|(name, _)| name.clone()));
        }
        self.compare_names();
        self.declared = self.named.iter().any(|label| is_declared_for(&self.kind, label));
        self.parameters = truth
            .effects
            .iter()
            .filter(|effect| effect.flips_at_s.is_none())
            .filter_map(|hidden| {
                Some((hidden, effects.iter().find(|answer| reported_label(answer) == hidden.label())?))
            })
            .flat_map(|(hidden, answer)| compare(hidden, answer))
            .collect();
        self.gap_mm = GAP.map(|key| finding["gap"][key].as_f64().unwrap_or(0.0));
        let [before_mm, _, floor_mm] = self.gap_mm;
        let less_mm = (before_mm.powi(2) - truth.effect_mm.powi(2)).max(0.0).sqrt();
        self.oracle_mm = twin_mm.unwrap_or(less_mm.max(floor_mm));
    }

    fn compare_names(&mut self) {
        let answers = if self.verdict == "ambiguous" { &self.set } else { &self.named };
        self.found = self
            .hidden
            .iter()
            .filter(|hidden| answers.iter().any(|answer| are_family(hidden, answer)))
            .count();
        if self.class != Class::Single {
            return;
        }
        let hidden = &self.hidden[0];
        self.exact = self.verdict == "named"
            && self.named.first().is_some_and(|first| same_columns(first) == same_columns(hidden));
        let first_is_family = self.named.first().is_some_and(|answer| are_family(hidden, answer));
        let in_the_set =
            self.verdict == "ambiguous" && self.set.iter().any(|answer| are_family(hidden, answer));
        self.family = self.exact || (self.verdict == "named" && first_is_family) || in_the_set;
    }

    /// Whether a name is a hidden effect, has the columns of one, or is declared for one outside the catalogue.
    pub fn is_right(&self, name: &str) -> bool {
        match self.class {
            Class::Single | Class::Pair => {
                self.hidden.iter().any(|hidden| same_columns(hidden) == same_columns(name))
            }
            Class::Outside => name == OUTSIDE || is_declared_for(&self.kind, name),
            Class::Clean => false,
        }
    }

    /// Whether there are names and all are right.
    pub fn names_are_right(&self) -> bool {
        !self.named.is_empty() && self.named.iter().all(|name| self.is_right(name))
    }

    /// The finding against the truth.
    pub fn outcome(&self) -> Outcome {
        match (self.class, self.verdict.as_str()) {
            (Class::Clean, "none") | (Class::Outside, "unexplained") => Outcome::Right,
            (_, "named") if self.names_are_right() => Outcome::Right,
            (_, "named") => Outcome::Wrong,
            _ => Outcome::Undecided,
        }
    }

    /// The finding after at most this many experiments against the truth.
    pub fn outcome_after(&self, experiments: usize) -> Outcome {
        self.experiments.get(experiments).map_or_else(|| self.outcome(), |next| next.before)
    }

    /// Stated probabilities that may be counted: an unexplained finding states no names.
    pub fn statements(&self) -> impl Iterator<Item = (f64, bool)> {
        let counts = |name: &str| self.verdict != "unexplained" || name == OUTSIDE;
        let stated = self.stated.iter().filter(move |(name, _)| counts(name));
        stated.map(|(name, probability)| (*probability, self.is_right(name)))
    }

    /// Whether a clean session has another verdict than `none`, or no finding.
    pub fn is_false_alarm(&self) -> bool {
        self.class == Class::Clean && self.verdict != "none"
    }

    /// Ratio of the gap after to that of the oracle; 1 is optimal.
    pub fn over_the_oracle(&self) -> Option<f64> {
        (self.oracle_mm > 0.0).then(|| self.gap_mm[1] / self.oracle_mm)
    }
}

/// Stated probability of each name of a finding (effects, candidates); effects with the same columns are one name.
fn stated(finding: &Value) -> BTreeMap<String, f64> {
    let list = |key: &str| finding[key].as_array().map(Vec::as_slice).unwrap_or_default();
    let candidates = list("candidates").iter().filter_map(|candidate| {
        Some((candidate["name"].as_str()?.to_owned(), candidate["probability"].as_f64()?))
    });
    let effects = list("effects")
        .iter()
        .filter_map(|effect| Some((reported_label(effect), effect["probability"].as_f64()?)));
    let mut stated: BTreeMap<String, f64> = BTreeMap::new();
    for (name, probability) in candidates.chain(effects) {
        let largest = stated.entry(same_columns(&name)).or_insert(0.0);
        *largest = largest.max(probability);
    }
    stated
}

/// Every parameter of the hidden effect that the answer lists.
fn compare(hidden: &super::truth::Hidden, answer: &Value) -> Vec<Compared> {
    let one = |(name, truth): (&String, &f64)| {
        let estimate = answer["parameters"].get(name)?;
        let value = estimate["value"].as_f64();
        let sigma = estimate["sigma"].as_f64().filter(|_| value.is_some());
        Some(Compared {
            name: format!("{} {name}", hidden.label()),
            truth: *truth,
            value: value.unwrap_or_default(),
            sigma: sigma.unwrap_or_default(),
        })
    };
    hidden.parameters.iter().filter_map(one).collect()
}

#[cfg(test)]
pub(super) mod tests;
