//! The channels of a file: topic, schema, and whether this release supports them.

use std::collections::HashMap;
use std::sync::Arc;

use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::Printable;
use mcap::records::{Channel, SchemaHeader};

use super::error::ReadError;
use super::topic::{Entry, Recorded, SCHEMA_HASH_KEY, TYPE_NAME_KEY, TopicTable};

/// Maximum size of the names and schemas in a file; Equipoise's own have 40 000 bytes.
const ANNOUNCED_BYTES_MAX: usize = 16 << 20;
/// Limits of the description of a foreign file: count of topics, and length of each text.
const TOPICS_NAMED: usize = 8;
const NAME_CHARS_MAX: usize = 160;

#[derive(Debug)]
struct Schema {
    name: Arc<str>,
    text: Vec<u8>,
}

#[derive(Debug)]
enum Reads {
    /// A topic of Equipoise, validated.
    Ours(&'static str),
    /// A topic that this release does not define.
    Unknown { topic: Arc<str>, schema: Arc<str> },
}

impl Reads {
    fn unknown(channel: &Channel, schema: Option<&Schema>) -> Reads {
        let schema = schema.map_or_else(|| Arc::from(""), |schema| Arc::clone(&schema.name));
        Reads::Unknown { topic: channel.topic.as_str().into(), schema }
    }

    fn bytes(&self) -> usize {
        match self {
            Reads::Ours(_) => 0,
            Reads::Unknown { topic, .. } => topic.len(),
        }
    }
}

impl Schema {
    fn bytes(&self) -> usize {
        self.name.len() + self.text.len()
    }
}

/// A text of the file, sanitised for display.
pub(super) fn shown(text: &str) -> String {
    Printable { text, chars_max: NAME_CHARS_MAX }.to_string()
}

/// Schemas and channels defined so far.
#[derive(Debug, Default)]
pub(super) struct Channels {
    schemas: HashMap<u16, Schema>,
    channels: HashMap<u16, Reads>,
    /// Bytes of the names and texts in both.
    bytes: usize,
}

impl Channels {
    /// Whether a topic of Equipoise was defined.
    pub(super) fn has_ours(&self) -> bool {
        self.channels.values().any(|reads| matches!(reads, Reads::Ours(_)))
    }

    /// Adds a schema.
    ///
    /// # Errors
    /// The definitions exceed the limit, as text.
    pub(super) fn add_schema(&mut self, header: SchemaHeader, text: Vec<u8>) -> Result<(), String> {
        let schema = Schema { name: header.name.into(), text };
        self.bytes += schema.bytes();
        let before = self.schemas.insert(header.id, schema);
        self.bytes -= before.map_or(0, |before| before.bytes());
        self.check_bytes()
    }

    fn check_bytes(&self) -> Result<(), String> {
        if self.bytes <= ANNOUNCED_BYTES_MAX {
            return Ok(());
        }
        Err(format!("its topics and schemas have more than {ANNOUNCED_BYTES_MAX} bytes"))
    }

    /// Adds a channel, unless it is a topic of Equipoise with a message of another release.
    pub(super) fn add_channel(&mut self, channel: Channel, at_byte: usize) -> Result<(), ReadError> {
        let schema = self.schemas.get(&channel.schema_id);
        let reads = match TopicTable::named(&channel.topic) {
            Some(table) => match check(table, &channel, schema) {
                Ok(()) => Reads::Ours(table.topic),
                // A checkpoint of another release cannot be used, but the samples in the same file can.
                Err(_) if table.topic == Checkpoint::TOPIC => Reads::unknown(&channel, schema),
                Err(refused) => return Err(refused),
            },
            None => Reads::unknown(&channel, schema),
        };
        self.bytes += reads.bytes();
        let before = self.channels.insert(channel.id, reads);
        self.bytes -= before.map_or(0, |before| before.bytes());
        self.check_bytes().map_err(|reason| ReadError::Damaged { at_byte, reason })
    }

    /// Refuses a file whose topics are all foreign. A file truncated before its first chunk is only empty.
    pub(super) fn refuse_foreign(&self) -> Result<(), ReadError> {
        let mut found: Vec<&str> = Vec::new();
        for reads in self.channels.values() {
            match reads {
                Reads::Ours(_) => return Ok(()),
                Reads::Unknown { topic, .. } => found.push(topic),
            }
        }
        if found.is_empty() {
            return Ok(());
        }
        found.sort_unstable();
        let listed: Vec<String> = found.iter().take(TOPICS_NAMED).map(|topic| shown(topic)).collect();
        let more = match found.len().saturating_sub(TOPICS_NAMED) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        Err(ReadError::Foreign { found: format!("the topics {}{more}", listed.join(", ")) })
    }

    /// Decodes the message in `data`.
    ///
    /// # Errors
    /// The fault as text: an undefined channel, or a message of the wrong size.
    pub(super) fn decode(&self, channel_id: u16, data: &[u8]) -> Result<Entry, String> {
        match self.channels.get(&channel_id) {
            None => Err(format!("a message of channel {channel_id}, which was never announced")),
            Some(Reads::Unknown { topic, schema }) => {
                Ok(Entry::Other { topic: topic.clone(), schema: schema.clone(), data: data.to_vec() })
            }
            Some(Reads::Ours(topic)) => {
                let table = TopicTable::named(topic).ok_or_else(|| format!("no topic {topic}"))?;
                (table.decode)(data).ok_or_else(|| {
                    format!("a message of {} bytes under {topic}, expected {}", data.len(), table.size)
                })
            }
        }
    }
}

/// Type name and hash of earlier schemas that differ in field names only: their messages are read as the present type.
const RENAMED_FIELDS: [(&str, &str); 3] = [
    ("equipoise/State/5", "e041a28860c29831"),
    // `reserved`, always zero, became `clock_epoch`.
    ("equipoise/Suit/1", "76d8648fb222b493"),
    ("equipoise/Ground/3", "cbd959d3fdd1fbea"),
];

/// Compares type name and schema hash; if a tool removed the metadata, name and text of the schema instead.
fn check(table: &'static TopicTable, channel: &Channel, schema: Option<&Schema>) -> Result<(), ReadError> {
    let schema_name = schema.map_or("", |schema| &*schema.name);
    let (found, expected) = match channel.metadata.get(TYPE_NAME_KEY) {
        Some(found) => (found.as_str(), table.type_name.to_owned()),
        None => (schema_name, table.schema_name()),
    };
    if found != expected {
        let found = if found.is_empty() { "messages without a schema" } else { found };
        return Err(ReadError::OtherType {
            topic: channel.topic.clone(),
            found: shown(found),
            expected: table.type_name,
        });
    }
    let expected = format!("{:016x}", table.schema_hash);
    let (same, found) = match channel.metadata.get(SCHEMA_HASH_KEY) {
        Some(found) => {
            let is_renamed = RENAMED_FIELDS.contains(&(table.type_name, found.as_str()));
            (*found == expected || is_renamed, shown(found))
        }
        None => {
            let same = schema.is_some_and(|schema| schema.text == (table.schema_text)().as_bytes());
            (same, "by its text".to_owned())
        }
    };
    if same {
        return Ok(());
    }
    Err(ReadError::OtherFields { topic: channel.topic.clone(), type_name: table.type_name, found, expected })
}
