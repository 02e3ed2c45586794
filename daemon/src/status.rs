//! What a running daemon says of itself beside the bus: a small file that `equipoise status` and recorders read.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use crate::realtime::ThreadReport;
use crate::whole_file::write_whole;

/// The facts of one daemon.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Status {
    /// Version of the program.
    pub version: String,
    /// Process.
    pub process_id: u32,
    /// Station.
    pub station: String,
    /// The whole configuration, defaults included.
    pub config_toml: String,
    /// The model in use beside the body; empty without one.
    #[serde(default)]
    pub model_toml: String,
    /// The subject in use; empty if nobody with a name is.
    #[serde(default)]
    pub subject: String,
    /// What was found of the daemon before, and what of it is used or not, in words.
    #[serde(default)]
    pub remembered: Vec<String>,
    /// Number of the reload that brought `config_toml` and `model_toml`; 0 for the start.
    #[serde(default)]
    pub reload: u64,
    /// Where the page is, if it is served.
    pub page: Option<String>,
    /// Whether memory is locked, or why not.
    pub memory_lock: String,
    /// Where the model does not explain what is measured, now; nothing while it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model_suspicion: Option<String>,
    /// What each thread asked for and has, in words.
    pub threads: Vec<ThreadStatus>,
}

/// One thread's real-time settings.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ThreadStatus {
    /// Role.
    pub thread: String,
    /// SCHED_FIFO priority asked for; 0 for none.
    pub asked_fifo: u32,
    /// SCHED_FIFO priority granted.
    pub granted_fifo: u32,
    /// Cores it may run on.
    pub cpus: Vec<usize>,
}

impl From<&ThreadReport> for ThreadStatus {
    fn from(report: &ThreadReport) -> ThreadStatus {
        ThreadStatus {
            thread: report.thread.to_owned(),
            asked_fifo: report.asked.fifo_priority,
            granted_fifo: report.granted.fifo_priority,
            cpus: report.granted.cpus.clone(),
        }
    }
}

/// The file of a station's daemon; removed when it ends. Copies of it tell the same.
#[derive(Debug, Clone)]
pub struct StatusFile {
    /// Where.
    pub path: PathBuf,
    facts: Arc<Mutex<(Status, String)>>,
}

impl StatusFile {
    /// A file for these facts.
    pub fn new(status: Status) -> StatusFile {
        let text = serde_json::to_string_pretty(&status).unwrap_or_default();
        StatusFile { path: path_of(&status.station), facts: Arc::new(Mutex::new((status, text))) }
    }

    /// Says where the model does not explain what is measured; written with the next [`StatusFile::write`].
    pub fn suspect(&self, suspicion: Option<String>) {
        let same = self.facts.lock().unwrap_or_else(PoisonError::into_inner).0.model_suspicion == suspicion;
        if !same {
            self.change(|status| status.model_suspicion = suspicion);
        }
    }

    /// Says who is in use; written with the next [`StatusFile::write`].
    pub fn set_subject(&self, subject: &str) {
        let same = self.facts.lock().unwrap_or_else(PoisonError::into_inner).0.subject == subject;
        if !same {
            self.change(|status| subject.clone_into(&mut status.subject));
        }
    }

    /// Changes facts; written with the next [`StatusFile::write`].
    pub fn change(&self, change: impl FnOnce(&mut Status)) {
        let (status, text) = &mut *self.facts.lock().unwrap_or_else(PoisonError::into_inner);
        change(status);
        *text = serde_json::to_string_pretty(status).unwrap_or_default();
    }

    /// Writes it, if it is not there as it should be.
    ///
    /// # Errors
    /// What the system said.
    pub fn write(&self) -> std::io::Result<()> {
        // Held while writing: two threads do it, into one temporary file.
        let facts = self.facts.lock().unwrap_or_else(PoisonError::into_inner);
        if std::fs::read_to_string(&self.path).is_ok_and(|text| text == facts.1) {
            return Ok(());
        }
        write_whole(&self.path, facts.1.as_bytes())
    }

    /// Removes it.
    pub fn remove(&self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Reads the facts of a station's daemon; `None` if there are none.
pub fn read(station: &str) -> Option<Status> {
    let text = std::fs::read_to_string(path_of(station)).ok()?;
    serde_json::from_str(&text).ok()
}

/// The facts of all daemons on this bus, also of such as were killed.
pub fn all() -> Vec<Status> {
    let files = std::fs::read_dir(equipoise_bus::root::root_of_environment()).into_iter().flatten().flatten();
    let is_ours = |name: &str| name.starts_with("equipoise-") && name.ends_with(".json");
    files
        .filter(|file| is_ours(&file.file_name().to_string_lossy()))
        .filter_map(|file| serde_json::from_str(&std::fs::read_to_string(file.path()).ok()?).ok())
        .collect()
}

/// Beside the files of the bus, so that whoever finds the one finds the other.
fn path_of(station: &str) -> PathBuf {
    equipoise_bus::root::root_of_environment().join(format!("equipoise-{station}.json"))
}
