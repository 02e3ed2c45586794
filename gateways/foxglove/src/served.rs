//! The WebSocket server and the messages that it publishes.

use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::Context as _;
use equipoise_gateways::{Gateway, Latest, Tally};
use equipoise_view::foxglove::{Channel, MESSAGE_ENCODING, SCHEMA_ENCODING, scene, state_text};
use foxglove::{Context, PartialMetadata, RawChannel, Schema, WebSocketServerHandle};
use tracing::{error, info};

use crate::heartbeat::{self, Heartbeat};

/// Longest queue of one viewer; beyond it the oldest messages are dropped. 0.1 s of all channels at 60 Hz.
pub const BACKLOG: usize = 18;

/// How often to check that the server still runs.
const LOOK_EVERY: Duration = Duration::from_secs(2);

/// Publishes a station to Foxglove and Lichtblick.
pub struct FoxgloveGateway {
    scene: Arc<RawChannel>,
    state: Arc<RawChannel>,
    heartbeat: Arc<RawChannel>,
    address: SocketAddr,
    server: WebSocketServerHandle,
    ticks: u64,
    tally: Tally,
    looked: Instant,
    /// Called once when the server has ended.
    on_end: Option<Box<dyn FnOnce(String) + Send>>,
    /// Must outlive the channels.
    _context: Arc<Context>,
    /// Dropping it ends the server's threads.
    _runtime: tokio::runtime::Runtime,
}

impl FoxgloveGateway {
    /// Serves the station at an address; port 0 selects a free one. `on_end` is called if the server ends by itself.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub fn start(
        station: &str,
        listen: SocketAddr,
        on_end: impl FnOnce(String) + Send + 'static,
    ) -> anyhow::Result<FoxgloveGateway> {
        let context = Context::new();
        let [scene, state] = [Channel::SCENE, Channel::STATE]
            .map(|channel| open(&context, channel.topic, channel.schema_name, channel.schema_text()));
        let heartbeat =
            open(&context, heartbeat::TOPIC, heartbeat::SCHEMA_NAME, heartbeat::schema().to_string());
        // One thread is enough for viewers, and leaves the other cores to the loop.
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("foxglove")
            .enable_all()
            .build()
            .context("the server's thread")?;
        let server = context
            .websocket_server()
            .name(format!("equipoise, station {station}"))
            .bind(listen.ip().to_string(), listen.port())
            .message_backlog_size(BACKLOG);
        let server = runtime.block_on(server.start()).with_context(|| {
            format!("gateways.foxglove.listen: cannot serve at {listen}; is another program there?")
        })?;
        info!("Foxglove and Lichtblick: open a connection to ws://{}:{}", listen.ip(), server.port());
        let (ticks, tally) = (0, Tally::default());
        let (scene, state, heartbeat) = (scene?, state?, heartbeat?);
        Ok(FoxgloveGateway {
            scene,
            state,
            heartbeat,
            address: SocketAddr::new(listen.ip(), server.port()),
            server,
            ticks,
            tally,
            looked: Instant::now(),
            on_end: Some(Box::new(on_end)),
            _context: context,
            _runtime: runtime,
        })
    }

    /// The port on which the server listens.
    pub fn port(&self) -> u16 {
        self.server.port()
    }

    /// The library's server ends for good, without an error, at the first connection that it cannot accept, for example
    /// when the process has reached its limit of open files. Its port is then free, which is what this check detects.
    fn look_after_the_server(&mut self) {
        if self.looked.elapsed() < LOOK_EVERY {
            return;
        }
        self.looked = Instant::now();
        if TcpListener::bind(self.address).is_ok()
            && let Some(on_end) = self.on_end.take()
        {
            on_end(format!("the server at {} has ended; were there too many connections?", self.address));
        }
    }

    /// Publishes a message to the viewers of a channel. Without viewers the message is not encoded.
    fn show(
        tally: &mut Tally,
        channel: &RawChannel,
        time_ns: u64,
        text: impl FnOnce() -> serde_json::Result<String>,
    ) {
        if !channel.has_sinks() {
            return;
        }
        match text() {
            Ok(text) => {
                channel.log_with_meta(text.as_bytes(), PartialMetadata::with_log_time(time_ns));
                tally.sent += 1;
            }
            Err(error) => {
                error!("{}: {error}", channel.topic());
                tally.lost += 1;
            }
        }
    }
}

fn open(
    context: &Arc<Context>,
    topic: &str,
    schema_name: &str,
    schema_text: String,
) -> anyhow::Result<Arc<RawChannel>> {
    let schema = Schema::new(schema_name, SCHEMA_ENCODING, schema_text.into_bytes());
    let channel = context.channel_builder(topic).message_encoding(MESSAGE_ENCODING).schema(schema);
    channel.build_raw().with_context(|| format!("the channel {topic}"))
}

impl Gateway for FoxgloveGateway {
    /// Messages carry wall-clock times, because viewers display them next to other live sources: the time of the
    /// state's cycle, or now if there is no state.
    fn send(&mut self, latest: &Latest) {
        self.look_after_the_server();
        self.ticks += 1;
        let now_ns = unix_ns();
        let heartbeat = Heartbeat::of(self.ticks, latest);
        let tally = &mut self.tally;
        match latest {
            Ok(reading) => {
                let time_ns = now_ns.saturating_sub(reading.age_ns);
                let state = &reading.state;
                Self::show(tally, &self.scene, time_ns, || scene::of(state, time_ns).to_text());
                Self::show(tally, &self.state, time_ns, || state_text(state));
            }
            Err(reason) => {
                let why = reason.to_string();
                Self::show(tally, &self.scene, now_ns, || scene::nothing(&why, now_ns).to_text());
            }
        }
        Self::show(tally, &self.heartbeat, now_ns, || serde_json::to_string(&heartbeat));
    }

    /// `sent` counts each message once, regardless of the number of viewers. The library does not report the messages
    /// that a slow viewer loses; gaps in `sequence` reveal them.
    fn tally(&self) -> Tally {
        Tally { peers: self.server.client_count() as u64, ..self.tally }
    }
}

fn unix_ns() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(0)
}
