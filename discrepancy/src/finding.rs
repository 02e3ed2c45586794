//! The result of the workflow, as printed with `--json` and in the report.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// The result of the workflow. The field names are a contract.
#[derive(Debug, Clone, Serialize)]
pub struct Finding {
    /// The verdict.
    pub verdict: Verdict,
    /// Named effects, strongest first.
    pub effects: Vec<Named>,
    /// Candidates of the first step by log odds; the first of an ambiguous set belong together.
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

/// A pose or motion that separates two explanations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ask {
    /// The explanations, by name with place.
    pub between: [String; 2],
    /// Name of the pose of the core's library to hold; `None` for a step, standing or a motion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<String>,
    /// Rotation of the body before, degrees to the left.
    #[serde(default)]
    pub turn_deg: f64,
    /// Displacement of the stance before: forward and to the left, m.
    #[serde(default)]
    pub step_m: [f64; 2],
    /// Duration of static standing, s; 0: as long as a pose takes.
    #[serde(default)]
    pub still_s: f64,
    /// Whether fast motion is requested.
    #[serde(default)]
    pub fast: bool,
    /// Difference of the two predictions, 1-σ of the noise.
    pub separation_sigma: f64,
}

impl Ask {
    /// The sentence of [`Finding::ask_next`].
    pub fn sentence(&self) -> String {
        let [one, other] = &self.between;
        let what = self.what();
        format!("{what}: {one} and {other} then differ by {:.1} times the noise", self.separation_sigma)
    }

    /// The instruction for the worker on the plate.
    pub fn what(&self) -> String {
        if self.fast {
            return "squat quickly and stop, a few times".to_owned();
        }
        if self.still_s > 0.0 {
            return format!("stand still for {:.0} minutes", self.still_s / 60.0);
        }
        if let [forward_m, left_m] = self.step_m
            && (forward_m, left_m) != (0.0, 0.0)
        {
            let side = |metres: f64, [plus, minus]: [&str; 2]| {
                format!("{:.0} cm {}", 100.0 * metres.abs(), if metres < 0.0 { minus } else { plus })
            };
            return format!(
                "step to another place on the plate, {} and {}",
                side(forward_m, ["forward", "back"]),
                side(left_m, ["to the left", "to the right"])
            );
        }
        let pose = self.pose.as_deref().unwrap_or("stand straight, arms down");
        match self.turn_deg {
            0.0 => format!("hold this pose: {pose}"),
            turn_deg => format!("{} and hold this pose: {pose}", turn(turn_deg)),
        }
    }
}

/// `turn by 90° to the left`.
pub fn turn(turn_deg: f64) -> String {
    let side = if turn_deg < 0.0 { "right" } else { "left" };
    if turn_deg.abs() == 180.0 {
        return "turn around".to_owned();
    }
    format!("turn by {:.0}° to the {side}", turn_deg.abs())
}

/// The verdict on a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Effects of the catalogue explain the residual.
    Named,
    /// No effect is detectable in these data.
    None,
    /// Several effects explain the residual equally well.
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
    /// The next best explanation.
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
    /// Log Bayes factor against no additional effect.
    pub log_odds: f64,
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
    /// Description: "heading of the right forearm, near (0.5, −0.4, 1.0) m".
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
