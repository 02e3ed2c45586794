//! Other processes: this program in another role, and a bus that only they share.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdout, Command, ExitCode, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use equipoise_bus::root::{ROOT_VARIABLE, shared_memory_prefix};

const PEER: &str = "--peer";

/// Another process of this program.
#[derive(Debug)]
pub struct Peer {
    child: Child,
    out: BufReader<ChildStdout>,
}

impl Peer {
    /// Starts one with a role and its arguments, and waits until it reports that it is ready; returns the rest of that
    /// line.
    pub fn start(role: &str, arguments: &[String]) -> (Peer, String) {
        let program = std::env::current_exe().expect("this program has a path");
        let mut child = Command::new(program)
            .arg(PEER)
            .arg(role)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("another process can be started");
        let mut out = BufReader::new(child.stdout.take().expect("its output is piped"));
        let mut line = String::new();
        out.read_line(&mut line).expect("its output can be read");
        let Some(said) = line.strip_prefix("ready") else { panic!("{role} did not start: '{line}'") };
        (Peer { child, out }, said.trim().to_owned())
    }

    /// Its process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Sends it a line.
    pub fn tell(&mut self, line: &str) {
        let input = self.child.stdin.as_mut().expect("its input is piped");
        writeln!(input, "{line}").expect("it reads");
    }

    /// Requests its end and reads its remaining output.
    pub fn finish(mut self) -> Vec<u8> {
        drop(self.child.stdin.take());
        let mut last = Vec::new();
        self.out.read_to_end(&mut last).expect("its output can be read");
        let status = self.child.wait().expect("it is our child");
        assert!(status.success(), "the other process failed: {status}");
        last
    }
}

impl Drop for Peer {
    /// A failed benchmark leaves no process behind.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The role and the arguments of a process that [`Peer::start`] started.
pub fn role() -> Option<(String, Vec<String>)> {
    let mut arguments = std::env::args().skip(1);
    (arguments.next()? == PEER).then(|| (arguments.next().unwrap_or_default(), arguments.collect()))
}

/// Reports that this peer is ready, with further text on the same line.
pub fn ready(more: &str) {
    println!("ready {more}");
    std::io::stdout().flush().expect("the parent process reads");
}

/// Becomes true when the parent process requests the end, or has died.
pub fn asked_to_end() -> Arc<AtomicBool> {
    let ends = Arc::new(AtomicBool::new(false));
    let ending = Arc::clone(&ends);
    std::thread::spawn(move || {
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        ending.store(true, Ordering::Relaxed);
    });
    ends
}

/// Runs `body` in a process with its own bus, which is removed afterwards.
pub fn on_an_own_bus(body: impl FnOnce()) -> ExitCode {
    if std::env::var_os(ROOT_VARIABLE).is_some() {
        body();
        return ExitCode::SUCCESS;
    }
    let root = tempfile::Builder::new().prefix("eqp-bench-").tempdir().expect("a folder for the bus");
    let program = std::env::current_exe().expect("this program has a path");
    let status =
        Command::new(program).args(std::env::args_os().skip(1)).env(ROOT_VARIABLE, root.path()).status();
    // iceoryx2 leaves 16 bytes behind for each root, and killed processes leave more.
    let prefix = shared_memory_prefix(root.path());
    for file in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
        if file.file_name().to_string_lossy().starts_with(&prefix) {
            let _already_gone = std::fs::remove_file(file.path());
        }
    }
    match status {
        Ok(status) if status.success() => ExitCode::SUCCESS,
        _ => ExitCode::FAILURE,
    }
}
