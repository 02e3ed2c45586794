//! `equipoise-daemon`: the service alone, as systemd starts it. `equipoise run` is the same, with the metrics' server.

use std::io::Write as _;
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser};
use equipoise_daemon::run;
use equipoise_station::process;

const EXAMPLE: &str = "Example: equipoise-daemon --sensors-apart --config /etc/equipoise/equipoise.toml";

#[derive(Debug, Parser)]
#[command(name = "equipoise-daemon", version)]
struct Program {
    #[command(flatten)]
    arguments: run::Arguments,
}

fn main() -> ExitCode {
    process::restrict_new_files();
    // The help of the flattened arguments has the example of `equipoise run`.
    let matches = Program::command().after_help(EXAMPLE).get_matches();
    let program = Program::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    match run::run(&program.arguments, None) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Standard error can be a terminal that was closed, where `eprintln!` panics.
            let _ = writeln!(std::io::stderr(), "equipoise-daemon: {}", process::single_line(&error));
            ExitCode::FAILURE
        }
    }
}
