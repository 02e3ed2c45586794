//! Exports of the session for OpenSim and as C3D, compared with its states.

use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::Command;

use equipoise_adapters::recording::{Entry, Recording};
use equipoise_core::body::{Joint, SEGMENTS};
use equipoise_core::message::{GroundSample, State, Validity};
use equipoise_studies::sensors::EPOCH_NS;
use rustix::process::{Pid, Signal, kill_process};

use crate::session::{equipoise, session, text};

/// Maximum difference of times, s: they are written in µs.
const TIME_TOLERANCE_S: f64 = 2e-6;

fn entries(path: &Path) -> impl Iterator<Item = Entry> {
    let recording = Recording::open(path).unwrap();
    recording.entries().map(|timed| timed.unwrap().entry).collect::<Vec<_>>().into_iter()
}

fn time_s(time_ns: u64) -> f64 {
    (time_ns - EPOCH_NS) as f64 / 1e9
}

/// The first state of each instant.
fn instants() -> Vec<State> {
    let mut instants: Vec<State> = Vec::new();
    for entry in entries(&session().states) {
        let Entry::State(state) = entry else { continue };
        if instants.last().map_or(0, |last| last.suit_sample_time_ns) < state.suit_sample_time_ns {
            instants.push(*state);
        }
    }
    instants
}

fn at(instants: &[State], row_s: f64) -> &State {
    let after =
        instants.partition_point(|state| time_s(state.suit_sample_time_ns) < row_s - TIME_TOLERANCE_S);
    let found = &instants[after];
    let apart_s = (time_s(found.suit_sample_time_ns) - row_s).abs();
    assert!(apart_s < TIME_TOLERANCE_S, "no instant at {row_s} s");
    found
}

/// Labels and rows of a text file whose data begin after a line.
fn rows(path: &Path, last_header: &str) -> (Vec<String>, Vec<Vec<f64>>) {
    let content = std::fs::read_to_string(path).unwrap();
    let mut lines = content.lines().skip_while(|line| !line.starts_with(last_header));
    let cells = |line: &str| line.split('\t').map(str::to_owned).collect::<Vec<_>>();
    let labels = match last_header {
        "endheader" => lines.nth(1),
        _ => lines.next(),
    };
    let labels = cells(labels.unwrap());
    let is_data = |line: &&str| line.starts_with(|first: char| first.is_ascii_digit() || first == '-');
    let numbers = |line: &str| cells(line).iter().map(|cell| cell.parse().unwrap()).collect::<Vec<f64>>();
    (labels, lines.filter(is_data).map(numbers).collect())
}

#[track_caller]
fn near(found: f64, expected: f64, within: f64) {
    assert!((found - expected).abs() <= within, "{found}, expected {expected}");
}

#[track_caller]
fn near_y_up(found: &[f64], [x, y, z]: [f64; 3], within: f64) {
    for (found, expected) in found.iter().zip([x, z, -y]) {
        near(*found, expected, within);
    }
}

/// Moment about the vertical through the centre of pressure, N m.
fn free_moment_nm(sample: &GroundSample) -> f64 {
    let ([x, y], [fx, fy, _]) = (sample.cop_m().unwrap(), sample.force_n);
    sample.moment_nm[2] - (x * fy - y * fx)
}

#[test]
fn files_for_opensim_are_the_states_in_its_axes() {
    let (session, instants, out) = (session(), instants(), session().file("opensim"));
    let ended = equipoise(&["export", text(&session.samples), "--format", "opensim", "--out", text(&out)]);
    assert_eq!(ended.status.code(), Some(0), "{ended:?}");

    let (labels, ground) = rows(&out.join("ground_reaction.mot"), "endheader");
    assert_eq!(labels[..2], ["time", "ground_force_vx"]);
    assert_eq!(labels[7..], ["ground_torque_x", "ground_torque_y", "ground_torque_z"]);
    assert!(ground.len() > 300, "{} rows", ground.len());
    let samples: Vec<_> = entries(&session.samples)
        .filter_map(|entry| if let Entry::Ground(sample) = entry { Some(sample) } else { None })
        .collect();
    for row in &ground {
        let state = at(&instants, row[0]);
        near_y_up(&row[1..4], state.ground_force_n, 1e-5);
        let [x, y] = state.cop_measured_m;
        near_y_up(&row[4..7], [x, y, samples[0].surface_z_m], 1e-5);
        let after = samples.partition_point(|sample| sample.sample_time_ns < state.suit_sample_time_ns);
        near(row[8], free_moment_nm(&samples[after]), 0.5);
        assert_eq!((row[7], row[9]), (0.0, 0.0));
    }

    let (labels, torques) = rows(&out.join("overload_torques.sto"), "endheader");
    assert_eq!((labels.len(), torques[0].len()), (1 + 4 * Joint::ALL.len(), labels.len()));
    let valid = instants.iter().filter(|state| !state.validity().any_of(Validity::INVALIDATES_TORQUES));
    near(torques.len() as f64, valid.count() as f64, 5.0);
    for row in &torques {
        let state = at(&instants, row[0]);
        for joint in Joint::ALL {
            let cells = &row[1 + 4 * joint.index()..][..4];
            near_y_up(&cells[..3], state.torque_nm[joint.index()], 1e-5);
            near(cells[3], state.torque_sigma_nm[joint.index()], 1e-5);
        }
    }

    let (labels, centres) = rows(&out.join("joint_centres.trc"), "Frame#");
    assert_eq!(
        (&*labels[2], labels.iter().filter(|label| !label.is_empty()).count()),
        ("Pelvis", 2 + SEGMENTS)
    );
    for row in centres.iter().filter(|row| row[2].is_finite()) {
        let state = at(&instants, row[1]);
        near_y_up(&row[2..5], state.segment_origin_m[0].map(|metres| 1000.0 * metres), 1e-5);
    }
}

/// Numbers of a C3D file.
struct C3d {
    points: usize,
    channels: usize,
    rate_hz: f32,
    frames: Vec<Vec<f32>>,
}

impl C3d {
    fn read(path: &Path) -> C3d {
        let bytes = std::fs::read(path).unwrap();
        let word = |index: usize| usize::from(u16::from_le_bytes([bytes[2 * index], bytes[2 * index + 1]]));
        let real = |at: &[u8]| f32::from_le_bytes(at[..4].try_into().unwrap());
        assert_eq!(bytes[..2], [2, 80]);
        let (points, channels, data) = (word(1), word(2), 512 * (word(8) - 1));
        let size = 4 * (4 * points + channels);
        let frame = |frame: &[u8]| frame.chunks_exact(4).map(real).collect();
        let frames: Vec<Vec<f32>> = bytes[data..].chunks_exact(size).map(frame).collect();
        assert_eq!((word(3), word(4)), (1, frames.len()));
        C3d { points, channels, rate_hz: real(&bytes[20..]), frames }
    }
}

#[test]
fn a_c3d_file_has_the_states_and_marks_invalid_points() {
    let (session, instants, out) = (session(), instants(), session().file("session.c3d"));
    let span = ["--span", "40:66"];
    let arguments = ["export", text(&session.samples), "--out", text(&out), span[0], span[1]];
    let ended = equipoise(&arguments);
    assert_eq!(ended.status.code(), Some(0), "{ended:?}");
    let file = C3d::read(&out);
    assert_eq!((file.points, file.channels), (SEGMENTS + 2 + Joint::ALL.len(), 6 + Joint::ALL.len()));
    let first = instants.iter().find(|state| time_s(state.suit_sample_time_ns) >= 40.0).unwrap();
    let begin_s = time_s(first.suit_sample_time_ns);
    let [mut valid, mut invalid] = [0; 2];
    for (index, frame) in file.frames.iter().enumerate() {
        let state = at(&instants, begin_s + index as f64 / f64::from(file.rate_hz));
        let cell = |index: usize| f64::from(frame[index]);
        let point = |index: usize| [0, 1, 2, 3].map(|axis| cell(4 * index + axis));
        let [x, y, z, residual] = point(0);
        let origin_m = state.segment_origin_m[0];
        [x, y, z].iter().zip(origin_m).for_each(|(mm, metres)| near(*mm, 1000.0 * metres, 1e-3));
        assert_eq!(residual, 0.0);
        let channel = |index: usize| cell(4 * file.points + index);
        let [fx, fy, fz] = state.ground_force_n;
        // A noise-free plate repeats its readings, which the plausibility check rejects at times.
        if state.validity().any_of(Validity::INVALIDATES_COP_MEASURED) {
            assert!((3..6).all(|index| channel(index).is_nan()), "a centre of pressure at {index}");
        } else {
            for (index, expected) in [fx, -fy, -fz].into_iter().enumerate() {
                near(channel(index), expected, 1e-3);
            }
            near(-channel(4) / channel(2) / 1000.0, state.cop_measured_m[0], 1e-5);
        }
        let knee = Joint::named("RightKnee").unwrap().index();
        let (moment, sigma) = (point(SEGMENTS + 2 + knee), channel(6 + knee));
        if state.validity().any_of(Validity::INVALIDATES_TORQUES) {
            assert!(moment == [0.0, 0.0, 0.0, -1.0] && sigma.is_nan());
            invalid += 1;
        } else {
            near(moment[1], 1000.0 * state.torque_nm[knee][1], 1e-2);
            near(sigma, 1000.0 * state.torque_sigma_nm[knee], 1e-2);
            valid += 1;
        }
    }
    assert!(valid > 300 && invalid > 100, "{valid} valid, {invalid} invalid");
}

#[test]
fn the_default_program_writes_every_format() {
    let (session, help) = (session(), equipoise(&["export", "--help"]));
    let help = String::from_utf8_lossy(&help.stdout).into_owned();
    // A line of the help per format: `          - csv:  Table: ...`.
    let formats = help.split("--topic").next().unwrap().lines().filter_map(|line| {
        let (name, _) = line.trim().strip_prefix("- ")?.split_once(':')?;
        Some(name.to_owned())
    });
    let formats: Vec<String> = formats.collect();
    assert_eq!(formats, ["csv", "jsonl", "parquet", "mot", "sto", "trc", "opensim", "c3d"]);
    // The tests above write the other formats.
    for format in ["csv", "jsonl", "parquet"] {
        let out = session.file(&format!("every.{format}"));
        let ended = equipoise(&["export", text(&session.states), "--out", text(&out)]);
        assert!(ended.status.success() && out.exists(), "{format}: {ended:?}");
    }
}

#[test]
fn an_export_without_valid_values_fails_with_a_remedy_and_leaves_no_file() {
    let (session, out) = (session(), |name: &str| session().file(name));
    let (samples, states) = (text(&session.samples), text(&session.states));
    for (name, recording, options, reason) in [
        ("no.mot", states, &[][..], "needs samples of a plate"),
        ("no.sto", samples, &["--span", "0:2"], "need an identified worker with a load"),
        ("no.trc", states, &["--span", "900:901"], "choose another --span"),
        ("no.c3d", states, &["--topic", "suit"], "--topic is for tables"),
        ("no.xlsx", states, &[], ".mot, .sto, .trc or .c3d"),
    ] {
        let path = out(name);
        let ended = equipoise(&[&["export", recording, "--out", text(&path)], options].concat());
        let message = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert!(ended.status.code() == Some(1) && message.contains(reason), "{name}: {message}");
        assert!(!path.exists());
    }
    let folder = session.states.parent().unwrap();
    // Other tests write their own exports into the same folder at the same time.
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
    let left: Vec<_> = names.filter(|name| name.to_string_lossy().starts_with("no.")).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn an_interrupted_export_leaves_no_file() {
    let (folder, out) = (tempfile::tempdir().unwrap(), "stopped.csv");
    let mut export = Command::new(env!("CARGO_BIN_EXE_equipoise"));
    export.args(["export", text(&session().samples), "--out"]).arg(folder.path().join(out));
    let mut export = export.spawn().unwrap();
    let names = || -> Vec<_> {
        std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect()
    };
    while names().is_empty() {
        assert!(export.try_wait().unwrap().is_none(), "it ended before its first file");
    }
    // A shell starts background jobs with an ignored interrupt.
    kill_process(Pid::from_child(&export), Signal::TERM).unwrap();
    assert_eq!(export.wait().unwrap().signal(), Some(15));
    assert_eq!(names(), [""; 0]);
}
