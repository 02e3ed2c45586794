//! Reports of several workers and sessions, of one worker without valid results, and of a restarted daemon.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use bytemuck::Zeroable;
use equipoise_adapters::recording::{Predecessor, Recorder, Recording, RecordingHeader};
use equipoise_core::body::{Joint, Side};
use equipoise_core::message::{CommandKind, CycleRecord, GroundSample, State, Validity};
use equipoise_core::overload::Level;
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
    recording_with(name, &header(), states, subjects, record)
}

fn header() -> RecordingHeader {
    RecordingHeader {
        config_toml: config(&Subject::of_the_paper(5)),
        subject_toml: "subject = \"anon-1\"\n".to_owned(),
        ..RecordingHeader::default()
    }
}

/// As `recording`, with another header.
fn recording_with(
    name: &str,
    header: &RecordingHeader,
    states: &[State],
    subjects: &[(f64, &str)],
    record: impl Fn(&State) -> CycleRecord,
) -> PathBuf {
    let path = session().file(name);
    let mut recorder = Recorder::create(&path, header).unwrap();
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

fn report(name: &str, recording: &Path) -> Page {
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
    assert_eq!(page.cell("Comparison", "lifts", "1.2: anon-77"), "0; 4 counted before");
    assert_eq!(page.cell("Comparison", "comparable", "1.3: anon-1"), "yes");
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

/// The page that compares recordings.
fn compared(name: &str, recordings: &[&Path]) -> Page {
    let out = session().file(name);
    let files = recordings.iter().map(|path| text(path));
    let arguments: Vec<&str> = ["report", "--out", text(&out)].into_iter().chain(files).collect();
    let ended = equipoise(&arguments);
    assert_eq!(ended.status.code(), Some(0), "{ended:?}");
    Page::read(&out)
}

/// One lift of 12 kg in 9 s, with a torque of 90 % of the limit of the left shoulder.
fn lifting(invalid: Validity) -> Vec<State> {
    let joint = Joint::named("LeftShoulder").unwrap().index();
    let state = |cycle: u64| {
        let mut state = State {
            cycle,
            time_ns: cycle * 10_000_000,
            suit_sample_time_ns: 1,
            worst_joint: joint as u32,
            lifts: u32::from(cycle >= 650),
            l5s1_compression_n: 4000.0,
            l5s1_compression_sigma_n: 200.0,
            valid: invalid.0,
            ..State::zeroed()
        };
        for side in Side::BOTH {
            state.segment_origin_m[side.toe().index()] = [0.2, 0.0, 0.0];
            state.segment_origin_m[side.hand().index()] = [0.5, 0.0, 0.75];
        }
        if invalid == Validity::default() {
            state.dose_damage = if cycle >= 650 { 3e-3 } else { 1e-3 };
        }
        if cycle >= 600 {
            state.valid |= Validity::BELOW_LOAD_THRESHOLD.0;
            return state;
        }
        (state.lifted_mass_kg, state.lifted_mass_sigma_kg, state.reach_m) = (12.0, 0.3, 0.5);
        (state.torque_nm[joint], state.torque_limit_nm[joint]) = ([0.0, 45.0, 0.0], 50.0);
        (state.torque_sigma_nm[joint], state.joint_level[joint]) = (2.0, Level::Red as u32);
        state
    };
    (1..900).map(state).collect()
}

#[test]
fn sessions_are_compared_with_uncertainties_or_reasons() {
    let record = |_: &State| CycleRecord { period_ns: 10_000_000, ..CycleRecord::zeroed() };
    let lifted = recording("lifted.mcap", &lifting(Validity::default()), &[], record);
    let hidden = recording("hidden.mcap", &lifting(Validity::NOT_IDENTIFIED), &[], record);
    let page = compared("compared.html", &[&lifted, &hidden]);
    let withheld = |what: &str| format!("{what}; mostly not_identified, 100.0 % of the time");
    let no_torque = withheld("no valid torque");
    for (row, first, second) in [
        ("recording", "lifted.mcap", "hidden.mcap"),
        ("comparable", "reference", "yes"),
        ("torques reported", "6.0 s, 66.6 % of the time", "0.0 s, 0.0 % of the time"),
        ("lifts", "1", "1"),
        ("mass of a lift, mean", "12.00 ± 0.30 kg", "12.00 ± 0.30 kg"),
        ("mass of a lift, largest", "12.00 ± 0.30 kg", "12.00 ± 0.30 kg"),
        ("lifts above the weight limit", "1 of 1", withheld("no valid load position").as_str()),
        (
            "largest lifting index",
            "1.04 ± 0.03, at t = 0.0 s",
            "no lift with a valid mass within the range of the equation",
        ),
        ("highest peak", "left shoulder, 90 % ± 4 % of its limit", no_torque.as_str()),
        ("highest level high", "6.0 s, 100.0 %", no_torque.as_str()),
        ("highest level low", "0.0 s, 0.0 %", no_torque.as_str()),
        ("L5/S1 compression, mean", "4000 ± 200 N", withheld("no valid compression").as_str()),
        (
            "L5/S1 dose of the shift, at the end",
            "3.00e-3",
            withheld("no lift with a valid low-back load").as_str(),
        ),
        ("L5/S1 dose of this time", "2.00e-3", withheld("no lift with a valid low-back load").as_str()),
    ] {
        let cells = ["1: anon-1", "2: anon-1"].map(|column| page.cell("Comparison", row, column));
        assert_eq!(cells, [first, second], "{row}");
    }
    let peak = page.cell("Peak of each joint", "left shoulder", "1: anon-1");
    assert_eq!(peak, "90 % ± 4 % of its limit; high or overloaded for 6.0 s");
    assert!(page.text.contains("The highest joint load was that of"), "{}", page.text);
    assert_eq!(page.rows("Session 1: Lifts").len(), 1);
    assert_eq!(page.rows("Session 2: Lifts").len(), 1);

    // Names of drawings and of groups of buttons are those of one session.
    let values = |key: &'static str| {
        let attributes = page.elements.iter().flat_map(|(_, attributes)| attributes);
        attributes.filter(move |(name, _)| name == key).map(|(_, value)| value.as_str())
    };
    assert_eq!(values("id").count(), values("id").collect::<BTreeSet<_>>().len());
    let groups: BTreeSet<&str> = values("name").filter(|name| name.ends_with("body")).collect();
    assert_eq!(groups.into_iter().collect::<Vec<_>>(), ["session-1-body", "session-2-body"]);
}

#[test]
fn sessions_of_other_models_or_settings_are_not_comparable() {
    const MODEL: &str = "version = 1\n[[effect]]\nname = \"plate_offset\"\nspan_s = [1, 2]\nopen_ended = true\n\
                         log_odds = 9.0\n[effect.parameters.dx_m]\nvalue = 0.01\nsigma = 0.001\nunit = \"m\"\n";
    let states = lifting(Validity::default());
    let write = |name: &str, header: &RecordingHeader| {
        recording_with(name, header, &states, &[], |_| CycleRecord::zeroed())
    };
    let same = write("same.mcap", &header());
    let settings = format!("{}[overload]\nthreshold_n = 30.0\n", header().config_toml);
    let settings = write("settings.mcap", &RecordingHeader { config_toml: settings, ..header() });
    let model = write("model.mcap", &RecordingHeader { model_toml: MODEL.to_owned(), ..header() });
    let release = RecordingHeader { software_version: "0.0.9".to_owned(), ..header() };
    let release = write("release.mcap", &release);
    let page = compared("other-settings.html", &[&same, &settings, &model, &release]);
    for (column, expected) in [
        ("1: anon-1", "reference"),
        ("2: anon-1", "no: [overload] differs"),
        ("3: anon-1", "no: another model file"),
        ("4: anon-1", "no: another release of Equipoise"),
    ] {
        assert_eq!(page.cell("Comparison", "comparable", column), expected);
    }
    assert!(page.text.contains("Not all columns can be compared"), "{}", page.text);
    assert!(!page.text.contains("The highest joint load was that of"), "{}", page.text);
}

#[test]
fn a_comparison_is_written_next_to_its_first_recording() {
    let write =
        |name: &str| recording(name, &lifting(Validity::default()), &[], |_: &State| CycleRecord::zeroed());
    let (one, two) = (write("first-session.mcap"), write("second-session.mcap"));
    let ended = equipoise(&["report", text(&one), text(&two)]);
    assert_eq!(ended.status.code(), Some(0), "{ended:?}");
    let page = Page::read(&session().file("comparison.html"));
    assert_eq!(page.cell("Comparison", "recording", "2: anon-1"), "second-session.mcap");
    let ended = equipoise(&["report", text(&one), text(&one)]);
    assert_eq!(ended.status.code(), Some(1), "{ended:?}");
    assert!(String::from_utf8_lossy(&ended.stderr).contains("is given twice"), "{ended:?}");
}
