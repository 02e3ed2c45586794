//! Samples are recorded without the tare, which only a checkpoint contains: every evaluation applies it.

use bytemuck::Zeroable;
use equipoise_config::Config;
use equipoise_core::cycle::memory::MEMORY_VERSION;
use equipoise_core::cycle::{Memory, Tare};
use equipoise_discrepancy::spans::Given;
use equipoise_discrepancy::workflow::Reconcile;
use equipoise_recording::replay::cross_validation::identify_without;
use equipoise_recording::replay::input::Input;
use equipoise_studies::sensors::EPOCH_NS;

use crate::common::{describe_output, equipoise};
use crate::make::Script;

#[test]
fn a_tare_before_the_recording_is_applied() {
    let mut script = Script { work_s: 20.0, ..Script::ordinary() };
    script.rig.plate_hz = 200;
    let tare = Tare { force_n: [0.0, 0.0, 140.0], ..Tare::zeroed() };
    let mut samples = script.samples();
    for sample in &mut samples.ground {
        sample.force_n[2] += tare.force_n[2];
    }
    // The plate weighs the worker.
    let mass_kg = script.subject.mass_kg;
    let text = script.config().replace(&format!("mass_kg = {mass_kg}\n"), "");
    let config = Config::parse(&text, "test").unwrap();
    assert_eq!(config.subject.mass_kg, None);
    let mut memory = bytemuck::zeroed_box::<Memory>();
    memory.start(&config.settings());
    memory.resume_tare(&tare);
    let directory = tempfile::tempdir().unwrap();
    let recording = directory.path().join("tared.mcap");
    samples.write_from(&recording, &text, EPOCH_NS, Some(&memory));

    let input = Input::open(&recording).unwrap();
    let compared = Reconcile { input: &input, config: &config, given: Given::default() };
    let compared = compared.compare(&mut |_| {}).unwrap();
    let validated = identify_without(&input, &config, [0, 0]).unwrap();
    for found_kg in [compared.session.mass_kg, validated.mass_kg] {
        assert!((found_kg - mass_kg).abs() < 2.0, "{found_kg} {mass_kg}");
    }
    assert!(compared.skipped.rejected.is_empty(), "{:?}", compared.skipped);
}

#[test]
fn a_memory_of_another_release_is_reported_as_missing() {
    let mut script = Script { work_s: 20.0, ..Script::ordinary() };
    script.rig.plate_hz = 200;
    let mut memory = bytemuck::zeroed_box::<Memory>();
    memory.start(&Config::parse(&script.config(), "test").unwrap().settings());
    memory.version = MEMORY_VERSION + 1;
    let directory = tempfile::tempdir().unwrap();
    let recording = directory.path().join("older.mcap");
    script.samples().write_from(&recording, &script.config(), EPOCH_NS, Some(&memory));
    let output = equipoise().arg("reconcile").arg(&recording).output().unwrap();
    let text = describe_output(&output);
    assert_eq!(output.status.code(), Some(3), "{text}");
    for phrase in ["another version of Equipoise made it", "tare and the worker from before it are missing"] {
        assert!(text.contains(phrase), "{text}");
    }
}
