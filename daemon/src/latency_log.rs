//! The latency log: histograms, interval log and flight recorder, on an ordinary thread.
//!
//! Egress is real-time and must never wait for a disk, so it only copies each outcome into a ring ([`feed`]). If the
//! log falls behind, it loses cycles and reports how many; a disk that cannot be written raises the incident
//! `latency_not_logged` without further effect.

pub mod feed;
pub mod flight;
pub mod flight_files;
pub mod hlog_file;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use equipoise_config::Config;
use equipoise_core::message::Incident;
use equipoise_latency::{PathHistograms, Report};
use equipoise_station::state_directory::StateDirectory;
use tracing::{info, warn};

use self::feed::Drain;
use self::flight::{Flight, FlightRecorder};
use self::flight_files::FlightFiles;
use self::hlog_file::HlogFile;
use crate::active_configuration::SharedConfiguration;
use crate::incidents::IncidentBoard;
use crate::rings::Outcome;

/// Polling interval of the ring, short compared to its capacity. Polling saves egress a system call for a wake-up.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Minimum interval between reports of lost cycles.
const REPORT_INTERVAL: Duration = Duration::from_secs(10);
/// Interval between attempts to write a flight record.
const RETRY_INTERVAL: Duration = Duration::from_secs(10);

/// The latency log before it runs.
pub struct LatencyLog {
    drain: Drain,
    /// The active configuration; a reload may change the path of the interval log.
    active_configuration: Arc<SharedConfiguration>,
    board: Arc<IncidentBoard>,
    total: PathHistograms,
    hlog: Option<HlogFile>,
    flight: Option<(FlightRecorder, FlightFiles)>,
    flight_cycles: u32,
    /// Directory of flight records.
    flights: PathBuf,
    /// Why the interval log could not be written.
    hlog_failed: Option<String>,
    /// The newest flight record that could not be written, and the reason.
    unwritten: Option<(Flight, String)>,
    flight_tried: Instant,
    dropped_reported: u64,
    reported_at: Instant,
}

impl LatencyLog {
    /// Builds the log according to the active configuration.
    pub fn new(
        drain: Drain,
        active_configuration: Arc<SharedConfiguration>,
        board: Arc<IncidentBoard>,
        state: &StateDirectory,
    ) -> LatencyLog {
        let config = active_configuration.get().config;
        LatencyLog {
            drain,
            active_configuration,
            board,
            total: PathHistograms::new(),
            hlog: config.latency.hlog.as_deref().map(HlogFile::new),
            flight: open_flight(&config, &state.flights()),
            flights: state.flights(),
            flight_cycles: config.latency.flight_cycles,
            hlog_failed: None,
            unwritten: None,
            flight_tried: Instant::now(),
            dropped_reported: 0,
            reported_at: Instant::now(),
        }
    }

    /// Runs until egress has ended; the report then includes all outcomes that egress passed on.
    pub fn run(mut self) -> Report {
        if let Some((_, files)) = &self.flight {
            files.clear_unfinished();
        }
        loop {
            // Checked before the ring is emptied, so that the ring contains the last outcome.
            let ended = self.drain.is_closed();
            while let Some(outcome) = self.drain.pop() {
                self.record(&outcome);
            }
            self.apply_reload();
            self.write_hlog(ended);
            if ended {
                let last = self.flight.as_mut().and_then(|(recorder, _)| recorder.end());
                self.write_flights(last);
                self.report_dropped();
                return Report::of(&self.total);
            }
            if self.unwritten.is_some() && self.flight_tried.elapsed() >= RETRY_INTERVAL {
                self.write_flights(None);
            }
            if self.reported_at.elapsed() >= REPORT_INTERVAL {
                self.report_dropped();
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    fn record(&mut self, outcome: &Outcome) {
        self.total.record(&outcome.record);
        if let Some(hlog) = &mut self.hlog {
            hlog.record(&outcome.record);
        }
        let flight = self.flight.as_mut().and_then(|(recorder, _)| recorder.record(outcome));
        if flight.is_some() {
            self.write_flights(flight);
        }
    }

    /// Switches interval log and flight recorder after a reload.
    fn apply_reload(&mut self) {
        let latency = self.active_configuration.with(|active| active.config.latency.clone());
        if self.hlog.as_ref().map(HlogFile::path) != latency.hlog.as_deref() {
            self.write_hlog(true);
            if self.hlog_failed.take().is_some() {
                warn!("what the latency log could not write is lost with it");
                self.set_incident();
            }
            self.hlog = latency.hlog.as_deref().map(HlogFile::new);
        }
        if latency.flight_cycles != self.flight_cycles {
            let last = self.flight.as_mut().and_then(|(recorder, _)| recorder.end());
            self.write_flights(last);
            self.flight = open_flight(&self.active_configuration.get().config, &self.flights);
            self.flight_cycles = latency.flight_cycles;
            if self.unwritten.take().is_some() {
                self.set_incident();
            }
        }
    }

    fn write_hlog(&mut self, at_once: bool) {
        let Some(hlog) = &mut self.hlog else { return };
        let Some(written) = hlog.write_if_due(at_once) else { return };
        let failed = written.as_ref().err().map(|error| {
            format!(
                "cannot write the latency log {}: {error}; it is tried again every ten seconds, and what is measured \
                 meanwhile is kept: make room, or see to `[latency] hlog`",
                hlog.path().display()
            )
        });
        self.hlog_failed = failed;
        self.set_incident();
    }

    /// Writes a new flight record and the one that could not be written before, if any.
    fn write_flights(&mut self, new: Option<Flight>) {
        let Some((_, files)) = &self.flight else { return };
        let (is_new, mut has_failed) = (new.is_some(), false);
        let before = self.unwritten.take().map(|(flight, _)| flight);
        for flight in before.into_iter().chain(new) {
            match files.write(&flight) {
                Ok(path) => {
                    info!(cycle = flight.cycle, cycles = flight.outcomes.len(), "kept {}", path.display());
                }
                Err(error) => {
                    let reason = format!(
                        "cannot keep the cycles around the deadline missed by cycle {}: {error:#}; it is tried again every \
                         ten seconds: make room in the state directory or correct its permissions, or set `[latency] \
                         flight_cycles = 0`",
                        flight.cycle
                    );
                    has_failed = true;
                    self.unwritten = Some((flight, reason));
                }
            }
        }
        self.flight_tried = Instant::now();
        // Failed retries are not logged.
        if is_new || !has_failed {
            self.set_incident();
        }
    }

    /// Sets the incident that both kinds of file share; it ends once all writes succeed.
    fn set_incident(&self) {
        match self.unwritten.as_ref().map(|(_, reason)| reason).or(self.hlog_failed.as_ref()) {
            Some(what) => self.board.begin(Incident::LatencyNotLogged, what),
            None => self.board.end(Incident::LatencyNotLogged),
        }
    }

    /// Reports outcomes that are missing in the log and files.
    fn report_dropped(&mut self) {
        self.reported_at = Instant::now();
        let dropped = self.drain.dropped();
        let new = dropped - std::mem::replace(&mut self.dropped_reported, dropped);
        if new > 0 {
            self.board.report_once(
                Incident::LatencyNotLogged,
                &format!(
                    "the latency log fell behind: {new} cycles are neither in it nor in flight records, {dropped} since \
                     the start; they were published all the same"
                ),
            );
        }
        let skipped = self.flight.as_mut().map_or(0, |(recorder, _)| recorder.take_skipped());
        if skipped > 0 {
            warn!(
                "{skipped} missed deadlines have no flight record: one is kept in {} s",
                flight::PAUSE_NS / equipoise_core::time::NS_PER_S
            );
        }
    }
}

/// The flight recorder according to a configuration.
fn open_flight(config: &Config, directory: &Path) -> Option<(FlightRecorder, FlightFiles)> {
    let cycles = config.latency.flight_cycles as usize;
    (cycles > 0).then(|| {
        let files = FlightFiles::new(directory, config);
        (FlightRecorder::new(cycles), files)
    })
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;
    use equipoise_core::message::{CycleRecord, State};

    use super::*;
    use crate::active_configuration::ActiveConfiguration;
    use crate::example_config;
    use crate::rings::Rings;

    /// A log with flight records of four cycles, and its incidents.
    fn log(state: &StateDirectory) -> (LatencyLog, Arc<IncidentBoard>) {
        let config = example_config::config("a", "[latency]\nflight_cycles = 4\n");
        let active = ActiveConfiguration { config, loaded: None, similar: None };
        let active = SharedConfiguration::new(active, Rings::new().unwrap().settings);
        let board = Arc::new(IncidentBoard::default());
        let (_, drain) = feed::feed(4);
        (LatencyLog::new(drain, Arc::new(active), Arc::clone(&board), state), board)
    }

    #[test]
    fn a_failed_flight_record_is_written_later_which_ends_the_incident() {
        let directory = tempfile::tempdir().unwrap();
        let state = StateDirectory::at(directory.path());
        let (mut log, board) = log(&state);
        let miss = |log: &mut LatencyLog, cycle: u64| {
            // The cycle after the missed deadline completes the record; ten seconds pass before the next.
            for (cycle, deadline_missed) in [(cycle, 1), (cycle + 1, 0)] {
                let due_ns = cycle * flight::PAUSE_NS;
                let record = CycleRecord { cycle, due_ns, deadline_missed, ..CycleRecord::zeroed() };
                log.record(&Outcome { state: State::zeroed(), record });
            }
        };
        let records = || std::fs::read_dir(state.flights()).unwrap().count();
        std::fs::write(state.flights(), "no directory").unwrap();
        miss(&mut log, 1);
        assert!(board.messages()["latency_not_logged"].contains("missed by cycle 1: "));
        std::fs::remove_file(state.flights()).unwrap();
        log.write_flights(None);
        assert!(!board.is_active(Incident::LatencyNotLogged));
        assert_eq!(records(), 1);
        // The next record is a later write too.
        std::fs::rename(state.flights(), directory.path().join("moved")).unwrap();
        std::fs::write(state.flights(), "no directory").unwrap();
        miss(&mut log, 3);
        assert!(board.is_active(Incident::LatencyNotLogged));
        std::fs::remove_file(state.flights()).unwrap();
        miss(&mut log, 5);
        assert!(!board.is_active(Incident::LatencyNotLogged));
        assert_eq!(records(), 2);
    }
}
