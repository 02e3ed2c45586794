//! Station and subjects of a recording.

use equipoise_adapters::recording::RecordingHeader;

/// The station; empty if the configuration does not name it.
pub(crate) fn station(header: &RecordingHeader) -> String {
    text(configuration(header).get("station"))
}

/// Pseudonyms of the recorded profiles, or of the configured subject if the recording has none.
pub(crate) fn subjects(header: &RecordingHeader) -> Vec<String> {
    let configured = text(configuration(header).get("subject").and_then(|subject| subject.get("id")));
    header.subjects(&configured)
}

/// Accepts recordings of any release: only these keys are read.
fn configuration(header: &RecordingHeader) -> toml::Table {
    header.config_toml.parse().unwrap_or_default()
}

fn text(value: Option<&toml::Value>) -> String {
    value.and_then(toml::Value::as_str).unwrap_or_default().to_owned()
}
