//! The active configuration: that of the start, with live changes since.

use std::sync::{Mutex, MutexGuard, PoisonError};

use equipoise_core::cycle::Settings;

use crate::config::Config;

/// A configuration and the settings derived from it for the loop.
#[derive(Debug, Clone)]
pub struct Forced {
    /// The configuration.
    pub config: Config,
    /// The settings passed to the cycle.
    pub settings: Settings,
    /// The pseudonym of the similar subject whose parameters are in `settings`, if any.
    pub similar: Option<String>,
}

/// [`Forced`], shared by all threads except the loop.
#[derive(Debug)]
pub struct InForce {
    forced: Mutex<Forced>,
    changing: Mutex<()>,
}

impl InForce {
    /// Begins with the configuration of the start.
    pub fn new(forced: Forced) -> InForce {
        InForce { forced: Mutex::new(forced), changing: Mutex::new(()) }
    }

    /// A copy of the active configuration.
    pub fn now(&self) -> Forced {
        self.look(Forced::clone)
    }

    /// Accesses the active configuration without a copy.
    pub fn look<T>(&self, look: impl FnOnce(&Forced) -> T) -> T {
        look(&self.forced.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Serialises read-modify-replace operations for as long as the guard is held.
    pub fn alone(&self) -> MutexGuard<'_, ()> {
        self.changing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Replaces the active configuration.
    pub fn replace(&self, forced: Forced) {
        *self.forced.lock().unwrap_or_else(PoisonError::into_inner) = forced;
    }
}
