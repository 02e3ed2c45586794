//! Data of a station that persist across daemon restarts: active subject and model, tare, registration.
//!
//! `stations/<station>.toml` in the state directory, written like a profile: atomically, readable by owner and group. A
//! file that cannot be parsed is refused and never overwritten.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use equipoise_config::Config;
use equipoise_core::cycle::Tare;
use equipoise_core::message::Printable;
use equipoise_files::Sha256;
use serde::{Deserialize, Serialize};

use crate::stored_file::{self, Refusal, sealed};

mod force_offset;
mod registration;

pub use force_offset::ForceOffsetPart;
pub use registration::RegistrationPart;

/// Increments with every change of the file's layout or meaning; a file of another format is refused.
const FORMAT: u32 = 4;
/// Age from which a tare is reported as old, s: one shift, in which a plate warms up and cools down.
const TARE_AGE_MAX_S: u64 = 12 * 3600;

/// The file of a station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StationFile {
    /// Format number.
    pub format: u32,
    /// The station.
    pub station: String,
    /// Time of writing, s since 1970 UTC.
    pub saved_unix_s: u64,
    /// The active subject, if it is not the configured one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subject: Option<SubjectPart>,
    /// The active model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<ModelPart>,
    /// Reading of the empty plate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tare: Option<TarePart>,
    /// Position of the suit world.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registration: Option<RegistrationPart>,
    /// Force offset of the subject on the plate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force_offset: Option<ForceOffsetPart>,
}

/// `[subject]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SubjectPart {
    /// Pseudonym of the loaded subject; empty for an unnamed one.
    pub in_use: String,
    /// Fingerprint of the configured subject at that time: if the configuration names another one since, that one is
    /// used. Not the pseudonym, which would remain here after that subject is deleted.
    configured: String,
}

impl SubjectPart {
    /// The active subject, unnamed if empty; `None` if it is the configured subject.
    pub fn of(in_use: &str, config: &Config) -> Option<SubjectPart> {
        (in_use != config.subject.id)
            .then(|| SubjectPart { in_use: in_use.to_owned(), configured: fingerprint(config) })
    }
}

fn fingerprint(config: &Config) -> String {
    let mut hash = Sha256::of(format!("{}/{}", config.station, config.subject.id).as_bytes());
    hash.truncate(16);
    hash
}

/// `[model]`
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelPart {
    /// Path as configured.
    pub file: String,
    /// SHA-256 of the content.
    pub sha256: String,
}

/// `[tare]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TarePart {
    /// Time of the tare, s since 1970 UTC.
    pub taken_unix_s: u64,
    /// SHA-256 of `[ground]`: a tare is valid only for its plate, pose and scale.
    plate: String,
    force_n: [f64; 3],
    moment_nm: [f64; 3],
    foot_vertical_n: [f64; 2],
    foot_lever_nm: [[f64; 2]; 2],
}

/// A station's file cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("the station's file {path} is not used: {reason}; it is left as it is", path = .path.display())]
pub struct Refused {
    /// Path of the file.
    pub path: PathBuf,
    /// Reason.
    pub reason: String,
}

impl StationFile {
    /// A file without data.
    pub fn new(station: &str) -> StationFile {
        StationFile {
            format: FORMAT,
            station: station.to_owned(),
            saved_unix_s: 0,
            subject: None,
            model: None,
            tare: None,
            registration: None,
            force_offset: None,
        }
    }

    /// Reads a file; `None` if it does not exist. The file name is the station's name.
    ///
    /// # Errors
    /// [`Refused`].
    pub fn read(path: &Path) -> Result<Option<StationFile>, Refused> {
        let refused = |reason: String| Refused { path: path.to_owned(), reason };
        let read = stored_file::read(path, FORMAT).map_err(|refusal| match refusal {
            Refusal::Io(error) => refused(format!("it cannot be read: {error}")),
            Refusal::Content(reason) => refused(reason),
        })?;
        let Some(file): Option<StationFile> = read else { return Ok(None) };
        if path.file_stem() != Some(OsStr::new(&file.station)) {
            return Err(refused(format!(
                "it is of the station {}",
                Printable { text: &file.station, chars_max: 64 }
            )));
        }
        Ok(Some(file))
    }

    /// The text of the file.
    ///
    /// # Errors
    /// The data have no TOML form. The caller must not overwrite an existing file.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self).map(sealed)
    }

    /// Removes the pseudonym of the loaded subject, which is unnamed from then on.
    pub fn clear_subject(&mut self) {
        if let Some(subject) = &mut self.subject {
            subject.in_use.clear();
        }
    }

    /// The subject to load, empty for an unnamed one, unless the configured subject has changed since.
    pub fn loaded_subject(&self, config: &Config) -> Option<&str> {
        let subject = self.subject.as_ref()?;
        (subject.configured == fingerprint(config) && subject.in_use != config.subject.id)
            .then_some(subject.in_use.as_str())
    }

    /// Message on a change of the model since; `None` if it is the same.
    pub fn other_model(&self, config: &Config) -> Option<String> {
        let now = ModelPart::of(config);
        match (&self.model, &now) {
            _ if self.model.as_ref().map(|part| &part.sha256) == now.as_ref().map(|part| &part.sha256) => {
                None
            }
            (Some(before), None) => Some(format!("the model {} is not in use any more", before.file)),
            (None, Some(now)) => Some(format!("the model {} was not in use before", now.file)),
            (Some(before), Some(now)) if before.file == now.file => {
                Some(format!("the content of the model {} is another than before", now.file))
            }
            (Some(before), Some(now)) => {
                Some(format!("the model is {}, before it was {}", now.file, before.file))
            }
            (None, None) => None,
        }
    }
}

impl ModelPart {
    /// The model of a configuration.
    pub fn of(config: &Config) -> Option<ModelPart> {
        let model = config.loaded_model.as_ref()?;
        Some(ModelPart { file: model.name.clone(), sha256: Sha256::of(model.text.as_bytes()) })
    }
}

impl TarePart {
    /// Converts a tare; `None` if there is none.
    pub fn of(tare: &Tare, taken_unix_s: u64, config: &Config) -> Option<TarePart> {
        let Tare { force_n, moment_nm, foot_vertical_n, foot_lever_nm } = *tare;
        let plate = plate_of(config);
        (*tare != bytemuck::Zeroable::zeroed()).then_some(TarePart {
            taken_unix_s,
            plate,
            force_n,
            moment_nm,
            foot_vertical_n,
            foot_lever_nm,
        })
    }

    /// The tare, and a message on it.
    ///
    /// # Errors
    /// Why it is no longer valid.
    pub fn tare(&self, config: &Config, now_unix_s: u64) -> Result<(Tare, String), String> {
        if self.plate != plate_of(config) {
            return Err("[ground] is another than when it was taken; tare again".to_owned());
        }
        let &TarePart { force_n, moment_nm, foot_vertical_n, foot_lever_nm, .. } = self;
        let age_s = now_unix_s.saturating_sub(self.taken_unix_s);
        let old = if age_s > TARE_AGE_MAX_S { "; tare again as soon as the plate is empty" } else { "" };
        let message =
            format!("the tare of {:.1} h ago is in force ({:.1} N){old}", age_s as f64 / 3600.0, force_n[2]);
        Ok((Tare { force_n, moment_nm, foot_vertical_n, foot_lever_nm }, message))
    }
}

fn plate_of(config: &Config) -> String {
    Sha256::of(config.ground.to_toml().as_bytes())
}

/// Boot id of the machine; `None` if unavailable.
fn boot() -> Option<String> {
    let id = fs::read_to_string("/proc/sys/kernel/random/boot_id").ok()?;
    Some(id.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use equipoise_core::cycle::{Registration, StoredForceOffset, StoredState};

    use super::*;
    use crate::realtime::now_ns;

    pub(super) fn config(change: &str) -> Config {
        let text = format!(
            "station = \"s\"\n[suit]\nsource = \"external\"\n[ground]\nsource = \"external\"\n{change}\n[subject]\nid = \"a\"\n\
             height_m = 1.7\n"
        );
        Config::parse(&text, "the test's").unwrap()
    }

    pub(super) fn copy() -> Box<StoredState> {
        let mut copy = bytemuck::zeroed_box::<StoredState>();
        copy.tare.force_n = [0.5, -0.25, 41.0];
        copy.force_offset = StoredForceOffset { mean_n: 7.5, sigma_n: 0.5, mass_kg: 71.3, time_ns: now_ns() };
        copy.registration = Registration {
            station_from_suit_rad: 0.7,
            station_from_suit_sigma_rad: 0.1,
            station_from_suit_m: [0.1, -0.2],
            station_from_suit_sigma_m: [0.02, 0.03],
            suit_time_ns: now_ns(),
            suit_counter: 77,
            suit_period_ns: 10_000_000,
            suit_lag_s: -0.04,
        };
        copy
    }

    #[test]
    fn a_file_round_trips_and_others_are_refused() {
        let (config, copy) = (config(""), copy());
        let mut file = StationFile::new("s");
        file.tare = TarePart::of(&copy.tare, 1000, &config);
        file.registration = RegistrationPart::of(&copy, &config);
        file.force_offset = ForceOffsetPart::of(&copy, "b", &config);
        assert!(file.force_offset.is_some());
        file.subject = SubjectPart::of("b", &config);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("s.toml");
        assert_eq!(StationFile::read(&path).unwrap(), None);
        fs::write(&path, file.to_toml().unwrap()).unwrap();
        let read = StationFile::read(&path).unwrap().unwrap();
        assert_eq!(read, file);
        assert_eq!(read.loaded_subject(&config), Some("b"));
        let mut other = config.clone();
        other.subject.id = "c".to_owned();
        assert_eq!(read.loaded_subject(&other), None, "the configuration is newer");
        file.subject = SubjectPart::of("", &config);
        assert_eq!(file.loaded_subject(&config), Some(""), "unnamed is not the configured subject");
        assert_eq!(SubjectPart::of("a", &config), None);
        assert_eq!(read.registration.unwrap().registration(&config, now_ns()), Ok(copy.registration));
        for (change, reason) in [
            ("format = 4", "format = 3"),
            ("format = 4", "format = 5"),
            ("format", "formats"),
            ("station", "= ="),
        ] {
            let text = file.to_toml().unwrap().replacen(change, reason, 1);
            fs::write(&path, &text).unwrap();
            assert!(StationFile::read(&path).unwrap_err().to_string().contains("left as it is"));
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        // The first format had no checksum.
        fs::write(&path, "format = 1\nstation = \"s\"\nsaved_unix_s = 1\n").unwrap();
        let refusal = StationFile::read(&path).unwrap_err().to_string();
        assert!(refusal.contains("its format is 1, this version reads format 4 only"), "{refusal}");
    }

    #[test]
    fn a_tare_is_valid_for_its_plate_only() {
        let part = TarePart::of(&copy().tare, 1000, &config("")).unwrap();
        let (tare, message) = part.tare(&config(""), 1000 + 3600).unwrap();
        assert_eq!(tare, copy().tare);
        assert!(message.contains("1.0 h ago") && !message.contains("tare again"), "{message}");
        assert!(part.tare(&config(""), 1000 + 20 * 3600).unwrap().1.contains("tare again"));
        let moved = config("[ground.frame]\nyaw_deg = 90.0");
        assert!(part.tare(&moved, 1000).unwrap_err().contains("tare again"));
        assert_eq!(TarePart::of(&bytemuck::Zeroable::zeroed(), 1, &config("")), None);
    }
}
