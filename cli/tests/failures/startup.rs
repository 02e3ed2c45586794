//! A daemon that cannot start reports the reason, disturbs no other process and leaves no files behind.

use std::net::UdpSocket;

use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::shutdown::assert_nothing_left;
use crate::station::Station;

/// An earlier read might miss data that the previous daemon has not written yet.
#[test]
fn state_is_read_after_the_station_is_locked() {
    let station = Station::new();
    let mut first = station.daemon(&station.configuration());
    // Reading a pipe without a writer would block for ever.
    let other = station.file("other");
    std::fs::create_dir_all(other.join("stations")).expect("a folder");
    let pipe = other.join("stations").join("bench.toml");
    let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
    rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, mode, 0).expect("a pipe");
    let configuration = station.write("second.toml", &station.configuration()).to_string_lossy().into_owned();
    let environment = [("STATE_DIRECTORY", other.as_os_str())];
    let mut second = station.spawn_with(&["run", "--config", &configuration], &environment);
    assert_eq!(second.wait().code(), Some(1));
    assert!(second.stderr().contains("already has a daemon"), "{}", second.stderr());
    assert_eq!(first.stop(Signal::TERM), Some(0));
}

#[test]
fn a_second_daemon_is_refused_and_names_the_first() {
    let station = Station::new();
    let _person = station.person();
    let mut first = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until("both sensors", Monitor::both_fresh);

    let (pid, before) = (first.id(), monitor.state.cycle);
    for _ in 0..2 {
        // Separate ports: only the station is in use.
        let other = Station::new();
        let configuration = station
            .configuration()
            .replace(&station.suit.to_string(), &other.suit.to_string())
            .replace(&station.plate.to_string(), &other.plate.to_string());
        let mut second = station.try_daemon(&configuration);
        assert_eq!(second.wait().code(), Some(1));
        let output = second.stderr();
        assert!(output.contains(&format!("station bench already has a daemon: process {pid}")), "{output}");
    }

    let state = monitor.until("more cycles of the first", |monitor| monitor.state.cycle > before + 100);
    assert!(state.cycle > before, "its cycles continue, they do not restart");
    monitor.until("both sensors", Monitor::both_fresh);
    assert!(first.is_running());
    assert_eq!(station.current_status()["daemon"]["process_id"], pid);
    assert_eq!(first.stop(Signal::TERM), Some(0));
}

#[test]
fn a_used_suit_port_is_reported_with_its_key() {
    // Another process of these tests may have taken the port meanwhile.
    let occupy =
        || Some(Station::new()).and_then(|station| Some((UdpSocket::bind(station.suit).ok()?, station)));
    let (occupied, station) = (0..10).find_map(|_| occupy()).expect("a port");
    let mut daemon = station.try_daemon(&station.configuration());
    assert_eq!(daemon.wait().code(), Some(1));
    let output = daemon.stderr();
    let message = format!("port {} is taken", station.suit.port());
    assert!(output.contains(&message) && output.contains("set suit.listen"), "{output}");
    assert!(!output.contains("panicked"), "{output}");
    assert_nothing_left(&station);

    let path = station.write("adapter.toml", &station.configuration()).display().to_string();
    station.run(&["adapter", "suit", "--config", &path]).assert_failed(1, &[&message, "suit.listen"]);
    // Its fault file remains, for the daemon's incident.
    let fault = station.root().join("equipoise-bench.suit.json");
    assert!(std::fs::read_to_string(&fault).expect("the adapter's fault").contains(&message));
    std::fs::remove_file(fault).expect("the file of the fault");
    assert_nothing_left(&station);

    drop(occupied);
    let mut daemon = station.daemon(&station.configuration());
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}

#[test]
fn an_unusable_bus_root_is_refused() {
    let station = Station::new();
    std::fs::write(station.root(), "a file where a directory should be").expect("a file");
    let mut daemon = station.try_daemon(&station.configuration());
    assert_eq!(daemon.wait().code(), Some(1));
    let output = daemon.stderr();
    assert!(output.contains("cannot join the bus under"), "{output}");
    assert!(!output.contains("panicked"), "{output}");
}
