//! Metrics over real HTTP.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};

use rustix::process::Signal;

use equipoise_simulator::ports::free_address;

use crate::monitor::Monitor;
use crate::process::{TIMEOUT, wait_for};
use crate::station::Station;

/// Header and body of an answer.
fn request(address: SocketAddr, head: &str) -> Option<(String, String)> {
    let mut connection = TcpStream::connect(address).ok()?;
    connection.set_read_timeout(Some(TIMEOUT)).expect("a socket");
    write!(connection, "GET {head}\r\nConnection: close\r\n\r\n").ok()?;
    let mut answer = String::new();
    connection.read_to_string(&mut answer).ok()?;
    let (head, body) = answer.split_once("\r\n\r\n")?;
    Some((head.to_owned(), body.to_owned()))
}

fn scrape(address: SocketAddr) -> Option<(String, String)> {
    request(address, &format!("/metrics HTTP/1.1\r\nHost: {address}"))
}

/// The value of the sample with this prefix.
fn value(body: &str, begins: &str) -> Option<f64> {
    let line = body.lines().find(|line| line.starts_with(begins))?;
    line.rsplit(' ').next()?.parse().ok()
}

#[test]
fn a_scrape_has_counters_incidents_and_no_motion_data() {
    let station = Station::new();
    let person = station.person();
    let address = free_address().expect("a free port");
    let configuration = format!("{}[metrics]\nlisten = \"{address}\"\n", station.configuration());
    let mut daemon = station.daemon(&configuration);
    let mut monitor = Monitor::open(&station);
    monitor.until("both sensors", Monitor::both_fresh);
    person.silence_suit(true);
    let silent = "equipoise_incident_active{station=\"bench\",incident=\"suit_silent\"}";
    let received = "equipoise_adapter_received_total{station=\"bench\",stream=\"ground\"}";
    let (head, body) = wait_for("the silence in the metrics, and the adapters' counts", || {
        scrape(address).filter(|(_, body)| {
            value(body, silent) == Some(1.0)
                && value(body, received) > Some(0.0)
                && value(body, "equipoise_publishing") == Some(1.0)
        })
    });
    assert!(head.starts_with("HTTP/1.1 200") && head.contains("text/plain; version=0.0.4"), "{head}");
    person.silence_suit(false);
    let of = |body: &str, name: &str| value(body, name).unwrap_or_else(|| panic!("no {name} in\n{body}"));
    assert!(of(&body, "equipoise_incidents_total{station=\"bench\",incident=\"suit_silent\"}") > 0.0);
    assert!(body.contains("# TYPE equipoise_cycles_total counter"), "{body}");
    // The name of an incident is no position.
    let values = body.replace("position_unknown", "");
    for private in ["anon-1", "torque", "segment_origin", "position", "com_m"] {
        assert!(!values.contains(private), "{private} is private: {body}");
    }
    let before = of(&body, "equipoise_cycles_total");
    wait_for("more cycles and the end of the silence", || {
        let (_, body) = scrape(address)?;
        (value(&body, silent) == Some(0.0) && value(&body, "equipoise_cycles_total")? > before).then_some(())
    });
    // OpenMetrics if requested.
    let accept = format!("/metrics HTTP/1.1\r\nHost: {address}\r\nAccept: application/openmetrics-text");
    let (head, body) = request(address, &accept).expect("an answer");
    assert!(head.contains("application/openmetrics-text; version=1.0.0"), "{head}");
    assert!(body.trim_end().ends_with("# EOF"), "{body}");
    // A host name that a foreign DNS entry points here is refused.
    let (head, _) = request(address, "/metrics HTTP/1.1\r\nHost: evil.example").expect("an answer");
    assert!(head.starts_with("HTTP/1.1 403"), "{head}");
    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
    assert!(scrape(address).is_none(), "it ends with the daemon");
}

#[test]
fn metrics_for_the_whole_network_or_on_a_used_port_are_refused() {
    let station = Station::new();
    let with = |address: &str| format!("{}[metrics]\nlisten = \"{address}\"\n", station.configuration());
    let path = station.write("metrics.toml", &with("0.0.0.0:9187")).display().to_string();
    for arguments in [&["check", &path][..], &["run", "--config", &path]] {
        station.run(arguments).assert_failed(1, &["metrics.listen", "loopback only"]);
    }
    let occupied = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = occupied.local_addr().expect("its address").to_string();
    let mut daemon = station.try_daemon(&with(&address));
    assert_eq!(daemon.wait().code(), Some(1));
    let message = daemon.stderr();
    assert!(
        message.contains("metrics.listen") && message.contains(&address) && !message.contains("panicked"),
        "{message}"
    );
    crate::shutdown::assert_nothing_left(&station);
}
