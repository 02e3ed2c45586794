//! Restores the loop's initial state from the stored profile and station file, as far as they are still valid.

use equipoise_config::Config;
use equipoise_core::cycle::{Memory, Settings, Tare};
use equipoise_files::atomic_file::remove_abandoned_files;
use tracing::{info, warn};

use crate::active_configuration::{ActiveConfiguration, LoadedSubject};
use crate::profile::{Profile, unix_s};
use crate::realtime::now_ns;
use crate::station_file::StationFile;
use crate::subjects::{self, ProfileDestination, Subjects};

/// The loop's initial memory and related data.
pub(super) struct Restored {
    pub(super) memory: Box<Memory>,
    /// Number of its worker.
    pub(super) worker: u64,
    /// The active tare and its time, s since 1970 UTC.
    pub(super) tare: (Tare, u64),
    /// The station file exists and must not be overwritten, or saving is disabled.
    pub(super) station_refused: bool,
    /// All findings and their outcome, as messages.
    pub(super) messages: Vec<String>,
}

impl Restored {
    /// An empty memory, filled with stored data that are still valid. Unusable files are left unchanged and reported.
    /// Adds the subject loaded last to the configuration.
    pub(super) fn find(active: &mut ActiveConfiguration, subjects: &Subjects) -> Restored {
        let (config, settings) = (&active.config.clone(), &active.settings());
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(settings);
        let mut restored = Restored {
            memory,
            worker: subjects::CONFIGURED,
            tare: (bytemuck::Zeroable::zeroed(), 0),
            station_refused: true,
            messages: Vec::new(),
        };
        if config.subject.save_profile {
            for folder in [subjects.state().profiles(), subjects.state().stations()] {
                remove_abandoned_files(&folder, |_| true);
            }
            let station = restored.station(config, subjects);
            restored.subject(active, settings, subjects, station.as_ref());
            if let Some(station) = &station {
                restored.restore_station(config, settings, station);
            }
        }
        restored
    }

    fn station(&mut self, config: &Config, subjects: &Subjects) -> Option<StationFile> {
        match StationFile::read(&subjects.state().station(&config.station)) {
            Ok(file) => {
                self.station_refused = false;
                file
            }
            Err(reason) => {
                self.warn(format!("{reason}; tare and registration are not kept (move it away and restart)"));
                None
            }
        }
    }

    /// Restores the subject loaded last; if there is none or it cannot be read, the configured subject.
    fn subject(
        &mut self,
        active: &mut ActiveConfiguration,
        settings: &Settings,
        subjects: &Subjects,
        station: Option<&StationFile>,
    ) {
        if let Some(loaded) = station.and_then(|file| file.loaded_subject(&active.config)) {
            let mut destination = ProfileDestination::of(subjects.state(), loaded, None, true);
            let settings_of = |profile: &Profile| {
                let subject = LoadedSubject { id: loaded.to_owned(), build: profile.build() };
                ActiveConfiguration { loaded: Some(subject), ..active.clone() }.settings()
            };
            match self.read(&destination, settings_of) {
                Ok(Some(profile)) => {
                    (destination.build, destination.experience) = (profile.build(), profile.experience());
                    active.loaded = Some(LoadedSubject { id: loaded.to_owned(), build: destination.build });
                    self.worker = subjects.add(destination);
                    subjects.activate(self.worker);
                    return;
                }
                Ok(None) => self.warn(format!("{loaded} was in use, and has no profile any more")),
                Err(reason) => self.warn(format!("{loaded} was in use: {reason}")),
            }
        }
        let Some(destination) = subjects.get(subjects::CONFIGURED) else { return };
        match self.read(&destination, |_| *settings) {
            Ok(None) => {}
            Ok(Some(profile)) => {
                subjects.update_experience(subjects::CONFIGURED, |all| *all = profile.experience());
                // The mass in the configuration overrides that of the profile.
                if let Some(mass_kg) = settings.mass_kg {
                    self.memory.identification.mass_kg = mass_kg;
                }
            }
            Err(reason) => {
                self.warn(format!("{reason}; what is learnt now is not saved"));
                subjects.refuse(
                    subjects::CONFIGURED,
                    format!("{reason} (not overwritten; move it away and restart)"),
                );
            }
        }
    }

    /// Restores a stored subject.
    fn read(
        &mut self,
        destination: &ProfileDestination,
        settings_of: impl Fn(&Profile) -> Settings,
    ) -> Result<Option<Profile>, String> {
        let Some(profile) = Profile::read(&destination.path).map_err(|error| error.to_string())? else {
            return Ok(None);
        };
        let worker = profile.worker(&settings_of(&profile)).map_err(|reason| {
            format!("the profile {} is not used: {reason}; it is left as it is", destination.path.display())
        })?;
        self.memory.identification = *worker;
        let progress = if profile.identified { "identified" } else { "not finished" };
        self.report(format!(
            "profile {} is in use: {} poses, {progress}",
            profile.subject, profile.poses_used
        ));
        match profile.shift(unix_s()) {
            Ok(shift) => {
                self.memory.resume_shift(&shift);
                self.report(format!("the shift goes on: {} lifts so far", shift.lifts));
            }
            Err(reason) => self.report(format!("a new shift begins: {reason}")),
        }
        Ok(Some(profile))
    }

    fn restore_station(&mut self, config: &Config, settings: &Settings, station: &StationFile) {
        if let Some(other) = station.other_model(config) {
            self.warn(format!("{other}; what was learnt with one model need not fit another"));
        }
        match station.tare.as_ref().map(|part| (part.taken_unix_s, part.tare(config, unix_s()))) {
            None => {}
            Some((taken_unix_s, Ok((tare, message)))) if self.memory.resume_tare(&tare) => {
                self.tare = (tare, taken_unix_s);
                self.report(message);
            }
            Some((_, Ok(_))) => self.warn("the tare is not used: a number of it is out of range".to_owned()),
            Some((_, Err(reason))) => self.warn(format!("the tare is not used: {reason}")),
        }
        match station.registration.as_ref().map(|part| part.registration(config, now_ns())) {
            None => {}
            Some(Ok(registration)) if self.memory.resume_registration(&registration, settings) => {
                self.report(
                    "the position of the suit's world is restored, if the suit was not restarted".to_owned(),
                );
            }
            Some(Ok(_)) => self.report("the stored position of the suit's world is not used".to_owned()),
            Some(Err(reason)) => {
                // Newly configured frames already describe the current position of the suit world.
                let has_new_frames =
                    station.registration.as_ref().is_some_and(|part| !part.is_in_frames_of(config));
                if settings.suit_drifts && self.memory.identification.has_body() && !has_new_frames {
                    self.memory.invalidate_registration();
                }
                self.report(format!("the position of the suit's world is estimated again: {reason}"));
            }
        }
    }

    fn report(&mut self, what: String) {
        info!("{what}");
        self.messages.push(what);
    }

    fn warn(&mut self, what: String) {
        warn!("{what}");
        self.messages.push(what);
    }
}
