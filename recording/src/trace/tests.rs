use std::collections::HashMap;

use bytemuck::Zeroable;
use equipoise_adapters::recording::{Recorder, RecordingHeader};
use equipoise_core::message::CommandKind;
use equipoise_latency::Stage;
use serde_json::Value;

use super::*;

const PERIOD_NS: u64 = 1_000_000;
/// An uptime of months: a double in µs would lose the ns.
const START_NS: u64 = 91_000_000_000_000_123;

/// Cycles 1 to 60 on an absolute schedule, like the loop's, with a stall in cycle 30; suit samples wait for each other in the adapter.
fn records() -> Vec<CycleRecord> {
    let (mut slot, mut now_ns) = (0, 0);
    let mut record = |cycle: u64| {
        let due_ns = START_NS + slot * PERIOD_NS;
        let stall_ns = if cycle == 30 { 5 * PERIOD_NS + 400_000 } else { 0 };
        let woken_ns = now_ns.max(due_ns) + 31_007 + stall_ns + 700 * (cycle % 7);
        let (compute_start_ns, compute_end_ns) = (woken_ns + 911, woken_ns + 6_020 + 3 * cycle);
        let record = CycleRecord {
            cycle,
            due_ns,
            woken_ns,
            compute_start_ns,
            compute_end_ns,
            publish_start_ns: compute_end_ns + 8_123,
            published_ns: compute_end_ns + 9_456,
            suit_sample_time_ns: due_ns - 5 * PERIOD_NS,
            suit_arrival_ns: due_ns - 3 * PERIOD_NS,
            suit_published_ns: due_ns - PERIOD_NS / 2,
            suit_ingress_ns: due_ns - PERIOD_NS / 3,
            suit_taken: u32::from(cycle.is_multiple_of(2)),
            period_ns: PERIOD_NS,
            slots_skipped: slot + 1 - cycle,
            deadline_missed: u32::from(compute_end_ns > due_ns + PERIOD_NS),
            command: if cycle == 7 { CommandKind::Tare as u32 } else { 0 },
            ..CycleRecord::zeroed()
        };
        now_ns = compute_end_ns + 200;
        slot = (slot + 1).max((now_ns - START_NS) / PERIOD_NS);
        record
    };
    (1..=60).map(&mut record).collect()
}

fn trace_of(records: &[CycleRecord], cycles: Option<RangeInclusive<u64>>) -> (TraceSummary, Vec<Value>) {
    let mut recorder = Recorder::in_memory("t", &RecordingHeader::default()).unwrap();
    for record in records {
        recorder.write(record.due_ns, record).unwrap();
    }
    let recording = Recording::from_bytes(recorder.into_bytes().unwrap()).unwrap();
    let mut text = Vec::new();
    let summary = write_trace(&recording, cycles.as_ref(), &mut text).unwrap();
    let trace: Value = serde_json::from_slice(&text).unwrap();
    (summary, trace["traceEvents"].as_array().unwrap().clone())
}

/// Parses a written number of µs to ns.
fn ns(event: &Value, key: &str, text: &str) -> u64 {
    let (whole, rest) = text.split_once('.').unwrap_or_else(|| panic!("{key} of {event}"));
    assert_eq!(rest.len(), 3, "{key} of {event}");
    format!("{whole}{rest}").parse().unwrap()
}

/// Stages of cycles with both stamps, as in the trace: name and cycle to begin and length.
fn spans(records: &[CycleRecord]) -> HashMap<(String, u64), (u64, u64)> {
    let mut spans = HashMap::new();
    for (index, record) in records.iter().enumerate() {
        let before = index.checked_sub(1).map(|index| &records[index]);
        let mut started = HashMap::new();
        for event in events_of(record, before) {
            let text = event.to_string();
            let event: Value = serde_json::from_str(&text).unwrap();
            let raw = |key: &str| {
                let rest = text.split_once(&format!("\"{key}\":")).unwrap().1;
                ns(&event, key, rest.split([',', '}']).next().unwrap())
            };
            let name = event["name"].as_str().unwrap().to_owned();
            match event["ph"].as_str().unwrap() {
                "X" => drop(spans.insert((name, record.cycle), (raw("ts"), raw("dur")))),
                "b" => drop(started.insert((name, event["id"].clone()), raw("ts"))),
                "e" => {
                    let from_ns = started.remove(&(name.clone(), event["id"].clone())).unwrap();
                    spans.insert((name, record.cycle), (from_ns, raw("ts") - from_ns));
                }
                _ => {}
            }
        }
        assert!(started.is_empty(), "{started:?}");
    }
    spans
}

#[test]
fn every_stage_of_every_cycle_is_a_slice_of_just_its_stamps() {
    let records = records();
    let mut spans = spans(&records);
    for record in &records {
        let cycle = spans.remove(&("cycle".to_owned(), record.cycle));
        assert_eq!(cycle, Some((record.woken_ns, record.compute_end_ns - record.woken_ns)));
        for stage in Stage::ALL.into_iter().filter(|stage| stage.is_elementary()) {
            let actual = spans.remove(&(stage.name().to_owned(), record.cycle));
            let stamps = stage.span_ns(record).and_then(Result::ok);
            assert_eq!(actual, stamps.map(|(from_ns, to_ns)| (from_ns, to_ns - from_ns)), "{}", stage.name());
        }
    }
    assert!(spans.is_empty(), "{spans:?}");
}

#[test]
fn slices_of_a_thread_are_disjoint_or_nested() {
    let (summary, events) = trace_of(&records(), None);
    assert_eq!((summary.cycles, summary.span, summary.deadlines_missed), (60, Some((1, 60)), 1));
    assert!(summary.damage.is_none());
    let mut open: HashMap<u64, Vec<(f64, f64)>> = HashMap::new();
    let (mut started, mut slices) = (0, 0);
    for event in &events {
        assert!(["M", "X", "b", "e", "i", "C"].contains(&event["ph"].as_str().unwrap()), "{event}");
        assert!(event["pid"].is_u64() && event["tid"].is_u64() && event["name"].is_string(), "{event}");
        started += match event["ph"].as_str().unwrap() {
            "b" => 1,
            "e" => -1,
            _ => 0,
        };
        if event["ph"] != "X" {
            continue;
        }
        slices += 1;
        let (from, length) = (event["ts"].as_f64().unwrap(), event["dur"].as_f64().unwrap());
        let stack = open.entry(event["tid"].as_u64().unwrap()).or_default();
        // Remove slices that have ended; times are exact to 16 ns in a double here.
        while stack.last().is_some_and(|(_, end)| *end <= from + 0.05) {
            stack.pop();
        }
        if let Some((outer_from, outer_end)) = stack.last() {
            assert!(*outer_from <= from && from + length <= outer_end + 0.05, "{event} crosses another");
        }
        stack.push((from, from + length));
    }
    assert_eq!((started, slices), (0, 60 * 4), "cycle, intake, compute, publish");
}

#[test]
fn occurrences_are_instants_of_their_cycle() {
    let (_, events) = trace_of(&records(), None);
    let instants: Vec<_> = events.iter().filter(|event| event["ph"] == "i").collect();
    let actual: Vec<_> = instants
        .iter()
        .map(|event| (event["name"].as_str().unwrap(), event["args"]["cycle"].as_u64().unwrap()))
        .collect();
    assert_eq!(actual, [("command", 7), ("deadline missed", 30), ("slots skipped", 31)]);
    assert_eq!(instants[0]["args"]["command"], "tare");
    assert_eq!(instants[2]["args"]["slots"], 4);
    let counters = |name: &str| events.iter().filter(|e| e["ph"] == "C" && e["name"] == name).count();
    assert_eq!((counters("lateness"), counters("samples taken")), (60, 60));
}

#[test]
fn a_range_holds_its_cycles_and_a_gap_is_reported() {
    let mut records = records();
    let (summary, events) = trace_of(&records, Some(20..=22));
    assert_eq!((summary.cycles, summary.span), (3, Some((20, 22))));
    assert_eq!(summary.available, [1..=60]);
    let of_cycles = events.iter().filter_map(|event| event["args"]["cycle"].as_u64());
    assert!(of_cycles.clone().all(|cycle| (20..=22).contains(&cycle)) && of_cycles.count() > 0);
    records.drain(10..15);
    let (summary, events) = trace_of(&records, None);
    assert_eq!(summary.available, [1..=10, 16..=60]);
    let gap = events.iter().find(|event| event["name"] == "not recorded").unwrap();
    assert_eq!((&gap["args"]["cycle"], &gap["args"]["cycles"]), (&Value::from(16), &Value::from(5)));
}
