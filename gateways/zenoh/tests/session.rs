//! The gateway and a subscriber, with a Zenoh session each, over TCP on loopback.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use equipoise_client::{NoReading, Reading};
use equipoise_core::message::State;
use equipoise_gateway_zenoh::ZenohGateway;
use equipoise_gateway_zenoh::ros::{RosNames, attachment};
use equipoise_gateways::config::ZenohConfig;
use equipoise_gateways::{Gateway, Latest};
use equipoise_simulator::ports::free_address;
use serde_json::Value;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;
use zenoh::{Config, Session, Wait};

/// Test time-out.
const PATIENCE: Duration = Duration::from_secs(90);

fn config(port: u16) -> ZenohConfig {
    ZenohConfig {
        connect: Vec::new(),
        listen: vec![format!("tcp/127.0.0.1:{port}")],
        rate_hz: 100.0,
        json_rate_hz: 100.0,
        ros_domain_id: 5,
        body: false,
        file: None,
    }
}

fn subscriber_session(port: u16) -> Session {
    let mut settings = Config::default();
    for (key, value) in [
        ("mode", "\"client\"".to_owned()),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("connect/endpoints", format!("[\"tcp/127.0.0.1:{port}\"]")),
    ] {
        settings.insert_json5(key, &value).unwrap();
    }
    zenoh::open(settings).wait().unwrap()
}

fn latest(cycle: u64) -> Latest {
    let state = State { cycle, mass_kg: 72.5, ..State::zeroed() };
    let sample_age_ns = Some(2);
    Ok(Reading {
        state,
        received_ns: 0,
        age_ns: 1,
        sample_age_ns,
        missed: 0,
        restarted: false,
        daemon_life: 1,
        is_new: true,
    })
}

/// Publishes `latest` until `count` samples have arrived or the time-out passes.
fn send_until(
    gateway: &mut ZenohGateway,
    latest: &Latest,
    from: &Subscriber<FifoChannelHandler<Sample>>,
    count: usize,
) -> Vec<Sample> {
    let (mut samples, start) = (Vec::new(), Instant::now());
    while samples.len() < count && start.elapsed() < PATIENCE {
        gateway.send(latest);
        std::thread::sleep(Duration::from_millis(10));
        samples.extend(from.drain());
    }
    assert!(samples.len() >= count, "{} of {count} samples came", samples.len());
    samples
}

fn json(sample: &Sample) -> Value {
    serde_json::from_slice(&sample.payload().to_bytes()).unwrap()
}

#[test]
fn a_dashboard_reads_states_by_wildcard_in_their_order_and_hears_of_silence() {
    let port = free_address().unwrap().port();
    let mut gateway = ZenohGateway::open("north", &config(port)).unwrap();
    let session = subscriber_session(port);
    let states = session.declare_subscriber("equipoise/*/state").wait().unwrap();
    let samples = send_until(&mut gateway, &latest(71), &states, 5);
    let mut last = 0;
    for sample in &samples {
        assert_eq!(sample.key_expr().as_str(), "equipoise/north/state");
        let message = json(sample);
        let sequence = message["sequence"].as_u64().unwrap();
        assert!(sequence > last, "{sequence} after {last}");
        last = sequence;
        assert_eq!((&message["current"], &message["state"]["cycle"]), (&Value::from(true), &Value::from(71)));
        assert_eq!((&message["age_ns"], &message["sample_age_ns"]), (&Value::from(1), &Value::from(2)));
    }
    let silent = Err(NoReading::Silent { silent: Duration::from_secs(1) });
    let messages = send_until(&mut gateway, &silent, &states, 10);
    let message = json(messages.last().unwrap());
    assert_eq!(
        (&message["current"], &message["no_state_reason"]),
        (&Value::from(false), &Value::from("silent"))
    );
    assert!(message.get("state").is_none() && message.get("age_ns").is_none());
    assert!(message["sequence"].as_u64().unwrap() > last);
}

#[test]
fn mass_and_centre_of_mass_are_published_only_if_configured() {
    for body in [false, true] {
        let port = free_address().unwrap().port();
        let mut gateway = ZenohGateway::open("north", &ZenohConfig { body, ..config(port) }).unwrap();
        let session = subscriber_session(port);
        let states = session.declare_subscriber("equipoise/*/state").wait().unwrap();
        let state = &json(&send_until(&mut gateway, &latest(1), &states, 1)[0])["state"];
        for key in ["mass_kg", "com", "suit_com"] {
            assert_eq!(state.get(key).is_some(), body, "{key}: {state}");
        }
        assert!(state.get("fatigue").is_some(), "{state}");
    }
}

#[test]
fn with_a_file_only_what_was_asked_for_listens() {
    let folder = std::env::temp_dir().join(format!("equipoise-zenoh-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("zenoh.json5");
    std::fs::write(&file, "{ transport: { link: { tx: { lease: 9000 } } } }").unwrap();
    std::fs::set_permissions(&file, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
    let port = free_address().unwrap().port();
    let gateway = ZenohGateway::open("south", &ZenohConfig { file: Some(file), ..config(port) }).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    let sockets: Vec<_> = std::fs::read_dir("/proc/self/fd").unwrap().flatten().collect();
    let ours = sockets.iter().filter_map(|file| std::fs::read_link(file.path()).ok());
    let ours: Vec<_> = ours.map(|link| link.to_string_lossy().into_owned()).collect();
    let mut listening = 0;
    for table in ["tcp", "tcp6", "udp", "udp6"] {
        let table = std::fs::read_to_string(format!("/proc/self/net/{table}")).unwrap_or_default();
        for row in table.lines().skip(1).map(|row| row.split_whitespace().collect::<Vec<_>>()) {
            // 0A: listening TCP socket; 07: unconnected UDP socket.
            if !["0A", "07"].contains(&row[3]) || !ours.contains(&format!("socket:[{}]", row[9])) {
                continue;
            }
            listening += 1;
            assert!(row[1].starts_with("0100007F:"), "something listens beyond loopback: {row:?}");
        }
    }
    assert!(listening > 0, "not even what was asked for");
    drop(gateway);
}

#[test]
fn a_ros_subscriber_gets_the_attachment_that_rmw_zenoh_wants_and_the_publishers_own_gid() {
    let port = free_address().unwrap().port();
    let mut gateway = ZenohGateway::open("south-2", &config(port)).unwrap();
    let session = subscriber_session(port);
    let tokens = session.liveliness().get("@ros2_lv/5/**").timeout(PATIENCE).wait().unwrap();
    let mut found: Vec<String> = Vec::new();
    while let Ok(Some(reply)) = tokens.recv_timeout(PATIENCE) {
        found.extend(reply.result().ok().map(|sample| sample.key_expr().to_string()));
    }
    found.sort();
    let zid = found[0].split('/').nth(2).unwrap();
    let names = RosNames::new("south-2", 5, zid);
    assert_eq!(found, [names.node_token.clone(), names.publisher_token.clone()]);

    let states = session.declare_subscriber(names.topic_key.as_str()).wait().unwrap();
    let samples = send_until(&mut gateway, &latest(3), &states, 3);
    for pair in samples.windows(2) {
        let of = |sample: &Sample| sample.attachment().unwrap().to_bytes().into_owned();
        let (one, next) = (of(&pair[0]), of(&pair[1]));
        assert_eq!((one.len(), &one[16..]), (33, &next[16..]));
        let sequence = |bytes: &[u8]| u64::from_le_bytes(bytes[..8].try_into().unwrap());
        assert_eq!(sequence(&next), sequence(&one) + 1);
        assert_eq!(one[16..], attachment(0, 0, names.gid())[16..]);
    }
}

#[test]
fn subscribers_detect_the_end_of_a_gateway() {
    let port = free_address().unwrap().port();
    let gateway = ZenohGateway::open("west", &config(port)).unwrap();
    let session = subscriber_session(port);
    let alive = session.liveliness().declare_subscriber("equipoise/*/alive").history(true).wait().unwrap();
    let kind = |sample: Sample| (sample.kind().to_string(), sample.key_expr().to_string());
    let next = || alive.recv_timeout(PATIENCE).unwrap().map(kind);
    assert_eq!(next(), Some(("PUT".to_owned(), "equipoise/west/alive".to_owned())));
    drop(gateway);
    assert_eq!(next(), Some(("DELETE".to_owned(), "equipoise/west/alive".to_owned())));
}

#[test]
fn a_missing_peer_and_a_wrong_address_are_reported() {
    let mut none = config(1);
    none.listen.clear();
    let gateways = equipoise_gateways::GatewaysConfig { zenoh: Some(none), ..Default::default() };
    assert_eq!(gateways.check().unwrap_err().0, "gateways.zenoh.connect");
    let wrong = ZenohConfig { listen: vec!["127.0.0.1".to_owned()], ..config(1) };
    let error = ZenohGateway::open("east", &wrong).err().unwrap().to_string();
    assert!(error.contains("listen/endpoints"), "{error}");
}
