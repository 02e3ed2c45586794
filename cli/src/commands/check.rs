//! `equipoise check`: validates a configuration, and prints what will run with it.

use std::path::{Path, PathBuf};

use anyhow::Context;
use equipoise_config::ground::GroundConfig;
use equipoise_config::ground::second::in_second;
use equipoise_config::{Config, GroundSourceKind, LoadedModel, SuitSourceKind, unit_network};
use equipoise_core::cycle::PriorKind;
use equipoise_daemon::similar;
use equipoise_files::secret::{self, SecretError};
use equipoise_recording::record::service::signing_key;
use equipoise_station::state_directory::StateDirectory;
use serde::Serialize;

use super::{Outcome, log_to_stderr};
use crate::page_tokens::PageTokens;

/// Check a configuration file, the model that it names, and the files with tokens, keys and passwords
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
    let secrets = check_secrets(&config, &arguments.file, Reader::this_process())?;
    let prior = prior(&config)?;
    println!("{}: OK", arguments.file.display());
    for (name, value) in summary(&config).into_iter().chain(prior) {
        println!("  {name:<10} {value}");
    }
    for note in unit_network::notes(&config).into_iter().chain(secrets) {
        println!("{note}");
    }
    Ok(Outcome::Done)
}

/// User and group of a process that reads secrets.
#[derive(Debug, Clone, Copy)]
struct Reader {
    /// Root can read every file, the service's user only its own.
    is_root: bool,
    group: u32,
}

impl Reader {
    fn this_process() -> Reader {
        Reader { is_root: rustix::process::geteuid().is_root(), group: rustix::process::getegid().as_raw() }
    }
}

/// Checks all files with secrets: the page's tokens, the recordings' key, passwords and keys of gateways. `file` is the
/// configuration. Returns notes; as root owner and group are not checked, which a note says.
fn check_secrets(config: &Config, file: &Path, reader: Reader) -> anyhow::Result<Vec<String>> {
    let base = file.parent().unwrap_or(Path::new(""));
    let (page, recording) = (config.page.as_ref(), config.recording.as_ref());
    let mut outcomes = vec![
        page.map_or(Ok(()), |page| PageTokens::read(page, base).map(drop)),
        recording.map_or(Ok(()), |recording| signing_key(recording, base).map(drop)),
    ];
    let gateways = config.gateways.secrets();
    outcomes.extend(gateways.iter().map(|secret| secret.check(base).context(secret.key)));
    let is_of_other = |error: &anyhow::Error| {
        let mut secrets = error.chain().filter_map(|cause| cause.downcast_ref::<SecretError>());
        secrets.any(|secret| matches!(secret, SecretError::Owner { .. }))
    };
    for outcome in outcomes {
        match outcome {
            Err(error) if reader.is_root && is_of_other(&error) => {}
            outcome => outcome?,
        }
    }
    let tokens = [
        ("page.token_file", page.and_then(|page| page.token_file.as_deref())),
        ("page.command_token_file", page.and_then(|page| page.command_token_file.as_deref())),
    ];
    let tokens = tokens.into_iter().filter_map(|(key, path)| Some((key, path?)));
    if reader.is_root {
        let signing =
            recording.and_then(|recording| recording.sign_key.as_ref()).map(|_| "recording.sign_key");
        let others = gateways.iter().map(|secret| secret.key);
        let keys: Vec<&str> = tokens.map(|(key, _)| key).chain(signing).chain(others).collect();
        return Ok(if keys.is_empty() { Vec::new() } else { vec![not_checked_as_root(&keys, file)] });
    }
    Ok(tokens.filter_map(|(key, path)| readable_by_other_group(key, &base.join(path), reader)).collect())
}

fn not_checked_as_root(keys: &[&str], file: &Path) -> String {
    format!(
        "not checked, since root can read every file: owner and group of {}. Run this as the service's user: `sudo -u \
         equipoise equipoise check {}`",
        keys.join(", "),
        file.display()
    )
}

/// A warning if the members of another group than the reader's can read a token: its mode may be 0640, so that root can
/// own the file that the service's group reads.
fn readable_by_other_group(key: &str, path: &Path, reader: Reader) -> Option<String> {
    // A file that cannot be opened was refused before.
    let group = secret::group_of_readers(path).ok()??;
    (group != reader.group).then(|| {
        let (path, own) = (path.display(), reader.group);
        format!(
            "{key}: group {group} can read {path}, and this user's group is {own}: chgrp {own} {path}, or chmod 0600 \
             {path}"
        )
    })
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

    const SERVICE: Reader = Reader { is_root: false, group: 0 };
    const ROOT: Reader = Reader { is_root: true, group: 0 };

    fn config(sections: &str) -> Config {
        let text = "station = \"s\"\n[suit]\nsource = \"external\"\n[ground]\nsource = \
                    \"external\"\n[subject]\nid = \"a\"\nheight_m = 1.7\n";
        Config::parse(&format!("{text}{sections}"), "c").unwrap()
    }

    fn write(path: &Path, text: &str, mode: u32) {
        std::fs::write(path, text).unwrap();
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
    }

    #[test]
    fn root_does_not_decide_whether_the_service_can_read_a_secret() {
        let folder = tempfile::tempdir().unwrap();
        let (file, token) = (folder.path().join("c.toml"), folder.path().join("page.token"));
        let page = "[page]\nlisten = \"127.0.0.1:1\"\ntoken_file = \"page.token\"\n";
        let [with, without] = [config(page), config("")];
        write(&token, &"a".repeat(64), 0o640);
        let service = Reader { group: secret::group_of_readers(&token).unwrap().unwrap(), ..SERVICE };
        assert_eq!(check_secrets(&with, &file, service).unwrap(), [""; 0]);
        assert_eq!(check_secrets(&without, &file, ROOT).unwrap(), [""; 0]);
        let notes = check_secrets(&with, &file, ROOT).unwrap();
        let command = format!("`sudo -u equipoise equipoise check {}`", file.display());
        assert!(notes.len() == 1 && notes[0].contains("page.token_file"), "{notes:?}");
        assert!(notes[0].contains(&command), "{notes:?}");
        // Only root can give a file to the service's user.
        if chown(&token, Some(12_345), None).is_ok() {
            assert!(check_secrets(&with, &file, service).is_err());
            assert_eq!(check_secrets(&with, &file, ROOT).unwrap(), notes);
        }
        write(&token, &"a".repeat(64), 0o644);
        assert!(check_secrets(&with, &file, ROOT).is_err() && check_secrets(&with, &file, service).is_err());
    }

    #[test]
    fn a_token_that_another_group_can_read_is_reported() {
        let folder = tempfile::tempdir().unwrap();
        let (file, token) = (folder.path().join("c.toml"), folder.path().join("page.token"));
        let with = config("[page]\nlisten = \"127.0.0.1:1\"\ntoken_file = \"page.token\"\n");
        write(&token, &"a".repeat(64), 0o640);
        let group = secret::group_of_readers(&token).unwrap().unwrap();
        let other = Reader { group: group + 1, ..SERVICE };
        let notes = check_secrets(&with, &file, other).unwrap();
        let expected = format!("page.token_file: group {group} can read");
        assert!(notes.len() == 1 && notes[0].starts_with(&expected), "{notes:?}");
        write(&token, &"a".repeat(64), 0o600);
        assert_eq!(check_secrets(&with, &file, other).unwrap(), [""; 0]);
    }

    #[test]
    fn secrets_of_gateways_are_checked_as_the_gateways_read_them() {
        let folder = tempfile::tempdir().unwrap();
        let (file, secret) = (folder.path().join("c.toml"), folder.path().join("secret"));
        let sections = [
            (
                "gateways.opcua.users_file",
                "[gateways.opcua]\nlisten = \"127.0.0.1:4840\"\nusers_file = \"secret\"\n",
            ),
            (
                "gateways.mqtt.password_file",
                "[gateways.mqtt]\nbroker = \"127.0.0.1\"\npassword_file = \"secret\"\n",
            ),
            (
                "gateways.mqtt.key_file",
                "[gateways.mqtt]\nbroker = \"b\"\nca_file = \"ca\"\ncertificate_file = \"own\"\nkey_file = \
                 \"secret\"\n",
            ),
            ("gateways.zenoh.file", "[gateways.zenoh]\nfile = \"secret\"\n"),
        ];
        for (key, section) in sections {
            let config = config(section);
            let refusal = || format!("{:#}", check_secrets(&config, &file, SERVICE).unwrap_err());
            let _ = std::fs::remove_file(&secret);
            assert!(refusal().starts_with(key) && refusal().contains("cannot read"), "{}", refusal());
            write(&secret, "plc:x\n", 0o640);
            assert!(refusal().starts_with(key) && refusal().contains("chmod 0600"), "{}", refusal());
            write(&secret, "plc:x\n", 0o600);
            assert_eq!(check_secrets(&config, &file, SERVICE).unwrap(), [""; 0], "{key}");
            assert!(check_secrets(&config, &file, ROOT).unwrap()[0].contains(key));
        }
    }
}
