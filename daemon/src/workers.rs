//! Whose profile is saved: the configured worker's, or that of whoever was loaded since.
//!
//! Each worker of this daemon's life has a number, and what is learnt travels with it. So a pose that was learnt just
//! before another worker was loaded still goes to its own profile.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use crate::profile::{self, Build};

/// The configured worker.
pub const CONFIGURED: u64 = 0;

/// Where a worker is saved.
#[derive(Debug, Clone, PartialEq)]
pub struct Saving {
    /// The pseudonym.
    pub subject: String,
    /// The file.
    pub path: PathBuf,
    /// How the worker is built; `None` if that is not known.
    pub build: Option<Build>,
    /// Whether the configuration asks to remember.
    pub remember: bool,
    /// Why it is not written, if so: nobody asked to remember, or the file is there and cannot be understood.
    pub refusal: Option<String>,
}

impl Saving {
    /// Saves a subject under its own name; not, with a reason, if nobody asked to remember.
    pub fn of(subject: &str, build: Option<Build>, remember: bool) -> Saving {
        let refusal = (!remember)
            .then(|| "subject.remember is false in the configuration, so no profile is kept".to_owned());
        Saving { subject: subject.to_owned(), path: profile::path_of(subject), build, remember, refusal }
    }
}

/// All workers so far; the last one loaded is the one in use.
#[derive(Debug)]
pub struct Workers(Mutex<Vec<Saving>>);

impl Workers {
    /// Begins with the configured worker.
    pub fn new(configured: Saving) -> Workers {
        Workers(Mutex::new(vec![configured]))
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

    /// Says why a worker is not saved.
    pub fn refuse(&self, number: u64, why: String) {
        self.with(|all| {
            if let Some(saving) = all.get_mut(number as usize) {
                saving.refusal = Some(why);
            }
        });
    }

    fn with<T>(&self, look: impl FnOnce(&mut Vec<Saving>) -> T) -> T {
        // A list is never half changed.
        look(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_worker_keeps_a_file_of_its_own() {
        let workers = Workers::new(Saving::of("a", None, true));
        let second = workers.add(Saving::of("b", None, false));
        let of = |number| workers.get(number).unwrap();
        assert_eq!((of(CONFIGURED).subject.as_str(), of(CONFIGURED).refusal), ("a", None));
        assert_eq!(of(second).subject, "b");
        assert!(of(second).refusal.is_some() && of(second).path != of(CONFIGURED).path);
        assert_eq!(workers.get(7), None);
    }
}
