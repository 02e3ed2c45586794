//! What a running daemon says of itself beside the bus: a small file that `equipoise status` and recorders read.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use equipoise_adapters::text_file::read_text;
use serde::{Deserialize, Serialize};

use crate::roster::{FaultWatch, MemoryUse, Roster};
use crate::whole_file::write_whole;

pub use crate::roster::ThreadStatus;

/// The longest of these files, bytes: a configuration and a model, written as JSON.
const STATUS_BYTES_MAX: u64 = 8 << 20;

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

/// The file of a station's daemon; removed when it ends. Copies of it tell the same.
#[derive(Debug, Clone)]
pub struct StatusFile {
    /// Where.
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

    /// Says where the model does not explain what is measured; written with the next [`StatusFile::write`].
    pub fn suspect(&self, suspicion: Option<String>) {
        self.change(|status| status.model_suspicion = suspicion);
    }

    /// Says who is in use; written with the next [`StatusFile::write`].
    pub fn set_subject(&self, subject: &str) {
        self.change(|status| subject.clone_into(&mut status.subject));
    }

    /// Says which incidents go on; written with the next [`StatusFile::write`].
    pub fn tell_incidents(&self, incidents: BTreeMap<String, String>) {
        self.change(|status| status.incidents = incidents);
    }

    /// Reads how every thread and the memory fare while the loop is at `cycle`; to be asked about once a second.
    pub fn note_threads(&self, roster: &Roster, cycle: u64) {
        let Facts { status, faults } = &mut *self.facts();
        status.threads = roster.threads();
        status.memory = MemoryUse::now();
        status.loop_faults = faults.look(cycle, &status.threads);
    }

    /// Minor and major page faults of the loop since its warm-up; `None` before it is over. A steady loop has none.
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

    /// Writes it whole. It is old in a second and dies with the daemon: nobody waits for a disk because of it.
    ///
    /// # Errors
    /// What the system said.
    pub fn write(&self) -> std::io::Result<()> {
        // Held while writing: two threads do it, into one temporary file.
        let facts = self.facts();
        let text = serde_json::to_string_pretty(&facts.status)?;
        let new = self.path.with_extension("json.new");
        std::fs::write(&new, text)?;
        std::fs::rename(&new, &self.path)
    }

    /// Removes it.
    pub fn remove(&self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Removes the file of a station whose daemon did not get far enough to do it.
pub fn remove(station: &str) {
    let _ = std::fs::remove_file(path_of(station));
}

/// Reads the facts of a station's daemon; `None` if there are none.
pub fn read(station: &str) -> Option<Status> {
    let text = read_text(&path_of(station), STATUS_BYTES_MAX).ok()?;
    serde_json::from_str(&text).ok()
}

/// The facts of all daemons on this bus, also of such as were killed.
pub fn all() -> Vec<Status> {
    let files = std::fs::read_dir(equipoise_bus::root::root_of_environment()).into_iter().flatten().flatten();
    let is_ours = |name: &str| name.starts_with("equipoise-") && name.ends_with(".json");
    files
        .filter(|file| is_ours(&file.file_name().to_string_lossy()))
        .filter_map(|file| serde_json::from_str(&read_text(&file.path(), STATUS_BYTES_MAX).ok()?).ok())
        .collect()
}

/// Where a station's page is, told by the process that serves it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PageStatus {
    /// Process that serves it.
    pub process_id: u32,
    /// What to type into a browser.
    pub url: String,
    /// Whether it asks for a token; which, nobody is told.
    pub needs_token: bool,
}

/// The file of a station's page; removed when it ends. After a crash it stays: who reads it asks the bus whether the
/// process is still there.
#[derive(Debug, Clone)]
pub struct PageFile {
    /// Where.
    pub path: PathBuf,
    status: PageStatus,
}

impl PageFile {
    /// A file for the page of this process.
    pub fn new(station: &str, url: String, needs_token: bool) -> PageFile {
        let status = PageStatus { process_id: std::process::id(), url, needs_token };
        PageFile { path: page_path_of(station), status }
    }

    /// Writes it.
    ///
    /// # Errors
    /// What the system said.
    pub fn write(&self) -> std::io::Result<()> {
        write_whole(&self.path, serde_json::to_string(&self.status).unwrap_or_default().as_bytes())
    }

    /// Removes it, unless another page has taken its place.
    pub fn remove(&self) {
        if read_page_file(&self.path).as_ref() == Some(&self.status) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Where a station's page is said to be; `None` if nobody said so.
pub fn read_page(station: &str) -> Option<PageStatus> {
    read_page_file(&page_path_of(station))
}

fn read_page_file(path: &Path) -> Option<PageStatus> {
    serde_json::from_str(&read_text(path, STATUS_BYTES_MAX).ok()?).ok()
}

fn page_path_of(station: &str) -> PathBuf {
    equipoise_bus::root::root_of_environment().join(format!("equipoise-{station}.page.json"))
}

/// Beside the files of the bus, so that whoever finds the one finds the other.
fn path_of(station: &str) -> PathBuf {
    equipoise_bus::root::root_of_environment().join(format!("equipoise-{station}.json"))
}
