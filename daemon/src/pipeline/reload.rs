//! Reloads the configuration of a running daemon.

use equipoise_config::{Config, ConfigError};
use equipoise_core::message::Incident;
use tracing::info;

use super::Pipeline;
use crate::active_configuration::ActiveConfiguration;

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
        let before = self.active_configuration.get();
        let config = before.config.with_live_settings_of(&new);
        let not_live = config.keys_that_differ(&new);
        let changed = before.config.keys_that_differ(&config);
        if changed.is_empty() && before.config.model_toml() == config.model_toml() {
            info!("the configuration is unchanged");
            return Ok(restart_notes(&config, &not_live));
        }
        let active = ActiveConfiguration { config: config.clone(), ..before.clone() };
        self.active_configuration.apply(&mut changes, active, || Ok(()))?;
        if let Some(model) =
            config.loaded_model.as_ref().filter(|_| before.config.loaded_model != config.loaded_model)
        {
            info!("{}", model.describe());
        }
        let not_live = restart_notes(&config, &not_live);
        for key in &changed {
            match Config::reader_of(key) {
                Some(reader) => info!("{key} changed: in force once {reader} is restarted"),
                None => info!("{key} changed: in force now"),
            }
        }
        Ok(not_live)
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
