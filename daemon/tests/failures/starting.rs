//! A daemon that cannot start reports the reason, disturbs no other process and leaves no files behind.

use std::net::UdpSocket;

use rustix::process::Signal;

use crate::ending::assert_nothing_left;
use crate::eyes::Eyes;
use crate::station::Station;

/// An earlier read might miss data that the previous daemon has not written yet.
#[test]
fn state_is_read_only_once_the_station_is_held() {
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
fn a_second_daemon_names_the_first_and_does_it_no_harm() {
    let station = Station::new();
    let _person = station.person();
    let mut first = station.daemon(&station.configuration());
    let mut eyes = Eyes::open(&station);
    eyes.until("both sensors", Eyes::both_fresh);

    let (pid, before) = (first.id(), eyes.state.cycle);
    for _ in 0..2 {
        // Separate ports: only the station is in use.
        let other = Station::new();
        let configuration = station
            .configuration()
            .replace(&station.suit.to_string(), &other.suit.to_string())
            .replace(&station.plate.to_string(), &other.plate.to_string());
        let mut second = station.try_daemon(&configuration);
        assert_eq!(second.wait().code(), Some(1));
        let said = second.stderr();
        assert!(said.contains(&format!("station bench already has a daemon: process {pid}")), "{said}");
    }

    let state = eyes.until("more cycles of the first", |eyes| eyes.state.cycle > before + 100);
    assert!(state.cycle > before, "its cycles continue, they do not restart");
    eyes.until("both sensors", Eyes::both_fresh);
    assert!(first.is_running());
    assert_eq!(station.status().expect("the first answers")["daemon"]["process_id"], pid);
    assert_eq!(first.stop(Signal::TERM), Some(0));
}

#[test]
fn a_taken_suit_port_is_named_with_its_key() {
    let station = Station::new();
    let taken = UdpSocket::bind(station.suit).expect("the port");
    let mut daemon = station.try_daemon(&station.configuration());
    assert_eq!(daemon.wait().code(), Some(1));
    let said = daemon.stderr();
    let sentence = format!("port {} is taken", station.suit.port());
    assert!(said.contains(&sentence) && said.contains("set suit.listen"), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    assert_nothing_left(&station);

    let path = station.write("adapter.toml", &station.configuration()).display().to_string();
    station.run(&["adapter", "suit", "--config", &path]).failed_with(1, &[&sentence, "suit.listen"]);
    // Its fault file remains, for the daemon's incident.
    let fault = station.root().join("equipoise-bench.suit.json");
    assert!(std::fs::read_to_string(&fault).expect("the adapter's fault").contains(&sentence));
    std::fs::remove_file(fault).expect("the file of the fault");
    assert_nothing_left(&station);

    drop(taken);
    let mut daemon = station.daemon(&station.configuration());
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}

#[test]
fn a_root_that_cannot_hold_a_bus_is_refused() {
    let station = Station::new();
    std::fs::write(station.root(), "a file where a directory should be").expect("a file");
    let mut daemon = station.try_daemon(&station.configuration());
    assert_eq!(daemon.wait().code(), Some(1));
    let said = daemon.stderr();
    assert!(said.contains("cannot join the bus under"), "{said}");
    assert!(!said.contains("panicked"), "{said}");
}
