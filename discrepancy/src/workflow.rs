//! Finds discrepancies between model and measurement in a recording: reads it, identifies the subject, compares, and
//! determines the missing effects.
//!
//! The subject is identified from the identification span only and then frozen; a second pass compares the predictions
//! of the frozen model with the plate's measurements ([`crate::compare`]). The engine determines effects;
//! this module provides files and cycle.
//!
//! Layers, lowest first: [`survey`] → `subjects` → [`identify`], `cutoff` → `session` → this file → [`output`], [`summary`].

mod cutoff;
pub mod identify;
pub mod output;
mod session;
mod subjects;
pub mod summary;
pub mod survey;

use anyhow::bail;
use equipoise_config::Config;
use equipoise_core::cycle::Settings;
use equipoise_recording::replay::input::Input;
use equipoise_recording::replay::samples::SkippedData;

use crate::session::Session;
use crate::spans::{Given, ResolvedSpans};

use identify::Identified;
use survey::Survey;

/// Progress of a pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Current step.
    pub doing: &'static str,
    /// Completed fraction, in [0, 1].
    pub fraction: f64,
}

/// Input of a reconciliation.
#[derive(Debug)]
pub struct Reconcile<'a> {
    /// The recording.
    pub input: &'a Input,
    /// Its configuration, with the model of the effects already found.
    pub config: &'a Config,
    /// The spans given by the user.
    pub given: Given,
}

/// A recording, compared with the model.
#[derive(Debug)]
pub struct Compared {
    /// Input of the engine.
    pub session: Session,
    /// The identified and frozen subject.
    pub identified: Identified,
    /// The spans of the recording, also in words.
    pub spans: ResolvedSpans,
    /// Unused parts of the input.
    pub skipped: SkippedData,
}

impl Reconcile<'_> {
    /// The cycle's settings, with the effects already found and without passive adaptation.
    fn settings(&self) -> Settings {
        // Lags and displacements are effects to find, so the cycle must not correct them.
        let sensors = Settings { align_streams: false, watch_registration: false, ..self.config.settings() };
        Settings { passive: false, ..sensors }
    }

    /// Surveys the recording, identifies the subject and compares.
    ///
    /// # Errors
    /// What the recording lacks, or which span is unusable.
    pub fn compare(&self, progress: &mut dyn FnMut(Progress)) -> anyhow::Result<Compared> {
        let mut survey = Survey::of(self.input, self.config, 0..u64::MAX, progress)?;
        if let Some(part_ns) = subjects::part_ns(self, &survey)? {
            survey = Survey::of(self.input, self.config, part_ns, progress)?;
        }
        survey.check()?;
        let samples_s = survey.samples_s();
        self.given.check(samples_s)?;
        let poses_s = match self.given.identify {
            Some(span) => [span.from_s, span.to_s],
            None => [samples_s[0], self.given.learn_until_s(samples_s)],
        };
        survey.check_weight(poses_s, self.config)?;
        let identified = identify::identify(self, &survey, progress)?;
        let spans = self.given.resolve(&identified.phases(samples_s))?;
        let (session, mut skipped) = session::compare(self, &survey, &identified, &spans, progress)?;
        if session.blocks.is_empty() {
            bail!(
                "no usable block: in {} there is no interval of 0.2 s with both feet on the plate and data of suit and plate",
                spans.description
            );
        }
        if let Some(cause) = survey.recorded.memory_unavailable() {
            let missing = "the tare and the worker from before it are missing";
            skipped.rejected.push(format!("{cause}: {missing}"));
        }
        Ok(Compared { session, identified, spans, skipped })
    }
}
