//! The service manager's watchdog follows the loop, and nothing else.

use std::os::unix::net::UnixDatagram;

use nix::sys::ptrace;
use nix::sys::wait::{WaitPidFlag, waitpid};
use nix::unistd::Pid;
use rustix::process::Signal;

use crate::process::{TIMEOUT, wait_for};
use crate::station::{NAME, Station};

/// Housekeeping alone is stopped, as by a disk that does not answer.
#[test]
fn notifications_continue_while_housekeeping_is_blocked() {
    let station = Station::new();
    let socket = station.file("notify");
    let notified = UnixDatagram::bind(&socket).expect("a socket");
    notified.set_read_timeout(Some(TIMEOUT)).expect("a timeout");
    let received = || {
        let mut bytes = [0; 4096];
        let length = notified.recv(&mut bytes).expect("a notification of the daemon");
        String::from_utf8_lossy(&bytes[..length]).into_owned()
    };
    station.write("watched.toml", &station.configuration());
    let mut daemon = station.daemon_of("watched.toml", &[("NOTIFY_SOCKET", socket.as_os_str())]);
    let status = station.root().join(format!("equipoise-{NAME}.json"));
    let housekeeping = wait_for("the thread", || thread_of(daemon.id(), "housekeeping"));
    ptrace::seize(housekeeping, ptrace::Options::empty()).expect("a thread of a child");
    ptrace::interrupt(housekeeping).expect("a running thread");
    waitpid(housekeeping, Some(WaitPidFlag::__WALL)).expect("a stopped thread");
    let written = || std::fs::metadata(&status).and_then(|facts| facts.modified()).expect("the status");
    let before = written();
    // Housekeeping writes once a second, so these take longer than it can do without.
    for _ in 0..4 {
        while !received().contains("WATCHDOG=1") {}
    }
    assert_eq!(written(), before, "housekeeping is not blocked: {}", daemon.stderr());

    // It must end with the daemon.
    ptrace::detach(housekeeping, None).expect("a stopped thread");
    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
}

/// The thread of a process with this name.
fn thread_of(process_id: u32, name: &str) -> Option<Pid> {
    std::fs::read_dir(format!("/proc/{process_id}/task")).ok()?.flatten().find_map(|thread| {
        let comm = std::fs::read_to_string(thread.path().join("comm")).ok()?;
        (comm.trim() == name).then(|| thread.file_name().to_str()?.parse().ok().map(Pid::from_raw)).flatten()
    })
}
