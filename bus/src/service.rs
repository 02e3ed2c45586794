//! Table of the services of a station: payload, writers, rate, and queue lengths.
//!
//! The first process that opens a service sets its limits, so all limits are defined here.

use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::{
    AdapterHealth, Command, ConsumerReceipt, CycleRecord, EarlyState, GroundSample, HandoverRequest,
    Incidents, Message, State, SuitBody, SuitSample,
};
use std::fmt;
use std::time::Duration;

use crate::command::Request;
use crate::error::BusError;
use crate::node::Bus;
use crate::publisher::{Publisher, RetainedService};
use crate::subscriber::Subscriber;
use crate::words::{self, Each, folded};

/// Maximum number of processes and threads per service.
pub const NODES_MAX: usize = 64;
/// Additional publishers of a service: one, while a process replaces another. An exclusive service has none.
pub const HAND_OVER: usize = 1;
/// Maximum number of messages that a subscriber borrows at the same time.
pub const BORROWED_MAX: usize = 2;
/// Maximum number of clients of a request–response service.
pub const CLIENTS_MAX: usize = 16;
/// Maximum number of notifiers of an event service: each client and each adapter is one.
pub const NOTIFIERS_MAX: usize = 32;
/// Maximum number of listeners of an event service; each sleeping listener costs a notifier 4 to 10 µs.
pub const LISTENERS_MAX: usize = 24;
/// Service attribute with the schema; iceoryx2 itself compares type names and sizes only.
pub const SCHEMA_KEY: &str = "equipoise.schema";
/// Upper bound of iceoryx2's header before each payload, with alignment, bytes.
const HEADER_BYTES: usize = 64;

/// A service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Service {
    /// Last part of the name `equipoise/<station>/<suffix>`.
    pub suffix: &'static str,
    /// Type name of the payload.
    pub payload: &'static str,
    /// Size of the payload, bytes.
    pub payload_bytes: usize,
    /// Component that publishes it.
    pub writer: &'static str,
    /// Number of simultaneous publishers, except during a hand-over.
    pub writers: usize,
    /// Whether additional publishers are refused even for a hand-over, so that no two processes publish the same data.
    pub exclusive: bool,
    /// Rate, in words.
    pub rate: &'static str,
    /// Silence after which the stream is stale; `None`: never.
    pub deadline: Option<Duration>,
    /// Default queue length of a subscriber, messages.
    pub depth: usize,
    /// Maximum queue length of a subscriber, messages.
    pub depth_max: usize,
    /// Maximum number of subscribers.
    pub subscribers_max: usize,
    /// Number of past messages that a new subscriber receives.
    pub history: usize,
}

impl Service {
    /// Full name of the service on a station.
    pub fn name(&self, station: &str) -> String {
        full_name(station, self.suffix)
    }

    /// Maximum number of publishers: the writers, and one that replaces one of them.
    pub const fn publishers_max(&self) -> usize {
        if self.exclusive { self.writers } else { self.writers + HAND_OVER }
    }

    /// Upper bound of the shared memory of all its regular writers, bytes.
    pub const fn memory_bytes(&self) -> usize {
        let chunks = self.subscribers_max * (self.depth_max + BORROWED_MAX) + self.history + 1;
        self.writers * chunks * (self.payload_bytes + HEADER_BYTES)
    }
}

/// `equipoise/<station>/<suffix>`.
pub(crate) fn full_name(station: &str, suffix: &str) -> String {
    format!("equipoise/{station}/{suffix}")
}

/// A published message and its service.
pub trait Topic: Message {
    /// Its service.
    const SERVICE: Service;

    /// Passes each name with a number in the message: its kind, name and number ([`crate::words`]).
    fn words(_each: Each<'_>) {}

    /// Schema that writers and readers must share: the hash of the fields and of the names with numbers.
    fn schema() -> u64
    where
        Self: Sized,
    {
        folded(Self::SCHEMA_HASH, Self::words)
    }

    /// [`Bus::publisher`] with all generic code of iceoryx2 that it needs.
    ///
    /// The implementations in the table repeat the provided body: only a function of a concrete type is compiled once,
    /// in this crate. A generic function is compiled again in every crate that calls it.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    #[doc(hidden)]
    fn open_publisher(bus: &Bus) -> Result<Publisher<Self>, BusError> {
        Publisher::open(bus)
    }

    /// [`Bus::subscriber`], likewise.
    ///
    /// # Errors
    /// As [`Bus::subscriber`].
    #[doc(hidden)]
    fn open_subscriber(bus: &Bus, depth: usize) -> Result<Subscriber<Self>, BusError> {
        Subscriber::open(bus, depth)
    }

    /// [`Bus::retain`], likewise.
    ///
    /// # Errors
    /// As [`Bus::retain`].
    #[doc(hidden)]
    fn open_retained(bus: &Bus) -> Result<RetainedService<Self>, BusError> {
        RetainedService::open(bus)
    }
}

macro_rules! topics {
    ($($Message:ty => $suffix:literal, by $writers:literal $writer:literal, $rate:literal, deadline $deadline:expr,
       depth $depth:literal of $depth_max:literal, $subscribers:literal subscribers $(, $exclusive:ident)?
       $(with $words:path)?;)*) => {
        $(impl Topic for $Message {
            const SERVICE: Service = Service {
                suffix: $suffix,
                payload: <$Message as Message>::TYPE_NAME,
                payload_bytes: size_of::<$Message>(),
                writer: $writer,
                writers: $writers,
                exclusive: topics!(@ $($exclusive)?),
                rate: $rate,
                deadline: $deadline,
                depth: $depth,
                depth_max: $depth_max,
                subscribers_max: $subscribers,
                history: 1,
            };

            $(fn words(each: Each<'_>) {
                $words(each);
            })?

            #[inline(never)]
            fn open_publisher(bus: &Bus) -> Result<Publisher<$Message>, BusError> {
                Publisher::open(bus)
            }

            #[inline(never)]
            fn open_subscriber(bus: &Bus, depth: usize) -> Result<Subscriber<$Message>, BusError> {
                Subscriber::open(bus, depth)
            }

            #[inline(never)]
            fn open_retained(bus: &Bus) -> Result<RetainedService<$Message>, BusError> {
                RetainedService::open(bus)
            }
        })*

        /// All publish-subscribe services of a station.
        pub const TABLE: &[Service] = &[$(<$Message as Topic>::SERVICE),*];
    };
    (@ exclusive) => { true };
    (@) => { false };
}

const fn ms(milliseconds: u64) -> Option<Duration> {
    Some(Duration::from_millis(milliseconds))
}

topics! {
    SuitSample => "suit", by 1 "suit adapter", "60-240 Hz", deadline ms(40), depth 64 of 128, 16 subscribers, exclusive;
    GroundSample => "ground", by 1 "ground adapter", "1 kHz", deadline ms(5), depth 256 of 1024, 16 subscribers, exclusive;
    SuitBody => "body", by 1 "suit adapter", "1 Hz and on change", deadline None, depth 4 of 8, 16 subscribers, exclusive;
    State => "state", by 1 "daemon", "loop rate", deadline ms(25), depth 8 of 1024, 24 subscribers with words::of_state;
    EarlyState => "early", by 1 "daemon", "suit rate", deadline ms(40), depth 4 of 256, 24 subscribers with words::of_early_state;
    CycleRecord => "cycle", by 1 "daemon", "loop rate", deadline ms(25), depth 1024 of 1024, 16 subscribers;
    Checkpoint => "checkpoint", by 1 "daemon", "on request", deadline None, depth 1 of 2, 4 subscribers;
    AdapterHealth => "health", by 2 "adapters", "1 Hz", deadline ms(2500), depth 8 of 16, 16 subscribers;
    Incidents => "incidents", by 1 "daemon", "1 Hz and on change", deadline ms(2500), depth 1 of 8, 16 subscribers;
    ConsumerReceipt => "receipt", by 16 "consumers", "1 Hz", deadline None, depth 16 of 32, 2 subscribers;
}

/// Upper bound of a station's shared memory with the regular writers, bytes.
pub const STATION_MEMORY_MAX: usize = 126_000_000;
const _: () = assert!(station_memory_bytes() < STATION_MEMORY_MAX);

/// Upper bound of the shared memory of one station, bytes.
pub const fn station_memory_bytes() -> usize {
    let (mut sum, mut row) = (0, 0);
    while row < TABLE.len() {
        sum += TABLE[row].memory_bytes();
        row += 1;
    }
    sum
}

/// The table in Markdown, for the documentation.
#[derive(Debug, Clone, Copy)]
pub struct Table;

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "| `equipoise/<station>/…` | payload | bytes | written by | rate | stale after | depth (max) | subscribers | history | MB |"
        )?;
        writeln!(f, "|---|---|---|---|---|---|---|---|---|---|")?;
        for row in TABLE {
            let deadline = row.deadline.map_or("never".to_owned(), |d| format!("{} ms", d.as_millis()));
            let megabytes = row.memory_bytes() as f64 / 1e6;
            writeln!(
                f,
                "| `{}` | `{}` | {} | {} | {} | {deadline} | {} ({}) | {} | {} | {megabytes:.1} |",
                row.suffix,
                row.payload,
                row.payload_bytes,
                row.writer,
                row.rate,
                row.depth,
                row.depth_max,
                row.subscribers_max,
                row.history,
            )?;
        }
        for channel in crate::Channel::ALL {
            writeln!(
                f,
                "| `{}` | event | | {} | | | | {LISTENERS_MAX} | | |",
                channel.suffix(),
                channel.writer()
            )?;
        }
        write_exchange::<Command>(f)?;
        write_exchange::<HandoverRequest>(f)
    }
}

/// Row of a request–response service.
fn write_exchange<Q: Request>(f: &mut fmt::Formatter<'_>) -> fmt::Result {
    writeln!(
        f,
        "| `{}` | `{}` → `{}` | {} → {} | clients → daemon | on request | | | {CLIENTS_MAX} | | |",
        Q::SUFFIX,
        Q::TYPE_NAME,
        Q::Response::TYPE_NAME,
        size_of::<Q>(),
        size_of::<Q::Response>(),
    )
}
