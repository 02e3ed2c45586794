//! Lock files: at most one process at a time holds a name.
//!
//! The kernel releases the lock at the end of the process, however it ends.

use std::fs::{self, File, TryLockError};
use std::io::{Error, ErrorKind, Result, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::atomic_file::MODE;
use crate::{Existing, read_text, write_regular};

/// Maximum length of a holder's description.
const HOLDER_BYTES_MAX: u64 = 1024;

/// A held lock file, which is removed when dropped.
#[derive(Debug)]
pub struct FileLock {
    file: File,
    path: PathBuf,
}

impl FileLock {
    /// Creates the file if it does not exist, and locks it; `holder` describes this process to others.
    ///
    /// # Errors
    /// [`ErrorKind::ResourceBusy`] with the description of the holder if the file is locked; other errors of the system.
    pub fn acquire(path: &Path, holder: &str) -> Result<FileLock> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        loop {
            let file = write_regular(path, Existing::Keep, MODE)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let holder = read_text(path, HOLDER_BYTES_MAX).unwrap_or_default();
                    let holder = if holder.is_empty() { "another process".to_owned() } else { holder };
                    return Err(Error::new(ErrorKind::ResourceBusy, holder));
                }
                Err(TryLockError::Error(error)) => return Err(error),
            }
            let mut lock = FileLock { file, path: path.to_owned() };
            // Otherwise the previous holder removed the file between opening and locking.
            if lock.is_in_place() {
                // The description is only for messages; it is missing on a full disk.
                let _ = lock.file.set_len(0).and_then(|()| lock.file.write_all(holder.as_bytes()));
                return Ok(lock);
            }
        }
    }

    fn is_in_place(&self) -> bool {
        let identity = |facts: fs::Metadata| (facts.dev(), facts.ino());
        match (self.file.metadata(), fs::metadata(&self.path)) {
            (Ok(own), Ok(current)) => identity(own) == identity(current),
            _ => false,
        }
    }
}

impl Drop for FileLock {
    fn drop(&mut self) {
        if self.is_in_place() {
            // A remaining file is harmless: it is not locked.
            let _ = fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_held_once_until_it_is_released() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep").join("a.lock");
        let lock = FileLock::acquire(&path, "station a").unwrap();
        let refusal = FileLock::acquire(&path, "station b").unwrap_err();
        assert_eq!((refusal.kind(), refusal.to_string()), (ErrorKind::ResourceBusy, "station a".to_owned()));
        drop(lock);
        assert!(!path.exists());
        // Left by a process that was killed.
        fs::write(&path, "a longer description").unwrap();
        let _lock = FileLock::acquire(&path, "station b").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "station b");
    }

    #[test]
    fn a_file_that_replaced_the_locked_one_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lock");
        let first = FileLock::acquire(&path, "first").unwrap();
        fs::remove_file(&path).unwrap();
        let second = FileLock::acquire(&path, "second").unwrap();
        drop(first);
        assert!(path.exists());
        drop(second);
        assert!(!path.exists());
    }

    #[test]
    fn threads_hold_it_one_after_the_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lock");
        let (inside, most) = (std::sync::atomic::AtomicU32::new(0), std::sync::atomic::AtomicU32::new(0));
        let order = std::sync::atomic::Ordering::SeqCst;
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..200 {
                        if let Ok(_lock) = FileLock::acquire(&path, "") {
                            most.fetch_max(inside.fetch_add(1, order) + 1, order);
                            inside.fetch_sub(1, order);
                        }
                    }
                });
            }
        });
        assert_eq!(most.load(order), 1);
    }
}
