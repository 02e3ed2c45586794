//! Feeds the metrics: a consumer of the bus that stores the newest message of each kind and counts levels.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

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

/// Polling interval of the bus.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
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
    let mut feed = Feed::open(station)?;
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
    states: Subscriber<State>,
    cycles: Subscriber<CycleRecord>,
    health: Subscriber<AdapterHealth>,
    incidents: Subscriber<Incidents>,
    snapshot: Snapshot,
    // Ports must be dropped before the node that they depend on.
    _bus: Bus,
}

impl Feed {
    fn open(station: &str) -> Result<Feed, BusError> {
        let bus = Bus::join(&BusSettings::new(station, METRICS_ROLE))?;
        let stream = |name, reasons| Stream { name, health: None, reasons };
        let snapshot = Snapshot {
            now_ns: now_ns(),
            station: station.to_owned(),
            version: env!("CARGO_PKG_VERSION"),
            state: None,
            record: None,
            streams: [stream("suit", SuitRefusal::NAMES), stream("ground", GroundRefusal::NAMES)],
            incidents: None,
            joint_cycles: [[0; _]; JOINTS],
        };
        Ok(Feed {
            states: bus.subscriber(STATES)?,
            cycles: bus.subscriber(1)?,
            health: bus.subscriber(8)?,
            incidents: bus.subscriber(1)?,
            snapshot,
            _bus: bus,
        })
    }

    fn update(&mut self) -> Result<(), BusError> {
        let snapshot = &mut self.snapshot;
        while let Some(state) = self.states.receive()? {
            for (levels, level) in snapshot.joint_cycles.iter_mut().zip(state.joint_level) {
                if let Some(count) = levels.get_mut(level as usize) {
                    *count += 1;
                }
            }
            snapshot.state = Some(state);
        }
        snapshot.record = self.cycles.latest()?.or(snapshot.record);
        snapshot.incidents = self.incidents.latest()?.or(snapshot.incidents);
        while let Some(health) = self.health.receive()? {
            if let Some(stream) = snapshot.streams.get_mut((health.stream as usize).wrapping_sub(1)) {
                stream.health = Some(health);
            }
        }
        Ok(())
    }
}
