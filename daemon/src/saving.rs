//! Writes persistent state to disk, in a separate thread so that no other thread waits for the disk.
//!
//! The loop provides a copy twice a second; differences from the file are written, and failed writes are retried with
//! the next copy, so a full disk loses data only while it is full.

mod lifts;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam_channel::{select, tick};
use equipoise_core::cycle::{StoredState, Tare};
use equipoise_core::handover::experience::Experience;
use equipoise_core::message::Incident;
use equipoise_core::time::NS_PER_S;
use equipoise_files::atomic_file::write_atomically;
use tracing::warn;

use crate::active_configuration::SharedConfiguration;
use crate::incidents::IncidentBoard;
use crate::planner::SharedWorker;
use crate::profile::{Profile, unix_s};
use crate::realtime::now_ns;
use crate::rings::SavingEnds;
use crate::station_file::{ForceOffsetPart, ModelPart, RegistrationPart, StationFile, SubjectPart, TarePart};
use crate::subjects::{ProfileDestination, Subjects};

use lifts::LiftLog;

/// Polling interval for the loop's copies: the loop wakes no thread for them.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Registration and force offset change with every sample; without other changes they are written at this interval.
const TRACKED_INTERVAL: Duration = Duration::from_millis(900);
/// An unchanged shift gets a new date at this interval while the subject is present.
const SHIFT_DATE_INTERVAL: Duration = Duration::from_secs(600);
/// Maximum age of the suit data of a present subject, ns. The shift of an absent subject keeps its date.
const SUIT_RECENT_NS: u64 = 10 * NS_PER_S;

/// Dependencies of the saving thread.
#[derive(Debug)]
pub struct Saver {
    /// Source of the loop's copies.
    pub ends: SavingEnds,
    /// The subjects and their files.
    pub subjects: Arc<Subjects>,
    /// Receives the data of the subject in use.
    pub worker: Arc<SharedWorker>,
    /// The active configuration.
    pub active_configuration: Arc<SharedConfiguration>,
    /// Receives the incident of a failed write.
    pub board: Arc<IncidentBoard>,
    /// The station file is not written: saving is disabled, or the existing file cannot be parsed.
    pub station_refused: bool,
    /// The tare of the file and its time, s since 1970 UTC.
    pub tare: (Tare, u64),
}

/// Saves until the loop has ended and its last copy is written.
pub fn run(saver: Saver) {
    let mut writer = Writer::new(saver);
    let ticks = tick(POLL_INTERVAL);
    loop {
        let ended = writer.saver.ends.control.has_ended();
        writer.drain();
        if ended {
            // Retry what could not be written with the last copy.
            writer.write();
            if !(writer.profiles.is_empty() && writer.station_text.is_none() && writer.lifts.is_written()) {
                warn!("the newest data of the subject are lost: they could not be written");
            }
            return;
        }
        select! {
            recv(ticks) -> _ => {}
            recv(writer.saver.ends.control.ended()) -> _ => {}
        }
    }
}

struct Writer {
    saver: Saver,
    /// The last profile, dated 0, and the number of its subject.
    profile: Option<(u64, Profile)>,
    /// When the file got its date; `None` if that is older than this process.
    profile_dated: Option<Instant>,
    /// The last content of the station file, dated 0.
    station: Option<StationFile>,
    station_written: Option<Instant>,
    /// Pending profiles by subject number.
    profiles: BTreeMap<u64, String>,
    station_text: Option<String>,
    /// The lists of lifts.
    lifts: LiftLog,
    /// Error of data that cannot be encoded.
    encoding_error: Option<String>,
}

impl Writer {
    fn new(saver: Saver) -> Writer {
        Writer {
            saver,
            profile: None,
            profile_dated: None,
            station: None,
            station_written: None,
            profiles: BTreeMap::new(),
            station_text: None,
            lifts: LiftLog::default(),
            encoding_error: None,
        }
    }

    /// Ingests all copies; only the last one of each subject counts.
    fn drain(&mut self) {
        let mut newest: Option<(u64, Box<StoredState>)> = None;
        while let Ok((number, copy)) = self.saver.ends.copies.pop() {
            if let Some((before, copy)) = newest.replace((number, copy)) {
                if before != number {
                    self.encode_profile(before, &copy);
                }
                self.return_copy(copy);
            }
        }
        let Some((number, copy)) = newest else { return };
        self.saver.worker.set(number, &copy.subject);
        self.encode_profile(number, &copy);
        self.encode_station(number, &copy);
        self.return_copy(copy);
        self.write();
        if self.profiles.is_empty() && self.lifts.is_written() {
            // The loop provides no copy of an earlier number any more.
            self.saver.subjects.release_unused(number);
        }
    }

    fn return_copy(&mut self, copy: Box<StoredState>) {
        // Cannot fail: the ring has as many slots as there are boxes.
        let _ = self.saver.ends.free_copies.push(copy);
        self.saver.ends.control.count_processed_copy();
    }

    fn encode_profile(&mut self, number: u64, copy: &StoredState) {
        if copy.subject.identified != 1 {
            // The ratios refer to the predictions of the previous identification.
            self.saver.subjects.update_experience(number, |experience| *experience = Experience::default());
        }
        let Some(destination) =
            self.saver.subjects.get(number).filter(|destination| destination.refusal.is_none())
        else {
            // Keep no data of a deleted subject.
            self.profile = None;
            return;
        };
        self.lifts.ingest(number, &copy.shift, now_ns(), unix_s());
        let of = |saved_unix_s| {
            let ProfileDestination { subject, build, experience, .. } = &destination;
            Profile::of(subject, (*build)?, &copy.subject, &copy.shift, experience, saved_unix_s)
        };
        let Some(undated) = of(0) else { return };
        let before = self.profile.as_ref().filter(|(of, _)| *of == number).map(|(_, profile)| profile);
        let suit_recent = now_ns().saturating_sub(copy.registration.suit_time_ns) < SUIT_RECENT_NS;
        if before.is_none() && !suit_recent && destination.path.exists() {
            // What was read from the file, which keeps its date.
            (self.profile, self.profile_dated) = (Some((number, undated)), None);
            return;
        }
        let date_is_current =
            !suit_recent || self.profile_dated.is_some_and(|at| at.elapsed() < SHIFT_DATE_INTERVAL);
        if before == Some(&undated) && date_is_current {
            return;
        }
        match of(unix_s()).map(|profile| profile.to_toml()) {
            Some(Ok(text)) => {
                self.profile_dated = Some(Instant::now());
                self.profile = Some((number, undated));
                self.profiles.insert(number, text);
                self.saver.subjects.set_unwritten(number, true);
            }
            Some(Err(reason)) => {
                self.encoding_error =
                    Some(format!("cannot encode the profile of {}: {reason}", destination.subject));
            }
            None => {}
        }
    }

    fn encode_station(&mut self, number: u64, copy: &StoredState) {
        let subject =
            self.saver.subjects.get(number).map(|destination| destination.subject).unwrap_or_default();
        if self.saver.station_refused {
            return;
        }
        if copy.tare != self.saver.tare.0 {
            self.saver.tare = (copy.tare, unix_s());
        }
        let (tare, taken_unix_s) = self.saver.tare;
        let undated = self.saver.active_configuration.with(|active| {
            let config = &active.config;
            StationFile {
                subject: SubjectPart::of(&subject, config),
                model: ModelPart::of(config),
                tare: TarePart::of(&tare, taken_unix_s, config),
                registration: RegistrationPart::of(copy, config),
                force_offset: ForceOffsetPart::of(copy, &subject, config),
                ..StationFile::new(&config.station)
            }
        });
        let only_tracked_changed = self.station.as_ref().is_some_and(|before| {
            let StationFile { registration, force_offset, .. } = undated.clone();
            StationFile { registration, force_offset, ..before.clone() } == undated
        });
        let recently = self.station_written.is_some_and(|at| at.elapsed() < TRACKED_INTERVAL);
        if self.station.as_ref() == Some(&undated) || (only_tracked_changed && recently) {
            return;
        }
        match (StationFile { saved_unix_s: unix_s(), ..undated.clone() }).to_toml() {
            Ok(text) => {
                self.station_written = Some(Instant::now());
                self.station_text = Some(text);
                self.station = Some(undated);
            }
            Err(reason) => self.encoding_error = Some(format!("cannot encode the station's file: {reason}")),
        }
    }

    /// Writes all pending files; failed ones remain pending.
    fn write(&mut self) {
        let mut failed = self.encoding_error.take();
        let subjects = &self.saver.subjects;
        // Before the profiles, which contain the dose: a lift whose dose is stored is in the list.
        if let Err((path, error)) = self.lifts.write(subjects) {
            failed = Some(format!("cannot write the list of lifts {}: {error}", path.display()));
        }
        self.profiles.retain(|number, text| {
            let written = subjects.write(*number, |destination| {
                write_atomically(&destination.path, text.as_bytes())
                    .map_err(|error| (destination.path.clone(), error))
            });
            if let Err((path, error)) = &written {
                failed = Some(format!("cannot write the profile {}: {error}", path.display()));
            } else {
                subjects.set_unwritten(*number, false);
            }
            written.is_err()
        });
        if let Some(text) = &self.station_text {
            let station = self.saver.active_configuration.with(|active| active.config.station.clone());
            let path = subjects.state().station(&station);
            match write_atomically(&path, text.as_bytes()) {
                Ok(()) => self.station_text = None,
                Err(error) => {
                    failed = Some(format!("cannot write the station's file {}: {error}", path.display()));
                }
            }
        }
        let failed = failed
            .map(|reason| format!("{reason}; all is kept in memory and written as soon as it can be"))
            .or_else(|| self.refusal());
        match failed {
            None => self.saver.board.end(Incident::NotSaved),
            Some(reason) => self.saver.board.begin(Incident::NotSaved, &reason),
        }
    }

    /// Why nothing is saved of the subject in use, unless the configuration disables saving.
    fn refusal(&self) -> Option<String> {
        if !self.saver.active_configuration.with(|active| active.config.subject.save_profile) {
            return None;
        }
        let refusal = self.saver.subjects.get(self.saver.subjects.in_use())?.refusal?;
        Some(format!("the worker in use is not saved: {refusal}"))
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::MetadataExt;

    use bytemuck::Zeroable;
    use equipoise_station::state_directory::StateDirectory;

    use super::*;
    use crate::active_configuration::ActiveConfiguration;
    use crate::rings::{LoopEnds, Rings};
    use crate::{example_config, profile};

    #[test]
    fn the_profile_of_an_absent_worker_keeps_its_date() {
        let directory = tempfile::tempdir().unwrap();
        let state = StateDirectory::at(directory.path());
        fs::create_dir_all(state.profiles()).unwrap();
        let config = example_config::config("alice", "mass_kg = 70.0\n");
        let (settings, path) = (config.settings(), state.profile("alice"));
        fs::write(&path, profile::example::text("alice", 3, &settings)).unwrap();
        let profile = Profile::read(&path).unwrap().unwrap();
        let Rings { saving, loop_ends, settings: sender, .. } = Rings::new().unwrap();
        let LoopEnds { mut copies, .. } = loop_ends;
        let alice = ProfileDestination::of(&state, "alice", Some(profile.build()), true);
        let subjects = Arc::new(Subjects::new(state, "s", alice));
        let active = ActiveConfiguration { config, loaded: None, similar: None };
        let mut writer = Writer::new(Saver {
            ends: saving,
            subjects: Arc::clone(&subjects),
            worker: Arc::default(),
            active_configuration: Arc::new(SharedConfiguration::new(active, sender)),
            board: Arc::default(),
            station_refused: true,
            tare: (Tare::zeroed(), 0),
        });
        let file = fs::metadata(&path).unwrap().ino();
        for (suit_time_ns, is_kept) in [(0, true), (now_ns(), false)] {
            let mut copy = bytemuck::zeroed_box::<StoredState>();
            profile.worker(&settings).unwrap().store(&mut copy.subject);
            copy.registration.suit_time_ns = suit_time_ns;
            copies.push((subjects.in_use(), copy)).unwrap();
            writer.drain();
            assert_eq!(fs::metadata(&path).unwrap().ino() == file, is_kept, "{suit_time_ns}");
        }
    }
}
