//! Restores the loop's initial state from the stored profile and station file, as far as they are still valid.

use equipoise_config::Config;
use equipoise_core::cycle::{Memory, Settings, Tare};
use equipoise_core::time::NS_PER_S;
use equipoise_files::atomic_file::remove_abandoned_files;
use equipoise_station::ANONYMOUS;
use tracing::{info, warn};

use crate::active_configuration::{ActiveConfiguration, LoadedSubject};
use crate::profile::{Profile, unix_s};
use crate::realtime::now_ns;
use crate::station_file::{ForceOffsetPart, RegistrationPart, StationFile};
use crate::subjects::{self, DELETED, ProfileDestination, Subjects};

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
                let in_use = subjects.get(restored.worker).map(|in_use| in_use.subject).unwrap_or_default();
                if let Some(part) = &station.force_offset {
                    restored.restore_force_offset(config, part, &in_use);
                }
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

    /// Restores the subject in use; the configured one only if no other was loaded.
    fn subject(
        &mut self,
        active: &mut ActiveConfiguration,
        settings: &Settings,
        subjects: &Subjects,
        station: Option<&StationFile>,
    ) {
        if self.station_refused {
            let file = subjects.state().station(&active.config.station);
            let reason = format!(
                "{} cannot be read, so the subject in use is unknown; load it (`equipoise subject load ID`), or move \
                 the file away and restart",
                file.display()
            );
            return self.start_unidentified(active, subjects, ProfileDestination::unnamed(&reason));
        }
        match station.and_then(|file| file.loaded_subject(&active.config)) {
            None => self.configured_subject(settings, subjects),
            Some("") => self.start_unidentified(active, subjects, ProfileDestination::unnamed(DELETED)),
            Some(loaded) => self.loaded_subject(loaded, active, subjects),
        }
    }

    fn loaded_subject(&mut self, loaded: &str, active: &mut ActiveConfiguration, subjects: &Subjects) {
        let mut destination = ProfileDestination::of(subjects.state(), loaded, None, true);
        let settings_of = |profile: &Profile| {
            let subject = LoadedSubject { id: loaded.to_owned(), build: Some(profile.build()) };
            ActiveConfiguration { loaded: Some(subject), ..active.clone() }.settings()
        };
        let in_order = |reason: String| format!("{reason}; put its profile in order and restart");
        let reason = match subjects.claim(loaded) {
            Err(in_use) => format!("{in_use}; load it again once that station has another one"),
            Ok(_claim) => match self.read(&destination, settings_of) {
                Ok(Some(profile)) => {
                    (destination.build, destination.experience) =
                        (Some(profile.build()), profile.experience());
                    active.loaded = Some(LoadedSubject { id: loaded.to_owned(), build: destination.build });
                    self.worker = subjects.add(destination);
                    return subjects.activate(self.worker);
                }
                Ok(None) => in_order(format!("there is no profile {}", destination.path.display())),
                Err(reason) => in_order(reason),
            },
        };
        destination.refusal = Some(format!(
            "{loaded} was in use: {reason}, or load another subject (`equipoise subject load ID`)"
        ));
        self.start_unidentified(active, subjects, destination);
    }

    /// Starts with a subject without data, of whom nothing is saved: who is on the plate is unknown, and must not become
    /// the configured subject.
    fn start_unidentified(
        &mut self,
        active: &mut ActiveConfiguration,
        subjects: &Subjects,
        destination: ProfileDestination,
    ) {
        let reason = destination.refusal.clone().unwrap_or_default();
        self.warn(format!("a worker without data is identified and not saved: {reason}"));
        let name = if destination.subject.is_empty() { ANONYMOUS } else { &destination.subject };
        active.loaded = Some(LoadedSubject { id: name.to_owned(), build: None });
        self.memory.start(&active.settings());
        self.worker = subjects.add(destination);
        subjects.activate(self.worker);
    }

    fn configured_subject(&mut self, settings: &Settings, subjects: &Subjects) {
        let Some(destination) = subjects.get(subjects::CONFIGURED) else { return };
        if let Err(in_use) = subjects.claim(&destination.subject) {
            self.warn(format!("{in_use}; what is learnt now is not saved"));
            let remedy =
                "name the worker of this station in subject.id, or load one (`equipoise subject load ID`)";
            return subjects.refuse(subjects::CONFIGURED, format!("{in_use}; {remedy}"));
        }
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
                let id = &destination.subject;
                let remedy = format!("move it away, and load it again: `equipoise subject load {id}`");
                subjects.refuse(subjects::CONFIGURED, format!("{reason} (not overwritten; {remedy})"));
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
            Ok((shift, age_s, message)) => {
                self.memory.resume_shift(&shift, now_ns().wrapping_sub(age_s * NS_PER_S));
                self.report(message);
            }
            Err(reason) => self.report(format!("a new shift begins: {reason}")),
        }
        Ok(Some(profile))
    }

    fn restore_station(&mut self, config: &Config, settings: &Settings, station: &StationFile) {
        if let Some(other) = station.other_model(config) {
            self.warn(format!("{other}; parameters identified with one model need not fit another"));
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
        if let Some(part) = station.registration.as_ref().filter(|_| settings.suit_drifts) {
            self.restore_registration(config, settings, part);
        }
    }

    /// After the tare, to which the offset refers.
    fn restore_force_offset(&mut self, config: &Config, part: &ForceOffsetPart, in_use: &str) {
        let mass_kg = self.memory.identification.mass_kg;
        let restored = part.offset(in_use, mass_kg, config, now_ns()).and_then(|offset| {
            let is_sound = self.memory.resume_force_offset(&offset);
            is_sound.then_some(offset.mean_n).ok_or_else(|| "a number of it is out of range".to_owned())
        });
        self.report(match restored {
            Ok(mean_n) => format!("the force offset of {mean_n:.1} N is restored"),
            Err(reason) => format!("the force offset is estimated again: {reason}"),
        });
    }

    fn restore_registration(&mut self, config: &Config, settings: &Settings, part: &RegistrationPart) {
        let restored = part.registration(config, now_ns()).and_then(|registration| {
            let is_sound = self.memory.resume_registration(&registration, settings);
            is_sound.then_some(()).ok_or_else(|| "a number of it is out of range".to_owned())
        });
        let outcome = match restored {
            Ok(()) => "restored, if the suit was not restarted".to_owned(),
            // Newly configured frames describe the present position of the suit world.
            Err(reason) if !part.is_in_frames_of(config) => format!("that of the configuration: {reason}"),
            // Also without a body: the next subject loaded may have one.
            Err(reason) => {
                self.memory.invalidate_registration();
                format!("estimated again: {reason}")
            }
        };
        self.report(format!("the position of the suit's world is {outcome}"));
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

#[cfg(test)]
mod tests {
    use std::fs;

    use equipoise_core::cycle::{StoredForceOffset, StoredState};
    use equipoise_station::state_directory::StateDirectory;

    use super::*;
    use crate::example_config;
    use crate::profile::example;
    use crate::station_file::{SubjectPart, TarePart};

    fn config() -> Config {
        example_config::config("alice", "mass_kg = 70.0\n")
    }

    fn profile(subject: &str, lifts: u64) -> String {
        example::text(subject, lifts, &config().settings())
    }

    /// Restores with the profiles of alice (7 lifts) and, if given, bob's text and the station's text. Returns the
    /// subject in use, its lifts and whether it is saved.
    fn restore(bob: Option<&str>, station: Option<&str>) -> (String, u64, bool, Restored) {
        let directory = tempfile::tempdir().unwrap();
        let state = StateDirectory::at(directory.path());
        fs::create_dir_all(state.profiles()).unwrap();
        fs::create_dir_all(state.stations()).unwrap();
        fs::write(state.profile("alice"), profile("alice", 7)).unwrap();
        for (path, text) in [(state.profile("bob"), bob), (state.station("s"), station)] {
            if let Some(text) = text {
                fs::write(path, text).unwrap();
            }
        }
        let configured = ProfileDestination::of(&state, "alice", None, true);
        let subjects = Subjects::new(state, "s", configured);
        let mut active = ActiveConfiguration { config: config(), loaded: None, similar: None };
        let restored = Restored::find(&mut active, &subjects);
        assert_eq!(subjects.in_use(), restored.worker);
        let in_use = subjects.get(restored.worker).unwrap();
        assert_eq!(active.with_subject_in_use().subject.id == "alice", in_use.subject == "alice");
        let lifts = restored.memory.exposure.dose.lifts;
        (in_use.subject, lifts, in_use.refusal.is_none(), restored)
    }

    fn station(in_use: &str) -> String {
        let subject = SubjectPart::of(in_use, &config());
        StationFile { subject, ..StationFile::new("s") }.to_toml().unwrap()
    }

    /// The text of the station's file with the position of the suit's world since long before the start.
    fn station_with_position(in_use: &str, frames: &Config) -> String {
        let mut stored = bytemuck::zeroed_box::<StoredState>();
        (stored.registration.suit_time_ns, stored.registration.suit_period_ns) = (1, 10_000_000);
        let subject = SubjectPart::of(in_use, &config());
        let registration = RegistrationPart::of(&stored, frames);
        StationFile { subject, registration, ..StationFile::new("s") }.to_toml().unwrap()
    }

    fn stored(restored: &Restored) -> Box<StoredState> {
        let mut stored = bytemuck::zeroed_box::<StoredState>();
        stored.copy_from(&restored.memory, &config().settings());
        stored
    }

    fn position_is_lost(restored: &Restored) -> bool {
        stored(restored).registration.station_from_suit_sigma_rad >= core::f64::consts::PI
    }

    #[test]
    fn a_lost_position_of_the_suit_s_world_stays_lost_over_any_number_of_starts_without_the_suit() {
        let (.., first) = restore(None, Some(&station_with_position("alice", &config())));
        let again = |restored: &Restored, frames: &Config| {
            let registration = RegistrationPart::of(&stored(restored), frames);
            let file = StationFile { registration, ..StationFile::new("s") };
            restore(None, Some(&file.to_toml().unwrap())).3
        };
        let second = again(&first, &config());
        assert!(position_is_lost(&second) && position_is_lost(&again(&second, &config())));
        assert!(second.messages.join("\n").contains("it was lost before"), "{:?}", second.messages);
        let mut moved = config();
        moved.ground.frame.yaw_deg = 90.0;
        assert!(!position_is_lost(&again(&first, &moved)), "the configured frame is newer");
        let (.., never) = restore(None, Some(&station("alice")));
        assert!(!position_is_lost(&again(&never, &config())));
    }

    #[test]
    fn an_outdated_position_of_the_suit_s_world_is_lost_also_for_a_subject_without_a_body() {
        for in_use in ["alice", ""] {
            let (.., restored) = restore(None, Some(&station_with_position(in_use, &config())));
            assert_eq!(restored.memory.identification.has_body(), in_use == "alice");
            assert!(position_is_lost(&restored), "{in_use}");
            assert!(restored.messages.join("\n").contains("is estimated again"), "{:?}", restored.messages);
        }
        let mut moved = config();
        moved.ground.frame.yaw_deg = 90.0;
        let (.., restored) = restore(None, Some(&station_with_position("alice", &moved)));
        assert!(!position_is_lost(&restored), "the configured frame is newer");
        assert!(
            restored.messages.join("\n").contains("that of the configuration"),
            "{:?}",
            restored.messages
        );
    }

    #[test]
    fn a_force_offset_is_restored_for_the_same_subject_and_mass() {
        let restored_n = |subject: &str, mass_kg: f64| {
            let mut copy = bytemuck::zeroed_box::<StoredState>();
            copy.force_offset = StoredForceOffset { mean_n: 18.0, sigma_n: 1.0, mass_kg, time_ns: now_ns() };
            let force_offset = ForceOffsetPart::of(&copy, subject, &config());
            let file = StationFile { force_offset, ..StationFile::new("s") };
            let (.., restored) = restore(None, Some(&file.to_toml().unwrap()));
            assert!(restored.messages.join("\n").contains("the force offset"), "{:?}", restored.messages);
            stored(&restored).force_offset.mean_n
        };
        assert_eq!(restored_n("alice", 70.0), 18.0);
        assert_eq!((restored_n("bob", 70.0), restored_n("alice", 71.0)), (0.0, 0.0));
    }

    #[test]
    fn a_tare_beyond_the_range_of_any_plate_is_not_used() {
        for (vertical_n, used) in [(41.0, true), (2e6, false)] {
            let mut stored = bytemuck::zeroed_box::<StoredState>();
            stored.tare.force_n[2] = vertical_n;
            let tare = TarePart::of(&stored.tare, unix_s(), &config());
            let file = StationFile { tare, ..StationFile::new("s") };
            let (.., restored) = restore(None, Some(&file.to_toml().unwrap()));
            assert_eq!(restored.memory.tare().force_n[2], if used { vertical_n } else { 0.0 });
            let messages = restored.messages.join("\n");
            let refusal = "the tare is not used: a number of it is out of range";
            assert_eq!(messages.contains(refusal), !used, "{messages}");
        }
    }

    #[test]
    fn only_the_subject_in_use_is_restored() {
        let of = |bob: Option<&str>, text: Option<&str>| {
            let (subject, lifts, is_saved, _) = restore(bob, text);
            (subject, lifts, is_saved)
        };
        assert_eq!(of(None, None), ("alice".to_owned(), 7, true));
        assert_eq!(of(None, Some(&station("alice"))), ("alice".to_owned(), 7, true));
        let bob = profile("bob", 3);
        assert_eq!(of(Some(&bob), Some(&station("bob"))), ("bob".to_owned(), 3, true));
    }

    #[test]
    fn a_subject_in_use_at_another_station_is_neither_restored_nor_saved() {
        let directory = tempfile::tempdir().unwrap();
        let state = StateDirectory::at(directory.path());
        for (loaded, id) in [(None, "alice"), (Some("bob"), "bob")] {
            fs::create_dir_all(state.profiles()).unwrap();
            fs::create_dir_all(state.stations()).unwrap();
            fs::write(state.profile(id), profile(id, 7)).unwrap();
            fs::write(state.station("s"), station(loaded.unwrap_or("alice"))).unwrap();
            let subjects = |station| {
                let configured = ProfileDestination::of(&state, "alice", None, true);
                Subjects::new(state.clone(), station, configured)
            };
            let (here, elsewhere) = (subjects("s"), subjects("elsewhere"));
            let _claim = elsewhere.claim(id).unwrap();
            let mut active = ActiveConfiguration { config: config(), loaded: None, similar: None };
            let restored = Restored::find(&mut active, &here);
            let in_use = here.get(restored.worker).unwrap();
            assert_eq!((in_use.subject.as_str(), restored.memory.exposure.dose.lifts), (id, 0));
            let refusal = in_use.refusal.unwrap();
            assert!(
                refusal.contains("station elsewhere (process ") && refusal.contains("subject load"),
                "{refusal}"
            );
            assert!(restored.messages.join("\n").contains("station elsewhere"), "{:?}", restored.messages);
        }
    }

    #[test]
    fn a_subject_in_use_that_cannot_be_restored_does_not_become_the_configured_one() {
        for (bob, text, subject) in [
            (Some("damaged"), station("bob"), "bob"),
            (None, station("bob"), "bob"),
            (None, station(""), ""),
            (None, "damaged".to_owned(), ""),
        ] {
            let (in_use, lifts, is_saved, restored) = restore(bob, Some(&text));
            assert_eq!((in_use.as_str(), lifts, is_saved), (subject, 0, false), "{text}");
            assert_eq!(restored.memory.identification.poses_used, 0);
            let messages = restored.messages.join("\n");
            assert!(messages.contains("`equipoise subject load ID`"), "{messages}");
        }
    }
}
