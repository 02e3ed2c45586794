//! Recordings with numbers that are not finite or cannot be: their messages are left out and counted, and no output
//! contains such a number.

use std::path::{Path, PathBuf};
use std::process::Output;

use bytemuck::Zeroable;
use equipoise_adapters::recording::{Entry, Recorder, Recording, RecordingHeader};
use equipoise_core::message::{CycleRecord, GroundSample, State};
use equipoise_core::time::NS_PER_S;
use equipoise_studies::sensors::EPOCH_NS;

use crate::common::{describe_output, equipoise};
use crate::make::{Samples, Script};

fn run(arguments: &[&dyn AsRef<std::ffi::OsStr>]) -> Output {
    equipoise().args(arguments.iter().map(AsRef::as_ref)).output().unwrap()
}

/// Duration of the session, s.
const LENGTH_S: u64 = 10;

fn script() -> Script {
    let mut script = Script { poses: 1, work_s: 4.0, ..Script::ordinary() };
    script.rig.plate_hz = 200;
    script
}

fn config() -> String {
    script().config() + "[loop]\nrate_hz = 100\n"
}

/// The states of a replay of the samples.
fn states(samples: &Samples, directory: &Path) -> Vec<State> {
    let [recording, result] = ["sound.mcap", "states.mcap"].map(|name| directory.join(name));
    samples.write(&recording, &config());
    let output = run(&[&"replay", &recording, &"--out", &result]);
    assert_eq!(output.status.code(), Some(0), "{}", describe_output(&output));
    let entries = Recording::open(&result).unwrap();
    let entries = entries.entries().map(|timed| timed.unwrap().entry);
    entries.filter_map(|entry| if let Entry::State(state) = entry { Some(*state) } else { None }).collect()
}

/// Number of altered messages in [`recording`].
const ALTERED: usize = 8;

/// Samples and states of a session, some of them with one impossible number.
fn recording(directory: &Path) -> PathBuf {
    let mut samples = script().samples();
    let mut states = states(&samples, directory);
    samples.ground[100].force_n[2] = f64::NAN;
    samples.ground[300].moment_nm[0] = f64::NEG_INFINITY;
    samples.ground[500].force_n[0] = 1e12;
    samples.suit[50].position_m[3][1] = f64::NAN;
    samples.suit[70].position_m[0][2] = 1e9;
    samples.suit[90].orientation_wxyz[5] = [2.0, 0.0, 0.0, 0.0];
    states[200].torque_nm[3][1] = f64::NAN;
    states[300].com_m[0] = f64::INFINITY;
    let path = directory.join("session.mcap");
    let header = RecordingHeader {
        software_version: "test".to_owned(),
        started_monotonic_ns: EPOCH_NS,
        config_toml: config(),
        ..RecordingHeader::default()
    };
    let mut recorder = Recorder::create(&path, &header).unwrap();
    // In bursts, stream by stream, as the recorder writes.
    for second in 0..=LENGTH_S {
        let begin_ns = EPOCH_NS + second * NS_PER_S;
        let burst = begin_ns..begin_ns + NS_PER_S;
        for sample in samples.suit.iter().filter(|sample| burst.contains(&sample.published_ns)) {
            recorder.write(sample.published_ns, sample).unwrap();
        }
        for sample in samples.ground.iter().filter(|sample| burst.contains(&sample.published_ns)) {
            recorder.write(sample.published_ns, sample).unwrap();
        }
        for state in states.iter().filter(|state| burst.contains(&state.time_ns)) {
            recorder.write(state.time_ns, state).unwrap();
        }
    }
    recorder.finish().unwrap();
    path
}

/// Whether a text contains a number that is not finite.
fn has_impossible(text: &str) -> bool {
    let mut words = text.split(|c: char| !c.is_alphanumeric() && c != '_');
    words.any(|word| ["nan", "inf", "infinity"].iter().any(|name| word.eq_ignore_ascii_case(name)))
}

#[test]
fn impossible_numbers_are_counted_and_in_no_output() {
    let directory = tempfile::tempdir().unwrap();
    let recording = recording(directory.path());
    let commands: [(&str, &str, &[&str]); 6] = [
        ("replay", "replayed.jsonl", &[]),
        ("replay", "replayed.csv", &[]),
        ("report", "page.html", &[]),
        ("export", "states.csv", &[]),
        ("export", "suit.jsonl", &["--topic", "suit"]),
        ("export", "ground.csv", &["--topic", "ground"]),
    ];
    for (command, name, options) in commands {
        let out = directory.path().join(name);
        let mut program = equipoise();
        program.arg(command).arg(&recording).arg("--out").arg(&out).args(options);
        let output = program.output().unwrap();
        let printed = describe_output(&output);
        assert_eq!(output.status.code(), Some(3), "{command} {name}: {printed}");
        let counted = format!("rejected: {ALTERED} messages hold numbers that are not finite");
        assert!(printed.contains(&counted), "{command} {name}: {printed}");
        assert!(!has_impossible(&printed), "{command} {name}: {printed}");
        let written = std::fs::read_to_string(&out).unwrap();
        assert!(written.len() > 10_000, "{command} {name}: {} bytes", written.len());
        assert!(!has_impossible(&written), "{command} {name}");
        assert!(!name.ends_with(".jsonl") || !written.contains("null,"), "{command} {name}");
    }
}

/// Cycles whose samples are all left out.
#[test]
fn without_a_possible_sample_the_replay_of_cycles_names_the_reason() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("cycles.mcap");
    let header = RecordingHeader { config_toml: config(), ..RecordingHeader::default() };
    let mut recorder = Recorder::create(&path, &header).unwrap();
    for cycle in 1..4 {
        let due_ns = EPOCH_NS + cycle * 1_000_000;
        let sample = GroundSample {
            sample_time_ns: due_ns,
            force_n: [f64::NAN; 3],
            sequence: cycle,
            ..GroundSample::zeroed()
        };
        recorder.write(due_ns, &sample).unwrap();
        recorder.write(due_ns, &CycleRecord { cycle, due_ns, ..CycleRecord::zeroed() }).unwrap();
    }
    recorder.finish().unwrap();
    let output = run(&[&"replay", &path]);
    let text = describe_output(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("no usable sample of suit or ground"), "{text}");
    assert!(text.contains("rejected: 3 messages hold numbers that are not finite"), "{text}");
}
