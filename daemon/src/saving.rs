//! Writes persistent state to disk, in a separate thread so that no other thread waits for the disk.
//!
//! The loop provides a copy twice a second; differences from the file are written, and failed writes are retried with
//! the next copy, so a full disk loses data only while it is full.

mod lifts;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use equipoise_core::cycle::{StoredState, Tare};
use equipoise_core::message::Incident;
use equipoise_core::time::NS_PER_S;
use tracing::warn;

use crate::in_force::InForce;
use crate::incidents::IncidentBoard;
use crate::profile::{Profile, unix_s};
use crate::realtime::now_ns;
use crate::rings::Rings;
use crate::station_file::{ModelPart, RegistrationPart, StationFile, SubjectPart, TarePart};
use crate::status::StatusFile;
use crate::whole_file::write_whole;
use crate::workers::Workers;

use lifts::LiftLog;

/// Polling interval for the loop's copies.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// The registration changes with every sample; without other changes it is written at this interval.
const REGISTRATION_EVERY: Duration = Duration::from_millis(900);
/// An unchanged shift gets a new date at this interval while the subject is present.
const SHIFT_DATED_EVERY: Duration = Duration::from_secs(600);
/// Maximum age of the suit data of a present subject, ns. The shift of an absent subject keeps its date.
const SEEN_NS: u64 = 10 * NS_PER_S;

/// Dependencies of the saving thread.
#[derive(Debug)]
pub struct Saver {
    /// Source of the loop's copies.
    pub rings: Arc<Rings>,
    /// The subjects and their files.
    pub workers: Arc<Workers>,
    /// The active configuration.
    pub in_force: Arc<InForce>,
    /// Receives the incident of a failed write.
    pub board: Arc<IncidentBoard>,
    /// The status file, which displays the active subject.
    pub status: StatusFile,
    /// The station file is not written: saving is disabled, or the existing file cannot be parsed.
    pub station_refused: bool,
    /// The tare of the file and its time, s since 1970 UTC.
    pub tare: (Tare, u64),
}

/// Saves until the loop has ended and its last copy is written.
pub fn run(saver: Saver) {
    let mut keeper = Keeper {
        saver,
        profile: None,
        profile_dated: Instant::now(),
        station: None,
        station_written: None,
        profiles: BTreeMap::new(),
        station_text: None,
        lifts: LiftLog::default(),
        unencoded: None,
    };
    loop {
        let ended = keeper.saver.rings.has_ended();
        keeper.take_all();
        if ended {
            // Retry what could not be written with the last copy.
            keeper.write();
            if !(keeper.profiles.is_empty() && keeper.station_text.is_none() && keeper.lifts.is_written()) {
                warn!("what was learnt last is lost: it could not be written");
            }
            return;
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

struct Keeper {
    saver: Saver,
    /// The last profile, dated 0, and the number of its subject.
    profile: Option<(u64, Profile)>,
    profile_dated: Instant,
    /// The last content of the station file, dated 0.
    station: Option<StationFile>,
    station_written: Option<Instant>,
    /// Pending profiles by subject number.
    profiles: BTreeMap<u64, String>,
    station_text: Option<String>,
    /// The lists of lifts.
    lifts: LiftLog,
    /// Error of data that cannot be encoded.
    unencoded: Option<String>,
}

impl Keeper {
    /// Ingests all copies; only the last one of each subject counts.
    fn take_all(&mut self) {
        let mut newest: Option<(u64, Box<StoredState>)> = None;
        while let Some((number, kept)) = self.saver.rings.kept.pop() {
            if let Some((before, kept)) = newest.replace((number, kept)) {
                if before != number {
                    self.take_profile(before, &kept);
                }
                self.give_back(kept);
            }
        }
        let Some((number, kept)) = newest else { return };
        self.take_profile(number, &kept);
        self.take_station(number, &kept);
        self.give_back(kept);
        self.write();
    }

    fn give_back(&self, kept: Box<StoredState>) {
        // Cannot fail: the ring has as many slots as there are boxes.
        let _ = self.saver.rings.keep_blank.push(kept);
    }

    fn take_profile(&mut self, number: u64, kept: &StoredState) {
        let Some(saving) = self.saver.workers.get(number).filter(|saving| saving.refusal.is_none()) else {
            // Keep no data of a deleted subject.
            self.profile = None;
            return;
        };
        self.lifts.take(number, &kept.shift, now_ns(), unix_s());
        let of = |saved_unix_s| {
            Profile::of(&saving.subject, saving.build, &kept.subject, &kept.shift, saved_unix_s)
        };
        let Some(undated) = of(0) else { return };
        let same = self.profile.as_ref().is_some_and(|(of, profile)| *of == number && *profile == undated);
        let seen = now_ns().saturating_sub(kept.registration.suit_time_ns) < SEEN_NS;
        let dated = !seen || self.profile_dated.elapsed() < SHIFT_DATED_EVERY;
        if same && dated {
            return;
        }
        match of(unix_s()).map(|profile| profile.to_toml()) {
            Some(Ok(text)) => {
                self.profile_dated = Instant::now();
                self.profile = Some((number, undated));
                self.profiles.insert(number, text);
            }
            Some(Err(why)) => {
                self.unencoded = Some(format!("cannot encode the profile of {}: {why}", saving.subject));
            }
            None => {}
        }
    }

    fn take_station(&mut self, number: u64, kept: &StoredState) {
        let subject = self.saver.workers.get(number).map(|saving| saving.subject).unwrap_or_default();
        self.saver.status.set_subject(&subject);
        if self.saver.station_refused {
            return;
        }
        if kept.tare != self.saver.tare.0 {
            self.saver.tare = (kept.tare, unix_s());
        }
        let (tare, taken_unix_s) = self.saver.tare;
        let undated = self.saver.in_force.look(|forced| {
            let config = &forced.config;
            StationFile {
                subject: SubjectPart::of(&subject, config),
                model: ModelPart::of(config),
                tare: TarePart::of(&tare, taken_unix_s, config),
                registration: RegistrationPart::of(kept, config),
                ..StationFile::new(&config.station)
            }
        });
        let only_moved = self.station.as_ref().is_some_and(|before| {
            StationFile { registration: undated.registration.clone(), ..before.clone() } == undated
        });
        let recently = self.station_written.is_some_and(|at| at.elapsed() < REGISTRATION_EVERY);
        if self.station.as_ref() == Some(&undated) || (only_moved && recently) {
            return;
        }
        match (StationFile { saved_unix_s: unix_s(), ..undated.clone() }).to_toml() {
            Ok(text) => {
                self.station_written = Some(Instant::now());
                self.station_text = Some(text);
                self.station = Some(undated);
            }
            Err(why) => self.unencoded = Some(format!("cannot encode the station's file: {why}")),
        }
    }

    /// Writes all pending files; failed ones remain pending.
    fn write(&mut self) {
        let mut failed = self.unencoded.take();
        let workers = &self.saver.workers;
        self.profiles.retain(|number, text| {
            let mut note = |path: &PathBuf, error: std::io::Error| {
                failed = Some(format!("cannot write the profile {}: {error}", path.display()));
            };
            let written = workers.write(*number, |saving| {
                write_whole(&saving.path, text.as_bytes()).map_err(|error| note(&saving.path, error))
            });
            written.is_err()
        });
        if let Err((path, error)) = self.lifts.write(workers) {
            failed = Some(format!("cannot write the list of lifts {}: {error}", path.display()));
        }
        if let Some(text) = &self.station_text {
            let station = self.saver.in_force.look(|forced| forced.config.station.clone());
            let path = workers.state().station(&station);
            match write_whole(&path, text.as_bytes()) {
                Ok(()) => self.station_text = None,
                Err(error) => {
                    failed = Some(format!("cannot write the station's file {}: {error}", path.display()));
                }
            }
        }
        match failed {
            None => self.saver.board.end(Incident::NotSaved),
            Some(why) => self.saver.board.begin(
                Incident::NotSaved,
                &format!("{why}; all is kept in memory and written as soon as it can be"),
            ),
        }
    }
}
