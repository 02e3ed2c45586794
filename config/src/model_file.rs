//! The model file: named effects and their provenance, readable, and applied by the loop.
//!
//! TOML, with the recording it was made from (`[provenance]`), and place, time span, parameters and evidence of every
//! effect:
//!
//! ```toml
//! version = 1
//!
//! [[effect]]
//! name = "worn_mass"
//! where = { segment = "T8" }       # or { hand = "left" }; absent for the plate and the whole suit
//! span_s = [120.0, 640.0]          # seconds since the recording's begin
//! open_ended = true                # it lasted to the recording's end
//! log_odds = 83.0
//! [effect.parameters.mass_kg]
//! value = 2.1
//! sigma = 0.05
//! unit = "kg"
//! ```
//!
//! An absent parameter is zero. Every value is validated, since files may be edited by hand.

mod ask;
mod check;
mod limits;
mod merge;
mod review;
mod text;

use std::path::PathBuf;

use equipoise_core::effect::{Effect, Model, PARAMETERS_MAX, Place, TERMS_MAX, Term};
use serde::{Deserialize, Serialize};

pub use ask::{Ask, turn};
pub use limits::largest;
pub use merge::{MergeError, Merged, merge};
pub use review::{Review, Verdict, with_review};

/// The version that is written and read.
pub const VERSION: u32 = 1;

/// Provenance of a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// SHA-256 of the recording's bytes, 64 hexadecimal digits.
    pub recording_sha256: String,
    /// Time of creation, UTC: `2026-03-01T08:30:00Z`.
    pub date: String,
    /// Pseudonym of the subject.
    pub subject: String,
    /// The station.
    pub station: String,
    /// Version of the program.
    pub software: String,
    /// Identification poses, s of the recording.
    pub identify_s: [f64; 2],
    /// Work declared clean, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_s: Option<[f64; 2]>,
    /// Work in question, s.
    pub work_s: [f64; 2],
}

/// A fitted effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// The effect.
    pub effect: Effect,
    /// Its place.
    pub place: Place,
    /// The non-linear parameter ([`Term::shape`]).
    pub shape: f64,
    /// 1-σ of the shape.
    pub shape_sigma: f64,
    /// Parameters, in the order and units of [`Effect::parameters_of`].
    pub value: [f64; PARAMETERS_MAX],
    /// 1-σ of each.
    pub sigma: [f64; PARAMETERS_MAX],
    /// Time span, s since the recording's start.
    pub span_s: [f64; 2],
    /// Whether it lasted to the end of the recording.
    pub open_ended: bool,
    /// Log Bayes factor of adding it.
    pub log_odds: f64,
    /// An engineer's verdict; `None` without one.
    pub review: Option<Review>,
}

/// A parameter of a fitted effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name in the file.
    pub name: &'static str,
    /// Value, in the unit.
    pub value: f64,
    /// 1-σ, in the unit.
    pub sigma: f64,
    /// Unit as written in the file.
    pub unit: &'static str,
}

/// A whole model file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ModelFile {
    /// Provenance; `None` if it was written by hand or merged.
    pub provenance: Option<Provenance>,
    /// Provenance of the models that were merged into it.
    pub merged_from: Vec<Provenance>,
    /// Effects; at most [`TERMS_MAX`] are not rejected.
    pub effects: Vec<Fitted>,
    /// Measurement that separates explanations of its recording; `None` if none is needed.
    pub ask: Option<Ask>,
}

/// Time spans in which the loop applies the effects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spans {
    /// For the recording that the file was made from: every effect in its span.
    Hold {
        /// Begin of the recording, CLOCK_MONOTONIC ns.
        begin_ns: u64,
    },
    /// For any other recording and live: effects that lasted to the end, without limits. Those that grow with time
    /// are left out.
    OpenEndedForEver,
}

/// Why a model file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ModelFileError {
    /// The file cannot be read.
    #[error("cannot read the model {path}: {source}; name an existing file with --model or [model] file")]
    Read {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// The content is invalid.
    #[error("{place}: {what}")]
    Wrong {
        /// File, and line, or effect and key, if known.
        place: String,
        /// The error and its remedy.
        what: String,
    },
}

impl ModelFile {
    /// Parses and validates a text; errors refer to it as `name`.
    ///
    /// # Errors
    /// [`ModelFileError`], worded for the author of the file.
    pub fn parse(text: &str, name: &str) -> Result<ModelFile, ModelFileError> {
        let raw: text::Raw = toml::from_str(text).map_err(|error| text::explain(&error, text, name))?;
        check::checked(raw, name)
    }

    /// The file as TOML.
    pub fn to_toml(&self) -> String {
        text::of(self)
    }

    /// The model for the loop, and the effects that it leaves out.
    pub fn model(&self, spans: Spans) -> (Model, Vec<&Fitted>) {
        let origin_ns = match spans {
            Spans::Hold { begin_ns } => Some(begin_ns),
            Spans::OpenEndedForEver => None,
        };
        let is_elsewhere = |fitted: &Fitted| fitted.open_ended && !fitted.grows_without_bound();
        let is_applied =
            |fitted: &&Fitted| !fitted.is_rejected() && (origin_ns.is_some() || is_elsewhere(fitted));
        let (applied, left_out): (Vec<&Fitted>, Vec<&Fitted>) = self.effects.iter().partition(is_applied);
        let mut terms = [None; TERMS_MAX];
        for (term, fitted) in terms.iter_mut().zip(applied) {
            *term = Some(fitted.term(spans));
        }
        (Model { terms, origin_ns }, left_out)
    }

    /// The effects that an engineer rejected.
    pub fn rejected(&self) -> impl Iterator<Item = &Fitted> {
        self.effects.iter().filter(|fitted| fitted.is_rejected())
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
            (Spans::Hold { .. }, true) => [self.span_s[0], f64::INFINITY],
            (Spans::Hold { .. }, false) => self.span_s,
        };
        Term { effect: self.effect, place: self.place, shape: self.shape, value: self.value, span_s }
    }

    /// Whether its size depends on the time since its recording's start, without a bound.
    pub fn grows_without_bound(&self) -> bool {
        self.effect.grows_without_bound(self.shape)
    }

    /// Whether an engineer rejected it.
    pub fn is_rejected(&self) -> bool {
        self.review.as_ref().is_some_and(|review| review.verdict == Verdict::Rejected)
    }

    /// Its parameters, the fitted shape included.
    pub fn parameters(&self) -> Vec<Parameter> {
        let shape = self.effect.shape_name().filter(|_| self.shape != 0.0).map(|name| Parameter {
            name,
            value: self.shape,
            sigma: self.shape_sigma,
            unit: text::shape_unit(self.effect),
        });
        let described = self.effect.parameters_of(self.shape).iter().zip(self.value.iter().zip(self.sigma));
        let values = described.map(|(described, (&value, sigma))| Parameter {
            name: described.name,
            value,
            sigma,
            unit: described.unit,
        });
        // A lag's parameter is its shape.
        let values = values.filter(|_| !text::shape_is_parameter(self.effect));
        shape.into_iter().chain(values).collect()
    }

    /// Name with place: `worn_mass T8`.
    pub fn name(&self) -> String {
        match text::place_name(self.place) {
            Some((_, name)) => format!("{} {name}", self.effect.name()),
            None => self.effect.name().to_owned(),
        }
    }
}

#[cfg(test)]
mod tests;
