//! Writes a recording from the system's cache to the disk, in a thread of its own: the disk may take longer than the bus
//! holds messages.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::Context;
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TryRecvError, bounded};
use equipoise_files::atomic_file::sync_directory_of;

/// Interval: with the duration of a write, the maximum loss at a power failure.
const SYNC_INTERVAL: Duration = Duration::from_secs(5);

/// A thread that ends when this value is dropped.
pub(super) struct Syncer {
    path: PathBuf,
    failed: Receiver<io::Error>,
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Syncer {
    /// Starts with the directory entry of a new file. `file` is a second handle of it.
    pub(super) fn start(path: &Path, file: File) -> Syncer {
        let (stop, stopped) = bounded::<()>(0);
        let (fault, failed) = bounded(1);
        let path = path.to_owned();
        let new = path.clone();
        let thread = std::thread::spawn(move || {
            // Some file systems do not synchronise directories.
            let _ = sync_directory_of(&new);
            while stopped.recv_timeout(SYNC_INTERVAL) == Err(RecvTimeoutError::Timeout) {
                if let Err(error) = file.sync_data() {
                    let _ = fault.send(error);
                    return;
                }
            }
        });
        Syncer { path, failed, stop: Some(stop), thread: Some(thread) }
    }

    /// # Errors
    /// The disk has rejected what was written.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        match self.failed.try_recv() {
            Ok(error) => {
                Err(error).with_context(|| format!("cannot write the recording {}", self.path.display()))
            }
            Err(TryRecvError::Empty | TryRecvError::Disconnected) => Ok(()),
        }
    }
}

impl Drop for Syncer {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
