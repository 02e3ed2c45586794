//! `equipoise view`: the worker's page, in a process of its own, so that nothing a browser does reaches the loop.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use equipoise_config::Config;
use tracing::info;

use super::{ConfigArgument, Outcome, log_to_stderr};
use crate::page_feed::ServedPage;

/// How often the watchdog is fed.
const PING_EVERY: Duration = Duration::from_secs(1);

/// Serve the worker's page of the configuration's [page]; it waits while no daemon runs
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: equipoise view --config /etc/equipoise/equipoise.toml")]
pub(super) struct Arguments {
    #[command(flatten)]
    config: ConfigArgument,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    log_to_stderr("info");
    let path = &arguments.config.config;
    let config = Config::read(path)?;
    let listen = config.page.as_ref().with_context(|| {
        format!("{} has no [page]: add it, with listen = \"127.0.0.1:8080\" for example", path.display())
    })?;
    let stop = super::stop_on_signals()?;
    let page = ServedPage::start(&config, listen, path.parent().unwrap_or(Path::new("")))?;
    info!("station {}: page at {}", config.station, page.url());
    match (&listen.token_file, listen.listen.ip().is_loopback()) {
        (Some(_), false) => info!("reachable from other machines; every request needs the token"),
        (Some(_), true) => info!("every request needs the token"),
        (None, _) => {}
    }
    let _ = sd_notify::notify(&[sd_notify::NotifyState::Ready]);
    let (mut pinged, mut requests) = (Instant::now(), 0);
    while !stop.load(Ordering::Relaxed) {
        if !page.is_running() {
            bail!("a part of the page ended by itself; what it said stands above");
        }
        // Feed the watchdog with requested frames, not merely while this thread runs.
        if pinged.elapsed() >= PING_EVERY && page.requests() != requests {
            (pinged, requests) = (Instant::now(), page.requests());
            let _ = sd_notify::notify(&[sd_notify::NotifyState::Watchdog]);
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    let _ = sd_notify::notify(&[sd_notify::NotifyState::Stopping]);
    drop(page);
    info!("ended");
    Ok(Outcome::Done)
}
