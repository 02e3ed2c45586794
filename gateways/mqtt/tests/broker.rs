//! Published messages, received by a minimal broker. `.ci/mqtt` tests against Mosquitto.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use bytes::BytesMut;
use equipoise_client::{NoReading, Reading};
use equipoise_core::message::{State, Validity};
use equipoise_gateway_mqtt::Mqtt;
use equipoise_gateways::config::MqttConfig;
use equipoise_gateways::{Gateway, Latest, StationFile};
use rumqttc::{ConnAck, Connect, ConnectReturnCode, Packet, PubAck, Publish};

const PATIENCE: Duration = Duration::from_secs(90);

fn config(port: u16, keys: &str) -> MqttConfig {
    let file = tempfile::NamedTempFile::new().unwrap();
    let section = format!("[gateways.mqtt]\nbroker = \"127.0.0.1\"\nport = {port}\n{keys}");
    std::fs::write(file.path(), format!("station = \"cell-7\"\n{section}\n")).unwrap();
    StationFile::read(file.path()).unwrap().gateways.mqtt.unwrap()
}

/// Joint index of MVN's RightElbow.
const ELBOW: usize = 8;
/// Due time of the cycle, CLOCK_MONOTONIC.
const DUE_NS: u64 = 12_500_000_000;

fn reading(valid: Validity) -> Latest {
    let mut state = State {
        time_ns: DUE_NS,
        cycle: 9,
        valid: valid.0,
        phase: 2,
        lifts: 3,
        worst_joint: ELBOW as u32,
        ..State::zeroed()
    };
    state.joint_level.fill(1);
    state.joint_level[ELBOW] = 3;
    Ok(Reading {
        state,
        received_ns: 1,
        age_ns: 1,
        sample_age_ns: None,
        missed: 0,
        restarted: false,
        daemon_life: 1,
        is_new: true,
    })
}

fn silence() -> Latest {
    Err(NoReading::Silent { silent: Duration::from_secs(1) })
}

/// One connection, on the broker's side.
struct Guest {
    socket: TcpStream,
    unread: BytesMut,
}

impl Guest {
    fn accept(listener: &TcpListener) -> Guest {
        let (socket, _) = listener.accept().unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        Guest { socket, unread: BytesMut::new() }
    }

    fn packet(&mut self) -> Packet {
        loop {
            if let Ok(packet) = Packet::read(&mut self.unread, 1 << 20) {
                return packet;
            }
            let mut read = [0; 4096];
            let count = self.socket.read(&mut read).unwrap();
            assert!(count > 0, "the gateway went without a word");
            self.unread.extend_from_slice(&read[..count]);
        }
    }

    fn send(&mut self, packet: &Packet) {
        let mut bytes = BytesMut::new();
        packet.write(&mut bytes, 1 << 20).unwrap();
        self.socket.write_all(&bytes).unwrap();
    }

    fn welcome(&mut self) -> Connect {
        let Packet::Connect(connect) = self.packet() else { panic!("no CONNECT") };
        self.send(&Packet::ConnAck(ConnAck::new(ConnectReturnCode::Success, false)));
        connect
    }

    fn publish(&mut self) -> Publish {
        let Packet::Publish(publish) = self.packet() else { panic!("no PUBLISH") };
        self.send(&Packet::PubAck(PubAck::new(publish.pkid)));
        publish
    }

    fn json(&mut self, topic: &str) -> serde_json::Value {
        let publish = self.publish();
        assert_eq!((publish.topic.as_str(), publish.retain), (topic, false));
        serde_json::from_slice(&publish.payload).unwrap()
    }
}

#[test]
fn a_station_goes_online_publishes_levels_and_goes_offline() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut gateway = Mqtt::new("cell-7", &config(listener.local_addr().unwrap().port(), "")).unwrap();
    let mut guest = Guest::accept(&listener);
    let will = guest.welcome().last_will.unwrap();
    assert_eq!(
        (will.topic.as_str(), &will.message[..], will.retain),
        ("equipoise/cell-7/online", &b"offline"[..], true)
    );
    let online = guest.publish();
    assert_eq!(
        (online.topic.as_str(), &online.payload[..], online.retain),
        ("equipoise/cell-7/online", &b"online"[..], true)
    );

    gateway.send(&reading(Validity(0)));
    let summary = guest.json("equipoise/cell-7/summary");
    assert_eq!(
        (&summary["worst_joint"], &summary["levels"]["RightElbow"]),
        (&"RightElbow".into(), &"red".into())
    );
    assert_eq!(
        (&summary["counts"]["green"], &summary["counts"]["red"], &summary["lifts"]),
        (&21.into(), &1.into(), &3.into())
    );
    let keys: Vec<_> = summary.as_object().unwrap().keys().map(String::as_str).collect();
    let allowed =
        ["counts", "levels", "lifts", "phase", "sequence", "station", "t", "v", "withheld", "worst_joint"];
    assert_eq!(keys, allowed, "levels and counts only");

    gateway.send(&reading(Validity::MOVING));
    let summary = guest.json("equipoise/cell-7/summary");
    assert_eq!(summary["withheld"], serde_json::json!(["moving"]));
    assert!(
        summary["levels"].is_null() && summary["counts"].is_null() && summary["worst_joint"].is_null(),
        "{summary}"
    );

    gateway.send(&silence());
    let summary = guest.json("equipoise/cell-7/summary");
    assert_eq!(summary["withheld"], serde_json::json!(["daemon_silent"]));
    assert!(
        summary["levels"].is_null() && summary["lifts"].is_null() && summary["phase"].is_null(),
        "{summary}"
    );

    let leaving = std::thread::spawn(move || drop(gateway));
    let farewell = guest.publish();
    assert_eq!((&farewell.payload[..], farewell.retain), (&b"offline"[..], true));
    assert_eq!(guest.packet(), Packet::Disconnect);
    leaving.join().unwrap();
}

#[test]
fn motion_is_published_only_if_configured() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let config = config(listener.local_addr().unwrap().port(), "motion = true");
    let mut gateway = Mqtt::new("cell-7", &config).unwrap();
    let mut guest = Guest::accept(&listener);
    guest.welcome();
    guest.publish();
    gateway.send(&reading(Validity(0)));
    let summary = guest.json("equipoise/cell-7/summary");
    let state = guest.json("equipoise/cell-7/state");
    assert!(state["joints"]["RightElbow"]["torque_nm"].is_array());
    // The keys of `status --json`, and the creation time of both messages.
    assert_eq!((&state["t"], &state["sent_unix_s"]), (&12.5.into(), &summary["t"]));
    drop(guest);
}

#[test]
fn a_broker_that_does_not_answer_blocks_nothing_and_then_receives_the_newest() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut gateway = Mqtt::new("cell-7", &config(listener.local_addr().unwrap().port(), "")).unwrap();
    let mut stuck = Guest::accept(&listener);
    let begun = Instant::now();
    for _ in 0..10_000 {
        gateway.send(&silence());
    }
    assert!(begun.elapsed() < PATIENCE);
    assert_eq!((gateway.tally().sent, gateway.tally().lost), (0, 9_999));
    gateway.send(&reading(Validity(0)));
    stuck.welcome();
    stuck.publish();
    assert_eq!(stuck.json("equipoise/cell-7/summary")["sequence"], 9);

    // The connection breaks, and the gateway connects again.
    drop(stuck);
    gateway.send(&silence());
    let mut next = Guest::accept(&listener);
    next.welcome();
    assert_eq!(&next.publish().payload[..], b"online");
    gateway.send(&reading(Validity(0)));
    while next.json("equipoise/cell-7/summary")["sequence"] != 9 {}
    drop(next);
}
