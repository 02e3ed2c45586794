//! Feeds the metrics: a consumer of the bus that stores the newest message of each kind and counts levels.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::Context;
use crossbeam_channel::Sender;
use equipoise_adapters::ground::GroundRefusal;
use equipoise_adapters::suit::SuitRefusal;
use equipoise_bus::{Bus, BusError, BusSettings, Subscriber};
use equipoise_core::body::JOINTS;
use equipoise_core::message::{AdapterHealth, CycleRecord, Incidents, State};
use equipoise_daemon::realtime::now_ns;
use equipoise_view::metrics::{Metrics, Snapshot, Stream};
use rustix::process::setpriority_process;
use tracing::warn;

use crate::page_feed::BusWatch;

/// Polling interval of the bus.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Interval between attempts to join a replaced bus.
const REJOIN_INTERVAL: Duration = Duration::from_secs(1);
/// Depth of several polling intervals at the highest rate, so that every state is counted.
const STATES: usize = 1024;
/// Nice value of both threads: any other work has priority.
const NICE: i32 = 10;

/// Serves until stopped; sends the listening address through `ready`.
///
/// # Errors
/// The port is taken or the bus cannot be joined; later, the bus fails.
pub fn run(
    station: &str,
    listen: SocketAddr,
    ready: &Sender<SocketAddr>,
    stopping: &dyn Fn() -> bool,
) -> anyhow::Result<()> {
    // On Linux this affects only this thread and the server's thread, which it starts. A refusal has little effect.
    let _ = setpriority_process(None, NICE);
    let mut feed = Feed::open(BusSettings::new(station, METRICS_ROLE))?;
    let shared = Arc::new(Mutex::new(feed.snapshot.clone()));
    let served = Arc::clone(&shared);
    let metrics = Metrics::start(listen, move || {
        let snapshot = served.lock().unwrap_or_else(PoisonError::into_inner).clone();
        Snapshot { now_ns: now_ns(), ..snapshot }
    })
    .context("metrics.listen")?;
    let _ = ready.send(metrics.address());
    while !stopping() {
        feed.update()?;
        shared.lock().unwrap_or_else(PoisonError::into_inner).clone_from(&feed.snapshot);
        std::thread::sleep(POLL_INTERVAL);
    }
    Ok(())
}

/// The role under which the metrics are found on the bus.
pub const METRICS_ROLE: &str = "metrics";

struct Feed {
    settings: BusSettings,
    /// `None` while a replaced bus cannot be joined.
    ports: Option<Ports>,
    joined: Instant,
    snapshot: Snapshot,
}

struct Ports {
    states: Subscriber<State>,
    cycles: Subscriber<CycleRecord>,
    health: Subscriber<AdapterHealth>,
    incidents: Subscriber<Incidents>,
    bus_watch: BusWatch,
    // Ports must be dropped before the node that they depend on.
    _bus: Bus,
}

impl Ports {
    fn open(settings: &BusSettings) -> Result<Ports, BusError> {
        let bus = Bus::join(settings)?;
        Ok(Ports {
            states: bus.subscriber(STATES)?,
            cycles: bus.subscriber(1)?,
            health: bus.subscriber(8)?,
            incidents: bus.subscriber(1)?,
            bus_watch: BusWatch::of(&settings.root),
            _bus: bus,
        })
    }
}

impl Feed {
    fn open(settings: BusSettings) -> Result<Feed, BusError> {
        let ports = Some(Ports::open(&settings)?);
        let stream = |name, reasons| Stream { name, health: None, reasons };
        let snapshot = Snapshot {
            now_ns: now_ns(),
            station: settings.station.clone(),
            version: env!("CARGO_PKG_VERSION"),
            state: None,
            record: None,
            streams: [stream("suit", SuitRefusal::NAMES), stream("ground", GroundRefusal::NAMES)],
            incidents: None,
            joint_cycles: [[0; _]; JOINTS],
        };
        Ok(Feed { settings, ports, joined: Instant::now(), snapshot })
    }

    /// Rejoins the bus if its directory was replaced, because the old ports do not receive from the new bus.
    fn rejoin_if_replaced(&mut self) {
        if let Some(ports) = self.ports.take_if(|ports| ports.bus_watch.is_replaced()) {
            // Dropping the old ports would remove files of the new bus that have the same names, so leak them.
            std::mem::forget(ports);
        }
        if self.ports.is_none() && self.joined.elapsed() >= REJOIN_INTERVAL {
            self.joined = Instant::now();
            let ports = Ports::open(&self.settings);
            self.ports = ports
                .inspect_err(|error| warn!("metrics: cannot rejoin the bus, retrying every second: {error}"))
                .ok();
        }
    }

    fn update(&mut self) -> Result<(), BusError> {
        self.rejoin_if_replaced();
        let (Some(ports), snapshot) = (&mut self.ports, &mut self.snapshot) else { return Ok(()) };
        while let Some(state) = ports.states.receive()? {
            for (levels, level) in snapshot.joint_cycles.iter_mut().zip(state.joint_level) {
                if let Some(count) = levels.get_mut(level as usize) {
                    *count += 1;
                }
            }
            snapshot.state = Some(state);
        }
        snapshot.record = ports.cycles.latest()?.or(snapshot.record);
        snapshot.incidents = ports.incidents.latest()?.or(snapshot.incidents);
        while let Some(health) = ports.health.receive()? {
            if let Some(stream) = snapshot.streams.get_mut((health.stream as usize).wrapping_sub(1)) {
                stream.health = Some(health);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn metrics_join_a_bus_whose_directory_was_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("bus");
        let settings = |role| BusSettings { root: root.clone(), ..BusSettings::new("metrics-test", role) };
        let mut feed = Feed::open(settings(METRICS_ROLE)).unwrap();
        std::fs::rename(&root, folder.path().join("old")).unwrap();
        let bus = Bus::join(&settings("daemon")).unwrap();
        let states = bus.publisher::<State>().unwrap();
        let begun = Instant::now();
        while feed.snapshot.state.is_none() {
            assert!(begun.elapsed() < Duration::from_secs(20), "no state of the new bus");
            states.send(&State { time_ns: now_ns(), ..State::zeroed() }).unwrap();
            feed.update().unwrap();
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}
