//! An orderly end.

use std::os::unix::fs::MetadataExt;

use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::station::Station;

/// Nothing of the bus remains except the files that iceoryx2 never removes: its small `*.global_mgmt` files.
#[track_caller]
pub(crate) fn assert_nothing_left(station: &Station) {
    let mut remaining = station.files_of_the_bus();
    remaining.retain(|path| {
        let size = path.metadata().map_or(0, |metadata| metadata.size());
        !(path.extension().is_some_and(|extension| extension == "global_mgmt") && size <= 16)
    });
    assert!(remaining.is_empty(), "{remaining:?}");
}

#[test]
fn both_signals_end_it_cleanly_with_sensors_and_clients() {
    let station = Station::new();
    let _person = station.person();
    for signal in [Signal::TERM, Signal::INT] {
        let mut daemon = station.daemon(&station.configuration());
        let mut monitor = Monitor::open(&station);
        monitor.until("both sensors", Monitor::both_fresh);
        drop(monitor);
        assert_eq!(daemon.stop(signal), Some(0), "{}", daemon.stderr());
        let message = daemon.stderr();
        assert!(message.contains("ended") && message.contains("schedule_adds_up=true"), "{message}");
        assert!(!message.contains("panicked"), "{message}");
        assert_nothing_left(&station);
        station.run(&["status"]).assert_failed(1, &["no daemon"]);
        assert_nothing_left(&station);
    }
}

#[test]
fn a_daemon_without_sensors_ends_as_well() {
    let station = Station::new();
    let mut daemon = station.daemon(&station.configuration());
    assert_eq!(station.current_status()["state"]["phase"], "waiting");
    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
    assert_nothing_left(&station);
}
