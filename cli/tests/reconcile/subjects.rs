//! A model is that of one worker, so only the part of one worker of a recording is used.

use equipoise_config::Config;
use equipoise_core::cycle::Memory;
use equipoise_discrepancy::spans::Given;
use equipoise_discrepancy::workflow::{Compared, Reconcile};
use equipoise_recording::replay::input::Input;
use equipoise_studies::sensors::EPOCH_NS;

use crate::make::Script;

/// Time at which the second worker begins, s.
const CHANGE_S: f64 = 28.0;

#[test]
fn a_recording_of_several_workers_needs_spans_of_one() {
    let mut script = Script { work_s: 20.0, ..Script::ordinary() };
    script.rig.plate_hz = 200;
    let mut samples = script.samples();
    samples.later_subject = Some((EPOCH_NS + (CHANGE_S * 1e9) as u64, "anon-2"));
    let mut first = bytemuck::zeroed_box::<Memory>();
    first.start(&Config::parse(&script.config(), "test").unwrap().settings());
    (first.identification.identified, first.identification.mass_kg) = (1, 99.0);
    let directory = tempfile::tempdir().unwrap();
    let recording = directory.path().join("workers.mcap");
    samples.write_from(&recording, &script.config(), EPOCH_NS, Some(&first));
    let input = Input::open(&recording).unwrap();
    let compared = |id: &str, identify: Option<&str>, work: Option<&str>| -> Result<Compared, String> {
        let config = Config::parse(&script.config().replace("anon-1", id), "test").unwrap();
        let [identify, work] = [identify, work].map(|span| span.map(|span| span.parse().unwrap()));
        let given = Given { identify, work, ..Given::default() };
        let reconcile = Reconcile { input: &input, config: &config, given };
        reconcile.compare(&mut |_| {}).map_err(|error| format!("{error:#}"))
    };
    for (identify, work) in [(None, None), (Some("0:20"), Some("30:50")), (None, Some("20:40"))] {
        let refusal = compared("anon-1", identify, work).unwrap_err();
        let workers =
            "of several workers, and a model is of one: anon-1 until 28.0 s, then anon-2; give --identify";
        assert!(refusal.contains(workers), "{refusal}");
    }
    let refusal = compared("anon-1", Some("28.5:44"), Some("46:60")).unwrap_err();
    assert!(
        refusal.contains("the worker of the given spans is anon-2, and the configuration is anon-1's"),
        "{refusal}"
    );

    for (id, identify, work) in
        [("anon-1", "0:16", None), ("anon-1", "0:16", Some("18:27.5")), ("anon-2", "28.5:44", None)]
    {
        let result = compared(id, Some(identify), work).unwrap();
        let is_second = id == "anon-2";
        let times_s = result.session.blocks.iter().map(|block| block.observation.time_s);
        let [from_s, to_s] = if is_second { [CHANGE_S, script.length_s()] } else { [0.0, CHANGE_S] };
        assert!(times_s.clone().count() > 20);
        assert!(times_s.clone().all(|time_s| (from_s..to_s).contains(&time_s)), "{id} {identify}");
    }
    // The memory in the recording is of the first worker.
    let result = compared("anon-2", None, Some("44:60")).unwrap();
    assert!(!result.spans.description.contains("identified before the recording began"));
    assert!((result.session.mass_kg - script.subject.mass_kg).abs() < 1e-9, "{}", result.session.mass_kg);
}
