//! `equipoise check`: validates a configuration, and prints what will run with it.

use std::path::{Path, PathBuf};

use anyhow::Context;
use equipoise_config::ground::GroundConfig;
use equipoise_config::ground::second::in_second;
use equipoise_config::{Config, GroundSourceKind, LoadedModel, SuitSourceKind, sensor_network};
use equipoise_core::cycle::PriorKind;
use equipoise_daemon::similar;
use equipoise_files::secret::SecretError;
use equipoise_recording::record::service::signing_key;
use equipoise_station::state_directory::StateDirectory;
use serde::Serialize;

use super::{Outcome, log_to_stderr};
use crate::page_tokens::PageTokens;

/// Check a configuration file, the model that it names, and the files with the page's tokens and the recordings' key
///
/// Prints OK and what runs with this file: rate, sensors with their addresses, subject, model, page, gateways.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: sudo -u equipoise equipoise check /etc/equipoise/equipoise.toml")]
pub(super) struct Arguments {
    /// Configuration file
    file: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    log_to_stderr("warn");
    let config = Config::read(&arguments.file)?;
    let note = check_secrets(&config, &arguments.file, rustix::process::geteuid().is_root())?;
    let prior = prior(&config)?;
    println!("{}: OK", arguments.file.display());
    for (name, value) in summary(&config).into_iter().chain(prior) {
        println!("  {name:<10} {value}");
    }
    for note in sensor_network::notes(&config).into_iter().chain(note) {
        println!("{note}");
    }
    Ok(Outcome::Done)
}

/// Checks the files with the page's tokens and the recordings' key; `file` is the configuration. Root can read every
/// file, the service's user only its own: as root the owner is not checked, which the returned note says.
fn check_secrets(config: &Config, file: &Path, is_root: bool) -> anyhow::Result<Option<String>> {
    let base = file.parent().unwrap_or(Path::new(""));
    let (page, recording) = (config.page.as_ref(), config.recording.as_ref());
    let tokens = page.map_or(Ok(()), |page| PageTokens::read(page, base).map(drop));
    let key = recording.map_or(Ok(()), |recording| signing_key(recording, base).map(drop));
    let is_of_other = |error: &anyhow::Error| {
        let mut secrets = error.chain().filter_map(|cause| cause.downcast_ref::<SecretError>());
        secrets.any(|secret| matches!(secret, SecretError::Owner { .. }))
    };
    for outcome in [tokens, key] {
        match outcome {
            Err(error) if is_root && is_of_other(&error) => {}
            outcome => outcome?,
        }
    }
    let keys = [
        ("page.token_file", page.is_some_and(|page| page.token_file.is_some())),
        ("page.command_token_file", page.is_some_and(|page| page.command_token_file.is_some())),
        ("recording.sign_key", recording.is_some_and(|recording| recording.sign_key.is_some())),
    ];
    let keys: Vec<&str> = keys.into_iter().filter_map(|(key, is_given)| is_given.then_some(key)).collect();
    Ok((is_root && !keys.is_empty()).then(|| {
        format!(
            "not checked, since root can read every file: the owner of {}. Run this as the service's user: `sudo -u \
             equipoise equipoise check {}`",
            keys.join(", "),
            file.display()
        )
    }))
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

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt, chown};

    use super::*;

    #[test]
    fn root_does_not_decide_whether_the_service_can_read_a_secret() {
        let folder = tempfile::tempdir().unwrap();
        let (file, token) = (folder.path().join("c.toml"), folder.path().join("page.token"));
        let text = "station = \"s\"\n[suit]\nsource = \"external\"\n[ground]\nsource = \
                    \"external\"\n[subject]\nid = \"a\"\nheight_m = 1.7\n";
        let page = "[page]\nlisten = \"127.0.0.1:1\"\ntoken_file = \"page.token\"\n";
        let [with, without] =
            [format!("{text}{page}"), text.to_owned()].map(|text| Config::parse(&text, "c").unwrap());
        std::fs::write(&token, "a".repeat(64)).unwrap();
        let set_mode =
            |mode| std::fs::set_permissions(&token, std::fs::Permissions::from_mode(mode)).unwrap();
        set_mode(0o640);
        assert_eq!(check_secrets(&with, &file, false).unwrap(), None);
        assert_eq!(check_secrets(&without, &file, true).unwrap(), None);
        let note = check_secrets(&with, &file, true).unwrap().expect("a note");
        let command = format!("`sudo -u equipoise equipoise check {}`", file.display());
        assert!(note.contains("page.token_file") && note.contains(&command), "{note}");
        // Only root can give a file to the service's user.
        if chown(&token, Some(12_345), None).is_ok() {
            assert!(check_secrets(&with, &file, false).is_err());
            assert_eq!(check_secrets(&with, &file, true).unwrap(), Some(note));
        }
        set_mode(0o644);
        assert!(check_secrets(&with, &file, true).is_err() && check_secrets(&with, &file, false).is_err());
    }
}
