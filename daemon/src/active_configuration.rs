//! The active configuration: that of the start, with live changes since.

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use anyhow::{Context, bail};
use equipoise_config::method::Build;
use equipoise_config::{Config, similar};
use equipoise_core::cycle::Settings;
use equipoise_station::ANONYMOUS;
use equipoise_station::status::Status;

use crate::realtime::now_ns;
use crate::rings::SettingsSender;
use crate::similar::Chosen;
use crate::status_file::StatusFile;

/// A configuration and the subject to which it applies.
#[derive(Debug, Clone)]
pub struct ActiveConfiguration {
    /// The configuration, with the configured subject.
    pub config: Config,
    /// The subject in use, unless it is the configured one.
    pub loaded: Option<LoadedSubject>,
    /// The similar subject whose parameters are in the configured subject's prior, if any.
    pub similar: Option<Chosen>,
}

/// A subject that is in use in place of the configured one.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedSubject {
    /// Pseudonym.
    pub id: String,
    /// Stature and sex; `None` if unknown: those of the configured subject are assumed.
    pub build: Option<Build>,
}

impl ActiveConfiguration {
    /// The configuration with the subject in use, as recordings contain it.
    pub fn with_subject_in_use(&self) -> Config {
        match &self.loaded {
            Some(LoadedSubject { id, build }) => self.config.with_subject(id, *build),
            None => self.config.clone(),
        }
    }

    /// Pseudonym of the subject in use; empty if it is unnamed.
    fn subject_in_use(&self) -> &str {
        match &self.loaded {
            Some(loaded) if loaded.id == ANONYMOUS => "",
            Some(loaded) => &loaded.id,
            None => &self.config.subject.id,
        }
    }

    /// The settings of the cycle: stature, sex and limits are those of the subject in use.
    pub fn settings(&self) -> Settings {
        let mut settings = self.with_subject_in_use().settings();
        // Similar to the configured subject, not to another.
        settings.similar =
            self.similar.as_ref().filter(|_| self.loaded.is_none()).map(|chosen| chosen.similar);
        settings
    }
}

/// [`ActiveConfiguration`], shared by all threads except the loop.
#[derive(Debug)]
pub struct SharedConfiguration {
    /// With the settings derived from it.
    active: Mutex<(ActiveConfiguration, Settings)>,
    /// Held during a change, which may send settings to the loop.
    change_lock: Mutex<SettingsSender>,
    /// Publishes the configuration; set once the daemon's threads have started.
    status: OnceLock<StatusFile>,
}

impl SharedConfiguration {
    /// Begins with the configuration of the start.
    pub fn new(active: ActiveConfiguration, settings: SettingsSender) -> SharedConfiguration {
        let derived = active.settings();
        SharedConfiguration {
            active: Mutex::new((active, derived)),
            change_lock: Mutex::new(settings),
            status: OnceLock::new(),
        }
    }

    /// Sets the status in which the active configuration is published.
    pub fn publish_in(&self, status: StatusFile) {
        // Called once, by the thread that starts the others.
        let _ = self.status.set(status);
    }

    /// A copy of the active configuration.
    pub fn get(&self) -> ActiveConfiguration {
        self.with(ActiveConfiguration::clone)
    }

    /// Accesses the active configuration without a copy.
    pub fn with<T>(&self, access: impl FnOnce(&ActiveConfiguration) -> T) -> T {
        access(&self.active.lock().unwrap_or_else(PoisonError::into_inner).0)
    }

    /// The settings of the cycle.
    pub fn settings(&self) -> Settings {
        self.active.lock().unwrap_or_else(PoisonError::into_inner).1
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

    /// Replaces the active configuration and passes its settings to the loop. `before_settings` is called once nothing but
    /// its own failure can prevent that.
    ///
    /// # Errors
    /// The status cannot be written, the loop has not applied the settings before, or `before_settings` fails: nothing has
    /// changed.
    pub fn apply(
        &self,
        changes: &mut SettingsSender,
        active: ActiveConfiguration,
        before_settings: impl FnOnce() -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        if !changes.wait_for_slot() {
            bail!("the loop has not applied the settings before; see `equipoise status`");
        }
        let settings = active.settings();
        // Publish the configuration before the loop applies it, so that a recorder that receives the cycle finds the
        // matching configuration.
        let published = Published {
            subject: active.subject_in_use().to_owned(),
            config_toml: active.with_subject_in_use().to_toml(),
            model_toml: active.config.model_toml(),
            similar_toml: similar::to_toml(settings.similar.as_ref()),
            reload: now_ns() / 1000,
        };
        let number = published.reload;
        let before = self.publish(published)?;
        if let Err(error) = before_settings() {
            if let Some(before) = before {
                // The next write of the status corrects it if this one fails.
                let _ = self.publish(before);
            }
            return Err(error);
        }
        changes.send(number, Box::new(settings));
        *self.active.lock().unwrap_or_else(PoisonError::into_inner) = (active, settings);
        Ok(())
    }

    /// Publishes a configuration in the status; returns the previous one, which remains if writing fails.
    fn publish(&self, new: Published) -> anyhow::Result<Option<Published>> {
        let Some(file) = self.status.get() else { return Ok(None) };
        let mut published = new;
        file.change(|status| published.swap(status));
        let Err(error) = file.write() else { return Ok(Some(published)) };
        file.change(|status| published.swap(status));
        Err(error).with_context(|| format!("cannot write {}", file.path.display()))
    }
}

/// The part of the status that a change of the configuration replaces.
struct Published {
    subject: String,
    config_toml: String,
    model_toml: String,
    similar_toml: String,
    reload: u64,
}

impl Published {
    fn swap(&mut self, status: &mut Status) {
        std::mem::swap(&mut self.subject, &mut status.subject);
        std::mem::swap(&mut self.config_toml, &mut status.config_toml);
        std::mem::swap(&mut self.model_toml, &mut status.model_toml);
        std::mem::swap(&mut self.similar_toml, &mut status.similar_toml);
        std::mem::swap(&mut self.reload, &mut status.reload);
    }
}

#[cfg(test)]
mod tests {
    use equipoise_core::cycle::Similar;
    use equipoise_core::sesc::PARAMETERS;
    use serde_json::json;

    use super::*;
    use crate::example_config;
    use crate::rings::Rings;

    /// The configuration of the start, and its status in a file.
    fn shared(directory: &std::path::Path, settings: SettingsSender) -> (SharedConfiguration, StatusFile) {
        let text = example_config::text("alice", "");
        let config = Config::parse(&text, "the test's").unwrap();
        let status = json!({
            "version": "", "process_id": 1, "station": "s", "config_toml": text, "memory_lock": "", "threads": [],
            "subject": "alice",
        });
        let mut file = StatusFile::new(serde_json::from_value(status).unwrap());
        file.path = directory.join("status.json");
        let (deviation_m, variance_m2) = ([0.002; PARAMETERS], [1e-6; PARAMETERS]);
        let similar = Similar { deviation_m, variance_m2, likeness: 0.7 };
        let similar = Some(Chosen { subject: "zoe".to_owned(), similar });
        let shared =
            SharedConfiguration::new(ActiveConfiguration { config, loaded: None, similar }, settings);
        shared.publish_in(file.clone());
        (shared, file)
    }

    #[test]
    fn a_change_publishes_the_subject_together_with_its_configuration() {
        let directory = tempfile::tempdir().unwrap();
        let Rings { mut loop_ends, settings, .. } = Rings::new().unwrap();
        let (shared, file) = shared(directory.path(), settings);
        let published = || -> (String, String, bool) {
            let text = std::fs::read_to_string(&file.path).unwrap();
            assert!(!text.contains("zoe"), "the name of the similar subject");
            let status: Status = serde_json::from_str(&text).unwrap();
            let config = Config::parse(&status.config_toml, "the status").unwrap();
            let similar = similar::parse(&status.similar_toml, "the status").unwrap();
            (status.subject, config.subject.id, similar == shared.settings().similar && similar.is_some())
        };
        let mut load = |id: Option<&str>, outcome: anyhow::Result<()>| {
            let loaded = id.map(|id| LoadedSubject { id: id.to_owned(), build: None });
            let active = ActiveConfiguration { loaded, ..shared.get() };
            let _ = shared.apply(&mut shared.lock_changes(), active, || outcome);
            // As the loop, which applies the settings.
            let _ = loop_ends.settings.pop();
        };
        load(Some("bob"), Ok(()));
        assert_eq!(published(), ("bob".to_owned(), "bob".to_owned(), false));
        load(Some(ANONYMOUS), Ok(()));
        assert_eq!(published(), (String::new(), ANONYMOUS.to_owned(), false));
        load(Some("carol"), Err(anyhow::anyhow!("the loop has no slot")));
        assert_eq!(published(), (String::new(), ANONYMOUS.to_owned(), false));
        load(None, Ok(()));
        assert_eq!(published(), ("alice".to_owned(), "alice".to_owned(), true));
    }
}
