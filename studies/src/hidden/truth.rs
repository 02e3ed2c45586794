//! Ground truth: injected effects. Only the evaluation reads it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Ground truth of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Name of the recording without its ending.
    pub session: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Kind: `clean`, `hand_load right`, `pair`, `outside elastic_band`, …
    pub kind: String,
    /// `ordinary` or `coloured`.
    pub noise: String,
    /// Stature, m.
    pub height_m: f64,
    /// Body mass, kg.
    pub mass_kg: f64,
    /// Phases of the recording, s since its start.
    pub spans: Spans,
    /// Whether the program receives the reference span: never if an effect is present from the start, and not always
    /// otherwise, so that its absence carries no information.
    pub reports_reference: bool,
    /// Length of the recording, s.
    pub length_s: f64,
    /// Standing places of the worker, in order.
    pub places: Vec<Standing>,
    /// Whether the worker has turned by 25° or more between identification or reference and the end of the work.
    pub turned: bool,
    /// Hidden effects.
    pub effects: Vec<Hidden>,
    /// Size of all hidden effects in the work: root mean square change of the measured centre of pressure minus the centre
    /// of mass of the true body in the suit's pose, mm.
    pub effect_mm: f64,
}

/// Phases of a recording, s since its start.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spans {
    /// Identification poses.
    pub identify: [f64; 2],
    /// Work before the effect starts, unless it is present from the start.
    pub reference: [f64; 2],
    /// Work in question.
    pub work: [f64; 2],
}

/// A standing place of the worker.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// Start time, s.
    pub from_s: f64,
    /// Middle between the feet, m.
    pub middle_m: [f64; 2],
    /// Turn to the left, degrees.
    pub heading_deg: f64,
}

/// One hidden effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hidden {
    /// The catalogue's name, or `outside`.
    pub name: String,
    /// Place: `hand` or `segment`.
    #[serde(rename = "where")]
    pub place: BTreeMap<String, String>,
    /// Parameters with the catalogue's names and units; only those that can be compared.
    pub parameters: BTreeMap<String, f64>,
    /// Start and end, s.
    pub span_s: [f64; 2],
    /// Time of the change of its sign, s.
    pub flips_at_s: Option<f64>,
    /// Size over the nominal detectable size: 0.5, 1, 2 or 4.
    pub size: f64,
    /// Whether it is present during identification.
    pub from_beginning: bool,
    /// Description.
    pub description: String,
}

impl Hidden {
    /// Whether it is in the catalogue.
    pub fn is_in_catalogue(&self) -> bool {
        self.name != "outside"
    }

    /// Name with place, as of candidates: `worn_mass T8`.
    pub fn label(&self) -> String {
        self.place.values().fold(self.name.clone(), |label, place| format!("{label} {place}"))
    }
}

/// A finding against the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// `named` with right names only; `none` for a clean session, `unexplained` for an effect outside the catalogue.
    Right,
    /// `named` with a wrong name.
    Wrong,
    /// Anything else.
    Undecided,
}
