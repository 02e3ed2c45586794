//! The sealed side of a session: what was hidden in it. Only the judge opens it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// What is so in a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Name of the recording without its ending.
    pub session: String,
    /// Everything random follows from it.
    pub seed: u64,
    /// What was drawn: `clean`, `hand_load right`, `pair`, `outside elastic_band`, …
    pub kind: String,
    /// `ordinary` or `coloured`.
    pub noise: String,
    /// Stature, m.
    pub height_m: f64,
    /// Body mass, kg.
    pub mass_kg: f64,
    /// Which part is what, s since the recording's begin.
    pub spans: Spans,
    /// Whether to tell the program the span of the reference: not where something is there from the beginning, and not
    /// always otherwise, so that its absence has no meaning.
    pub reports_reference: bool,
    /// How long the recording is, s.
    pub length_s: f64,
    /// Where the worker stands, in order.
    pub places: Vec<Standing>,
    /// Whether the worker has turned by 25° or more between identification or reference and the end of the work.
    pub turned: bool,
    /// What was hidden.
    pub effects: Vec<Hidden>,
    /// How large all of it is in the work: root mean square of how it changes the measured centre of pressure less the
    /// centre of mass that the suit's pose has with the true body, mm.
    pub effect_mm: f64,
}

/// Which part of a recording is what, s since its begin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spans {
    /// Identification poses.
    pub identify: [f64; 2],
    /// Work before anything was hidden, unless it was there from the beginning.
    pub reference: [f64; 2],
    /// Work in question.
    pub work: [f64; 2],
}

/// Where the worker stands from a time on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// Since when, s.
    pub from_s: f64,
    /// Between the feet, m.
    pub middle_m: [f64; 2],
    /// Turn to the left, degrees.
    pub heading_deg: f64,
}

/// One hidden effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hidden {
    /// The catalogue's name, or `outside`.
    pub name: String,
    /// Where: `hand` or `segment`.
    #[serde(rename = "where")]
    pub place: BTreeMap<String, String>,
    /// By the catalogue's parameter names and in its units; of some only what can be compared.
    pub parameters: BTreeMap<String, f64>,
    /// From when to when it is there, s.
    pub span_s: [f64; 2],
    /// When its sign turns over, s.
    pub flips_at_s: Option<f64>,
    /// Size over the nominal detectable size: 0.5, 1, 2 or 4.
    pub size: f64,
    /// Whether it is there while the worker is identified.
    pub from_beginning: bool,
    /// In words.
    pub description: String,
}

impl Hidden {
    /// Whether the catalogue has it.
    pub fn is_in_catalogue(&self) -> bool {
        self.name != "outside"
    }

    /// Name with place, as candidates are called: `worn_mass T8`.
    pub fn label(&self) -> String {
        self.place.values().fold(self.name.clone(), |label, place| format!("{label} {place}"))
    }
}
