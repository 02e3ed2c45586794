//! Which profile is saved: that of the configured subject, or of one loaded later.
//!
//! Each subject loaded during the daemon's lifetime has a number, which accompanies its data. So a pose used just
//! before another subject is loaded still enters the correct profile.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, ErrorKind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use equipoise_config::method::Build;
use equipoise_core::handover::experience::Experience;
use equipoise_files::FileLock;
use equipoise_station::state_directory::StateDirectory;

/// Number of the configured subject.
pub const CONFIGURED: u64 = 0;

/// Why nothing is saved of the worker after the subject in use was deleted.
pub const DELETED: &str =
    "the subject that was in use was deleted; load another first (`equipoise subject load ID`)";

/// Destination of a subject's data.
#[derive(Debug, Clone, PartialEq)]
pub struct ProfileDestination {
    /// The pseudonym; empty for an unnamed subject, which is not saved.
    pub subject: String,
    /// Path of the profile.
    pub path: PathBuf,
    /// Path of the list of lifts.
    pub lifts: PathBuf,
    /// Stature and sex; `None` if unavailable.
    pub build: Option<Build>,
    /// Whether the configuration enables saving.
    pub remember: bool,
    /// Why the profile is not written: saving is disabled, or the existing file cannot be parsed.
    pub refusal: Option<String>,
    /// Measured handovers.
    pub experience: Experience,
}

impl ProfileDestination {
    /// Destination for a subject's own name; refused, with a reason, unless saving is enabled.
    pub fn of(
        state: &StateDirectory,
        subject: &str,
        build: Option<Build>,
        remember: bool,
    ) -> ProfileDestination {
        let refusal = (!remember)
            .then(|| "subject.save_profile is false in the configuration, so no profile is kept".to_owned());
        let (path, lifts) = (state.profile(subject), state.lifts(subject));
        ProfileDestination {
            subject: subject.to_owned(),
            path,
            lifts,
            build,
            remember,
            refusal,
            experience: Experience::default(),
        }
    }

    /// An unnamed subject, of which nothing is saved, with the reason.
    pub fn unnamed(refusal: &str) -> ProfileDestination {
        ProfileDestination {
            subject: String::new(),
            path: PathBuf::new(),
            lifts: PathBuf::new(),
            build: None,
            remember: false,
            refusal: Some(refusal.to_owned()),
            experience: Experience::default(),
        }
    }
}

/// All subjects so far; the last one loaded is active.
#[derive(Debug)]
pub struct Subjects {
    state: StateDirectory,
    station: String,
    /// Locks of the subjects whose files this daemon writes, by pseudonym.
    claims: Mutex<BTreeMap<String, Arc<FileLock>>>,
    all: Mutex<Vec<ProfileDestination>>,
    in_use: AtomicU64,
    /// Numbers whose profile in memory is newer than the file.
    unwritten: Mutex<BTreeSet<u64>>,
    /// Held while a profile is written, so that none is written after its subject is deleted.
    disk: Mutex<()>,
}

impl Subjects {
    /// Begins with the configured subject. `station` is the name under which other daemons report a claim.
    pub fn new(state: StateDirectory, station: &str, configured: ProfileDestination) -> Subjects {
        Subjects {
            state,
            station: station.to_owned(),
            claims: Mutex::default(),
            all: Mutex::new(vec![configured]),
            in_use: AtomicU64::new(CONFIGURED),
            unwritten: Mutex::default(),
            disk: Mutex::new(()),
        }
    }

    /// State directory of all subjects.
    pub fn state(&self) -> &StateDirectory {
        &self.state
    }

    /// Adds a subject; returns its number.
    pub fn add(&self, destination: ProfileDestination) -> u64 {
        self.with(|all| {
            all.push(destination);
            all.len() as u64 - 1
        })
    }

    /// The subject with a number.
    pub fn get(&self, number: u64) -> Option<ProfileDestination> {
        self.with(|all| all.get(number as usize).cloned())
    }

    /// Updates the measured handovers of a subject, unless it has been deleted.
    pub fn update_experience(&self, number: u64, update: impl FnOnce(&mut Experience)) {
        self.with(|all| {
            let destination =
                all.get_mut(number as usize).filter(|destination| !destination.subject.is_empty());
            if let Some(destination) = destination {
                update(&mut destination.experience);
            }
        });
    }

    /// Number of the active subject.
    pub fn in_use(&self) -> u64 {
        self.in_use.load(Ordering::Relaxed)
    }

    /// Sets the active subject.
    pub fn activate(&self, number: u64) {
        self.in_use.store(number, Ordering::Relaxed);
    }

    /// Marks a subject's profile as pending or written.
    pub fn set_unwritten(&self, number: u64, is_unwritten: bool) {
        let mut unwritten = self.unwritten.lock().unwrap_or_else(PoisonError::into_inner);
        if is_unwritten {
            unwritten.insert(number);
        } else {
            unwritten.remove(&number);
        }
    }

    /// Whether the file of a subject is older than what is in memory.
    pub fn is_unwritten(&self, subject: &str) -> bool {
        let unwritten = self.unwritten.lock().unwrap_or_else(PoisonError::into_inner).clone();
        unwritten
            .into_iter()
            .any(|number| self.get(number).is_some_and(|destination| destination.subject == subject))
    }

    /// Disables saving of a subject, with the reason.
    pub fn refuse(&self, number: u64, reason: String) {
        self.with(|all| {
            if let Some(destination) = all.get_mut(number as usize) {
                destination.refusal = Some(reason);
            }
        });
    }

    /// Enables saving of the active subject again; returns whether it was disabled.
    pub fn end_refusal(&self) -> bool {
        let number = self.in_use();
        self.with(|all| {
            all.get_mut(number as usize).is_some_and(|destination| destination.refusal.take().is_some())
        })
    }

    /// Claims the files of a subject for this daemon until [`Subjects::release_unused`], at least while the returned
    /// value exists. `None` if the claim cannot be stored, for example on a full disk: [`Subjects::write`] tries again.
    ///
    /// # Errors
    /// Another daemon has claimed them.
    pub fn claim(&self, subject: &str) -> Result<Option<Arc<FileLock>>, String> {
        match self.try_claim(subject) {
            Ok(claim) => Ok(Some(claim)),
            Err(error) if error.kind() == ErrorKind::ResourceBusy => Err(error.to_string()),
            Err(_) => Ok(None),
        }
    }

    fn try_claim(&self, subject: &str) -> io::Result<Arc<FileLock>> {
        let mut claims = self.claims.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(claim) = claims.get(subject) {
            return Ok(Arc::clone(claim));
        }
        let holder = format!("station {} (process {})", self.station, std::process::id());
        let lock =
            FileLock::acquire(&self.state.lock(subject), &holder).map_err(|error| match error.kind() {
                ErrorKind::ResourceBusy => {
                    let text = format!("{subject} is in use at another station of this computer: {error}");
                    io::Error::new(ErrorKind::ResourceBusy, text)
                }
                _ => error,
            })?;
        let claim = Arc::new(lock);
        claims.insert(subject.to_owned(), Arc::clone(&claim));
        Ok(claim)
    }

    /// Releases the claims of all subjects without a number from `oldest` on, so that other daemons can load them.
    /// Nothing of earlier numbers may be pending.
    pub fn release_unused(&self, oldest: u64) {
        let used: BTreeSet<String> =
            self.with(|all| all.iter().skip(oldest as usize).map(|one| one.subject.clone()).collect());
        let mut claims = self.claims.lock().unwrap_or_else(PoisonError::into_inner);
        claims.retain(|subject, claim| used.contains(subject) || Arc::strong_count(claim) > 1);
    }

    /// Calls `write` for a subject unless saving is disabled.
    ///
    /// # Errors
    /// The error of `write`, or that of the subject's claim, with the path of the file.
    pub fn write(
        &self,
        number: u64,
        write: impl FnOnce(&ProfileDestination) -> Result<(), (PathBuf, io::Error)>,
    ) -> Result<(), (PathBuf, io::Error)> {
        let _disk = self.disk.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(destination) = self.get(number).filter(|destination| destination.refusal.is_none()) else {
            return Ok(());
        };
        let _claim =
            self.try_claim(&destination.subject).map_err(|error| (destination.path.clone(), error))?;
        write(&destination)
    }

    /// Clears a subject under all its numbers. After the return, nothing is written under its name.
    pub fn delete(&self, subject: &str) {
        self.with(|all| {
            for destination in all.iter_mut().filter(|destination| destination.subject == subject) {
                *destination = ProfileDestination::unnamed(DELETED);
            }
        });
        drop(self.disk.lock());
        self.claims.lock().unwrap_or_else(PoisonError::into_inner).remove(subject);
    }

    fn with<T>(&self, access: impl FnOnce(&mut Vec<ProfileDestination>) -> T) -> T {
        // Ignore poisoning: no operation leaves the list half changed.
        access(&mut self.all.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[cfg(test)]
mod tests {
    use equipoise_core::handover::experience::Handover;

    use super::*;

    /// The subjects of a station in a state directory; the configured one is "a".
    fn subjects(directory: &tempfile::TempDir, station: &str) -> Subjects {
        let state = StateDirectory::at(directory.path());
        let configured = ProfileDestination::of(&state, "a", None, true);
        Subjects::new(state, station, configured)
    }

    #[test]
    fn every_subject_has_its_own_file() {
        let directory = tempfile::tempdir().unwrap();
        let subjects = subjects(&directory, "s");
        let second = subjects.add(ProfileDestination::of(subjects.state(), "b", None, false));
        let of = |number| subjects.get(number).unwrap();
        assert_eq!((of(CONFIGURED).subject.as_str(), of(CONFIGURED).refusal), ("a", None));
        assert_eq!(of(second).subject, "b");
        assert!(of(second).refusal.is_some() && of(second).path != of(CONFIGURED).path);
        assert_eq!(subjects.get(7), None);
    }

    #[test]
    fn a_deleted_subject_is_not_written() {
        let directory = tempfile::tempdir().unwrap();
        let subjects = subjects(&directory, "s");
        let again = subjects.add(ProfileDestination::of(subjects.state(), "a", None, true));
        let written = |number| {
            let mut written = false;
            let _ = subjects.write(number, |_| {
                written = true;
                Ok(())
            });
            written
        };
        let learn = |number| {
            subjects.update_experience(number, |all| assert!(all.add(Handover::default())));
            subjects.get(number).unwrap().experience.count()
        };
        assert!(written(CONFIGURED) && written(again));
        assert_eq!((learn(again), learn(again)), (1, 2));
        subjects.set_unwritten(CONFIGURED, true);
        subjects.set_unwritten(again, true);
        subjects.set_unwritten(again, false);
        assert!(subjects.is_unwritten("a") && !subjects.is_unwritten("b"), "under another number");
        subjects.delete("a");
        assert!(!subjects.is_unwritten("a"));
        assert!(!written(CONFIGURED) && !written(again));
        assert_eq!((subjects.get(again).unwrap().subject.as_str(), learn(again)), ("", 0));
        assert!(!subjects.state().lock("a").exists());
    }

    #[test]
    fn the_files_of_a_subject_are_written_by_one_station_at_a_time() {
        let directory = tempfile::tempdir().unwrap();
        let [first, second] = ["press-1", "press-2"].map(|station| subjects(&directory, station));
        drop(first.claim("a").unwrap().expect("a claim"));
        let in_use = "a is in use at another station of this computer: station press-1 (process ";
        assert!(second.claim("a").unwrap_err().starts_with(in_use));
        let (path, error) = second.write(CONFIGURED, |_| panic!("written by two")).unwrap_err();
        assert!(path.ends_with("a.toml") && error.to_string().starts_with(in_use), "{error}");
        // The first station loads another subject, whose data follow those of the one before.
        let next = first.add(ProfileDestination::of(first.state(), "b", None, true));
        first.release_unused(CONFIGURED);
        assert!(second.claim("a").is_err());
        let claimed = first.claim("b").unwrap();
        first.release_unused(next);
        assert_eq!(second.write(CONFIGURED, |_| Ok(())).ok(), Some(()));
        assert!(second.claim("b").is_err());
        drop((claimed, first));
        assert!(second.claim("b").is_ok());
    }

    #[test]
    fn a_claim_is_kept_until_its_subject_has_a_number() {
        let directory = tempfile::tempdir().unwrap();
        let [first, second] = ["press-1", "press-2"].map(|station| subjects(&directory, station));
        let claimed = first.claim("b").unwrap();
        first.release_unused(CONFIGURED);
        assert!(second.claim("b").is_err());
        drop(claimed);
        first.release_unused(CONFIGURED);
        assert!(second.claim("b").is_ok());
    }
}
