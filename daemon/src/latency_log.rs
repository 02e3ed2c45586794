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
    hlog_failed: bool,
    flight_failed: bool,
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
            hlog_failed: false,
            flight_failed: false,
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
                self.write_flight(last);
                self.report_dropped();
                return Report::of(&self.total);
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
        self.write_flight(flight);
    }

    /// Switches interval log and flight recorder after a reload.
    fn apply_reload(&mut self) {
        let latency = self.active_configuration.with(|active| active.config.latency.clone());
        if self.hlog.as_ref().map(HlogFile::path) != latency.hlog.as_deref() {
            self.write_hlog(true);
            if std::mem::take(&mut self.hlog_failed) {
                warn!("what the latency log could not write is lost with it");
                self.set_incident(None);
            }
            self.hlog = latency.hlog.as_deref().map(HlogFile::new);
        }
        if latency.flight_cycles != self.flight_cycles {
            let last = self.flight.as_mut().and_then(|(recorder, _)| recorder.end());
            self.write_flight(last);
            self.flight = open_flight(&self.active_configuration.get().config, &self.flights);
            self.flight_cycles = latency.flight_cycles;
            if std::mem::take(&mut self.flight_failed) {
                self.set_incident(None);
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
        self.hlog_failed = failed.is_some();
        self.set_incident(failed);
    }

    fn write_flight(&mut self, flight: Option<Flight>) {
        let (Some(flight), Some((_, files))) = (flight, &self.flight) else { return };
        let failed = match files.write(&flight) {
            Ok(path) => {
                info!(cycle = flight.cycle, cycles = flight.outcomes.len(), "kept {}", path.display());
                None
            }
            Err(error) => Some(format!(
                "cannot keep the cycles around the deadline missed by cycle {}: {error}; make room in the state \
                 directory or correct its permissions, or set `[latency] flight_cycles = 0`",
                flight.cycle
            )),
        };
        self.flight_failed = failed.is_some();
        self.set_incident(failed);
    }

    /// Sets the incident that both kinds of file share; it ends once all writes succeed.
    fn set_incident(&self, failed: Option<String>) {
        if let Some(what) = failed {
            self.board.begin(Incident::LatencyNotLogged, &what);
        } else if !self.hlog_failed && !self.flight_failed {
            self.board.end(Incident::LatencyNotLogged);
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
