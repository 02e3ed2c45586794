//! The command line: one file per command.

mod adapter;
mod check;
mod completions;
mod demo;
mod doctor;
mod export;
mod gateway;
mod identify;
mod import;
mod install;
mod latency;
mod metrics;
mod model;
mod plan;
mod reconcile;
mod record;
mod register;
mod replay;
mod report;
mod simulate;
mod status;
mod stomp;
mod subject;
mod token;
mod trace;
mod verify;
mod view;
mod watch;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use equipoise_daemon::run;
use equipoise_daemon::run::ConfigArgument;
use equipoise_discrepancy::spans::Span;
use equipoise_station::process::{self, log_to_stderr, single_line, stop_on_signals};

use crate::{metrics_feed, output};

/// Exit status of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// 0: done.
    Done,
    /// 3: the data were read, but part of them was rejected.
    PartRejected,
}

#[derive(Debug, Parser)]
#[command(
    name = "equipoise",
    version,
    about = "Overload torques of a worker's joints, live, from a motion-capture suit and a force plate",
    after_help = "Start with: equipoise demo\n\nExit codes: 0 done, 1 failed, 2 wrong usage, 3 part of the data was \
                  rejected.\nNot a medical device and not a safety function."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Arguments),
    Doctor(doctor::Arguments),
    Run(run::Arguments),
    View(view::Arguments),
    Adapter(adapter::Arguments),
    Check(check::Arguments),
    Status(status::Arguments),
    Watch(watch::Arguments),
    Identify(identify::Arguments),
    Subject(subject::Arguments),
    Tare(identify::TareArguments),
    Verify(verify::Arguments),
    Register(register::Arguments),
    Stomp(stomp::Arguments),
    Record(record::Arguments),
    Import(import::Arguments),
    Replay(replay::Arguments),
    Report(report::Arguments),
    Export(export::Arguments),
    Reconcile(reconcile::Arguments),
    Model(model::Arguments),
    Plan(plan::Arguments),
    Latency(latency::Arguments),
    Metrics(metrics::Arguments),
    #[command(alias = "outlet")]
    Gateway(gateway::Arguments),
    Trace(trace::Arguments),
    Simulate(simulate::Arguments),
    Token(token::Arguments),
    Install(install::Arguments),
    Uninstall(install::UninstallArguments),
    Completions(completions::Arguments),
    #[command(hide = true)]
    ManPages(completions::ManPagesArguments),
}

/// Which station to talk to.
#[derive(Debug, clap::Args)]
struct StationArgument {
    /// Station of the running daemon
    #[arg(long, default_value = "station-1", env = "EQUIPOISE_STATION")]
    station: String,
}

/// Runs the command of the arguments.
pub fn main() -> ExitCode {
    process::restrict_new_files();
    let cli = Cli::parse();
    let outcome = match cli.command {
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Doctor(arguments) => doctor::run(&arguments),
        Command::Run(arguments) => run::run(&arguments, Some(metrics_feed::run)).map(|()| Outcome::Done),
        Command::View(arguments) => view::run(&arguments),
        Command::Adapter(arguments) => adapter::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Status(arguments) => status::run(&arguments),
        Command::Watch(arguments) => watch::run(&arguments),
        Command::Identify(arguments) => identify::run(&arguments),
        Command::Subject(arguments) => subject::run(&arguments),
        Command::Tare(arguments) => identify::tare(&arguments),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Register(arguments) => register::run(&arguments),
        Command::Stomp(arguments) => stomp::run(&arguments),
        Command::Record(arguments) => record::run(&arguments),
        Command::Import(arguments) => import::run(&arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Reconcile(arguments) => reconcile::run(&arguments),
        Command::Model(arguments) => model::run(&arguments),
        Command::Plan(arguments) => plan::run(&arguments),
        Command::Latency(arguments) => latency::run(&arguments),
        Command::Metrics(arguments) => metrics::run(&arguments),
        Command::Gateway(arguments) => gateway::run(&arguments),
        Command::Trace(arguments) => trace::run(&arguments),
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Token(arguments) => token::run(&arguments),
        Command::Install(arguments) => install::run(&arguments),
        Command::Uninstall(arguments) => install::uninstall(&arguments),
        Command::Completions(arguments) => completions::run(&arguments),
        Command::ManPages(arguments) => completions::man_pages(&arguments),
    };
    let code = match outcome {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::PartRejected) => ExitCode::from(3),
        // The reader closed our output early, as in `equipoise watch | head -n 1`.
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("equipoise: {}", single_line(&error));
            return ExitCode::FAILURE;
        }
    };
    match output::finish() {
        None => code,
        Some(error) => {
            eprintln!("equipoise: the output is incomplete: cannot write to standard output: {error}");
            ExitCode::FAILURE
        }
    }
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let cause = error.root_cause().downcast_ref::<std::io::Error>();
    cause.is_some_and(|cause| cause.kind() == std::io::ErrorKind::BrokenPipe)
}

/// A span of time on the command line.
fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().unwrap_or(f64::NAN);
    if seconds > 0.0 && f64::is_finite(seconds) {
        Ok(seconds)
    } else {
        Err("give a number of seconds above 0".to_owned())
    }
}

/// A span of a recording that an option names.
fn span(option: &str, text: Option<&str>) -> anyhow::Result<Option<Span>> {
    text.map(|text| text.parse().map_err(|reason: String| anyhow::anyhow!("{option}: {reason}"))).transpose()
}
