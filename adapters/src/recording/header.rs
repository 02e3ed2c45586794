//! Metadata of a recording: software, configuration, subject, model, and start time.

use std::collections::BTreeMap;

use super::channels::shown;

/// Name of the metadata record.
pub(super) const METADATA_NAME: &str = "equipoise.recording";
/// Version of the layout of a recording (messages have versions of their own).
pub(super) const FORMAT: u32 = 1;
/// Media type of the attachments.
pub(super) const TOML_MEDIA_TYPE: &str = "application/toml";

const FORMAT_KEY: &str = "format";
const SOFTWARE_VERSION_KEY: &str = "software_version";
const STARTED_WALL_CLOCK_KEY: &str = "started_unix_ns";
const STARTED_MONOTONIC_KEY: &str = "started_monotonic_ns";
const PREVIOUS_FILE_KEY: &str = "previous_file";
const PREVIOUS_SHA256_KEY: &str = "previous_sha256";
const CONFIG_NAME: &str = "config.toml";
const SUBJECT_NAME: &str = "subject.toml";
const MODEL_NAME: &str = "model.toml";
const SIMILAR_NAME: &str = "similar.toml";

/// The header of a recording. Contains no names of host or person: the subject has a pseudonym.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RecordingHeader {
    /// The release that recorded, for example `0.1.0`.
    pub software_version: String,
    /// Wall-clock time of the start, ns since 1970 UTC; 0 if unknown (an import).
    pub started_unix_ns: u64,
    /// The same instant on the clock of the log times, CLOCK_MONOTONIC ns.
    pub started_monotonic_ns: u64,
    /// The active configuration, TOML; empty if there was none.
    pub config_toml: String,
    /// The subject's profile, TOML; empty if none was loaded.
    pub subject_toml: String,
    /// The model in use, TOML; empty if none was loaded.
    pub model_toml: String,
    /// Numbers of the similar subject in the prior, TOML, without its name; empty if there is none.
    pub similar_toml: String,
    /// Configurations and models that became active later, by number.
    pub reloads: BTreeMap<u64, Reloaded>,
    /// Profiles of later subjects, TOML, in order.
    pub later_subjects_toml: Vec<String>,
    /// Log times of these profiles, CLOCK_MONOTONIC ns.
    pub later_subjects_ns: Vec<u64>,
    /// The preceding recording, if this one is part of a series.
    pub previous: Option<Predecessor>,
}

/// The preceding recording of a series: the link of a hash chain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Predecessor {
    /// Name of the file, without a folder.
    pub file: String,
    /// SHA-256 of its bytes, 64 lowercase hexadecimal digits.
    pub sha256: String,
}

impl Predecessor {
    /// `None` unless the name is that of a file in the same folder, suitable for display, and the hash has 64 digits.
    fn parse(file: &str, sha256: &str) -> Option<Predecessor> {
        let is_name = !matches!(file, "" | "." | "..") && !file.contains('/') && shown(file) == file;
        let is_digit = |byte: u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
        let is_hash = sha256.len() == 64 && sha256.bytes().all(is_digit);
        (is_name && is_hash).then(|| Predecessor { file: file.to_owned(), sha256: sha256.to_owned() })
    }
}

/// Result of a reload.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Reloaded {
    /// The configuration that became active, TOML.
    pub config_toml: String,
    /// The model that became active, TOML; empty if there was none.
    pub model_toml: String,
    /// The similar subject from then on, as in the header.
    pub similar_toml: String,
}

impl Reloaded {
    /// The texts to attach, by file name; `number` is that of the cycle record.
    pub(super) fn attachments(&self, number: u64) -> [(String, &str); 3] {
        // Without a model an empty one is attached, as the initial model is no longer in use.
        [
            (format!("config.{number}.toml"), &self.config_toml),
            (format!("model.{number}.toml"), &self.model_toml),
            (format!("similar.{number}.toml"), &self.similar_toml),
        ]
    }
}

/// The pseudonym in a subject's profile, TOML.
pub fn pseudonym(profile_toml: &str) -> Option<String> {
    let profile: toml::Table = profile_toml.parse().ok()?;
    profile.get("subject")?.as_str().map(str::to_owned)
}

/// The name of a later subject's attachment.
pub(super) const LATER_SUBJECT_NAME: &str = "subject.later.toml";

impl RecordingHeader {
    /// The pseudonyms of all subjects, in order, each once, from the profiles. `configured` is used only if the
    /// recording began without a profile.
    pub fn subjects(&self, configured: &str) -> Vec<String> {
        let first = pseudonym(&self.subject_toml).unwrap_or_else(|| configured.to_owned());
        let later = self.later_subjects_toml.iter().filter_map(|text| pseudonym(text));
        let mut all = Vec::new();
        for id in std::iter::once(first).chain(later) {
            if !id.is_empty() && !all.contains(&id) {
                all.push(id);
            }
        }
        all
    }

    /// The changes of the subject, in order: log time of the profile, CLOCK_MONOTONIC ns, and the pseudonyms before and
    /// after. A subject without a profile has the name in the recording's configuration.
    pub fn subject_changes(&self) -> Vec<(u64, [String; 2])> {
        let config: toml::Table = self.config_toml.parse().unwrap_or_default();
        let configured = config.get("subject").and_then(|subject| subject.get("id")?.as_str());
        let first = pseudonym(&self.subject_toml).or_else(|| configured.map(str::to_owned));
        let mut last = first.unwrap_or_default();
        let mut changes = Vec::new();
        for (at_ns, text) in self.later_subjects_ns.iter().zip(&self.later_subjects_toml) {
            if let Some(id) = pseudonym(text).filter(|id| *id != last) {
                changes.push((*at_ns, [last, id.clone()]));
                last = id;
            }
        }
        changes
    }

    pub(super) fn metadata(&self) -> BTreeMap<String, String> {
        let mut metadata = BTreeMap::from([
            (FORMAT_KEY.to_owned(), FORMAT.to_string()),
            (SOFTWARE_VERSION_KEY.to_owned(), self.software_version.clone()),
            (STARTED_WALL_CLOCK_KEY.to_owned(), self.started_unix_ns.to_string()),
            (STARTED_MONOTONIC_KEY.to_owned(), self.started_monotonic_ns.to_string()),
        ]);
        if let Some(previous) = &self.previous {
            metadata.insert(PREVIOUS_FILE_KEY.to_owned(), previous.file.clone());
            metadata.insert(PREVIOUS_SHA256_KEY.to_owned(), previous.sha256.clone());
        }
        metadata
    }

    /// The texts to attach, by file name; empty ones are omitted.
    pub(super) fn attachments(&self) -> impl Iterator<Item = (&'static str, &str)> {
        [
            (CONFIG_NAME, self.config_toml.as_str()),
            (SUBJECT_NAME, self.subject_toml.as_str()),
            (MODEL_NAME, self.model_toml.as_str()),
            (SIMILAR_NAME, self.similar_toml.as_str()),
        ]
        .into_iter()
        .filter(|(_, text)| !text.is_empty())
    }

    /// Reads the metadata record; returns the layout's version, `None` if it is not a number.
    pub(super) fn take_metadata(&mut self, metadata: &BTreeMap<String, String>) -> Option<u32> {
        let number = |key: &str| metadata.get(key).and_then(|text| text.parse().ok()).unwrap_or(0);
        let version = metadata.get(SOFTWARE_VERSION_KEY).map(String::as_str).unwrap_or_default();
        self.software_version = shown(version);
        self.started_unix_ns = number(STARTED_WALL_CLOCK_KEY);
        self.started_monotonic_ns = number(STARTED_MONOTONIC_KEY);
        self.previous = metadata
            .get(PREVIOUS_FILE_KEY)
            .zip(metadata.get(PREVIOUS_SHA256_KEY))
            .and_then(|(file, sha256)| Predecessor::parse(file, sha256));
        metadata.get(FORMAT_KEY)?.parse().ok()
    }

    /// Reads an attachment; others than Equipoise's are skipped.
    pub(super) fn take_attachment(&mut self, log_time_ns: u64, name: &str, data: &[u8]) {
        let text = String::from_utf8_lossy(data).into_owned();
        let number = |kind: &str| name.strip_prefix(kind)?.strip_suffix(".toml")?.parse::<u64>().ok();
        match name {
            CONFIG_NAME => self.config_toml = text,
            SUBJECT_NAME => self.subject_toml = text,
            MODEL_NAME => self.model_toml = text,
            SIMILAR_NAME => self.similar_toml = text,
            LATER_SUBJECT_NAME => {
                self.later_subjects_toml.push(text);
                self.later_subjects_ns.push(log_time_ns);
            }
            _ => {
                if let Some(number) = number("config.") {
                    self.reloads.entry(number).or_default().config_toml = text;
                } else if let Some(number) = number("model.") {
                    self.reloads.entry(number).or_default().model_toml = text;
                } else if let Some(number) = number("similar.") {
                    self.reloads.entry(number).or_default().similar_toml = text;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_predecessor_is_a_file_of_the_same_folder() {
        let hash = "0a".repeat(32);
        let previous = Predecessor::parse("s.1700000000.mcap", &hash);
        let header = RecordingHeader { previous, ..RecordingHeader::default() };
        assert!(header.previous.is_some());
        let mut read = RecordingHeader::default();
        read.take_metadata(&header.metadata());
        assert_eq!(read.previous, header.previous);
        for (file, hash) in
            [("../a.mcap", &*hash), ("..", &hash), ("a\u{1b}[2J", &hash), ("a.mcap", "0a"), ("", &hash)]
        {
            assert_eq!(Predecessor::parse(file, hash), None, "{file}");
        }
    }

    #[test]
    fn profiles_name_who_was_in_use_and_the_configuration_only_where_there_is_none() {
        let profile = |subject: &str| format!("format = 3\nsubject = \"{subject}\"\n");
        let mut header = RecordingHeader::default();
        assert_eq!(header.subjects("anon-1"), ["anon-1"]);
        assert!(header.subjects("").is_empty());
        header.later_subjects_toml = vec![profile("anon-2"), profile("anon-1"), "no = [table".to_owned()];
        assert_eq!(header.subjects("anon-1"), ["anon-1", "anon-2"]);
        header.subject_toml = profile("anon-3");
        assert_eq!(header.subjects("anon-1"), ["anon-3", "anon-2", "anon-1"]);
    }

    #[test]
    fn a_change_of_the_subject_has_another_pseudonym() {
        let profile = |subject: &str| format!("subject = \"{subject}\"\n");
        let mut header = RecordingHeader {
            config_toml: "[subject]\nid = \"anon-1\"\n".to_owned(),
            later_subjects_toml: ["anon-1", "anon-2", "anon-2", "anon-1"].map(profile).to_vec(),
            later_subjects_ns: vec![10, 20, 30, 40],
            ..RecordingHeader::default()
        };
        let change = |at_ns, ids: [&str; 2]| (at_ns, ids.map(str::to_owned));
        let later = [change(20, ["anon-1", "anon-2"]), change(40, ["anon-2", "anon-1"])];
        assert_eq!(header.subject_changes(), later);
        header.subject_toml = profile("anon-3");
        assert_eq!(header.subject_changes()[0], change(10, ["anon-3", "anon-1"]));
    }
}
