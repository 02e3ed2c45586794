//! Status of a running daemon outside the bus: a small file that `equipoise status` and recorders read.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::Context;
use equipoise_files::atomic_file::write_atomically;
use equipoise_files::read_text;
use serde::{Deserialize, Serialize};

use crate::proc::MemoryUse;

/// The longest of these files, bytes: a configuration and a model, written as JSON.
const STATUS_BYTES_MAX: u64 = 8 << 20;
/// Suffix of a page's file in the same directory.
const PAGE_ENDING: &str = ".page.json";

/// The facts of one daemon.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Status {
    /// Version of the program.
    pub version: String,
    /// Process id.
    pub process_id: u32,
    /// Start of the daemon, CLOCK_MONOTONIC; 0 if its version does not publish it.
    #[serde(default)]
    pub started_ns: u64,
    /// Station.
    pub station: String,
    /// The complete configuration, defaults included.
    pub config_toml: String,
    /// The model in use in addition to the body; empty without one.
    #[serde(default)]
    pub model_toml: String,
    /// Numbers of the similar subject in the prior, without its name; empty without one.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub similar_toml: String,
    /// State directory of the daemon; empty if its version does not publish it.
    #[serde(default)]
    pub state_directory: PathBuf,
    /// The subject in use; empty if it is unnamed.
    #[serde(default)]
    pub subject: String,
    /// Messages on stored data of earlier runs: what is restored, and what is not.
    #[serde(default)]
    pub restored: Vec<String>,
    /// Number of the reload that set `config_toml`, `model_toml` and `similar_toml`; 0 for the start.
    #[serde(default)]
    pub reload: u64,
    /// Whether memory is locked, or the reason that it is not.
    pub memory_lock: String,
    /// Total and locked memory, as read back.
    #[serde(default)]
    pub memory: MemoryUse,
    /// Minor and major page faults of the loop since its warm-up; `None` before its end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loop_faults: Option<[u64; 2]>,
    /// Current discrepancy between model and measurement; `None` without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model_mismatch: Option<String>,
    /// Why the weighing of the subject does not progress; `None` while it does, and with a mass.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weighing: Option<String>,
    /// Active incidents: the daemon's message by name.
    #[serde(default)]
    pub incidents: BTreeMap<String, String>,
    /// Requested and granted scheduling of each thread, and its page faults and preemptions.
    pub threads: Vec<ThreadStatus>,
}

impl Status {
    /// Distinguishes daemons: in a container each has the same process id.
    pub fn instance(&self) -> (u32, u64) {
        (self.process_id, self.started_ns)
    }
}

/// Requested and granted scheduling of one thread, its page faults and preemptions.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ThreadStatus {
    /// Role; for a thread without a request, its name in the kernel.
    pub thread: String,
    /// Thread id.
    #[serde(default)]
    pub id: i32,
    /// Whether the thread requested scheduling.
    #[serde(default)]
    pub has_asked: bool,
    /// Requested SCHED_FIFO priority; 0 for none.
    pub asked_fifo: u32,
    /// Requested core.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked_cpu: Option<usize>,
    /// Name of the current scheduling policy.
    #[serde(default)]
    pub policy: String,
    /// Current SCHED_FIFO priority.
    pub granted_fifo: u32,
    /// Cores on which it may run.
    pub cpus: Vec<usize>,
    /// Timer slack, read back, ns; `None` for a thread without a request.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timer_slack_ns: Option<u64>,
    /// Page faults that needed no disk, since its start.
    #[serde(default)]
    pub minor_faults: u64,
    /// Page faults that waited for a disk, since its start.
    #[serde(default)]
    pub major_faults: u64,
    /// Number of preemptions since its start.
    #[serde(default)]
    pub involuntary_switches: u64,
}

/// Removes the file of a daemon that failed to start.
pub fn remove(station: &str) {
    let _ = std::fs::remove_file(path_of(station));
}

/// Reads the facts of a station's daemon; `None` if there are none.
pub fn read(station: &str) -> Option<Status> {
    let text = read_text(&path_of(station), STATUS_BYTES_MAX).ok()?;
    serde_json::from_str(&text).ok()
}

/// The facts of all daemons on this bus, including killed ones.
///
/// # Errors
/// One of the files cannot be parsed, for instance because it is another version's: the list of daemons would be
/// incomplete.
pub fn all() -> anyhow::Result<Vec<Status>> {
    all_in(&equipoise_bus::root::root_of_environment())
}

fn all_in(root: &Path) -> anyhow::Result<Vec<Status>> {
    let files = match std::fs::read_dir(root) {
        Ok(files) => files,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error).with_context(|| format!("cannot read {}", root.display())),
    };
    // Station names contain no dot; names with a dot are files of a page or an adapter.
    let is_ours = |name: &str| {
        let station = name.strip_prefix("equipoise-").and_then(|name| name.strip_suffix(".json"));
        station.is_some_and(|station| !station.contains('.'))
    };
    let mut all = Vec::new();
    for file in files {
        let path = file.with_context(|| format!("cannot read {}", root.display()))?.path();
        if !path.file_name().is_some_and(|name| is_ours(&name.to_string_lossy())) {
            continue;
        }
        let unreadable = || {
            format!(
                "{} is no status that this version understands; stop its daemon, or remove the file if that does not \
                 run any more",
                path.display()
            )
        };
        match read_text(&path, STATUS_BYTES_MAX) {
            Ok(text) => all.push(serde_json::from_str(&text).with_context(unreadable)?),
            // The daemon has just ended.
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(error).with_context(unreadable),
        }
    }
    Ok(all)
}

/// Address of a station's page, published by the process that serves it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PageStatus {
    /// Process that serves the page.
    pub process_id: u32,
    /// Address for a browser.
    pub url: String,
    /// Whether it requires a token; the token itself is not published.
    pub needs_token: bool,
}

/// The file of a station's page; removed at its end. It remains after a crash, so readers check on the bus whether the
/// process still runs.
#[derive(Debug, Clone)]
pub struct PageFile {
    /// Path of the file.
    pub path: PathBuf,
    status: PageStatus,
}

impl PageFile {
    /// A file for the page of this process.
    pub fn new(station: &str, url: String, needs_token: bool) -> PageFile {
        let status = PageStatus { process_id: std::process::id(), url, needs_token };
        PageFile { path: page_path_of(station), status }
    }

    /// Writes the file.
    ///
    /// # Errors
    /// The system's error.
    pub fn write(&self) -> std::io::Result<()> {
        write_atomically(&self.path, serde_json::to_string(&self.status)?.as_bytes())
    }

    /// Removes the file, unless it is that of another page.
    pub fn remove(&self) {
        if read_page_file(&self.path).as_ref() == Some(&self.status) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Published address of a station's page; `None` if there is none.
pub fn read_page(station: &str) -> Option<PageStatus> {
    read_page_file(&page_path_of(station))
}

fn read_page_file(path: &Path) -> Option<PageStatus> {
    serde_json::from_str(&read_text(path, STATUS_BYTES_MAX).ok()?).ok()
}

fn page_path_of(station: &str) -> PathBuf {
    equipoise_bus::root::root_of_environment().join(format!("equipoise-{station}{PAGE_ENDING}"))
}

/// Path of the file, next to the files of the bus, so that both are found together.
pub fn path_of(station: &str) -> PathBuf {
    equipoise_bus::root::root_of_environment().join(format!("equipoise-{station}.json"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unreadable_status_is_reported_and_a_page_status_is_ignored() {
        let root = tempfile::tempdir().unwrap();
        assert!(all_in(&root.path().join("nothing")).unwrap().is_empty());
        for passed_over in
            ["equipoise-a.page.json", "equipoise-a.suit.json", "equipoise-a.json.new", "other.json"]
        {
            std::fs::write(root.path().join(passed_over), "{").unwrap();
        }
        assert!(all_in(root.path()).unwrap().is_empty());
        for content in ["{", "{\"version\": \"99\"}", "{}"] {
            std::fs::write(root.path().join("equipoise-b.json"), content).unwrap();
            let message = format!("{:#}", all_in(root.path()).unwrap_err());
            assert!(message.contains("equipoise-b.json") && message.contains("stop its daemon"), "{message}");
        }
        let file = std::fs::File::create(root.path().join("equipoise-b.json")).unwrap();
        file.set_len(STATUS_BYTES_MAX + 1).unwrap();
        assert!(all_in(root.path()).is_err(), "too long");
    }
}
