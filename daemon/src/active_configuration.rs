//! The active configuration: that of the start, with live changes since.

use std::sync::{Mutex, MutexGuard, PoisonError};

use equipoise_core::cycle::Settings;

use equipoise_config::Config;

use crate::rings::SettingsSender;

/// A configuration and the settings derived from it for the loop.
#[derive(Debug, Clone)]
pub struct ActiveConfiguration {
    /// The configuration.
    pub config: Config,
    /// The settings passed to the cycle.
    pub settings: Settings,
    /// The pseudonym of the similar subject whose parameters are in `settings`, if any.
    pub similar: Option<String>,
}

/// [`ActiveConfiguration`], shared by all threads except the loop.
#[derive(Debug)]
pub struct SharedConfiguration {
    active: Mutex<ActiveConfiguration>,
    /// Held during a change, which may send settings to the loop.
    change_lock: Mutex<SettingsSender>,
}

impl SharedConfiguration {
    /// Begins with the configuration of the start.
    pub fn new(active: ActiveConfiguration, settings: SettingsSender) -> SharedConfiguration {
        SharedConfiguration { active: Mutex::new(active), change_lock: Mutex::new(settings) }
    }

    /// A copy of the active configuration.
    pub fn get(&self) -> ActiveConfiguration {
        self.with(ActiveConfiguration::clone)
    }

    /// Accesses the active configuration without a copy.
    pub fn with<T>(&self, access: impl FnOnce(&ActiveConfiguration) -> T) -> T {
        access(&self.active.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Serialises read-modify-replace operations for as long as the guard is held; the guard sends settings to the loop.
    pub fn lock_changes(&self) -> MutexGuard<'_, SettingsSender> {
        self.change_lock.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Frees the settings that the loop has replaced, unless a change is in progress, which frees them itself.
    pub fn free_returned_settings(&self) {
        if let Ok(mut sender) = self.change_lock.try_lock() {
            sender.free_returned();
        }
    }

    /// Replaces the active configuration.
    pub fn replace(&self, active: ActiveConfiguration) {
        *self.active.lock().unwrap_or_else(PoisonError::into_inner) = active;
    }
}
