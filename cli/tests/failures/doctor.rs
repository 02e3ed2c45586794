//! `doctor` against real ports, a real daemon and real streams.

use std::net::UdpSocket;

use serde_json::Value;

use equipoise_simulator::ports::free_address;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::{Output, Station};
use crate::streams;

fn check<'a>(report: &'a Value, name: &str) -> &'a Value {
    let checks = report["checks"].as_array().expect("a list of checks");
    checks.iter().find(|check| check["name"] == name).unwrap_or_else(|| panic!("no {name} in {report}"))
}

fn report(ended: &Output) -> Value {
    serde_json::from_str(&ended.stdout).unwrap_or_else(|error| panic!("{error}: {}", ended.stdout))
}

#[test]
fn a_port_of_another_process_fails_with_a_remedy_and_a_free_one_is_observed() {
    let station = Station::new();
    let metrics = free_address().expect("a free port");
    let text = format!("{}[metrics]\nlisten = \"{metrics}\"\n", station.configuration());
    let path = station.write("doctor.toml", &text).display().to_string();
    let command = ["doctor", "--json", "--config", &path];

    let occupied = UdpSocket::bind(station.suit).expect("the port");
    let ended = station.run(&command);
    ended.assert_failed(1, &["checks failed"]);
    let facts = report(&ended);
    let port = check(&facts, "suit.listen");
    assert_eq!(port["verdict"], "fail", "{port}");
    assert!(port["fix"].as_str().is_some_and(|fix| fix.contains("ss -ulpn")), "{port}");
    assert_eq!(check(&facts, "metrics.listen")["verdict"], "ok");
    assert_eq!(check(&facts, "MVN stream")["verdict"], "skipped");
    assert_eq!(check(&facts, "plate")["verdict"], "skipped", "no daemon runs");
    assert_eq!(check(&facts, "real-time priority")["verdict"], "skipped", "loop.priority is 0");
    drop(occupied);

    let _suit = streams::suit(station.suit);
    let facts = report(&station.run(&command));
    assert_eq!(check(&facts, "suit.listen")["verdict"], "ok", "{facts}");
    let received = check(&facts, "MVN stream");
    // The number of samples a second on a busy machine is not tested here.
    assert!(received["found"].as_str().is_some_and(|found| found.contains("samples a second")), "{received}");
    let other =
        station.write("other.toml", &text.replace("[suit]", "[suit]\navatar = 5")).display().to_string();
    let ended = station.run(&["doctor", "--config", &other]);
    assert!(
        ended.stdout.contains("character 5 is not among those sent: 0 -> suit.avatar = 0"),
        "{}",
        ended.stdout
    );
}

#[test]
fn a_running_daemon_holds_its_ports_and_reports_suit_and_plate() {
    let station = Station::new();
    let _person = station.person();
    let _daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until("both sensors", Monitor::both_fresh);
    // Without a file argument the daemon's own configuration is used.
    let found = |facts: &Value, name: &str, part: &str| {
        check(facts, name)["found"].as_str().is_some_and(|found| found.contains(part))
    };
    let facts = wait_for("the person and the suit", || {
        let facts = report(&station.run(&["doctor", "--json"]));
        let are_found = found(&facts, "plate", "a person stands on it")
            && found(&facts, "MVN stream", "samples a second");
        are_found.then_some(facts)
    });
    assert_eq!(check(&facts, "suit.listen")["verdict"], "ok", "{facts}");
    // Another file, whose port another process holds.
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a port");
    let occupied = socket.local_addr().expect("its address").to_string();
    let text = station.configuration().replace(&station.suit.to_string(), &occupied);
    let path = station.write("other.toml", &text).display().to_string();
    let other = report(&station.run(&["doctor", "--json", "--config", &path]));
    assert_eq!(check(&other, "suit.listen")["verdict"], "fail", "{other}");
    assert_eq!(check(&facts, "bus root")["verdict"], "ok", "{facts}");
}

#[test]
fn ports_of_page_and_metrics_are_ok_only_while_page_and_daemon_hold_them() {
    let station = Station::new();
    let (page, metrics) = (free_address().expect("a free port"), free_address().expect("a free port"));
    let text = format!(
        "{}[page]\nlisten = \"{page}\"\n[metrics]\nlisten = \"{metrics}\"\n",
        station.configuration()
    );
    let _daemon = station.daemon(&text);
    let path = station.write("page.toml", &text).display().to_string();
    let port = |name: &str| {
        let facts = report(&station.run(&["doctor", "--json", "--config", &path]));
        check(&facts, name)["verdict"].as_str().expect("a verdict").to_owned()
    };
    // Another process holds the page's port, while the station is fully operational without it.
    let listener = std::net::TcpListener::bind(page).expect("the port");
    assert_eq!((port("page.listen").as_str(), port("metrics.listen").as_str()), ("fail", "ok"));
    drop(listener);
    let _view = station.spawn(&["view", "--config", &path]);
    wait_for("the page", || std::net::TcpStream::connect(page).ok());
    // It listens before it has joined the bus, which identifies it as the station's.
    wait_for("a port of the station's", || (port("page.listen") == "ok").then_some(()));
}

#[test]
fn without_a_configuration_only_the_computer_is_checked() {
    let station = Station::new();
    let ended = station.run(&["doctor"]);
    for name in ["ports", "MVN stream", "plate"] {
        let line = format!("skipped {name:<21} no daemon runs: name the configuration with --config");
        assert!(ended.stdout.lines().any(|shown| shown == line), "{line}: {}", ended.stdout);
    }
    for name in ["user", "real-time priority", "CPU governor", "/dev/shm", "clock source", "socket buffers"] {
        assert!(ended.stdout.contains(name), "{name}: {}", ended.stdout);
    }
    std::fs::write(station.root(), "a file where a directory should be").expect("a file");
    let ended = station.run(&["doctor"]);
    ended.assert_failed(1, &["checks failed"]);
    assert!(ended.stdout.contains("FAIL    bus root"), "{}", ended.stdout);
}
