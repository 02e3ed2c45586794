//! Adapters: from a source's samples to the bus. The same code runs as a thread of the daemon or as its own process.

use std::time::{Duration, Instant};

use equipoise_adapters::clock::now_monotonic_ns;
use equipoise_adapters::ground::{GroundFrame, Measures, RdtSettings};
use equipoise_adapters::source::{MvnUdpSettings, MvnUdpSource, RdtSource, RdtSourceSettings, SourceError};
use equipoise_adapters::suit::SuitSettings;
use equipoise_bus::{Bus, BusError, BusSettings, Channel, Event};
use equipoise_core::message::{AdapterHealth, GroundSample};
use tracing::warn;

use crate::config::sensors::Measures as MeasuresConfig;
use crate::config::{GroundConfig, SuitConfig};

/// How often an adapter says how it fares.
const HEALTH_INTERVAL: Duration = Duration::from_secs(1);
/// How long a broken source rests before it is opened anew.
const REST: Duration = Duration::from_secs(1);

/// Why an adapter cannot run at all.
#[derive(Debug, thiserror::Error)]
pub enum AdapterError {
    /// The source.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The bus.
    #[error(transparent)]
    Bus(#[from] BusError),
}

/// Runs the suit's adapter until `stopping` says so; `ready` is called once it listens.
///
/// The first opening must succeed; later faults are retried.
///
/// # Errors
/// The port is taken, or the bus cannot be joined.
pub fn run_suit(
    station: &str,
    config: &SuitConfig,
    ready: impl FnOnce(),
    stopping: &dyn Fn() -> bool,
) -> Result<(), AdapterError> {
    let settings = MvnUdpSettings {
        listen: config.listen,
        allow_remote: config.allow_remote,
        suit: suit_settings(config),
        ..MvnUdpSettings::default()
    };
    let bus = Bus::join(&BusSettings::new(station, "suit"))?;
    let (samples, wake) = (bus.publisher()?, bus.notifier(Channel::Inputs)?);
    let mut health = Health::new(&bus)?;
    let mut source = MvnUdpSource::open(settings)?;
    ready();
    while !stopping() {
        match source.receive() {
            Ok(Some(mut sample)) => {
                sample.published_ns = now_monotonic_ns();
                samples.send(&sample)?;
                wake.notify(Event::NewSuit)?;
            }
            Ok(None) => {}
            Err(error) => {
                warn!("suit: {error}; trying again in {REST:?}");
                std::thread::sleep(REST);
                if let Ok(opened) = MvnUdpSource::open(settings) {
                    source = opened;
                }
            }
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
/// No socket can be had, or the bus cannot be joined.
pub fn run_ground(
    station: &str,
    config: &GroundConfig,
    ready: impl FnOnce(),
    stopping: &dyn Fn() -> bool,
) -> Result<(), AdapterError> {
    let settings = RdtSourceSettings {
        address: config.address,
        rdt: rdt_settings(config),
        ..RdtSourceSettings::default()
    };
    let bus = Bus::join(&BusSettings::new(station, "ground"))?;
    let (publisher, wake) = (bus.publisher::<GroundSample>()?, bus.notifier(Channel::Inputs)?);
    let mut health = Health::new(&bus)?;
    let mut source = RdtSource::open(settings)?;
    ready();
    let mut samples = Vec::with_capacity(64);
    while !stopping() {
        samples.clear();
        if let Err(error) = source.receive(&mut samples) {
            warn!("ground: {error}; trying again in {REST:?}");
            std::thread::sleep(REST);
            if let Ok(opened) = RdtSource::open(settings) {
                source = opened;
            }
        }
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
    publisher: equipoise_bus::Publisher<AdapterHealth>,
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
