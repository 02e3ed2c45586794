//! Records for as long as the station runs: one file after another, within the limits of the disk space.

use std::cell::Cell;
use std::path::Path;
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context, bail};
use equipoise_adapters::recording::Predecessor;
use tracing::{info, warn};

use super::keeping::{Limits, Shelf, has_jumped};
use super::signature::{Signer, SigningKey};
use super::summary::RecordSummary;
use super::{Progress, Tap};
use crate::config::RecordingConfig;
use crate::model::sha256_with;
use crate::status;
use crate::whole_file::runs;

/// Polling interval for a daemon.
const LOOK_EVERY: Duration = Duration::from_millis(500);
/// Interval for checking file and daemon, and for notifying the service manager that messages are written.
const LOOK_AT_FILE_EVERY: Duration = Duration::from_millis(500);
/// Shorter interval after the cycle number restarted: messages of another daemon belong in another file.
const LOOK_AFTER_RESTART: Duration = Duration::from_millis(50);
/// Interval for removing old files.
const CLEAR_EVERY: Duration = Duration::from_secs(10);
const MIB: u64 = 1 << 20;

impl RecordingConfig {
    fn limits(&self) -> Limits {
        Limits {
            total_bytes: self.total_max_mib * MIB,
            age: Some(Duration::from_secs_f64(self.age_max_days * 86_400.0)),
            free_bytes: self.free_min_mib * MIB,
        }
    }
}

/// Records a station until `stopping`; waits while no daemon runs. `base` is the folder to which a relative directory
/// refers; `alive` is called at least every second.
///
/// # Errors
/// The disk is full and no old recording can be removed, or the folder or a file cannot be written.
pub fn serve(
    station: &str,
    config: &RecordingConfig,
    base: &Path,
    stopping: &dyn Fn() -> bool,
    alive: &dyn Fn(),
) -> anyhow::Result<RecordSummary> {
    let directory = base.join(&config.directory);
    let shelf = Shelf::open(&directory, station)
        .with_context(|| format!("recording.directory: cannot make {}", directory.display()))?;
    let mut signer = Signer::new(signing_key(config, base)?);
    shelf.clear_leftovers();
    let keeper = Keeper::new(&shelf, config)?;
    keeper.clear_if_due()?;
    alive();
    let mut previous = shelf.newest_finished()?.and_then(|path| link_to(&path, alive));
    let Some(mut tap) = wait_for_a_daemon(station, stopping, alive)? else {
        return Ok(RecordSummary::default());
    };
    while !stopping() {
        keeper.clear_if_due()?;
        let unix_s = super::unix_ns() / 1_000_000_000;
        let out = shelf.next(unix_s);
        let until = Until::new(station, &keeper, stopping, alive);
        let said = || info!("recording station {station} to {}", out.display());
        match tap.record(&out, previous, config.pictures_hz, &|progress| until.is_over(progress), said) {
            Ok(sha256) => {
                info!("{} {}; {}", out.display(), until.why.get(), tap.summary);
                signer.start(&out, &sha256);
                previous = Some(Predecessor { file: name_of(&out), sha256 });
            }
            // Errors are expected after the bus was replaced.
            Err(error) if tap.is_cut_off() => {
                warn!("{} has ended: {error:#}", out.display());
                previous = link_to(&out, alive);
            }
            Err(error) => return Err(error),
        }
        if let Some(error) = until.trouble.take() {
            return Err(error);
        }
        let cut_off = tap.is_cut_off();
        if !stopping() && (cut_off || status::read(station).is_none()) {
            info!("the daemon of station {station} has ended; waiting for the next one");
            let summary = tap.summary;
            if cut_off {
                // Dropping the old ports would remove files of the new bus that have the same names, so leak them.
                std::mem::forget(tap);
            } else {
                drop(tap);
            }
            match wait_for_a_daemon(station, stopping, alive)? {
                Some(next) => tap = Tap { summary, ..next },
                None => return Ok(summary),
            }
        }
    }
    Ok(tap.summary)
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
fn link_to(path: &Path, alive: &dyn Fn()) -> Option<Predecessor> {
    match sha256_with(path, alive) {
        Ok(sha256) => Some(Predecessor { file: name_of(path), sha256 }),
        Err(error) => {
            warn!("a new hash chain begins: {error:#}");
            None
        }
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Returns `None` once `stopping`.
fn wait_for_a_daemon(
    station: &str,
    stopping: &dyn Fn() -> bool,
    alive: &dyn Fn(),
) -> anyhow::Result<Option<Tap>> {
    let mut said = false;
    while !stopping() {
        if status::read(station).is_some() {
            match Tap::open(station) {
                Ok(tap) => return Ok(Some(tap)),
                Err(error) if !said => warn!("not yet: {error:#}"),
                Err(_) => {}
            }
        } else if !said {
            info!("no daemon runs on station {station}; waiting for one");
        }
        said = true;
        alive();
        std::thread::sleep(LOOK_EVERY);
    }
    Ok(None)
}

/// Removes old recordings and logs it.
struct Keeper<'a> {
    shelf: &'a Shelf,
    config: &'a RecordingConfig,
    cleared: Cell<Option<Instant>>,
    /// Last change of the newest file that existed when this process started.
    newest: Option<SystemTime>,
    began: Instant,
    doubted: Cell<bool>,
}

impl<'a> Keeper<'a> {
    fn new(shelf: &'a Shelf, config: &'a RecordingConfig) -> anyhow::Result<Keeper<'a>> {
        let newest = shelf.newest().context("looking at old recordings")?;
        let (cleared, doubted) = (Cell::new(None), Cell::new(false));
        Ok(Keeper { shelf, config, cleared, newest, began: Instant::now(), doubted })
    }

    /// Limits the rate of removals: space of removed files may not be released yet.
    fn clear_if_due(&self) -> anyhow::Result<()> {
        if self.cleared.get().is_some_and(|cleared| cleared.elapsed() < CLEAR_EVERY) {
            return Ok(());
        }
        self.cleared.set(Some(Instant::now()));
        self.clear()
    }

    fn clear(&self) -> anyhow::Result<()> {
        let (mut limits, now) = (self.config.limits(), SystemTime::now());
        limits.age = limits.age.filter(|age| !self.doubts(now, *age));
        let cleared = self.shelf.clear(&limits, now).context("clearing old recordings away")?;
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
    fn doubts(&self, now: SystemTime, age: Duration) -> bool {
        let jumped = has_jumped(self.newest, now, age, self.began.elapsed());
        if jumped && !self.doubted.replace(jumped) {
            warn!(
                "by this computer's clock nothing was recorded here for longer than recording.age_max_days: it may be \
                 wrong, so no recording is removed for its age. If it is right, restart this service; if not, set it first"
            );
        }
        self.doubted.set(jumped);
        jumped
    }
}

/// Decides when a file ends: called every few milliseconds, it checks file, daemon and disk at longer intervals.
struct Until<'a> {
    station: &'a str,
    keeper: &'a Keeper<'a>,
    stopping: &'a dyn Fn() -> bool,
    alive: &'a dyn Fn(),
    looked: Cell<Instant>,
    /// Messages written at the last check.
    written: Cell<u64>,
    /// Restarts of the cycle number counted when the file was started.
    restarts: Cell<Option<u64>>,
    /// Reason for the end of the file, in words.
    why: Cell<&'static str>,
    trouble: Cell<Option<anyhow::Error>>,
}

impl<'a> Until<'a> {
    fn new(
        station: &'a str,
        keeper: &'a Keeper<'a>,
        stopping: &'a dyn Fn() -> bool,
        alive: &'a dyn Fn(),
    ) -> Until<'a> {
        Until {
            station,
            keeper,
            stopping,
            alive,
            looked: Cell::new(Instant::now()),
            written: Cell::new(0),
            restarts: Cell::new(None),
            why: Cell::new("is whole"),
            trouble: Cell::new(None),
        }
    }

    fn is_over(&self, progress: &Progress<'_>) -> bool {
        if (self.stopping)() {
            return true;
        }
        if let Err(error) = self.keeper.clear_if_due() {
            self.trouble.set(Some(error));
            return true;
        }
        let restarts = progress.summary.cycles.restarts;
        let begun_with = self.restarts.get().unwrap_or(restarts);
        self.restarts.set(Some(begun_with));
        let pause = if restarts > begun_with { LOOK_AFTER_RESTART } else { LOOK_AT_FILE_EVERY };
        if self.looked.get().elapsed() < pause {
            return false;
        }
        self.looked.set(Instant::now());
        self.look(progress)
    }

    /// Checks that the file is still at its path, its size, and which daemon runs.
    fn look(&self, progress: &Progress<'_>) -> bool {
        let facts = status::read(self.station);
        let written = progress.summary.written();
        let runs = facts.as_ref().is_some_and(|facts| runs(facts.process_id));
        // A running daemon publishes in every cycle, so a recorder that receives nothing must not feed the watchdog.
        if written > self.written.replace(written) || !runs {
            (self.alive)();
        }
        let Some(bytes) = progress.recorder.bytes_in_place() else {
            self.why.set("was removed or replaced while it was written: the next file begins");
            return true;
        };
        if facts.is_some_and(|facts| facts.process_id != progress.process_id) {
            self.why.set("is whole: another daemon runs, with a head of its own");
            return true;
        }
        bytes >= self.keeper.config.file_max_mib * MIB || progress.joined.is_cut_off()
    }
}
