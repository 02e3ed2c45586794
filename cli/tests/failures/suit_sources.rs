//! Transports of a suit: TCP, several workers on one port, and the report of `doctor suit` for each.

use std::net::{SocketAddr, UdpSocket};
use std::time::Instant;

use equipoise_adapters::suit::SuitRefusal;
use equipoise_bus::{Bus, BusSettings, Subscriber};
use equipoise_core::message::{AdapterHealth, SuitSample, Validity};
use equipoise_simulator::ports::free_address;
use rustix::process::Signal;
use serde_json::Value;

use crate::adapters::adapter;
use crate::malformed_datagrams::assert_memory_bounded;
use crate::monitor::Monitor;
use crate::process::{Process, TIMEOUT, wait_for};
use crate::shutdown::assert_nothing_left;
use crate::station::{NAME, Station};
use crate::streams::{self, FakePlate};

/// The other worker's station.
const OTHER: &str = "other";

fn check<'a>(report: &'a Value, name: &str) -> &'a Value {
    let checks = report["checks"].as_array().expect("a list of checks");
    checks.iter().find(|check| check["name"] == name).unwrap_or_else(|| panic!("no {name} in {report}"))
}

/// Report of `doctor suit`, once its exit code and these parts of its findings are as expected: within its two seconds a
/// busy machine may send little.
fn doctor(station: &Station, text: &str, code: i32, parts: &[(&str, &str)]) -> Value {
    let path = station.write("doctor.toml", text).display().to_string();
    let command = ["doctor", "suit", "--config", &path, "--for", "2s", "--json"];
    wait_for("the report of the doctor", || {
        let ended = station.run(&command);
        let report: Value = serde_json::from_str(&ended.stdout)
            .unwrap_or_else(|error| panic!("{error}: {} {}", ended.stdout, ended.stderr));
        let checks = report["checks"].as_array().expect("a list of checks");
        let is_found = |(name, part): &(&str, &str)| {
            let found = checks.iter().find(|check| check["name"] == *name);
            found.and_then(|check| check["found"].as_str()).is_some_and(|found| found.contains(part))
        };
        if ended.code == Some(code) && parts.iter().all(is_found) {
            return Some(report);
        }
        println!("{:?}: {report}", ended.code);
        None
    })
}

/// The station's configuration, with additional keys of `[suit]`.
fn with(station: &Station, keys: &str) -> String {
    station.configuration().replace("[ground]", &format!("{keys}\n[ground]"))
}

fn over_tcp(station: &Station, port: SocketAddr) -> String {
    let text = station.configuration().replace("\"mvn-udp\"", "\"mvn-tcp\"");
    text.replace(&format!("listen = \"{}\"", station.suit), &format!("listen = \"{port}\""))
}

/// The samples published as a station's suit.
struct OnTheBus {
    samples: Subscriber<SuitSample>,
    health: Subscriber<AdapterHealth>,
    _bus: Bus,
}

impl OnTheBus {
    fn of(station: &Station, name: &str) -> OnTheBus {
        let settings =
            BusSettings { station: name.to_owned(), role: "test".to_owned(), root: station.root() };
        let bus = Bus::join(&settings).expect("the bus");
        OnTheBus {
            samples: bus.subscriber(128).expect("a place"),
            health: bus.subscriber(8).expect("a place"),
            _bus: bus,
        }
    }

    /// Waits for this many samples from now on: all are of one character, each once and in order.
    #[track_caller]
    fn assert_verdict(&mut self, count: usize, avatar: u32) {
        while self.samples.receive().expect("the bus").is_some() {}
        let (mut counters, started) = (Vec::new(), Instant::now());
        while counters.len() < count {
            assert!(started.elapsed() < TIMEOUT, "{} of {count} samples", counters.len());
            while let Some(sample) = self.samples.receive().expect("the bus") {
                assert_eq!(sample.avatar, avatar);
                assert!(sample.published_ns >= sample.arrival_ns);
                counters.push(sample.device_counter);
            }
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        assert!(counters.windows(2).all(|pair| pair[0] < pair[1]), "{counters:?}");
    }

    /// Waits for a health message of the adapter that fulfils a condition.
    #[track_caller]
    fn health(&mut self, holds: impl Fn(&AdapterHealth) -> bool) -> AdapterHealth {
        wait_for("a word of the adapter", || {
            let mut newest = None;
            while let Some(health) = self.health.receive().expect("the bus") {
                newest = Some(health).filter(|health| health.stream == 1 && holds(health)).or(newest);
            }
            newest
        })
    }
}

fn health_text(process: &Process, lines: &str) {
    wait_for(lines, || process.stderr().contains(lines).then_some(()));
}

#[test]
fn a_suit_over_tcp_survives_damage_and_reconnection() {
    let station = Station::new();
    let port = free_address().expect("a free port");
    let _plate = FakePlate::start(station.plate);
    let daemon = station.daemon(&over_tcp(&station, port));
    let suit = streams::suits_over_tcp(port, &[0]);
    let mut monitor = Monitor::open(&station);
    monitor.until("both sensors", Monitor::both_fresh);
    suit.slip_in(|_| vec![0xa5; 333]);
    monitor.until("the loss of step", |monitor| monitor.suit_refused(SuitRefusal::OutOfStep) == 1);
    monitor.until("both sensors after the damage", Monitor::both_fresh);
    drop(suit);
    monitor.until("the suit's silence", |monitor| monitor.has(Validity::SUIT_STALE));
    let _suit = streams::suits_over_tcp(port, &[0]);
    monitor.until("the suit again", Monitor::both_fresh);
    assert_memory_bounded(&daemon);
    assert!(!daemon.stderr().contains("panicked"), "{}", daemon.stderr());

    // The daemon holds the port, so the doctor queries it.
    let parts = [("suit.listen", "is held by station"), ("samples", "of character 0")];
    doctor(&station, &over_tcp(&station, port), 0, &parts);
}

#[test]
fn two_suits_on_one_port_have_separate_stations_and_failures() {
    let station = Station::new();
    let others = with(&station, &format!("others = [{{ avatar = 1, station = \"{OTHER}\" }}]"));
    let _suits = [0, 1, 2].map(|avatar| streams::suit_of(station.suit, avatar));
    let mut daemon = station.daemon(&others);
    let [mut own, mut other] = [NAME, OTHER].map(|name| OnTheBus::of(&station, name));
    own.assert_verdict(60, 0);
    other.assert_verdict(60, 1);
    // A full socket buffer behind a busy core may lose datagrams.
    let counts = other.health(|health| health.published > 60);
    assert_eq!(counts.refused.iter().sum::<u64>(), 0, "{counts:?}");
    // The third belongs to no station.
    own.health(|health| health.refused[SuitRefusal::OtherAvatar.index()] > 10);

    // The other station's daemon, with its own plate, accepts the forwarded samples.
    let plate = free_address().expect("a free port");
    let _plate = FakePlate::start(plate);
    let text = station.configuration().replace("\"mvn-udp\"", "\"external\"");
    let text = text.replace(&station.plate.to_string(), &plate.to_string());
    let text = text.replace(&format!("station = \"{NAME}\""), &format!("station = \"{OTHER}\""));
    let state = station.file("other");
    std::fs::create_dir(&state).expect("a directory");
    let start = || {
        station.write("other.toml", &text);
        station.daemon_of("other.toml", &[("STATE_DIRECTORY", state.as_os_str())])
    };
    let fresh = || {
        wait_for("the other station's sensors", || {
            let ended = station.run(&["status", "--json", "--station", OTHER]);
            let status: Value = serde_json::from_str(&ended.stdout).ok()?;
            let valid = status["state"]["valid"].as_array()?;
            valid.iter().all(|reason| reason != "suit_stale" && reason != "ground_stale").then_some(())
        });
    };
    let mut second = start();
    fresh();
    second.kill();
    own.assert_verdict(60, 0);
    other.assert_verdict(30, 1);
    let mut second = start();
    fresh();
    for process in [&mut second, &mut daemon] {
        assert_eq!(process.stop(Signal::TERM), Some(0), "{}", process.stderr());
    }
    drop((own, other));
    assert_nothing_left(&station);
}

#[test]
fn forwarding_to_a_station_with_another_publisher_is_retried_and_the_own_suit_continues() {
    let station = Station::new();
    let elsewhere = free_address().expect("a free port");
    let others = with(&station, &format!("others = [{{ avatar = 1, station = \"{OTHER}\" }}]"));
    let other_configuration =
        station.configuration().replace(&station.suit.to_string(), &elsewhere.to_string());
    let other_configuration =
        other_configuration.replace(&format!("station = \"{NAME}\""), &format!("station = \"{OTHER}\""));
    let path = station.write("theirs.toml", &other_configuration).display().to_string();
    let mut rival = station.spawn(&["adapter", "suit", "--config", &path]);
    health_text(&rival, "adapter runs");

    let _suits = [0, 1].map(|avatar| streams::suit_of(station.suit, avatar));
    let daemon = station.daemon(&others);
    health_text(
        &daemon,
        &format!("the suit of station {OTHER} is published by process {} already", rival.id()),
    );
    let [mut own, mut other] = [NAME, OTHER].map(|name| OnTheBus::of(&station, name));
    own.assert_verdict(60, 0);
    assert_eq!(rival.stop(Signal::TERM), Some(0), "{}", rival.stderr());
    other.assert_verdict(30, 1);
    own.assert_verdict(30, 0);
}

#[test]
fn doctor_suit_reports_received_data_and_the_process_of_the_port() {
    let station = Station::new();
    let occupied = UdpSocket::bind(station.suit).expect("the port");
    let own = format!("(process {})", std::process::id());
    let report = doctor(&station, &station.configuration(), 1, &[("suit.listen", own.as_str())]);
    assert_eq!(check(&report, "suit.listen")["verdict"], "fail", "{report}");
    drop(occupied);

    let report = doctor(&station, &station.configuration(), 1, &[]);
    let fix = check(&report, "sender")["fix"].as_str().expect("what to do");
    assert!(fix.contains(&format!("Port = {}", station.suit.port())), "{report}");

    let suits = [0, 3].map(|avatar| streams::suit_of(station.suit, avatar));
    let parts = [("characters", "3 belongs to no station"), ("samples", "a second of the suit's 60")];
    let report = doctor(&station, &station.configuration(), 0, &parts);
    assert_eq!(check(&report, "02 pose quaternion")["verdict"], "ok");
    let characters = report["heard"]["at_the_port"]["characters"].as_array().expect("characters");
    assert_eq!(characters.iter().map(|one| one["avatar"].as_u64()).collect::<Vec<_>>(), [Some(0), Some(3)]);
    drop(suits);

    // Over TCP the suit connects to the doctor itself.
    let port = free_address().expect("a free port");
    let _suits = streams::suits_over_tcp(port, &[0, 1]);
    let report = doctor(&station, &over_tcp(&station, port), 0, &[("characters", "1 belongs to no station")]);
    let listen = check(&report, "suit.listen")["found"].as_str();
    assert!(listen.is_some_and(|found| found.starts_with("TCP ")), "{report}");
}

#[test]
fn doctor_suit_queries_a_separate_adapter() {
    let station = Station::new();
    let _suit = streams::suit(station.suit);
    let _adapter = adapter(&station, "suit");
    doctor(&station, &crate::adapters::external(&station), 0, &[("samples", "of character 0")]);
    let ended = station.run(&["doctor", "suit"]);
    ended.assert_failed(1, &["name the configuration with --config FILE"]);
}
