//! Viewers over real sockets, with a minimal WebSocket client: one that reads, and one that has stopped reading.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use equipoise_client::{NoReading, Reading};
use equipoise_core::body::Skeleton;
use equipoise_core::message::State;
use equipoise_gateway_foxglove::{BACKLOG, FoxgloveGateway};
use equipoise_gateways::{Gateway, Latest};
use equipoise_simulator::ports::free_address;
use serde_json::Value;

const PATIENCE: Duration = Duration::from_secs(90);

fn gateway() -> FoxgloveGateway {
    FoxgloveGateway::start("test", SocketAddr::from(([127, 0, 0, 1], 0)), |why| panic!("{why}")).unwrap()
}

fn latest(cycle: u64) -> Latest {
    let mut state = State::zeroed();
    (state.cycle, state.suit_sample_time_ns) = (cycle, 1);
    state.segment_origin_m = Skeleton::nominal(1.77).t_pose_m();
    Ok(Reading {
        state,
        received_ns: 0,
        age_ns: 700_000,
        sample_age_ns: Some(90_000_000),
        missed: 0,
        restarted: false,
        daemon_life: 1,
        is_new: true,
    })
}

/// A viewer with the minimum that the tests need (RFC 6455; subprotocol foxglove.sdk.v1).
struct Viewer(TcpStream);

impl Viewer {
    fn connect(port: u16) -> Viewer {
        let mut socket = TcpStream::connect(("127.0.0.1", port)).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        let request = "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
                       Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\
                       Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n";
        socket.write_all(request.as_bytes()).unwrap();
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            socket.read_exact(&mut byte).unwrap();
            head.push(byte[0]);
        }
        assert!(head.starts_with(b"HTTP/1.1 101"), "{}", String::from_utf8_lossy(&head));
        Viewer(socket)
    }

    /// The payload of the next frame, and whether it is text.
    fn frame(&mut self) -> (bool, Vec<u8>) {
        let mut head = [0; 2];
        self.0.read_exact(&mut head).unwrap();
        let length = match head[1] {
            126 => {
                let mut length = [0; 2];
                self.0.read_exact(&mut length).unwrap();
                usize::from(u16::from_be_bytes(length))
            }
            127 => {
                let mut length = [0; 8];
                self.0.read_exact(&mut length).unwrap();
                usize::try_from(u64::from_be_bytes(length)).unwrap()
            }
            short => usize::from(short),
        };
        let mut payload = vec![0; length];
        self.0.read_exact(&mut payload).unwrap();
        (head[0] & 0x0f == 1, payload)
    }

    fn say(&mut self, text: &str) {
        let length = u16::try_from(text.len()).unwrap();
        // RFC 6455 requires clients to mask their frames; a zero mask leaves the bytes unchanged.
        let mut frame = vec![0x81, 0x80 | 126];
        frame.extend(length.to_be_bytes());
        frame.extend([0; 4]);
        frame.extend(text.as_bytes());
        self.0.write_all(&frame).unwrap();
    }

    /// Subscribes to all advertised channels; returns the topics in the order of the subscriptions.
    fn subscribe_to_all(&mut self) -> Vec<String> {
        let mut topics = Vec::new();
        while topics.len() < 3 {
            let (is_text, payload) = self.frame();
            assert!(is_text);
            let message: Value = serde_json::from_slice(&payload).unwrap();
            for channel in message["channels"].as_array().into_iter().flatten() {
                assert_eq!(
                    (&channel["encoding"], &channel["schemaEncoding"]),
                    (&"json".into(), &"jsonschema".into())
                );
                let schema: Value = serde_json::from_str(channel["schema"].as_str().unwrap()).unwrap();
                assert_eq!(schema["title"], channel["schemaName"]);
                let subscription = serde_json::json!({"id": topics.len(), "channelId": channel["id"]});
                let ask = serde_json::json!({"op": "subscribe", "subscriptions": [subscription]});
                self.say(&ask.to_string());
                topics.push(channel["topic"].as_str().unwrap().to_owned());
            }
        }
        topics
    }

    /// The next message: its topic and its JSON object.
    fn message(&mut self, topics: &[String]) -> (String, Value) {
        loop {
            let (is_text, payload) = self.frame();
            if !is_text {
                assert_eq!(payload[0], 1, "a message of data");
                let subscription = u32::from_le_bytes(*payload[1..].first_chunk().unwrap());
                let object = serde_json::from_slice(&payload[1 + 4 + 8..]).unwrap();
                return (topics[subscription as usize].clone(), object);
            }
        }
    }
}

fn until(what: &str, mut happened: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !happened() {
        assert!(begun.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Resident memory of this process, bytes.
fn resident() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<usize>().unwrap() << 10
}

#[test]
fn a_viewer_sees_scene_state_and_heartbeat_and_then_the_reason_why_there_is_none() {
    let mut gateway = gateway();
    let mut viewer = Viewer::connect(gateway.port());
    let topics = viewer.subscribe_to_all();
    // A subscription takes effect when the server has read it, so states are published until all three topics have
    // arrived.
    let mut found = std::collections::BTreeMap::new();
    let (mut cycle, begun) = (0, Instant::now());
    while found.len() < 3 {
        cycle += 1;
        gateway.send(&latest(cycle));
        if gateway.tally().sent > 0 {
            let (topic, object) = viewer.message(&topics);
            found.insert(topic, object);
        } else {
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(begun.elapsed() < PATIENCE, "only {found:?}");
    }
    assert!(found["/equipoise/scene"]["entities"].as_array().is_some_and(|entities| !entities.is_empty()));
    assert!(found["/equipoise/state_json"]["cycle"].as_u64() <= Some(cycle));
    let heartbeat = &found["/equipoise/heartbeat"];
    assert_eq!((&heartbeat["fresh"], &heartbeat["age_ns"]), (&true.into(), &700_000.into()));

    gateway.send(&Err(NoReading::Silent { silent: Duration::from_millis(99) }));
    let mut newest = 0;
    loop {
        let (topic, object) = viewer.message(&topics);
        if topic != "/equipoise/heartbeat" {
            continue;
        }
        let sequence = object["sequence"].as_u64().unwrap();
        assert!(sequence > newest, "heartbeats increase");
        newest = sequence;
        if object["fresh"] == false {
            assert_eq!(object["no_state_reason"], "silent");
            assert!(object.get("age_ns").is_none());
            break;
        }
    }
}

#[test]
fn a_viewer_that_reads_nothing_costs_no_memory_and_delays_no_other() {
    let mut gateway = gateway();
    let mut stuck = Viewer::connect(gateway.port());
    stuck.subscribe_to_all();
    // It never reads again: the kernel's socket buffer fills up, then the queue of BACKLOG messages.
    let mut cycle = 0;
    until("the stuck viewer is served", || {
        cycle += 1;
        gateway.send(&latest(cycle));
        gateway.tally().sent >= 3
    });
    for _ in 0..3_000 {
        cycle += 1;
        gateway.send(&latest(cycle));
    }
    let before = resident();
    for _ in 0..10_000 {
        cycle += 1;
        gateway.send(&latest(cycle));
    }
    let grown = resident().saturating_sub(before);
    // Ten thousand scenes and states take 100 MB.
    assert!(grown < 16 << 20, "{grown} bytes more, with a queue of {BACKLOG} messages");
    assert_eq!(gateway.tally().peers, 1, "it is still there");

    let mut viewer = Viewer::connect(gateway.port());
    let topics = viewer.subscribe_to_all();
    let known = cycle;
    let heartbeat = loop {
        cycle += 1;
        gateway.send(&latest(cycle));
        viewer.0.set_read_timeout(Some(PATIENCE)).unwrap();
        if gateway.tally().peers == 2 && cycle > known + 10 {
            let (topic, object) = viewer.message(&topics);
            if topic == "/equipoise/heartbeat" {
                break object;
            }
        }
        // The server's own thread must first read the subscriptions.
        std::thread::sleep(Duration::from_millis(1));
    };
    assert!(
        heartbeat["cycle"].as_u64() > Some(known),
        "the newest, not what the stuck one left: {heartbeat}"
    );
}

/// Kills the program when the test ends, also on panic.
struct Program(std::process::Child);

impl Drop for Program {
    fn drop(&mut self) {
        let _ended = self.0.kill();
        let _waited = self.0.wait();
    }
}

#[test]
fn a_program_whose_server_has_ended_ends_with_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let address = free_address().unwrap();
    let config = folder.path().join("station.toml");
    std::fs::write(&config, format!("station = \"end\"\n[gateways.foxglove]\nlisten = \"{address}\"\n"))
        .unwrap();
    // A low limit of open files, so that a few viewers exceed it.
    let command = format!(
        "ulimit -n 60; exec {} --config {}",
        env!("CARGO_BIN_EXE_equipoise-gateway-foxglove"),
        config.display()
    );
    let stderr = std::fs::File::create(folder.path().join("stderr")).unwrap();
    let program = std::process::Command::new("sh")
        .args(["-c", &command])
        .env("EQUIPOISE_BUS_ROOT", folder.path().join("bus"))
        .stderr(stderr)
        .spawn();
    let mut program = Program(program.unwrap());
    let said = || std::fs::read_to_string(folder.path().join("stderr")).unwrap();
    let begun = Instant::now();
    let mut viewers: Vec<TcpStream> = Vec::new();
    let status = loop {
        assert!(begun.elapsed() < PATIENCE, "it continues without a server: {}", said());
        if let Some(status) = program.0.try_wait().unwrap() {
            break status;
        }
        if viewers.len() < 100 {
            viewers.extend(TcpStream::connect(address));
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    assert_eq!(status.code(), Some(1), "{}", said());
    assert!(said().contains("has ended"), "{}", said());
    assert!(!viewers.is_empty());
}
