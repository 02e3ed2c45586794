//! Real missed deadlines, their records, and unwritable disks.

use std::path::PathBuf;
use std::time::Duration;

use equipoise_adapters::recording::{Entry, Recording};
use equipoise_bus::{Bus, BusSettings};
use equipoise_core::message::{CycleRecord, Incident, Incidents};
use rustix::process::Signal;
use serde_json::Value;

use crate::monitor::Monitor;
use crate::process::{Process, wait_for};
use crate::station::{NAME, Station};

/// Duration for which the daemon is stopped.
const STALL: Duration = Duration::from_millis(300);
/// A wake-up this late can only be caused by the stop.
const LATE_NS: u64 = 200_000_000;

fn stall(daemon: &Process) {
    daemon.send(Signal::STOP);
    std::thread::sleep(STALL);
    daemon.send(Signal::CONT);
}

fn is_late(record: &CycleRecord) -> bool {
    record.woken_ns - record.due_ns > LATE_NS
}

fn flights(station: &Station) -> Vec<PathBuf> {
    let directory = station.state_directory().join("flight");
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
    entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|end| end == "mcap"))
        .collect()
}

fn cycles_of(path: &PathBuf) -> Vec<CycleRecord> {
    let recording = Recording::open(path).expect("a flight record is a recording");
    assert!(!recording.truncated(), "{}", path.display());
    let entries = recording.entries().map(|entry| entry.expect("sound to its end").entry);
    entries.filter_map(|entry| if let Entry::Cycle(record) = entry { Some(*record) } else { None }).collect()
}

/// Stops the daemon until there is a record that it caused, with 20 cycles before and 10 after: a busy machine may have
/// missed a deadline just before, and then the next is only recorded after a pause.
fn record_of_a_stall(
    station: &Station,
    daemon: &Process,
    monitor: &mut Monitor,
) -> (PathBuf, Vec<CycleRecord>) {
    wait_for("a flight record of a stall", || {
        stall(daemon);
        let before = monitor.update().cycle;
        monitor.until("the cycles after a stall", |monitor| monitor.state.cycle > before + 100);
        let is_its_cause = |cycles: &[CycleRecord]| {
            let at = cycles.iter().position(is_late);
            at.is_some_and(|at| cycles[at].deadline_missed == 1 && at >= 20 && cycles.len() - at > 10)
        };
        flights(station)
            .into_iter()
            .map(|path| (path.clone(), cycles_of(&path)))
            .find(|(_, cycles)| is_its_cause(cycles))
    })
}

#[test]
fn a_missed_deadline_is_stored_with_the_cycles_around_it_and_can_be_traced() {
    let station = Station::new();
    let _person = station.person();
    let mut daemon = station.daemon(&format!("{}[latency]\nflight_cycles = 40\n", station.configuration()));
    let mut monitor = Monitor::open(&station);
    monitor.until("a past to keep", |monitor| monitor.both_fresh() && monitor.state.cycle > 60);
    let (path, cycles) = record_of_a_stall(&station, &daemon, &mut monitor);
    assert!(cycles.windows(2).all(|pair| pair[1].cycle == pair[0].cycle + 1), "a gap");
    let place = cycles.iter().position(is_late).expect("the stall");
    // 60 slots of 5 ms passed while the daemon was stopped.
    let skipped = cycles[place + 1].slots_skipped - cycles[place].slots_skipped;
    assert!(skipped >= 38, "{skipped} slots skipped");

    let out = station.file("trace.json");
    let (file, out_name) = (path.to_string_lossy(), out.to_string_lossy());
    station.run(&["trace", &file, "-o", &out_name]).assert_done();
    let text = std::fs::read_to_string(&out).expect("the trace");
    let trace: Value = serde_json::from_str(&text).expect("JSON");
    let events = trace["traceEvents"].as_array().expect("events");
    let traced = |name: &str| -> Vec<u64> {
        let named = events.iter().filter(|event| event["name"] == name && event["ph"] != "e");
        named.map(|event| event["args"]["cycle"].as_u64().expect("its cycle")).collect()
    };
    assert_eq!(traced("cycle"), cycles.iter().map(|record| record.cycle).collect::<Vec<_>>());
    assert!(traced("deadline missed").contains(&cycles[place].cycle));
    assert!(traced("slots skipped").contains(&cycles[place + 1].cycle));
    assert!(!traced("suit.ingress").is_empty() && !traced("ground.ingress").is_empty());

    station.run(&["trace", &file, "-o", &out_name]).assert_failed(1, &["cannot create", "exists"]);
    let few = station.file("few.json").to_string_lossy().into_owned();
    let range = format!("{}-{}", cycles[place].cycle, cycles[place + 1].cycle);
    let message = station.run(&["trace", &file, "-o", &few, "--cycles", &range]).assert_done().to_owned();
    assert!(message.contains("2 cycles"), "{message}");
    station.run(&["trace", &file, "-o", "/dev/null/t.json"]).assert_failed(1, &["cannot create"]);
    let none = station.file("none.json").to_string_lossy().into_owned();
    let available = format!("no such cycles; --cycles selects from {}-", cycles[0].cycle);
    station.run(&["trace", &file, "-o", &none, "--cycles", "1-2"]).assert_failed(1, &[&available]);
    assert!(!std::path::Path::new(&none).exists());
    station.run(&["trace", &file, "-o", &none, "--cycles", "2-1"]).assert_failed(2, &["--cycles"]);
    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
}

#[test]
fn full_disks_cause_an_incident_only() {
    let station = Station::new();
    if !std::path::Path::new("/dev/full").exists() {
        println!("skipped: there is no /dev/full here");
        return;
    }
    let directory = station.state_directory();
    std::fs::create_dir_all(&directory).expect("a state directory");
    std::fs::write(directory.join("flight"), "no directory").expect("a file in the way");
    let configuration =
        format!("{}[latency]\nhlog = \"/dev/full\"\nflight_cycles = 40\n", station.configuration());
    let mut daemon = station.daemon(&configuration);
    let settings = BusSettings { station: NAME.to_owned(), role: "test".to_owned(), root: station.root() };
    let bus = Bus::join(&settings).expect("the bus");
    let mut incidents = bus.subscriber::<Incidents>(8).expect("a place");
    let mut active =
        || incidents.latest().expect("the bus").map(|newest| newest.active().collect::<Vec<_>>());
    wait_for("the incident on the bus", || active()?.contains(&Incident::LatencyNotLogged).then_some(()));
    wait_for("its words", || {
        let message = daemon.stderr();
        (message.contains("latency_not_logged") && message.contains("/dev/full")).then_some(())
    });
    // A stop between the end of one cycle's work and the choice of the next slot delays no cycle.
    wait_for("the record that cannot be kept", || {
        stall(&daemon);
        daemon.stderr().contains("cannot keep the cycles").then_some(())
    });
    let mut monitor = Monitor::open(&station);
    let before = monitor.update().cycle;
    monitor.until("more cycles", |monitor| monitor.state.cycle > before + 200);
    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
    let message = daemon.stderr();
    assert!(message.contains("schedule_adds_up=true") && !message.contains("panicked"), "{message}");
}

#[test]
fn nothing_is_stored_unless_configured() {
    let station = Station::new();
    let mut daemon = station.daemon(&format!("{}[latency]\nflight_cycles = 0\n", station.configuration()));
    let mut monitor = Monitor::open(&station);
    stall(&daemon);
    let before = monitor.update().cycle;
    monitor.until("more cycles", |monitor| monitor.state.cycle > before + 100);
    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
    assert!(!station.state_directory().join("flight").exists());
}
