//! Files finished by this process, dated again after a step of the clock: their age is that by the monotonic clock.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use equipoise_files::open_regular;
use tracing::{info, warn};

/// Smallest step of the clock after which files are dated again; much less than any age limit.
const CLOCK_STEP: Duration = Duration::from_secs(60);

/// The files, each with the time of its end.
pub(super) struct FinishedFiles {
    files: Vec<(PathBuf, Instant)>,
    started: Instant,
    /// Time of the start by the clock as it is set now.
    started_at: SystemTime,
}

impl FinishedFiles {
    /// None yet; `now` is the time by the clock.
    pub(super) fn new(now: SystemTime) -> FinishedFiles {
        FinishedFiles { files: Vec::new(), started: Instant::now(), started_at: now }
    }

    pub(super) fn push(&mut self, path: &Path) {
        self.files.push((path.to_owned(), Instant::now()));
    }

    /// Dates the files again if the clock was set since the last call.
    pub(super) fn follow_clock(&mut self, now: SystemTime) {
        let Some(started_at) = now.checked_sub(self.started.elapsed()) else { return };
        let ahead = started_at.duration_since(self.started_at).unwrap_or_else(|behind| behind.duration());
        if ahead < CLOCK_STEP {
            return;
        }
        self.started_at = started_at;
        self.files.retain(|(path, _)| path.symlink_metadata().is_ok());
        for (path, finished) in &self.files {
            let Some(date) = now.checked_sub(finished.elapsed()) else { continue };
            match open_regular(path).and_then(|file| file.set_modified(date)) {
                Ok(()) => info!("the clock was set: {} is dated again", path.display()),
                Err(error) => warn!("{} keeps the date of a wrong clock: {error}", path.display()),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, File};

    #[test]
    fn a_step_of_the_clock_changes_no_age() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("station-1.0000000010.mcap");
        let then = SystemTime::UNIX_EPOCH + Duration::from_secs(10);
        File::create(&path).unwrap().set_modified(then).unwrap();
        let date = || fs::metadata(&path).unwrap().modified().unwrap();
        let mut finished = FinishedFiles::new(then);
        finished.push(&path);
        finished.push(&folder.path().join("removed.mcap"));
        finished.follow_clock(then + Duration::from_secs(1));
        assert_eq!(date(), then, "no step, no change");
        let now = SystemTime::now();
        finished.follow_clock(now);
        assert!(now.duration_since(date()).is_ok_and(|age| age < Duration::from_secs(3600)), "{:?}", date());
        assert_eq!(finished.files.len(), 1);
        finished.follow_clock(then + Duration::from_secs(1));
        assert!(date() < then + Duration::from_secs(3600), "set back: {:?}", date());
    }
}
