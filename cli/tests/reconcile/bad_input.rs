//! Unusable input is refused with one message that includes the remedy, and no partial output is written.

use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::OnceLock;

use crate::common::{describe_output, equipoise};
use crate::make::{Samples, Script};

/// An ordinary session on a slow plate, made once for all tests here.
fn session() -> &'static (Script, Samples) {
    static SESSION: OnceLock<(Script, Samples)> = OnceLock::new();
    SESSION.get_or_init(|| {
        let mut script = Script::ordinary();
        script.rig.plate_hz = 200;
        (script, script.samples())
    })
}

struct Trial {
    directory: tempfile::TempDir,
    recording: PathBuf,
}

impl Trial {
    /// A recording of these samples under this configuration.
    fn of(samples: &Samples, config: &str) -> Trial {
        let directory = tempfile::tempdir().unwrap();
        let recording = directory.path().join("session.mcap");
        samples.write(&recording, config);
        Trial { directory, recording }
    }

    /// The unmodified session.
    fn whole() -> Trial {
        Trial::of(&session().1, &session().0.config())
    }

    /// Samples corrupted by `change`.
    fn corrupted(change: impl FnOnce(&mut Samples)) -> Trial {
        let mut samples = session().1.clone();
        change(&mut samples);
        Trial::of(&samples, &session().0.config())
    }

    fn out(&self) -> PathBuf {
        self.directory.path().join("out")
    }

    fn run(&self, options: &[&str]) -> Output {
        let mut command = equipoise();
        command.arg("reconcile").arg(&self.recording).arg("--out").arg(self.out()).args(options);
        command.output().unwrap()
    }

    /// Asserts exit code 1, one line that contains each of these words, and no output.
    fn refuses(&self, options: &[&str], phrases: &[&str]) {
        let output = self.run(options);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{}", describe_output(&output));
        for phrase in phrases {
            assert!(text.contains(phrase), "\"{phrase}\" is not in: {}", describe_output(&output));
        }
        assert_eq!(text.trim_end().lines().count(), 1, "{}", describe_output(&output));
        assert!(output.stdout.is_empty(), "{}", describe_output(&output));
        assert!(!self.out().exists(), "something was written");
    }
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn a_whole_session_is_summarised_and_its_report_written() {
    let trial = Trial::whole();
    let output = trial.run(&[]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{}", describe_output(&output));
    for phrase in
        ["configuration: the recording's own", "until the worker was identified", "gap:", "report.html"]
    {
        assert!(text.contains(phrase), "\"{phrase}\" is not in: {}", describe_output(&output));
    }
    let names = names(&trial.out());
    assert!(
        names.contains(&"report.html".to_owned()) && names.contains(&"report.md".to_owned()),
        "{names:?}"
    );
    assert!(names.iter().all(|name| !name.starts_with('.')), "litter: {names:?}");
}

#[test]
fn json_contains_the_finding_only() {
    let trial = Trial::whole();
    let output = equipoise().arg("reconcile").arg(&trial.recording).arg("--json").output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", describe_output(&output));
    let finding: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let verdict = finding["verdict"].as_str().unwrap();
    assert!(["named", "none", "ambiguous", "unexplained"].contains(&verdict), "{finding}");
    for key in ["before_mm", "after_mm", "noise_floor_mm"] {
        assert!(finding["gap"][key].as_f64().unwrap() > 0.0, "{finding}");
    }
    assert!(finding["model"].is_null(), "nothing was to be written");
}

#[test]
fn several_recordings_have_a_folder_and_a_line_each() {
    let trial = Trial::whole();
    let other = trial.directory.path().join("other.mcap");
    std::fs::copy(&trial.recording, &other).unwrap();
    let other = other.to_str().unwrap().to_owned();
    let output = trial.run(&[&other, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", describe_output(&output));
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(text.lines().count(), 2, "{text}");
    assert_eq!(names(&trial.out()), ["other", "session"]);
    let same = trial.recording.to_str().unwrap().to_owned();
    let output = trial.run(&[&same]);
    assert_eq!(output.status.code(), Some(1), "{}", describe_output(&output));
    assert!(
        describe_output(&output).contains("two recordings would be written to"),
        "{}",
        describe_output(&output)
    );
}

#[test]
fn an_empty_file_is_no_recording() {
    let trial = Trial::whole();
    std::fs::write(&trial.recording, "").unwrap();
    trial.refuses(&[], &["session.mcap", "the file is empty"]);
}

#[test]
fn a_truncated_recording_is_used_up_to_the_damage() {
    let trial = Trial::whole();
    let bytes = std::fs::read(&trial.recording).unwrap();
    std::fs::write(&trial.recording, &bytes[..bytes.len() * 9 / 10]).unwrap();
    let output = trial.run(&[]);
    assert_eq!(output.status.code(), Some(3), "{}", describe_output(&output));
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("the recording was cut short"), "{}", describe_output(&output));
    assert!(trial.out().join("report.html").exists());
}

#[test]
fn a_recording_that_is_cut_before_its_samples_is_refused() {
    let trial = Trial::whole();
    let bytes = std::fs::read(&trial.recording).unwrap();
    // Truncated in the header, and in the first chunk: no measurement is readable.
    for (length, phrases) in
        [(6, "not a recording"), (60, "session.mcap"), (4000, "no usable sample of suit or plate")]
    {
        std::fs::write(&trial.recording, &bytes[..length]).unwrap();
        trial.refuses(&[], &[phrases]);
    }
    trial.refuses(&[], &["rejected: the recording was cut short"]);
}

/// A refusal neither mixes its output with an older report nor deletes that.
#[test]
fn existing_files_are_unchanged() {
    let trial = Trial::whole();
    let bytes = std::fs::read(&trial.recording).unwrap();
    assert_eq!(trial.run(&[]).status.code(), Some(0));
    let written = || -> Vec<(String, Vec<u8>)> {
        names(&trial.out())
            .into_iter()
            .map(|name| (name.clone(), std::fs::read(trial.out().join(&name)).unwrap()))
            .collect()
    };
    let before = written();
    let constant = Trial::corrupted(|samples| {
        let first = samples.ground[0];
        for sample in &mut samples.ground {
            (sample.force_n, sample.moment_nm) = (first.force_n, first.moment_nm);
        }
    });
    let plate_only = Trial::corrupted(|samples| samples.suit.clear());
    let suit_only = Trial::corrupted(|samples| samples.ground.clear());
    let corrupted: [Vec<u8>; 5] = [
        Vec::new(),
        bytes[..4000].to_vec(),
        std::fs::read(&constant.recording).unwrap(),
        std::fs::read(&plate_only.recording).unwrap(),
        std::fs::read(&suit_only.recording).unwrap(),
    ];
    for bytes in corrupted {
        std::fs::write(&trial.recording, bytes).unwrap();
        let output = trial.run(&[]);
        assert_eq!(output.status.code(), Some(1), "{}", describe_output(&output));
        assert!(written() == before, "something was changed: {:?}", names(&trial.out()));
    }
}

#[test]
fn another_worker_s_configuration_is_refused() {
    let trial = Trial::whole();
    let config = trial.directory.path().join("config.toml");
    let path = config.to_str().unwrap().to_owned();
    std::fs::write(&config, session().0.config().replace("anon-1", "anon-2")).unwrap();
    trial.refuses(&["--config", &path], &["the recording is of anon-1", "anon-2's", "--config"]);
    std::fs::write(&config, session().0.config().replace("mass_kg = 72", "mass_kg = 104")).unwrap();
    trial.refuses(&["--config", &path], &["72.", "104.0 kg", "another worker"]);
}

#[test]
fn without_a_static_pose_no_worker_is_identified() {
    let script = Script { poses: 0, work_s: 20.0, ..session().0 };
    let mut config = script.config().replace("[identification]", "[identification]\nmethod = \"static\"");
    config += "[static_pose]\njoint_deg = 0.1\ncop_mm = 0.1\n";
    let trial = Trial::of(&script.samples(), &config);
    trial.refuses(&[], &["no static pose in the recording", "--identify", "[static_pose]"]);
}

#[test]
fn one_stream_is_not_sufficient() {
    Trial::corrupted(|samples| samples.suit.clear())
        .refuses(&[], &["samples of the plate and none of the suit", "suit.listen"]);
    Trial::corrupted(|samples| samples.ground.clear())
        .refuses(&[], &["samples of the suit and none of the plate", "ground.address"]);
    Trial::corrupted(|samples| {
        samples.suit.clear();
        samples.ground.clear();
    })
    .refuses(&[], &["no usable sample of suit or plate"]);
}

#[test]
fn samples_that_cannot_be_used_are_counted_in_the_refusal() {
    let (suits, plates) = (session().1.suit.len(), session().1.ground.len());
    let no_suit = |samples: &mut Samples| {
        samples.suit.iter_mut().for_each(|sample| sample.position_m[0][0] = f64::NAN);
    };
    let counted = |count: usize| format!("rejected: {count} messages hold numbers that are not finite");
    Trial::corrupted(no_suit).refuses(&[], &["none of the suit", &counted(suits)]);
    Trial::corrupted(|samples| {
        no_suit(samples);
        samples.ground.iter_mut().for_each(|sample| sample.force_n[2] = f64::INFINITY);
    })
    .refuses(&[], &["no usable sample of suit or plate", &counted(suits + plates)]);
}

#[test]
fn a_constant_sensor_is_rejected() {
    Trial::corrupted(|samples| {
        let first = samples.ground[0];
        for sample in &mut samples.ground {
            (sample.force_n, sample.moment_nm) = (first.force_n, first.moment_nm);
        }
    })
    .refuses(&[], &["the plate data never change", "cable"]);
    Trial::corrupted(|samples| {
        let first = samples.suit[0];
        for sample in &mut samples.suit {
            (sample.position_m, sample.orientation_wxyz) = (first.position_m, first.orientation_wxyz);
        }
    })
    .refuses(&[], &["the suit data never change", "paused or stuck"]);
}

#[test]
fn streams_without_common_time_and_an_empty_plate_are_reported() {
    Trial::corrupted(|samples| {
        samples.suit.retain(|sample| sample.sample_time_ns < 20_000_000_000);
        samples.ground.retain(|sample| sample.sample_time_ns > 30_000_000_000);
    })
    .refuses(&[], &["not recorded at the same time"]);
    Trial::corrupted(|samples| {
        for sample in &mut samples.ground {
            sample.force_n = sample.force_n.map(|newtons| 0.01 * newtons);
        }
    })
    .refuses(&[], &["no person stands on the plate"]);
}

#[test]
fn invalid_spans_are_refused() {
    let trial = Trial::whole();
    trial.refuses(&["--work", "500:600"], &["--work 500:600 lies outside the recording"]);
    trial.refuses(&["--identify", "0:40", "--work", "30:60"], &["--identify 0:40 and --work 30:60 overlap"]);
    trial.refuses(&["--reference", "40:30"], &["--reference", "ends before it begins"]);
    trial.refuses(&["--identify", "forty"], &["--identify", "12:90.5"]);
}

#[test]
fn files_that_cannot_be_read_are_named() {
    let trial = Trial::whole();
    trial.refuses(&["--config", "nowhere.toml"], &["cannot read the configuration nowhere.toml"]);
    let config = trial.directory.path().join("config.toml");
    std::fs::write(&config, "station = 3").unwrap();
    trial.refuses(
        &["--config", config.to_str().unwrap()],
        &["config.toml, line 1", "text in quotation marks is expected"],
    );
    trial.refuses(&["--model", "nowhere.toml"], &["cannot read the model nowhere.toml"]);
    let missing = equipoise().args(["reconcile", "nowhere.mcap"]).output().unwrap();
    assert_eq!(missing.status.code(), Some(1), "{}", describe_output(&missing));
    let unknown = equipoise().args(["reconcile", "shift.xlsx"]).output().unwrap();
    assert!(
        describe_output(&unknown).contains(".mcap, .csv, .mvnx, .pcap or .pcapng"),
        "{}",
        describe_output(&unknown)
    );
}
