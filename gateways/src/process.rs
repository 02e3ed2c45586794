//! A gateway as a program: `equipoise-gateway-KIND --config FILE`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Parser;
use tracing::info;

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
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("info"));
    let builder =
        tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).with_target(false);
    if std::env::var_os("JOURNAL_STREAM").is_some() {
        builder.without_time().with_ansi(false).init();
    } else {
        builder.with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr())).init();
    }
}
