//! The channels of a file: which topic, which schema, and whether this release reads it.

use std::collections::HashMap;

use equipoise_core::cycle::Checkpoint;
use mcap::records::{Channel, SchemaHeader};

use super::error::ReadError;
use super::topic::{Entry, Recorded, SCHEMA_HASH_KEY, TYPE_NAME_KEY, TopicTable};

#[derive(Debug)]
struct Schema {
    name: String,
    text: Vec<u8>,
}

#[derive(Debug)]
enum Reads {
    /// One of our topics, checked.
    Ours(&'static str),
    /// A topic this release does not know.
    Unknown { topic: String, schema: String },
}

impl Reads {
    fn unknown(channel: &Channel, schema: Option<&Schema>) -> Reads {
        let schema = schema.map(|schema| schema.name.clone()).unwrap_or_default();
        Reads::Unknown { topic: channel.topic.clone(), schema }
    }
}

/// What has been announced so far.
#[derive(Debug, Default)]
pub(super) struct Channels {
    schemas: HashMap<u16, Schema>,
    channels: HashMap<u16, Reads>,
}

impl Channels {
    /// Whether one of our topics was announced.
    pub(super) fn has_ours(&self) -> bool {
        self.channels.values().any(|reads| matches!(reads, Reads::Ours(_)))
    }

    pub(super) fn add_schema(&mut self, header: SchemaHeader, text: Vec<u8>) {
        self.schemas.insert(header.id, Schema { name: header.name, text });
    }

    /// Takes a channel in, unless it is one of our topics with another message than this release's.
    pub(super) fn add_channel(&mut self, channel: Channel) -> Result<(), ReadError> {
        let schema = self.schemas.get(&channel.schema_id);
        let reads = match TopicTable::named(&channel.topic) {
            Some(table) => match check(table, &channel, schema) {
                Ok(()) => Reads::Ours(table.topic),
                // Another release's memory means nothing here; the samples beside it do.
                Err(_) if table.topic == Checkpoint::TOPIC => Reads::unknown(&channel, schema),
                Err(refused) => return Err(refused),
            },
            None => Reads::unknown(&channel, schema),
        };
        self.channels.insert(channel.id, reads);
        Ok(())
    }

    /// Refuses a file that announced topics, none of them ours. A file cut before its first chunk is only empty.
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
        Err(ReadError::Foreign { found: format!("the topics {}", found.join(", ")) })
    }

    /// The message in `data`.
    ///
    /// # Errors
    /// What is wrong, in words: a channel never announced, or a message of the wrong size.
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

/// Compares type name and schema hash; where a tool dropped the metadata, name and text of the schema instead.
fn check(table: &'static TopicTable, channel: &Channel, schema: Option<&Schema>) -> Result<(), ReadError> {
    let schema_name = schema.map_or("", |schema| schema.name.as_str());
    let (found, expected) = match channel.metadata.get(TYPE_NAME_KEY) {
        Some(found) => (found.as_str(), table.type_name.to_owned()),
        None => (schema_name, table.schema_name()),
    };
    if found != expected {
        let found = if found.is_empty() { "messages without a schema" } else { found };
        return Err(ReadError::OtherType {
            topic: channel.topic.clone(),
            found: found.to_owned(),
            expected: table.type_name,
        });
    }
    let expected = format!("{:016x}", table.schema_hash);
    let (same, found) = match channel.metadata.get(SCHEMA_HASH_KEY) {
        Some(found) => (*found == expected, found.clone()),
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
