//! The gateway: each tick puts a message into the mailbox, and a thread maintains the connection and sends it.

use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use crossbeam_channel::{Receiver, bounded};
use equipoise_core::message::Printable;
use equipoise_gateways::config::MqttConfig;
use equipoise_gateways::{Gateway, Latest, Tally};
use tracing::{info, warn};

use crate::document::{self, Summary};
use crate::mailbox::{Mailbox, Sending, mailbox};
use crate::session::{PATIENCE, Session, SessionError, Target};

/// Longest error text in the log.
const ERROR_CHARS_MAX: usize = 500;
const BACKOFF_MIN: Duration = Duration::from_millis(500);
const BACKOFF_MAX: Duration = Duration::from_secs(30);

/// Payloads of one tick.
struct Message {
    summary: Vec<u8>,
    state: Option<Vec<u8>>,
}

#[derive(Default)]
struct Shared {
    sent: AtomicU64,
    failed: AtomicU64,
    connected: AtomicBool,
}

/// Publishes a station's states to an MQTT broker.
pub struct Mqtt {
    station: String,
    motion: bool,
    /// `None` while the gateway ends.
    messages: Option<Sending<Message>>,
    shared: Arc<Shared>,
    /// Disconnected once the connection thread has ended.
    ended: Receiver<Infallible>,
}

impl Mqtt {
    /// Reads certificates and passtext, and starts to connect. The broker need not be reachable.
    ///
    /// # Errors
    /// A file cannot be used, or the thread cannot be started.
    pub fn new(station: &str, config: &MqttConfig) -> anyhow::Result<Mqtt> {
        let target = Target::new(station, config)?;
        let shared = Arc::new(Shared::default());
        let (messages, mailbox) = mailbox();
        let connection =
            Connection { shared: Arc::clone(&shared), mailbox, target, station: station.to_owned() };
        let (running, ended) = bounded(0);
        std::thread::Builder::new().name("mqtt".to_owned()).spawn(move || {
            let _running = running;
            connection.run();
        })?;
        let messages = Some(messages);
        Ok(Mqtt { station: station.to_owned(), motion: config.motion, messages, shared, ended })
    }
}

impl Gateway for Mqtt {
    fn send(&mut self, latest: &Latest) {
        let utc_s = document::now_utc_s();
        let summary = Summary::new(&self.station, latest, utc_s).to_bytes();
        let state = self.motion.then(|| document::state(latest, utc_s)).flatten();
        if let Some(messages) = &mut self.messages {
            messages.put(Message { summary, state });
        }
    }

    /// `sent`: ticks that the broker has acknowledged. `lost`: ticks replaced by a newer one or whose connection broke.
    fn tally(&self) -> Tally {
        Tally {
            sent: self.shared.sent.load(Ordering::Relaxed),
            lost: self.messages.as_ref().map_or(0, Sending::replaced)
                + self.shared.failed.load(Ordering::Relaxed),
            peers: u64::from(self.shared.connected.load(Ordering::Relaxed)),
        }
    }
}

impl Drop for Mqtt {
    /// Waits for a limited time until the broker has acknowledged `offline`; otherwise the last will publishes it.
    fn drop(&mut self) {
        self.messages = None;
        let _ = self.ended.recv_timeout(PATIENCE);
    }
}

/// Maintains the connection.
struct Connection {
    shared: Arc<Shared>,
    mailbox: Mailbox<Message>,
    target: Target,
    station: String,
}

impl Connection {
    fn run(&self) {
        let mut backoff = BACKOFF_MIN;
        let mut logged = None;
        loop {
            let mut acknowledged = 0;
            let outcome = Session::open(&self.target).and_then(|session| {
                info!("connected to the broker");
                self.serve(session, &mut acknowledged)
            });
            self.shared.connected.store(false, Ordering::Relaxed);
            let Err(error) = outcome else { return };
            if acknowledged > 0 {
                (backoff, logged) = (BACKOFF_MIN, None);
            }
            // The text may come from the broker, so it is made printable and limited in length.
            let text = Printable { text: &error.to_string(), chars_max: ERROR_CHARS_MAX }.to_string();
            if logged.as_ref() != Some(&text) {
                warn!("{text}; retrying, at intervals of up to {} s", BACKOFF_MAX.as_secs());
                logged = Some(text);
            }
            if !self.mailbox.pause(with_jitter(backoff)) {
                return;
            }
            backoff = (2 * backoff).min(BACKOFF_MAX);
        }
    }

    /// Sends until the mailbox is closed or the connection fails; `acknowledged` counts acknowledged messages.
    fn serve(&self, mut session: Session, acknowledged: &mut u64) -> Result<(), SessionError> {
        self.shared.connected.store(true, Ordering::Relaxed);
        loop {
            let Some(message) = self.mailbox.take() else { return session.close() };
            if let Err(error) = self.publish(&mut session, message) {
                self.shared.failed.fetch_add(1, Ordering::Relaxed);
                return Err(error);
            }
            *acknowledged += 1;
            self.shared.sent.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn publish(&self, session: &mut Session, message: Message) -> Result<(), SessionError> {
        session.publish(&format!("equipoise/{}/summary", self.station), message.summary)?;
        match message.state {
            Some(state) => session.publish(&format!("equipoise/{}/state", self.station), state),
            None => Ok(()),
        }
    }
}

/// Adds up to 50 %, so that the stations of a plant do not all reconnect to the broker at the same instant.
fn with_jitter(wait: Duration) -> Duration {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    wait + wait.mul_f64(f64::from(now.subsec_micros() % 1000) / 2000.0)
}
