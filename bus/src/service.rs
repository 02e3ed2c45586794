//! The table of services: what is shared on a station, how often, how deep, and who writes it.
//!
//! The first process that opens a service fixes its limits, so all of them are defined here.

use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::{
    AdapterHealth, Command, CycleRecord, GroundSample, Incidents, Message, PickUp, Reply, State, SuitBody,
    SuitSample,
};
use std::fmt;
use std::time::Duration;

use crate::words::{self, Each, folded};

/// Processes and threads that may take part in one service.
pub const NODES_MAX: usize = 64;
/// Places for writers beyond a row's own: one, while a process replaces another. An exclusive service has none.
pub const HAND_OVER: usize = 1;
/// Messages that a subscriber may hold while it reads.
pub const BORROWED_MAX: usize = 2;
/// Clients of the command service.
pub const CLIENTS_MAX: usize = 16;
/// Notifiers of one event service: every client is one, and the adapters.
pub const NOTIFIERS_MAX: usize = 32;
/// Listeners of one event service; each costs a notifier 4 to 10 µs while it sleeps.
pub const LISTENERS_MAX: usize = 24;
/// The service attribute that holds the schema. iceoryx2 itself compares type names and sizes only.
pub const SCHEMA_KEY: &str = "equipoise.schema";
/// Bytes that iceoryx2 may put before each payload, with alignment; generous.
const HEADER_BYTES: usize = 64;

/// One row of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Service {
    /// Last part of the name: `equipoise/<station>/<suffix>`.
    pub suffix: &'static str,
    /// Type name of the payload.
    pub payload: &'static str,
    /// Bytes of one payload.
    pub payload_bytes: usize,
    /// Who writes it.
    pub writer: &'static str,
    /// How many write at once, hand-over apart.
    pub writers: usize,
    /// Whether more are refused even for a hand-over: while one lives, no other process may publish the same data.
    pub exclusive: bool,
    /// How often, in words.
    pub rate: &'static str,
    /// Silence after which a reader must call the stream stale; `None`: it may be silent for ever.
    pub deadline: Option<Duration>,
    /// A subscriber's buffer where nothing else is asked for, messages.
    pub depth: usize,
    /// The deepest buffer that a subscriber may ask for, messages.
    pub depth_max: usize,
    /// How many subscribers there may be.
    pub subscribers_max: usize,
    /// How many messages a late subscriber gets at once.
    pub history: usize,
}

impl Service {
    /// The service's full name on a station.
    pub fn name(&self, station: &str) -> String {
        full_name(station, self.suffix)
    }

    /// How many publishers it takes: its writers, and one more that replaces one of them.
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

/// A message that is published: it knows its row of the table.
pub trait Topic: Message {
    /// Its row.
    const SERVICE: Service;

    /// Each word in it that readers take for granted: what it is a word of, its name, its number ([`crate::words`]).
    fn words(_each: Each<'_>) {}

    /// What writers and readers must have in common: the hash of its fields, and of its words if it has any.
    fn schema() -> u64
    where
        Self: Sized,
    {
        folded(Self::SCHEMA_HASH, Self::words)
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
        })*

        /// Every publish-subscribe service of a station.
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
    CycleRecord => "cycle", by 1 "daemon", "loop rate", deadline ms(25), depth 1024 of 1024, 16 subscribers;
    Checkpoint => "checkpoint", by 1 "daemon", "on request", deadline None, depth 1 of 2, 4 subscribers;
    AdapterHealth => "health", by 2 "adapters", "1 Hz", deadline ms(2500), depth 8 of 16, 16 subscribers;
    Incidents => "incidents", by 1 "daemon", "1 Hz and on change", deadline ms(2500), depth 1 of 8, 16 subscribers;
    PickUp => "pickup", by 16 "consumers", "1 Hz", deadline None, depth 16 of 32, 2 subscribers;
}

/// A station's shared memory stays below this with one writer per service, bytes.
pub const STATION_MEMORY_MAX: usize = 125_000_000;
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

/// The table as Markdown, for the documentation.
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
        writeln!(
            f,
            "| `command` | `{}` → `{}` | {} → {} | clients → daemon | on request | | | {CLIENTS_MAX} | | |",
            Command::TYPE_NAME,
            Reply::TYPE_NAME,
            size_of::<Command>(),
            size_of::<Reply>(),
        )
    }
}
