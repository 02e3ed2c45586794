//! What a running daemon says of itself beside the bus: a small file that `equipoise status` and recorders read.

use std::path::{Path, PathBuf};

use equipoise_adapters::text_file::read_text;
use serde::{Deserialize, Serialize};

use crate::realtime::ThreadReport;
use crate::whole_file::write_whole;

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

/// The file of a station's daemon; removed when it ends.
#[derive(Debug, Clone)]
pub struct StatusFile {
    /// Where.
    pub path: PathBuf,
    status: Status,
    text: String,
}

impl StatusFile {
    /// A file for these facts.
    pub fn new(status: Status) -> StatusFile {
        let text = serde_json::to_string_pretty(&status).unwrap_or_default();
        StatusFile { path: path_of(&status.station), status, text }
    }

    /// Says where the model does not explain what is measured; written with the next [`StatusFile::write`].
    pub fn suspect(&mut self, suspicion: Option<String>) {
        if self.status.model_suspicion != suspicion {
            self.status.model_suspicion = suspicion;
            self.text = serde_json::to_string_pretty(&self.status).unwrap_or_default();
        }
    }

    /// Writes it, if it is not there as it should be.
    ///
    /// # Errors
    /// What the system said.
    pub fn write(&self) -> std::io::Result<()> {
        if std::fs::read_to_string(&self.path).is_ok_and(|text| text == self.text) {
            return Ok(());
        }
        write_whole(&self.path, self.text.as_bytes())
    }

    /// Removes it.
    pub fn remove(&self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Reads the facts of a station's daemon; `None` if there are none.
pub fn read(station: &str) -> Option<Status> {
    let text = read_text(&path_of(station), STATUS_BYTES_MAX).ok()?;
    serde_json::from_str(&text).ok()
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
