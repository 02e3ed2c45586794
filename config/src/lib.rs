//! The configuration file: keys, permitted values and error messages.

pub mod gateways;
pub mod ground;
mod latencies;
mod live;
mod message;
pub mod method;
pub mod model;
pub mod model_file;
pub mod overload;
mod ports;
mod recording;
mod remedy;
mod renamed;
pub mod similar;
pub mod suit;
pub mod unit_network;

use std::borrow::Cow;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use equipoise_core::cycle::Settings;
use equipoise_files::{TEXT_BYTES_MAX, read_text};
use serde::{Deserialize, Serialize};

use model_file::{Ask, ModelFileError};

pub use gateways::GatewaysConfig;
pub use ground::{GroundConfig, GroundSourceKind};
pub use method::{IdentificationConfig, StaticPoseConfig, SubjectConfig};
pub use model::LoadedModel;
pub use overload::OverloadConfig;
pub use recording::RecordingConfig;
pub use renamed::renamed_keys;
pub use suit::{SuitConfig, SuitPosition, SuitSourceKind};

/// A configuration file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Name of the station; several stations may run on one PC.
    pub station: String,
    /// The loop.
    #[serde(default, rename = "loop")]
    pub tick: LoopConfig,
    /// The suit.
    pub suit: SuitConfig,
    /// The force plate.
    pub ground: GroundConfig,
    /// The subject.
    pub subject: SubjectConfig,
    /// Identification of the subject.
    #[serde(default)]
    pub identification: IdentificationConfig,
    /// Thresholds of a static pose.
    #[serde(default)]
    pub static_pose: StaticPoseConfig,
    /// Overload reporting.
    #[serde(default)]
    pub overload: OverloadConfig,
    /// Model file with effects in addition to the body; none without this section.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<ModelConfig>,
    /// The page served by `equipoise view`; none without this section.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub page: Option<PageConfig>,
    /// Metrics for Prometheus; not served without this section.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metrics: Option<MetricsConfig>,
    /// Latency figures.
    #[serde(default)]
    pub latency: LatencyConfig,
    /// Recordings of `equipoise record --config` and their retention; required for that command.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<RecordingConfig>,
    /// Data sent to other machines by `equipoise gateway`; nothing without a section.
    #[serde(default, alias = "outlets", skip_serializing_if = "GatewaysConfig::is_empty")]
    pub gateways: GatewaysConfig,
    /// The loaded model file of `[model]`; not a key.
    #[serde(skip)]
    pub loaded_model: Option<LoadedModel>,
    /// Sensors and metrics are separate processes that read the same file; not a key, but `run --sensors-apart`.
    #[serde(skip)]
    pub sensors_apart: bool,
}

/// `[loop]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LoopConfig {
    /// Cycles per second, 100 to 4000.
    pub rate_hz: u32,
    /// SCHED_FIFO priority of the loop, 1 to 90; 0 for none.
    pub priority: u32,
    /// Core to which the loop and egress are pinned.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cpu: Option<usize>,
    /// Ingress and egress poll without sleeping. Costs two cores in addition to the loop's.
    pub busy_poll: bool,
    /// Lock all memory.
    pub lock_memory: bool,
    /// Refuse to run unless all requested scheduling is granted.
    pub strict: bool,
}

impl Default for LoopConfig {
    fn default() -> Self {
        LoopConfig {
            rate_hz: 1000,
            priority: 80,
            cpu: None,
            busy_poll: false,
            lock_memory: true,
            strict: false,
        }
    }
}

/// `[model]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// A model file of `equipoise reconcile`; a relative path refers to the configuration's folder.
    pub file: PathBuf,
}

/// `[page]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PageConfig {
    /// Listening address of the page; on loopback, or with a token.
    pub listen: SocketAddr,
    /// File with the token that every request requires; a relative path refers to the configuration's folder. The token
    /// itself is never part of a configuration, which recordings contain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub token_file: Option<PathBuf>,
    /// File with the token that every command of the engineer's page requires; without it the page accepts no commands.
    /// Same form as `token_file`; give it to fewer people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub command_token_file: Option<PathBuf>,
    /// The report.html that `equipoise reconcile --out` wrote, to which the engineer's page links.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub report: Option<PathBuf>,
}

/// `[metrics]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MetricsConfig {
    /// Loopback address for `GET /metrics`.
    pub listen: SocketAddr,
}

/// `[latency]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LatencyConfig {
    /// Interval log in the HdrHistogram format: one entry per stage every ten seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hlog: Option<PathBuf>,
    /// Cycles stored before each missed deadline, and a quarter as many after it, 0 to 2048; 0 stores none.
    pub flight_cycles: u32,
}

impl Default for LatencyConfig {
    fn default() -> Self {
        LatencyConfig { hlog: None, flight_cycles: 256 }
    }
}

/// A configuration cannot be used. The text names file, line, field and remedy.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the configuration {path}: {source}; {}", remedy::remedy(path, source))]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The content is invalid.
    #[error("{place}: {what}")]
    Invalid {
        /// File, and line if available.
        place: String,
        /// Description and remedy.
        what: String,
    },
    /// The configured model file cannot be used.
    #[error("[model] file: {0}")]
    Model(#[from] ModelFileError),
}

impl Config {
    /// Reads and checks a file and its model file. Logs a warning for each key of the previous release.
    ///
    /// # Errors
    /// [`ConfigError`], with a text for the author of the file.
    pub fn read(path: &Path) -> Result<Config, ConfigError> {
        let mut config = Config::read_without_model(path)?;
        if let Some(model) = &config.model {
            let folder = path.parent().unwrap_or(Path::new(""));
            config.loaded_model = Some(LoadedModel::read(&folder.join(&model.file))?);
        }
        Ok(config)
    }

    /// As [`Config::read`], for a process that does not use the model file and need not have access to it.
    ///
    /// # Errors
    /// As [`Config::read`].
    pub fn read_without_model(path: &Path) -> Result<Config, ConfigError> {
        let (config, warnings) = Config::read_with_warnings(path)?;
        for warning in warnings {
            tracing::warn!("{warning}");
        }
        Ok(config)
    }

    /// As [`Config::read_without_model`], for repeated reads: returns the warnings instead of logging them.
    ///
    /// # Errors
    /// As [`Config::read`].
    pub fn read_with_warnings(path: &Path) -> Result<(Config, Vec<String>), ConfigError> {
        let text = read_text(path, TEXT_BYTES_MAX)
            .map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        let config = Config::parse(&text, &path.display().to_string())?;
        let keys = renamed_keys(&text);
        Ok((config, keys.into_iter().map(|sentence| format!("{}: {sentence}", path.display())).collect()))
    }

    /// Parses and checks a text; `name` is its name in errors. The model file is not read.
    ///
    /// # Errors
    /// As [`Config::read`].
    pub fn parse(text: &str, name: &str) -> Result<Config, ConfigError> {
        let config: Config = toml::from_str(text).map_err(|error| message::explain(&error, text, name))?;
        config.check().map_err(|(field, what)| ConfigError::Invalid {
            place: message::location_of(&field, text, name),
            what: format!("{field}: {what}"),
        })?;
        config.ground.check_description().map_err(|error| ConfigError::Invalid {
            place: message::location_of_error(&error, text, name),
            what: format!("{}: {}", error.key, error.what),
        })?;
        Ok(config)
    }

    /// Rules that single values cannot express; the error names the field.
    fn check(&self) -> Result<(), ground::InvalidField> {
        self.ground.check_second()?;
        self.check_parts().map_err(|(field, what)| (Cow::Borrowed(field), what))?;
        ports::check(self)
    }

    fn check_parts(&self) -> method::Checked {
        if !name_is_plain(&self.station) {
            return Err(("station", "use 1 to 32 letters, digits, '-' or '_'".to_owned()));
        }
        if !name_is_plain(&self.subject.id) {
            return Err(("subject.id", "use 1 to 32 letters, digits, '-' or '_'; no real name".to_owned()));
        }
        method::between("loop.rate_hz", f64::from(self.tick.rate_hz), 100.0, 4000.0)?;
        method::between("loop.priority", f64::from(self.tick.priority), 0.0, 90.0)?;
        method::between("latency.flight_cycles", f64::from(self.latency.flight_cycles), 0.0, 2048.0)?;
        self.suit.check()?;
        self.suit.check_others(&self.station)?;
        self.ground.check()?;
        self.subject.check()?;
        self.identification.check()?;
        self.static_pose.check()?;
        self.overload.check()?;
        latencies::check(&self.suit, &self.ground, &self.overload)?;
        self.gateways.check()?;
        self.recording.as_ref().map_or(Ok(()), RecordingConfig::check)?;
        let open = |page: &PageConfig| !page.listen.ip().is_loopback() && page.token_file.is_none();
        if self.page.as_ref().is_some_and(open) {
            return Err((
                "page.listen",
                "without a token the page is served on loopback only, for example 127.0.0.1:8080; reach it from \
                 elsewhere through an SSH tunnel, or set page.token_file (`equipoise token --out FILE` makes one)"
                    .to_owned(),
            ));
        }
        if self.metrics.as_ref().is_some_and(|metrics| !metrics.listen.ip().is_loopback()) {
            return Err((
                "metrics.listen",
                "metrics are served on loopback only, for example 127.0.0.1:9187; a Prometheus elsewhere asks through \
                 an agent on this machine, or an SSH tunnel"
                    .to_owned(),
            ));
        }
        Ok(())
    }

    /// The settings of the cycle.
    pub fn settings(&self) -> Settings {
        let mut settings = Settings {
            library: equipoise_core::pose_suggestion::library::LIBRARY,
            ..Settings::for_height(self.subject.height_m)
        };
        settings.suit_drifts = self.suit.position != Some(SuitPosition::Absolute);
        self.suit.apply(&mut settings);
        self.ground.apply(&mut settings);
        self.subject.apply(&mut settings);
        self.identification.apply(&mut settings);
        self.static_pose.apply(&mut settings);
        self.overload.apply(&mut settings);
        if let Some(loaded) = &self.loaded_model {
            settings.model = loaded.model();
            settings.pose_requests = loaded.file().ask.as_ref().map(Ask::pose_requests).unwrap_or_default();
        }
        settings
    }

    /// The configuration as TOML, defaults included, as stored in recordings.
    pub fn to_toml(&self) -> String {
        // Every value has a TOML form: numbers, strings, tables.
        toml::to_string_pretty(self).unwrap_or_default()
    }

    /// For recordings: without page, metrics and gateways, which a replay does not use and whose addresses may
    /// contain names of hosts, and without the folders of files and ports, which may contain names of persons.
    pub fn for_recording(mut self) -> Config {
        let name_of = |path: &Path| path.file_name().map_or_else(PathBuf::new, PathBuf::from);
        (self.page, self.metrics, self.gateways) = (None, None, GatewaysConfig::default());
        if let Some(model) = &mut self.model {
            model.file = name_of(&model.file);
        }
        let GroundConfig { file, serial, second, .. } = &mut self.ground;
        let second = second.as_deref_mut();
        let (second_file, second_serial) =
            second.map_or((None, None), |of| (of.file.as_mut(), of.serial.as_mut()));
        for file in file.iter_mut().chain(second_file) {
            file.path = name_of(&file.path);
        }
        let mut first = None;
        for serial in serial.iter_mut().chain(second_serial) {
            let mut name = name_of(&serial.port).into_os_string();
            if first.as_ref() == Some(&name) {
                name.push("-2");
            }
            // The path of a port must be absolute.
            serial.port = Path::new("/").join(&name);
            first = Some(name);
        }
        self.latency.hlog = self.latency.hlog.as_deref().map(name_of);
        if let Some(recording) = &mut self.recording {
            recording.directory = name_of(&recording.directory);
            recording.sign_key = recording.sign_key.as_deref().map(name_of);
        }
        self
    }

    /// The text of the active model, as stored in recordings; empty without one.
    pub fn model_toml(&self) -> String {
        self.loaded_model.as_ref().map(|model| model.text.clone()).unwrap_or_default()
    }

    /// Whether the daemon reads the suit itself.
    pub fn reads_suit(&self) -> bool {
        !self.sensors_apart && self.suit.source != SuitSourceKind::External
    }

    /// Whether the daemon reads the ground itself.
    pub fn reads_ground(&self) -> bool {
        !self.sensors_apart && self.ground.source != GroundSourceKind::External
    }

    /// Wait strategy of ingress and egress.
    pub fn wait_strategy(&self) -> WaitStrategy {
        if self.tick.busy_poll { WaitStrategy::Polling } else { WaitStrategy::Sleeping }
    }

    /// Length of one cycle.
    pub fn period_ns(&self) -> u64 {
        equipoise_core::time::NS_PER_S / u64::from(self.tick.rate_hz)
    }
}

/// How a thread waits for another thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WaitStrategy {
    /// Sleep until woken.
    Sleeping,
    /// Poll, which uses a full core and avoids the wake-up latency.
    Polling,
}

/// Whether a name is valid for a station or a subject.
fn name_is_plain(name: &str) -> bool {
    (1..=32).contains(&name.len()) && is_plain(name)
}

/// Whether a name consists of letters, digits, '-' and '_', so that it is a valid file name and not a path.
pub fn is_plain(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_')
}

#[cfg(test)]
mod tests;
