//! A subject's profile on disk, under a pseudonym: the result of the identification.
//!
//! Written atomically (temporary file, fsync, rename), readable by owner and group only. A file that cannot be parsed
//! is refused and never overwritten.

#[cfg(test)]
pub(crate) mod example;
mod parts;

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use equipoise_config::method::{Build, HEIGHT_M, MASS_KG, SexConfig};
use equipoise_core::body::SEGMENTS;
use equipoise_core::cycle::identification::StoredSubject;
use equipoise_core::cycle::{Identification, NO_POSE, Settings};
use equipoise_core::exposure::Shift;
use equipoise_core::handover::experience::Experience;
use equipoise_core::kalman::Filter;
use equipoise_core::message::Printable;
use equipoise_core::pose_suggestion::Performed;
use equipoise_core::pose_suggestion::library::LIBRARY;
use serde::{Deserialize, Serialize};

use crate::stored_file::{self, Refusal, sealed};

use self::parts::{ConsistencyPart, HandoverPart, ShiftPart, index_of, names_of, set_of};

/// Increments with every change of the file's layout or meaning; a file of another format is refused.
const FORMAT: u32 = 7;

/// Maximum number of characters of another subject's name in a message.
const ID_CHARS_MAX: usize = 64;

/// Content of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// Format number.
    format: u32,
    /// The pseudonym.
    pub subject: String,
    /// Number of identified parameters; must match the configured reduction.
    pub parameters: usize,
    /// Body mass, kg; 0 if unavailable.
    pub mass_kg: f64,
    /// Its 1-σ, kg, if it was weighed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mass_sigma_kg: Option<f64>,
    /// Stature, m.
    height_m: f64,
    /// Sex as it was configured.
    sex: SexConfig,
    /// Number of held poses used by the filter.
    pub poses_used: u64,
    /// Whether identification is complete.
    pub identified: bool,
    /// Whether identification was active.
    learning: bool,
    /// The suggested pose of the library.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    suggested: Option<String>,
    /// Poses of the library that were suggested before.
    asked: Vec<String>,
    /// Poses of the library that this subject could not hold.
    unholdable: Vec<String>,
    /// Number of poses performed since the start of the identification.
    poses_performed: u64,
    /// Skeleton: each segment's origin in its parent, m.
    skeleton_m: Vec<[f64; 3]>,
    /// The last pose used, `parent_from_segment`, scalar first, so that it is not used again.
    last_pose_wxyz: Vec<[f64; 4]>,
    /// θ, m.
    theta_m: Vec<f64>,
    /// P of θ, m², row by row.
    covariance_m2: Vec<f64>,
    /// The poses performed, oldest first: a rotation vector per segment, rad.
    performed_rad: Vec<Vec<f64>>,
    /// Consistency of the measurements with the prior.
    consistency: ConsistencyPart,
    /// Variance of the model error forward and sideways, m².
    model_error_m2: [f64; 2],
    /// Measured handovers, oldest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    handover: Vec<HandoverPart>,
    /// Exposure accumulated over the shift.
    shift: ShiftPart,
}

/// A profile cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ProfileError {
    /// The file cannot be read.
    #[error("cannot read the profile {path}: {source}")]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file is not a profile, or not one for this configuration.
    #[error("the profile {path} is not used: {reason}; it is left as it is")]
    Refused {
        /// Path of the file.
        path: PathBuf,
        /// Reason.
        reason: String,
    },
}

impl Profile {
    /// The profile of a subject; `None` before the skeleton is available. `saved_unix_s` is the time, s since 1970 UTC.
    pub fn of(
        subject: &str,
        build: Build,
        worker: &StoredSubject,
        shift: &Shift,
        experience: &Experience,
        saved_unix_s: u64,
    ) -> Option<Profile> {
        if worker.has_body != 1 {
            return None;
        }
        let count = worker.filter.count();
        let suggested = usize::try_from(worker.suggested).ok().and_then(|index| LIBRARY.get(index));
        Some(Profile {
            format: FORMAT,
            subject: subject.to_owned(),
            parameters: count,
            mass_kg: worker.mass_kg,
            mass_sigma_kg: Some(worker.mass_sigma_kg).filter(|sigma_kg| *sigma_kg > 0.0),
            height_m: build.height_m,
            sex: build.sex,
            poses_used: worker.poses_used,
            identified: worker.identified == 1,
            learning: worker.identifying == 1,
            suggested: suggested.map(|posture| posture.name.to_owned()),
            asked: names_of(worker.suggested_before),
            unholdable: names_of(worker.unholdable),
            poses_performed: worker.performed.count(),
            skeleton_m: worker.skeleton_m.to_vec(),
            last_pose_wxyz: worker.last_pose_wxyz.to_vec(),
            theta_m: worker.filter.theta_m()[..count].to_vec(),
            covariance_m2: (0..count).flat_map(|row| worker.filter.covariance_row_m2(row).to_vec()).collect(),
            performed_rad: worker.performed.poses().map(|pose| pose.to_vec()).collect(),
            consistency: ConsistencyPart::of(&worker.consistency),
            model_error_m2: worker.misfit_m2,
            handover: experience.handovers().map(HandoverPart::of).collect(),
            shift: ShiftPart::of(shift, saved_unix_s),
        })
    }

    /// Stature and sex.
    pub fn build(&self) -> Build {
        Build { height_m: self.height_m, sex: self.sex }
    }

    /// Skeleton: each segment's origin in its parent, m.
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

    /// The identification of this profile under these settings.
    ///
    /// # Errors
    /// Why it does not fit.
    pub fn worker(&self, settings: &Settings) -> Result<Box<Identification>, String> {
        let mut worker = bytemuck::zeroed_box::<Identification>();
        if worker.restore(&*self.stored()?, settings) {
            Ok(worker)
        } else {
            Err(format!(
                "its {} parameters do not fit the configured reduction, or a number in it is out of range",
                self.parameters
            ))
        }
    }

    fn stored(&self) -> Result<Box<StoredSubject>, String> {
        let mut stored = bytemuck::zeroed_box::<StoredSubject>();
        stored.has_body = 1;
        let bones: Result<[[f64; 3]; SEGMENTS], _> = self.skeleton_m.clone().try_into();
        stored.skeleton_m =
            bones.map_err(|bones| format!("it has {} segments instead of {SEGMENTS}", bones.len()))?;
        stored.last_pose_wxyz = self
            .last_pose_wxyz
            .clone()
            .try_into()
            .map_err(|_| "its last pose has another number of joints".to_owned())?;
        stored.filter = *self.filter()?;
        stored.mass_kg = self.mass_kg;
        stored.mass_sigma_kg = self.mass_sigma_kg.unwrap_or(0.0);
        stored.poses_used = self.poses_used;
        stored.identified = u64::from(self.identified);
        stored.identifying = u64::from(self.learning && !self.identified);
        // Unknown pose names are dropped; the performed poses themselves are stored separately.
        stored.suggested_before = set_of(&self.asked);
        stored.unholdable = set_of(&self.unholdable);
        stored.suggested = self.suggested.as_deref().and_then(index_of).map_or(NO_POSE, |index| index as u64);
        let performed = self.performed_rad.iter().map(|pose| pose.clone().try_into());
        let performed: Result<Vec<_>, Vec<f64>> = performed.collect();
        let performed =
            performed.map_err(|_| "a performed pose has another number of segments".to_owned())?;
        stored.performed = Performed::of(self.poses_performed, performed.into_iter());
        stored.misfit_m2 = self.model_error_m2;
        stored.consistency = self.consistency.consistency();
        Ok(stored)
    }

    /// The filter with θ and P.
    fn filter(&self) -> Result<Box<Filter>, String> {
        let mut filter = bytemuck::zeroed_box::<Filter>();
        if self.theta_m.len() != self.parameters || !filter.restore(&self.theta_m, &self.covariance_m2) {
            return Err("a number of θ or P is out of range, or one is missing".to_owned());
        }
        if !filter.is_within_reach(self.height_m) {
            return Err(format!(
                "a number of θ or P is beyond the reach of a body with a stature of {} m",
                self.height_m
            ));
        }
        Ok(filter)
    }

    /// The shift to resume at a time, s since 1970 UTC, its age, s, and a message.
    ///
    /// # Errors
    /// Why a new shift begins.
    pub fn shift(&self, now_unix_s: u64) -> Result<(Shift, u64, String), String> {
        let (shift, age_s) = self.shift.shift(now_unix_s)?;
        let unknown = match age_s {
            Some(_) => "",
            None => {
                "; its age is unknown, because this computer's clock is behind the shift's date: set the clock"
            }
        };
        let message = format!("the shift goes on: {} lifts so far{unknown}", shift.lifts);
        Ok((shift, age_s.unwrap_or(0), message))
    }

    /// Measured handovers: none unless identification is complete, because the ratios refer to its predictions.
    pub fn experience(&self) -> Experience {
        let mut experience = Experience::default();
        for part in self.handover.iter().filter(|_| self.identified) {
            experience.add(part.handover());
        }
        experience
    }

    /// Reads a profile; `None` if it does not exist. The file name is the subject's pseudonym.
    ///
    /// # Errors
    /// [`ProfileError`].
    pub fn read(path: &Path) -> Result<Option<Profile>, ProfileError> {
        let refused = |reason: String| ProfileError::Refused { path: path.to_owned(), reason };
        let read = stored_file::read(path, FORMAT).map_err(|refusal| match refusal {
            Refusal::Io(source) => ProfileError::Io { path: path.to_owned(), source },
            Refusal::Content(reason) => refused(reason),
        })?;
        let Some(profile): Option<Profile> = read else { return Ok(None) };
        if path.file_stem() != Some(OsStr::new(&profile.subject)) {
            return Err(refused(format!(
                "it is of the subject {}",
                Printable { text: &profile.subject, chars_max: ID_CHARS_MAX }
            )));
        }
        profile.check().map_err(refused)?;
        Ok(Some(profile))
    }

    /// Checks mass, stature, θ, P, handovers and the shift; the other numbers are checked where they are restored.
    fn check(&self) -> Result<(), String> {
        let out = |what: &str, value: f64| Err(format!("{what} is {value}, which no person's is"));
        if self.mass_kg != 0.0 && !MASS_KG.contains(&self.mass_kg) {
            return out("mass_kg", self.mass_kg);
        }
        if let Some(sigma_kg) =
            self.mass_sigma_kg.filter(|sigma_kg| !(0.0..=*MASS_KG.end()).contains(sigma_kg))
        {
            return out("mass_sigma_kg", sigma_kg);
        }
        if !HEIGHT_M.contains(&self.height_m) {
            return out("height_m", self.height_m);
        }
        self.filter()?;
        self.shift.check()?;
        if !self.handover.iter().all(|part| part.handover().is_sound()) {
            return Err("a handover in it is out of range".to_owned());
        }
        let turned = self.last_pose_wxyz.iter().all(|q| {
            let square: f64 = q.iter().map(|part| part * part).sum();
            // Before the first pose all components are zero.
            square == 0.0 || (square - 1.0).abs() < 1e-3
        });
        if turned {
            Ok(())
        } else {
            Err("the last pose in it is none: its turns have no unit length".to_owned())
        }
    }

    /// The text of the file.
    ///
    /// # Errors
    /// The data have no TOML form. The caller must not overwrite an existing file.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self).map(sealed)
    }
}

/// Current time, s since 1970 UTC; 0 if the clock is earlier.
pub fn unix_s() -> u64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    since.map_or(0, |since| since.as_secs())
}

#[cfg(test)]
mod tests;
