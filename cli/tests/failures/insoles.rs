//! Insoles in place of a plate, over the wire: located by the suit's feet, and without quantities that they cannot
//! measure.

use std::time::{Duration, Instant};

use equipoise_simulator::devices::line::Line;
use equipoise_simulator::devices::load::{Ground, Mounting};
use equipoise_simulator::devices::moticon::Moticon;
use equipoise_simulator::devices::running::{Pace, Running};
use equipoise_simulator::devices::udp::UdpPort;
use equipoise_simulator::noise::SuitNoise;
use equipoise_simulator::person::Person;
use equipoise_simulator::ports::free_address;
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::Simulation;
use equipoise_simulator::wires::moticon::ALL;

use crate::common::{Station, describe_output};
use serde_json::Value;

/// Upper limit of the error of the measured CoP, m: the person's sway between two reads.
const PLACED_M: f64 = 0.015;

/// The state, once it fulfils `condition`.
fn until(station: &Station, what: &str, condition: impl Fn(&Value) -> bool) -> Value {
    let started = Instant::now();
    loop {
        let output = station.command("status").arg("--json").output().unwrap();
        if let Ok(status) = serde_json::from_slice::<Value>(&output.stdout)
            && condition(&status["state"])
        {
            return status["state"].clone();
        }
        assert!(started.elapsed() < Duration::from_secs(90), "{what}: {}", describe_output(&output));
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn names(state: &Value, key: &str) -> Vec<String> {
    serde_json::from_value(state[key].clone()).unwrap_or_default()
}

#[test]
fn a_subject_is_identified_with_insoles_and_unavailable_quantities_are_reported() {
    let (suit, insoles) = (free_address().unwrap(), free_address().unwrap());
    let mut settings = SimulationSettings::default();
    settings.suit.target = suit;
    // The suit's position is exact here: the remaining error is the person's sway between two reads.
    settings.suit.noise = SuitNoise::NONE;
    settings.plate.address = "127.0.0.1:0".parse().unwrap();
    let person = Person::new(settings.seed, settings.height_m, settings.mass_kg);
    let simulation = Simulation::start(settings).unwrap();
    let size_m =
        [person.foot_outline_m.back + person.foot_outline_m.forward, 2.0 * person.foot_outline_m.half_width];
    let line = Line::new(Box::new(UdpPort::to(insoles).unwrap()), 1);
    let device = Moticon::new(line, &ALL, 100.0, size_m);
    let pace = Pace { start_ns: simulation.start_ns(), ..Pace::default() };
    let running =
        Running::start(Box::new(device), Ground::One(Mounting::default()), simulation.load(), pace).unwrap();
    let config = format!(
        "station = \"test\"\n[loop]\nlock_memory = false\n[suit]\nsource = \"mvn-udp\"\nlisten = \"{suit}\"\n{}\n\
         [subject]\nid = \"anon-1\"\nheight_m = 1.77\n",
        running.config()
    );
    let station = Station::start(&config);

    let state = until(&station, "the suit's soles", |state| {
        state["foot_outline_source"] == "suit" && state.get("cop_measured").is_some()
    });
    assert_eq!(names(&state, "ground_devices"), ["insoles"], "{state}");
    assert_eq!(names(&state, "unavailable"), ["shear"], "{state}");
    assert!(state.get("ground_force_n").is_none(), "no device measures the horizontal force: {state}");
    let weight_n = 9.81 * 72.0;
    assert!((state["vertical_force_n"].as_f64().unwrap() - weight_n).abs() < 0.05 * weight_n, "{state}");
    let truth = simulation.truth();
    for axis in 0..2 {
        let measured_m = state["cop_measured"][axis].as_f64().unwrap();
        assert!((measured_m - truth.cop_m[axis]).abs() < PLACED_M, "{measured_m} {}", truth.cop_m[axis]);
    }
    // Static poses are used for identification as on a plate.
    until(&station, "a pose", |state| {
        state["poses_used"].as_u64() >= Some(1) && state["phase"] == "identifying"
    });

    simulation.silence_suit(true);
    until(&station, "the silence, with the vertical force alone", |state| {
        let reasons = names(state, "valid");
        ["suit_stale", "cop_not_measured"].iter().all(|reason| reasons.iter().any(|raised| raised == reason))
            && state.get("cop_measured").is_none()
            && state.get("vertical_force_n").is_some()
    });
    simulation.silence_suit(false);
    until(&station, "the suit again", |state| state.get("cop_measured").is_some());
}
