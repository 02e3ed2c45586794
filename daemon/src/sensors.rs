//! Adapters: publish the samples of a source on the bus, as a thread of the daemon or as a separate process.
//!
//! An adapter that fails returns the reason: the daemon or systemd restarts it.

mod body_publisher;
mod forwarding;

use std::time::{Duration, Instant};

use equipoise_adapters::clock::now_monotonic_ns;
use equipoise_adapters::ground::GroundSettings;
use equipoise_adapters::source::{FusedSource, GroundSource, SourceError, SuitSource};
use equipoise_bus::{Bus, BusError, BusSettings, Channel, Event, Publisher, Topic};
use equipoise_config::ground::second::{error_of_second, in_second};
use equipoise_config::{Config, GroundConfig, SuitConfig};
use equipoise_core::message::{AdapterHealth, GroundSample, SuitSample};

use self::body_publisher::BodyPublisher;
use self::forwarding::Forwarders;
use crate::realtime::RequestedScheduling;

/// Publication interval of an adapter's health.
const HEALTH_INTERVAL: Duration = Duration::from_secs(1);
/// Minimum interval between log lines with a device's description of itself, so that one that changes with every sample
/// does not fill the disk.
const NOTE_INTERVAL: Duration = Duration::from_secs(10);
/// Role of the suit's adapter on the bus.
pub const SUIT_ROLE: &str = "suit";
/// Role of the ground's adapter on the bus.
pub const GROUND_ROLE: &str = "ground";
/// Distance of an adapter's SCHED_FIFO priority below the loop's; it is above that of ingress, which depends on it.
const BELOW_LOOP: u32 = 5;

/// Scheduling requested by an adapter's thread, inside the daemon or in a separate process.
pub fn requested_scheduling(config: &Config) -> RequestedScheduling {
    RequestedScheduling { fifo_priority: config.tick.priority.saturating_sub(BELOW_LOOP), cpu: None }
}

/// Reasons that prevent an adapter from running.
#[derive(Debug, thiserror::Error)]
pub enum AdapterError {
    /// The source failed.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// Another process publishes the same stream.
    #[error(
        "the {stream} of station {station} is published by process {process} already; two would contradict each other: \
         stop that one, or let this one be for another `station` (a daemon next to `equipoise adapter {stream}` has \
         {stream}.source = \"external\")"
    )]
    AlreadyPublished {
        /// `suit` or `ground`.
        stream: &'static str,
        /// The station.
        station: String,
        /// Id of the publishing process.
        process: u32,
    },
}

/// The only publisher of a stream; fails while another process that is alive publishes it.
fn exclusive_publisher<M: Topic>(bus: &Bus, stream: &'static str) -> Result<Publisher<M>, AdapterError> {
    let refused = match bus.publisher() {
        Ok(publisher) => return Ok(publisher),
        Err(refused) => refused,
    };
    if !matches!(refused, BusError::Full { .. }) {
        return Err(refused.into());
    }
    let own = std::process::id();
    let publisher_process =
        bus.participants()?.into_iter().find(|one| one.role == stream && one.process_id != own);
    Err(match publisher_process {
        Some(other) => AdapterError::AlreadyPublished {
            stream,
            station: bus.station().to_owned(),
            process: other.process_id,
        },
        None => refused.into(),
    })
}

/// Runs the suit's adapter until `stopping` returns true; `ready` is called once it receives.
///
/// # Errors
/// The port is taken, another process publishes the suit, or the socket or the bus fails.
pub fn run_suit(
    station: &str,
    config: &SuitConfig,
    ready: &mut dyn FnMut(),
    stopping: &dyn Fn() -> bool,
) -> Result<(), AdapterError> {
    let bus = Bus::join(&BusSettings::new(station, SUIT_ROLE))?;
    let samples = exclusive_publisher::<SuitSample>(&bus, SUIT_ROLE)?;
    let wake = bus.notifier(Channel::Inputs)?;
    let mut health = Health::new(&bus)?;
    let mut body_publisher = BodyPublisher::new(&bus)?;
    let mut source = SuitSource::open(&config.mvn_settings()?)?;
    let mut forwarders = Forwarders::start(&config.forwarded);
    ready();
    while !stopping() {
        if let Some(mut sample) = source.receive()?.filter(|sample| !forwarders.forward(sample)) {
            // Before the sample, so that the first sample already has its segment lengths.
            body_publisher.publish_if_due(source.body())?;
            sample.published_ns = now_monotonic_ns();
            samples.send(&sample)?;
            wake.notify(Event::NewSuit)?;
        }
        if health.publish_if_due(|| source.health())? {
            // Also while the suit is silent, since subscribers may leave.
            samples.update_connections()?;
            body_publisher.update_connections()?;
            forwarders.publish_health(|avatar| source.health_of(avatar));
            forwarders.publish_bodies(|avatar| source.assembler(avatar)?.body());
        }
    }
    Ok(())
}

/// Runs the ground's adapter until `stopping` returns true; `ready` is called after the first attempt to open the
/// device, and `report_fault` whenever the device's fault changes: a message, or `None` once the fault has ended.
///
/// A device that is off or unplugged is retried indefinitely.
///
/// # Errors
/// Permanent errors: a port that is taken, an invalid configuration, another process that publishes the ground, or the
/// bus.
pub fn run_ground(
    station: &str,
    config: &GroundConfig,
    ready: &mut dyn FnMut(),
    report_fault: &dyn Fn(Option<&str>),
    stopping: &dyn Fn() -> bool,
) -> Result<(), AdapterError> {
    let bus = Bus::join(&BusSettings::new(station, GROUND_ROLE))?;
    let publisher = exclusive_publisher::<GroundSample>(&bus, GROUND_ROLE)?;
    let wake = bus.notifier(Channel::Inputs)?;
    let mut health = Health::new(&bus)?;
    let mut source = Ground::open(config)?;
    ready();
    let mut samples = Vec::with_capacity(64);
    let (mut reported, mut logged) = (None, None);
    let mut logged_at: Option<Instant> = None;
    while !stopping() {
        samples.clear();
        source.receive(&mut samples)?;
        for sample in &mut samples {
            sample.published_ns = now_monotonic_ns();
            publisher.send(sample)?;
        }
        if samples.is_empty() {
            // A subscriber that joins a silent plate receives its last sample.
            publisher.update_connections()?;
        } else {
            wake.notify(Event::NewGround)?;
        }
        let note = source.note();
        if note != logged && logged_at.is_none_or(|at| at.elapsed() >= NOTE_INTERVAL) {
            logged_at = Some(Instant::now());
            if let Some(note) = &note {
                tracing::info!("ground: {note}");
            }
            logged = note;
        }
        let current = source.fault();
        if current != reported {
            report_fault(current.as_deref());
            reported = current;
        }
        health.publish_if_due(|| source.health())?;
    }
    Ok(())
}

/// One device, or two combined.
#[derive(Debug)]
pub enum Ground {
    /// One device.
    One(Box<GroundSource>),
    /// Two devices.
    Two(Box<FusedSource>),
}

impl Ground {
    /// Opens the devices of a configuration section.
    ///
    /// # Errors
    /// The samples come from another process, or this machine lacks a requirement.
    pub fn open(config: &GroundConfig) -> Result<Ground, SourceError> {
        let first = open_device(config, config.settings())?;
        let (Some(second), Some(fusion)) = (config.second.as_deref(), config.fusion()) else {
            return Ok(Ground::One(Box::new(first)));
        };
        let other = open_device(second, second.settings_of_second()).map_err(error_of_second)?;
        let names = [config.own_location(), in_second(&second.own_location())];
        let [name, other_name] = names.map(|place| format!("the device at {place}"));
        Ok(Ground::Two(Box::new(FusedSource::start([(name, first), (other_name, other)], fusion)?)))
    }

    /// As [`GroundSource::receive`].
    ///
    /// # Errors
    /// As there.
    pub fn receive(&mut self, samples: &mut Vec<GroundSample>) -> Result<usize, SourceError> {
        match self {
            Ground::One(source) => source.receive(samples),
            Ground::Two(source) => source.receive(samples),
        }
    }

    /// Current fault of the device, or of either device.
    pub fn fault(&self) -> Option<String> {
        match self {
            Ground::One(source) => source.diagnostic(),
            Ground::Two(source) => source.diagnostic(),
        }
    }

    /// As [`GroundSource::note`].
    pub fn note(&self) -> Option<String> {
        match self {
            Ground::One(source) => source.note(),
            Ground::Two(source) => source.note(),
        }
    }

    /// As [`GroundSource::health`].
    pub fn health(&mut self) -> AdapterHealth {
        match self {
            Ground::One(source) => source.health(),
            Ground::Two(source) => source.health(),
        }
    }
}

fn open_device(config: &GroundConfig, settings: GroundSettings) -> Result<GroundSource, SourceError> {
    let elsewhere =
        || SourceError::Unusable("ground.source is \"external\": another process publishes it".to_owned());
    let transport = config.transport()?.ok_or_else(elsewhere)?;
    let device = config.device()?.ok_or_else(elsewhere)?;
    GroundSource::open(transport, device, settings)
}

/// Publishes an adapter's counts once a second.
struct Health {
    publisher: Publisher<AdapterHealth>,
    last: Instant,
}

impl Health {
    fn new(bus: &Bus) -> Result<Health, BusError> {
        Ok(Health { publisher: bus.publisher()?, last: Instant::now() })
    }

    /// Publishes if due; returns whether it was due. A subscriber that joined receives the last counts at once.
    fn publish_if_due(&mut self, health: impl FnOnce() -> AdapterHealth) -> Result<bool, BusError> {
        let is_due = self.last.elapsed() >= HEALTH_INTERVAL;
        if is_due {
            self.last = Instant::now();
            self.publisher.send(&health())?;
        } else {
            self.publisher.update_connections()?;
        }
        Ok(is_due)
    }
}
