//! Corrects modification times of closed recordings after a step of the system clock, so that retention by age stays
//! right.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use equipoise_files::open_regular;
use tracing::{info, warn};

/// Minimum step of the clock that is corrected; much less than any age limit.
const CLOCK_STEP: Duration = Duration::from_secs(60);

/// The closed recordings, each with the time of closing.
pub(super) struct FinishedFiles {
    files: Vec<(PathBuf, Instant)>,
    started: Instant,
    /// Start by the system clock as currently set.
    started_at: SystemTime,
}

impl FinishedFiles {
    /// Without files; `now` is the system time.
    pub(super) fn new(now: SystemTime) -> FinishedFiles {
        FinishedFiles { files: Vec::new(), started: Instant::now(), started_at: now }
    }

    pub(super) fn push(&mut self, path: &Path) {
        self.files.push((path.to_owned(), Instant::now()));
    }

    /// Corrects the dates if the system clock was set since the last call.
    pub(super) fn correct_dates_after_clock_step(&mut self, now: SystemTime) {
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
                Ok(()) => {
                    info!("the system clock was set: corrected the modification time of {}", path.display());
                }
                Err(error) => warn!(
                    "cannot correct the modification time of {} after a clock step: {error}",
                    path.display()
                ),
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
        finished.correct_dates_after_clock_step(then + Duration::from_secs(1));
        assert_eq!(date(), then, "no step, no change");
        let now = SystemTime::now();
        finished.correct_dates_after_clock_step(now);
        assert!(now.duration_since(date()).is_ok_and(|age| age < Duration::from_secs(3600)), "{:?}", date());
        assert_eq!(finished.files.len(), 1);
        finished.correct_dates_after_clock_step(then + Duration::from_secs(1));
        assert!(date() < then + Duration::from_secs(3600), "set back: {:?}", date());
    }
}
