//! What was found: the workflow's answer, as it is printed with `--json` and in the report.

use std::collections::BTreeMap;

use equipoise_config::model_file::Ask;
use serde::Serialize;

/// The workflow's answer. The field names are a contract.
#[derive(Debug, Clone, Serialize)]
pub struct Finding {
    /// What it comes down to.
    pub verdict: Verdict,
    /// The effects that were named, strongest first.
    pub effects: Vec<Named>,
    /// What was considered, by log odds; the first of an ambiguous set belong together.
    pub candidates: Vec<Candidate>,
    /// Candidates that were set aside, and why.
    pub set_aside: Vec<SetAside>,
    /// Structure that nothing of the catalogue explains, in words of the body: generic terms.
    pub unexplained: Vec<Generic>,
    /// How far model and measurement are apart, before and after.
    pub gap: Gap,
    /// Where they are apart.
    pub spans: Vec<Suspicion>,
    /// What to do next to tell apart what these data cannot; `None` if nothing needs it.
    pub ask_next: Option<String>,
    /// The same for programs: the pose or motion, and what it would tell apart.
    pub ask: Option<Ask>,
    /// The model file; `None` if nothing was added.
    pub model: Option<String>,
}

/// The four answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Effects of the catalogue explain it.
    Named,
    /// Nothing is missing that these data could show.
    None,
    /// Several effects explain it alike.
    Ambiguous,
    /// Something is missing that the catalogue does not have.
    Unexplained,
}

/// An effect that was named.
#[derive(Debug, Clone, Serialize)]
pub struct Named {
    /// Catalogue name.
    pub name: String,
    /// Where: `hand`, `segment`, `from_s`, `to_s`.
    #[serde(rename = "where")]
    pub place: BTreeMap<String, serde_json::Value>,
    /// By the catalogue's parameter names.
    pub parameters: BTreeMap<String, Estimate>,
    /// Log Bayes factor of adding it to what was accepted before.
    pub log_odds: f64,
    /// The next best explanation.
    pub runner_up: Option<Candidate>,
    /// Catalogue names that these data cannot tell from it.
    pub family: Vec<String>,
}

/// A parameter's value.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Estimate {
    /// Best value.
    pub value: f64,
    /// 1-σ.
    pub sigma: f64,
    /// Unit.
    pub unit: &'static str,
}

/// An explanation that was considered.
#[derive(Debug, Clone, Serialize)]
pub struct Candidate {
    /// Name with place: `worn_mass T8`.
    pub name: String,
    /// Log Bayes factor against adding nothing.
    pub log_odds: f64,
}

/// An explanation that was set aside.
#[derive(Debug, Clone, Serialize)]
pub struct SetAside {
    /// Name with place.
    pub name: String,
    /// Log Bayes factor it had.
    pub log_odds: f64,
    /// Why it does not count.
    pub why: String,
}

/// A generic term, outside the catalogue.
#[derive(Debug, Clone, Serialize)]
pub struct Generic {
    /// In words: "heading of the right forearm, near (0.5, −0.4, 1.0) m".
    pub what: String,
    /// Log Bayes factor.
    pub log_odds: f64,
}

/// How far model and measurement are apart in the work beyond what the clean part of the recording makes one expect, root
/// mean square.
#[derive(Debug, Clone, Serialize)]
pub struct Gap {
    /// With the model as it was, mm of the centre of pressure.
    pub before_mm: f64,
    /// With what was named, fitted on other blocks than those it is judged on, mm.
    pub after_mm: f64,
    /// What noise alone would leave, mm.
    pub noise_floor_mm: f64,
    /// Always true: parameters came from other blocks of time.
    pub held_out: bool,
    /// The same by axis: `x`, `y` (mm), `fz` (N), and still and moving apart: `x_still`, `x_moving`, …
    pub per_axis: BTreeMap<String, AxisGap>,
}

/// Gap on one axis.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct AxisGap {
    /// Before.
    pub before: f64,
    /// After, held out.
    pub after: f64,
    /// By noise alone.
    pub noise_floor: f64,
    /// `mm` or `N`.
    pub unit: &'static str,
}

/// Where model and measurement are apart beyond noise.
#[derive(Debug, Clone, Serialize)]
pub struct Suspicion {
    /// Begin and end, s of the recording.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// Signal that shows it most: `cop_x`, `cop_y`, `fz`.
    pub signal: String,
    /// `still`, `moving` or `both`.
    #[serde(rename = "while")]
    pub while_: String,
    /// Segment whose pose goes with it most, if any.
    pub segment: Option<String>,
    /// Root mean square of the residual over its noise there.
    pub times_noise: f64,
}
