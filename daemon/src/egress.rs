//! From the loop to the bus: publishes, stamps, wakes consumers, keeps the histograms.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant, SystemTime};

use equipoise_bus::{Bus, BusError, BusSettings, Channel, Event, Notifier, Publisher};
use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::{CycleRecord, State};
use equipoise_latency::hlog::HlogWriter;
use equipoise_latency::{PathHistograms, Report};
use tracing::{info, warn};

use crate::realtime::now_ns;
use crate::rings::{Outcome, Rings, Waiting};
use crate::saving::ChangedWorker;

const WAKE_AT_LEAST: Duration = Duration::from_millis(50);
/// One entry per stage in the interval log this often.
const HLOG_INTERVAL: Duration = Duration::from_secs(10);

/// Egress, with its ports open.
pub struct Egress {
    rings: Arc<Rings>,
    waiting: Waiting,
    state: Publisher<State>,
    cycle: Publisher<CycleRecord>,
    checkpoint: Publisher<Checkpoint>,
    events: Notifier,
    worker_changed: Sender<ChangedWorker>,
    phase: u32,
    deadlines_missed: u64,
    latency: PathHistograms,
    hlog: Option<Hlog>,
    last_checkpoint_service: Instant,
    // Ports die before the node they hang on.
    _bus: Bus,
}

impl Egress {
    /// Opens the ports.
    ///
    /// # Errors
    /// The bus cannot be joined.
    pub fn open(
        station: &str,
        rings: Arc<Rings>,
        waiting: Waiting,
        worker_changed: Sender<ChangedWorker>,
        hlog: Option<&Path>,
    ) -> Result<Egress, BusError> {
        let bus = Bus::join(&BusSettings::new(station, "egress"))?;
        Ok(Egress {
            rings,
            waiting,
            state: bus.publisher()?,
            cycle: bus.publisher()?,
            checkpoint: bus.publisher()?,
            events: bus.notifier(Channel::Results)?,
            worker_changed,
            phase: u32::MAX,
            deadlines_missed: 0,
            latency: PathHistograms::new(),
            hlog: hlog.and_then(Hlog::create),
            last_checkpoint_service: Instant::now(),
            _bus: bus,
        })
    }

    /// Publishes until the loop has ended and its last word is out.
    ///
    /// # Errors
    /// The bus breaks.
    pub fn run(mut self) -> Result<Report, BusError> {
        loop {
            // Asked before the rings are emptied: what the loop said last is in them then.
            let ended = self.rings.has_ended();
            self.rings.await_outcome(self.waiting, WAKE_AT_LEAST);
            self.publish_outcomes()?;
            while let Some((worker, checkpoint)) = self.rings.taken.pop() {
                self.publish_checkpoint(worker, checkpoint)?;
            }
            if self.last_checkpoint_service.elapsed() > Duration::from_secs(1) {
                self.checkpoint.serve_late_subscribers()?;
                self.last_checkpoint_service = Instant::now();
            }
            if let Some(hlog) = &mut self.hlog {
                hlog.write_if_due(false);
            }
            if ended {
                if let Some(hlog) = &mut self.hlog {
                    hlog.write_if_due(true);
                }
                return Ok(Report::of(&self.latency));
            }
        }
    }

    /// Publishes what the loop has said so far; how many cycles.
    ///
    /// # Errors
    /// The bus breaks.
    pub fn publish_outcomes(&mut self) -> Result<usize, BusError> {
        let mut published = 0;
        while let Some(outcome) = self.rings.outcome.pop() {
            self.publish(outcome)?;
            published += 1;
        }
        Ok(published)
    }

    fn publish(&mut self, Outcome { mut state, mut record }: Outcome) -> Result<(), BusError> {
        state.published_ns = now_ns();
        self.state.send(&state)?;
        record.published_ns = now_ns();
        // One awakening per cycle; what else happened is said with it, and before the record, which nobody waits for.
        if state.phase != self.phase {
            self.phase = state.phase;
            info!(phase = state.phase_name(), cycle = state.cycle, "phase");
            self.events.notify(Event::PhaseChanged)?;
        }
        if record.deadlines_missed != self.deadlines_missed {
            self.deadlines_missed = record.deadlines_missed;
            self.events.notify(Event::DeadlineMissed)?;
        }
        self.events.notify(Event::NewState)?;
        self.cycle.send(&record)?;
        self.latency.record(&record);
        if let Some(hlog) = &mut self.hlog {
            hlog.interval.record(&record);
        }
        Ok(())
    }

    fn publish_checkpoint(&mut self, worker: u64, checkpoint: Box<Checkpoint>) -> Result<(), BusError> {
        self.checkpoint.send(&checkpoint)?;
        if let Some(memory) = checkpoint.memory() {
            // Saving may have ended already; then nothing is saved any more.
            let _ = self.worker_changed.send((worker, Box::new(memory.identification)));
        }
        self.events.notify(Event::NewCheckpoint)?;
        // There are as many places as boxes.
        let _ = self.rings.blank.push(checkpoint);
        Ok(())
    }
}

/// The interval log.
struct Hlog {
    path: PathBuf,
    writer: Option<HlogWriter<BufWriter<File>>>,
    interval: PathHistograms,
    started: Instant,
    since: Instant,
}

impl Hlog {
    fn create(path: &Path) -> Option<Hlog> {
        let writer = File::create(path).map_err(|error| error.to_string()).and_then(|file| {
            HlogWriter::new(BufWriter::new(file), SystemTime::now()).map_err(|error| error.to_string())
        });
        match writer {
            Ok(writer) => Some(Hlog {
                path: path.to_owned(),
                writer: Some(writer),
                interval: PathHistograms::new(),
                started: Instant::now(),
                since: Instant::now(),
            }),
            Err(error) => {
                warn!("no latency log: cannot write {}: {error}", path.display());
                None
            }
        }
    }

    fn write_if_due(&mut self, at_once: bool) {
        if !at_once && self.since.elapsed() < HLOG_INTERVAL {
            return;
        }
        let Some(writer) = &mut self.writer else { return };
        let since_start = self.since.duration_since(self.started);
        if let Err(error) = writer.write_interval(since_start, self.since.elapsed(), &self.interval) {
            warn!("the latency log ends: cannot write {}: {error}", self.path.display());
            self.writer = None;
        }
        self.since = Instant::now();
        self.interval.start_interval();
    }
}
