//! A gateway as a program: `equipoise-gateway-KIND --config FILE`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;

use clap::Parser;
use equipoise_station::process::{log_to_stderr, stop_on_signals};
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
    log_to_stderr("info");
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
