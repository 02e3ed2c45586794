//! `equipoise adapter`: one adapter as a process of its own, so that its crash takes nothing else along.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::bail;
use clap::ValueEnum;
use equipoise_config::{Config, GroundSourceKind, SuitSourceKind};
use equipoise_daemon::realtime::ThreadReport;
use equipoise_daemon::sensors::AdapterError;
use equipoise_daemon::{realtime, sensors};
use equipoise_station::adapter_fault;
use tracing::{info, warn};

use super::{ConfigArgument, Outcome, log_to_stderr, single_line};

/// Run one adapter as a process of its own, for a daemon with --sensors-apart or with source = "external"
///
/// SIGHUP reads the configuration again and reopens the sensor. With source = "external" in this file it ends at once.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: equipoise adapter suit --config /etc/equipoise/equipoise.toml")]
pub(super) struct Arguments {
    stream: Stream,
    #[command(flatten)]
    config: ConfigArgument,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Stream {
    /// The motion-capture suit
    Suit,
    /// The force plate
    Ground,
}

impl Stream {
    fn name(self) -> &'static str {
        match self {
            Stream::Suit => sensors::SUIT_ROLE,
            Stream::Ground => sensors::GROUND_ROLE,
        }
    }

    fn is_external(self, config: &Config) -> bool {
        match self {
            Stream::Suit => config.suit.source == SuitSourceKind::External,
            Stream::Ground => config.ground.source == GroundSourceKind::External,
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    log_to_stderr("info");
    let (stream, path) = (arguments.stream, &arguments.config.config);
    let mut config = Config::read(path)?;
    let stop = super::stop_on_signals()?;
    let reload = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGHUP, Arc::clone(&reload))?;
    let report = realtime::request(stream.name(), sensors::requested_scheduling(&config));
    match report.missing() {
        Some(missing) if config.tick.strict => {
            let fault = format!("loop.strict: {missing}");
            adapter_fault::publish(&config.station, stream.name(), Some(&fault));
            bail!("{fault}");
        }
        Some(missing) => warn!("{missing}"),
        None => {}
    }
    while !stop.load(Ordering::Relaxed) {
        if stream.is_external(&config) {
            let name = stream.name();
            warn!(
                "{}: {name}.source is \"external\": another process publishes the {name}, and this adapter ends. If it is \
                 to read the {name}, name the device in this file",
                path.display()
            );
            break;
        }
        let stopping = || stop.load(Ordering::Relaxed) || reload.load(Ordering::Relaxed);
        if let Err(error) = run_once(stream, &config, &report, &stopping) {
            let error = anyhow::Error::from(error);
            adapter_fault::publish(&config.station, stream.name(), Some(&single_line(&error)));
            return Err(error);
        }
        // Reset the flag before reading the file, so that a signal during the read causes another one.
        if reload.swap(false, Ordering::Relaxed) {
            config = reread(path, config);
        }
    }
    adapter_fault::publish(&config.station, stream.name(), None);
    Ok(Outcome::Done)
}

/// Runs the adapter until `stopping`.
fn run_once(
    stream: Stream,
    config: &Config,
    report: &ThreadReport,
    stopping: &dyn Fn() -> bool,
) -> Result<(), AdapterError> {
    let publish = |fault: Option<&str>| adapter_fault::publish(&config.station, stream.name(), fault);
    let mut ready = || {
        publish(None);
        info!(
            fifo_asked = report.asked.fifo_priority,
            fifo_granted = report.granted.fifo_priority,
            "station {}: the {} adapter runs",
            config.station,
            stream.name()
        );
        let _ = sd_notify::notify(&[sd_notify::NotifyState::Ready]);
    };
    match stream {
        Stream::Suit => sensors::run_suit(&config.station, &config.suit, &mut ready, stopping),
        Stream::Ground => {
            let report_fault = |message: Option<&str>| {
                match message {
                    Some(message) => warn!("{message}"),
                    None => info!("the ground's device is there"),
                }
                publish(message);
            };
            sensors::run_ground(&config.station, &config.ground, &mut ready, &report_fault, stopping)
        }
    }
}

/// The configuration read again; one that is refused is logged, and the one before stays in force.
fn reread(path: &Path, before: Config) -> Config {
    info!("the configuration is read again");
    match Config::read(path) {
        Ok(config) if config.station == before.station => return config,
        Ok(config) => {
            warn!("station changed to {}: takes effect at the next restart of this adapter", config.station);
        }
        Err(error) => warn!("{error}; the configuration before stays in force"),
    }
    before
}
