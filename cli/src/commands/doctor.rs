//! `equipoise doctor`: checks this computer for obstacles to real time, and prints how to fix each.

use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use equipoise_config::Config;
use equipoise_station::state_directory::StateDirectory;
use equipoise_station::status;

use super::{Outcome, StationArgument};
use crate::doctor::{Check, Facts, StationFacts, SuitFacts, Verdict, evaluate, evaluate_suit};

/// Check this computer and station: limits, kernel, clock, memory, ports, plate, suit; print a fix for each problem
#[derive(Debug, clap::Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_help = "Example: sudo -u equipoise equipoise doctor --config /etc/equipoise/equipoise.toml\nRun it as the user \
                  of the service, on its bus: limits and places are that user's.\n`equipoise doctor suit --help`: what MVN sends, \
                  and which of its boxes to tick.\nExit codes: 0 nothing fails (warnings \
                  may stand), 1 something does."
)]
pub(super) struct Arguments {
    #[command(subcommand)]
    target: Option<Target>,
    #[command(flatten)]
    options: Options,
}

#[derive(Debug, clap::Subcommand)]
enum Target {
    Suit(SuitArguments),
}

#[derive(Debug, clap::Args)]
struct Options {
    #[command(flatten)]
    station: StationArgument,
    /// Configuration file; without it that of the station's running daemon, if there is one
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

/// Listen to the suit: who sends, which characters, which types at which rate; which boxes of MVN to tick, and why
///
/// It listens on suit.listen as the daemon would; while the station's daemon or adapter has the port, it is asked
/// instead.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: equipoise doctor suit --config /etc/equipoise/equipoise.toml --for 5s\nExit codes: 0 all that \
                  is needed is there, 1 something is missing."
)]
struct SuitArguments {
    #[command(flatten)]
    options: Options,
    /// For how many seconds to listen
    #[arg(long = "for", default_value = "5s", value_name = "SECONDS", value_parser = span)]
    time: Duration,
}

/// Seconds, with or without the unit, up to an hour.
fn span(text: &str) -> Result<Duration, String> {
    let seconds = super::seconds(text.strip_suffix('s').unwrap_or(text))?;
    if seconds <= 3600.0 {
        Ok(Duration::from_secs_f64(seconds))
    } else {
        Err("give an hour at most".to_owned())
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    super::log_to_stderr("warn");
    match &arguments.target {
        Some(Target::Suit(suit)) => run_suit(suit),
        None => run_all(&arguments.options),
    }
}

fn read_config(options: &Options) -> anyhow::Result<Option<Config>> {
    match &options.config {
        Some(path) => Ok(Some(Config::read(path)?)),
        None => Ok(status::read(&options.station.station)
            .map(|facts| Config::parse(&facts.config_toml, "the daemon's configuration"))
            .transpose()?),
    }
}

fn run_suit(arguments: &SuitArguments) -> anyhow::Result<Outcome> {
    let Some(config) = read_config(&arguments.options)? else {
        anyhow::bail!(
            "no daemon of station {} runs: name the configuration with --config FILE",
            arguments.options.station.station
        );
    };
    let stop = super::stop_on_signals()?;
    let facts = SuitFacts::gather(&config, arguments.time, &|| stop.load(Ordering::Relaxed));
    let checks = evaluate_suit(&config, &facts);
    let mut out = Vec::new();
    if arguments.options.json {
        let report = serde_json::json!({ "checks": checks, "heard": facts.to_json() });
        writeln!(out, "{}", serde_json::to_string_pretty(&report)?)?;
    } else {
        for check in &checks {
            write_check(&mut out, check)?;
        }
    }
    print!("{}", String::from_utf8_lossy(&out));
    outcome(&checks)
}

fn run_all(arguments: &Options) -> anyhow::Result<Outcome> {
    let config = read_config(arguments)?;
    let name = config.as_ref().map_or(&arguments.station.station, |config| &config.station);
    let facts = Facts::gather(StateDirectory::of_station(name));
    // Without a bus the station cannot be examined; a separate check reports the failure to join.
    let station = match &config {
        Some(config) => StationFacts::gather(config).map_err(|error| error.to_string()),
        None => Err("no daemon runs: name the configuration with --config".to_owned()),
    };
    let observed = config.as_ref().zip(station.as_ref().ok());
    let reason = station.as_ref().err().map_or("", String::as_str);
    let checks = evaluate(&facts, config.as_ref(), observed.ok_or(reason));
    let mut out = Vec::new();
    if arguments.json {
        let report = serde_json::json!({ "checks": checks });
        writeln!(out, "{}", serde_json::to_string_pretty(&report)?)?;
    } else {
        for check in &checks {
            write_check(&mut out, check)?;
        }
    }
    print!("{}", String::from_utf8_lossy(&out));
    outcome(&checks)
}

fn outcome(checks: &[Check]) -> anyhow::Result<Outcome> {
    let failed = checks.iter().filter(|check| check.verdict == Verdict::Fail).count();
    match failed {
        0 => Ok(Outcome::Done),
        _ => anyhow::bail!("{failed} of {} checks failed", checks.len()),
    }
}

fn write_check(out: &mut impl Write, check: &Check) -> std::io::Result<()> {
    let verdict = match check.verdict {
        Verdict::Ok => "ok",
        Verdict::Skipped => "skipped",
        Verdict::Warn => "warn",
        Verdict::Fail => "FAIL",
    };
    write!(out, "{verdict:<7} {:<21} {}", check.name, check.found)?;
    match &check.fix {
        Some(fix) => writeln!(out, " -> {fix}"),
        None => writeln!(out),
    }
}
