//! A delayed loop, and settings that no machine grants: both are reported.

use std::time::Duration;

use equipoise_bus::{Bus, BusSettings};
use equipoise_core::message::CycleRecord;
use rustix::process::Signal;
use serde_json::Value;

use crate::process::{Process, wait_for};
use crate::station::{NAME, Station};

/// Cycles a second of [`Station::configuration`].
const RATE_HZ: u64 = 200;

#[test]
fn a_daemon_that_was_stopped_for_a_second_accounts_for_every_slot() {
    let station = Station::new();
    let mut daemon = station.daemon(&station.configuration());
    let settings = BusSettings { station: NAME.to_owned(), role: "test".to_owned(), root: station.root() };
    let bus = Bus::join(&settings).expect("the bus");
    let mut records = bus.subscriber::<CycleRecord>(1024).expect("a subscriber");
    let mut first: Option<CycleRecord> = None;
    let mut late = Vec::new();
    let mut newest_record = |late: &mut Vec<CycleRecord>| {
        let mut newest = None;
        while let Some(record) = records.receive().expect("the bus") {
            let first = *first.get_or_insert(record);
            // At every cycle, not only at the end.
            let slots = (record.due_ns - first.due_ns) / record.period_ns;
            let skipped = record.slots_skipped - first.slots_skipped;
            assert_eq!(slots, record.cycle - first.cycle + skipped, "{record:?}");
            if record.deadline_missed == 1 {
                late.push(record);
            }
            newest = Some(record);
        }
        newest
    };
    let mut skipped = wait_for("records", || newest_record(&mut late)).slots_skipped;
    let lateness_ns = |record: &CycleRecord| record.compute_end_ns - record.due_ns;
    // A stop that falls between the end of one cycle's work and the choice of the next slot skips slots without a late
    // cycle: it is repeated until one falls elsewhere.
    let worst = (1..).find_map(|stops| {
        daemon.send(Signal::STOP);
        std::thread::sleep(Duration::from_secs(1));
        daemon.send(Signal::CONT);
        let target = skipped + RATE_HZ * 9 / 10;
        skipped = wait_for("the skipped slots", || {
            newest_record(&mut late).map(|record| record.slots_skipped).filter(|skipped| *skipped >= target)
        });
        // The record of the delayed cycle itself shows the delay, by its number.
        let worst = late.iter().max_by_key(|record| lateness_ns(record));
        assert!(stops < 10, "ten stops and no cycle was late by their length: {worst:?}");
        worst.filter(|record| lateness_ns(record) > 900_000_000).copied()
    });
    let worst = worst.expect("the search ends with a result");

    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
    let message = daemon.stderr();
    assert!(message.contains("schedule_adds_up=true"), "{message}");
    assert!(message.contains(&format!("worst_miss=cycle {}, ", worst.cycle)), "{skipped} slots: {message}");
}

#[test]
fn strict_refuses_a_start_without_the_requested_scheduling_and_names_it() {
    let station = Station::new();
    let strict = |key: &str| station.configuration().replace("[loop]\n", &format!("[loop]\n{key}\n"));
    let mut refused = station.try_daemon(&strict("cpu = 4095\nstrict = true"));
    assert_eq!(refused.wait().code(), Some(1));
    let message = refused.stderr();
    assert!(message.contains("loop.strict: thread loop asked for core 4095"), "{message}");

    // Without `strict` it runs, with a warning.
    let mut daemon = station.daemon(&strict("cpu = 4095"));
    assert!(daemon.stderr().contains("WARN") && daemon.stderr().contains("core 4095"), "{}", daemon.stderr());
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}

#[test]
fn status_reports_requested_and_granted_scheduling_and_faults_of_every_thread() {
    let station = Station::new();
    let _person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let names = [
        "main",
        "commands",
        "saving",
        "egress",
        "loop",
        "ingress",
        "suit",
        "ground",
        "watchdog",
        "housekeeping",
        "planner",
    ];
    // Counts are published with housekeeping's rounds. Every kernel thread of the process is listed, with or without
    // requested settings.
    let tasks = || std::fs::read_dir(format!("/proc/{}/task", daemon.id())).expect("a living daemon").count();
    let status = station.status_when("every thread with its granted settings", |status| {
        let threads = status["daemon"]["threads"].as_array().map_or(&[][..], Vec::as_slice);
        let has_asked = |name: &&str| {
            threads.iter().any(|thread| thread["thread"] == *name && thread["has_asked"] == true)
        };
        names.iter().all(has_asked) && threads.len() == tasks()
    });
    let threads = status["daemon"]["threads"].as_array().expect("a list");
    for name in names {
        let thread = threads.iter().find(|thread| thread["thread"] == name);
        let thread = thread.unwrap_or_else(|| panic!("no {name} in {threads:?}"));
        assert_eq!(thread["policy"], "other", "{thread}");
        assert!(thread["cpus"].as_array().is_some_and(|cores| !cores.is_empty()), "{thread}");
        assert!(thread["timer_slack_ns"].as_u64() <= Some(1), "{thread}");
        let counted = thread["minor_faults"].as_u64().unwrap_or_else(|| panic!("no count in {thread}"));
        let by_kernel = minor_faults(&daemon, thread);
        assert!(counted <= by_kernel, "{thread}, and {by_kernel} by now");
        // Another thread may have no fault of its own: it uses the stack and the heap of one that has ended, such as that
        // of a request to the plate's settings page.
        assert!(counted > 0 || !["main", "loop"].contains(&name), "{thread}");
    }
    assert!(status["daemon"]["memory"]["resident_kib"].as_u64() > Some(1000), "{status}");
    let line = "asked other, granted other";
    station.run_until(line, &["status", "--all"], |ended| ended.stdout.contains(line)).assert_done();
    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
}

/// Page faults of a living thread that needed no disk, by the kernel (proc_pid_stat(5)).
fn minor_faults(daemon: &Process, thread: &Value) -> u64 {
    let path = format!("/proc/{}/task/{}/stat", daemon.id(), thread["id"]);
    let stat = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"));
    // The name may contain spaces; field 3 follows it, and this is field 10.
    let (_, fields) = stat.rsplit_once(')').expect("its name");
    fields.split_whitespace().nth(7).expect("a count").parse().expect("a number")
}
