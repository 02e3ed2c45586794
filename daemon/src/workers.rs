//! Whose profile is saved: the configured worker's, or that of whoever was loaded since.
//!
//! Each worker of this daemon's life has a number, and what is learnt travels with it. So a pose that was learnt just
//! before another worker was loaded still goes to its own profile.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::profile::Build;
use crate::state_directory::StateDirectory;

/// The configured worker.
pub const CONFIGURED: u64 = 0;

/// Where a worker is saved.
#[derive(Debug, Clone, PartialEq)]
pub struct Saving {
    /// The pseudonym; empty for somebody who has none and is not kept.
    pub subject: String,
    /// The file.
    pub path: PathBuf,
    /// The list of the lifts, beside it.
    pub lifts: PathBuf,
    /// How the worker is built; `None` if that is not known.
    pub build: Option<Build>,
    /// Whether the configuration asks to remember.
    pub remember: bool,
    /// Why it is not written, if so: nobody asked to remember, or the file is there and cannot be understood.
    pub refusal: Option<String>,
}

impl Saving {
    /// Saves a subject under its own name; not, with a reason, if nobody asked to remember.
    pub fn of(state: &StateDirectory, subject: &str, build: Option<Build>, remember: bool) -> Saving {
        let refusal = (!remember)
            .then(|| "subject.remember is false in the configuration, so no profile is kept".to_owned());
        let (path, lifts) = (state.profile(subject), state.lifts(subject));
        Saving { subject: subject.to_owned(), path, lifts, build, remember, refusal }
    }

    /// Somebody without a name, of whom nothing is kept.
    pub fn nobody() -> Saving {
        Saving {
            subject: String::new(),
            path: PathBuf::new(),
            lifts: PathBuf::new(),
            build: None,
            remember: false,
            refusal: Some("the subject that was in use was deleted; load another first".to_owned()),
        }
    }
}

/// All workers so far; the last one loaded is the one in use.
#[derive(Debug)]
pub struct Workers {
    state: StateDirectory,
    all: Mutex<Vec<Saving>>,
    in_use: AtomicU64,
    /// Held while a profile is written, so that none is written once it is forgotten.
    disk: Mutex<()>,
}

impl Workers {
    /// Begins with the configured worker.
    pub fn new(state: StateDirectory, configured: Saving) -> Workers {
        Workers {
            state,
            all: Mutex::new(vec![configured]),
            in_use: AtomicU64::new(CONFIGURED),
            disk: Mutex::new(()),
        }
    }

    /// Where all of them are saved.
    pub fn state(&self) -> &StateDirectory {
        &self.state
    }

    /// Takes in one more and gives back its number.
    pub fn add(&self, saving: Saving) -> u64 {
        self.with(|all| {
            all.push(saving);
            all.len() as u64 - 1
        })
    }

    /// The worker of a number.
    pub fn get(&self, number: u64) -> Option<Saving> {
        self.with(|all| all.get(number as usize).cloned())
    }

    /// Number of the worker that the loop was last given.
    pub fn in_use(&self) -> u64 {
        self.in_use.load(Ordering::Relaxed)
    }

    /// The loop was given this one.
    pub fn use_from_now_on(&self, number: u64) {
        self.in_use.store(number, Ordering::Relaxed);
    }

    /// Says why a worker is not saved.
    pub fn refuse(&self, number: u64, why: String) {
        self.with(|all| {
            if let Some(saving) = all.get_mut(number as usize) {
                saving.refusal = Some(why);
            }
        });
    }

    /// Writes for a worker, unless something forbids it by now.
    ///
    /// # Errors
    /// What `write` returns.
    pub fn write<E>(&self, number: u64, write: impl FnOnce(&Saving) -> Result<(), E>) -> Result<(), E> {
        let _disk = self.disk.lock().unwrap_or_else(PoisonError::into_inner);
        match self.get(number).filter(|saving| saving.refusal.is_none()) {
            Some(saving) => write(&saving),
            None => Ok(()),
        }
    }

    /// Forgets a subject under whatever numbers it had. When this returns, nothing is written under its name any more.
    pub fn forget(&self, subject: &str) {
        self.with(|all| {
            for saving in all.iter_mut().filter(|saving| saving.subject == subject) {
                *saving = Saving::nobody();
            }
        });
        drop(self.disk.lock());
    }

    fn with<T>(&self, look: impl FnOnce(&mut Vec<Saving>) -> T) -> T {
        // A list is never half changed.
        look(&mut self.all.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn workers() -> Workers {
        let state = StateDirectory::at(std::path::Path::new("/nowhere"));
        let configured = Saving::of(&state, "a", None, true);
        Workers::new(state, configured)
    }

    #[test]
    fn every_worker_keeps_a_file_of_its_own() {
        let workers = workers();
        let second = workers.add(Saving::of(workers.state(), "b", None, false));
        let of = |number| workers.get(number).unwrap();
        assert_eq!((of(CONFIGURED).subject.as_str(), of(CONFIGURED).refusal), ("a", None));
        assert_eq!(of(second).subject, "b");
        assert!(of(second).refusal.is_some() && of(second).path != of(CONFIGURED).path);
        assert_eq!(workers.get(7), None);
    }

    #[test]
    fn who_is_forgotten_is_written_no_more() {
        let workers = workers();
        let again = workers.add(Saving::of(workers.state(), "a", None, true));
        let written = |number| {
            let mut written = false;
            let _ = workers.write::<()>(number, |_| {
                written = true;
                Ok(())
            });
            written
        };
        assert!(written(CONFIGURED) && written(again));
        workers.forget("a");
        assert!(!written(CONFIGURED) && !written(again));
        assert_eq!(workers.get(again).unwrap().subject, "");
    }
}
