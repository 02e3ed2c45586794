//! An outlet as a program: `equipoise-outlet-KIND --config FILE`.

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
use crate::outlet::Outlet;

/// Arguments of every outlet.
#[derive(Debug, Parser)]
#[command(version, about = "An outlet of an Equipoise station; `equipoise outlet KIND` starts it")]
struct Arguments {
    /// Configuration file of the station, with its [outlets]
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
}

/// A gateway and its rate.
pub struct Made {
    /// The gateway.
    pub outlet: Box<dyn Outlet>,
    /// Ticks per second.
    pub rate_hz: f64,
}

/// The whole program of an outlet: `kind` is the name of its section, `make` makes it of the configuration.
pub fn main_of(kind: &str, make: impl FnOnce(&StationFile) -> anyhow::Result<Made>) -> ExitCode {
    let arguments = Arguments::parse();
    log_to_stderr();
    let outcome = stop_on_signals().and_then(|stop| {
        let file = StationFile::read(&arguments.config)?;
        run(kind, &file, make(&file)?, &stop)
    });
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("equipoise-outlet-{kind}: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Serves until `stop`.
///
/// # Errors
/// As [`drive()`].
pub fn run(kind: &str, file: &StationFile, mut made: Made, stop: &AtomicBool) -> anyhow::Result<()> {
    info!("station {}: outlet {kind}, {} Hz", file.station, made.rate_hz);
    drive(&file.station, kind, made.rate_hz, made.outlet.as_mut(), stop)?;
    info!("ended: {}", made.outlet.tally());
    Ok(())
}

/// What to say when a section is missing.
pub fn no_section(kind: &str) -> anyhow::Error {
    anyhow::anyhow!("the configuration has no [outlets.{kind}]: add it (docs/consumers/)")
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
