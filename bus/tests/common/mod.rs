//! A separate bus for each test, and child processes that can be killed.
#![allow(
    dead_code,
    clippy::allow_attributes,
    reason = "each test binary uses its own part, one uses all, so nothing can be expected"
)]

use equipoise_bus::root::shared_memory_prefix;
use equipoise_bus::{Bus, BusSettings};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Time-out of all waits in these tests, with a wide margin; not a measurement.
pub(crate) const PATIENCE: Duration = Duration::from_secs(90);
const CHILD_ROOT: &str = "EQUIPOISE_BUS_TEST_CHILD";

/// A root directory that removes the bus's shared memory when dropped.
pub(crate) struct Root {
    path: PathBuf,
    _directory: TempDir,
}

pub(crate) fn root() -> Root {
    let directory = tempfile::Builder::new().prefix("equipoise-bus-").tempdir().unwrap();
    Root { path: directory.path().to_owned(), _directory: directory }
}

/// A root whose path has `length` bytes.
pub(crate) fn root_of_length(length: usize) -> Root {
    let mut root = root();
    let fill = length - root.path.to_str().unwrap().len() - 1;
    root.path.push("x".repeat(fill));
    root
}

impl Root {
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Root {
    /// iceoryx2 leaves 16 bytes for each prefix, and a killed process leaves more.
    fn drop(&mut self) {
        let prefix = shared_memory_prefix(self.path());
        for file in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if file.file_name().to_string_lossy().starts_with(&prefix) {
                let _already_gone = std::fs::remove_file(file.path());
            }
        }
    }
}

pub(crate) fn join(root: &Path, role: &str) -> Bus {
    let settings = BusSettings { root: root.to_owned(), ..BusSettings::new("test", role) };
    Bus::join(&settings).unwrap()
}

/// Polls until `ready` returns true; panics at the time-out.
pub(crate) fn until(what: &str, mut ready: impl FnMut() -> bool) {
    let start = Instant::now();
    while !ready() {
        assert!(start.elapsed() < PATIENCE, "waited in vain until {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Runs the test `name` of this binary as a child process.
pub(crate) fn spawn_child(name: &str, root: &Path) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", name])
        .env(CHILD_ROOT, root)
        .stdout(Stdio::null())
        .spawn()
        .unwrap()
}

/// In a child, joins the parent's bus; `None` in an ordinary run of the tests.
pub(crate) fn parents_bus(role: &str) -> Option<Bus> {
    let root = std::env::var_os(CHILD_ROOT)?;
    Some(join(Path::new(&root), role))
}

/// Sends SIGKILL, so that nothing is cleaned up.
pub(crate) fn kill(mut child: Child) {
    child.kill().unwrap();
    child.wait().unwrap();
}
