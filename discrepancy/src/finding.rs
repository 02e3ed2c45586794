//! The result of the workflow, as printed with `--json` and in the report.

use std::collections::BTreeMap;

use equipoise_config::model_file::Ask;
use serde::Serialize;

/// The result of the workflow. The field names are a contract.
#[derive(Debug, Clone, Serialize)]
pub struct Finding {
    /// The verdict.
    pub verdict: Verdict,
    /// Whether the names are certain, or that there are none, or that something outside the catalogue acts: no experiment is
    /// needed.
    pub decided: bool,
    /// Named effects, strongest first.
    pub effects: Vec<Named>,
    /// The best effects by themselves, by log odds; then others of the explanations. Each with the probability that it acts.
    pub candidates: Vec<Candidate>,
    /// Rejected candidates with reasons.
    pub set_aside: Vec<SetAside>,
    /// Generic terms: structure that no effect of the catalogue explains.
    pub unexplained: Vec<Generic>,
    /// Gap between model and measurement, before and after.
    pub gap: Gap,
    /// Spans in which the gap exceeds noise.
    pub spans: Vec<Suspicion>,
    /// Next measurement, which separates explanations that these data cannot; `None` if none is needed.
    pub ask_next: Option<String>,
    /// The same for programs.
    pub ask: Option<Ask>,
    /// The model file; `None` if nothing was added.
    pub model: Option<String>,
}

/// The verdict on a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Effects of the catalogue explain the residual; each is certain enough ([`Named::probability`] of 0.95 or more).
    Named,
    /// No effect is detectable in these data.
    None,
    /// An effect of the most probable explanation is not certain.
    Ambiguous,
    /// No effect of the catalogue explains part of the residual.
    Unexplained,
}

/// A named effect.
#[derive(Debug, Clone, Serialize)]
pub struct Named {
    /// Catalogue name.
    pub name: String,
    /// Place and time: `hand` or `segment`, `from_s`, `to_s`.
    #[serde(rename = "where")]
    pub place: BTreeMap<String, serde_json::Value>,
    /// Parameters by their names in the catalogue.
    pub parameters: BTreeMap<String, Estimate>,
    /// Log Bayes factor of adding it to the effects accepted before.
    pub log_odds: f64,
    /// Probability of this name with its place.
    pub probability: f64,
    /// The most probable name in its place.
    pub runner_up: Option<Candidate>,
    /// Names of effects that these data cannot distinguish from it.
    pub family: Vec<String>,
}

/// A fitted parameter.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Estimate {
    /// Posterior mean.
    pub value: f64,
    /// 1-σ.
    pub sigma: f64,
    /// Unit.
    pub unit: &'static str,
}

/// A considered explanation.
#[derive(Debug, Clone, Serialize)]
pub struct Candidate {
    /// Name with place: `worn_mass T8`.
    pub name: String,
    /// Log Bayes factor against no effect, by itself; `None` if it is not among the best by itself.
    pub log_odds: Option<f64>,
    /// Probability that it acts.
    pub probability: f64,
}

/// A probability in per cent, never rounded to certainty.
pub(crate) fn percent(probability: f64) -> String {
    match 100.0 * probability {
        percent if percent > 99.9 => "over 99.9 %".to_owned(),
        percent if percent < 0.1 => "below 0.1 %".to_owned(),
        percent => format!("{percent:.1} %"),
    }
}

/// A rejected explanation.
#[derive(Debug, Clone, Serialize)]
pub struct SetAside {
    /// Name with place.
    pub name: String,
    /// Its log Bayes factor.
    pub log_odds: f64,
    /// Reason for the rejection.
    pub why: String,
}

/// A generic term, outside the catalogue.
#[derive(Debug, Clone, Serialize)]
pub struct Generic {
    /// Description: "a heading error of the right forearm near (0.5, −0.4, 1.0) m".
    pub what: String,
    /// Log Bayes factor.
    pub log_odds: f64,
}

/// Root mean square of measured minus predicted in the work, less the expectation from the clean part of the recording.
#[derive(Debug, Clone, Serialize)]
pub struct Gap {
    /// With the original model, centre of pressure, mm.
    pub before_mm: f64,
    /// With the named effects, with parameters from other blocks, mm.
    pub after_mm: f64,
    /// Expected from noise alone, mm.
    pub noise_floor_mm: f64,
    /// Always true: parameters are from other blocks of time.
    pub held_out: bool,
    /// By axis: `x`, `y` (mm), `fz` (N); static poses and motion separately: `x_still`, `x_moving`, …
    pub per_axis: BTreeMap<String, AxisGap>,
}

/// Gap on one axis.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct AxisGap {
    /// With the original model.
    pub before: f64,
    /// With the named effects, held out.
    pub after: f64,
    /// Expected from noise alone.
    pub noise_floor: f64,
    /// `mm` or `N`.
    pub unit: &'static str,
}

/// A span in which model and measurement differ beyond noise.
#[derive(Debug, Clone, Serialize)]
pub struct Suspicion {
    /// Start, s of the recording.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// Signal with the largest ratio to noise: `cop_x`, `cop_y`, `fz`.
    pub signal: String,
    /// `still`, `moving` or `both`.
    #[serde(rename = "while")]
    pub while_: String,
    /// Segment whose pose correlates with the residual, if any.
    pub segment: Option<String>,
    /// Root mean square of the residual over its noise.
    pub times_noise: f64,
}
