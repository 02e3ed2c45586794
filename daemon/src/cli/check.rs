//! `equipoise check`: is this configuration one that `run` would take?

use std::path::PathBuf;

use super::Outcome;
use crate::config::Config;

/// Check a configuration file
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: equipoise check /etc/equipoise/equipoise.toml")]
pub(super) struct Arguments {
    /// Configuration file
    file: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let config = Config::read(&arguments.file)?;
    println!(
        "{}: station {}, {} Hz, subject {}",
        arguments.file.display(),
        config.station,
        config.tick.rate_hz,
        config.subject.id
    );
    Ok(Outcome::Done)
}
