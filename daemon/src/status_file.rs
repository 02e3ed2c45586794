//! Writes the status of this daemon for other processes ([`equipoise_station::status`]).

use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use equipoise_files::{Existing, write_regular};
use equipoise_station::proc::MemoryUse;
use equipoise_station::status::{Status, path_of};

use crate::thread_registry::{FaultWatch, ThreadRegistry};

/// The file of a station's daemon; removed at its end. Clones share the same facts.
#[derive(Debug, Clone)]
pub struct StatusFile {
    /// Path of the file.
    pub path: PathBuf,
    facts: Arc<Mutex<Facts>>,
}

#[derive(Debug)]
struct Facts {
    status: Status,
    faults: FaultWatch,
    /// The file is removed and must not be written again: the daemon ends.
    is_removed: bool,
}

impl StatusFile {
    /// A file for these facts.
    pub fn new(status: Status) -> StatusFile {
        let facts = Facts { status, faults: FaultWatch::default(), is_removed: false };
        StatusFile { path: path_of(&facts.status.station), facts: Arc::new(Mutex::new(facts)) }
    }

    /// Sets the discrepancy between model and measurement; written with the next [`StatusFile::write`].
    pub fn set_model_mismatch(&self, suspicion: Option<String>) {
        self.change(|status| status.model_mismatch = suspicion);
    }

    /// Sets why the weighing does not progress; written with the next [`StatusFile::write`].
    pub fn set_weighing(&self, reason: Option<String>) {
        self.change(|status| status.weighing = reason);
    }

    /// Sets the active incidents; written with the next [`StatusFile::write`].
    pub fn set_incidents(&self, incidents: BTreeMap<String, String>) {
        self.change(|status| status.incidents = incidents);
    }

    /// Updates threads and memory; `cycle` is the loop's current cycle. For calls about once per second.
    pub fn update_threads(&self, thread_registry: &ThreadRegistry, cycle: u64) {
        let Facts { status, faults, .. } = &mut *self.facts();
        status.threads = thread_registry.threads();
        status.memory = MemoryUse::read();
        status.loop_faults = faults.update(cycle, &status.threads);
    }

    /// Minor and major page faults of the loop since its warm-up; `None` before its end. A steady loop has none.
    pub fn loop_faults(&self) -> Option<[u64; 2]> {
        self.facts().status.loop_faults
    }

    /// Changes facts; written with the next [`StatusFile::write`].
    pub fn change(&self, change: impl FnOnce(&mut Status)) {
        change(&mut self.facts().status);
    }

    fn facts(&self) -> MutexGuard<'_, Facts> {
        self.facts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes the file atomically, without a sync to disk: it is outdated after a second and removed with the daemon.
    ///
    /// # Errors
    /// The system's error, or the file was removed.
    pub fn write(&self) -> std::io::Result<()> {
        // Serialises the writes of two threads to the same temporary file.
        let facts = self.facts();
        if facts.is_removed {
            return Err(std::io::Error::other("the daemon is stopping"));
        }
        let text = serde_json::to_string_pretty(&facts.status)?;
        let new = self.path.with_extension("json.new");
        write_regular(&new, Existing::Truncate, 0o666)?.write_all(text.as_bytes())?;
        std::fs::rename(&new, &self.path)
    }

    /// Removes the file; later writes of all clones fail.
    pub fn remove(&self) {
        let mut facts = self.facts();
        facts.is_removed = true;
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(test)]
impl StatusFile {
    /// A file in a directory, for tests.
    pub(crate) fn example(directory: &std::path::Path) -> StatusFile {
        let facts = serde_json::json!({
            "version": "1", "process_id": 1, "station": "s", "config_toml": "", "memory_lock": "", "threads": []
        });
        let file = StatusFile::new(serde_json::from_value(facts).expect("the facts"));
        StatusFile { path: directory.join("status.json"), ..file }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_removed_file_is_not_written_again() {
        let directory = tempfile::tempdir().unwrap();
        let file = StatusFile::example(directory.path());
        file.write().unwrap();
        assert!(file.path.exists());
        // A command may still be in progress in another thread.
        let other = file.clone();
        file.remove();
        other.write().unwrap_err();
        assert!(!file.path.exists());
    }
}
