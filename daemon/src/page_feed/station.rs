//! Data of the engineer's page in addition to frames: incidents, sensors, latencies, and the filter's parameters.
//!
//! A separate thread joins the bus for it, only while the page is viewed: the frames of the worker's page never wait
//! for it, and an unviewed station has no additional subscriber.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use equipoise_bus::{Bus, BusError, BusSettings, CommandClient, Subscriber, Topic};
use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::state::Phase;
use equipoise_core::message::{AdapterHealth, Command, CycleRecord, Incident, Incidents};
use equipoise_core::time::{NS_PER_S, seconds};
use equipoise_files::read_text;
use equipoise_latency::{PathHistograms, Report};
use equipoise_view::page::{PageCommand, Station};
use serde_json::{Value, json};

use super::history::{History, Parameters};
use super::{Newest, PAGE_ROLE, Place};
use crate::cli::client;
use crate::realtime::now_ns;
use crate::status;

/// Data are gathered for this long after the last request.
const WANTED_FOR_NS: u64 = 5 * NS_PER_S;
/// Polling interval of the bus: a tenth of its deepest buffer at 1 kHz.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Interval between points of the history.
const POINT_EVERY: Duration = Duration::from_millis(500);
/// Interval of checkpoint requests during identification; each costs 32 µs of one cycle.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(1);
/// Timeout of the daemon's reply to the request.
const PATIENCE: Duration = Duration::from_millis(500);
/// The daemon publishes its incidents once a second; an older message does not count as current, ns.
const INCIDENTS_FRESH_NS: u64 = 5 * NS_PER_S / 2;
/// Older states are ignored, ns.
const FRESH_NS: u64 = NS_PER_S / 4;
/// Maximum size of a displayed report, bytes.
const REPORT_BYTES_MAX: u64 = 16 << 20;

/// The data gathered, and access to the daemon.
pub(super) struct Desk {
    station: String,
    report: Option<PathBuf>,
    wanted_ns: AtomicU64,
    gathered: Mutex<Gathered>,
}

#[derive(Default)]
struct Gathered {
    incidents: Option<Incidents>,
    adapters: [Option<AdapterHealth>; 2],
    latency: Option<Report>,
    history: History,
}

impl Desk {
    pub(super) fn new(station: &str, report: Option<PathBuf>) -> Desk {
        Desk { station: station.to_owned(), report, wanted_ns: AtomicU64::new(0), gathered: Mutex::default() }
    }

    fn gathered(&self) -> MutexGuard<'_, Gathered> {
        self.gathered.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_wanted(&self) -> bool {
        let wanted_ns = self.wanted_ns.load(Ordering::Relaxed);
        wanted_ns != 0 && now_ns().saturating_sub(wanted_ns) < WANTED_FOR_NS
    }
}

impl Station for Desk {
    fn facts(&self) -> String {
        self.wanted_ns.store(now_ns(), Ordering::Relaxed);
        let facts = status::read(&self.station);
        let gathered = self.gathered();
        let sentence = |name: &str| facts.as_ref().and_then(|facts| facts.incidents.get(name));
        let is_current = |time_ns: u64| now_ns().saturating_sub(time_ns) < INCIDENTS_FRESH_NS;
        let incidents = gathered.incidents.as_ref().filter(|all| is_current(all.time_ns)).map(|all| {
            let begun = Incident::ALL.iter().filter(|kind| all.begun[**kind as usize] > 0);
            begun.map(|kind| incident(all, *kind, sentence(kind.name()))).collect::<Vec<_>>()
        });
        json!({
            "station": self.station,
            "daemon": facts.as_ref().filter(|_| incidents.is_some()).map(|facts| json!({
                "version": facts.version, "process_id": facts.process_id, "subject": facts.subject,
                "model_suspicion": facts.model_suspicion, "loop_faults": facts.loop_faults,
            })),
            "incidents": incidents,
            "adapters": gathered.adapters.iter().flatten().map(adapter).collect::<Vec<_>>(),
            "latency": gathered.latency,
            "parameters": gathered.history.newest_parameters(),
            "report": self.report.as_ref().is_some_and(|path| path.is_file()),
        })
        .to_string()
    }

    fn history(&self) -> String {
        self.gathered().history.to_json().to_string()
    }

    fn report(&self) -> Option<String> {
        read_text(self.report.as_ref()?, REPORT_BYTES_MAX).ok()
    }

    fn command(&self, command: &PageCommand) -> Result<String, String> {
        let (kind, subject) = match command {
            PageCommand::IdentifyStart => (CommandKind::IdentifyStart, ""),
            PageCommand::IdentifyStop => (CommandKind::IdentifyStop, ""),
            PageCommand::IdentifyReset => (CommandKind::IdentifyReset, ""),
            PageCommand::PoseSkip => (CommandKind::PoseSkip, ""),
            PageCommand::Tare => (CommandKind::Tare, ""),
            PageCommand::SubjectLoad(id) => (CommandKind::SubjectLoad, id.as_str()),
        };
        client::ask(&self.station, kind, subject).map_err(|error| format!("{error:#}"))
    }
}

fn incident(all: &Incidents, kind: Incident, what: Option<&String>) -> Value {
    let (now_ns, place) = (now_ns(), kind as usize);
    let since_s = |then_ns: u64| seconds(now_ns.saturating_sub(then_ns));
    let active = all.active().any(|active| active == kind);
    json!({
        "name": kind.name(), "active": active, "begun": all.begun[place], "what": what,
        "for_s": active.then(|| since_s(all.last_begun_ns[place])),
        "ended_s_ago": (!active).then(|| since_s(all.last_ended_ns[place])),
    })
}

fn adapter(health: &AdapterHealth) -> Value {
    json!({
        "stream": if health.stream == 1 { "suit" } else { "ground" },
        "rate_hz": health.rate_hz, "received": health.received, "published": health.published, "lost": health.lost,
        "refused": health.refused.iter().sum::<u64>(), "age_s": seconds(now_ns().saturating_sub(health.time_ns)),
    })
}

/// Starts the gathering thread; it ends when `newest` is dropped.
pub(super) fn gather(desk: Arc<Desk>, newest: Weak<Newest>) -> std::io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name("page-station".into()).spawn(move || {
        let mut eyes: Option<Eyes> = None;
        let mut kept = Instant::now();
        while let Some(newest) = newest.upgrade() {
            let state = newest.lock().ok().and_then(|newest| *newest);
            let state = state.filter(|state| now_ns().saturating_sub(state.time_ns) < FRESH_NS);
            drop(newest);
            if kept.elapsed() >= POINT_EVERY {
                kept = Instant::now();
                if let Some(state) = &state {
                    desk.gathered().history.keep(state);
                }
            }
            let learning = state.is_some_and(|state| state.phase == Phase::Identifying as u32);
            if !desk.is_wanted() {
                close(&mut eyes);
            } else if let Some(open) = &mut eyes {
                if !matches!(open.look(&desk, learning), Ok(true)) {
                    close(&mut eyes);
                }
            } else {
                eyes = Eyes::open(&desk.station).ok();
            }
            std::thread::sleep(LOOK_EVERY);
        }
    })
}

fn close(eyes: &mut Option<Eyes>) {
    if let Some(mut eyes) = eyes.take()
        && eyes.place.is_another_now()
    {
        // Dropping the old ports would remove files of the new bus that have the same names, so leak them.
        std::mem::forget(eyes);
    }
}

/// All subscribers; ports are declared before the node, which must be dropped last.
struct Eyes {
    incidents: Subscriber<Incidents>,
    health: Subscriber<AdapterHealth>,
    cycles: Subscriber<CycleRecord>,
    checkpoints: Subscriber<Checkpoint>,
    client: CommandClient,
    path: Box<PathHistograms>,
    since_ns: u64,
    asked: Option<Instant>,
    place: Place,
    _bus: Bus,
}

impl Eyes {
    fn open(station: &str) -> Result<Eyes, BusError> {
        let settings = BusSettings::new(station, PAGE_ROLE);
        let bus = Bus::join(&settings)?;
        Ok(Eyes {
            incidents: bus.subscriber(1)?,
            health: bus.subscriber(8)?,
            cycles: bus.subscriber(CycleRecord::SERVICE.depth_max)?,
            checkpoints: bus.subscriber(1)?,
            client: bus.command_client()?,
            path: Box::new(PathHistograms::new()),
            since_ns: now_ns(),
            asked: None,
            place: Place::of(&settings.root),
            _bus: bus,
        })
    }

    /// Ingests all pending messages; returns `false` if the bus was replaced.
    fn look(&mut self, desk: &Desk, learning: bool) -> Result<bool, BusError> {
        if self.place.is_another() {
            return Ok(false);
        }
        let incidents = self.incidents.latest()?;
        let mut adapters = Vec::new();
        while let Some(health) = self.health.receive()? {
            adapters.push(health);
        }
        while let Some(record) = self.cycles.receive()? {
            // Ignore records published before the subscription: their waiting time is not a latency.
            if record.publish_start_ns >= self.since_ns {
                self.path.record(&record);
            }
        }
        let parameters = self
            .checkpoints
            .receive_with(|checkpoint| Parameters::of(checkpoint, seconds(now_ns())))?
            .flatten();
        let mut gathered = desk.gathered();
        gathered.incidents = incidents.or(gathered.incidents);
        for health in adapters {
            gathered.adapters[usize::from(health.stream != 1)] = Some(health);
        }
        gathered.latency = Some(Report::of(&self.path));
        if let Some(parameters) = parameters {
            gathered.history.keep_parameters(parameters);
        }
        drop(gathered);
        if learning && self.asked.is_none_or(|asked| asked.elapsed() >= CHECKPOINT_EVERY) {
            self.asked = Some(Instant::now());
            let command = Command { kind: CommandKind::Checkpoint as u32, ..Command::zeroed() };
            // A failed request needs no report: missing frames reveal a daemon that does not answer.
            let _ = self.client.ask(&command, PATIENCE);
        }
        Ok(true)
    }
}
