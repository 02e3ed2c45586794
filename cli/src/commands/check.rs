//! `equipoise check`: is this configuration one that `run` would take?

use std::path::{Path, PathBuf};

use anyhow::Context;
use equipoise_config::{Config, sensor_network};
use equipoise_core::cycle::PriorKind;
use equipoise_daemon::similar;
use equipoise_recording::record::service::signing_key;
use equipoise_station::state_directory::StateDirectory;

use super::{Outcome, log_to_stderr};
use crate::page_tokens::PageTokens;

/// Check a configuration file, the model that it names, and the files with the page's tokens and the recordings' key
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: equipoise check /etc/equipoise/equipoise.toml")]
pub(super) struct Arguments {
    /// Configuration file
    file: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    log_to_stderr("warn");
    let config = Config::read(&arguments.file)?;
    let base = arguments.file.parent().unwrap_or(Path::new(""));
    if let Some(page) = &config.page {
        PageTokens::read(page, base)?;
    }
    if let Some(recording) = &config.recording {
        signing_key(recording, base)?;
    }
    println!(
        "{}: station {}, {} Hz, subject {}",
        arguments.file.display(),
        config.station,
        config.tick.rate_hz,
        config.subject.id
    );
    if let Some(model) = &config.loaded_model {
        println!("{}", model.describe());
    }
    for note in sensor_network::notes(&config) {
        println!("{note}");
    }
    let settings = config.settings();
    if settings.prior == PriorKind::SimilarSubject {
        let state = StateDirectory::of_station(&config.station)?;
        let chosen = similar::choose(&config.subject.id, &settings, &state).with_context(|| {
            format!("identification.prior = \"similar-subject\" needs to read {}", state.profiles().display())
        })?;
        println!("{}", similar::describe(chosen.as_ref()));
    }
    Ok(Outcome::Done)
}
