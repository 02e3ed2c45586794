//! Reads a recording once and gathers the data of a report.

use std::collections::VecDeque;

use equipoise_adapters::recording::{Entry, Recording, RecordingHeader, pseudonym};
use equipoise_config::Config;
use equipoise_core::exposure::dose::LIFT_MIN_S;
use equipoise_core::message::State;
use equipoise_latency::{PathHistograms, Report as PathReport};
use equipoise_recording::replay::Replay;
use equipoise_recording::replay::input::{Chosen, Input};
use equipoise_recording::replay::samples::Sample;
use equipoise_recording::replay::survey::SUBJECT_ATTACHED_WITHIN_NS;

use super::back::Back;
use super::body_positions::BodyPositions;
use super::exposure::Exposure;
use super::identification::Identification;
use super::lifts::Lifts;
use super::period::{Cause, Period};
use super::quality::Quality;
use super::records::Records;
use crate::constants::REORDER_BUFFER;

/// Origin of the states.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Recorded from the live loop.
    Recorded,
    /// Computed by the same cycle: the recording has samples only, or another configuration was given.
    Replayed,
}

/// The data of a report.
#[derive(Debug)]
pub struct Facts {
    /// Name of the file.
    pub name: String,
    /// Origin of the states.
    pub source: Source,
    /// The recording's header; empty for a capture of another program.
    pub header: RecordingHeader,
    /// The configuration in use.
    pub config: Config,
    /// Its origin, in words.
    pub config_origin: String,
    /// Pseudonyms of the subjects, in order; empty if none is named.
    pub subjects: Vec<String>,
    /// The session by worker and shift, in order.
    pub periods: Vec<Period>,
    /// Number of states.
    pub cycles: u64,
    /// Times of the first and last state, s since the start of the recording.
    pub span_s: Option<[f64; 2]>,
    /// Progress of the identification.
    pub identification: Identification,
    /// Exposure of the joints.
    pub exposure: Exposure,
    /// Lifts.
    pub lifts: Lifts,
    /// Low back, load, dose.
    pub back: Back,
    /// Positions of the body.
    pub body: BodyPositions,
    /// Final body mass, kg; 0 if unavailable.
    pub mass_kg: f64,
    /// Percentiles of the path; `None` without cycle records.
    pub path: Option<PathReport>,
    /// Quality of the data.
    pub quality: Quality,
    /// Unusable parts of the file, in words.
    pub rejected: Vec<String>,
    /// Result of the authenticity check, in one line; `None` for a capture.
    pub authenticity: Option<String>,
    /// Number of times that the settings were replaced during the recording; 0 if they were not those of the states.
    pub reloads: usize,
    /// Height of the walking surface in the world, m.
    pub surface_z_m: f64,
    started_ns: u64,
    records: Records,
    last: Option<Last>,
    /// Time of the first state of the last period; 0 for the first one.
    period_begin_ns: u64,
}

/// Data of the previous state, for comparison with the next one.
#[derive(Debug, Clone, Copy)]
struct Last {
    cycle: u64,
    time_ns: u64,
    lifts: u32,
}

impl Facts {
    /// Reads an input with its configuration; `name` is the display name of the file. Unless the configuration is the
    /// original one (`as_recorded`), recorded states are ignored and computed again.
    ///
    /// # Errors
    /// The input contains neither a usable state nor a usable sample.
    pub fn gather(name: &str, input: &Input, chosen: Chosen, as_recorded: bool) -> anyhow::Result<Facts> {
        let header = match input {
            Input::Recording(recording) => recording.header().clone(),
            _ => RecordingHeader::default(),
        };
        let surface_z_m = surface_z_m(input, &chosen.config);
        let first = pseudonym(&header.subject_toml).unwrap_or_else(|| chosen.config.subject.id.clone());
        let first = Some(first).filter(|id| !id.is_empty());
        let mut facts = Facts {
            name: name.to_owned(),
            source: Source::Recorded,
            subjects: header.subjects(&chosen.config.subject.id),
            reloads: if as_recorded { header.reloads.len() } else { 0 },
            header,
            config: chosen.config,
            config_origin: chosen.origin,
            periods: vec![Period::on(surface_z_m, None, first)],
            cycles: 0,
            span_s: None,
            identification: Identification::default(),
            exposure: Exposure::default(),
            lifts: Lifts::on(surface_z_m),
            back: Back::default(),
            body: BodyPositions::default(),
            mass_kg: 0.0,
            path: None,
            quality: Quality::default(),
            rejected: Vec::new(),
            authenticity: None,
            started_ns: input.started_ns(),
            surface_z_m,
            records: Records::default(),
            last: None,
            period_begin_ns: 0,
        };
        if let Input::Recording(recording) = input {
            facts.read(recording, as_recorded);
        }
        if facts.cycles == 0 {
            facts.replay(input, as_recorded)?;
        }
        Ok(facts)
    }

    /// Reads the recorded data up to the first damage.
    fn read(&mut self, recording: &Recording, as_recorded: bool) {
        let mut path = PathHistograms::new();
        let mut waiting = VecDeque::new();
        for timed in recording.entries() {
            match timed.map(|timed| timed.entry) {
                Ok(Entry::State(state)) if as_recorded => {
                    waiting.push_back(state);
                    if waiting.len() > REORDER_BUFFER
                        && let Some(state) = waiting.pop_front()
                    {
                        self.ingest(&state);
                    }
                }
                Ok(Entry::Cycle(record)) => {
                    path.record(&record);
                    self.records.ingest(&record);
                }
                Ok(Entry::Health(health)) => self.quality.ingest_health(&health),
                Ok(_) => {}
                Err(damage) => self.rejected.push(damage.to_string()),
            }
        }
        for state in waiting {
            self.ingest(&state);
        }
        let report = PathReport::of(&path);
        self.path = (report.cycles > 0).then_some(report);
        if recording.truncated() {
            self.rejected.push(Recording::TRUNCATED.to_owned());
        }
    }

    fn replay(&mut self, input: &Input, as_recorded: bool) -> anyhow::Result<()> {
        self.source = Source::Replayed;
        let config = self.config.clone();
        let replay = Replay { input, config: &config, as_recorded, residual_s: None };
        let summary = replay.run_with(|state| {
            self.ingest(state);
            Ok(())
        })?;
        let inexact = summary.fidelity.filter(|fidelity| !fidelity.is_exact());
        let inexact = inexact.map(|fidelity| fidelity.to_string()).unwrap_or_default();
        for reason in summary.skipped.rejected.into_iter().chain(inexact.lines().map(str::to_owned)) {
            if !self.rejected.contains(&reason) {
                self.rejected.push(reason);
            }
        }
        Ok(())
    }

    fn ingest(&mut self, state: &State) {
        let step_s = self.period_ns(state) as f64 / 1e9;
        let time_s = (i128::from(state.time_ns) - i128::from(self.started_ns)) as f64 / 1e9;
        self.cycles += 1;
        let [from_s, _] = self.span_s.unwrap_or([time_s; 2]);
        self.span_s = Some([from_s, time_s]);
        if let Some(last) = self.last.filter(|last| self.begins_period(*last, state)) {
            self.begin_period(last, state);
        }
        let stopped = self.last.is_some_and(|last| self.records.has_stop(last.time_ns, state.time_ns));
        let State { cycle, time_ns, lifts, .. } = *state;
        self.last = Some(Last { cycle, time_ns, lifts });
        self.identification.ingest(state, time_s, stopped);
        if let Some(period) = self.periods.last_mut() {
            period.ingest(state, time_s, step_s);
        }
        self.exposure.ingest(state, time_s, step_s);
        self.lifts.ingest(state, time_s, step_s);
        self.back.ingest(state, time_s, step_s);
        self.body.ingest(state, time_s);
        self.quality.ingest(state, step_s);
        self.mass_kg = state.mass_kg;
    }

    /// Duration that a state represents: that of the recorded cycle, which a replay repeats. The header is not
    /// sufficient: after a restart of the daemon the file still has the previous one's.
    fn period_ns(&self, state: &State) -> u64 {
        self.records.period_ns(state.time_ns).unwrap_or(self.config.period_ns())
    }

    fn begin_period(&mut self, last: Last, state: &State) {
        let previous = self.periods.last().and_then(|period| period.subject.clone());
        let subject = match self.records.has_deletion(last.time_ns, state.time_ns) {
            true => None,
            false => self.attached_at(state.time_ns).or_else(|| previous.clone()),
        };
        let cause = if subject != previous {
            Cause::Worker
        } else if self.records.has_load(last.time_ns, state.time_ns) {
            Cause::Load
        } else {
            Cause::Shift
        };
        if cause != Cause::Shift {
            self.identification = Identification::default();
        }
        self.lifts.change_subject(state);
        self.periods.push(Period::on(self.surface_z_m, Some(cause), subject));
        self.period_begin_ns = state.time_ns;
    }

    /// The pseudonym of the last subject that was attached since the last period began and until shortly after a time.
    fn attached_at(&self, time_ns: u64) -> Option<String> {
        let since_ns = self.period_begin_ns..=time_ns.saturating_add(SUBJECT_ATTACHED_WITHIN_NS);
        let header = &self.header;
        let mut attached = header.later_subjects_ns.iter().zip(&header.later_subjects_toml);
        attached.rfind(|(at_ns, _)| since_ns.contains(*at_ns)).and_then(|(_, text)| pseudonym(text))
    }

    /// Whether the subject was changed or a new shift began since the previous state: according to a record, or to a
    /// change in the number of lifts that is impossible within one shift of one subject, where it can only decrease one
    /// by one (`subject undo-lift`) and increases at a limited rate. A restart of the daemon restores the last saved
    /// number, which may be lower by one, begins a new shift at 0, or is with another configured subject.
    fn begins_period(&self, last: Last, state: &State) -> bool {
        if self.records.has_load(last.time_ns, state.time_ns)
            || state.cycle <= last.cycle && self.is_subject_attached(last.time_ns, state.time_ns)
        {
            return true;
        }
        let since_s = state.time_ns.saturating_sub(last.time_ns) as f64 / 1e9;
        let more = f64::from(state.lifts.saturating_sub(last.lifts));
        state.lifts.saturating_add(1) < last.lifts || more > 1.0 + since_s / (2.0 * LIFT_MIN_S)
    }

    /// Whether a subject was attached after a restart between these times, for another reason than a record of it.
    fn is_subject_attached(&self, before_ns: u64, restarted_ns: u64) -> bool {
        let until_ns = restarted_ns.saturating_add(SUBJECT_ATTACHED_WITHIN_NS);
        let loaded = self.records.has_load(before_ns.saturating_sub(SUBJECT_ATTACHED_WITHIN_NS), until_ns);
        !loaded && self.header.later_subjects_ns.iter().any(|at_ns| (before_ns..=until_ns).contains(at_ns))
    }

    /// Whether the whole file was used.
    pub fn is_complete(&self) -> bool {
        self.rejected.is_empty()
    }
}

/// Height of the walking surface in the world according to the first ground sample, m; 0 without one.
fn surface_z_m(input: &Input, config: &Config) -> f64 {
    let first = input.samples(config).ok().and_then(|mut samples| {
        samples.find_map(|sample| match sample {
            Sample::Ground(ground) => Some(ground.surface_z_m),
            Sample::Suit(_) | Sample::Body(_) => None,
        })
    });
    first.unwrap_or_default()
}
