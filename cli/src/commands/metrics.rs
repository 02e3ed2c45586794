//! `equipoise metrics`: the counts for Prometheus, in a process of its own, so that the daemon opens no network socket.

use std::cell::Cell;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::Context;
use crossbeam_channel::bounded;
use equipoise_config::Config;
use sd_notify::NotifyState;
use tracing::info;

use crate::metrics_feed;

use super::{ConfigArgument, Outcome, log_to_stderr};

/// How often the watchdog is fed.
const PING_EVERY: Duration = Duration::from_secs(1);

/// Serve the metrics of the configuration's [metrics], for a daemon that runs with --sensors-apart
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: equipoise metrics --config /etc/equipoise/equipoise.toml")]
pub(super) struct Arguments {
    #[command(flatten)]
    config: ConfigArgument,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    log_to_stderr("info");
    let path = &arguments.config.config;
    let config = Config::read_without_model(path)?;
    let metrics = config.metrics.as_ref().with_context(|| {
        format!("{} has no [metrics]: add it, with listen = \"127.0.0.1:9187\" for example", path.display())
    })?;
    let stop = super::stop_on_signals()?;
    let (ready, listens) = bounded(1);
    let pinged = Cell::new(None::<Instant>);
    // Evaluated after each read of the bus, so that watchdog pings depend on reads.
    let stopping = || {
        if let Ok(address) = listens.try_recv() {
            info!("station {}: metrics at http://{address}/metrics", config.station);
            let _ = sd_notify::notify(&[NotifyState::Ready]);
        }
        if pinged.get().is_none_or(|at| at.elapsed() >= PING_EVERY) {
            pinged.set(Some(Instant::now()));
            let _ = sd_notify::notify(&[NotifyState::Watchdog]);
        }
        stop.load(Ordering::Relaxed)
    };
    metrics_feed::run(&config.station, metrics.listen, &ready, &stopping)?;
    let _ = sd_notify::notify(&[NotifyState::Stopping]);
    Ok(Outcome::Done)
}
