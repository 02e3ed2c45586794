//! Adapters as processes of their own, and their deaths.

use equipoise_core::message::Validity;
use rustix::process::Signal;

use crate::ending::assert_nothing_left;
use crate::eyes::Eyes;
use crate::process::{Process, wait_for};
use crate::station::Station;

/// The same station for the daemon: both sources come from elsewhere.
pub(crate) fn external(station: &Station) -> String {
    station.configuration().replace("\"mvn-udp\"", "\"external\"").replace("\"ati-rdt\"", "\"external\"")
}

pub(crate) fn adapter(station: &Station, stream: &str) -> Process {
    let path = station.write("adapters.toml", &station.configuration()).display().to_string();
    let mut process = station.spawn(&["adapter", stream, "--config", &path]);
    wait_for("the adapter to run", || {
        assert!(process.is_running(), "it ended: {}", process.stderr());
        process.stderr().contains("adapter runs").then_some(())
    });
    process
}

#[test]
fn a_killed_adapter_is_seen_as_silence_and_its_successor_is_heard() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&external(&station));
    let mut eyes = Eyes::open(&station);
    eyes.until("cycles", |eyes| eyes.state.cycle > 10);
    assert_eq!(eyes.reasons()[..2], ["suit_stale", "ground_stale"]);

    let [mut suit, mut ground] = ["suit", "ground"].map(|stream| adapter(&station, stream));
    eyes.until_poses(&person, 1);
    let learnt = eyes.state.poses_used;
    for _ in 0..2 {
        suit.kill();
        eyes.until("the suit's silence", |eyes| eyes.has(Validity::SUIT_STALE));
        suit = adapter(&station, "suit");
        eyes.until("the suit again", Eyes::both_fresh);
        ground.kill();
        eyes.until("the plate's silence", |eyes| eyes.has(Validity::GROUND_STALE));
        ground = adapter(&station, "ground");
        eyes.until("the plate again", Eyes::both_fresh);
    }
    assert!(eyes.state.poses_used >= learnt);
    eyes.until_poses(&person, learnt + 1);
    let status = station.status().expect("the daemon answers");
    assert_eq!(status["adapters"][0]["process_id"], suit.id(), "{status}");
    assert_eq!(status["adapters"][1]["process_id"], ground.id(), "{status}");

    // The daemon dies instead: the adapters go on and are heard by the next one.
    daemon.kill();
    let mut daemon = station.daemon(&external(&station));
    let old = eyes.state.cycle;
    eyes.until("both sensors in the new daemon", |eyes| eyes.state.cycle != old && eyes.both_fresh());

    drop(eyes);
    for process in [&mut suit, &mut ground, &mut daemon] {
        assert_eq!(process.stop(Signal::TERM), Some(0), "{}", process.stderr());
    }
    assert_nothing_left(&station);
}

#[test]
fn an_adapter_given_the_daemon_s_configuration_says_so() {
    let station = Station::new();
    let path = station.write("daemon.toml", &external(&station)).display().to_string();
    for stream in ["suit", "ground"] {
        let sentence = format!("{stream}.source is \"external\" in this file");
        station.run(&["adapter", stream, "--config", &path]).failed_with(1, &[&sentence]);
    }
}
