//! Another process takes over only after the first is dead: a stopped process still holds the station, a dead one
//! releases it at once.

use equipoise_core::message::Incident;
use rustix::process::Signal;

use crate::adapters::{adapter, external};
use crate::eyes::Eyes;
use crate::station::{Station, ready};

#[test]
fn a_stopped_daemon_keeps_its_station_and_a_killed_one_leaves_it_at_once() {
    let station = Station::new();
    let mut first = station.daemon(&station.configuration());
    let pid = first.id();
    first.send(Signal::STOP);
    let mut second = station.try_daemon(&station.configuration());
    assert_eq!(second.wait().code(), Some(1));
    let said = second.stderr();
    assert!(said.contains(&format!("station bench already has a daemon: process {pid}")), "{said}");
    let remedy = format!("kill -CONT {pid}");
    assert!(said.contains(&remedy), "{said}");
    for command in [&["status"][..], &["tare"], &["watch", "--for", "1"]] {
        let refused = station.run(command);
        refused.failed_with(1, &["is stopped", &remedy]);
        assert!(!refused.stderr.contains("equipoise run"), "{}", refused.stderr);
    }
    // It can continue without any consequence.
    first.send(Signal::CONT);
    let mut eyes = Eyes::open(&station);
    eyes.until("cycles", |eyes| eyes.state.cycle > 0);
    drop(eyes);

    first.send(Signal::STOP);
    first.kill();
    let mut second = station.daemon(&station.configuration());
    assert_eq!(second.stop(Signal::TERM), Some(0), "{}", second.stderr());
}

#[test]
fn a_suit_and_a_plate_are_published_by_one_living_process_each() {
    let station = Station::new();
    let _person = station.person();
    let mut daemon = station.daemon(&external(&station));
    let mut eyes = Eyes::open(&station);
    let path = station.file("adapters.toml").display().to_string();
    for (stream, down) in [("suit", Incident::SuitAdapterDown), ("ground", Incident::GroundAdapterDown)] {
        let mut first = adapter(&station, stream);
        let named = format!("the {stream} of station bench is published by process {} already", first.id());
        station.run(&["adapter", stream, "--config", &path]).failed_with(1, &[&named, "external"]);
        first.send(Signal::STOP);
        station.run(&["adapter", stream, "--config", &path]).failed_with(1, &[&named]);
        first.kill();
        let mut second = adapter(&station, stream);
        eyes.until("nothing to be missed", |eyes| !eyes.goes_on(down));
        second.kill();
        eyes.until("the adapter to be missed", |eyes| eyes.goes_on(down));
        let _third = adapter(&station, stream);
        eyes.until("the adapter to be there", |eyes| !eyes.goes_on(down));
    }
    assert!(daemon.is_running());
}

#[test]
fn a_daemon_with_internal_adapters_and_a_separate_adapter_exclude_each_other() {
    let station = Station::new();
    let _person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let path = station.write("adapters.toml", &station.configuration()).display().to_string();
    for stream in ["suit", "ground"] {
        let named = format!("the {stream} of station bench is published by process {} already", daemon.id());
        station.run(&["adapter", stream, "--config", &path]).failed_with(1, &[&named]);
    }
    assert_eq!(daemon.stop(Signal::TERM), Some(0));

    for stream in ["suit", "ground"] {
        let mut alone = adapter(&station, stream);
        let mut daemon = station.try_daemon(&station.configuration());
        assert_eq!(daemon.wait().code(), Some(1));
        let said = daemon.stderr();
        let named = format!("the {stream} of station bench is published by process {} already", alone.id());
        assert!(said.contains(&named) && !said.contains("panicked"), "{said}");
        alone.kill();
        let mut daemon = ready(station.try_daemon(&station.configuration()));
        assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
    }
}
