//! The suit's null pose over the wire: the worker's segment lengths and soles, in status, recording and replay.

use std::path::Path;
use std::time::{Duration, Instant};

use equipoise_adapters::recording::{Entry, Recording};
use equipoise_core::body::Side;
use equipoise_core::cycle::{BodyRejection, BodySource};
use equipoise_core::message::suit_body::FootPoint;
use equipoise_recording::replay::Replay;
use equipoise_recording::replay::input::Input;
use equipoise_simulator::person::Person;
use equipoise_simulator::ports::free_address;
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::Simulation;

use crate::common::{Station, describe_output, equipoise};

const CONFIG: &str = r#"
station = "test"
[loop]
lock_memory = false
[suit]
source = "mvn-udp"
listen = "SUIT"
[ground]
source = "ati-rdt"
address = "PLATE"
counts_per_newton = 1000000
counts_per_newton_metre = 1000000
[subject]
id = "anon-1"
height_m = 1.77
"#;

/// Output of `status --json` with a current pose, once the segment lengths are those of the null pose, which the suit sends
/// once a second.
fn state_of(station: &Station) -> serde_json::Value {
    let started = Instant::now();
    loop {
        let output = station.command("status").arg("--json").output().unwrap();
        if let Ok(status) = serde_json::from_slice::<serde_json::Value>(&output.stdout)
            && status["state"]["body_source"] == "null_pose"
            && status["state"].get("suit_com").is_some()
        {
            return status["state"].clone();
        }
        assert!(started.elapsed() < Duration::from_secs(60), "{}", describe_output(&output));
        std::thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn segments_and_foot_outlines_are_those_of_the_suit() {
    let suit = free_address().unwrap();
    let mut settings = SimulationSettings::default();
    settings.suit.target = suit;
    settings.plate.address = "127.0.0.1:0".parse().unwrap();
    let person = Person::new(settings.seed, settings.height_m, settings.mass_kg);
    let simulation = Simulation::start(settings).unwrap();
    let config =
        CONFIG.replace("SUIT", &suit.to_string()).replace("PLATE", &simulation.plate_address().to_string());
    let station = Station::start(&config);
    let state = state_of(&station);
    assert_eq!(state["foot_outline_source"], "suit", "{state}");
    assert!(state.get("body_rejected").is_none(), "{state}");
    let output = station.command("status").output().unwrap();
    assert!(
        describe_output(&output).contains("body    from the suit's null pose; soles from the suit's"),
        "{}",
        describe_output(&output)
    );

    // A recorder that starts late still receives the body, and the replay applies it at the same cycle as the loop.
    let out = station.file("live.mcap");
    let recorded = station.command("record").arg(&out).args(["--for", "8"]).output().unwrap();
    assert!(matches!(recorded.status.code(), Some(0 | 3)), "{}", describe_output(&recorded));
    assert_recorded_outlines(&out, &person);
    assert_replayed_body(&out);
    let lines = station.file("live.jsonl");
    let output = equipoise().arg("replay").arg(&out).arg("--out").arg(&lines).output().unwrap();
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", describe_output(&output));
    let lines = std::fs::read_to_string(lines).unwrap();
    assert!(lines.lines().last().unwrap().contains(r#""suit_com":["#), "the suit's own centre is published");
}

fn assert_recorded_outlines(recording: &Path, person: &Person) {
    let recording = Recording::open(recording).unwrap();
    let (mut bodies, mut taken) = (Vec::new(), 0);
    for timed in recording.entries().map_while(Result::ok) {
        match timed.entry {
            Entry::Body(body) => bodies.push(*body),
            Entry::Cycle(record) => taken += u32::from(record.body_published_ns > 0),
            _ => {}
        }
    }
    assert!(bodies.len() >= 2 && taken >= 2, "{} bodies, taken in by {taken} cycles", bodies.len());
    for side in Side::BOTH {
        let heel = bodies[0].foot_point_m(side, FootPoint::Heel).unwrap();
        let tip = bodies[0].foot_point_m(side, FootPoint::ToeTip).unwrap();
        assert!(
            (heel.x + person.foot_outline_m.back).abs() < 1e-6
                && (tip.x - person.foot_outline_m.forward).abs() < 1e-6
        );
    }
}

/// As recorded and recomputed.
fn assert_replayed_body(recording: &Path) {
    let input = Input::open(recording).unwrap();
    let chosen = input.configuration(None).unwrap();
    for as_recorded in [true, false] {
        let replay = Replay { input: &input, config: &chosen.config, as_recorded, residual_s: None };
        let mut last = None;
        let summary = replay
            .run_with(|state| {
                last = Some(*state);
                Ok(())
            })
            .unwrap();
        let last = last.unwrap();
        let body =
            (BodySource::from_number(last.body_source), BodyRejection::from_number(last.body_rejected));
        assert_eq!(body, (Some(BodySource::NullPose), Some(BodyRejection::None)), "{summary}");
        if as_recorded {
            let fidelity = summary.fidelity.clone().unwrap();
            assert_eq!((fidelity.states_differing, fidelity.memories_differing), (0, 0), "{summary}");
            assert!(fidelity.states_compared > 500, "{summary}");
        }
    }
}
