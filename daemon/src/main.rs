//! `equipoise-daemon`: the service alone, as systemd starts it. `equipoise run` is the same.

use std::process::ExitCode;

use clap::Parser;
use equipoise_daemon::{process, run};

#[derive(Debug, Parser)]
#[command(name = "equipoise-daemon", version)]
struct Program {
    #[command(flatten)]
    arguments: run::Arguments,
}

fn main() -> ExitCode {
    process::restrict_new_files();
    match run::run(&Program::parse().arguments, None) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("equipoise-daemon: {}", process::single_line(&error));
            ExitCode::FAILURE
        }
    }
}
