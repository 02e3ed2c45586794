//! Where model and measurement disagree in a recording: reads it, learns the worker, compares, asks what is missing.
//!
//! The worker is learnt in the identification span alone and frozen; then the recording is gone through again, and what
//! the frozen model predicts is compared with what the plate measured (`equipoise_discrepancy::compare`). All questions
//! about effects are the engine's; here are the files and the cycle.
//!
//! Floors, ground first: `date`, [`survey`] → [`learn`], `known` → `session` → this file → [`output`],
//! [`summary`].

pub(crate) mod date;
mod known;
pub mod learn;
pub mod output;
mod session;
pub mod summary;
pub mod survey;

use anyhow::bail;
use equipoise_core::cycle::{Memory, Settings};
use equipoise_discrepancy::session::Session;
use equipoise_discrepancy::spans::{Found, Given};

use crate::config::Config;
use crate::replay::input::Input;
use crate::replay::samples::LeftOut;
use learn::Learnt;
use survey::Survey;

/// The loop's ticks here, ns: every suit sample is seen, whatever the configured rate.
const TICK_NS: u64 = 4_000_000;

/// How far a pass has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// What is being done.
    pub doing: &'static str,
    /// How much of it is done, in [0, 1].
    pub share: f64,
}

/// What to look into.
#[derive(Debug)]
pub struct Reconcile<'a> {
    /// The recording.
    pub input: &'a Input,
    /// Its configuration, with the model of the effects that are known already.
    pub config: &'a Config,
    /// The spans that a person gave.
    pub given: Given,
}

/// A recording, compared with the model.
#[derive(Debug)]
pub struct Compared {
    /// What the engine works on.
    pub session: Session,
    /// The worker as learnt, frozen.
    pub learnt: Learnt,
    /// Which part is what, in words too.
    pub found: Found,
    /// What of the input was not used.
    pub left_out: LeftOut,
}

impl Reconcile<'_> {
    /// The cycle's settings, with the effects that are known; nothing is learnt but where this says so.
    fn settings(&self) -> Settings {
        // A lag is named as an effect, so it must not be corrected before.
        Settings { passive: false, align_streams: false, ..self.config.settings() }
    }

    /// Surveys, learns, compares.
    ///
    /// # Errors
    /// A sentence: what the recording lacks, or which span cannot be used.
    pub fn compare(&self, progress: &mut dyn FnMut(Progress)) -> anyhow::Result<Compared> {
        let survey = Survey::of(self.input, self.config, progress)?;
        survey.check()?;
        let samples_s = survey.samples_s();
        self.given.check(samples_s)?;
        let poses_s = match self.given.identify {
            Some(span) => [span.from_s, span.to_s],
            None => [samples_s[0], self.given.learn_until_s(samples_s)],
        };
        survey.check_weight(poses_s, self.config)?;
        let learnt = learn::learn(self, &survey, progress)?;
        let found = self.given.find(&learnt.shown(samples_s))?;
        let (session, left_out) = session::compare(self, &survey, &learnt, &found, progress)?;
        if session.blocks.is_empty() {
            bail!(
                "nothing can be compared: in {} there is no fifth of a second in which both feet stand on the plate and suit \
                 and plate are both heard",
                found.told
            );
        }
        Ok(Compared { session, learnt, found, left_out })
    }
}

/// A memory to begin with: that of the recording's first checkpoint keeps its tare.
fn memory_at_first(reconcile: &Reconcile<'_>, survey: &Survey) -> Box<Memory> {
    let settings = reconcile.settings();
    let mut memory = bytemuck::zeroed_box::<Memory>();
    match survey.first_memory() {
        Some(first) => {
            bytemuck::bytes_of_mut(&mut *memory).copy_from_slice(bytemuck::bytes_of(first));
            memory.start_over(&settings);
        }
        None => memory.start(&settings),
    }
    memory
}
