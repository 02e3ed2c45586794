//! Named effects are written to a model file, and effects of a model file are not reported again; a recording may
//! contain an identified worker.

use std::path::Path;

use equipoise_config::Config;
use equipoise_config::model::LoadedModel;
use equipoise_core::cycle::Memory;
use equipoise_discrepancy::block::Phase;
use equipoise_discrepancy::spans::Given;
use equipoise_discrepancy::workflow::{Compared, Reconcile};
use equipoise_files::sha256_of;
use equipoise_recording::replay::input::Input;
use equipoise_studies::sensors::EPOCH_NS;
use serde_json::Value;

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
    assert!(loaded.found.description.contains("the worker was identified before the recording began"));
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
