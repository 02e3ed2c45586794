//! Reports of several workers, of one without valid results, and of a restarted daemon.

use std::path::PathBuf;

use bytemuck::Zeroable;
use equipoise_adapters::recording::{Predecessor, Recorder, Recording, RecordingHeader};
use equipoise_core::message::{CommandKind, CycleRecord, GroundSample, State, Validity};
use equipoise_studies::subject::Subject;

use crate::page::Page;
use crate::session::{config, equipoise, session, text};

/// As the recorder writes: the record of a cycle some states after its state.
const RECORDS_BEHIND: usize = 20;

/// A recording of these states, with a record for each and the subjects attached later, each with its time, s.
fn recording(
    name: &str,
    states: &[State],
    subjects: &[(f64, &str)],
    record: impl Fn(&State) -> CycleRecord,
) -> PathBuf {
    let path = session().file(name);
    let header = RecordingHeader {
        config_toml: config(&Subject::of_the_paper(5)),
        subject_toml: "subject = \"anon-1\"\n".to_owned(),
        ..RecordingHeader::default()
    };
    let mut recorder = Recorder::create(&path, &header).unwrap();
    for batch in states.chunks(RECORDS_BEHIND) {
        for state in batch {
            recorder.write(state.time_ns, state).unwrap();
        }
        for state in batch {
            let due = CycleRecord { cycle: state.cycle, due_ns: state.time_ns, ..record(state) };
            recorder.write(due.due_ns, &due).unwrap();
        }
    }
    for (time_s, id) in subjects {
        recorder.add_subject((time_s * 1e9) as u64, &format!("subject = {id:?}\n")).unwrap();
    }
    recorder.finish().unwrap();
    path
}

fn report(name: &str, recording: &std::path::Path) -> Page {
    let out = session().file(name);
    let ended = equipoise(&["report", text(recording), "--out", text(&out)]);
    assert_eq!(ended.status.code(), Some(0), "{ended:?}");
    Page::read(&out)
}

#[test]
fn a_change_of_worker_is_reported_and_adds_no_lifts() {
    let states: Vec<State> = (1..900)
        .map(|cycle| {
            let state = State { cycle, time_ns: cycle * 10_000_000, lifted_mass_kg: 7.0, ..State::zeroed() };
            match cycle {
                // One additional lift may be a real lift: only the cycle record reveals the restart.
                ..300 => State { lifts: 3, poses_used: 12, ..state },
                300..600 => State { lifts: 4, poses_used: 40, converged: 1, ..state },
                // Without a record, seven lifts in a hundredth of a second reveal it.
                _ => State { lifts: 11, poses_used: 30, converged: 1, ..state },
            }
        })
        .collect();
    let subjects = [(3.5, "anon-77"), (6.5, "anon-1")];
    let recording = recording("workers.mcap", &states, &subjects, |state| CycleRecord {
        command: if state.cycle == 300 { CommandKind::SubjectLoad as u32 } else { 0 },
        period_ns: 10_000_000,
        ..CycleRecord::zeroed()
    });
    let page = report("workers.html", &recording);
    assert!(page.text.contains("No lift ended in this recording."), "{}", page.text);
    assert!(page.text.contains("3 lifts were counted before it began."), "{}", page.text);
    assert!(page.text.contains("The worker changed at t = 3.0 s, 6.0 s"), "{}", page.text);
    assert!(page.text.contains("identified when loaded"), "{}", page.text);
    let workers: Vec<Vec<&str>> = page
        .rows("Workers")
        .iter()
        .map(|row| [0, 1, 2, 3, 7].map(|cell| row[cell].as_str()).into())
        .collect();
    let expected = [
        ["anon-1", "0.0", "3.0", "3.0 s", "0"],
        ["anon-77", "3.0", "6.0", "3.0 s", "0"],
        ["anon-1", "6.0", "9.0", "3.0 s", "0"],
    ];
    assert_eq!(workers, expected);
    let poses = page.rows("Identification");
    assert_eq!(
        (poses.len(), poses[0][0].as_str()),
        (1, "30"),
        "what was loaded was not learnt here: {poses:?}"
    );
    assert_eq!(
        page.cell("Session", "subject", "value"),
        "anon-1 and anon-77",
        "the profiles', not the configuration's"
    );
}

#[test]
fn a_restart_that_begins_a_new_shift_keeps_the_lifts_before() {
    // Three lifts, then a restart with a lower cycle number and no lifts; one lift fewer would continue the same shift.
    let states: Vec<State> = (1..600)
        .map(|number| State {
            cycle: if number < 400 { number } else { number - 399 },
            time_ns: number * 10_000_000,
            lifts: if number < 400 { (number / 100) as u32 } else { 0 },
            poses_used: 12,
            converged: 1,
            dose_damage: if number < 400 { 1e-3 } else { 0.0 },
            ..State::zeroed()
        })
        .collect();
    let record = |_: &State| CycleRecord { period_ns: 10_000_000, ..CycleRecord::zeroed() };
    let recording = recording("shifts.mcap", &states, &[], record);
    let page = report("shifts.html", &recording);
    assert_eq!(page.rows("Lifts").len(), 3, "{}", page.text);
    let rows: Vec<[&str; 2]> =
        page.rows("Workers").iter().map(|row| [0, 7].map(|cell| &*row[cell])).collect();
    assert_eq!(rows, [["anon-1", "3"], ["anon-1", "0"]]);
    assert!(page.text.contains("A new shift of the same worker began"), "{}", page.text);
    assert!(!page.text.contains("The worker changed"), "{}", page.text);
    // The identification is still that of the begin.
    assert!(page.text.contains("identified when the recording began"), "{}", page.text);
    assert_eq!(page.rows("Identification")[0][..2], ["12", "0.0"]);
}

#[test]
fn a_restart_with_another_subject_begins_a_period() {
    // The restart is 1 s before the end, where the recorder attaches the other subject. The workers have no lifts.
    let states: Vec<State> = (1..600)
        .map(|number| State {
            cycle: if number < 500 { number } else { number - 499 },
            time_ns: number * 10_000_000,
            ..State::zeroed()
        })
        .collect();
    let recording = recording("restart.mcap", &states, &[(5.99, "anon-77")], |_| CycleRecord::zeroed());
    let page = report("restart.html", &recording);
    let workers: Vec<&str> = page.rows("Workers").iter().map(|row| row[0].as_str()).collect();
    assert_eq!(workers, ["anon-1", "anon-77"]);
    assert!(page.text.contains("The worker changed at t = 5.0 s"), "{}", page.text);
}

#[test]
fn with_another_rate_times_are_those_of_the_recorded_cycles() {
    let recording = session().file("cycles.mcap");
    let config_toml = config(&Subject::of_the_paper(5));
    let header = RecordingHeader {
        config_toml: config_toml.clone(),
        previous: Some(Predecessor { file: "before.mcap".to_owned(), sha256: "0a".repeat(32) }),
        ..RecordingHeader::default()
    };
    let mut recorder = Recorder::create(&recording, &header).unwrap();
    recorder.add_subject(1_000_000_000, "subject = \"anon-77\"\n").unwrap();
    for sequence in 1..=400_u64 {
        let sample_time_ns = sequence * 5_000_000;
        let sample = GroundSample {
            sample_time_ns,
            published_ns: sample_time_ns,
            sequence,
            force_n: [0.0, 0.0, 700.0],
            ..GroundSample::zeroed()
        };
        recorder.write(sample_time_ns, &sample).unwrap();
        let cycle = CycleRecord {
            cycle: sequence,
            due_ns: sample_time_ns + 1,
            period_ns: 5_000_000,
            ground_taken: 1,
            ground_first: sequence,
            ground_last: sequence,
            ground_sample_time_ns: sample_time_ns,
            ..CycleRecord::zeroed()
        };
        recorder.write(cycle.due_ns, &cycle).unwrap();
    }
    recorder.finish().unwrap();
    // It has 100 Hz, the cycles 200.
    let (other, out) = (session().file("other-rate.toml"), session().file("other-rate.html"));
    std::fs::write(&other, &config_toml).unwrap();
    let ended = equipoise(&["report", text(&recording), "--config", text(&other), "--out", text(&out)]);
    assert!(matches!(ended.status.code(), Some(0 | 3)), "{ended:?}");
    let page = Page::read(&out);
    assert_eq!(page.cell("Invalid reasons", "suit_stale", "time"), "2.0 s", "{}", page.text);

    // A recording of the same states has the same times and subjects, but no place in the chain of its input.
    let states = session().file("other-rate.mcap");
    let ended = equipoise(&["replay", text(&recording), "--config", text(&other), "--out", text(&states)]);
    assert!(matches!(ended.status.code(), Some(0 | 3)), "{ended:?}");
    let ended = equipoise(&["report", text(&states), "--out", text(&out)]);
    assert_eq!(ended.status.code(), Some(0), "{ended:?}");
    let page = Page::read(&out);
    assert_eq!(page.cell("Invalid reasons", "suit_stale", "time"), "2.0 s", "{}", page.text);
    let [input, result] = [&recording, &states].map(|path| Recording::open(path).unwrap());
    assert_eq!(result.header().previous, None);
    assert_eq!(result.header().later_subjects_toml, ["subject = \"anon-77\"\n"]);
    assert_eq!(result.header().later_subjects_ns, input.header().later_subjects_ns);
    // It contains no samples, so it cannot be replayed.
    let ended = equipoise(&["replay", text(&states)]);
    assert_eq!(ended.status.code(), Some(1), "{ended:?}");
}

#[test]
fn a_worker_without_valid_loads_has_no_reported_risk() {
    let state = |cycle| State {
        cycle,
        time_ns: cycle * 10_000_000,
        valid: Validity::NOT_IDENTIFIED.0,
        ..State::zeroed()
    };
    let states: Vec<State> = (1..300).map(state).collect();
    let page = report("unjudged.html", &recording("unjudged.mcap", &states, &[], |_| CycleRecord::zeroed()));
    for expected in ["no lift with a valid low-back load: see data quality", "joint fatigue is unavailable"] {
        assert!(page.text.contains(expected), "{expected} is not in {}", page.text);
    }
    for absent in ["joint fatigue accumulated", "high-risk job with a probability", "Damage of the low back"]
    {
        assert!(!page.text.contains(absent), "{absent} is in {}", page.text);
    }
}

#[test]
fn times_are_those_of_the_daemon_of_each_record() {
    // The header has 100 Hz; the daemon after it ran at 200.
    let states: Vec<State> = (1..1001)
        .map(|number| State {
            cycle: if number <= 200 { number } else { number - 200 },
            time_ns: if number <= 200 { number * 10_000_000 } else { 3_000_000_000 + number * 5_000_000 },
            valid: if number <= 200 { 0 } else { Validity::MOVING.0 },
            ..State::zeroed()
        })
        .collect();
    let recording = recording("rates.mcap", &states, &[], |state| CycleRecord {
        period_ns: if state.time_ns <= 2_000_000_000 { 10_000_000 } else { 5_000_000 },
        ..CycleRecord::zeroed()
    });
    let page = report("rates.html", &recording);
    assert_eq!(page.cell("Invalid reasons", "moving", "time"), "4.0 s");
    assert!(page.text.contains("Restarts of the daemon: 1."), "{}", page.text);
    assert!(!page.text.contains("The worker changed"), "{}", page.text);
}
