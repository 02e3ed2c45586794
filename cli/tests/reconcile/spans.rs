//! The spans of a model file are those of the recording, also if the suit begins later than the recording.

use std::path::Path;

use equipoise_files::sha256_of;
use equipoise_studies::sensors::EPOCH_NS;

use crate::common::{describe_output, equipoise};
use crate::make::Script;

/// Estimated centre of pressure in x at each time, m, replayed with these options.
fn estimated_x_m<const N: usize>(recording: &Path, options: &[&str], times_s: [f64; N]) -> [f64; N] {
    let mut command = equipoise();
    let output = command.arg("replay").arg(recording).args(["--out", "-"]).args(options).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", describe_output(&output));
    let lines = String::from_utf8(output.stdout).unwrap();
    let states: Vec<serde_json::Value> =
        lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    times_s.map(|time_s| {
        let state = states.iter().find(|state| state["t"].as_f64().unwrap() >= time_s).unwrap();
        state["cop_estimated"][0].as_f64().unwrap_or_else(|| panic!("no estimate: {state}"))
    })
}

#[test]
fn an_effect_begins_at_its_time_of_the_recording() {
    let mut script = Script { poses: 3, work_s: 3.0, ..Script::ordinary() };
    script.rig.plate_hz = 200;
    let mut samples = script.samples();
    samples.suit.retain(|sample| sample.sample_time_ns >= EPOCH_NS + 6_000_000_000);
    let directory = tempfile::tempdir().unwrap();
    let (recording, model) = (directory.path().join("late.mcap"), directory.path().join("model.toml"));
    samples.write(&recording, &script.config());
    let text = format!(
        "version = 1\n[provenance]\nrecording_sha256 = \"{}\"\ndate = \"2026-03-01T08:30:00Z\"\nsubject = \"anon-1\"\n\
         station = \"test\"\nsoftware = \"0.1.0\"\nidentify_s = [0, 1]\nwork_s = [1, 2]\n[[effect]]\nname = \
         \"plate_offset\"\nspan_s = [10.0, 12.0]\nopen_ended = false\nlog_odds = 9.0\nparameters.dx_m = {{ value = 0.04, \
         sigma = 0.001, unit = \"m\" }}\n",
        sha256_of(&recording).unwrap()
    );
    std::fs::write(&model, text).unwrap();
    // Results follow the motion by less than 0.2 s.
    let times_s = [9.9, 10.25];
    let plain = estimated_x_m(&recording, &[], times_s);
    let with = estimated_x_m(&recording, &["--model", model.to_str().unwrap()], times_s);
    let [before_m, within_m] = [0, 1].map(|index| with[index] - plain[index]);
    assert!(before_m.abs() < 1e-3 && (0.03..0.05).contains(&within_m), "{before_m} {within_m}");
}
