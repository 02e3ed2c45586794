//! Two stations of one computer share the state directory: each subject is saved by one of them.

use equipoise_core::message::Incident;
use equipoise_simulator::ports::free_address;
use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::{NAME, Station};

const OTHER: &str = "bench-2";

#[test]
fn a_subject_in_use_at_one_station_is_not_used_at_another() {
    let station = Station::new();
    let person = station.person();
    let mut first = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    wait_for("a profile", || station.profile("anon-1").exists().then_some(()));
    let load = |id: &str, at: &str| station.run(&["subject", "load", id, "--station", at]);

    // Both files name the same subject, as the examples do.
    let free = || free_address().expect("a free port").to_string();
    let configuration = station.configuration().replace(NAME, OTHER);
    let configuration = configuration.replace(&station.suit.to_string(), &free());
    let configuration = configuration.replace(&station.plate.to_string(), &free());
    let mut second = station.daemon(&configuration);
    let in_use =
        format!("in use at another station of this computer: station {NAME} (process {})", first.id());
    assert!(second.stderr().contains(&in_use), "{}", second.stderr());
    wait_for("the incident of the second station", || {
        let status = station.run(&["status", "--json", "--station", OTHER]);
        let status: serde_json::Value = serde_json::from_str(&status.stdout).ok()?;
        let message = status["daemon"]["incidents"]["not_saved"].as_str()?.to_owned();
        message.contains(&in_use).then_some(())
    });
    load("anon-1", OTHER).assert_failed(1, &[&in_use, "load another subject there first"]);
    assert!(!monitor.is_active(Incident::NotSaved));

    station.copy_profile("anon-1", "anon-2", |_| {});
    load("anon-2", NAME).assert_done();
    wait_for("the first subject to be released", || (load("anon-1", OTHER).code == Some(0)).then_some(()));
    load("anon-1", NAME).assert_failed(1, &[&format!("station {OTHER} (process {})", second.id())]);
    // A killed daemon releases its subject, too.
    second.kill();
    load("anon-1", NAME).assert_done();
    assert_eq!(first.stop(Signal::TERM), Some(0));
    assert!(!station.state_directory().join("subjects/anon-1.lock").exists());
}
