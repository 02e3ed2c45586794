//! Subscriptions of the terminal display: the newest message of each service of a station, from any daemon.

use std::time::{Duration, Instant};

use equipoise_bus::{Bus, BusError, BusSettings, Subscriber, Topic};
use equipoise_config::model_file::Ask;
use equipoise_core::message::{AdapterHealth, CycleRecord, Incidents, State};
use equipoise_daemon::realtime::now_ns;
use equipoise_latency::{PathHistograms, Report};
use equipoise_station::bus_directory::BusDirectory;
use equipoise_station::process_state::is_stopped;
use equipoise_station::status;
use equipoise_view::is_current;
use equipoise_view::watch::Sensor;

use super::SILENT_AFTER;
use crate::commands::status::{reasons, refused, requested_pose};

/// Interval at which the bus directory, the daemon's status file and the latency percentiles are checked.
const STATUS_INTERVAL: Duration = Duration::from_secs(1);
/// Adapters publish their health once a second; older messages are not displayed.
const HEALTH_FOR: Duration = Duration::from_secs(3);

/// All subscribers; the node that they depend on is dropped last.
struct Ports {
    states: Subscriber<State>,
    board: Subscriber<Incidents>,
    health: Subscriber<AdapterHealth>,
    /// `None` if no subscriber slot is free: the display works without.
    records: Option<Subscriber<CycleRecord>>,
    _bus: Bus,
    bus_directory: BusDirectory,
}

/// The data received so far.
pub(super) struct Subscriptions {
    settings: BusSettings,
    ports: Option<Ports>,
    state: Option<(State, Instant)>,
    sensors: Vec<(Sensor, Instant)>,
    pub(super) incidents: Option<Incidents>,
    path: PathHistograms,
    /// Ignore cycles before this subscription, ns.
    since_ns: u64,
    pub(super) latency: Option<Report>,
    pub(super) ask: Option<Ask>,
    pub(super) subject: String,
    /// Process id of the daemon while it is stopped.
    pub(super) stopped: Option<u32>,
    status_read: Option<Instant>,
}

impl Subscriptions {
    /// Joins the station's bus; no other process need have joined it yet.
    pub(super) fn open(station: &str) -> Result<Subscriptions, BusError> {
        let settings = BusSettings::new(station, "watch");
        let ports = Some(join(&settings)?);
        Ok(Subscriptions {
            settings,
            ports,
            state: None,
            sensors: Vec::new(),
            incidents: None,
            path: PathHistograms::new(),
            since_ns: now_ns(),
            latency: None,
            ask: None,
            subject: String::new(),
            stopped: None,
            status_read: None,
        })
    }

    /// Ingests new messages. Joins the bus again one second after a failure.
    pub(super) fn update(&mut self) {
        if self.status_read.is_none_or(|status_read| status_read.elapsed() >= STATUS_INTERVAL) {
            self.status_read = Some(Instant::now());
            self.update_status();
        }
        if self.receive().is_err() {
            self.ports = None;
        }
    }

    fn receive(&mut self) -> Result<(), BusError> {
        let Some(ports) = &mut self.ports else { return Ok(()) };
        let is_fresh = |state: &State| is_current(state.time_ns, now_ns(), SILENT_AFTER.as_nanos() as u64);
        if let Some(state) = ports.states.latest()?.filter(is_fresh) {
            self.state = Some((state, Instant::now()));
        }
        self.incidents = ports.board.latest()?.or(self.incidents);
        while let Some(report) = ports.health.receive()? {
            let (name, _) = reasons(&report);
            let refused = refused(&report).collect();
            let sensor = Sensor { name, rate_hz: report.rate_hz, lost: report.lost, refused };
            self.sensors.retain(|(other, _)| other.name != name);
            self.sensors.push((sensor, Instant::now()));
        }
        if let Some(records) = &mut ports.records {
            while let Some(record) = records.receive()? {
                if record.due_ns >= self.since_ns {
                    self.path.record(&record);
                }
            }
        }
        Ok(())
    }

    /// Slower checks: the bus itself, the daemon's status file, percentiles.
    fn update_status(&mut self) {
        if let Some(ports) = self.ports.take_if(|ports| ports.bus_directory.is_replaced()) {
            // Dropping the old ports would remove files of the new bus that have the same names, so leak them.
            std::mem::forget(ports);
        }
        if self.ports.is_none() {
            self.ports = join(&self.settings).ok();
        }
        let facts = status::read(&self.settings.station);
        self.ask = requested_pose(facts.as_ref());
        self.stopped = facts.as_ref().map(|facts| facts.process_id).filter(|process| is_stopped(*process));
        self.subject = facts.map(|facts| facts.subject).unwrap_or_default();
        self.latency = Some(Report::of(&self.path));
        self.sensors.retain(|(_, at)| at.elapsed() < HEALTH_FOR);
    }

    /// The newest state, unless it is stale.
    pub(super) fn state(&self) -> Option<&State> {
        self.state.as_ref().filter(|(_, at)| at.elapsed() < SILENT_AFTER).map(|(state, _)| state)
    }

    /// Time since the last state was received, s.
    pub(super) fn silent_s(&self) -> Option<f64> {
        self.state.as_ref().map(|(_, at)| at.elapsed().as_secs_f64())
    }

    pub(super) fn sensors(&self) -> Vec<Sensor> {
        self.sensors.iter().map(|(sensor, _)| sensor.clone()).collect()
    }
}

fn join(settings: &BusSettings) -> Result<Ports, BusError> {
    let bus = Bus::join(settings)?;
    let records = match bus.subscriber(CycleRecord::SERVICE.depth_max) {
        Ok(records) => Some(records),
        Err(BusError::Full { .. }) => None,
        Err(error) => return Err(error),
    };
    Ok(Ports {
        states: bus.subscriber(1)?,
        board: bus.subscriber(1)?,
        health: bus.subscriber(8)?,
        records,
        bus_directory: BusDirectory::read(&settings.root),
        _bus: bus,
    })
}
