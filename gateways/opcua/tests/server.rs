//! The server over loopback, queried by the client of the same library. `.ci/opcua` queries it with an independent
//! client.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

#[path = "support/mod.rs"]
mod support;

use std::path::Path;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use equipoise_core::message::Validity;
use equipoise_gateway_opcua::{OpcUa, space::NAMESPACE};
use equipoise_gateways::config::OpcUaConfig;
use equipoise_gateways::{Gateway, Latest, StationFile};
use opcua::client::{Client, ClientBuilder, DataChangeCallback, IdentityToken, Session};
use opcua::crypto::SecurityPolicy;
use opcua::types::{
    AttributeId, DataValue, MessageSecurityMode, MonitoredItemCreateRequest, MonitoredItemModifyRequest,
    MonitoringParameters, NodeId, ReadValueId, StatusCode, TimestampsToReturn, UserTokenPolicy, VariableId,
    Variant, WriteValue,
};

use support::{reading, silence};

const PATIENCE: Duration = Duration::from_secs(90);
/// Session time-out, which the tests of leftovers wait for.
const SESSION: Duration = Duration::from_secs(4);
/// Longer than the interval at which the gateway counts what clients have left.
const COUNTED: Duration = Duration::from_secs(3);
/// Keys and certificates of server and client.
const KEYS: [&str; 4] =
    ["pki/private/private.pem", "pki/own/cert.der", "client/private/private.pem", "client/own/cert.der"];

struct Station {
    gateway: OpcUa,
    folder: tempfile::TempDir,
}

impl Station {
    fn new(keys: &str) -> Station {
        Station::with(keys, |what| panic!("{what}"))
    }

    fn with(keys: &str, on_end: impl FnOnce(String) + Send + 'static) -> Station {
        // A new key takes seconds of CPU time: both are made at the same time, and once for all stations.
        static CONTENTS: OnceLock<[Vec<u8>; KEYS.len()]> = OnceLock::new();
        let contents = CONTENTS.get_or_init(|| {
            let clients = tempfile::tempdir().unwrap();
            let first = std::thread::scope(|scope| {
                scope.spawn(|| drop(client(clients.path())));
                Station::in_folder(tempfile::tempdir().unwrap(), "", |what| panic!("{what}"))
            });
            let folders = [first.folder.path(), clients.path()];
            let content =
                |path: &str| folders.iter().find_map(|folder| std::fs::read(folder.join(path)).ok());
            KEYS.map(|path| content(path).unwrap())
        });
        let folder = tempfile::tempdir().unwrap();
        for (path, content) in KEYS.iter().zip(contents) {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, content).unwrap();
        }
        Station::in_folder(folder, keys, on_end)
    }

    fn in_folder(
        folder: tempfile::TempDir,
        keys: &str,
        on_end: impl FnOnce(String) + Send + 'static,
    ) -> Station {
        let users = folder.path().join("users");
        std::fs::write(&users, "plc:secret\n").unwrap();
        std::fs::set_permissions(&users, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
        let file = folder.path().join("station.toml");
        let section = format!("[gateways.opcua]\nlisten = \"127.0.0.1:0\"\npki = \"pki\"\n{keys}\n");
        std::fs::write(&file, format!("station = \"cell-7\"\n{section}")).unwrap();
        let config: OpcUaConfig = StationFile::read(&file).unwrap().gateways.opcua.unwrap();
        let gateway = OpcUa::new("cell-7", &config, on_end).unwrap();
        Station { gateway, folder }
    }

    fn url(&self) -> String {
        format!("opc.tcp://{}/", self.gateway.address())
    }

    async fn connect(
        &self,
        policy: SecurityPolicy,
        mode: MessageSecurityMode,
        user: IdentityToken,
    ) -> Option<Arc<Session>> {
        let endpoint = (self.url().as_str(), policy.to_str(), mode, UserTokenPolicy::anonymous()).into();
        let mut client = client(self.folder.path());
        let endpoint: opcua::types::EndpointDescription = endpoint;
        let (session, events) = client.connect_to_matching_endpoint(endpoint, user).await.ok()?;
        let ends = events.spawn();
        tokio::select! {
            connected = tokio::time::timeout(PATIENCE, session.wait_for_connection()) => {
                connected.ok().filter(|connected| *connected).map(|_| session)
            }
            _ = ends => None,
        }
    }

    async fn plain(&self) -> Option<Arc<Session>> {
        self.connect(SecurityPolicy::None, MessageSecurityMode::None, IdentityToken::Anonymous).await
    }
}

/// A client whose keys are in this folder.
fn client(folder: &Path) -> Client {
    let uri = "urn:test:client";
    ClientBuilder::new()
        .application_name("test")
        .application_uri(uri)
        .pki_dir(folder.join("client"))
        .create_sample_keypair(true)
        .trust_server_certs(true)
        .session_retry_limit(0)
        .session_retry_initial(Duration::from_millis(50))
        .session_timeout(SESSION.as_millis() as u32)
        .client()
        .unwrap()
}

async fn index(session: &Session) -> u16 {
    let names = read_id(session, VariableId::Server_NamespaceArray.into()).await;
    let Some(Variant::Array(names)) = names.value else { panic!("no namespaces") };
    let ours = names.values.iter().position(|name| *name == Variant::from(NAMESPACE));
    ours.expect("the namespace is announced") as u16
}

async fn read_id(session: &Session, id: NodeId) -> DataValue {
    let values = session.read(&[ReadValueId::from(id)], TimestampsToReturn::Both, 0.0).await.unwrap();
    values.into_iter().next().unwrap()
}

async fn id_of(session: &Session, path: &str) -> NodeId {
    NodeId::new(index(session).await, format!("cell-7/{path}"))
}

async fn read(session: &Session, path: &str) -> DataValue {
    read_id(session, id_of(session, path).await).await
}

/// Sends a state and reads a node until a condition holds: a late read finds the values withdrawn.
async fn send_and_read(
    gateway: &mut OpcUa,
    session: &Session,
    latest: &Latest,
    id: NodeId,
    holds: impl Fn(&DataValue) -> bool,
) -> DataValue {
    let begun = tokio::time::Instant::now();
    loop {
        gateway.send(latest);
        let value = read_id(session, id.clone()).await;
        if holds(&value) {
            return value;
        }
        assert!(begun.elapsed() < PATIENCE, "{id}: {value:?}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

fn is_good(value: &DataValue) -> bool {
    value.status() == StatusCode::Good
}

fn run(test: impl Future<Output = ()>) {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(test);
}

#[test]
fn values_come_and_go_with_the_state() {
    let mut station = Station::new("");
    run(async {
        let session = station.plain().await.expect("loopback needs no security");
        let before = read(&session, "SequenceNumber").await;
        assert_eq!(before.status, Some(StatusCode::BadWaitingForInitialData));
        let level = || read_id(&session, VariableId::Server_ServiceLevel.into());
        assert_eq!(level().await.value, Some(Variant::from(1_u8)), "no state yet");

        let (gateway, good) = (&mut station.gateway, Ok(reading(Validity(0))));
        let full = Some(Variant::from(255_u8));
        let id = VariableId::Server_ServiceLevel.into();
        send_and_read(gateway, &session, &good, id, |level| level.value == full).await;
        let id = id_of(&session, "SequenceNumber").await;
        let sequence = send_and_read(gateway, &session, &good, id, is_good).await;
        assert_eq!(sequence.value, Some(Variant::from(4711_u64)));
        let id = id_of(&session, "Joints/L5S1/TorqueMagnitude").await;
        let magnitude = send_and_read(gateway, &session, &good, id.clone(), is_good).await;
        assert_eq!(magnitude.value, Some(Variant::from(13.0)));
        assert!(magnitude.source_timestamp < sequence.source_timestamp, "the moment was before the cycle");
        let unit = read(&session, "Joints/L5S1/TorqueMagnitude/EngineeringUnits").await;
        assert!(matches!(unit.value, Some(Variant::ExtensionObject(_))), "{unit:?}");

        let fault = Ok(reading(Validity::PLATE_FAULT));
        let failed = |value: &DataValue| value.status == Some(StatusCode::BadSensorFailure);
        let magnitude = send_and_read(gateway, &session, &fault, id, failed).await;
        assert!(matches!(magnitude.value, None | Some(Variant::Empty)), "{magnitude:?}");
        let id = id_of(&session, "TorquesUsable").await;
        let usable = send_and_read(gateway, &session, &fault, id, is_good).await;
        assert_eq!(usable.value, Some(Variant::from(false)));

        station.gateway.send(&silence());
        let lifts = read(&session, "Lifts").await;
        assert_eq!(lifts.status, Some(StatusCode::BadNoCommunication));
        assert!(matches!(lifts.value, None | Some(Variant::Empty)), "{lifts:?}");
    });
}

#[test]
fn values_are_withdrawn_when_beats_stay_away() {
    let mut station = Station::new("rate_hz = 50.0");
    run(async {
        let session = station.plain().await.unwrap();
        station.gateway.send(&Ok(reading(Validity(0))));
        let mut last = read(&session, "SequenceNumber").await;
        let asked = tokio::time::Instant::now();
        while last.status() == StatusCode::Good && asked.elapsed() < PATIENCE {
            tokio::time::sleep(Duration::from_millis(20)).await;
            last = read(&session, "SequenceNumber").await;
        }
        assert_eq!(last.status, Some(StatusCode::BadNoCommunication));
        assert_eq!(station.gateway.tally().lost, 1);
        let id = id_of(&session, "SequenceNumber").await;
        send_and_read(&mut station.gateway, &session, &Ok(reading(Validity(0))), id, is_good).await;
    });
}

#[test]
fn subscriptions_hear_of_a_value_and_of_its_end() {
    let mut station = Station::new("");
    run(async {
        let session = station.plain().await.unwrap();
        let (send, mut received) = tokio::sync::mpsc::unbounded_channel();
        let callback = DataChangeCallback::new(move |value, _| {
            let _ = send.send(value.status());
        });
        let every = Duration::from_millis(50);
        let subscription = session.create_subscription(every, 60, 20, 0, 0, true, callback).await.unwrap();
        let id = NodeId::new(index(&session).await, "cell-7/LiftedMass");
        let mut item = MonitoredItemCreateRequest::from(id);
        // With a queue of one value, each replacement sets the overflow bit in the status.
        item.requested_parameters.queue_size = 10;
        session.create_monitored_items(subscription, TimestampsToReturn::Both, vec![item]).await.unwrap();
        let good = || Ok(reading(Validity(0)));
        let beats = [good(), Ok(reading(Validity::BELOW_LOAD_THRESHOLD)), good(), silence(), good()];
        let (yes, no, gone) = (StatusCode::Good, StatusCode::BadNoData, StatusCode::BadNoCommunication);
        for (beat, expected) in beats.iter().zip([yes, no, yes, gone, yes]) {
            let (begun, mut before) = (tokio::time::Instant::now(), Vec::new());
            loop {
                // A value that was withdrawn before a late sampling is sent again.
                station.gateway.send(beat);
                let waiting = async {
                    while let Some(status) = received.recv().await.filter(|status| *status != expected) {
                        before.push(status);
                    }
                };
                if tokio::time::timeout(Duration::from_secs(5), waiting).await.is_ok() {
                    break;
                }
                assert!(begun.elapsed() < PATIENCE, "after {before:?} never received {expected}");
            }
        }
    });
}

/// A state that differs from all earlier ones.
fn other(number: u64) -> Latest {
    let mut reading = reading(Validity(0));
    reading.state.cycle = number;
    Ok(reading)
}

#[test]
fn no_interval_brings_an_old_value_after_its_end() {
    // The subscription's own interval, a long one, and both set by a later modification.
    for (created, modified) in [(-1.0, None), (60_000.0, None), (0.0, Some(-1.0)), (100.0, Some(60_000.0))] {
        let mut station = Station::new("rate_hz = 50.0");
        run(async {
            let session = station.plain().await.unwrap();
            let (send, mut received) = tokio::sync::mpsc::unbounded_channel();
            let callback = DataChangeCallback::new(move |value, _| {
                let _ = send.send(value.status().set_overflow(false));
            });
            let every = Duration::from_millis(50);
            let subscription =
                session.create_subscription(every, 60, 20, 0, 0, true, callback).await.unwrap();
            let id = NodeId::new(index(&session).await, "cell-7/SequenceNumber");
            let mut item = MonitoredItemCreateRequest::from(id);
            (item.requested_parameters.queue_size, item.requested_parameters.sampling_interval) =
                (20, created);
            let made = session.create_monitored_items(subscription, TimestampsToReturn::Both, vec![item]);
            let made = made.await.unwrap();
            if let Some(interval) = modified {
                let requests = [MonitoredItemModifyRequest {
                    monitored_item_id: made[0].result.monitored_item_id,
                    requested_parameters: MonitoringParameters {
                        client_handle: made[0].requested_parameters.client_handle,
                        sampling_interval: interval,
                        queue_size: 20,
                        ..MonitoringParameters::default()
                    },
                }];
                let answer =
                    session.modify_monitored_items(subscription, TimestampsToReturn::Both, &requests);
                assert_eq!(answer.await.unwrap()[0].status_code, StatusCode::Good);
            }
            let mut number = 0;
            // Every tick is a sample, whatever interval was requested.
            let mut good = 0;
            let begun = tokio::time::Instant::now();
            while good < 5 {
                number += 1;
                station.gateway.send(&other(number));
                tokio::time::sleep(Duration::from_millis(10)).await;
                while let Ok(status) = received.try_recv() {
                    good += usize::from(status == StatusCode::Good);
                }
                assert!(begun.elapsed() < PATIENCE, "{created} {modified:?}: {good} of {number} values came");
            }
            for beat in 0..5 {
                station.gateway.send(&other(number + 1 + beat));
            }
            station.gateway.send(&silence());
            let gone = StatusCode::BadNoCommunication;
            let waiting = async { while received.recv().await.is_some_and(|status| status != gone) {} };
            assert!(tokio::time::timeout(PATIENCE, waiting).await.is_ok(), "its end is not received");
            // Ten publishing intervals, during which the watchdog repeats the bad status.
            tokio::time::sleep(10 * every).await;
            while let Ok(status) = received.try_recv() {
                assert_eq!(status, gone, "{created} {modified:?}: after the end");
            }
        });
    }
}

/// A subscription whose notifications are ignored: it lives as long as its session, and for hours after that.
async fn subscribe(session: &Session, items: usize) -> u32 {
    let silent = DataChangeCallback::new(|_, _| ());
    let every = Duration::from_secs(60);
    let subscription = session.create_subscription(every, 300, 100, 0, 0, true, silent).await.unwrap();
    let id = NodeId::new(index(session).await, "cell-7/Lifts");
    let items = vec![MonitoredItemCreateRequest::from(id); items];
    let made = session.create_monitored_items(subscription, TimestampsToReturn::Both, items).await.unwrap();
    assert!(made.iter().all(|item| item.result.status_code == StatusCode::Good));
    subscription
}

/// A client that connects, leaves `items` in the library, and disconnects, with or without deleting its subscription.
async fn come_and_go(station: &Station, items: usize, deletes: bool) {
    let leaving = station.plain().await.unwrap();
    let subscription = subscribe(&leaving, items).await;
    if deletes {
        leaving.delete_subscription(subscription).await.unwrap();
    }
    leaving.disconnect_without_delete_subscriptions().await.unwrap();
}

/// A session with 4000 items, next to clients that come and go and leave 1000 each.
async fn live_while_others_leave(station: &Station, leave: &[bool]) -> Arc<Session> {
    let active = station.plain().await.unwrap();
    for _ in 0..4 {
        subscribe(&active, 1000).await;
    }
    for deletes in leave {
        come_and_go(station, 1000, *deletes).await;
        assert_eq!(read(&active, "Lifts").await.status(), StatusCode::BadWaitingForInitialData);
    }
    active
}

#[test]
fn active_sessions_do_not_terminate_the_server() {
    let (send, ended) = crossbeam_channel::bounded(1);
    let mut station = Station::with("", move |what| send.send(what).unwrap());
    run(async {
        let leave = [true, false, true, false, true, false, true, false];
        let active = live_while_others_leave(&station, &leave).await;
        // Once the other sessions have expired, 12 000 items are counted, of which 4 000 belong to a live session.
        let id = id_of(&active, "Lifts").await;
        let begun = tokio::time::Instant::now();
        while begun.elapsed() < SESSION + COUNTED {
            let good = Ok(reading(Validity(0)));
            send_and_read(&mut station.gateway, &active, &good, id.clone(), is_good).await;
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        assert!(ended.try_recv().is_err());
    });
}

#[test]
fn abandoned_sessions_terminate_the_server_at_the_limit() {
    let (send, ended) = crossbeam_channel::bounded(1);
    let mut station = Station::with("", move |what| send.send(what).unwrap());
    run(async {
        let leave = [true, false, true, false, true, false, true, false, true, false, false];
        let active = live_while_others_leave(&station, &leave).await;
        let begun = tokio::time::Instant::now();
        let why = loop {
            station.gateway.send(&Ok(reading(Validity(0))));
            match ended.try_recv() {
                Ok(why) => break why,
                Err(_) => assert!(begun.elapsed() < PATIENCE, "15 000 items, and none was missed"),
            }
            // A request keeps the session alive.
            let server: NodeId = VariableId::Server_NamespaceArray.into();
            let _ = active.read(&[server.into()], TimestampsToReturn::Both, 0.0).await;
            tokio::time::sleep(Duration::from_millis(50)).await;
        };
        assert!(why.contains("left"), "{why}");
    });
}

#[test]
fn nothing_can_be_written() {
    let mut station = Station::new("");
    run(async {
        let session = station.plain().await.unwrap();
        station.gateway.send(&Ok(reading(Validity(0))));
        let namespace = index(&session).await;
        for path in ["Lifts", "Joints/L5S1/Limit", "Joints/L5S1/Level/EnumStrings"] {
            let write = WriteValue {
                node_id: NodeId::new(namespace, format!("cell-7/{path}")),
                attribute_id: AttributeId::Value as u32,
                value: DataValue::new_now(Variant::from(1.0)),
                ..WriteValue::default()
            };
            let answer = session.write(&[write]).await.unwrap();
            assert!(answer[0].is_bad(), "{path}: {answer:?}");
        }
    });
}

#[test]
fn anonymous_clients_are_refused_where_names_are_required() {
    let station = Station::new("anonymous = false\nusers_file = \"users\"");
    run(async {
        assert!(station.plain().await.is_none());
        for (name, password, lets_in) in
            [("plc", "secret", true), ("plc", "Secret", false), ("x", "secret", false)]
        {
            let user = IdentityToken::UserName(name.to_owned(), password.into());
            let session = station.connect(SecurityPolicy::None, MessageSecurityMode::None, user).await;
            assert_eq!(session.is_some(), lets_in, "{name} {password}");
        }
    });
}

#[test]
fn an_unknown_client_is_accepted_once_its_certificate_is_trusted() {
    let station = Station::new("");
    let pki = station.folder.path().join("pki");
    let (policy, mode) = (SecurityPolicy::Basic256Sha256, MessageSecurityMode::SignAndEncrypt);
    run(async {
        assert!(station.connect(policy, mode, IdentityToken::Anonymous).await.is_none());
        let rejected = only_file(&pki.join("rejected"));
        std::fs::rename(&rejected, pki.join("trusted").join(rejected.file_name().unwrap())).unwrap();
        let session = station.connect(policy, mode, IdentityToken::Anonymous).await.expect("trusted now");
        assert_eq!(read(&session, "Lifts").await.status(), StatusCode::BadWaitingForInitialData);
    });
}

fn only_file(folder: &Path) -> std::path::PathBuf {
    let mut entries = std::fs::read_dir(folder).unwrap();
    let only = entries.next().unwrap().unwrap().path();
    assert!(entries.next().is_none());
    only
}
