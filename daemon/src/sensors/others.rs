//! Further subjects on one suit port: each is published to a separate station by a separate thread.
//!
//! A station that does not exist, that another process publishes, or whose bus fails is retried without loss for the
//! other stations: its thread receives copies through a queue that never blocks.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use equipoise_adapters::clock::now_monotonic_ns;
use equipoise_bus::{Bus, BusSettings, Channel, Event, Notifier, Publisher};
use equipoise_core::message::{AdapterHealth, SuitBody, SuitSample};
use tracing::{info, warn};

use super::{AdapterError, SUIT_ROLE, only_publisher};
use crate::config::suit::OtherWorker;

/// A quarter of a second at 240 Hz: longer than joining a bus takes.
const QUEUE: usize = 64;
/// Interval between attempts to reach a station.
const RETRY: Duration = Duration::from_secs(2);
/// Timeout of receiving from the queue, after which the station is checked without samples.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// A message for another station.
pub(super) enum Said {
    /// A sample of its subject.
    Sample(Box<SuitSample>),
    /// Body dimensions of its subject.
    Body(Box<SuitBody>),
    /// Health of its subject's stream.
    Health(Box<AdapterHealth>),
}

/// The stations of the other subjects.
pub(super) struct Others(Vec<Other>);

struct Other {
    avatar: u8,
    station: String,
    queue: Option<SyncSender<Said>>,
    thread: Option<JoinHandle<()>>,
    /// Whether the queue was full at the last message.
    full: bool,
}

impl Others {
    /// Starts a thread for each station.
    pub(super) fn start(workers: &[OtherWorker]) -> Others {
        Others(workers.iter().map(Other::start).collect())
    }

    /// Passes a sample on if it belongs to one of the other stations; returns whether it does.
    pub(super) fn take(&mut self, sample: &SuitSample) -> bool {
        let other = self.0.iter_mut().find(|other| u32::from(other.avatar) == sample.avatar);
        let is_theirs = other.is_some();
        if let Some(other) = other {
            other.say(Said::Sample(Box::new(*sample)));
        }
        is_theirs
    }

    /// Sends body dimensions to each station once available.
    pub(super) fn tell_builds(&mut self, mut body: impl FnMut(u8) -> Option<SuitBody>) {
        for other in &mut self.0 {
            if let Some(body) = body(other.avatar) {
                other.say(Said::Body(Box::new(body)));
            }
        }
    }

    /// Sends the health of its stream to each station.
    pub(super) fn tell(&mut self, mut health: impl FnMut(u8) -> Option<AdapterHealth>) {
        for other in &mut self.0 {
            if let Some(health) = health(other.avatar) {
                other.say(Said::Health(Box::new(health)));
            }
        }
    }
}

impl Other {
    fn start(worker: &OtherWorker) -> Other {
        let (queue, said) = sync_channel(QUEUE);
        let station = worker.station.clone();
        // The thread inherits the priority of the adapter. If it cannot be started, its station receives nothing.
        let name = format!("suit {}", worker.avatar);
        let thread = std::thread::Builder::new().name(name).spawn(move || publish(&station, &said));
        if let Err(error) = &thread {
            warn!("suit.others: station {} gets nothing: no thread can be had: {error}", worker.station);
        }
        Other {
            avatar: worker.avatar,
            station: worker.station.clone(),
            queue: Some(queue),
            thread: thread.ok(),
            full: false,
        }
    }

    /// Queues a message, or drops it if the thread is behind.
    fn say(&mut self, said: Said) {
        let was_full = self.full;
        self.full = self.queue.as_ref().is_some_and(|queue| queue.try_send(said).is_err());
        if self.full && !was_full {
            warn!("suit.others: station {} is behind and loses samples of its suit", self.station);
        }
    }
}

impl Drop for Other {
    fn drop(&mut self) {
        // Closing the queue ends the thread.
        self.queue = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Publishes messages until the queue is closed.
fn publish(station: &str, said: &Receiver<Said>) {
    let mut link = None;
    let mut try_at = Instant::now();
    let mut logged = None;
    loop {
        let said = match said.recv_timeout(LOOK_EVERY) {
            Ok(said) => Some(said),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => return,
        };
        let outcome = match &link {
            Some(link) => said.map_or(Ok(()), |said| Link::pass_on(link, said)),
            None if Instant::now() < try_at => continue,
            None => Link::open(station).map(|opened| {
                info!("the suit of station {station} is published here too (suit.others)");
                logged = None;
                link = Some(opened);
            }),
        };
        if let Err(error) = outcome {
            link = None;
            try_at = Instant::now() + RETRY;
            let why = error.to_string();
            if logged.as_ref() != Some(&why) {
                warn!("suit.others: station {station} gets no samples of its suit: {why}; it is tried again");
                logged = Some(why);
            }
        }
    }
}

/// Publishers on another station's bus.
struct Link {
    samples: Publisher<SuitSample>,
    bodies: Publisher<SuitBody>,
    health: Publisher<AdapterHealth>,
    wake: Notifier,
    /// Declared last, so that it is dropped after the ports above.
    _bus: Bus,
}

impl Link {
    fn open(station: &str) -> Result<Link, AdapterError> {
        let bus = Bus::join(&BusSettings::new(station, SUIT_ROLE))?;
        Ok(Link {
            samples: only_publisher(&bus, SUIT_ROLE)?,
            bodies: only_publisher(&bus, SUIT_ROLE)?,
            health: bus.publisher()?,
            wake: bus.notifier(Channel::Inputs)?,
            _bus: bus,
        })
    }

    fn pass_on(&self, said: Said) -> Result<(), AdapterError> {
        match said {
            Said::Sample(mut sample) => {
                sample.published_ns = now_monotonic_ns();
                self.samples.send(&sample)?;
                self.wake.notify(Event::NewSuit)?;
            }
            Said::Body(mut body) => {
                body.published_ns = now_monotonic_ns();
                self.bodies.send(&body)?;
            }
            Said::Health(health) => {
                self.health.send(&health)?;
                self.samples.update_connections()?;
                self.bodies.update_connections()?;
            }
        }
        Ok(())
    }
}
