//! `[recording]`

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::method::{Checked, between};

/// `[recording]`: recordings of `equipoise record --config`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingConfig {
    /// Folder of the files; created if missing. A relative path refers to the configuration's folder.
    pub directory: PathBuf,
    /// Size at which the next file is started, MiB.
    #[serde(default = "default_file_max_mib")]
    pub file_max_mib: u64,
    /// Total size of this station's files, above which the oldest are removed, MiB.
    #[serde(default = "default_total_max_mib")]
    pub total_max_mib: u64,
    /// Age of the last message above which a file is removed, days.
    #[serde(default = "default_age_max_days")]
    pub age_max_days: f64,
    /// Minimum free space, MiB: the oldest files are removed, and if that is not sufficient, recording ends.
    #[serde(default = "default_free_min_mib")]
    pub free_min_mib: u64,
    /// Pictures per second for Foxglove and Lichtblick, 0 to 100; 0 for none.
    #[serde(default = "default_pictures_hz")]
    pub pictures_hz: f64,
    /// Secret key of minisign, without a password, that signs every finished file; without it none is signed. A
    /// relative path refers to the configuration's folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sign_key: Option<PathBuf>,
}

fn default_file_max_mib() -> u64 {
    512
}

fn default_total_max_mib() -> u64 {
    20_480
}

fn default_age_max_days() -> f64 {
    30.0
}

fn default_free_min_mib() -> u64 {
    2_048
}

/// Sufficiently smooth, and a small part of a recording (docs/recordings.md).
fn default_pictures_hz() -> f64 {
    20.0
}

impl RecordingConfig {
    pub(super) fn check(&self) -> Checked {
        between("recording.file_max_mib", self.file_max_mib as f64, 1.0, 1e6)?;
        between("recording.total_max_mib", self.total_max_mib as f64, 1.0, 1e9)?;
        between("recording.age_max_days", self.age_max_days, 1e-3, 36_500.0)?;
        between("recording.free_min_mib", self.free_min_mib as f64, 0.0, 1e9)?;
        between("recording.pictures_hz", self.pictures_hz, 0.0, 100.0)?;
        if self.total_max_mib < self.file_max_mib {
            let what = "less than one file may have (recording.file_max_mib): raise it, or lower that";
            return Err(("recording.total_max_mib", what.to_owned()));
        }
        Ok(())
    }
}
