//! `equipoise run`: the service.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::bail;
use tracing::info;

use super::{ConfigArgument, Outcome, log_to_stderr};
use crate::config::Config;
use crate::model::LoadedModel;
use crate::pipeline::Pipeline;

/// Run the pipeline as a service
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: equipoise run --config /etc/equipoise/equipoise.toml")]
pub(super) struct Arguments {
    #[command(flatten)]
    config: ConfigArgument,
    /// Model file to run, in place of the configuration's own
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    log_to_stderr("info");
    let mut config = Config::read(&arguments.config.config)?;
    if let Some(path) = &arguments.model {
        config.loaded_model = Some(LoadedModel::read(path)?);
    }
    if let Some(model) = &config.loaded_model {
        info!("{}", model.tell());
    }
    let stop = stop_on_signals()?;
    let pipeline = Pipeline::start(&config)?;
    // Ready means that cycles run, not that threads exist.
    while pipeline.last_cycle() == 0 && pipeline.is_whole() && !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(5));
    }
    if pipeline.last_cycle() > 0 {
        let _ = sd_notify::notify(&[sd_notify::NotifyState::Ready]);
        info!("station {}: {} cycles a second", config.station, config.tick.rate_hz);
    }
    while !stop.load(Ordering::Relaxed) {
        if !pipeline.is_whole() {
            let fault = pipeline.stop().err();
            bail!(
                "a part of the pipeline ended by itself: {}",
                fault.map_or_else(String::new, |f| format!("{f:#}"))
            );
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    let _ = sd_notify::notify(&[sd_notify::NotifyState::Stopping]);
    let summary = pipeline.stop()?;
    info!(
        cycles = summary.cycles.cycles,
        slots_skipped = summary.cycles.slots_skipped,
        deadlines_missed = summary.cycles.deadlines_missed,
        schedule_adds_up = summary.cycles.adds_up,
        "ended"
    );
    Ok(Outcome::Done)
}

/// A flag that SIGTERM and SIGINT set.
pub(super) fn stop_on_signals() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}
