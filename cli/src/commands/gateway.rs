//! `equipoise gateway KIND`: sends states to other machines; each kind is a separate process.

use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

use anyhow::Context;
use clap::ValueEnum;
use equipoise_config::Config;
use equipoise_gateways::process::ScheduledGateway;
use equipoise_gateways::{StationFile, process, rtde, udp};

use super::{ConfigArgument, Outcome, log_to_stderr};

/// Send the station's states to controllers and other machines, by a gateway of the configuration ([gateways.KIND])
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: equipoise gateway udp --config /etc/equipoise/equipoise.toml\n\nudp and rtde are part \
                  of this program. Each other gateway is a separate program (and package), equipoise-gateway-KIND, in the \
                  directory of this one:\n  cargo build --release -p equipoise-gateway-opcua"
)]
pub(super) struct Arguments {
    /// Kind of the gateway
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

    /// Constructor of a gateway that is part of this program.
    fn in_process(self) -> Option<fn(&StationFile) -> anyhow::Result<ScheduledGateway>> {
        match self {
            Kind::Udp => Some(udp::create),
            Kind::Rtde => Some(rtde::create),
            Kind::Opcua | Kind::Mqtt | Kind::Zenoh | Kind::Foxglove => None,
        }
    }

    /// Path of the separate program, in the directory of this one.
    fn program(self) -> anyhow::Result<PathBuf> {
        let here = std::env::current_exe().context("cannot determine the path of this program")?;
        Ok(here.with_file_name(format!("equipoise-gateway-{}", self.name())))
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    log_to_stderr("info");
    // Check the complete configuration: a gateway reads only its own section.
    Config::read_without_model(&arguments.config.config)?;
    if let Some(create) = arguments.kind.in_process() {
        let stop = super::stop_on_signals()?;
        let file = StationFile::read(&arguments.config.config)?;
        process::run(&arguments.kind.name(), &file, create(&file)?, &stop)?;
        return Ok(Outcome::Done);
    }
    let program = arguments.kind.program()?;
    let failed = Command::new(&program).arg("--config").arg(&arguments.config.config).exec();
    let name = program.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Err(failed).with_context(|| {
        format!(
            "cannot start {}: install the package {name}, or build it into the directory of this program: cargo \
             build --release -p {name}",
            program.display()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[test]
    fn the_previous_name_of_the_command_is_accepted() {
        for name in ["gateway", "outlet"] {
            let cli = super::super::Cli::try_parse_from(["equipoise", name, "udp", "--config", "c.toml"]);
            assert!(matches!(cli.unwrap().command, super::super::Command::Gateway(_)), "{name}");
        }
    }

    #[test]
    fn every_separate_gateway_program_is_installed() {
        for kind in Kind::value_variants().iter().filter(|kind| kind.in_process().is_none()) {
            let program = kind.program().unwrap();
            let name = program.file_name().and_then(|name| name.to_str()).unwrap();
            assert!(crate::install::PROGRAMS.contains(&name), "{name}");
        }
    }
}
