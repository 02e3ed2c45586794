//! The configuration in force: that of the start, with what was changed live since.

use std::sync::{Mutex, PoisonError};

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
pub struct InForce(Mutex<Forced>);

impl InForce {
    /// Begins with the start's.
    pub fn new(forced: Forced) -> InForce {
        InForce(Mutex::new(forced))
    }

    /// A copy of what holds now.
    pub fn now(&self) -> Forced {
        self.look(Forced::clone)
    }

    /// Looks at what holds now.
    pub fn look<T>(&self, look: impl FnOnce(&Forced) -> T) -> T {
        look(&self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Something else holds from now on.
    pub fn replace(&self, forced: Forced) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = forced;
    }
}
