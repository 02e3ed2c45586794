//! Manages the recordings of a station in a folder, and removes the oldest ones according to limits.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rustix::fs::statvfs;

use equipoise_files::atomic_file::remove_abandoned_files;
use equipoise_files::open_regular;

use super::signature::{SIGNATURE_ENDING, signature_of};

/// Limits of the stored recordings.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Total size of all files, bytes.
    pub total_bytes: u64,
    /// Maximum time since a file was written, by its date and number; `None`: no limit.
    pub age: Option<Duration>,
    /// Minimum free space of the disk, bytes.
    pub free_bytes: u64,
}

/// The recordings of one station in one folder. Only files that match its naming scheme are ever removed.
#[derive(Debug, Clone)]
pub struct RecordingStore {
    directory: PathBuf,
    prefix: String,
}

/// A recording in the folder.
#[derive(Debug, Clone, PartialEq, Eq)]
struct RecordingFile {
    path: PathBuf,
    number: u64,
    bytes: u64,
    changed: SystemTime,
}

impl RecordingFile {
    /// Time since its last change; `None` while it is in the future.
    ///
    /// A wrong clock may have set the change before the file's number, which is not below the start of the file before
    /// it: the later one counts, unless a clock that was ahead has set it in the future.
    fn age(&self, now: SystemTime) -> Option<Duration> {
        let numbered = SystemTime::UNIX_EPOCH.checked_add(Duration::from_secs(self.number));
        [Some(self.changed), numbered]
            .into_iter()
            .flatten()
            .filter_map(|at| now.duration_since(at).ok())
            .min()
    }
}

/// Result of a cleanup.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Cleared {
    /// Removed files, each with the reason.
    pub removed: Vec<(PathBuf, &'static str)>,
    /// Free space of the disk, including space of removed files that is yet to be released, bytes.
    pub free_bytes: u64,
}

const EXTENSION: &str = ".mcap";
/// Digits of the seconds since 1970, with leading zeros so that names sort by number.
const DIGITS: usize = 10;

impl RecordingStore {
    /// The recordings of a station; creates the folder if it does not exist.
    ///
    /// # Errors
    /// The system's error if the folder cannot be created.
    pub fn open(directory: &Path, station: &str) -> io::Result<RecordingStore> {
        fs::create_dir_all(directory)?;
        Ok(RecordingStore { directory: directory.to_owned(), prefix: format!("{station}.") })
    }

    /// The series that a file belongs to according to its name, and its number in the series.
    pub(super) fn with(path: &Path) -> Option<(RecordingStore, u64)> {
        let (station, _) = path.file_stem()?.to_str()?.rsplit_once('.')?;
        let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let store = RecordingStore { directory: parent.to_owned(), prefix: format!("{station}.") };
        let number = store.number(path.file_name()?.to_str()?)?;
        Some((store, number))
    }

    /// The file with the next higher number.
    pub(super) fn after(&self, number: u64) -> Option<PathBuf> {
        let files = self.files().unwrap_or_default().into_iter();
        files.filter(|file| file.number > number).min_by_key(|file| file.number).map(|file| file.path)
    }

    /// Whether there are files with lower numbers than that in `name`.
    pub(super) fn has_before(&self, name: &str) -> bool {
        let files = self.files().unwrap_or_default();
        self.number(name).is_some_and(|number| files.iter().any(|file| file.number < number))
    }

    /// The newest file that is not being written.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub(super) fn newest_finished(&self) -> io::Result<Option<PathBuf>> {
        let mut newest_first = self.files()?.into_iter().rev().map(|file| file.path);
        Ok(newest_first.find(|path| !is_being_written(path)))
    }

    /// Removes incompletely written signatures.
    pub(super) fn remove_unfinished_signatures(&self) {
        let is_signature =
            |name: &str| name.strip_suffix(SIGNATURE_ENDING).and_then(|of| self.number(of)).is_some();
        remove_abandoned_files(&self.directory, is_signature);
    }

    /// An unused name `STATION.SECONDS.mcap`, with the first free second from `unix_s` on, but after all other files: the
    /// clock may be wrong, and names must sort by the order of recording.
    pub fn next(&self, unix_s: u64) -> PathBuf {
        let newest = self.files().ok().and_then(|files| Some(files.last()?.number));
        let unix_s = newest.map_or(unix_s, |newest| unix_s.max(newest.saturating_add(1)));
        let path = |second: u64| self.directory.join(format!("{}{second:0DIGITS$}{EXTENSION}", self.prefix));
        (unix_s..).map(path).find(|path| path.symlink_metadata().is_err()).unwrap_or_else(|| path(unix_s))
    }

    /// The number in a name of this series; `None` for other names.
    fn number(&self, name: &str) -> Option<u64> {
        let digits = name.strip_prefix(&self.prefix)?.strip_suffix(EXTENSION)?;
        let plain = digits.len() >= DIGITS && digits.bytes().all(|byte| byte.is_ascii_digit());
        plain.then(|| digits.parse().ok()).flatten()
    }

    /// Time of the last change of the newest file; `None` if there is none.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub fn newest(&self) -> io::Result<Option<SystemTime>> {
        Ok(self.files()?.last().map(|file| file.changed))
    }

    /// The files of the series in the order of recording.
    fn files(&self) -> io::Result<Vec<RecordingFile>> {
        let mut files = Vec::new();
        for entry in fs::read_dir(&self.directory)? {
            let entry = entry?;
            let Some(number) = entry.file_name().to_str().and_then(|name| self.number(name)) else {
                continue;
            };
            // Links are not part of the series and are not followed.
            let Ok(facts) = entry.path().symlink_metadata() else { continue };
            if facts.is_file() {
                let changed = facts.modified()?;
                files.push(RecordingFile { path: entry.path(), number, bytes: facts.len(), changed });
            }
        }
        files.sort_by_key(|file| file.number);
        Ok(files)
    }

    /// Removes the oldest files until all limits are met, except files that are being written by any process.
    ///
    /// # Errors
    /// The folder or the disk cannot be queried. A file that cannot be removed is skipped.
    pub fn clear(&self, limits: &Limits, now: SystemTime) -> io::Result<Cleared> {
        self.clear_on(limits, now, || self.free_bytes())
    }

    /// As [`Self::clear`], with a replaceable query of the free space.
    fn clear_on(
        &self,
        limits: &Limits,
        now: SystemTime,
        free_bytes: impl Fn() -> io::Result<u64>,
    ) -> io::Result<Cleared> {
        let files = self.files()?;
        let mut total: u64 = files.iter().map(|file| file.bytes).sum();
        let mut cleared = Cleared { removed: Vec::new(), free_bytes: free_bytes()? };
        let is_old =
            |file: &RecordingFile| file.age(now).zip(limits.age).is_some_and(|(age, limit)| age > limit);
        for file in files {
            let old = is_old(&file);
            let reason = if old {
                "older than recording.age_max_days"
            } else if total > limits.total_bytes {
                "more than recording.total_max_mib"
            } else if cleared.free_bytes < limits.free_bytes {
                "less free than recording.free_min_mib"
            } else {
                continue;
            };
            if is_being_written(&file.path) || fs::remove_file(&file.path).is_err() {
                continue;
            }
            let _ = fs::remove_file(signature_of(&file.path));
            total -= file.bytes;
            cleared.removed.push((file.path, reason));
            // Some file systems release space later, and none does while the file is open: count removed files as free
            // at once, otherwise all other files would be removed too.
            cleared.free_bytes = cleared.free_bytes.saturating_add(file.bytes).max(free_bytes()?);
        }
        Ok(cleared)
    }

    /// Free space of the folder's disk for unprivileged users, bytes.
    fn free_bytes(&self) -> io::Result<u64> {
        let disk = statvfs(&self.directory)?;
        Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
    }
}

/// Whether the clock is unreliable for ages: according to it, nothing was recorded for longer than `age` when this
/// process started, `running` ago. Becomes false again once the clock is corrected.
pub fn has_jumped(newest: Option<SystemTime>, now: SystemTime, age: Duration, running: Duration) -> bool {
    let since = newest.and_then(|newest| now.duration_since(newest).ok());
    since.is_some_and(|since| since > age.saturating_add(running))
}

/// A recorder holds a lock on its file while it writes. Files that cannot be opened are also left alone.
fn is_being_written(path: &Path) -> bool {
    !open_regular(path).is_ok_and(|file| file.try_lock().is_ok())
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::*;

    const DAY: Duration = Duration::from_secs(86_400);
    const UNLIMITED: Limits = Limits { total_bytes: u64::MAX, age: None, free_bytes: 0 };

    fn store() -> (tempfile::TempDir, RecordingStore) {
        let folder = tempfile::tempdir().unwrap();
        let store = RecordingStore::open(folder.path(), "station-1").unwrap();
        (folder, store)
    }

    fn create_file(folder: &Path, name: &str, bytes: usize) -> PathBuf {
        let path = folder.join(name);
        fs::write(&path, vec![0; bytes]).unwrap();
        path
    }

    fn create_file_at(folder: &Path, number: u64, changed_s: u64) {
        let path = create_file(folder, &format!("station-1.{number:010}.mcap"), 100);
        let changed = SystemTime::UNIX_EPOCH + Duration::from_secs(changed_s);
        File::options().append(true).open(path).unwrap().set_modified(changed).unwrap();
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn the_oldest_are_removed_until_the_total_is_below_the_limit() {
        let (folder, store) = store();
        // The clock was wrong during the last and the first file.
        for (second, changed_s) in [(30, 2000), (90, 1000), (20, 1 << 33)] {
            create_file_at(folder.path(), second, changed_s);
        }
        let limits = Limits { total_bytes: 250, ..UNLIMITED };
        let cleared = store.clear(&limits, SystemTime::now()).unwrap();
        assert_eq!(cleared.removed.len(), 1);
        assert_eq!(names(folder.path()), ["station-1.0000000030.mcap", "station-1.0000000090.mcap"]);
        assert_eq!(store.newest_finished().unwrap(), Some(folder.path().join("station-1.0000000090.mcap")));
        assert!(store.clear(&limits, SystemTime::now()).unwrap().removed.is_empty(), "enough is enough");
    }

    #[test]
    fn a_removed_recording_removes_its_signature() {
        let (folder, store) = store();
        let signed = |name: &str| {
            let recording = create_file(folder.path(), name, 100);
            let signature = signature_of(&recording);
            fs::write(&signature, "untrusted comment").unwrap();
            (recording, signature)
        };
        let all = [10, 11, 12].map(|second: u64| signed(&format!("station-1.{second:010}.mcap")));
        let (_, of_another) = signed("station-2.0000000010.mcap");
        let writer = File::open(&all[1].0).unwrap();
        writer.try_lock().unwrap();
        let remaining =
            || all.each_ref().map(|(recording, signature)| [recording, signature].map(|f| f.exists()));

        // Each limit by itself.
        let limits = Limits { total_bytes: 250, ..UNLIMITED };
        assert_eq!(store.clear(&limits, SystemTime::now()).unwrap().removed.len(), 1);
        assert_eq!(remaining(), [[false; 2], [true; 2], [true; 2]]);
        let old = Limits { age: Some(DAY), ..UNLIMITED };
        assert_eq!(store.clear(&old, SystemTime::now() + 2 * DAY).unwrap().removed.len(), 1);
        assert_eq!(remaining(), [[false; 2], [true; 2], [false; 2]], "a recording in progress keeps its own");
        drop(writer);
        let limits = Limits { free_bytes: u64::MAX, ..UNLIMITED };
        assert_eq!(store.clear(&limits, SystemTime::now()).unwrap().removed.len(), 1);
        assert_eq!(remaining(), [[false; 2]; 3]);
        assert!(of_another.exists());
        assert_eq!(names(folder.path()).len(), 2, "{:?}", names(folder.path()));
    }

    #[test]
    fn old_recordings_are_removed_regardless_of_size() {
        let (folder, store) = store();
        create_file(folder.path(), "station-1.0000000010.mcap", 1);
        let limits = Limits { age: Some(DAY), ..UNLIMITED };
        assert!(store.clear(&limits, SystemTime::now()).unwrap().removed.is_empty());
        assert_eq!(store.clear(&limits, SystemTime::now() + 2 * DAY).unwrap().removed.len(), 1);
    }

    #[test]
    fn a_wrong_clock_makes_no_file_old() {
        let (folder, store) = store();
        let now_s = 2_000_000_000;
        let day_s = DAY.as_secs();
        // The clock was at 1970 during the second file, and ahead during the third; the last one is right.
        let files =
            [(now_s - 3 * day_s, now_s - 3 * day_s), (now_s - day_s, 10), (now_s + 9 * day_s, 1 << 33)];
        for (number, changed_s) in files.into_iter().chain([(now_s + 9 * day_s + 1, now_s)]) {
            create_file_at(folder.path(), number, changed_s);
        }
        let old = Limits { age: Some(2 * DAY), ..UNLIMITED };
        let at = |second: u64| SystemTime::UNIX_EPOCH + Duration::from_secs(second);
        assert_eq!(store.clear(&old, at(now_s)).unwrap().removed.len(), 1);
        assert_eq!(store.clear(&old, at(now_s + day_s + 2)).unwrap().removed.len(), 1);
        assert_eq!(names(folder.path()).len(), 2);
        assert_eq!(store.clear(&old, at(now_s + 2 * day_s + 2)).unwrap().removed.len(), 1, "the last one");
    }

    #[test]
    fn ages_are_ignored_after_a_clock_jump() {
        let (folder, store) = store();
        assert_eq!(store.newest().unwrap(), None);
        create_file(folder.path(), "station-1.0000000010.mcap", 1);
        let newest = store.newest().unwrap();
        let now = newest.unwrap();
        assert!(!has_jumped(None, now, DAY, Duration::ZERO), "nothing there, nothing to lose");
        assert!(!has_jumped(newest, now + DAY / 2, DAY, Duration::ZERO));
        assert!(has_jumped(newest, now + 1000 * DAY, DAY, Duration::ZERO));
        assert!(!has_jumped(newest, now + 3 * DAY, DAY, 2 * DAY), "it has run for two of the three days");
        assert!(has_jumped(newest, now + 1002 * DAY, DAY, 2 * DAY), "however long it runs");
        assert!(!has_jumped(newest, now - DAY, DAY, Duration::ZERO), "behind, nothing is old");
    }

    #[test]
    fn delayed_release_of_space_removes_no_further_files() {
        let (folder, store) = store();
        for second in 10..20 {
            create_file(folder.path(), &format!("station-1.{second:010}.mcap"), 100);
        }
        let limits = Limits { free_bytes: 1150, ..UNLIMITED };
        let cleared = store.clear_on(&limits, SystemTime::now(), || Ok(1000)).unwrap();
        assert_eq!((cleared.removed.len(), cleared.free_bytes), (2, 1200));
        assert_eq!(names(folder.path()).len(), 8);
    }

    #[test]
    fn files_of_other_programs_are_never_removed() {
        let (folder, store) = store();
        let others = [
            "notes.txt",
            "station-1.mcap",
            "station-1.first.mcap",
            "station-1.0000000010.mcap.part",
            "station-10.0000000010.mcap",
            "station-2.0000000010.mcap",
        ];
        for name in others {
            create_file(folder.path(), name, 100);
        }
        fs::create_dir(folder.path().join("station-1.0000000009.mcap")).unwrap();
        std::os::unix::fs::symlink("notes.txt", folder.path().join("station-1.0000000008.mcap")).unwrap();
        let before = names(folder.path());
        let nothing = Limits { total_bytes: 0, age: Some(Duration::ZERO), free_bytes: u64::MAX };
        let cleared = store.clear(&nothing, SystemTime::now() + DAY).unwrap();
        assert!(cleared.removed.is_empty(), "{cleared:?}");
        assert_eq!(names(folder.path()), before);
    }

    #[test]
    fn a_file_in_progress_is_not_removed() {
        let (folder, store) = store();
        let path = create_file(folder.path(), "station-1.0000000010.mcap", 100);
        let writer = File::options().append(true).open(&path).unwrap();
        writer.try_lock().unwrap();
        let nothing = Limits { total_bytes: 0, ..UNLIMITED };
        assert!(store.clear(&nothing, SystemTime::now()).unwrap().removed.is_empty());
        assert!(path.exists());
        drop(writer);
        assert_eq!(store.clear(&nothing, SystemTime::now()).unwrap().removed.len(), 1);
    }

    #[test]
    fn a_full_disk_removes_all_own_recordings_and_reports_the_free_space() {
        let (folder, store) = store();
        create_file(folder.path(), "station-1.0000000010.mcap", 100);
        let limits = Limits { free_bytes: u64::MAX, ..UNLIMITED };
        let cleared = store.clear(&limits, SystemTime::now()).unwrap();
        assert_eq!(cleared.removed.len(), 1);
        assert!(cleared.free_bytes < u64::MAX && names(folder.path()).is_empty());
    }

    #[test]
    fn a_new_name_is_unused() {
        let (_folder, store) = store();
        let first = store.next(1_700_000_000);
        assert!(first.ends_with("station-1.1700000000.mcap"));
        fs::write(&first, "").unwrap();
        assert!(store.next(1_700_000_000).ends_with("station-1.1700000001.mcap"));
        assert!(store.next(1_800_000_000).ends_with("station-1.1800000000.mcap"));
        assert!(store.next(10).ends_with("station-1.1700000001.mcap"), "the clock was set back");
    }
}
