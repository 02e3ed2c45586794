//! `equipoise adapter`: one adapter as a process of its own, so that its crash takes nothing else along.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::bail;
use clap::ValueEnum;
use equipoise_config::{Config, GroundSourceKind, SuitSourceKind};
use equipoise_daemon::realtime::ThreadReport;
use equipoise_daemon::sensors::AdapterError;
use equipoise_daemon::{realtime, sensors};
use equipoise_station::{adapter_fault, status};
use tracing::{info, warn};

use super::{ConfigArgument, Outcome, log_to_stderr, single_line};

/// Interval at which the section in use is compared with the daemon's.
const CHECK_INTERVAL: Duration = Duration::from_millis(500);

/// Run one adapter as a process of its own, for a daemon with --sensors-apart or with source = "external"
///
/// SIGHUP reads the configuration again and reopens the sensor. While a daemon runs with another [suit] or [ground], the
/// adapter keeps that of the daemon, or publishes nothing. A daemon with source = "external" in [ground] must have the
/// same remaining [ground] keys as this file. With source = "external" in this file the adapter exits immediately.
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
    let mut config = Config::read_without_model(path)?;
    let stop = super::stop_on_signals()?;
    let reload = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGHUP, Arc::clone(&reload))?;
    // Before the scheduling is requested, which the thread would inherit.
    let watch = DaemonWatch::start(stream, &config);
    let mut reported = None;
    let report = request_scheduling(stream, &config)?;
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
        let stopping = || {
            stop.load(Ordering::Relaxed)
                || reload.load(Ordering::Relaxed)
                || watch.differs.load(Ordering::Relaxed)
        };
        if let Some(fault) = differs_from_daemon(stream, &config) {
            // The file has the daemon's section if only the daemon was restarted after a change.
            let read = Config::read_with_warnings(path).ok();
            match read.filter(|(new, _)| differs_from_daemon(stream, new).is_none()) {
                Some((new, warnings)) if new.station == config.station => {
                    warnings.iter().for_each(|warning| warn!("{warning}"));
                    info!("[{}] of {} is in use, as the daemon has it", stream.name(), path.display());
                    config = new;
                }
                _ => {
                    adapter_fault::publish(&config.station, stream.name(), Some(&fault));
                    if reported.as_ref() != Some(&fault) {
                        warn!("{fault}");
                        reported = Some(fault);
                    }
                    std::thread::sleep(CHECK_INTERVAL);
                    continue;
                }
            }
        }
        reported = None;
        watch.set(&config);
        if let Err(error) = run_once(stream, &config, &report, &stopping) {
            let error = anyhow::Error::from(error);
            adapter_fault::publish(&config.station, stream.name(), Some(&single_line(&error)));
            return Err(error);
        }
        // Reset the flag before reading the file, so that a signal during the read causes another one.
        if reload.swap(false, Ordering::Relaxed) {
            config = reread(stream, path, config);
        }
    }
    adapter_fault::publish(&config.station, stream.name(), None);
    Ok(Outcome::Done)
}

/// Requests the adapter's scheduling; under `loop.strict` a refusal is an error.
fn request_scheduling(stream: Stream, config: &Config) -> anyhow::Result<ThreadReport> {
    let report = realtime::request(stream.name(), sensors::requested_scheduling(config));
    match report.missing() {
        Some(missing) if config.tick.strict => {
            let fault = format!("loop.strict: {missing}");
            adapter_fault::publish(&config.station, stream.name(), Some(&fault));
            bail!("{fault}");
        }
        Some(missing) => warn!("{missing}"),
        None => {}
    }
    Ok(report)
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

/// Why this adapter's section must not be used: the daemon has another one, so its tare, latency and model refer to other
/// samples. `None` without a daemon.
fn differs_from_daemon(stream: Stream, config: &Config) -> Option<String> {
    let daemon = status::read(&config.station)?.config_toml;
    let (name, station) = (stream.name(), &config.station);
    let section = daemon.parse::<toml::Table>().ok()?.remove(name)?;
    let remedy = difference(stream, config.section(name)?, section)?;
    Some(format!(
        "[{name}] in this adapter's file differs from that of the running daemon of station {station}: nothing is \
         published. {remedy}"
    ))
}

/// What ends the difference between an adapter's section and the daemon's; `None` if the samples of this section are
/// those that the daemon's tare, frames and latency refer to.
fn difference(stream: Stream, own: toml::Value, of_daemon: toml::Value) -> Option<&'static str> {
    let is_external = of_daemon.get("source").and_then(toml::Value::as_str) == Some("external");
    match (stream, is_external) {
        // The daemon uses no key that describes the suit's device.
        (Stream::Suit, true) => None,
        (Stream::Ground, true) => (without_devices(own) != without_devices(of_daemon)).then_some(
            "Restart equipoise with this file's [ground] keys and source = \"external\", or with this file and \
             --sensors-apart",
        ),
        (_, false) => (own != of_daemon).then_some("Restart equipoise with this file"),
    }
}

/// A section without its `source` and `second`, which a daemon with an external ground cannot have.
fn without_devices(mut section: toml::Value) -> toml::Value {
    if let Some(keys) = section.as_table_mut() {
        keys.remove("source");
        keys.remove("second");
    }
    section
}

/// Compares the section in use with the daemon's, in a thread of its own so that no sample waits for a file.
struct DaemonWatch {
    config: Mutex<Config>,
    differs: AtomicBool,
}

impl DaemonWatch {
    fn start(stream: Stream, config: &Config) -> Arc<DaemonWatch> {
        let watch =
            Arc::new(DaemonWatch { config: Mutex::new(config.clone()), differs: AtomicBool::new(false) });
        let shared = Arc::clone(&watch);
        // It ends with the process.
        std::thread::spawn(move || {
            loop {
                // The result must not replace that of a configuration set meanwhile.
                let config = shared.config.lock().unwrap_or_else(PoisonError::into_inner);
                shared.differs.store(differs_from_daemon(stream, &config).is_some(), Ordering::Relaxed);
                drop(config);
                std::thread::sleep(CHECK_INTERVAL);
            }
        });
        watch
    }

    fn set(&self, config: &Config) {
        let mut in_use = self.config.lock().unwrap_or_else(PoisonError::into_inner);
        *in_use = config.clone();
        self.differs.store(false, Ordering::Relaxed);
    }
}

/// The configuration read again; one that is refused is logged, and the one before stays in force.
fn reread(stream: Stream, path: &Path, before: Config) -> Config {
    info!("the configuration is read again");
    match Config::read_without_model(path) {
        Ok(config) if config.station == before.station => {
            if stream.is_external(&config) || differs_from_daemon(stream, &config).is_none() {
                return config;
            }
            warn!("[{}] changed: takes effect once equipoise is restarted", stream.name());
        }
        Ok(config) => {
            warn!("station changed to {}: takes effect at the next restart of this adapter", config.station);
        }
        Err(error) => warn!("{error}; the configuration before stays in force"),
    }
    before
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_daemon_with_an_external_ground_has_the_same_ground_except_its_source() {
        let config = |source: &str, keys: &str| {
            let text = format!(
                "station = \"s\"\n[suit]\nsource = \"mvn-udp\"\n[ground]\nsource = \"{source}\"\n\
                 counts_per_newton = 1e6\ncounts_per_newton_metre = 1e6\n{keys}[subject]\nid = \"a\"\nheight_m = 1.7\n"
            );
            Config::parse(&text, "the test's").unwrap().section("ground").unwrap()
        };
        let own = config("ati-rdt", "");
        let of = |daemon: toml::Value| difference(Stream::Ground, own.clone(), daemon);
        assert_eq!(of(config("ati-rdt", "")), None);
        assert_eq!(of(config("external", "")), None);
        let mut two_devices = own.clone();
        two_devices.as_table_mut().unwrap().insert("second".to_owned(), toml::Table::new().into());
        assert_eq!(difference(Stream::Ground, two_devices, config("external", "")), None);
        let moved = "[ground.frame]\nyaw_deg = 90.0\n";
        assert_eq!(of(config("ati-rdt", moved)), Some("Restart equipoise with this file"));
        for changed in [moved, "latency_ms = 5.0\n", "measures = \"reaction\"\n"] {
            assert!(
                of(config("external", changed)).is_some_and(|remedy| remedy.contains("external")),
                "{changed}"
            );
        }
        let suit = |text: &str| text.parse::<toml::Table>().map(toml::Value::Table).unwrap();
        let forwarded = suit("source = \"external\"\nlatency_ms = 0.0");
        assert_eq!(difference(Stream::Suit, suit("source = \"mvn-udp\"\navatar = 1"), forwarded), None);
    }
}
