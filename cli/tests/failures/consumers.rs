//! Consumers that die or stop reading.

use std::time::Duration;

use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::Station;

#[test]
fn the_loop_is_unaffected_by_consumers_that_end_or_stop_reading() {
    let station = Station::new();
    let _person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until("both sensors", Monitor::both_fresh);

    for _ in 0..3 {
        let mut watch = station.spawn(&["watch"]);
        let mut latency = station.spawn(&["latency", "--for", "600"]);
        wait_for("a line of the watch", || (!watch.stdout().is_empty()).then_some(()));
        assert!(latency.is_running(), "{}", latency.stderr());
        let before = monitor.update().cycle;
        watch.kill();
        latency.kill();
        monitor.until("cycles after the killing", |monitor| monitor.state.cycle > before + 100);
    }

    let mut stopped = station.spawn(&["watch"]);
    let mut reader = station.spawn(&["latency", "--for", "600"]);
    wait_for("a line of the watch", || (!stopped.stdout().is_empty()).then_some(()));
    // Stopped any earlier it could not end regularly.
    wait_for("the reader on the bus", || monitor.has_participant("latency").then_some(()));
    stopped.send(Signal::STOP);
    reader.send(Signal::STOP);
    // Longer than any buffer: a publisher that waited for its readers would be blocked now.
    let before = monitor.update().cycle;
    monitor.until("cycles while consumers are stopped", |monitor| monitor.state.cycle > before + 1500);
    monitor.until("both sensors", Monitor::both_fresh);

    // New consumers find a place, and the stopped ones resume with a daemon that has kept theirs.
    station.run(&["watch", "--for", "1"]).assert_done();
    assert_latency_is_measured(&station);
    stopped.send(Signal::CONT);
    reader.send(Signal::CONT);
    let lines = stopped.stdout().lines().count();
    wait_for("the woken watch to go on", || (stopped.stdout().lines().count() > lines + 1).then_some(()));
    assert_eq!(stopped.stop(Signal::TERM), Some(0), "{}", stopped.stderr());
    // If it has lost cycles it reports it; it may also have been stopped before its first.
    let code = reader.stop(Signal::TERM);
    assert!(matches!(code, Some(0 | 3)), "{code:?} {}", reader.stderr());

    assert!(daemon.is_running());
    assert!(!daemon.stderr().contains("panicked"), "{}", daemon.stderr());
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}

#[test]
fn consumers_killed_while_joining_or_leaving_are_removed_once() {
    let station = Station::new();
    let mut daemon = station.daemon(&station.configuration());
    for milliseconds in (2..80).step_by(3) {
        let mut consumer = station.spawn(&["latency", "--for", "600"]);
        std::thread::sleep(Duration::from_millis(milliseconds));
        consumer.kill();
    }
    // Processes that are not really gone would be cleared away again every second.
    let cleared = || daemon.stderr().matches("cleared away").count();
    wait_for("an end of the clearing", || {
        let before = cleared();
        std::thread::sleep(Duration::from_millis(2500));
        (cleared() == before).then_some(())
    });
    assert_latency_is_measured(&station);
    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
}

#[test]
fn a_closed_pipe_is_no_crash() {
    use std::io::Read;
    use std::process::{Command, Stdio};

    let station = Station::new();
    let _person = station.person();
    let _daemon = station.daemon(&station.configuration());
    // As in `equipoise watch | head -n 1`.
    let mut child = Command::new(env!("CARGO_BIN_EXE_equipoise"))
        .args(["watch", "--for", "20", "--station", crate::station::NAME])
        .env("EQUIPOISE_BUS_ROOT", station.root())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary starts");
    let mut first = [0; 1];
    child.stdout.take().expect("a pipe").read_exact(&mut first).expect("a first byte");
    let mut message = String::new();
    child.stderr.take().expect("a pipe").read_to_string(&mut message).expect("its end");
    let status = child.wait().expect("its end");
    assert!(!message.contains("panicked"), "{status}: {message}");
}

/// A busy machine loses cycles: exit code 3.
#[track_caller]
fn assert_latency_is_measured(station: &Station) {
    let latency = station.run(&["latency", "--for", "3"]);
    assert!(matches!(latency.code, Some(0 | 3)), "{}", latency.stderr);
    assert!(latency.stdout.contains("cycles"), "{}", latency.stdout);
}
