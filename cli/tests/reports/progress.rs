//! Progress bars: on a terminal only, and never in the results.

use std::fmt::Write as _;
use std::fs::File;
use std::io::Read;
use std::os::fd::OwnedFd;
use std::process::{Command, Stdio};

use equipoise_core::body::Segment;
use rustix::fs::{Mode, OFlags, open};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};

use crate::session::{equipoise, session, text};

/// A terminal of 80 columns: its far end, which receives the output, and its near end for a program.
fn terminal() -> (File, OwnedFd) {
    let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&far).and_then(|()| unlockpt(&far)).unwrap();
    let name = ptsname(&far, Vec::new()).unwrap();
    let near = open(name, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty()).unwrap();
    let size = Winsize { ws_row: 24, ws_col: 80, ws_xpixel: 0, ws_ypixel: 0 };
    tcsetwinsize(&near, size).unwrap();
    (File::from(far), near)
}

/// Standard output of a command, and what a terminal at its standard error received.
fn on_terminal(arguments: &[&str]) -> (String, String) {
    let (mut far, near) = terminal();
    let mut command = Command::new(env!("CARGO_BIN_EXE_equipoise"));
    command.args(arguments).env("TERM", "xterm-256color").stdout(Stdio::piped()).stderr(near);
    let child = command.spawn().unwrap();
    // Otherwise this process keeps the terminal's near end open, and reading never ends.
    drop(command);
    let reader = std::thread::spawn(move || {
        let (mut received, mut bytes) = (Vec::new(), [0; 4096]);
        while let Ok(count @ 1..) = far.read(&mut bytes) {
            received.extend_from_slice(&bytes[..count]);
        }
        String::from_utf8_lossy(&received).into_owned()
    });
    let output = child.wait_with_output().unwrap();
    (String::from_utf8_lossy(&output.stdout).into_owned(), reader.join().unwrap())
}

/// A second of a person at rest, as a CSV.
fn capture() -> String {
    let mut rows = "t_s".to_owned();
    for segment in Segment::ALL {
        let name = segment.name();
        for column in ["px_m", "py_m", "pz_m", "qw", "qx", "qy", "qz"] {
            write!(rows, ",{name}_{column}").unwrap();
        }
    }
    rows += ",Fx_N,Fy_N,Fz_N,Mx_Nm,My_Nm,Mz_Nm\n";
    for row in 0..60 {
        let pose = ",0,0,1,1,0,0,0".repeat(Segment::ALL.len());
        writeln!(rows, "{}{pose},0,0,700,0,0,0", f64::from(row) / 60.0).unwrap();
    }
    rows
}

#[test]
fn long_commands_show_a_bar_on_a_terminal_only() {
    let session = session();
    let capture_file = session.file("capture.csv");
    std::fs::write(&capture_file, capture()).unwrap();
    let (samples, states) = (text(&session.samples), text(&session.states));
    let file = |name: &str| text(&session.file(name)).to_owned();
    let (imported, table, computed, page) =
        (file("imported.mcap"), file("bar.csv"), file("computed.csv"), file("bar.html"));
    for (arguments, doing) in [
        (&["replay", samples][..], "replaying"),
        // Ends after the first pass, since the span is not in the recording.
        (&["reconcile", samples, "--work", "900:901"], "reading the recording"),
        (&["import", text(&capture_file), "--out", &imported], "importing"),
        (&["export", states, "--out", &table], "writing"),
        (&["export", samples, "--out", &computed], "computing states by a replay"),
        (&["report", states, "--out", &page], "reading the recording"),
    ] {
        let (_, shown) = on_terminal(arguments);
        assert!(shown.contains(doing) && shown.contains(" % "), "{arguments:?}: {shown:?}");
        // Removed at the end: the last line was erased.
        assert!(!shown.ends_with('%') && shown.contains("\u{1b}[2K"), "{arguments:?}: {shown:?}");
        let _absent = std::fs::remove_file(&imported);
        let piped = equipoise(arguments);
        let [stdout, stderr] = [piped.stdout, piped.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        assert!(!stderr.contains(doing) && !stderr.contains('\u{1b}'), "{arguments:?}: {stderr:?}");
        assert!(!stdout.contains('\u{1b}'), "{arguments:?}: {stdout:?}");
    }
    let (lines, shown) = on_terminal(&["replay", samples, "--out", "-"]);
    assert!(lines.lines().all(|line| line.starts_with('{')), "only results");
    assert!(!shown.contains("replaying"), "{shown:?}");
}
