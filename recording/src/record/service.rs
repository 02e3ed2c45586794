//! Records for as long as the station runs: one file after another, within the limits of the disk space.

use std::cell::{Cell, RefCell};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context, bail};
use equipoise_adapters::recording::Predecessor;
use equipoise_config::RecordingConfig;
use equipoise_files::sha256_with;
use equipoise_station::status;
use tracing::{info, warn};

use super::finished_files::FinishedFiles;
use super::ports::Daemons;
use super::signature::{Finisher, SigningKey};
use super::storage::{Limits, RecordingStore, has_jumped};
use super::summary::RecordSummary;
use super::{Progress, Tap};

/// Polling interval for a daemon.
const POLL_INTERVAL: Duration = Duration::from_millis(500);
/// Interval for checking file and daemon, and for notifying the service manager that messages are written.
const FILE_CHECK_INTERVAL: Duration = Duration::from_millis(500);
/// Maximum wait for the status of a daemon whose first cycles were received: it is published after them.
const STATUS_TIMEOUT: Duration = Duration::from_secs(2);
/// Interval at which that status is read.
const STATUS_POLL_INTERVAL: Duration = Duration::from_millis(5);
/// Interval for removing old files.
const CLEAR_INTERVAL: Duration = Duration::from_secs(10);
/// Reason for the end of a file.
const NEXT_DAEMON: &str = "is complete: another daemon runs, whose configuration is in the next file";
const MIB: u64 = 1 << 20;

fn limits_of(config: &RecordingConfig) -> Limits {
    Limits {
        total_bytes: config.total_max_mib * MIB,
        age: Some(Duration::from_secs_f64(config.age_max_days * 86_400.0)),
        free_bytes: config.free_min_mib * MIB,
    }
}

/// Records a station until `stopping`; waits while no daemon runs. `base` is the folder to which a relative directory
/// refers; `heartbeat` is called at least every second.
///
/// # Errors
/// The disk is full and no old recording can be removed, or the folder or a file cannot be written.
pub fn serve(
    station: &str,
    config: &RecordingConfig,
    base: &Path,
    stopping: &dyn Fn() -> bool,
    heartbeat: &dyn Fn(),
) -> anyhow::Result<RecordSummary> {
    let directory = base.join(&config.directory);
    let store = RecordingStore::open(&directory, station)
        .with_context(|| format!("recording.directory: cannot make {}", directory.display()))?;
    let mut finisher = Finisher::new(signing_key(config, base)?);
    store.remove_unfinished_signatures();
    let retention = Retention::new(&store, config)?;
    retention.clear_if_due()?;
    heartbeat();
    let mut previous = store.newest_finished()?.and_then(|path| link_to(&path, heartbeat));
    let Some(mut tap) = wait_for_daemon(station, stopping, heartbeat)? else {
        return Ok(RecordSummary::default());
    };
    while !stopping() {
        retention.clear_if_due()?;
        let unix_s = super::unix_ns() / 1_000_000_000;
        let out = store.next(unix_s);
        let until = Until::new(station, &retention, stopping, heartbeat);
        let announce = || info!("recording station {station} to {}", out.display());
        let contents = (config.pictures_hz, Daemons::One);
        match tap.record(&out, previous, contents, &|progress| until.is_over(progress), announce) {
            Ok((sha256, syncer)) => {
                if tap.ports.is_next_daemon() {
                    until.reason.set(NEXT_DAEMON);
                }
                info!("{} {}; {}", out.display(), until.reason.get(), tap.summary);
                retention.finished.borrow_mut().push(&out);
                finisher.start(&out, &sha256, || syncer.finish())?;
                previous = Some(Predecessor { file: file_name(&out), sha256 });
            }
            // Errors are expected after the bus was replaced.
            Err(error) if tap.is_replaced() => {
                warn!("{} has ended: {error:#}", out.display());
                previous = link_to(&out, heartbeat);
            }
            Err(error) => return Err(error),
        }
        if let Some(error) = until.error.take() {
            return Err(error);
        }
        tap = match next_tap(tap, station, stopping, heartbeat)? {
            ControlFlow::Continue(next) => next,
            ControlFlow::Break(summary) => return finisher.finish().map(|()| summary),
        };
    }
    let summary = tap.summary;
    drop(tap);
    finisher.finish().map(|()| summary)
}

/// The subscriptions for the next file, after a wait for a daemon if none runs; the summary once `stopping`.
fn next_tap(
    tap: Tap,
    station: &str,
    stopping: &dyn Fn() -> bool,
    heartbeat: &dyn Fn(),
) -> anyhow::Result<ControlFlow<RecordSummary, Tap>> {
    if tap.ports.is_next_daemon() {
        wait_for_next_status(station, tap.instance, stopping, heartbeat);
    }
    let (summary, is_replaced) = (tap.summary, tap.is_replaced());
    if stopping() || !is_replaced && status::read(station).is_some() {
        return Ok(ControlFlow::Continue(tap));
    }
    info!("the daemon of station {station} has ended; waiting for the next one");
    if is_replaced {
        tap.leak();
    } else {
        drop(tap);
    }
    let next = wait_for_daemon(station, stopping, heartbeat)?;
    Ok(next.map_or(ControlFlow::Break(summary), |next| ControlFlow::Continue(Tap { summary, ..next })))
}

/// The configured signing key; `base` is the folder to which a relative path refers.
///
/// # Errors
/// A sentence that begins with the key's name: the file is missing, is accessible to other users, or holds no secret
/// key.
pub fn signing_key(config: &RecordingConfig, base: &Path) -> anyhow::Result<Option<SigningKey>> {
    let key = config.sign_key.as_ref().map(|file| SigningKey::read(&base.join(file)));
    key.transpose().context("recording.sign_key")
}

/// The link to a file whose hash is not available yet, such as that of a recorder that was killed. Reads the whole
/// file, so call it only while no messages are pending.
fn link_to(path: &Path, heartbeat: &dyn Fn()) -> Option<Predecessor> {
    match sha256_with(path, heartbeat) {
        Ok(sha256) => Some(Predecessor { file: file_name(path), sha256 }),
        Err(error) => {
            warn!("a new hash chain begins: {error:#}");
            None
        }
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Returns `None` once `stopping`.
fn wait_for_daemon(
    station: &str,
    stopping: &dyn Fn() -> bool,
    heartbeat: &dyn Fn(),
) -> anyhow::Result<Option<Tap>> {
    let mut logged = false;
    while !stopping() {
        if status::read(station).is_some() {
            match Tap::open(station) {
                Ok(tap) => return Ok(Some(tap)),
                Err(error) if !logged => warn!("not yet: {error:#}"),
                Err(_) => {}
            }
        } else if !logged {
            info!("no daemon runs on station {station}; waiting for one");
        }
        logged = true;
        heartbeat();
        std::thread::sleep(POLL_INTERVAL);
    }
    Ok(None)
}

/// Waits until the status is that of another daemon: the next file has its configuration in the header.
fn wait_for_next_status(
    station: &str,
    instance: (u32, u64),
    stopping: &dyn Fn() -> bool,
    heartbeat: &dyn Fn(),
) {
    let started = Instant::now();
    let is_next = || status::read(station).is_some_and(|facts| facts.instance() != instance);
    while !stopping() && started.elapsed() < STATUS_TIMEOUT && !is_next() {
        heartbeat();
        std::thread::sleep(STATUS_POLL_INTERVAL);
    }
}

/// Removes old recordings and logs it.
struct Retention<'a> {
    store: &'a RecordingStore,
    config: &'a RecordingConfig,
    cleared: Cell<Option<Instant>>,
    /// Last change of the newest file that existed when this process started.
    newest: Option<SystemTime>,
    started: Instant,
    clock_suspect: Cell<bool>,
    finished: RefCell<FinishedFiles>,
}

impl<'a> Retention<'a> {
    fn new(store: &'a RecordingStore, config: &'a RecordingConfig) -> anyhow::Result<Retention<'a>> {
        let newest = store.newest().context("looking at old recordings")?;
        let (cleared, clock_suspect) = (Cell::new(None), Cell::new(false));
        let finished = RefCell::new(FinishedFiles::new(SystemTime::now()));
        Ok(Retention { store, config, cleared, newest, started: Instant::now(), clock_suspect, finished })
    }

    /// Limits the rate of removals: space of removed files may not be released yet.
    fn clear_if_due(&self) -> anyhow::Result<()> {
        if self.cleared.get().is_some_and(|cleared| cleared.elapsed() < CLEAR_INTERVAL) {
            return Ok(());
        }
        self.cleared.set(Some(Instant::now()));
        self.clear()
    }

    fn clear(&self) -> anyhow::Result<()> {
        let (mut limits, now) = (limits_of(self.config), SystemTime::now());
        self.finished.borrow_mut().correct_dates_after_clock_step(now);
        limits.age = limits.age.filter(|age| !self.is_clock_suspect(now, *age));
        let cleared = self.store.clear(&limits, now).context("clearing old recordings away")?;
        for (path, reason) in &cleared.removed {
            info!("removed {}: {reason}", path.display());
        }
        if cleared.free_bytes < limits.free_bytes {
            bail!(
                "the disk has {} MiB free, less than recording.free_min_mib ({}), and no old recording is left to \
                 remove: recording ends, the station goes on; make room, or lower the limit",
                cleared.free_bytes / MIB,
                self.config.free_min_mib
            );
        }
        Ok(())
    }

    /// Whether the clock is unreliable for ages; warns once.
    fn is_clock_suspect(&self, now: SystemTime, age: Duration) -> bool {
        let jumped = has_jumped(self.newest, now, age, self.started.elapsed());
        if jumped && !self.clock_suspect.replace(jumped) {
            warn!(
                "by this computer's clock nothing was recorded here for longer than recording.age_max_days: it may be \
                 wrong, so no recording is removed for its age. If it is right, restart this service; if not, set it first"
            );
        }
        self.clock_suspect.set(jumped);
        jumped
    }
}

/// Decides when a file ends: called every few milliseconds, it checks file, daemon and disk at longer intervals.
struct Until<'a> {
    station: &'a str,
    retention: &'a Retention<'a>,
    stopping: &'a dyn Fn() -> bool,
    heartbeat: &'a dyn Fn(),
    checked: Cell<Instant>,
    /// Messages written at the last check.
    written: Cell<u64>,
    /// Reason for the end of the file, in words.
    reason: Cell<&'static str>,
    error: Cell<Option<anyhow::Error>>,
}

impl<'a> Until<'a> {
    fn new(
        station: &'a str,
        retention: &'a Retention<'a>,
        stopping: &'a dyn Fn() -> bool,
        heartbeat: &'a dyn Fn(),
    ) -> Until<'a> {
        Until {
            station,
            retention,
            stopping,
            heartbeat,
            checked: Cell::new(Instant::now()),
            written: Cell::new(0),
            reason: Cell::new("is complete"),
            error: Cell::new(None),
        }
    }

    fn is_over(&self, progress: &Progress<'_>) -> bool {
        if (self.stopping)() {
            return true;
        }
        if let Err(error) = self.retention.clear_if_due() {
            self.error.set(Some(error));
            return true;
        }
        if self.checked.get().elapsed() < FILE_CHECK_INTERVAL {
            return false;
        }
        self.checked.set(Instant::now());
        self.check_file(progress)
    }

    /// Checks that the file is still at its path, its size, and which daemon runs.
    fn check_file(&self, progress: &Progress<'_>) -> bool {
        let facts = status::read(self.station);
        let written = progress.summary.written();
        // A running daemon publishes in every cycle, so a recorder that receives nothing must not feed the watchdog.
        if written > self.written.replace(written) || !progress.has_daemon() {
            (self.heartbeat)();
        }
        let Some(bytes) = progress.recorder.bytes_in_place() else {
            self.reason.set("was removed or replaced while it was written: the next file begins");
            return true;
        };
        if facts.is_some_and(|facts| facts.instance() != progress.instance) {
            self.reason.set(NEXT_DAEMON);
            return true;
        }
        bytes >= self.retention.config.file_max_mib * MIB || progress.bus_directory.is_replaced()
    }
}
