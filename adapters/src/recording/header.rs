//! What a recording says of itself: software, configuration, subject and model, and when it began.

use std::collections::BTreeMap;

/// Name of the metadata record.
pub(super) const METADATA_NAME: &str = "equipoise.recording";
/// Version of how a recording is laid out (not of the messages: these have versions of their own).
pub(super) const FORMAT: u32 = 1;
/// Media type of the attachments.
pub(super) const TOML_MEDIA_TYPE: &str = "application/toml";

const FORMAT_KEY: &str = "format";
const SOFTWARE_VERSION_KEY: &str = "software_version";
const STARTED_WALL_CLOCK_KEY: &str = "started_unix_ns";
const STARTED_MONOTONIC_KEY: &str = "started_monotonic_ns";
const CONFIG_NAME: &str = "config.toml";
const SUBJECT_NAME: &str = "subject.toml";
const MODEL_NAME: &str = "model.toml";

/// The head of a recording. Names neither the host nor the person: the subject bears a pseudonym.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RecordingHeader {
    /// The release that recorded, for example `0.1.0`.
    pub software_version: String,
    /// Wall-clock time of the start, ns since 1970 UTC; 0 if unknown (an import).
    pub started_unix_ns: u64,
    /// The same moment on the clock of the log times, CLOCK_MONOTONIC ns.
    pub started_monotonic_ns: u64,
    /// The configuration in force, TOML; empty if none was.
    pub config_toml: String,
    /// The subject's profile, TOML; empty if none was loaded.
    pub subject_toml: String,
    /// The model in use, TOML; empty if none was loaded.
    pub model_toml: String,
}

impl RecordingHeader {
    pub(super) fn metadata(&self) -> BTreeMap<String, String> {
        BTreeMap::from([
            (FORMAT_KEY.to_owned(), FORMAT.to_string()),
            (SOFTWARE_VERSION_KEY.to_owned(), self.software_version.clone()),
            (STARTED_WALL_CLOCK_KEY.to_owned(), self.started_unix_ns.to_string()),
            (STARTED_MONOTONIC_KEY.to_owned(), self.started_monotonic_ns.to_string()),
        ])
    }

    /// The texts to attach, by file name; empty ones are left out.
    pub(super) fn attachments(&self) -> impl Iterator<Item = (&'static str, &str)> {
        [
            (CONFIG_NAME, self.config_toml.as_str()),
            (SUBJECT_NAME, self.subject_toml.as_str()),
            (MODEL_NAME, self.model_toml.as_str()),
        ]
        .into_iter()
        .filter(|(_, text)| !text.is_empty())
    }

    /// Takes the metadata record in; returns the layout's version, `None` if it is not a number.
    pub(super) fn take_metadata(&mut self, metadata: &BTreeMap<String, String>) -> Option<u32> {
        let number = |key: &str| metadata.get(key).and_then(|text| text.parse().ok()).unwrap_or(0);
        self.software_version = metadata.get(SOFTWARE_VERSION_KEY).cloned().unwrap_or_default();
        self.started_unix_ns = number(STARTED_WALL_CLOCK_KEY);
        self.started_monotonic_ns = number(STARTED_MONOTONIC_KEY);
        metadata.get(FORMAT_KEY)?.parse().ok()
    }

    /// Takes an attachment in; others than ours are passed over.
    pub(super) fn take_attachment(&mut self, name: &str, data: &[u8]) {
        let text = match name {
            CONFIG_NAME => &mut self.config_toml,
            SUBJECT_NAME => &mut self.subject_toml,
            MODEL_NAME => &mut self.model_toml,
            _ => return,
        };
        *text = String::from_utf8_lossy(data).into_owned();
    }
}
