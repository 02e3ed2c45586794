//! The model file: effects that were found, with what they were found from, for people to read and the loop to run.
//!
//! TOML. A file says where it comes from (`[provenance]`), and of every effect where it acts, when, how strong it is and
//! how sure that is:
//!
//! ```toml
//! version = 1
//!
//! [[effect]]
//! name = "worn_mass"
//! where = { segment = "T8" }       # or { hand = "left" }; nothing for the plate and the suit as a whole
//! span_s = [120.0, 640.0]          # seconds since the recording's begin
//! open_ended = true                # it lasted to the recording's end
//! log_odds = 83.0
//! [effect.parameters.mass_kg]
//! value = 2.1
//! sigma = 0.05
//! unit = "kg"
//! ```
//!
//! A parameter that is not there is zero. Whatever is read is checked: a file that a person has changed may not make the
//! loop compute nonsense.

mod ask;
mod check;
mod text;

use std::path::PathBuf;

use equipoise_core::effect::{Effect, Model, PARAMETERS_MAX, Place, TERMS_MAX, Term};
use serde::{Deserialize, Serialize};

pub use ask::{Ask, turn};

/// The version that is written, and the only one that is read.
pub const VERSION: u32 = 1;

/// Where a model comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// SHA-256 of the recording's bytes, 64 hexadecimal digits.
    pub recording_sha256: String,
    /// When it was made, UTC: `2026-03-01T08:30:00Z`.
    pub date: String,
    /// The worker's pseudonym.
    pub subject: String,
    /// The station.
    pub station: String,
    /// Version of the program.
    pub software: String,
    /// The identification poses, s of the recording.
    pub identify_s: [f64; 2],
    /// Work known to be clean, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_s: Option<[f64; 2]>,
    /// The work in question, s.
    pub work_s: [f64; 2],
}

/// One effect as it was fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fitted {
    /// Which.
    pub effect: Effect,
    /// Where.
    pub place: Place,
    /// What is not linear ([`Term::shape`]), and its 1-σ.
    pub shape: f64,
    /// 1-σ of the shape.
    pub shape_sigma: f64,
    /// The parameters, in the order and units of [`Effect::parameters_of`].
    pub value: [f64; PARAMETERS_MAX],
    /// 1-σ of each.
    pub sigma: [f64; PARAMETERS_MAX],
    /// From when to when it was seen, s since the recording's begin.
    pub span_s: [f64; 2],
    /// Whether it lasted to the recording's end.
    pub open_ended: bool,
    /// Log Bayes factor of adding it.
    pub log_odds: f64,
}

/// A whole model file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ModelFile {
    /// Where it comes from; `None` of one that was written by hand.
    pub provenance: Option<Provenance>,
    /// The effects, at most [`TERMS_MAX`].
    pub effects: Vec<Fitted>,
    /// What would tell explanations of its recording apart; `None` if nothing needs it.
    pub ask: Option<Ask>,
}

/// What of a model file the loop is to run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spans {
    /// The recording that the file was made from: every effect in its span.
    Hold,
    /// Any other, and live: effects that lasted to the end, from the first moment on for ever.
    OpenEndedForEver,
}

/// Why a model file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ModelFileError {
    /// It cannot be read.
    #[error("cannot read the model {path}: {source}; name an existing file with --model or [model] file")]
    Read {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// It is not what it should be.
    #[error("{place}: {what}")]
    Wrong {
        /// File, and line, or effect and key, where it is known.
        place: String,
        /// What is wrong, and what to do.
        what: String,
    },
}

impl ModelFile {
    /// Checks a text; `name` is what errors call it.
    ///
    /// # Errors
    /// [`ModelFileError`], whose text is fit for the person who wrote the file.
    pub fn parse(text: &str, name: &str) -> Result<ModelFile, ModelFileError> {
        let raw: text::Raw = toml::from_str(text).map_err(|error| text::explain(&error, text, name))?;
        check::checked(raw, name)
    }

    /// The file as TOML.
    pub fn to_toml(&self) -> String {
        text::of(self)
    }

    /// What the loop runs, and which effects that leaves out.
    pub fn model(&self, spans: Spans) -> (Model, Vec<&Fitted>) {
        let runs = |fitted: &&Fitted| spans == Spans::Hold || fitted.open_ended;
        let (running, left_out): (Vec<&Fitted>, Vec<&Fitted>) = self.effects.iter().partition(runs);
        let mut terms = [None; TERMS_MAX];
        for (place, fitted) in terms.iter_mut().zip(running) {
            *place = Some(fitted.term(spans));
        }
        (Model { terms }, left_out)
    }

    /// Whether it was made from a recording with this SHA-256.
    pub fn is_of(&self, recording_sha256: &str) -> bool {
        self.provenance
            .as_ref()
            .is_some_and(|from| from.recording_sha256.eq_ignore_ascii_case(recording_sha256))
    }
}

impl Fitted {
    fn term(&self, spans: Spans) -> Term {
        let span_s = match (spans, self.open_ended) {
            (Spans::OpenEndedForEver, _) => [0.0, f64::INFINITY],
            (Spans::Hold, true) => [self.span_s[0], f64::INFINITY],
            (Spans::Hold, false) => self.span_s,
        };
        Term { effect: self.effect, place: self.place, shape: self.shape, value: self.value, span_s }
    }

    /// Name with place, for people: `worn_mass T8`.
    pub fn name(&self) -> String {
        match text::place_name(self.place) {
            Some((_, name)) => format!("{} {name}", self.effect.name()),
            None => self.effect.name().to_owned(),
        }
    }
}

#[cfg(test)]
mod tests;
