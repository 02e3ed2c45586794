//! Replay with a model file: active terms, their spans, the model stored in a recording, and refusals.

use std::path::Path;
use std::process::Output;

use equipoise_adapters::recording::Recording;
use equipoise_files::sha256_of;

use crate::common::{describe_output, equipoise, human_motion, human_motion_config};

fn run(arguments: &[&dyn AsRef<std::ffi::OsStr>]) -> Output {
    equipoise().args(arguments.iter().map(AsRef::as_ref)).output().unwrap()
}

/// A permanent offset of 40 mm, and one of 70 mm that ended after four seconds.
fn model(recording_sha256: &str) -> String {
    let offset = |key: &str, value: f64, to_s: f64, open_ended: bool| {
        format!(
            "[[effect]]\nname = \"plate_offset\"\nspan_s = [0.0, {to_s:?}]\nopen_ended = {open_ended}\nlog_odds = 9.0\n\
             parameters.{key} = {{ value = {value}, sigma = 0.001, unit = \"m\" }}\n"
        )
    };
    format!(
        "version = 1\n[provenance]\nrecording_sha256 = \"{recording_sha256}\"\ndate = \"2026-03-01T08:30:00Z\"\nsubject = \
         \"anon-1\"\nstation = \"station-1\"\nsoftware = \"0.1.0\"\nidentify_s = [0, 1]\nwork_s = [1, 2]\n{}{}",
        offset("dx_m", 0.04, 9.0, true),
        offset("dy_m", 0.07, 4.0, false)
    )
}

/// Estimated centres of pressure of every state that has one, by its time in s.
fn estimated_cop(lines: &Path) -> Vec<(f64, [f64; 2])> {
    let text = std::fs::read_to_string(lines).unwrap();
    let states = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let estimates = states.filter_map(|state| {
        let number = |value: &serde_json::Value| value.as_f64();
        let [x, y] = [0, 1].map(|axis| number(&state["cop_estimated"][axis]));
        Some((number(&state["t"])?, [x?, y?]))
    });
    estimates.collect()
}

#[test]
fn figaroh_replayed_with_a_model_has_prediction_and_terms() {
    let Some(whole) = human_motion() else { return };
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str| directory.path().join(name);
    // The head and ten seconds: the estimates that are compared are those after one second.
    let (csv, text) = (file("motion.csv"), std::fs::read_to_string(whole).unwrap());
    std::fs::write(&csv, text.lines().take(301).collect::<Vec<_>>().join("\n")).unwrap();
    let (here, elsewhere) = (file("here.toml"), file("elsewhere.toml"));
    std::fs::write(&here, model(&sha256_of(&csv).unwrap())).unwrap();
    std::fs::write(&elsewhere, model(&"0".repeat(64))).unwrap();
    let config = human_motion_config();
    let replay = |model: Option<&Path>, out: &str| {
        let out = file(out);
        let mut arguments: Vec<&dyn AsRef<std::ffi::OsStr>> =
            vec![&"replay", &csv, &"--config", &config, &"--out", &out];
        if let Some(model) = &model {
            arguments.extend([&"--model" as &dyn AsRef<std::ffi::OsStr>, model]);
        }
        let output = run(&arguments);
        assert_eq!(output.status.code(), Some(0), "{}", describe_output(&output));
        describe_output(&output)
    };
    replay(None, "plain.jsonl");
    let summary = replay(Some(&here), "here.jsonl");
    assert!(summary.contains("plate_offset, plate_offset, each in the span of this recording"), "{summary}");
    let summary = replay(Some(&elsewhere), "elsewhere.jsonl");
    assert!(summary.contains("left out, since it ended before"), "{summary}");

    // Before identification only the terms differ.
    let [plain, here_cop, elsewhere_cop] =
        ["plain.jsonl", "here.jsonl", "elsewhere.jsonl"].map(|name| estimated_cop(&file(name)));
    let difference = |with: &[(f64, [f64; 2])]| {
        let first = |all: &[(f64, [f64; 2])]| *all.iter().find(|(time_s, _)| *time_s > 1.0).unwrap();
        let ((_, plain), (_, with)) = (first(&plain), first(with));
        [0, 1].map(|axis| 1e3 * (with[axis] - plain[axis]))
    };
    for (with, expected_mm) in [(&here_cop, [40.0, 70.0]), (&elsewhere_cop, [40.0, 0.0])] {
        let found_mm = difference(with);
        let near = |axis: usize| (found_mm[axis] - expected_mm[axis]).abs() < 1.0;
        assert!(near(0) && near(1), "{found_mm:?}, not {expected_mm:?}");
    }

    // A recording of results keeps the model, and is replayed with it.
    replay(Some(&elsewhere), "kept.mcap");
    let recording = Recording::open(file("kept.mcap")).unwrap();
    assert_eq!(recording.header().model_toml, std::fs::read_to_string(&elsewhere).unwrap());
    let imported = file("imported.mcap");
    let with_model = file("with_model.toml");
    let text = std::fs::read_to_string(&config).unwrap();
    std::fs::write(&with_model, format!("{text}\n[model]\nfile = \"elsewhere.toml\"\n")).unwrap();
    let output = run(&[&"import", &csv, &"--config", &with_model, &"-o", &imported]);
    assert_eq!(output.status.code(), Some(0), "{}", describe_output(&output));
    let output = run(&[&"replay", &imported]);
    assert!(
        describe_output(&output).contains("model of the recording: plate_offset; left out"),
        "{}",
        describe_output(&output)
    );
}

#[test]
fn a_model_that_cannot_be_used_is_refused_before_anything_runs() {
    let directory = tempfile::tempdir().unwrap();
    let (config, model) = (directory.path().join("c.toml"), directory.path().join("m.toml"));
    let text = include_str!("../../../systemd/equipoise.toml");
    std::fs::write(&config, format!("{text}\n[model]\nfile = \"m.toml\"\n")).unwrap();
    std::fs::write(&model, "version = 1\n[[effect]]\nname = \"plate_ofset\"\nspan_s = [0, 1]\nopen_ended = true\nlog_odds = 1.0\n").unwrap();
    for arguments in [&[&"check" as &dyn AsRef<_>, &config][..], &[&"run", &"--config", &config]] {
        let output = run(arguments);
        assert_eq!(output.status.code(), Some(1), "{}", describe_output(&output));
        let expected = "effect 1, name: `plate_ofset` is not an effect; did you mean `plate_offset`?";
        assert!(describe_output(&output).contains(expected), "{}", describe_output(&output));
    }
    std::fs::write(&model, self::model(&"0".repeat(64))).unwrap();
    let output = run(&[&"check", &config]);
    assert!(
        output.status.success() && describe_output(&output).contains("m.toml: plate_offset; left out"),
        "{}",
        describe_output(&output)
    );
}
