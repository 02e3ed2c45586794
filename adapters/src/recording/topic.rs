//! Topics of a recording: their messages and their descriptions.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::Arc;

use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::{
    AdapterHealth, Command, CycleRecord, EarlyState, GroundSample, Message, State, SuitBody, SuitSample,
};

/// How messages are encoded (mcap.dev registry): little-endian, fixed-size arrays without length prefix.
pub(super) const MESSAGE_ENCODING: &str = "ros1";
/// How schemas are encoded: the text of a ROS `.msg` file.
pub(super) const SCHEMA_ENCODING: &str = "ros1msg";
/// Channel metadata: the versioned type name of the bus.
pub(super) const TYPE_NAME_KEY: &str = "equipoise.type_name";
/// Channel metadata: `Message::SCHEMA_HASH` as 16 hex digits.
pub(super) const SCHEMA_HASH_KEY: &str = "equipoise.schema_hash";

/// A message that recordings hold.
pub trait Recorded: Message {
    /// The topic it stands under.
    const TOPIC: &'static str;
}

/// One message of a recording and when it was recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct TimedEntry {
    /// The message's own time, CLOCK_MONOTONIC ns of the recording machine.
    pub log_time_ns: u64,
    /// The message.
    pub entry: Entry,
}

/// How a topic describes itself in a file, and how its bytes become an entry.
pub(super) struct TopicTable {
    pub(super) topic: &'static str,
    pub(super) type_name: &'static str,
    pub(super) schema_hash: u64,
    pub(super) size: usize,
    pub(super) schema_text: fn() -> String,
    /// `None` if the bytes are not `size` long.
    pub(super) decode: fn(&[u8]) -> Option<Entry>,
}

// To record another message type, add it to this table; nothing else changes.
macro_rules! recorded {
    ($($topic:literal => $(#[$doc:meta])* $Variant:ident($Message:ty),)*) => {
        $(impl Recorded for $Message {
            const TOPIC: &'static str = $topic;
        })*

        /// A message of a recording.
        #[derive(Debug, Clone, PartialEq)]
        pub enum Entry {
            $($(#[$doc])* $Variant(Box<$Message>),)*
            /// A message under a topic that this release does not know.
            Other {
                /// The topic.
                topic: Arc<str>,
                /// The schema's name; empty if the file gives none.
                schema: Arc<str>,
                /// The bytes as they stand in the file.
                data: Vec<u8>,
            },
        }

        impl Entry {
            /// Whether its numbers can be: all finite, those of samples within what a body or a plate has.
            pub fn is_possible(&self) -> bool {
                let is_finite = match self {
                    $(Entry::$Variant(message) => message.is_finite(),)*
                    Entry::Other { .. } => true,
                };
                is_finite
                    && match self {
                        Entry::Suit(sample) => sample.is_possible(),
                        Entry::Ground(sample) => sample.is_possible(),
                        _ => true,
                    }
            }
        }

        $(impl From<$Message> for Entry {
            fn from(message: $Message) -> Entry {
                Entry::$Variant(Box::new(message))
            }
        })*

        /// Every topic that recordings hold.
        pub(super) const TOPICS: &[TopicTable] = &[$(topic_table::<$Message>()),*];
    };
}

recorded! {
    "/equipoise/suit" => /// Sample of the suit.
        Suit(SuitSample),
    "/equipoise/ground" => /// Sample of the ground.
        Ground(GroundSample),
    "/equipoise/body" => /// Body dimensions from the suit's software.
        Body(SuitBody),
    "/equipoise/state" => /// Result of a cycle.
        State(State),
    "/equipoise/early" => /// Result about the newest suit sample.
        Early(EarlyState),
    "/equipoise/cycle" => /// Stamps and inputs of one cycle.
        Cycle(CycleRecord),
    "/equipoise/checkpoint" => /// Memory of the loop after a cycle.
        Checkpoint(Checkpoint),
    "/equipoise/command" => /// Command, as received.
        Command(Command),
    "/equipoise/health" => /// Counts of an adapter.
        Health(AdapterHealth),
}

const fn topic_table<M: Recorded>() -> TopicTable
where
    Entry: From<M>,
{
    TopicTable {
        topic: M::TOPIC,
        type_name: M::TYPE_NAME,
        schema_hash: M::SCHEMA_HASH,
        size: size_of::<M>(),
        schema_text: schema_text::<M>,
        // The payload is unaligned in the file; this copies it into an aligned struct.
        decode: |bytes| bytemuck::try_pod_read_unaligned::<M>(bytes).ok().map(Entry::from),
    }
}

impl TopicTable {
    pub(super) fn named(topic: &str) -> Option<&'static TopicTable> {
        TOPICS.iter().find(|table| table.topic == topic)
    }

    /// `equipoise/State/1` as a ROS type name, which has one slash only: `equipoise/State_1`.
    pub(super) fn schema_name(&self) -> String {
        schema_name(self.type_name)
    }

    pub(super) fn metadata(&self) -> BTreeMap<String, String> {
        BTreeMap::from([
            (TYPE_NAME_KEY.to_owned(), self.type_name.to_owned()),
            (SCHEMA_HASH_KEY.to_owned(), format!("{:016x}", self.schema_hash)),
        ])
    }
}

fn schema_name(type_name: &str) -> String {
    match type_name.rsplit_once('/') {
        Some((name, version)) => format!("{name}_{version}"),
        None => type_name.to_owned(),
    }
}

/// The message as a ROS `.msg` text, one field a line: `float64[66] torque_nm`.
///
/// Tables stand flat, row by row: ROS messages have no arrays of arrays.
pub fn schema_text<M: Message>() -> String {
    let mut text = String::new();
    for field in M::FIELDS {
        let ros_name = field.primitive.ros_name();
        let written = match field.count {
            1 => writeln!(text, "{ros_name} {}", field.name),
            count => writeln!(text, "{ros_name}[{count}] {}", field.name),
        };
        debug_assert!(written.is_ok(), "writing to a String cannot fail");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_schema_is_the_field_table() {
        let text = schema_text::<GroundSample>();
        assert!(text.starts_with("uint64 sample_time_ns\nuint64 sample_time_sigma_ns\n"), "{text}");
        assert!(text.contains("\nfloat64[3] force_n\n"), "{text}");
        assert!(schema_text::<State>().contains("\nfloat64[66] torque_nm\n"));
        assert_eq!(schema_name(State::TYPE_NAME), "equipoise/State_5");
    }

    #[test]
    fn the_document_lists_all_topics() {
        let document = include_str!("../../../docs/recordings.md");
        let rows: Vec<&str> = document.lines().filter(|line| line.starts_with("| `/equipoise/")).collect();
        for TopicTable { topic, .. } in TOPICS {
            let name = topic.trim_start_matches("/equipoise/");
            let is_listed = |row: &&str| [name, topic].iter().any(|one| row.contains(&format!("`{one}`")));
            assert!(rows.iter().any(is_listed), "{topic}");
        }
    }

    #[test]
    fn topics_are_distinct() {
        for (index, table) in TOPICS.iter().enumerate() {
            assert!(TOPICS[..index].iter().all(|other| other.topic != table.topic));
            assert!((table.decode)(&vec![0; table.size]).is_some());
            assert!((table.decode)(&vec![0; table.size + 1]).is_none());
        }
    }
}
