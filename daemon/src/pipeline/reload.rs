//! Reloads the configuration of a running daemon.

use anyhow::{Context, bail};
use equipoise_config::{Config, ConfigError};
use equipoise_core::message::Incident;
use equipoise_station::status::Status;
use tracing::info;

use super::Pipeline;
use crate::active_configuration::ActiveConfiguration;
use crate::realtime::now_ns;

impl Pipeline {
    /// Applies the settings of another configuration that can change live; returns one sentence for each key that
    /// cannot.
    ///
    /// An unreadable or invalid configuration changes nothing and begins an incident.
    ///
    /// # Errors
    /// The reason of a refusal.
    pub fn reload(&self, read: Result<Config, ConfigError>) -> anyhow::Result<Vec<String>> {
        let outcome = read.map_err(anyhow::Error::from).and_then(|new| self.apply(new));
        match &outcome {
            Ok(_) => self.board.end(Incident::ReloadRefused),
            Err(reason) => self.board.begin(
                Incident::ReloadRefused,
                &format!("{reason:#}; the configuration before stays in force"),
            ),
        }
        outcome
    }

    fn apply(&self, new: Config) -> anyhow::Result<Vec<String>> {
        let mut changes = self.active_configuration.lock_changes();
        if changes.settings.is_full() {
            bail!("the reload before is not taken up yet; ask again");
        }
        let before = self.active_configuration.get();
        let config = before.config.with_live_settings_of(&new);
        let not_live = config.keys_that_differ(&new);
        let changed = before.config.keys_that_differ(&config);
        if changed.is_empty() && before.config.model_toml() == config.model_toml() {
            info!("the configuration is the one in force");
            return Ok(restart_notes(&config, &not_live));
        }
        let mut settings = config.settings();
        settings.similar = before.settings.similar;
        // Publish the configuration before the loop applies it, so that a recorder that receives the cycle finds the
        // matching configuration. Restore the previous status if the loop does not apply it.
        let reload = now_ns() / 1000;
        let status_before = self.publish_status(&config, reload)?;
        if !changes.send(reload, Box::new(settings)) {
            self.status.change(|status| *status = status_before);
            let _ = self.status.write();
            bail!("the loop takes nothing up; see `equipoise status`");
        }
        if let Some(model) =
            config.loaded_model.as_ref().filter(|_| before.config.loaded_model != config.loaded_model)
        {
            info!("{}", model.describe());
        }
        let not_live = restart_notes(&config, &not_live);
        self.active_configuration.replace(ActiveConfiguration { config, settings, similar: before.similar });
        for key in &changed {
            match Config::reader_of(key) {
                Some(reader) => info!("{key} changed: in force once {reader} is restarted"),
                None => info!("{key} changed: in force now"),
            }
        }
        Ok(not_live)
    }

    /// Publishes the new configuration in the status; returns the previous status, which remains if writing fails.
    fn publish_status(&self, config: &Config, reload: u64) -> anyhow::Result<Status> {
        let mut before = None;
        self.status.change(|status| {
            before = Some(status.clone());
            status.config_toml = config.to_toml();
            status.model_toml = config.model_toml();
            status.reload = reload;
        });
        let before = before.context("no status was published yet")?;
        if let Err(error) = self.status.write() {
            self.status.change(|status| status.clone_from(&before));
            return Err(error).with_context(|| format!("cannot write {}", self.status.path.display()));
        }
        Ok(before)
    }
}

/// One sentence for each key that requires a restart; names the units if several processes read the file.
fn restart_notes(config: &Config, keys: &[String]) -> Vec<String> {
    let of = |key: &str| match key.split('.').next() {
        Some(stream @ ("suit" | "ground")) if config.sensors_apart => {
            format!(" of equipoise and equipoise-adapter@{stream}")
        }
        Some("metrics") if config.sensors_apart => " of equipoise-metrics".to_owned(),
        _ => String::new(),
    };
    keys.iter().map(|key| format!("{key} changed: takes effect at the next restart{}", of(key))).collect()
}
