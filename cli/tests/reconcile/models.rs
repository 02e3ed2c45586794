//! Named effects are written to a model file, and effects of a model file are not reported again; a recording may
//! contain an identified worker.

use std::path::Path;

use equipoise_config::Config;
use equipoise_config::model::LoadedModel;
use equipoise_config::model_file::Fitted;
use equipoise_core::cycle::Memory;
use equipoise_discrepancy::block::Phase;
use equipoise_discrepancy::spans::Given;
use equipoise_discrepancy::workflow::{Compared, Reconcile};
use equipoise_files::sha256_of;
use equipoise_recording::replay::input::Input;
use equipoise_studies::sensors::EPOCH_NS;
use serde_json::Value;

use crate::common::{describe_output, equipoise};
use crate::make::{Script, reconciled};

fn compared(recording: &Path, config: &str, given: Given) -> Compared {
    let input = Input::open(recording).unwrap();
    let config = Config::parse(config, "test").unwrap();
    Reconcile { input: &input, config: &config, given }.compare(&mut |_| {}).unwrap()
}

#[test]
fn a_load_in_the_hands_is_written_to_the_model_and_then_compensated() {
    let mut script = Script { carried_kg: 3.0, work_s: 60.0, ..Script::ordinary() };
    script.rig.plate_hz = 200;
    let directory = tempfile::tempdir().unwrap();
    let (recording, out) = (directory.path().join("shift.mcap"), directory.path().join("out"));
    script.samples().write(&recording, &script.config());
    let found = reconciled(&recording, &["--out", out.to_str().unwrap()]);
    assert_ne!(found["verdict"], "none", "{found}");
    assert_eq!(found["effects"][0]["name"], "hand_load", "{found}");
    let model = out.join("model.toml");
    assert_eq!(found["model"].as_str(), model.to_str());
    let written = LoadedModel::read(&model).unwrap().file().clone();
    assert!(written.is_of(&sha256_of(&recording).unwrap()) && !written.effects.is_empty());
    let again = reconciled(&recording, &["--model", model.to_str().unwrap()]);
    let before = |found: &Value| found["gap"]["before_mm"].as_f64().unwrap();
    let (unknown_mm, known_mm) = (before(&found), before(&again));
    assert!(known_mm < 0.5 * unknown_mm, "{known_mm} {unknown_mm}");

    // An engineer knows better: the effects stay in the file, are not applied, and others are found in their place.
    let rejected: Vec<String> = written.effects.iter().map(Fitted::name).collect();
    for (index, name) in rejected.iter().enumerate() {
        let number = (index + 1).to_string();
        let reviewed =
            model_command(&["reject", model.to_str().unwrap(), &number, "--reason", "no box was there"]);
        assert_eq!(reviewed, format!("{name} is rejected in {}\n", model.display()));
    }
    // The verdicts are not replaced by a new result without them.
    let verdicts = std::fs::read_to_string(&model).unwrap();
    let mut lost = equipoise();
    lost.arg("reconcile").arg(&recording).arg("--out").arg(&out);
    let lost = lost.output().unwrap();
    assert_eq!(lost.status.code(), Some(1), "{}", describe_output(&lost));
    let refusal = String::from_utf8_lossy(&lost.stderr).into_owned();
    assert!(
        refusal.contains("contains an engineer's verdict on ") && refusal.contains("--model"),
        "{refusal}"
    );
    assert_eq!(std::fs::read_to_string(&model).unwrap(), verdicts);
    let path = model.to_str().unwrap();
    let without = reconciled(&recording, &["--model", path, "--out", out.to_str().unwrap()]);
    let kept = LoadedModel::read(&model).unwrap();
    assert_eq!(kept.file().rejected().count(), rejected.len());
    // Not equal: what the clean parts predict for the work depends on the effects that are assumed.
    assert!((before(&without) / unknown_mm - 1.0).abs() < 0.02, "{} {unknown_mm}", before(&without));
    let names = |found: &Value| -> Vec<String> {
        let all = ["effects", "candidates", "set_aside"].map(|list| found[list].as_array().unwrap().clone());
        all.concat().iter().map(full_name).collect()
    };
    for name in &rejected {
        assert!(names(&found).contains(name) && !names(&without).contains(name), "{name}: {without}");
    }
    assert!(!without["candidates"].as_array().unwrap().is_empty(), "{without}");
}

/// Name with place, of an effect or a candidate.
fn full_name(named: &Value) -> String {
    let place = ["hand", "segment"].iter().find_map(|key| named["where"][key].as_str());
    let name = named["name"].as_str().unwrap();
    place.map_or(name.to_owned(), |place| format!("{name} {place}"))
}

/// What `equipoise model` prints.
fn model_command(arguments: &[&str]) -> String {
    let output = equipoise().arg("model").args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", describe_output(&output));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn models_of_two_sessions_become_one_that_the_loop_can_run() {
    let directory = tempfile::tempdir().unwrap();
    let paths = ["monday.toml", "tuesday.toml", "both.toml"].map(|name| directory.path().join(name));
    let [monday, tuesday, both] = paths.each_ref().map(|path| path.to_str().unwrap());
    for (path, sha, mass_kg) in [(monday, "11", 2.0), (tuesday, "22", 2.2)] {
        let sha = sha.repeat(32);
        let text = format!(
            "version = 1\n[provenance]\nrecording_sha256 = \"{sha}\"\ndate = \"2026-03-01T08:30:00Z\"\nsubject = \
             \"anon-1\"\nstation = \"station-1\"\nsoftware = \"0.1.0\"\nidentify_s = [0, 90]\nwork_s = [90, 600]\n\
             [[effect]]\nname = \"worn_mass\"\nwhere = {{ segment = \"T8\" }}\nspan_s = [100, 600]\nopen_ended = \
             true\nlog_odds = 40.0\n[effect.parameters.mass_kg]\nvalue = {mass_kg}\nsigma = 0.2\nunit = \"kg\"\n"
        );
        std::fs::write(path, text).unwrap();
    }
    model_command(&["confirm", monday, "1", "--reason", "a tool vest, weighed", "--by", "eng-3"]);
    let shown = model_command(&["show", monday]);
    assert!(shown.contains(" 1  worn_mass T8, log odds 40: mass_kg 2.00 ± 0.20"), "{shown}");
    assert!(shown.contains("confirmed ") && shown.contains(" by eng-3: a tool vest, weighed"), "{shown}");

    let merged = model_command(&["merge", monday, tuesday, "--out", both]);
    assert!(merged.contains("worn_mass T8, log odds 80: mass_kg 2.10 ± 0.14"), "{merged}");
    let loaded = LoadedModel::read(Path::new(both)).unwrap();
    assert_eq!(loaded.model().terms[0].unwrap().value[0], 2.1);
    let again = equipoise().args(["model", "merge", monday, tuesday, "--out", both]).output().unwrap();
    assert!(String::from_utf8_lossy(&again.stderr).contains("both.toml exists already"), "{again:?}");
    let unknown =
        equipoise().args(["model", "reject", monday, "plate_yaw", "--reason", "x"]).output().unwrap();
    let said = String::from_utf8_lossy(&unknown.stderr).into_owned();
    assert!(said.contains("no effect is called `plate_yaw`; it has: worn_mass T8"), "{said}");
}

#[test]
fn a_subject_identified_before_the_recording_is_not_identified_again() {
    let mut script = Script { work_s: 25.0, ..Script::ordinary() };
    script.rig.plate_hz = 200;
    let samples = script.samples();
    let directory = tempfile::tempdir().unwrap();
    let [whole, work] = ["whole.mcap", "work.mcap"].map(|name| directory.path().join(name));
    samples.write(&whole, &script.config());
    let stored = compared(&whole, &script.config(), Given::default());
    let mut memory = bytemuck::zeroed_box::<Memory>();
    memory.start(&Config::parse(&script.config(), "test").unwrap().settings());
    memory.identification = *stored.identified.worker;
    // Only the work, as recorded by a station with the identified worker.
    let from_ns = EPOCH_NS + (script.poses_end_s() * 1e9) as u64;
    samples.write_from(&work, &script.config(), from_ns, Some(&memory));

    let loaded = compared(&work, &script.config(), Given::default());
    assert!(loaded.spans.description.contains("the worker was identified before the recording began"));
    assert!(loaded.session.blocks.len() > 80, "{}", loaded.session.blocks.len());
    assert!(loaded.session.blocks.iter().all(|block| block.phase == Phase::Work));
    let [phi, again] = [&stored, &loaded].map(|one| one.session.blocks[0].observation.phi_m);
    assert_eq!(phi, again);
    // An explicit identification span replaces the subject identified before.
    let given = Given { identify: Some("0:12".parse().unwrap()), ..Given::default() };
    let identified = compared(&work, &script.config(), given);
    assert_ne!(identified.session.blocks[0].observation.phi_m, phi);
    assert_eq!(identified.session.spans_s.identify, [0.0, 12.0]);
}
