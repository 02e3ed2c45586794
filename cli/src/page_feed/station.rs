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
use equipoise_daemon::realtime::now_ns;
use equipoise_files::read_text;
use equipoise_latency::{PathHistograms, Report};
use equipoise_station::state_directory::StateDirectory;
use equipoise_station::status;
use equipoise_view::page::{PageCommand, Station};
use serde_json::{Value, json};

use super::frame_configuration::ConfigurationWatch;
use super::history::{History, Parameters};
use super::{BusWatch, FRESH_NS, Newest, PAGE_ROLE, SharedFrameConfiguration, is_current};
use crate::client;

/// Data are gathered for this long after the last request.
const REQUEST_VALID_NS: u64 = 5 * NS_PER_S;
/// Polling interval of the bus: a tenth of its deepest buffer at 1 kHz.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Interval between points of the history.
const POINT_INTERVAL: Duration = Duration::from_millis(500);
/// Interval of checkpoint requests during identification; each costs 32 µs of one cycle.
const CHECKPOINT_INTERVAL: Duration = Duration::from_secs(1);
/// Timeout of the daemon's reply to the request.
const TIMEOUT: Duration = Duration::from_millis(500);
/// The daemon publishes its incidents once a second; an older message does not count as current, ns.
const INCIDENTS_FRESH_NS: u64 = 5 * NS_PER_S / 2;
/// Interval at which the daemon's active configuration is read.
const STATUS_INTERVAL: Duration = Duration::from_secs(1);
/// Maximum size of a displayed report, bytes.
const REPORT_BYTES_MAX: u64 = 16 << 20;

/// The data gathered, and access to the daemon.
pub(super) struct StationData {
    station: String,
    report: Option<PathBuf>,
    requested_ns: AtomicU64,
    collected: Mutex<Collected>,
}

#[derive(Default)]
struct Collected {
    incidents: Option<Incidents>,
    adapters: [Option<AdapterHealth>; 2],
    /// With the time over which it was measured, s.
    latency: Option<(Report, f64)>,
    history: History,
}

impl StationData {
    pub(super) fn new(station: &str, report: Option<PathBuf>) -> StationData {
        StationData {
            station: station.to_owned(),
            report,
            requested_ns: AtomicU64::new(0),
            collected: Mutex::default(),
        }
    }

    fn collected(&self) -> MutexGuard<'_, Collected> {
        self.collected.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_requested(&self) -> bool {
        let requested_ns = self.requested_ns.load(Ordering::Relaxed);
        requested_ns != 0 && now_ns().saturating_sub(requested_ns) < REQUEST_VALID_NS
    }
}

impl Station for StationData {
    fn facts(&self) -> String {
        self.requested_ns.store(now_ns(), Ordering::Relaxed);
        let facts = status::read(&self.station);
        let collected = self.collected();
        let message = |name: &str| facts.as_ref().and_then(|facts| facts.incidents.get(name));
        let current = |all: &&Incidents| is_current(all.time_ns, now_ns(), INCIDENTS_FRESH_NS);
        let incidents = collected.incidents.as_ref().filter(current).map(|all| {
            let begun = Incident::ALL.iter().filter(|kind| all.begun[**kind as usize] > 0);
            begun.map(|kind| incident(all, *kind, message(kind.name()))).collect::<Vec<_>>()
        });
        json!({
            "station": self.station,
            "daemon": facts.as_ref().filter(|_| incidents.is_some()).map(|facts| json!({
                "version": facts.version, "process_id": facts.process_id, "subject": facts.subject,
                "model_mismatch": facts.model_mismatch, "loop_faults": facts.loop_faults,
            })),
            "incidents": incidents,
            "adapters": collected.adapters.iter().flatten().map(adapter).collect::<Vec<_>>(),
            "latency": collected.latency.as_ref().map(|(report, _)| report),
            "latency_span_s": collected.latency.as_ref().map(|(_, span_s)| span_s),
            "parameters": collected.history.newest_parameters(),
            "report": self.report.as_ref().is_some_and(|path| path.is_file()),
        })
        .to_string()
    }

    fn history(&self) -> String {
        self.collected().history.to_json().to_string()
    }

    fn report(&self) -> Option<String> {
        read_text(self.report.as_ref()?, REPORT_BYTES_MAX).ok()
    }

    fn subjects(&self) -> Result<Vec<String>, String> {
        let directory = StateDirectory::of_station(&self.station).map_err(|error| error.to_string())?;
        let files = directory.profile_files().map_err(|error| {
            let folder = directory.profiles();
            format!(
                "Cannot list the stored workers in {}: {error}. Enter the id of a worker.",
                folder.display()
            )
        })?;
        let id = |path: &PathBuf| Some(path.file_stem()?.to_str()?.to_owned());
        let mut ids: Vec<String> = files.iter().filter_map(id).collect();
        ids.sort();
        Ok(ids)
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
        client::request(&self.station, kind, subject).map_err(|error| format!("{error:#}"))
    }
}

fn incident(all: &Incidents, kind: Incident, what: Option<&String>) -> Value {
    let (now_ns, index) = (now_ns(), kind as usize);
    let since_s = |then_ns: u64| seconds(now_ns.saturating_sub(then_ns));
    let active = all.active().any(|active| active == kind);
    json!({
        "name": kind.name(), "active": active, "count": all.begun[index], "message": what,
        "duration_s": active.then(|| since_s(all.last_begun_ns[index])),
        "ended_ago_s": (!active).then(|| since_s(all.last_ended_ns[index])),
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
pub(super) fn start_collecting(
    station_data: Arc<StationData>,
    newest: Weak<Newest>,
    frame_configuration: Arc<SharedFrameConfiguration>,
) -> std::io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name("page-station".into()).spawn(move || {
        let mut subscriptions: Option<Subscriptions> = None;
        let mut point_time = Instant::now();
        let (mut watch, mut status_read) = (ConfigurationWatch::default(), None::<Instant>);
        while let Some(newest) = newest.upgrade() {
            let state = newest.lock().ok().and_then(|newest| *newest);
            let state = state.filter(|state| is_current(state.time_ns, now_ns(), FRESH_NS));
            drop(newest);
            if status_read.is_none_or(|status_read| status_read.elapsed() >= STATUS_INTERVAL) {
                status_read = Some(Instant::now());
                if let Some(facts) = status::read(&station_data.station) {
                    station_data.collected().history.set_subject(&facts.subject);
                    if let Some(changed) = watch.changed(facts) {
                        *frame_configuration.lock().unwrap_or_else(PoisonError::into_inner) = changed;
                    }
                }
            }
            if point_time.elapsed() >= POINT_INTERVAL {
                point_time = Instant::now();
                if let Some(state) = &state {
                    station_data.collected().history.push(state);
                }
            }
            let identifying = state.is_some_and(|state| state.phase == Phase::Identifying as u32);
            if !station_data.is_requested() {
                close(&mut subscriptions, &station_data);
            } else if let Some(open) = &mut subscriptions {
                if !matches!(open.update(&station_data, identifying), Ok(true)) {
                    close(&mut subscriptions, &station_data);
                }
            } else {
                subscriptions = Subscriptions::open(&station_data.station).ok();
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    })
}

fn close(subscriptions: &mut Option<Subscriptions>, station_data: &StationData) {
    let Some(mut subscriptions) = subscriptions.take() else { return };
    // It ends with the subscription.
    station_data.collected().latency = None;
    if subscriptions.bus_watch.is_replaced_now() {
        // Dropping the old ports would remove files of the new bus that have the same names, so leak them.
        std::mem::forget(subscriptions);
    }
}

/// All subscribers; ports are declared before the node, which must be dropped last.
struct Subscriptions {
    incidents: Subscriber<Incidents>,
    health: Subscriber<AdapterHealth>,
    cycles: Subscriber<CycleRecord>,
    checkpoints: Subscriber<Checkpoint>,
    client: CommandClient,
    path: Box<PathHistograms>,
    since_ns: u64,
    checkpoint_requested: Option<Instant>,
    bus_watch: BusWatch,
    _bus: Bus,
}

impl Subscriptions {
    fn open(station: &str) -> Result<Subscriptions, BusError> {
        let settings = BusSettings::new(station, PAGE_ROLE);
        let bus = Bus::join(&settings)?;
        Ok(Subscriptions {
            incidents: bus.subscriber(1)?,
            health: bus.subscriber(8)?,
            cycles: bus.subscriber(CycleRecord::SERVICE.depth_max)?,
            checkpoints: bus.subscriber(1)?,
            client: bus.command_client()?,
            path: Box::new(PathHistograms::new()),
            since_ns: now_ns(),
            checkpoint_requested: None,
            bus_watch: BusWatch::of(&settings.root),
            _bus: bus,
        })
    }

    /// Ingests all pending messages; returns `false` if the bus was replaced.
    fn update(&mut self, station_data: &StationData, identifying: bool) -> Result<bool, BusError> {
        if self.bus_watch.is_replaced() {
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
        let mut collected = station_data.collected();
        collected.incidents = incidents.or(collected.incidents);
        for health in adapters {
            collected.adapters[usize::from(health.stream != 1)] = Some(health);
        }
        let span_s = seconds(now_ns().saturating_sub(self.since_ns));
        collected.latency = Some((Report::of(&self.path), span_s));
        if let Some(parameters) = parameters {
            collected.history.push_parameters(parameters);
        }
        drop(collected);
        if identifying
            && self
                .checkpoint_requested
                .is_none_or(|checkpoint_requested| checkpoint_requested.elapsed() >= CHECKPOINT_INTERVAL)
        {
            self.checkpoint_requested = Some(Instant::now());
            let command = Command { kind: CommandKind::Checkpoint as u32, ..Command::zeroed() };
            // A failed request needs no report: missing frames reveal a daemon that does not answer.
            let _ = self.client.ask(&command, TIMEOUT);
        }
        Ok(true)
    }
}
