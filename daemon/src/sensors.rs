//! Adapters: from a source's samples to the bus. The same code runs as a thread of the daemon or as its own process.
//!
//! An adapter that fails ends with the reason: the daemon's keeper or systemd starts it again.

use std::time::{Duration, Instant};

use equipoise_adapters::clock::now_monotonic_ns;
use equipoise_adapters::ground::{GroundFrame, Measures, RdtSettings};
use equipoise_adapters::source::{MvnUdpSettings, MvnUdpSource, RdtSource, RdtSourceSettings, SourceError};
use equipoise_adapters::suit::SuitSettings;
use equipoise_bus::{Bus, BusError, BusSettings, Channel, Event, Publisher, Topic};
use equipoise_core::message::{AdapterHealth, GroundSample, SuitSample};

use crate::config::sensors::Measures as MeasuresConfig;
use crate::config::{Config, GroundConfig, SuitConfig};
use crate::realtime::Asked;

/// How often an adapter says how it fares.
const HEALTH_INTERVAL: Duration = Duration::from_secs(1);
/// The roles under which adapters are found on the bus.
pub const SUIT_ROLE: &str = "suit";
/// As [`SUIT_ROLE`].
pub const GROUND_ROLE: &str = "ground";
/// SCHED_FIFO priority of an adapter, below the loop, above ingress, which has nothing to do before it.
const BELOW_LOOP: u32 = 5;

/// What an adapter's thread asks for, inside the daemon or as a process of its own.
pub fn asked(config: &Config) -> Asked {
    Asked { fifo_priority: config.tick.priority.saturating_sub(BELOW_LOOP), cpu: None }
}

/// Why an adapter cannot run at all.
#[derive(Debug, thiserror::Error)]
pub enum AdapterError {
    /// The source.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The bus.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// Somebody else says the same thing.
    #[error(
        "the {stream} of station {station} is published by process {process} already; two would contradict each other: \
         stop that one, or let this one be for another `station` (a daemon beside `equipoise adapter {stream}` says \
         {stream}.source = \"external\")"
    )]
    Taken {
        /// `suit` or `ground`.
        stream: &'static str,
        /// The station.
        station: String,
        /// Who publishes.
        process: u32,
    },
}

/// The one publisher of a stream, while nobody else who lives is it; a dead one's place is taken at once.
fn only_publisher<M: Topic>(bus: &Bus, stream: &'static str) -> Result<Publisher<M>, AdapterError> {
    let refused = match bus.publisher() {
        Ok(publisher) => return Ok(publisher),
        Err(refused) => refused,
    };
    if !matches!(refused, BusError::Full { .. }) {
        return Err(refused.into());
    }
    let own = std::process::id();
    let there = bus.participants()?.into_iter().find(|one| one.role == stream && one.process_id != own);
    Err(match there {
        Some(other) => {
            AdapterError::Taken { stream, station: bus.station().to_owned(), process: other.process_id }
        }
        None => refused.into(),
    })
}

/// Runs the suit's adapter until `stopping` says so; `ready` is called once it listens.
///
/// # Errors
/// The port is taken, another living process publishes the suit, the socket fails, or the bus does.
pub fn run_suit(
    station: &str,
    config: &SuitConfig,
    ready: &mut dyn FnMut(),
    stopping: &dyn Fn() -> bool,
) -> Result<(), AdapterError> {
    let settings = MvnUdpSettings {
        listen: config.listen,
        allow_remote: config.allow_remote,
        suit: suit_settings(config),
        ..MvnUdpSettings::default()
    };
    let bus = Bus::join(&BusSettings::new(station, SUIT_ROLE))?;
    let samples = only_publisher::<SuitSample>(&bus, SUIT_ROLE)?;
    let wake = bus.notifier(Channel::Inputs)?;
    let mut health = Health::new(&bus)?;
    let mut source = MvnUdpSource::open(settings)?;
    ready();
    while !stopping() {
        if let Some(mut sample) = source.receive()? {
            sample.published_ns = now_monotonic_ns();
            samples.send(&sample)?;
            wake.notify(Event::NewSuit)?;
        }
        health.tell_if_due(|| source.health())?;
    }
    Ok(())
}

/// Runs the ground's adapter until `stopping` says so; `ready` is called once the device was asked to stream.
///
/// A silent device is asked again and again.
///
/// # Errors
/// No socket can be had, another living process publishes the ground, the socket fails, or the bus does.
pub fn run_ground(
    station: &str,
    config: &GroundConfig,
    ready: &mut dyn FnMut(),
    stopping: &dyn Fn() -> bool,
) -> Result<(), AdapterError> {
    let settings = RdtSourceSettings {
        address: config.address,
        rdt: rdt_settings(config),
        ..RdtSourceSettings::default()
    };
    let bus = Bus::join(&BusSettings::new(station, GROUND_ROLE))?;
    let publisher = only_publisher::<GroundSample>(&bus, GROUND_ROLE)?;
    let wake = bus.notifier(Channel::Inputs)?;
    let mut health = Health::new(&bus)?;
    let mut source = RdtSource::open(settings)?;
    ready();
    let mut samples = Vec::with_capacity(64);
    while !stopping() {
        samples.clear();
        source.receive(&mut samples)?;
        for sample in &mut samples {
            sample.published_ns = now_monotonic_ns();
            publisher.send(sample)?;
        }
        if !samples.is_empty() {
            wake.notify(Event::NewGround)?;
        }
        health.tell_if_due(|| source.health())?;
    }
    Ok(())
}

/// The character and its constant delay, as configured.
pub fn suit_settings(config: &SuitConfig) -> SuitSettings {
    SuitSettings { avatar: config.avatar, latency_ns: config.latency_ns(), ..SuitSettings::default() }
}

/// Scale, sign, place and constant delay of the plate, as configured.
pub fn rdt_settings(config: &GroundConfig) -> RdtSettings {
    let default = RdtSettings::default();
    RdtSettings {
        counts_per_newton: config.counts_per_newton.unwrap_or(default.counts_per_newton),
        counts_per_newton_metre: config.counts_per_newton_metre.unwrap_or(default.counts_per_newton_metre),
        measures: match config.measures {
            MeasuresConfig::Action => Measures::Action,
            MeasuresConfig::Reaction => Measures::Reaction,
        },
        frame: GroundFrame {
            origin_m: config.frame.origin_m,
            yaw_rad: config.frame.yaw_deg.to_radians(),
            surface_height_m: config.frame.surface_height_m,
        },
        latency_ns: config.latency_ns(),
    }
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

    fn tell_if_due(&mut self, health: impl FnOnce() -> AdapterHealth) -> Result<(), BusError> {
        if self.last.elapsed() >= HEALTH_INTERVAL {
            self.last = Instant::now();
            self.publisher.send(&health())?;
        }
        Ok(())
    }
}
