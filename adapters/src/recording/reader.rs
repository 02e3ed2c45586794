//! Reads a recording, complete or truncated.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use mcap::records::{Record, op};

use super::channels::{Channels, shown};
use super::error::ReadError;
use super::frame::{RECORD_HEAD_BYTES, parse, unpack_chunk};
use super::header::{FORMAT, METADATA_NAME, RecordingHeader};
use super::store::Store;
use super::topic::TimedEntry;

/// An opened recording. Only the positions of the records are determined; their contents are read during iteration.
#[derive(Debug)]
pub struct Recording {
    store: Store,
    /// End of the complete records.
    end: usize,
    header: RecordingHeader,
    truncated: bool,
    /// Position of the iterator that read last.
    position: AtomicUsize,
}

impl Recording {
    /// Message about a recording that ends before its footer ([`Recording::truncated`]).
    pub const TRUNCATED: &str =
        "the recording was cut short: the data after its last complete chunk are missing";

    /// Opens a recording, complete or truncated by a crash.
    ///
    /// # Errors
    /// [`ReadError`] if the file cannot be read, is not a recording, or was written by a release whose messages differ.
    pub fn open(path: impl AsRef<Path>) -> Result<Recording, ReadError> {
        let path = path.as_ref();
        let failed = |source| ReadError::Io { path: path.to_owned(), source };
        Recording::of(Store::open(path).map_err(failed)?, failed)
    }

    /// The same for bytes in memory.
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Recording, ReadError> {
        Recording::of(Store::Memory(bytes), |source| ReadError::Io { path: "in memory".into(), source })
    }

    fn of(store: Store, failed: impl Fn(std::io::Error) -> ReadError) -> Result<Recording, ReadError> {
        let begin = store.read(0..store.len().min(BEGIN_BYTES)).map_err(&failed)?;
        if !begin.starts_with(mcap::MAGIC) {
            return Err(ReadError::NotMcap { found: what_it_begins_with(&begin) });
        }
        drop(begin);
        let mut recording = Recording {
            store,
            end: mcap::MAGIC.len(),
            header: RecordingHeader::default(),
            truncated: true,
            position: AtomicUsize::new(0),
        };
        recording.scan(failed)?;
        recording.check_first_channels()?;
        Ok(recording)
    }

    /// The header: software, configuration, subject, model, start.
    pub fn header(&self) -> &RecordingHeader {
        &self.header
    }

    /// Whether the file ends before its footer: the recorder crashed, or is still recording. All complete chunks are
    /// read.
    pub fn truncated(&self) -> bool {
        self.truncated
    }

    /// Fraction of the file that the iterator which read last has read, 0 to 1; another thread may display it.
    pub fn fraction_read(&self) -> f64 {
        self.position.load(Ordering::Relaxed) as f64 / self.end as f64
    }

    /// The messages in file order. An error ends the iteration.
    pub fn entries(&self) -> Entries<'_> {
        Entries {
            recording: self,
            at: mcap::MAGIC.len(),
            channels: Channels::default(),
            ready: VecDeque::new(),
            impossible: None,
            ended: false,
        }
    }

    /// Finds the records by their frames; nothing is decompressed, and only the metadata of the file are read.
    fn scan(&mut self, failed: impl Fn(std::io::Error) -> ReadError) -> Result<(), ReadError> {
        let mut head_bytes = 0;
        while let Some((opcode, record)) = self.store.record_at(self.end).map_err(&failed)? {
            let at_byte = self.end;
            self.end = record.end;
            match opcode {
                op::FOOTER => {
                    self.truncated = false;
                    break;
                }
                op::METADATA | op::ATTACHMENT => {
                    let body = record.start + RECORD_HEAD_BYTES..record.end;
                    let body = self.store.read(body).map_err(&failed)?.into_owned();
                    head_bytes += record.len() + HEAD_RECORD_BYTES;
                    if head_bytes > HEAD_BYTES_MAX {
                        let reason = format!("its attachments have more than {HEAD_BYTES_MAX} bytes");
                        return Err(ReadError::Damaged { at_byte, reason });
                    }
                    self.take_head(opcode, &body)?;
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Reads the file's metadata. A record that cannot be parsed is reported when the reader reaches it.
    fn take_head(&mut self, opcode: u8, body: &[u8]) -> Result<(), ReadError> {
        match parse(opcode, body) {
            Ok(Some(Record::Metadata(metadata))) if metadata.name == METADATA_NAME => {
                let format = self.header.take_metadata(&metadata.metadata);
                if let Some(found) = format.filter(|found| *found > FORMAT) {
                    let software_version = self.header.software_version.clone();
                    return Err(ReadError::LaterFormat { found, software_version });
                }
            }
            Ok(Some(Record::Attachment { header, data, .. })) => {
                self.header.take_attachment(header.log_time, &header.name, &data);
            }
            Ok(_) | Err(_) => {}
        }
        Ok(())
    }

    /// Reads up to the first topic of Equipoise, so that a foreign file is refused on opening.
    fn check_first_channels(&self) -> Result<(), ReadError> {
        let mut entries = self.entries();
        while !entries.channels.has_ours() && entries.at < self.end {
            entries.ready.clear();
            match entries.read_record() {
                // Damage is reported during reading, as the data before it are valid.
                Err(ReadError::Damaged { .. }) => return Ok(()),
                outcome => outcome?,
            }
        }
        entries.channels.refuse_foreign()
    }
}

/// Length of the part that identifies the file.
const BEGIN_BYTES: usize = 64;
/// Limit of the metadata's size: sufficient for four hundred changes of the subject in one shift.
const HEAD_BYTES_MAX: usize = 64 << 20;
/// Maximum overhead of an attachment.
const HEAD_RECORD_BYTES: usize = 256;

fn what_it_begins_with(bytes: &[u8]) -> String {
    match bytes {
        [] => "nothing: the file is empty".to_owned(),
        [0xd4 | 0xa1, 0xc3 | 0xb2, 0xb2 | 0xc3, 0xa1 | 0xd4, ..] => "a .pcap head".to_owned(),
        [0x0a, 0x0d, 0x0d, 0x0a, ..] => "a .pcapng head".to_owned(),
        _ => format!("\"{}\"", bytes[..bytes.len().min(16)].escape_ascii()),
    }
}

/// Records that contain or define messages, and those that were read on opening: if one cannot be parsed, the file is
/// damaged.
const HOLDS_MESSAGES: [u8; 6] =
    [op::SCHEMA, op::CHANNEL, op::MESSAGE, op::CHUNK, op::METADATA, op::ATTACHMENT];

/// The messages of a recording in file order. Those with impossible numbers are omitted, and counted in an error at the
/// end.
#[derive(Debug)]
pub struct Entries<'a> {
    recording: &'a Recording,
    /// Position of the next record.
    at: usize,
    channels: Channels,
    ready: VecDeque<TimedEntry>,
    /// Count of messages omitted for their numbers, and position of the first one's record.
    impossible: Option<(u64, usize)>,
    ended: bool,
}

impl Entries<'_> {
    /// Fraction of the file that has been read, 0 to 1.
    pub fn fraction_read(&self) -> f64 {
        self.at as f64 / self.recording.end as f64
    }

    /// Reads the next record of the file that is a chunk, or a schema, channel or message outside a chunk.
    fn read_record(&mut self) -> Result<(), ReadError> {
        let at_byte = self.at;
        let damaged = |reason: String| ReadError::Damaged { at_byte, reason: shown(&reason) };
        let store = &self.recording.store;
        let found = store.record_at(at_byte).map_err(|error| damaged(error.to_string()))?;
        let Some((opcode, range)) = found else {
            self.at = self.recording.end;
            return Ok(());
        };
        self.at = range.end;
        self.recording.position.store(self.at, Ordering::Relaxed);
        if !HOLDS_MESSAGES.contains(&opcode) {
            return Ok(());
        }
        let record = store.read(range).map_err(|error| damaged(error.to_string()))?;
        if opcode == op::CHUNK {
            // A chunk is used completely or not at all.
            let mut taken = VecDeque::new();
            unpack_chunk(&record, damaged, |opcode, body| {
                taken.extend(self.take(opcode, body, at_byte)?);
                Ok(())
            })?;
            self.ready.append(&mut taken);
        } else {
            let body = record.get(RECORD_HEAD_BYTES..).unwrap_or_default();
            let entry = self.take(opcode, body, at_byte)?;
            self.ready.extend(entry);
        }
        Ok(())
    }

    fn take(&mut self, opcode: u8, body: &[u8], at_byte: usize) -> Result<Option<TimedEntry>, ReadError> {
        match parse(opcode, body).map_err(|reason| ReadError::Damaged { at_byte, reason })? {
            Some(Record::Schema { header, data }) => {
                let added = self.channels.add_schema(header, data.into_owned());
                added.map_err(|reason| ReadError::Damaged { at_byte, reason })?;
            }
            Some(Record::Channel(channel)) => self.channels.add_channel(channel, at_byte)?,
            Some(Record::Message { header, data }) => {
                let entry = self.channels.decode(header.channel_id, &data);
                let entry = entry.map_err(|reason| ReadError::Damaged { at_byte, reason })?;
                if !entry.is_possible() {
                    self.impossible.get_or_insert((0, at_byte)).0 += 1;
                    return Ok(None);
                }
                return Ok(Some(TimedEntry { log_time_ns: header.log_time, entry }));
            }
            _ => {}
        }
        Ok(None)
    }
}

impl Iterator for Entries<'_> {
    type Item = Result<TimedEntry, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(entry) = self.ready.pop_front() {
                return Some(Ok(entry));
            }
            if self.ended {
                return None;
            }
            if self.at >= self.recording.end {
                self.ended = true;
                let (count, at_byte) = self.impossible?;
                return Some(Err(ReadError::Impossible { count, at_byte }));
            }
            if let Err(error) = self.read_record() {
                self.ended = true;
                return Some(Err(error));
            }
        }
    }
}
