//! The configuration in force: that of the start, with what was changed live since.

use std::sync::{Mutex, MutexGuard, PoisonError};

use equipoise_core::cycle::Settings;

use crate::config::Config;

/// A configuration and what the loop makes of it.
#[derive(Debug, Clone)]
pub struct Forced {
    /// The configuration.
    pub config: Config,
    /// What the cycle was told.
    pub settings: Settings,
    /// The pseudonym of the similar worker whose parameters are in `settings`, if there is one.
    pub similar: Option<String>,
}

/// [`Forced`], for all threads but the loop.
#[derive(Debug)]
pub struct InForce {
    forced: Mutex<Forced>,
    changing: Mutex<()>,
}

impl InForce {
    /// Begins with the start's.
    pub fn new(forced: Forced) -> InForce {
        InForce { forced: Mutex::new(forced), changing: Mutex::new(()) }
    }

    /// A copy of what holds now.
    pub fn now(&self) -> Forced {
        self.look(Forced::clone)
    }

    /// Looks at what holds now.
    pub fn look<T>(&self, look: impl FnOnce(&Forced) -> T) -> T {
        look(&self.forced.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Whoever reads, changes and replaces it does so alone, for as long as this is held.
    pub fn alone(&self) -> MutexGuard<'_, ()> {
        self.changing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Something else holds from now on.
    pub fn replace(&self, forced: Forced) {
        *self.forced.lock().unwrap_or_else(PoisonError::into_inner) = forced;
    }
}
