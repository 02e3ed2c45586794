//! The active model file: its effects in the loop, and its description.

use std::borrow::Cow;
use std::path::Path;

use equipoise_core::effect::Model;
use equipoise_core::message::State;
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_files::{TEXT_BYTES_MAX, read_text, sha256_of};

use crate::model_file::{Ask, Fitted, ModelFile, ModelFileError, Spans, turn};

/// A model file in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedModel {
    /// Name for messages: its path, or a reference to the recording that contains it.
    pub name: String,
    /// The file's text, which recordings store.
    pub text: String,
    file: ModelFile,
    spans: Spans,
}

impl LoadedModel {
    /// Reads a model file.
    ///
    /// # Errors
    /// [`ModelFileError`], with a message for the author of the file.
    pub fn read(path: &Path) -> Result<LoadedModel, ModelFileError> {
        let text = read_text(path, TEXT_BYTES_MAX)
            .map_err(|source| ModelFileError::Read { path: path.to_owned(), source })?;
        LoadedModel::parse(text, path.display().to_string())
    }

    /// Parses a text; `name` is its name in messages.
    ///
    /// # Errors
    /// As [`LoadedModel::read`].
    pub fn parse(text: String, name: String) -> Result<LoadedModel, ModelFileError> {
        let file = ModelFile::parse(&text, &name)?;
        Ok(LoadedModel { name, text, file, spans: Spans::OpenEndedForEver })
    }

    /// Applies every effect within its time span if the file was made from this recording, which begins at `begin_ns`,
    /// CLOCK_MONOTONIC.
    ///
    /// # Errors
    /// The recording cannot be read.
    pub fn fit_to(&mut self, recording: &Path, begin_ns: u64) -> std::io::Result<()> {
        let is_origin = self.file.provenance.is_some() && self.file.is_of(&sha256_of(recording)?);
        self.spans = if is_origin { Spans::Hold { begin_ns } } else { Spans::OpenEndedForEver };
        Ok(())
    }

    /// The file with all effects, whether or not they run here.
    pub fn file(&self) -> &ModelFile {
        &self.file
    }

    /// The model that the loop runs.
    pub fn model(&self) -> Model {
        self.file.model(self.spans).0
    }

    /// One sentence on the active and the omitted effects.
    pub fn describe(&self) -> String {
        let (_, left_out) = self.file.model(self.spans);
        let running = self.file.effects.iter().filter(|fitted| !left_out.contains(fitted));
        let names = |all: Vec<String>| if all.is_empty() { "nothing".to_owned() } else { all.join(", ") };
        let mut text = format!("model {}: {}", self.name, names(running.map(Fitted::name).collect()));
        if self.spans != Spans::OpenEndedForEver {
            text += ", each in the span of this recording in which it was found";
        }
        let (rejected, left_out): (Vec<&Fitted>, Vec<&Fitted>) =
            left_out.into_iter().partition(|fitted| fitted.is_rejected());
        let (growing, ended): (Vec<&Fitted>, Vec<&Fitted>) =
            left_out.into_iter().partition(|fitted| fitted.open_ended);
        for (why, fitted) in [
            ("it ended before the recording it was found in did", ended),
            ("it grows with time and its size is known in its recording only", growing),
        ] {
            if !fitted.is_empty() {
                let fitted = names(fitted.into_iter().map(Fitted::name).collect());
                text += &format!("; left out, since {why}: {fitted}");
            }
        }
        for fitted in rejected {
            let reason = fitted.review.as_ref().map_or("", |review| review.reason.as_str());
            text += &format!("; rejected: {} ({reason})", fitted.name());
        }
        if let Some(ask) = &self.file.ask {
            text += &format!("; {}, to tell {} from {}", ask.what(), ask.between[0], ask.between[1]);
        }
        text
    }
}

/// Label of the suggested pose; if the model file requests the pose, with the requested turn and the reason.
pub fn suggestion(state: &State, ask: Option<&Ask>) -> Option<Cow<'static, str>> {
    let name = LIBRARY.get(state.suggested_pose as usize)?.name;
    // During identification the filter's suggestion takes precedence.
    let Some(ask) = ask.filter(|ask| state.converged == 1 && ask.poses.iter().any(|pose| pose == name))
    else {
        return Some(Cow::Borrowed(name));
    };
    let turn = if ask.turn_deg == 0.0 { String::new() } else { format!("{}, ", turn(ask.turn_deg)) };
    Some(Cow::Owned(format!("{turn}{name}, to tell {} from {}", ask.between[0], ask.between[1])))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "version = 1\n[provenance]\nrecording_sha256 = \"HASH\"\ndate = \"\"\nsubject = \"\"\nstation = \
                        \"\"\nsoftware = \"\"\nidentify_s = [0, 1]\nwork_s = [1, 2]\n[[effect]]\nname = \"plate_offset\"\n\
                        span_s = [1, 2]\nopen_ended = true\nlog_odds = 9.0\n[effect.parameters.dx_m]\nvalue = 0.01\nsigma = \
                        0.001\nunit = \"m\"\n[[effect]]\nname = \"plate_yaw\"\nspan_s = [1, 1.5]\nopen_ended = \
                        false\nlog_odds = 9.0\n[effect.parameters.psi_rad]\nvalue = 0.1\nsigma = 0.001\nunit = \"rad\"\n";

    #[test]
    fn spans_apply_only_to_their_recording() {
        let folder = tempfile::tempdir().unwrap();
        let (here, elsewhere) = (folder.path().join("here"), folder.path().join("elsewhere"));
        std::fs::write(&here, "abc").unwrap();
        std::fs::write(&elsewhere, "abd").unwrap();
        // FIPS 180-2, appendix B.1.
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(sha256_of(&here).unwrap(), expected);
        let mut loaded = LoadedModel::parse(TEXT.replace("HASH", expected), "m.toml".to_owned()).unwrap();
        let spans = |loaded: &LoadedModel| {
            loaded.model().terms.iter().flatten().map(|term| term.span_s).collect::<Vec<_>>()
        };
        assert_eq!(spans(&loaded), [[0.0, f64::INFINITY]]);
        let text = "model m.toml: plate_offset; left out, since it ended before the recording it was found in did: plate_yaw";
        assert_eq!(loaded.describe(), text);
        loaded.fit_to(&here, 7).unwrap();
        assert_eq!(spans(&loaded), [[1.0, f64::INFINITY], [1.0, 1.5]]);
        assert!(
            loaded.describe().contains("plate_offset, plate_yaw, each in the span"),
            "{}",
            loaded.describe()
        );
        loaded.fit_to(&elsewhere, 7).unwrap();
        assert_eq!(spans(&loaded).len(), 1);
        assert!(loaded.fit_to(&folder.path().join("none"), 7).is_err());
        let drift = TEXT
            .replace("HASH", expected)
            .replace("plate_offset", "plate_drift")
            .replace("dx_m", "vx_m_per_s");
        let drift =
            drift.replace("value = 0.01", "value = 1e-4").replacen("unit = \"m\"", "unit = \"m/s\"", 1);
        let loaded = LoadedModel::parse(drift, "m.toml".to_owned()).unwrap();
        assert!(loaded.model().is_empty());
        let text = "plate_yaw; left out, since it grows with time and its size is known in its recording only: plate_drift";
        assert!(loaded.describe().ends_with(text), "{}", loaded.describe());
    }
}
