//! The gateway: messages of a tick, their keys and their transport settings.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::anyhow;
use equipoise_gateways::config::ZenohConfig;
use equipoise_gateways::{Gateway, Latest, Tally};
use tracing::warn;
use zenoh::bytes::Encoding;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait};

use crate::json::JsonMessage;
use crate::ros::{RosNames, attachment, state_message};
use crate::session;

/// How often peers are counted.
const COUNT_EVERY: Duration = Duration::from_secs(1);

/// Publisher of a station.
pub struct ZenohGateway {
    station: String,
    /// ID of the session, which liveliness tokens contain.
    session_id: String,
    json: Stream,
    ros: Stream,
    gid: [u8; 16],
    /// Whether to publish the worker's mass and centre of mass.
    with_body: bool,
    json_period: Duration,
    json_due: Instant,
    counted: Instant,
    tally: Tally,
    /// Dropping them withdraws the tokens; the session outlives them.
    _tokens: Vec<LivelinessToken>,
    session: Session,
}

/// A publisher on one key, and the number of messages it published.
struct Stream {
    publisher: Publisher<'static>,
    sequence: u64,
}

impl Stream {
    /// Slow subscribers lose messages: publishing never blocks. Urgent messages are sent at once, one per packet;
    /// others wait up to a millisecond for messages on the same link, which reduces the load of a router and of a
    /// dashboard of many stations.
    fn declare(session: &Session, key: &str, encoding: Encoding, urgent: bool) -> anyhow::Result<Stream> {
        let publisher = session
            .declare_publisher(key.to_owned())
            .encoding(encoding)
            .congestion_control(CongestionControl::Drop)
            .priority(if urgent { Priority::RealTime } else { Priority::Data })
            .express(urgent)
            .wait()
            .map_err(|error| anyhow!("cannot publish at {key}: {error}"))?;
        Ok(Stream { publisher, sequence: 0 })
    }
}

/// Key of a station's JSON; dashboards subscribe to `equipoise/*/state`.
pub fn json_key(station: &str) -> String {
    format!("equipoise/{station}/state")
}

/// Liveliness token that exists while a station's gateway runs and is reachable.
pub fn alive_key(station: &str) -> String {
    format!("equipoise/{station}/alive")
}

impl ZenohGateway {
    /// Opens a session as configured and declares publishers and tokens.
    ///
    /// # Errors
    /// Those of [`session::open`].
    pub fn open(station: &str, config: &ZenohConfig) -> anyhow::Result<ZenohGateway> {
        ZenohGateway::on(session::open(config)?, station, config)
    }

    fn on(session: Session, station: &str, config: &ZenohConfig) -> anyhow::Result<ZenohGateway> {
        let session_id = session.zid().to_string();
        let names = RosNames::new(station, config.ros_domain_id, &session_id);
        let json = Stream::declare(&session, &json_key(station), Encoding::APPLICATION_JSON, false)?;
        let ros = Stream::declare(&session, &names.topic_key, Encoding::default(), true)?;
        let tokens = [alive_key(station), names.node_token.clone(), names.publisher_token.clone()]
            .into_iter()
            .map(|key| {
                let token = session.liveliness().declare_token(key.clone()).wait();
                token.map_err(|error| anyhow!("cannot declare {key}: {error}"))
            })
            .collect::<anyhow::Result<Vec<_>>>()?;
        let now = Instant::now();
        Ok(ZenohGateway {
            station: station.to_owned(),
            session_id,
            json,
            ros,
            gid: names.gid(),
            with_body: config.body,
            json_period: Duration::from_secs_f64(1.0 / config.json_rate_hz),
            json_due: now,
            counted: now,
            tally: Tally::default(),
            _tokens: tokens,
            session,
        })
    }

    fn publish_ros(&mut self, latest: &Latest, now_unix_ns: u64) {
        self.ros.sequence += 1;
        let payload = state_message(&self.station, self.ros.sequence, now_unix_ns, latest, self.with_body);
        let attachment = attachment(self.ros.sequence, now_unix_ns, self.gid);
        let put = self.ros.publisher.put(payload).attachment(attachment).wait();
        count(&mut self.tally, put);
    }

    fn publish_json(&mut self, latest: &Latest, now_unix_ns: u64) {
        self.json.sequence += 1;
        let message = JsonMessage {
            station: &self.station,
            session: &self.session_id,
            sequence: self.json.sequence,
            sent_unix_ns: now_unix_ns,
            latest,
            with_body: self.with_body,
        };
        match message.to_text() {
            Ok(text) => count(&mut self.tally, self.json.publisher.put(text).wait()),
            Err(error) => {
                self.tally.lost += 1;
                warn!("cannot write a state as JSON: {error}");
            }
        }
    }
}

impl Gateway for ZenohGateway {
    fn send(&mut self, latest: &Latest) {
        let now_unix_ns = unix_ns();
        self.publish_ros(latest, now_unix_ns);
        let now = Instant::now();
        if now >= self.json_due {
            self.publish_json(latest, now_unix_ns);
            self.json_due = (self.json_due + self.json_period).max(now);
        }
        if now.duration_since(self.counted) >= COUNT_EVERY {
            self.counted = now;
            let info = self.session.info();
            self.tally.peers = (info.peers_zid().wait().count() + info.routers_zid().wait().count()) as u64;
        }
    }

    /// Messages dropped by a peer's full queue are not counted, because Zenoh does not report them; the peer detects
    /// them by the sequence number.
    fn tally(&self) -> Tally {
        self.tally
    }
}

fn count<E>(tally: &mut Tally, put: Result<(), E>) {
    match put {
        Ok(()) => tally.sent += 1,
        Err(_) => tally.lost += 1,
    }
}

/// Wall-clock time, ns since 1970; 0 if it is earlier.
fn unix_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64)
}
