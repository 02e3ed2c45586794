//! `equipoise outlet KIND`: what leaves the machine, each kind in a process of its own.

use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

use anyhow::Context;
use clap::ValueEnum;
use equipoise_outlets::process::Made;
use equipoise_outlets::{StationFile, process, rtde, udp};

use super::{ConfigArgument, Outcome, log_to_stderr};
use crate::config::Config;

/// Send the station's states to controllers and other machines, by one of the configuration's [outlets]
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: equipoise outlet udp --config /etc/equipoise/equipoise.toml\n\nudp and rtde need nothing more. \
                  Each other outlet is a program of its own, equipoise-outlet-KIND, in the directory of this one:\n  cargo \
                  build --release -p equipoise-outlet-opcua"
)]
pub(super) struct Arguments {
    /// Which outlet
    kind: Kind,
    #[command(flatten)]
    config: ConfigArgument,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    Udp,
    Rtde,
    Opcua,
    Mqtt,
    Zenoh,
    Foxglove,
}

impl Kind {
    fn name(self) -> String {
        self.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
    }

    /// An outlet that needs no other program.
    fn in_process(self) -> Option<fn(&StationFile) -> anyhow::Result<Made>> {
        match self {
            Kind::Udp => Some(udp::make),
            Kind::Rtde => Some(rtde::make),
            Kind::Opcua | Kind::Mqtt | Kind::Zenoh | Kind::Foxglove => None,
        }
    }

    /// The program, with the folder of this one before it.
    fn program(self) -> anyhow::Result<PathBuf> {
        let here = std::env::current_exe().context("where this program lies")?;
        Ok(here.with_file_name(format!("equipoise-outlet-{}", self.name())))
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    // Check the complete configuration: an outlet reads only its own section.
    let config = Config::read(&arguments.config.config)?;
    drop(config);
    if let Some(make) = arguments.kind.in_process() {
        log_to_stderr("info");
        let stop = super::run::stop_on_signals()?;
        let file = StationFile::read(&arguments.config.config)?;
        process::run(&arguments.kind.name(), &file, make(&file)?, &stop)?;
        return Ok(Outcome::Done);
    }
    let program = arguments.kind.program()?;
    let failed = Command::new(&program).arg("--config").arg(&arguments.config.config).exec();
    let name = program.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Err(failed).with_context(|| {
        format!(
            "cannot start {}: build it with cargo build --release -p {name}, into the directory of this program",
            program.display()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_separate_outlet_program_is_installed() {
        for kind in Kind::value_variants().iter().filter(|kind| kind.in_process().is_none()) {
            let program = kind.program().unwrap();
            let name = program.file_name().and_then(|name| name.to_str()).unwrap();
            assert!(crate::install::PROGRAMS.contains(&name), "{name}");
        }
    }
}
