//! What the screen sees of a station: the newest of everything, whichever daemon tells it.

use std::time::{Duration, Instant};

use equipoise_bus::{Bus, BusError, BusSettings, Subscriber, Topic};
use equipoise_core::message::{AdapterHealth, CycleRecord, Incidents, State};
use equipoise_discrepancy::finding::Ask;
use equipoise_latency::{PathHistograms, Report};
use equipoise_view::watch::Sensor;

use super::SILENT_AFTER;
use crate::cli::status::{asked, reasons, refused};
use crate::joined::Joined;
use crate::process_state::is_stopped;
use crate::realtime::now_ns;
use crate::status;

/// How often it is looked whether the bus is still the one that was joined, what the daemon says of itself, and how late
/// the path was.
const LOOK_AROUND_EVERY: Duration = Duration::from_secs(1);
/// An adapter tells once a second how it fares; what is older is not shown.
const HEALTH_FOR: Duration = Duration::from_secs(3);

/// Everything subscribed; the node that they hang on comes last.
struct Ports {
    states: Subscriber<State>,
    board: Subscriber<Incidents>,
    health: Subscriber<AdapterHealth>,
    /// `None` where every place is taken: the rest is worth watching without.
    records: Option<Subscriber<CycleRecord>>,
    _bus: Bus,
    joined: Joined,
}

/// What was seen so far.
pub(super) struct Eyes {
    settings: BusSettings,
    ports: Option<Ports>,
    state: Option<(State, Instant)>,
    sensors: Vec<(Sensor, Instant)>,
    pub(super) incidents: Option<Incidents>,
    path: PathHistograms,
    /// Cycles before it waited for this consumer, ns.
    since_ns: u64,
    pub(super) latency: Option<Report>,
    pub(super) ask: Option<Ask>,
    pub(super) subject: String,
    /// The daemon's process, while it is stopped.
    pub(super) stopped: Option<u32>,
    looked: Option<Instant>,
}

impl Eyes {
    /// Joins the station's bus, on which there need not be anybody yet.
    pub(super) fn open(station: &str) -> Result<Eyes, BusError> {
        let settings = BusSettings::new(station, "watch");
        let ports = Some(join(&settings)?);
        Ok(Eyes {
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
            looked: None,
        })
    }

    /// Takes in what is new. A bus that breaks is joined anew a second later.
    pub(super) fn look(&mut self) {
        if self.looked.is_none_or(|looked| looked.elapsed() >= LOOK_AROUND_EVERY) {
            self.looked = Some(Instant::now());
            self.look_around();
        }
        if self.take().is_err() {
            self.ports = None;
        }
    }

    fn take(&mut self) -> Result<(), BusError> {
        let Some(ports) = &mut self.ports else { return Ok(()) };
        if let Some(state) = ports.states.latest()? {
            self.state = Some((state, Instant::now()));
        }
        self.incidents = ports.board.latest()?.or(self.incidents);
        while let Some(told) = ports.health.receive()? {
            let (name, _) = reasons(&told);
            let refused = refused(&told).collect();
            let sensor = Sensor { name, rate_hz: told.rate_hz, lost: told.lost, refused };
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

    /// The slower things: the bus itself, the daemon's file, percentiles.
    fn look_around(&mut self) {
        if let Some(ports) = self.ports.take_if(|ports| ports.joined.is_cut_off()) {
            // To leave would take away what the next bus has under the same names: the old ports are let go of.
            std::mem::forget(ports);
        }
        if self.ports.is_none() {
            self.ports = join(&self.settings).ok();
        }
        let facts = status::read(&self.settings.station);
        self.ask = asked(facts.as_ref());
        self.stopped = facts.as_ref().map(|facts| facts.process_id).filter(|process| is_stopped(*process));
        self.subject = facts.map(|facts| facts.subject).unwrap_or_default();
        self.latency = Some(Report::of(&self.path));
        self.sensors.retain(|(_, at)| at.elapsed() < HEALTH_FOR);
    }

    /// The newest state, unless it is old.
    pub(super) fn state(&self) -> Option<&State> {
        self.state.as_ref().filter(|(_, at)| at.elapsed() < SILENT_AFTER).map(|(state, _)| state)
    }

    /// How long ago the last state came, s.
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
        joined: Joined::now(&settings.root),
        _bus: bus,
    })
}
