//! A gateway as a program: `equipoise-gateway-KIND --config FILE`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Parser;
use tracing::info;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

use crate::config::StationFile;
use crate::drive::drive;
use crate::gateway::Gateway;

/// Arguments of every gateway.
#[derive(Debug, Parser)]
#[command(version, about = "Gateway of an Equipoise station; started by `equipoise gateway KIND`")]
struct Arguments {
    /// Configuration file of the station, with its table [gateways]
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
}

/// A gateway and its rate.
pub struct ScheduledGateway {
    /// The gateway.
    pub gateway: Box<dyn Gateway>,
    /// Ticks per second.
    pub rate_hz: f64,
}

/// Main function of a gateway's program: `kind` is the name of its section, `create` constructs the gateway from the
/// configuration.
pub fn main_of(
    kind: &str,
    create: impl FnOnce(&StationFile) -> anyhow::Result<ScheduledGateway>,
) -> ExitCode {
    let arguments = Arguments::parse();
    log_to_stderr();
    let outcome = stop_on_signals().and_then(|stop| {
        let file = StationFile::read(&arguments.config)?;
        run(kind, &file, create(&file)?, &stop)
    });
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("equipoise-gateway-{kind}: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Serves until `stop`.
///
/// # Errors
/// As [`drive()`].
pub fn run(
    kind: &str,
    file: &StationFile,
    mut scheduled: ScheduledGateway,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    info!("station {}: gateway {kind}, {} Hz", file.station, scheduled.rate_hz);
    drive(&file.station, kind, scheduled.rate_hz, scheduled.gateway.as_mut(), stop)?;
    info!("ended: {}", scheduled.gateway.tally());
    Ok(())
}

/// Error for a missing section.
pub fn no_section(kind: &str) -> anyhow::Error {
    anyhow::anyhow!("the configuration has no [gateways.{kind}]: add it (docs/consumers/)")
}

fn stop_on_signals() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}

fn log_to_stderr() {
    let requested = std::env::var("RUST_LOG").ok().filter(|text| !text.is_empty());
    let requested: Option<Targets> = requested.and_then(|text| text.parse().ok());
    let filter = requested.unwrap_or_else(|| Targets::new().with_default(LevelFilter::INFO));
    let builder = tracing_subscriber::fmt().with_max_level(LevelFilter::TRACE).with_writer(std::io::stderr);
    let builder = builder.with_target(false);
    if std::env::var_os("JOURNAL_STREAM").is_some() {
        builder.without_time().with_ansi(false).finish().with(filter).init();
    } else {
        let terminal = std::io::IsTerminal::is_terminal(&std::io::stderr());
        builder.with_ansi(terminal).finish().with(filter).init();
    }
}
