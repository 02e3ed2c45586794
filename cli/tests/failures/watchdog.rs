//! The service manager's watchdog follows the loop, and nothing else.

use std::os::unix::net::UnixDatagram;

use rustix::fs::{CWD, FileType, Mode, mknodat};
use rustix::process::Signal;

use crate::process::{TIMEOUT, wait_for};
use crate::station::{NAME, Station};

/// A pipe without a reader where housekeeping writes the status: it blocks like a disk that does not answer.
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
    let pipe = status.with_extension("json.new");
    // The name is in use during a write.
    wait_for("the name of the next status", || {
        mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).ok()
    });
    let written = || std::fs::metadata(&status).and_then(|facts| facts.modified()).expect("the status");
    let before = written();
    // Housekeeping writes once a second, so these take longer than it can do without.
    for _ in 0..4 {
        while !received().contains("WATCHDOG=1") {}
    }
    assert_eq!(written(), before, "housekeeping is not blocked: {}", daemon.stderr());

    // The reader releases housekeeping, which must end with the daemon.
    let text = std::fs::read_to_string(&pipe).expect("the status");
    assert!(text.contains(NAME), "{text}");
    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
}
