//! Compiles C and C++ clients and runs them against a real bus.

use equipoise_bus::root::ROOT_VARIABLE;
use equipoise_core::message::ConsumerReceipt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::common::{PERIOD, Station, publish_until_killed, root, until};
use crate::compiler::{Link, compile, is_installed, stdout_of};

const HANGS_AFTER: Duration = Duration::from_secs(20);
const CONTROLLER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/controller.c");
const WRONG_USE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/programs/wrong_use.c");

const WRONG_USE_CPP: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/programs/wrong_use.cpp");

/// Not a test: body of the child process, until it is killed or a time-out passes.
#[test]
fn child_publishes() {
    publish_until_killed();
}

fn number(line: &str, key: &str) -> u64 {
    let value = line.split_whitespace().find_map(|pair| pair.strip_prefix(key)?.strip_prefix('='));
    value.unwrap_or_else(|| panic!("no {key} in: {line}")).parse().unwrap()
}

#[test]
fn invalid_calls_return_an_error_message() {
    for link in [Link::Static, Link::Shared] {
        let root = root();
        let scratch = tempfile::tempdir().unwrap();
        let program = compile(Path::new(WRONG_USE), link, scratch.path());
        let ended = Command::new(program).env(ROOT_VARIABLE, root.path()).output().unwrap();
        assert_eq!(stdout_of(&ended), "all refused\n");
    }
}

#[test]
fn the_header_for_cpp_does_not_hang_and_reports_a_leaked_consumer() {
    if !is_installed("cpp") {
        eprintln!("skipped: no compiler of C++ (CXX, or c++)");
        return;
    }
    let root = root();
    let scratch = tempfile::tempdir().unwrap();
    let program = compile(Path::new(WRONG_USE_CPP), Link::Shared, scratch.path());
    let mut command = Command::new(program);
    command.env(ROOT_VARIABLE, root.path()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let begun = Instant::now();
    // Would hang if the library took a negative time-out for a long one.
    while child.try_wait().unwrap().is_none() && begun.elapsed() < HANGS_AFTER {
        sleep(PERIOD);
    }
    let _ = child.kill();
    let ended = child.wait_with_output().unwrap();
    assert_eq!(stdout_of(&ended), "all refused\n");
    let stderr = String::from_utf8_lossy(&ended.stderr);
    assert!(stderr.contains("a consumer was not closed: a consumer belongs to the thread"), "{stderr}");
}

#[test]
fn the_controller_reads_a_station_and_reports() {
    let root = root();
    let bus = root.bus("latency");
    let mut reports = bus.subscriber::<ConsumerReceipt>(16).unwrap();
    let _station = Station::start(&root, "ffi::child_publishes");
    let scratch = tempfile::tempdir().unwrap();
    let program = compile(Path::new(CONTROLLER), Link::Shared, scratch.path());
    let mut command = Command::new(program);
    command.args(["test", "arm", "2.5"]).env(ROOT_VARIABLE, root.path());
    let mut controller = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // A subscriber connects to a publisher only when it reads, so reports are read while the publisher exists.
    let mut last: Option<ConsumerReceipt> = None;
    until("the controller ends", || {
        last = reports.latest().unwrap().or(last);
        sleep(PERIOD);
        controller.try_wait().unwrap()
    });
    let last = reports.latest().unwrap().or(last).expect("it reported");
    let printed = stdout_of(&controller.wait_with_output().unwrap());
    let lines: Vec<&str> = printed.lines().collect();
    let current = lines.iter().filter(|line| line.contains(" state=current ")).count();
    assert!(current > 0, "{printed}");
    let end = lines.last().unwrap();
    let (states, missed) = (number(end, "states"), number(end, "missed"));
    assert_eq!(&last.consumer[..4], b"arm\0");
    // The report also counts states that were missed before the first returned state.
    assert!(last.states >= states && last.states + last.states_missed >= states + missed, "{printed}");
    assert!(states > 0);
}
