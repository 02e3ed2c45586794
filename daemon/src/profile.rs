//! A worker's profile on disk: what was learnt, under a pseudonym.
//!
//! Written whole or not at all (temporary file, fsync, rename), readable by its owner and group only. A file that
//! cannot be understood is refused and never overwritten.

use std::path::{Path, PathBuf};

use equipoise_adapters::text_file::{TEXT_BYTES_MAX, read_text};
use equipoise_core::body::SEGMENTS;
use equipoise_core::cycle::identification::Stored;
use equipoise_core::cycle::{Identification, Settings};
use serde::{Deserialize, Serialize};

use crate::config::method::SexConfig;
use crate::whole_file::write_whole;

/// Grows with every change of the file's layout or meaning.
const FORMAT: u32 = 2;
/// Files from before stature and sex were kept; read, but of no use as a similar worker.
const FORMAT_WITHOUT_BUILD: u32 = 1;

/// How a worker is built, beside the mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Build {
    /// Stature, m.
    pub height_m: f64,
    /// Which table the worker started from.
    pub sex: SexConfig,
}

/// A profile as it stands in the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// Layout of the file.
    format: u32,
    /// The pseudonym.
    pub subject: String,
    /// Number of identified parameters; must match the configured reduction.
    pub parameters: usize,
    /// Body mass, kg; 0 while unknown.
    pub mass_kg: f64,
    /// Stature, m; absent in files of format 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    height_m: Option<f64>,
    /// Sex as it was configured; absent in files of format 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sex: Option<SexConfig>,
    /// Held poses that entered the filter.
    pub poses_used: u64,
    /// Whether identification was finished.
    pub identified: bool,
    /// Bones: each segment's origin in its parent, m.
    skeleton_m: Vec<[f64; 3]>,
    /// The last pose used, `parent_from_segment`, scalar first: it is not used again.
    last_pose_wxyz: Vec<[f64; 4]>,
    /// θ, m.
    theta_m: Vec<f64>,
    /// P, m², row by row.
    covariance_m2: Vec<f64>,
}

/// Why a profile cannot be used or written.
#[derive(Debug, thiserror::Error)]
pub enum ProfileError {
    /// The file cannot be read or written.
    #[error("cannot {doing} the profile {path}: {source}")]
    Io {
        /// "read" or "write".
        doing: &'static str,
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not a profile, or not one for this configuration.
    #[error("the profile {path} is not used: {why}; it is left as it is")]
    Refused {
        /// Which file.
        path: PathBuf,
        /// Why.
        why: String,
    },
}

impl Profile {
    /// The profile of a worker whose bones are known; `None` before that.
    pub fn of(subject: &str, build: Option<Build>, worker: &Identification) -> Option<Profile> {
        let stored = worker.stored()?;
        let count = stored.theta_m.len();
        Some(Profile {
            format: FORMAT,
            subject: subject.to_owned(),
            parameters: count,
            mass_kg: stored.mass_kg,
            height_m: build.map(|build| build.height_m),
            sex: build.map(|build| build.sex),
            poses_used: stored.poses_used,
            identified: stored.identified,
            skeleton_m: stored.skeleton_m.to_vec(),
            last_pose_wxyz: stored.last_pose_wxyz.to_vec(),
            theta_m: stored.theta_m.to_vec(),
            covariance_m2: (0..count).flat_map(|row| worker.filter.covariance_row_m2(row).to_vec()).collect(),
        })
    }

    /// How the worker is built; `None` if the file does not say.
    pub fn build(&self) -> Option<Build> {
        Some(Build { height_m: self.height_m.filter(|metres| (0.5..3.0).contains(metres))?, sex: self.sex? })
    }

    /// Bones: each segment's origin in its parent, m.
    pub fn skeleton_m(&self) -> &[[f64; 3]] {
        &self.skeleton_m
    }

    /// θ, m.
    pub fn theta_m(&self) -> &[f64] {
        &self.theta_m
    }

    /// P, m², row by row.
    pub fn covariance_m2(&self) -> &[f64] {
        &self.covariance_m2
    }

    /// The worker of this profile under these settings.
    ///
    /// # Errors
    /// Why it does not fit, in words.
    pub fn worker(&self, settings: &Settings) -> Result<Box<Identification>, String> {
        let skeleton_m: [[f64; 3]; SEGMENTS] = self
            .skeleton_m
            .clone()
            .try_into()
            .map_err(|_| format!("it has {} segments instead of {SEGMENTS}", self.skeleton_m.len()))?;
        let mut worker = bytemuck::zeroed_box::<Identification>();
        worker.start(settings);
        let stored = Stored {
            skeleton_m,
            mass_kg: self.mass_kg,
            theta_m: &self.theta_m,
            poses_used: self.poses_used,
            identified: self.identified,
            last_pose_wxyz: self
                .last_pose_wxyz
                .clone()
                .try_into()
                .map_err(|_| "its last pose has another number of joints".to_owned())?,
        };
        if worker.restore(&stored, &self.covariance_m2, settings) {
            Ok(worker)
        } else {
            Err(format!(
                "its {} parameters do not fit the configured reduction, or a number in it is out of range",
                self.parameters
            ))
        }
    }

    /// Reads a profile; `None` if there is none.
    ///
    /// # Errors
    /// [`ProfileError`].
    pub fn read(path: &Path) -> Result<Option<Profile>, ProfileError> {
        let text = match read_text(path, TEXT_BYTES_MAX) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(ProfileError::Io { doing: "read", path: path.to_owned(), source }),
        };
        let refused = |why: String| ProfileError::Refused { path: path.to_owned(), why };
        let profile: Profile = toml::from_str(&text).map_err(|error| refused(error.message().to_owned()))?;
        if !(FORMAT_WITHOUT_BUILD..=FORMAT).contains(&profile.format) {
            let why = format!(
                "its format is {}, this version reads {FORMAT_WITHOUT_BUILD} to {FORMAT}",
                profile.format
            );
            return Err(refused(why));
        }
        Ok(Some(profile))
    }

    /// Writes a profile whole or not at all.
    ///
    /// # Errors
    /// [`ProfileError::Io`]; the file before is then still there.
    pub fn write(&self, path: &Path) -> Result<(), ProfileError> {
        let text = toml::to_string(self).unwrap_or_default();
        write_whole(path, text.as_bytes()).map_err(|source| ProfileError::Io {
            doing: "write",
            path: path.to_owned(),
            source,
        })
    }
}

/// Where state lives: systemd's `$STATE_DIRECTORY`, else `$XDG_STATE_HOME/equipoise`, else `~/.local/state/equipoise`.
pub fn state_directory() -> PathBuf {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    if let Some(directories) = set("STATE_DIRECTORY") {
        let first = directories.to_string_lossy().split(':').next().unwrap_or_default().to_owned();
        return PathBuf::from(first);
    }
    match (set("XDG_STATE_HOME"), set("HOME")) {
        (Some(state), _) => PathBuf::from(state).join("equipoise"),
        (None, Some(home)) => PathBuf::from(home).join(".local/state/equipoise"),
        (None, None) => std::env::temp_dir().join("equipoise"),
    }
}

/// Whether a name is made of letters, digits, '-' and '_', so that it can be a file's and no path.
pub fn is_plain(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_')
}

/// Where profiles are kept.
pub fn folder() -> PathBuf {
    state_directory().join("subjects")
}

/// The file of a subject; the id is checked by the configuration.
pub fn path_of(subject: &str) -> PathBuf {
    folder().join(format!("{subject}.toml"))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_broken_profile_is_refused_and_left_alone() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.toml");
        assert_eq!(Profile::read(&path).unwrap(), None);
        fs::write(&path, "format = 1\nsubject = ").unwrap();
        assert!(Profile::read(&path).unwrap_err().to_string().contains("left as it is"));
        assert_eq!(fs::read_to_string(&path).unwrap(), "format = 1\nsubject = ");
    }

    #[test]
    fn a_file_without_stature_is_read_and_one_of_a_later_version_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.toml");
        let old = "format = 1\nsubject = \"a\"\nparameters = 0\nmass_kg = 70.0\nposes_used = 3\nidentified = true\n\
                   skeleton_m = []\nlast_pose_wxyz = []\ntheta_m = []\ncovariance_m2 = []\n";
        fs::write(&path, old).unwrap();
        let profile = Profile::read(&path).unwrap().unwrap();
        assert_eq!((profile.poses_used, profile.build()), (3, None));
        let new = old.replace("format = 1", "format = 2\nheight_m = 1.7\nsex = \"female\"");
        fs::write(&path, &new).unwrap();
        let build = Build { height_m: 1.7, sex: SexConfig::Female };
        assert_eq!(Profile::read(&path).unwrap().unwrap().build(), Some(build));
        fs::write(&path, new.replace("format = 2", "format = 3")).unwrap();
        assert!(Profile::read(&path).unwrap_err().to_string().contains("reads 1 to 2"));
    }
}
