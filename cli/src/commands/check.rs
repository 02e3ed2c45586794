//! `equipoise check`: validates a configuration, and prints what will run with it.

use std::path::{Path, PathBuf};

use anyhow::Context;
use equipoise_config::ground::GroundConfig;
use equipoise_config::ground::second::in_second;
use equipoise_config::{Config, GroundSourceKind, LoadedModel, SuitSourceKind, sensor_network};
use equipoise_core::cycle::PriorKind;
use equipoise_daemon::similar;
use equipoise_recording::record::service::signing_key;
use equipoise_station::state_directory::StateDirectory;
use serde::Serialize;

use super::{Outcome, log_to_stderr};
use crate::page_tokens::PageTokens;

/// Check a configuration file, the model that it names, and the files with the page's tokens and the recordings' key
///
/// Prints OK and what runs with this file: rate, sensors with their addresses, subject, model, page, gateways.
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
    let prior = prior(&config)?;
    println!("{}: OK", arguments.file.display());
    for (name, value) in summary(&config).into_iter().chain(prior) {
        println!("  {name:<10} {value}");
    }
    for note in sensor_network::notes(&config) {
        println!("{note}");
    }
    Ok(Outcome::Done)
}

/// What runs with a configuration: names and values.
fn summary(config: &Config) -> Vec<(&'static str, String)> {
    let tick = &config.tick;
    let core = tick.cpu.map_or_else(String::new, |cpu| format!(", core {cpu}"));
    let mut lines = vec![
        ("station", config.station.clone()),
        ("loop", format!("{} Hz, priority {}{core}", tick.rate_hz, tick.priority)),
        ("suit", suit(config)),
        ("ground", ground(&config.ground)),
    ];
    if let Some(second) = &config.ground.second {
        lines.push(("ground", in_second(&ground(second))));
    }
    let subject = &config.subject;
    let mass = subject.mass_kg.map_or_else(|| "weighed by the plate".to_owned(), |kg| format!("{kg} kg"));
    lines.push(("subject", format!("{}, {} m, {mass}", subject.id, subject.height_m)));
    let model = config.loaded_model.as_ref().map(LoadedModel::describe);
    let model = model.as_deref().map_or("none", |text| text.strip_prefix("model ").unwrap_or(text));
    lines.push(("model", model.to_owned()));
    if let Some(page) = &config.page {
        lines.push(("page", format!("{} (`equipoise view`)", page.listen)));
    }
    if let Some(metrics) = &config.metrics {
        lines.push(("metrics", metrics.listen.to_string()));
    }
    if let Some(recording) = &config.recording {
        lines.push(("recordings", format!("{} (`equipoise record`)", recording.directory.display())));
    }
    let gateways = config.gateways.addresses();
    if gateways.is_empty() {
        lines.push(("gateway", "none".to_owned()));
    }
    lines.extend(gateways.into_iter().map(|(kind, addresses)| ("gateway", format!("{kind}, {addresses}"))));
    lines
}

fn suit(config: &Config) -> String {
    let suit = &config.suit;
    match suit.source {
        SuitSourceKind::External => EXTERNAL.to_owned(),
        source => format!("{}, suit.listen = {}", key_value(source), suit.listen),
    }
}

fn ground(ground: &GroundConfig) -> String {
    match ground.source {
        GroundSourceKind::External => EXTERNAL.to_owned(),
        source => format!("{}, {}", key_value(source), ground.own_location()),
    }
}

/// A source without an address in this configuration.
const EXTERNAL: &str = "external, published by another process";

/// The value as in the configuration file.
fn key_value(value: impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|value| Some(value.as_str()?.to_owned())).unwrap_or_default()
}

/// The stored subject on which the prior is based, if the configuration requests one.
fn prior(config: &Config) -> anyhow::Result<Option<(&'static str, String)>> {
    let settings = config.settings();
    if settings.prior != PriorKind::SimilarSubject {
        return Ok(None);
    }
    let state = StateDirectory::of_station(&config.station)?;
    let chosen = similar::choose(&config.subject.id, &settings, &state).with_context(|| {
        format!("identification.prior = \"similar-subject\" needs to read {}", state.profiles().display())
    })?;
    Ok(Some(("prior", similar::describe(chosen.as_ref()))))
}
