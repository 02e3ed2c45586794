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
}

impl StatusFile {
    /// A file for these facts.
    pub fn new(status: Status) -> StatusFile {
        let facts = Facts { status, faults: FaultWatch::default() };
        StatusFile { path: path_of(&facts.status.station), facts: Arc::new(Mutex::new(facts)) }
    }

    /// Sets the discrepancy between model and measurement; written with the next [`StatusFile::write`].
    pub fn set_model_mismatch(&self, suspicion: Option<String>) {
        self.change(|status| status.model_mismatch = suspicion);
    }

    /// Sets the active subject; written with the next [`StatusFile::write`].
    pub fn set_subject(&self, subject: &str) {
        self.change(|status| subject.clone_into(&mut status.subject));
    }

    /// Sets the active incidents; written with the next [`StatusFile::write`].
    pub fn set_incidents(&self, incidents: BTreeMap<String, String>) {
        self.change(|status| status.incidents = incidents);
    }

    /// Updates threads and memory; `cycle` is the loop's current cycle. For calls about once per second.
    pub fn update_threads(&self, thread_registry: &ThreadRegistry, cycle: u64) {
        let Facts { status, faults } = &mut *self.facts();
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
    /// The system's error.
    pub fn write(&self) -> std::io::Result<()> {
        // Serialises the writes of two threads to the same temporary file.
        let facts = self.facts();
        let text = serde_json::to_string_pretty(&facts.status)?;
        let new = self.path.with_extension("json.new");
        write_regular(&new, Existing::Truncate, 0o666)?.write_all(text.as_bytes())?;
        std::fs::rename(&new, &self.path)
    }

    /// Removes the file.
    pub fn remove(&self) {
        let _ = std::fs::remove_file(&self.path);
    }
}
