//! The service as a program: `equipoise-daemon`, and `equipoise run`.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::bail;
use equipoise_config::model::LoadedModel;
use equipoise_config::{Config, ConfigError};
use equipoise_station::process::{log_to_stderr, stop_on_signals};
use tracing::{info, warn};

use crate::pipeline::{Pipeline, ServeMetrics};
use crate::realtime::now_ns;

/// Which configuration to use.
#[derive(Debug, clap::Args)]
pub struct ConfigArgument {
    /// Configuration file
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
}

/// Run the pipeline as a service
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: equipoise run --config /etc/equipoise/equipoise.toml")]
pub struct Arguments {
    #[command(flatten)]
    config: ConfigArgument,
    /// Model file to run, in place of the configuration's own
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Open no sensor and no network socket: `equipoise adapter suit`, `equipoise adapter ground` and `equipoise metrics`
    /// do that in processes of their own, with the same configuration file
    #[arg(long)]
    sensors_apart: bool,
}

/// Runs the service until SIGTERM or SIGINT; SIGHUP reads the configuration again.
///
/// # Errors
/// The configuration is refused, the pipeline cannot start, or a part of it ended by itself.
pub fn run(arguments: &Arguments, serve_metrics: Option<ServeMetrics>) -> anyhow::Result<()> {
    log_to_stderr("info");
    let config = arguments.read()?;
    if let Some(model) = &config.loaded_model {
        info!("{}", model.describe());
    }
    if config.metrics.is_some() && !config.sensors_apart && serve_metrics.is_none() {
        warn!(
            "[metrics]: this program does not serve them; start `equipoise metrics --config {}`",
            arguments.config.config.display()
        );
    }
    let stop = stop_on_signals()?;
    let reload = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGHUP, Arc::clone(&reload))?;
    let pipeline = Pipeline::start_serving(&config, serve_metrics)?;
    // Report readiness once cycles run, not once the threads exist.
    while pipeline.last_cycle() == 0 && pipeline.is_running() && !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(5));
    }
    if pipeline.last_cycle() > 0 {
        let _ = sd_notify::notify(&[sd_notify::NotifyState::Ready]);
        info!("station {}: {} cycles a second", config.station, config.tick.rate_hz);
    }
    while !stop.load(Ordering::Relaxed) {
        if !pipeline.is_running() {
            let fault = pipeline.stop().err();
            bail!(
                "a part of the pipeline ended by itself: {}",
                fault.map_or_else(String::new, |f| format!("{f:#}"))
            );
        }
        if reload.swap(false, Ordering::Relaxed) {
            reread(arguments, &pipeline);
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    let _ = sd_notify::notify(&[sd_notify::NotifyState::Stopping]);
    let summary = pipeline.stop()?;
    let cycles = summary.cycles;
    info!(
        cycles = cycles.cycles,
        slots_skipped = cycles.slots_skipped,
        deadlines_missed = cycles.deadlines_missed,
        last_miss = cycles.misses.last.map(tracing::field::display),
        worst_miss = cycles.misses.worst.map(tracing::field::display),
        schedule_adds_up = cycles.adds_up,
        "ended"
    );
    if !cycles.adds_up {
        bail!(
            "the schedule does not add up: {} ns at {} ns a slot are not the {} cycles and {} skipped slots that were \
             counted; this is a fault of the program, please report it",
            cycles.elapsed_ns,
            cycles.period_ns,
            cycles.cycles,
            cycles.slots_skipped
        );
    }
    Ok(())
}

impl Arguments {
    fn read(&self) -> Result<Config, ConfigError> {
        let mut config = Config::read(&self.config.config)?;
        config.sensors_apart = self.sensors_apart;
        if let Some(path) = &self.model {
            config.loaded_model = Some(LoadedModel::read(path)?);
        }
        Ok(config)
    }
}

/// Applies live settings; settings that require a restart and errors are logged.
fn reread(arguments: &Arguments, pipeline: &Pipeline) {
    info!("the configuration is read again");
    let began = [sd_notify::NotifyState::Reloading, monotonic_now()];
    let _ = sd_notify::notify(&began);
    // The incident contains the reason of a refusal.
    for message in pipeline.reload(arguments.read()).unwrap_or_default() {
        warn!("{message}");
    }
    let _ = sd_notify::notify(&[sd_notify::NotifyState::Ready]);
}

/// When, as systemd wants it with every reload.
fn monotonic_now() -> sd_notify::NotifyState<'static> {
    sd_notify::NotifyState::MonotonicUsec(i128::from(now_ns() / 1000))
}
