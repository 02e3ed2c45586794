//! What a running daemon says of itself beside the bus: a small file that `equipoise status` and recorders read.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::roster::{FaultWatch, MemoryUse, Roster};

pub use crate::roster::ThreadStatus;

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
    /// Where the page is, if it is served.
    pub page: Option<String>,
    /// Whether memory is locked, or why not.
    pub memory_lock: String,
    /// How much memory there is, and how much of it is locked, as read back.
    #[serde(default)]
    pub memory: MemoryUse,
    /// Minor and major page faults of the loop since its warm-up; nothing before it is over.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loop_faults: Option<[u64; 2]>,
    /// Where the model does not explain what is measured, now; nothing while it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model_suspicion: Option<String>,
    /// What goes wrong now: the daemon's own sentence on each incident, by name.
    #[serde(default)]
    pub incidents: BTreeMap<String, String>,
    /// What each thread asked for, has, and suffered.
    pub threads: Vec<ThreadStatus>,
}

/// The file of a station's daemon; removed when it ends.
#[derive(Debug, Clone)]
pub struct StatusFile {
    /// Where.
    pub path: PathBuf,
    status: Status,
    faults: FaultWatch,
}

impl StatusFile {
    /// A file for these facts.
    pub fn new(status: Status) -> StatusFile {
        StatusFile { path: path_of(&status.station), status, faults: FaultWatch::default() }
    }

    /// Says where the model does not explain what is measured; written with the next [`StatusFile::write`].
    pub fn suspect(&mut self, suspicion: Option<String>) {
        self.status.model_suspicion = suspicion;
    }

    /// Reads how every thread and the memory fare while the loop is at `cycle`; to be asked about once a second.
    pub fn note_threads(&mut self, roster: &Roster, cycle: u64) {
        self.status.threads = roster.threads();
        self.status.memory = MemoryUse::now();
        self.status.loop_faults = self.faults.look(cycle, &self.status.threads);
    }

    /// Minor and major page faults of the loop since its warm-up; `None` before it is over. A steady loop has none.
    pub fn loop_faults(&self) -> Option<[u64; 2]> {
        self.status.loop_faults
    }

    /// Says which incidents go on; written with the next [`StatusFile::write`].
    pub fn tell_incidents(&mut self, incidents: BTreeMap<String, String>) {
        self.status.incidents = incidents;
    }

    /// Writes it whole. It is old in a second and dies with the daemon: nobody waits for a disk because of it.
    ///
    /// # Errors
    /// What the system said.
    pub fn write(&self) -> std::io::Result<()> {
        let text = serde_json::to_string_pretty(&self.status)?;
        let new = self.path.with_extension("json.new");
        std::fs::write(&new, text)?;
        std::fs::rename(&new, &self.path)
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

/// Beside the files of the bus, so that whoever finds the one finds the other.
fn path_of(station: &str) -> PathBuf {
    equipoise_bus::root::root_of_environment().join(format!("equipoise-{station}.json"))
}
