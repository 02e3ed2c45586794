//! `equipoise install` and `equipoise uninstall`: the service, from the program alone.

use std::path::PathBuf;

use anyhow::Context;

use super::Outcome;
use crate::install::{self, Destination};

/// Where to.
#[derive(Debug, clap::Args)]
struct DestinationArguments {
    /// The program goes to DIR/bin
    #[arg(long, value_name = "DIR", default_value = "/usr/local")]
    prefix: PathBuf,
    /// Everything goes below this folder, for packages; needs no root
    #[arg(long, value_name = "DIR", default_value = "/")]
    root: PathBuf,
}

/// Install this program as a service: units, user, directories, a configuration if there is none
///
/// Gateways that are separate programs (equipoise-gateway-KIND) are installed too if they are in the directory of this
/// program. Those that are missing are listed, with the unit to enable for each [gateways.KIND] of the
/// configuration.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  sudo equipoise install\n  equipoise install --prefix /usr --root package/ --enable"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    destination: DestinationArguments,
    /// Start daemon, sensors and page at boot
    #[arg(long)]
    enable: bool,
}

/// Take away what install put there; configuration and workers stay
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example (units of sensors, gateways and recordings: as in systemd/README.md):\n  sudo systemctl disable --now equipoise equipoise-adapter@suit equipoise-adapter@ground equipoise-view && sudo equipoise uninstall"
)]
pub(super) struct UninstallArguments {
    #[command(flatten)]
    destination: DestinationArguments,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let destination = Destination::new(&arguments.destination.prefix, &arguments.destination.root)?;
    let program = std::env::current_exe().context("this program does not know where it lies")?;
    for line in install::install(&destination, &program, arguments.enable)? {
        println!("{line}");
    }
    let start = if arguments.enable { "start" } else { "enable --now" };
    println!(
        "next: systemd-sysusers && systemd-tmpfiles --create && systemctl daemon-reload\n\
         then: sudo -u equipoise equipoise check /etc/equipoise/equipoise.toml && systemctl {start} equipoise \
         equipoise-adapter@suit equipoise-adapter@ground equipoise-view"
    );
    Ok(Outcome::Done)
}

pub(super) fn uninstall(arguments: &UninstallArguments) -> anyhow::Result<Outcome> {
    let destination = Destination::new(&arguments.destination.prefix, &arguments.destination.root)?;
    for line in install::uninstall(&destination)? {
        println!("{line}");
    }
    println!("next: systemctl daemon-reload; what still runs ends with: systemctl stop 'equipoise*'");
    Ok(Outcome::Done)
}
