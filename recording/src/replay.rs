//! Replays a recording or a capture of another program through the same `core::cycle::step` as the live loop, faster
//! than real time and with identical bytes every time.
//!
//! There are two schedules. If a recording has cycle records, their ticks, samples and commands are repeated from the
//! first checkpoint on: the states are the live loop's, and are compared with it (`recorded`). Imports have no cycle
//! records: ticks follow the configured rate, and a sample enters the first tick after its delivery
//! (`synthetic_ticks`).
//!
//! Layers, lowest first: `capture_file` → `samples`, `pcap`, [`survey`] → [`input`] → `pending` → `feed` → [`score`], [`residual`] →
//! `machine` → [`fidelity`], `recorded`, `synthetic_ticks` → `output`, [`cross_validation`]

mod capture_file;
pub mod cross_validation;
mod feed;
pub mod fidelity;
pub mod input;
mod machine;
mod output;
mod pcap;
mod pending;
mod recorded;
pub mod residual;
pub mod samples;
pub mod score;
pub mod summary;
pub mod survey;
pub mod synthetic_ticks;

use std::collections::VecDeque;
use std::path::Path;

use anyhow::bail;
use equipoise_adapters::recording::{Recording, RecordingHeader};
use equipoise_config::Config;
use equipoise_core::cycle::Settings;
use equipoise_core::message::{CycleRecord, State};

use input::Input;
use machine::Machine;
use output::Output;
use recorded::Start;
use samples::SkippedData;
pub use summary::Summary;
use survey::{SubjectChange, Survey};

/// A replay and its options.
#[derive(Debug)]
pub struct Replay<'a> {
    /// The input.
    pub input: &'a Input,
    /// Its configuration.
    pub config: &'a Config,
    /// Whether `config` is the configuration of the recording. Only then are states compared with it.
    pub as_recorded: bool,
    /// The span over which the loop's residual is summed, s since the start of the recording; `None` for all of it.
    pub residual_s: Option<[f64; 2]>,
}

impl Replay<'_> {
    /// Replays into a file: `.jsonl`, `.csv`, `.mcap`, or `-` for JSON lines on standard output.
    ///
    /// # Errors
    /// Nothing to replay, a checkpoint of another version, or a file that cannot be written.
    pub fn run(&self, out: Option<&Path>) -> anyhow::Result<Summary> {
        let mut output = match out {
            Some(path) => Output::create(path, &self.result_header())?,
            None => Output::discard(),
        };
        let summary = self.run_with_records(|state, record| output.write(state, record))?;
        output.finish()?;
        Ok(summary)
    }

    /// Replays and passes every state to `write`.
    ///
    /// # Errors
    /// As [`Replay::run`], and the error of `write`.
    pub fn run_with(&self, mut write: impl FnMut(&State) -> anyhow::Result<()>) -> anyhow::Result<Summary> {
        self.run_with_records(|state, _| write(state))
    }

    /// As [`Replay::run_with`], with the record of the replayed cycle; `None` if no cycles were recorded.
    fn run_with_records(
        &self,
        mut write: impl FnMut(&State, Option<&CycleRecord>) -> anyhow::Result<()>,
    ) -> anyhow::Result<Summary> {
        let survey = self.input.survey();
        let settings = self.settings()?;
        let mut machine = Machine::new(settings, survey.initial_memory(&settings));
        let mut summary = Summary::new(self.input.started_ns(), self.residual_s);
        match self.input {
            Input::Recording(recording) if survey.cycles > 0 => {
                let start = match (self.as_recorded, survey.checkpoints, &survey.checkpoint_refused) {
                    (true, 1.., _) => Start::Checkpoint,
                    (true, 0, Some(cause)) => bail!(
                        "the recording's checkpoints cannot be gone on from: {cause}; replay it with the release that \
                         recorded it ({}), or afresh by naming a configuration with --config",
                        recording.header().software_version
                    ),
                    _ => Start::Empty,
                };
                let reloads = self.input.reloads()?;
                let reloads = self.as_recorded.then_some(&reloads);
                let later = match start {
                    Start::Checkpoint => VecDeque::new(),
                    Start::Empty => self.later_subjects(&survey, recording),
                };
                let fidelity =
                    recorded::run(recording, &mut machine, start, reloads, later, |state, record| {
                        let period_ns = Some(record.period_ns).filter(|period_ns| *period_ns > 0);
                        summary.ingest(state, period_ns.unwrap_or(self.config.period_ns()));
                        write(state, Some(record))
                    })?;
                if summary.cycles == 0 && survey.samples == 0 {
                    let skipped = input::skipped_of(recording, fidelity.damage);
                    bail!("{}", with_skipped(synthetic_ticks::NO_SAMPLE, &skipped));
                }
                summary.skipped = input::skipped_of(recording, None);
                summary.fidelity = Some(fidelity);
            }
            input => {
                let mut samples = input.samples(self.config)?;
                let ran =
                    synthetic_ticks::run(samples.by_ref(), self.config.period_ns(), &[], |tick, inputs| {
                        let state = machine.step(tick, inputs);
                        summary.ingest(state, self.config.period_ns());
                        write(state, None)
                    });
                summary.skipped = samples.skipped();
                match ran {
                    // Unused parts of the input explain why there are no cycles.
                    Err(cause) if summary.cycles == 0 => {
                        bail!("{}", with_skipped(&cause.to_string(), &summary.skipped))
                    }
                    ran => ran?,
                }
            }
        }
        if let Some(cause) = survey.memory_unavailable() {
            let states = "the states are not those of the live loop";
            summary
                .skipped
                .rejected
                .push(format!("{cause}: replayed without its tare and its worker, so {states}"));
        }
        summary.scored = machine.into_scored();
        Ok(summary)
    }

    /// The settings at the start; the numbers of a similar subject are those of the recording.
    fn settings(&self) -> anyhow::Result<Settings> {
        let similar = if self.as_recorded { self.input.similar()? } else { None };
        Ok(Settings { similar, ..self.config.settings() })
    }

    /// Due time of the first cycle, ns, and settings of each later subject.
    fn later_subjects(&self, survey: &Survey, recording: &Recording) -> VecDeque<(u64, Settings)> {
        let mut later = VecDeque::new();
        for SubjectChange { at_ns, subjects: [_, id] } in survey.subject_changes(recording.header()) {
            let mut settings = self.config.settings();
            // The configured mass is that of the configured subject.
            settings.mass_kg = settings.mass_kg.filter(|_| id == self.config.subject.id);
            later.push_back((at_ns, settings));
        }
        later
    }

    /// The header of a recording of results: the input's, with the active configuration, outside the hash chain.
    fn result_header(&self) -> RecordingHeader {
        let base = match self.input {
            Input::Recording(recording) => recording.header().clone(),
            _ => RecordingHeader::default(),
        };
        RecordingHeader {
            software_version: env!("CARGO_PKG_VERSION").to_owned(),
            started_monotonic_ns: self.input.started_ns(),
            config_toml: self.config.clone().for_recording().to_toml(),
            model_toml: self.config.model_toml(),
            similar_toml: String::new(),
            previous: None,
            ..base
        }
    }
}

/// An error about an input without usable data: `what`, then the reasons why its data were not used, a line each.
pub fn with_skipped(what: &str, skipped: &SkippedData) -> String {
    format!("{what}\n{}", skipped_lines(skipped)).trim_end().to_owned()
}

/// Unused data in words, for the end of a summary.
pub fn skipped_lines(skipped: &SkippedData) -> String {
    let rejected = skipped.rejected.iter().map(|reason| format!("rejected: {reason}\n"));
    let ignored = skipped.ignored.iter().map(|reason| format!("passed over: {reason}\n"));
    rejected.chain(ignored).collect()
}
