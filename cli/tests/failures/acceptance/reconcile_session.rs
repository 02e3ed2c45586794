//! `reconcile --session` evaluates a recording while it is written, and writes the results at its end.

use std::fs::{File, read_to_string};
use std::io::Write;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use serde_json::Value;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::{NAME, Station};

/// An evaluation needs 10 s of work in which enough can be used; a busy machine loses samples.
const POSES_MAX: usize = 60;
const HOLD: Duration = Duration::from_secs(3);

/// Number of evaluations that had too little data.
fn refusals(err: &Path) -> usize {
    read_to_string(err).expect("text").matches("not yet: ").count()
}

#[test]
fn a_session_is_evaluated_while_it_is_recorded() {
    let station = Station::new();
    let person = station.person();
    let _daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until("both sensors", Monitor::both_fresh);
    let folder = station.state_directory().join("found");
    let (out, err) = (station.file("session.out"), station.file("session.err"));
    let mut command = station.command(&["reconcile", "--session", "--json", "--station", NAME, "--out"]);
    command.arg(&folder).stdin(Stdio::piped());
    let mut session = command
        .stdout(File::create(&out).expect("a file"))
        .stderr(File::create(&err).expect("a file"))
        .spawn()
        .expect("it starts");
    let mut keys = session.stdin.take().expect("piped");
    let said =
        |text: &str| wait_for(text, || read_to_string(&err).expect("text").contains(text).then_some(()));
    said("recording station");
    writeln!(keys).expect("Enter");
    said("not yet: ");

    monitor.until_poses(&person, 6);
    station.run(&["identify", "stop"]).assert_done();
    // One line for each evaluation that had enough data.
    let findings = || -> Vec<Value> {
        let lines = read_to_string(&out).expect("text");
        lines.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect()
    };
    let evaluations = || read_to_string(&err).expect("text").matches("Enter").count() + refusals(&err);
    for pose in 0..POSES_MAX {
        person.take_pose(pose % 8).expect("a pose of the library");
        std::thread::sleep(HOLD);
        let before = evaluations();
        writeln!(keys).expect("Enter");
        // A decided finding ends the session.
        wait_for("an evaluation", || (evaluations() > before || !findings().is_empty()).then_some(()));
        if !findings().is_empty() {
            break;
        }
    }
    assert!(!findings().is_empty(), "{}", read_to_string(&err).expect("text"));
    drop(keys);
    let ended = wait_for("its end", || session.try_wait().expect("a child"));
    assert_eq!(ended.code(), Some(0), "{}", read_to_string(&err).expect("text"));
    let findings = findings();
    assert_eq!(findings.len(), 2);
    for finding in &findings {
        assert!(finding["gap"]["before_mm"].as_f64().is_some_and(|gap_mm| gap_mm < 20.0), "{finding}");
    }
    assert!(folder.join("session.mcap").exists() && folder.join("report.html").exists());
}
