//! `equipoise view`: the worker's page, in a process of its own, so that nothing a browser does reaches the loop.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use equipoise_config::Config;
use tracing::info;

use super::{Outcome, log_to_stderr};
use crate::page_feed::ServedPage;
use crate::stations::{ServedStations, StationsFile};

/// How often the watchdog is fed.
const PING_EVERY: Duration = Duration::from_secs(1);

/// Serve the worker's page of the configuration's [page]; it waits while no daemon runs
///
/// With --stations one page of several stations, on this and other machines: joint closest to its limit, load, incidents,
/// and a link to each station's page. The file has a [page] with `listen`, and for each station a [[station]] with the
/// `url` of its page; both may have a `token_file`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise view --config /etc/equipoise/equipoise.toml\n  equipoise view --stations \
                        stations.toml"
)]
pub(super) struct Arguments {
    /// Configuration file
    #[arg(long, value_name = "FILE", required_unless_present = "stations")]
    config: Option<PathBuf>,
    /// Serve one page of the stations listed in this file
    #[arg(long, value_name = "FILE", conflicts_with = "config")]
    stations: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    log_to_stderr("info");
    match (&arguments.stations, &arguments.config) {
        (Some(stations), _) => serve_stations(stations),
        (None, Some(config)) => serve_station(config),
        (None, None) => bail!("give --config FILE or --stations FILE"),
    }
}

fn serve_station(path: &Path) -> anyhow::Result<Outcome> {
    let config = Config::read_without_model(path)?;
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
    let mut requests = 0;
    // Feed the watchdog with requested frames, not merely while this thread runs.
    let progresses = || {
        let newest = page.requests();
        std::mem::replace(&mut requests, newest) != newest
    };
    serve(&stop, || page.is_running(), progresses)?;
    drop(page);
    info!("ended");
    Ok(Outcome::Done)
}

/// Serves until `stop`, as a service of systemd: pings its watchdog while the page `progresses`.
///
/// # Errors
/// A thread of the page ended.
fn serve(
    stop: &AtomicBool,
    is_running: impl Fn() -> bool,
    mut progresses: impl FnMut() -> bool,
) -> anyhow::Result<()> {
    let _ = sd_notify::notify(&[sd_notify::NotifyState::Ready]);
    let mut pinged = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        if !is_running() {
            bail!("a thread of the page ended unexpectedly; the log has its error");
        }
        if pinged.elapsed() >= PING_EVERY && progresses() {
            pinged = Instant::now();
            let _ = sd_notify::notify(&[sd_notify::NotifyState::Watchdog]);
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    let _ = sd_notify::notify(&[sd_notify::NotifyState::Stopping]);
    Ok(())
}

fn serve_stations(path: &Path) -> anyhow::Result<Outcome> {
    let file = StationsFile::read(path)?;
    let stop = super::stop_on_signals()?;
    let served = ServedStations::start(file, path.parent().unwrap_or(Path::new("")))?;
    info!("stations: page at {}", served.url());
    let mut snapshots = 0;
    let progresses = || {
        let newest = served.snapshots();
        std::mem::replace(&mut snapshots, newest) != newest
    };
    serve(&stop, || served.is_running(), progresses)?;
    info!("ended");
    Ok(Outcome::Done)
}
