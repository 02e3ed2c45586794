//! Further subjects on one suit port: each is published to a separate station by a separate thread.
//!
//! A station that does not exist, that another process publishes, or whose bus fails is retried without loss for the
//! other stations: its thread receives copies through a queue that never blocks.

use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use equipoise_adapters::clock::now_monotonic_ns;
use equipoise_bus::{Bus, BusSettings, Channel, Event, Notifier, Publisher};
use equipoise_config::suit::ForwardedSuit;
use equipoise_core::message::{AdapterHealth, SuitBody, SuitSample};
use tracing::{info, warn};

use super::{AdapterError, SUIT_ROLE, exclusive_publisher};

/// A quarter of a second at 240 Hz: longer than joining a bus takes.
const QUEUE: usize = 64;
/// Interval between attempts to reach a station.
const RETRY: Duration = Duration::from_secs(2);
/// Timeout of receiving from the queue, after which the station is checked without samples.
const POLL_INTERVAL: Duration = Duration::from_millis(200);

/// A message for another station.
pub(super) enum Message {
    /// A sample of its subject.
    Sample(Box<SuitSample>),
    /// Body dimensions of its subject.
    Body(Box<SuitBody>),
    /// Health of its subject's stream.
    Health(Box<AdapterHealth>),
}

/// The stations of the other subjects.
pub(super) struct Forwarders(Vec<Forwarder>);

struct Forwarder {
    avatar: u8,
    station: String,
    queue: Option<Sender<Message>>,
    thread: Option<JoinHandle<()>>,
    /// Whether the queue was full at the last message.
    full: bool,
}

impl Forwarders {
    /// Starts a thread for each station.
    pub(super) fn start(suits: &[ForwardedSuit]) -> Forwarders {
        Forwarders(suits.iter().map(Forwarder::start).collect())
    }

    /// Passes a sample on if it belongs to one of the other stations; returns whether it does.
    pub(super) fn forward(&mut self, sample: &SuitSample) -> bool {
        let forwarder = self.0.iter_mut().find(|forwarder| u32::from(forwarder.avatar) == sample.avatar);
        let is_forwarded = forwarder.is_some();
        if let Some(forwarder) = forwarder {
            forwarder.enqueue(Message::Sample(Box::new(*sample)));
        }
        is_forwarded
    }

    /// Sends body dimensions to each station once available.
    pub(super) fn publish_bodies(&mut self, mut body: impl FnMut(u8) -> Option<SuitBody>) {
        for forwarder in &mut self.0 {
            if let Some(body) = body(forwarder.avatar) {
                forwarder.enqueue(Message::Body(Box::new(body)));
            }
        }
    }

    /// Sends the health of its stream to each station.
    pub(super) fn publish_health(&mut self, mut health: impl FnMut(u8) -> Option<AdapterHealth>) {
        for forwarder in &mut self.0 {
            if let Some(health) = health(forwarder.avatar) {
                forwarder.enqueue(Message::Health(Box::new(health)));
            }
        }
    }
}

impl Forwarder {
    fn start(suit: &ForwardedSuit) -> Forwarder {
        let (queue, message) = bounded(QUEUE);
        let station = suit.station.clone();
        // The thread inherits the priority of the adapter. If it cannot be started, its station receives nothing.
        let name = format!("suit {}", suit.avatar);
        let thread = std::thread::Builder::new().name(name).spawn(move || publish(&station, &message));
        if let Err(error) = &thread {
            warn!("suit.forwarded: station {} gets nothing: no thread can be had: {error}", suit.station);
        }
        Forwarder {
            avatar: suit.avatar,
            station: suit.station.clone(),
            queue: Some(queue),
            thread: thread.ok(),
            full: false,
        }
    }

    /// Queues a message, or drops it if the thread is behind.
    fn enqueue(&mut self, message: Message) {
        let was_full = self.full;
        self.full = self.queue.as_ref().is_some_and(|queue| queue.try_send(message).is_err());
        if self.full && !was_full {
            warn!("suit.forwarded: station {} is behind and loses samples of its suit", self.station);
        }
    }
}

impl Drop for Forwarder {
    fn drop(&mut self) {
        // Closing the queue ends the thread.
        self.queue = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Publishes messages until the queue is closed.
fn publish(station: &str, message: &Receiver<Message>) {
    let mut ports = None;
    let mut retry_at = Instant::now();
    let mut logged = None;
    loop {
        let message = match message.recv_timeout(POLL_INTERVAL) {
            Ok(message) => Some(message),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => return,
        };
        let outcome = match &ports {
            Some(ports) => message.map_or(Ok(()), |message| Ports::send(ports, message)),
            None if Instant::now() < retry_at => continue,
            None => Ports::open(station).map(|opened| {
                info!("the suit of station {station} is published here too (suit.forwarded)");
                logged = None;
                ports = Some(opened);
            }),
        };
        if let Err(error) = outcome {
            ports = None;
            retry_at = Instant::now() + RETRY;
            let reason = error.to_string();
            if logged.as_ref() != Some(&reason) {
                warn!(
                    "suit.forwarded: station {station} gets no samples of its suit: {reason}; it is tried again"
                );
                logged = Some(reason);
            }
        }
    }
}

/// Publishers on another station's bus.
struct Ports {
    samples: Publisher<SuitSample>,
    bodies: Publisher<SuitBody>,
    health: Publisher<AdapterHealth>,
    wake: Notifier,
    /// Declared last, so that it is dropped after the ports above.
    _bus: Bus,
}

impl Ports {
    fn open(station: &str) -> Result<Ports, AdapterError> {
        let bus = Bus::join(&BusSettings::new(station, SUIT_ROLE))?;
        Ok(Ports {
            samples: exclusive_publisher(&bus, SUIT_ROLE)?,
            bodies: exclusive_publisher(&bus, SUIT_ROLE)?,
            health: bus.publisher()?,
            wake: bus.notifier(Channel::Inputs)?,
            _bus: bus,
        })
    }

    fn send(&self, message: Message) -> Result<(), AdapterError> {
        match message {
            Message::Sample(mut sample) => {
                sample.published_ns = now_monotonic_ns();
                self.samples.send(&sample)?;
                self.wake.notify(Event::NewSuit)?;
                self.health.update_connections()?;
            }
            Message::Body(mut body) => {
                body.published_ns = now_monotonic_ns();
                self.bodies.send(&body)?;
            }
            Message::Health(health) => {
                self.health.send(&health)?;
                self.samples.update_connections()?;
                self.bodies.update_connections()?;
            }
        }
        Ok(())
    }
}
