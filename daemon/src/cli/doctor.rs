//! `equipoise doctor`: what stands in the way of real time on this computer, and how to mend it.

use std::io::Write;
use std::path::PathBuf;

use super::{Outcome, StationArgument};
use crate::config::Config;
use crate::doctor::{Check, Facts, StationFacts, Verdict, judge};
use crate::state_directory::StateDirectory;
use crate::status;

/// Look at this computer and station: limits, kernel, clock, memory, ports, plate, suit; say how to mend each
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: sudo -u equipoise equipoise doctor --config /etc/equipoise/equipoise.toml\nRun it as the user \
                  of the service, on its bus: limits and places are that user's.\nExit codes: 0 nothing fails (warnings \
                  may stand), 1 something does."
)]
pub(super) struct Arguments {
    #[command(flatten)]
    station: StationArgument,
    /// Configuration file; without it that of the station's running daemon, if there is one
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let config = match &arguments.config {
        Some(path) => Some(Config::read(path)?),
        None => status::read(&arguments.station.station)
            .map(|facts| Config::parse(&facts.config_toml, "the daemon's configuration"))
            .transpose()?,
    };
    let name = config.as_ref().map_or(&arguments.station.station, |config| &config.station);
    let facts = Facts::gather(StateDirectory::of_station(name));
    // Without a bus there is no station to look at; that the bus cannot be joined is a check of its own.
    let (station, no_bus) = match config.as_ref().map(StationFacts::gather) {
        Some(Ok(station)) => (Some(station), None),
        Some(Err(error)) => (None, Some(error.to_string())),
        None => (None, None),
    };
    let checks = judge(&facts, config.as_ref(), station.as_ref());
    let note = no_bus.or_else(|| {
        let unseen = "ports, plate and suit were not looked at: name the configuration with --config";
        config.is_none().then(|| unseen.to_owned())
    });
    let mut out = std::io::stdout().lock();
    if arguments.json {
        let told = serde_json::json!({ "checks": checks, "note": note });
        writeln!(out, "{}", serde_json::to_string_pretty(&told)?)?;
    } else {
        for check in &checks {
            write_check(&mut out, check)?;
        }
        if let Some(note) = &note {
            writeln!(out, "{note}")?;
        }
    }
    let failed = checks.iter().filter(|check| check.verdict == Verdict::Fail).count();
    match failed {
        0 => Ok(Outcome::Done),
        _ => anyhow::bail!("{failed} of {} checks failed", checks.len()),
    }
}

fn write_check(out: &mut impl Write, check: &Check) -> std::io::Result<()> {
    let verdict = match check.verdict {
        Verdict::Ok => "ok",
        Verdict::Warn => "warn",
        Verdict::Fail => "FAIL",
    };
    write!(out, "{verdict:<5} {:<21} {}", check.name, check.found)?;
    match &check.mend {
        Some(mend) => writeln!(out, " -> {mend}"),
        None => writeln!(out),
    }
}
