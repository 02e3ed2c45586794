//! Another process takes over only after the first is dead: a stopped process still holds the station, a dead one
//! releases it at once.

use equipoise_core::message::Incident;
use rustix::process::Signal;

use crate::adapters::{adapter, external};
use crate::monitor::Monitor;
use crate::station::{Station, ready};

#[test]
fn a_stopped_daemon_holds_its_station_and_a_killed_one_releases_it() {
    let station = Station::new();
    let mut first = station.daemon(&station.configuration());
    let pid = first.id();
    first.send(Signal::STOP);
    let mut second = station.try_daemon(&station.configuration());
    assert_eq!(second.wait().code(), Some(1));
    let message = second.stderr();
    assert!(message.contains(&format!("station bench already has a daemon: process {pid}")), "{message}");
    let remedy = format!("kill -CONT {pid}");
    assert!(message.contains(&remedy), "{message}");
    for command in [&["status"][..], &["tare"], &["watch", "--for", "1"]] {
        let refused = station.run(command);
        refused.assert_failed(1, &["is stopped", &remedy]);
        assert!(!refused.stderr.contains("equipoise run"), "{}", refused.stderr);
    }
    // It can continue without any consequence.
    first.send(Signal::CONT);
    let mut monitor = Monitor::open(&station);
    monitor.until("cycles", |monitor| monitor.state.cycle > 0);
    drop(monitor);

    first.send(Signal::STOP);
    first.kill();
    let mut second = station.daemon(&station.configuration());
    assert_eq!(second.stop(Signal::TERM), Some(0), "{}", second.stderr());
}

#[test]
fn a_suit_and_a_plate_are_published_by_one_running_process_each() {
    let station = Station::new();
    let _person = station.person();
    let mut daemon = station.daemon(&external(&station));
    let mut monitor = Monitor::open(&station);
    let path = station.file("adapters.toml").display().to_string();
    for (stream, down) in [("suit", Incident::SuitAdapterDown), ("ground", Incident::GroundAdapterDown)] {
        let mut first = adapter(&station, stream);
        let named = format!("the {stream} of station bench is published by process {} already", first.id());
        station.run(&["adapter", stream, "--config", &path]).assert_failed(1, &[&named, "external"]);
        first.send(Signal::STOP);
        station.run(&["adapter", stream, "--config", &path]).assert_failed(1, &[&named]);
        first.kill();
        let mut second = adapter(&station, stream);
        monitor.until("nothing to be missed", |monitor| !monitor.is_active(down));
        second.kill();
        monitor.until("the adapter to be missed", |monitor| monitor.is_active(down));
        let _third = adapter(&station, stream);
        monitor.until("the adapter to be there", |monitor| !monitor.is_active(down));
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
        station.run(&["adapter", stream, "--config", &path]).assert_failed(1, &[&named]);
    }
    assert_eq!(daemon.stop(Signal::TERM), Some(0));

    for stream in ["suit", "ground"] {
        let mut separate = adapter(&station, stream);
        let mut daemon = station.try_daemon(&station.configuration());
        assert_eq!(daemon.wait().code(), Some(1));
        let message = daemon.stderr();
        let named =
            format!("the {stream} of station bench is published by process {} already", separate.id());
        assert!(message.contains(&named) && !message.contains("panicked"), "{message}");
        separate.kill();
        let mut daemon = ready(station.try_daemon(&station.configuration()));
        assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
    }
}
