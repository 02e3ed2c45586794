//! Atomic file writes: after a crash, a kill or a full disk, the file has either the old or the new content.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Owner writes, group reads.
pub const MODE: u32 = 0o640;
/// Number of temporary files created by this process.
static FILES_CREATED: AtomicU64 = AtomicU64::new(0);

/// Writes a file so that a crash at any instant leaves either the old content or the new. Concurrent writes are safe:
/// the file has the complete content of the last one.
///
/// # Errors
/// The system's error; the old content remains.
pub fn write_atomically(path: &Path, content: &[u8]) -> std::io::Result<()> {
    write_atomically_with(path, content, |_| Ok(()))
}

/// As [`write_atomically`]; `prepare` sets owner and mode of the file before the content is written.
///
/// # Errors
/// The system's error, or that of `prepare`; the old content remains.
pub fn write_atomically_with(
    path: &Path,
    content: &[u8],
    prepare: impl FnOnce(&File) -> std::io::Result<()>,
) -> std::io::Result<()> {
    let directory = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::create_dir_all(directory)?;
    let (mut file, temporary) = create_temporary(path)?;
    let written = prepare(&file).and_then(|()| file.write_all(content)).and_then(|()| file.sync_all());
    if let Err(error) = written.and_then(|()| fs::rename(&temporary, path)) {
        let _ = fs::remove_file(&temporary);
        return Err(error);
    }
    // Makes the rename durable: it is an entry of the directory.
    sync_directory_of(path)
}

/// Writes the directory entry of a file from the system's cache to the disk.
///
/// # Errors
/// The directory cannot be opened or synchronised; some file systems do not synchronise directories.
pub fn sync_directory_of(path: &Path) -> std::io::Result<()> {
    let directory = path.parent().filter(|directory| !directory.as_os_str().is_empty());
    File::open(directory.unwrap_or(Path::new(".")))?.sync_all()
}

/// Creates a temporary file `<path>.<process>-<number>.new`, unique to this write.
fn create_temporary(path: &Path) -> std::io::Result<(File, PathBuf)> {
    loop {
        let number = FILES_CREATED.fetch_add(1, Ordering::Relaxed);
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".{}-{number}.new", std::process::id()));
        let temporary = PathBuf::from(name);
        match OpenOptions::new().write(true).create_new(true).mode(MODE).open(&temporary) {
            // Left by an earlier process with the same id, as in a container.
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
            opened => return opened.map(|file| (file, temporary)),
        }
    }
}

/// Temporary file of an interrupted write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TemporaryFile<'a> {
    /// Name of the intended file.
    pub target: &'a str,
    /// Whether its writer no longer runs.
    pub is_abandoned: bool,
}

impl TemporaryFile<'_> {
    /// Parses a file name; `None` if it is not a temporary file. Older versions wrote `<name>.new`.
    pub fn named(name: &str) -> Option<TemporaryFile<'_>> {
        let stem = name.strip_suffix(".new")?;
        let numbered = stem.rsplit_once('.').and_then(|(target, writer)| {
            let (process, number) = writer.split_once('-')?;
            Some((target, process.parse::<u32>().ok()?, number.parse::<u64>().ok()?))
        });
        Some(match numbered {
            Some((target, process, number)) => {
                TemporaryFile { target, is_abandoned: !is_being_written(process, number) }
            }
            None => TemporaryFile { target: stem, is_abandoned: true },
        })
    }
}

fn is_being_written(process: u32, number: u64) -> bool {
    match process == std::process::id() {
        true => number < FILES_CREATED.load(Ordering::Relaxed),
        false => process_runs(process),
    }
}

/// Whether a process runs.
pub fn process_runs(process: u32) -> bool {
    Path::new("/proc").join(process.to_string()).exists()
}

/// Removes abandoned temporary files from a folder if `is_ours` returns true for the intended name.
pub fn remove_abandoned_files(folder: &Path, is_ours: impl Fn(&str) -> bool) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if TemporaryFile::named(&name).is_some_and(|found| found.is_abandoned && is_ours(found.target)) {
            // A remaining file is harmless.
            let _ = fs::remove_file(entry.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_file_is_replaced_atomically() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("deep").join("a.toml");
        write_atomically(&path, b"one").unwrap();
        write_atomically(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
    }

    #[test]
    fn a_file_has_its_mode_before_it_replaces_another() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.toml");
        fs::write(&path, "old").unwrap();
        write_atomically_with(&path, b"new", |file| {
            assert_eq!((file.metadata()?.len(), fs::read(&path)?), (0, b"old".to_vec()));
            file.set_permissions(fs::Permissions::from_mode(0o600))
        })
        .unwrap();
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        let refused = write_atomically_with(&path, b"newer", |_| Err(std::io::Error::other("no")));
        assert!(refused.is_err() && fs::read(&path).unwrap() == b"new");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    }

    #[test]
    fn concurrent_writes_have_different_temporary_files() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.toml");
        let (_one, first) = create_temporary(&path).unwrap();
        let (_other, second) = create_temporary(&path).unwrap();
        assert_ne!(first, second);
        let content = |of: u8| vec![of; 100_000];
        std::thread::scope(|scope| {
            for of in 0..4 {
                let path = &path;
                scope.spawn(move || (0..50).for_each(|_| write_atomically(path, &content(of)).unwrap()));
            }
            for _ in 0..200 {
                let read = fs::read(&path).unwrap_or_else(|_| content(0));
                assert!(read.len() == 100_000 && read.iter().all(|byte| *byte == read[0]), "half a file");
            }
        });
    }

    #[test]
    fn only_abandoned_files_are_cleared() {
        let directory = tempfile::tempdir().unwrap();
        // No process has this id: ids are below 2^22.
        let ended = "a.toml.4194305-3.new";
        let running = format!("a.toml.{}-0.new", std::os::unix::process::parent_id());
        let own = format!("a.toml.{}-{}.new", std::process::id(), u64::MAX);
        let (_file, now) = create_temporary(&directory.path().join("a.toml")).unwrap();
        let others = ["a.toml", "b.toml.new", &running, &now.file_name().unwrap().to_string_lossy()];
        for name in others.into_iter().chain([ended, "a.toml.new", &own]) {
            fs::write(directory.path().join(name), "").unwrap();
        }
        remove_abandoned_files(directory.path(), |of| of == "a.toml");
        let mut remaining: Vec<_> =
            fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        remaining.sort();
        let mut others = others.map(std::ffi::OsString::from);
        others.sort();
        assert_eq!(remaining, others);
    }
}
