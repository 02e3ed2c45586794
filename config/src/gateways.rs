//! `[gateways]`: one section per gateway; a gateway without a section does not run.

mod foxglove;
mod mqtt;
mod opcua;
mod rtde;
mod rtde_values;
mod udp;
mod zenoh;

use std::net::IpAddr;
use std::path::{Path, PathBuf};

use equipoise_files::secret::{self, SecretError};
use equipoise_files::{TEXT_BYTES_MAX, read_text};
use serde::{Deserialize, Serialize};

pub use foxglove::FoxgloveConfig;
pub use mqtt::MqttConfig;
pub use opcua::OpcUaConfig;
pub use rtde::RtdeConfig;
pub use rtde_values::{Register, Value, rtde_values};
pub use udp::UdpConfig;
pub use zenoh::ZenohConfig;

use super::remedy::remedy;

/// Ok, or the key with an invalid value, and the remedy.
pub type Checked = Result<(), (&'static str, String)>;

/// `[gateways]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GatewaysConfig {
    /// Datagrams of fixed layout to controllers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub udp: Option<UdpConfig>,
    /// Input registers of a Universal Robots controller.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rtde: Option<RtdeConfig>,
    /// A server for PLCs and MES.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub opcua: Option<OpcUaConfig>,
    /// Levels and counts to an MQTT broker.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mqtt: Option<MqttConfig>,
    /// Other machines, and ROS 2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zenoh: Option<ZenohConfig>,
    /// Live scenes for Foxglove and Lichtblick.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub foxglove: Option<FoxgloveConfig>,
}

/// A file with a secret.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SecretFile<'a> {
    /// The key that names it.
    pub key: &'static str,
    /// The path as configured.
    pub path: &'a Path,
    /// Whether its lines are `name:password`.
    has_logins: bool,
}

impl SecretFile<'_> {
    /// Reads the file as its gateway does; a relative path refers to the folder `base`.
    ///
    /// # Errors
    /// Why the gateway rejects it.
    pub fn check(&self, base: &Path) -> Result<(), SecretError> {
        let path = base.join(self.path);
        if self.has_logins { secret::logins(&path).map(drop) } else { secret::read(&path).map(drop) }
    }
}

impl GatewaysConfig {
    /// Files with passwords and private keys. Those that Zenoh's own file names are not among them.
    pub fn secrets(&self) -> Vec<SecretFile<'_>> {
        let (opcua, mqtt) = (self.opcua.as_ref(), self.mqtt.as_ref());
        let users = opcua.and_then(|opcua| opcua.users_file.as_deref());
        let password = mqtt.and_then(|mqtt| mqtt.password_file.as_deref());
        let key = mqtt.and_then(|mqtt| mqtt.key_file.as_deref());
        let zenoh = self.zenoh.as_ref().and_then(|zenoh| zenoh.file.as_deref());
        let all = [
            ("gateways.opcua.users_file", users, true),
            ("gateways.mqtt.password_file", password, true),
            ("gateways.mqtt.key_file", key, false),
            ("gateways.zenoh.file", zenoh, false),
        ];
        let named = all.into_iter().filter_map(|(key, path, has_logins)| Some((key, path?, has_logins)));
        named.map(|(key, path, has_logins)| SecretFile { key, path, has_logins }).collect()
    }

    /// Rules that types cannot express.
    ///
    /// # Errors
    /// The first key whose value cannot be used.
    pub fn check(&self) -> Checked {
        self.udp.as_ref().map_or(Ok(()), UdpConfig::check)?;
        self.rtde.as_ref().map_or(Ok(()), RtdeConfig::check)?;
        self.opcua.as_ref().map_or(Ok(()), OpcUaConfig::check)?;
        self.mqtt.as_ref().map_or(Ok(()), MqttConfig::check)?;
        self.zenoh.as_ref().map_or(Ok(()), ZenohConfig::check)?;
        self.foxglove.as_ref().map_or(Ok(()), FoxgloveConfig::check)
    }

    /// Each gateway that has a section: its name, and the addresses to which it sends or on which it listens.
    pub fn addresses(&self) -> Vec<(&'static str, String)> {
        let all = [
            ("udp", self.udp.as_ref().map(|udp| list(&udp.to))),
            ("rtde", self.rtde.as_ref().map(|rtde| rtde.robot.to_string())),
            ("opcua", self.opcua.as_ref().map(|opcua| opcua.listen.to_string())),
            ("mqtt", self.mqtt.as_ref().map(|mqtt| format!("{}:{}", mqtt.broker, mqtt.port()))),
            ("zenoh", self.zenoh.as_ref().map(|zenoh| list(&[&zenoh.connect[..], &zenoh.listen].concat()))),
            ("foxglove", self.foxglove.as_ref().map(|foxglove| foxglove.listen.to_string())),
        ];
        all.into_iter().filter_map(|(kind, addresses)| Some((kind, addresses?))).collect()
    }

    /// Whether no gateway is configured.
    pub fn is_empty(&self) -> bool {
        *self == GatewaysConfig::default()
    }

    fn each_path(&mut self, mut change: impl FnMut(&mut PathBuf)) {
        let opcua = self.opcua.iter_mut().flat_map(OpcUaConfig::paths);
        let mqtt = self.mqtt.iter_mut().flat_map(MqttConfig::paths);
        let zenoh = self.zenoh.iter_mut().flat_map(ZenohConfig::paths);
        opcua.chain(mqtt).chain(zenoh).flatten().for_each(&mut change);
    }
}

/// The part of the station's configuration file that a gateway reads; `equipoise check` checks the complete file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct StationFile {
    /// Name of the station.
    pub station: String,
    /// The gateways; `outlets` is the name of the previous release.
    #[serde(default, alias = "outlets")]
    pub gateways: GatewaysConfig,
}

/// A configuration cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StationFileError {
    /// The file cannot be read.
    #[error("cannot read the configuration {path}: {source}; {}", remedy(path, source))]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The content is invalid.
    #[error("{path}: {what}; run `equipoise check {path}` for details")]
    Wrong {
        /// Path of the file.
        path: PathBuf,
        /// Description and remedy.
        what: String,
    },
}

impl StationFile {
    /// Reads a file and checks its `[gateways]`. Relative paths in it refer to the file's folder.
    ///
    /// # Errors
    /// [`StationFileError`], with a text for the author of the file.
    pub fn read(path: &Path) -> Result<StationFile, StationFileError> {
        let text = read_text(path, TEXT_BYTES_MAX)
            .map_err(|source| StationFileError::Read { path: path.to_owned(), source })?;
        let wrong = |what: String| StationFileError::Wrong { path: path.to_owned(), what };
        let mut file: StationFile =
            toml::from_str(&text).map_err(|error| wrong(error.message().to_owned()))?;
        file.gateways.check().map_err(|(key, what)| wrong(format!("{key}: {what}")))?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        file.gateways.each_path(|path| *path = folder.join(&*path));
        Ok(file)
    }
}

fn list(addresses: &[impl ToString]) -> String {
    addresses.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// Whether a text is a host name or an address alone: without scheme, port and path.
fn is_host(text: &str) -> bool {
    let plain = |letter: char| letter.is_ascii_alphanumeric() || ".-:_".contains(letter);
    // Only an address of IPv6 has colons; others come before a port.
    let has_port = text.contains(':') && text.parse::<IpAddr>().is_err();
    !text.is_empty() && !has_port && text.chars().all(plain)
}

/// A number within bounds.
fn between(key: &'static str, value: f64, least: f64, most: f64) -> Checked {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    // Avoid printing all the digits of a number like 1e300.
    let value = if value.abs() < 1e9 { format!("{value}") } else { format!("{value:?}") };
    Err((key, format!("{value} is not between {least} and {most}")))
}
