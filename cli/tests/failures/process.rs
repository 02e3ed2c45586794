//! Child processes that never outlive their test.

use std::fs::File;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

/// Time limit of every wait, on a machine whose cores and disk have much other load.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(90);

/// Polls until there is a result. A pause is as long as the probe before it, within limits: a probe that starts a
/// process would occupy a core.
pub(crate) fn wait_for<T>(what: &str, mut probe: impl FnMut() -> Option<T>) -> T {
    let started = Instant::now();
    loop {
        let probed = Instant::now();
        if let Some(found) = probe() {
            return found;
        }
        assert!(started.elapsed() < TIMEOUT, "waited in vain for {what}");
        std::thread::sleep(probed.elapsed().clamp(Duration::from_millis(10), Duration::from_millis(100)));
    }
}

/// A running `equipoise`; killed when dropped.
pub(crate) struct Process {
    child: Child,
    out: PathBuf,
    err: PathBuf,
}

impl Process {
    /// Starts a command whose output goes to `out` and `err`: no full pipe can block it.
    pub(crate) fn start(mut command: Command, out: PathBuf, err: PathBuf) -> Process {
        let file = |path: &PathBuf| File::create(path).expect("a file for the output");
        command.stdin(Stdio::null()).stdout(file(&out)).stderr(file(&err));
        Process { child: command.spawn().expect("the binary starts"), out, err }
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    pub(crate) fn stdout(&self) -> String {
        std::fs::read_to_string(&self.out).expect("standard output")
    }

    /// Its log and error output so far.
    pub(crate) fn stderr(&self) -> String {
        std::fs::read_to_string(&self.err).expect("standard error")
    }

    pub(crate) fn send(&self, signal: Signal) {
        let id = Pid::from_child(&self.child);
        kill_process(id, signal).expect("a process to signal");
    }

    pub(crate) fn is_running(&mut self) -> bool {
        self.child.try_wait().expect("a child").is_none()
    }

    /// Waits until it has ended by itself.
    pub(crate) fn wait(&mut self) -> ExitStatus {
        let err = self.err.clone();
        let started = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("a child") {
                return status;
            }
            let message = || std::fs::read_to_string(&err).unwrap_or_default();
            assert!(started.elapsed() < TIMEOUT, "it does not end; it says: {}", message());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Ends it with a signal, as a user or systemd would, and returns its exit code.
    pub(crate) fn stop(&mut self, signal: Signal) -> Option<i32> {
        self.send(signal);
        self.wait().code()
    }

    /// `kill -9`.
    pub(crate) fn kill(&mut self) {
        self.child.kill().expect("a process to kill");
        self.child.wait().expect("a killed process");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
        if std::thread::panicking() {
            eprintln!("--- process {} said:\n{}{}---", self.id(), self.stdout(), self.stderr());
        }
    }
}
