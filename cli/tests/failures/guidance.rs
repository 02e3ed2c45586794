//! The running daemon suggests the pose requested by a model file until the worker has held it.

use std::time::{Duration, Instant};

use equipoise_bus::{Bus, BusSettings, Subscriber};
use equipoise_core::message::State;
use equipoise_core::message::state::Phase;
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_simulator::ports::free_address;
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::Simulation;

use crate::common::{Station, describe_output};
use crate::process::{TIMEOUT, wait_for};

const WANTED: usize = 1;
const BETWEEN: &str = "to tell hand_load right from worn_mass T8";

#[track_caller]
fn until(states: &mut Subscriber<State>, what: &str, is_so: impl Fn(&State) -> bool) -> State {
    let started = Instant::now();
    loop {
        if let Some(state) = states.latest().unwrap().filter(|state| is_so(state)) {
            return state;
        }
        assert!(started.elapsed() < TIMEOUT, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_daemon_requests_the_pose_of_its_model_file_until_it_was_held() {
    let suit = free_address().unwrap();
    let mut settings = SimulationSettings::default();
    settings.suit.target = suit;
    settings.plate.address = "127.0.0.1:0".parse().unwrap();
    settings.plate.rate_hz = 250.0;
    let simulation = Simulation::start(settings).unwrap();
    let config = format!(
        "station = \"test\"\n[loop]\nrate_hz = 200\npriority = 0\nlock_memory = false\n[suit]\nsource = \"mvn-udp\"\nlisten = \
         \"{suit}\"\n[ground]\nsource = \"ati-rdt\"\naddress = \"{}\"\ncounts_per_newton = \
         1000000\ncounts_per_newton_metre = 1000000\n[subject]\nid = \"anon-1\"\nheight_m = 1.77\nmass_kg = 72\n",
        simulation.plate_address()
    );
    let directory = tempfile::tempdir().unwrap();
    let model = directory.path().join("model.toml");
    let pose = LIBRARY[WANTED].name;
    let text = format!(
        "version = 1\n[ask]\nbetween = [\"hand_load right\", \"worn_mass T8\"]\npose = \"{pose}\"\nseparation_sigma = 4.0\n"
    );
    std::fs::write(&model, text).unwrap();
    let station = Station::start_with(&config, &["--model", model.to_str().unwrap()], |_| {});
    let root = station.file("bus");
    let bus = Bus::join(&BusSettings { station: "test".to_owned(), role: "test".to_owned(), root }).unwrap();
    let mut states = bus.subscriber::<State>(1).unwrap();

    until(&mut states, "identification", |state| state.phase == Phase::Identifying as u32);
    let run = |arguments: &[&str]| {
        let output = station.command(arguments[0]).args(&arguments[1..]).output().unwrap();
        assert!(output.status.success(), "{}", describe_output(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    run(&["identify", "stop"]);
    until(&mut states, "the pose that is asked for", |state| state.suggested_pose == WANTED as u32);
    // Right after the start the body is unknown, and the status says that first. Compare words, independent of line
    // breaks.
    wait_for("the pose in the status", || {
        let output = run(&["status"]).split_whitespace().collect::<Vec<_>>().join(" ");
        output.contains(&format!("Take this pose: {pose}, {BETWEEN}")).then_some(())
    });
    // A fault of a sensor takes the pose's place.
    wait_for("the pose in a line of watch", || {
        run(&["watch", "--for", "0.5"]).contains(BETWEEN).then_some(())
    });

    simulation.take_pose(WANTED).unwrap();
    until(&mut states, "its end", |state| state.suggested_pose == u32::MAX);
    assert!(!run(&["status"]).contains(BETWEEN));
}
