//! Writes a recording from the system's cache to the disk, in a thread of its own: the disk may take longer than the bus
//! holds messages.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, anyhow};
use crossbeam_channel::{RecvTimeoutError, Sender, bounded};
use equipoise_files::atomic_file::sync_directory_of;

/// Interval: with the duration of a write, the maximum loss at a power failure.
const SYNC_INTERVAL: Duration = Duration::from_secs(5);

/// A thread that writes everything to the disk and ends when this value is dropped.
pub(super) struct Syncer {
    path: PathBuf,
    stop: Sender<()>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl Syncer {
    /// Starts with the directory entry of a new file. `file` is a second handle of it.
    pub(super) fn start(path: &Path, file: File) -> Syncer {
        let (stop, stopped) = bounded::<()>(0);
        let path = path.to_owned();
        let new = path.clone();
        let thread = std::thread::spawn(move || {
            // Some file systems do not synchronise directories.
            let _ = sync_directory_of(&new);
            while stopped.recv_timeout(SYNC_INTERVAL) == Err(RecvTimeoutError::Timeout) {
                file.sync_data()?;
            }
            file.sync_all()
        });
        Syncer { path, stop, thread: Some(thread) }
    }

    /// # Errors
    /// The disk has rejected what was written.
    pub(super) fn check(&mut self) -> anyhow::Result<()> {
        self.thread.take_if(|thread| thread.is_finished()).map_or(Ok(()), |thread| join(thread, &self.path))
    }

    /// Waits until what was written is on the disk.
    ///
    /// # Errors
    /// The disk has rejected it.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        let Syncer { path, stop, thread } = self;
        drop(stop);
        thread.map_or(Ok(()), |thread| join(thread, &path))
    }
}

fn join(thread: JoinHandle<io::Result<()>>, path: &Path) -> anyhow::Result<()> {
    let synchronised = thread.join().map_err(|_| anyhow!("the thread that writes it to the disk panicked"));
    synchronised
        .and_then(|synchronised| synchronised.map_err(anyhow::Error::from))
        .with_context(|| format!("cannot write the recording {}", path.display()))
}
