//! Reading a recording, whole or cut short.

use std::collections::VecDeque;
use std::ops::Range;
use std::path::Path;

use mcap::records::{Record, op};

use super::channels::Channels;
use super::error::ReadError;
use super::frame::{RECORD_HEAD_BYTES, parse, unpack_chunk};
use super::header::{FORMAT, METADATA_NAME, RecordingHeader};
use super::store::Store;
use super::topic::TimedEntry;

/// An opened recording. Of a file only the frames are known; what is in them is read when it is gone through.
#[derive(Debug)]
pub struct Recording {
    store: Store,
    /// Where the records stand that hold messages or announce them.
    records: Vec<Range<usize>>,
    header: RecordingHeader,
    truncated: bool,
}

impl Recording {
    /// Opens a recording, whole or cut short by a crash.
    ///
    /// # Errors
    /// [`ReadError`] if the file cannot be read, is no recording, or was written by a release whose messages differ.
    pub fn open(path: impl AsRef<Path>) -> Result<Recording, ReadError> {
        let path = path.as_ref();
        let failed = |source| ReadError::Io { path: path.to_owned(), source };
        Recording::of(Store::open(path).map_err(failed)?, failed)
    }

    /// The same from bytes.
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
        let mut recording =
            Recording { store, records: Vec::new(), header: RecordingHeader::default(), truncated: true };
        recording.scan(failed)?;
        recording.check_first_channels()?;
        Ok(recording)
    }

    /// The head: software, configuration, subject, model, start.
    pub fn header(&self) -> &RecordingHeader {
        &self.header
    }

    /// Whether the file ends before its foot: the recorder crashed, or still records. All whole chunks are read.
    pub fn truncated(&self) -> bool {
        self.truncated
    }

    /// The messages in file order. After an error nothing more comes.
    pub fn entries(&self) -> Entries<'_> {
        Entries {
            recording: self,
            next_record: 0,
            channels: Channels::default(),
            ready: VecDeque::new(),
            ended: false,
        }
    }

    /// Finds the records by their frames; nothing is decompressed here, and of a file only the head is read.
    fn scan(&mut self, failed: impl Fn(std::io::Error) -> ReadError) -> Result<(), ReadError> {
        let mut at = mcap::MAGIC.len();
        while let Some((opcode, record)) = self.store.record_at(at).map_err(&failed)? {
            at = record.end;
            match opcode {
                op::FOOTER => {
                    self.truncated = false;
                    break;
                }
                // What cannot be parsed is kept too: the reader says where it stands when it gets there.
                op::SCHEMA | op::CHANNEL | op::MESSAGE | op::CHUNK => self.records.push(record),
                op::METADATA | op::ATTACHMENT => {
                    let body = record.start + RECORD_HEAD_BYTES..record.end;
                    let body = self.store.read(body).map_err(&failed)?.into_owned();
                    if !self.take_head(opcode, &body)? {
                        self.records.push(record);
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Takes in what the file says of itself; whether it could be parsed.
    fn take_head(&mut self, opcode: u8, body: &[u8]) -> Result<bool, ReadError> {
        match parse(opcode, body) {
            Ok(Some(Record::Metadata(metadata))) if metadata.name == METADATA_NAME => {
                let format = self.header.take_metadata(&metadata.metadata);
                if let Some(found) = format.filter(|found| *found > FORMAT) {
                    let software_version = self.header.software_version.clone();
                    return Err(ReadError::LaterFormat { found, software_version });
                }
            }
            Ok(Some(Record::Attachment { header, data, .. })) => {
                self.header.take_attachment(&header.name, &data);
            }
            Ok(_) => {}
            Err(_) => return Ok(false),
        }
        Ok(true)
    }

    /// Reads on to the first of our topics, so that a foreign file is refused when it is opened.
    fn check_first_channels(&self) -> Result<(), ReadError> {
        let mut entries = self.entries();
        while !entries.channels.has_ours() && entries.next_record < self.records.len() {
            entries.ready.clear();
            match entries.read_record() {
                // Damage is told while reading: what stands before it is still good.
                Err(ReadError::Damaged { .. }) => return Ok(()),
                outcome => outcome?,
            }
        }
        entries.channels.refuse_foreign()
    }
}

/// As much of a file as tells what it is.
const BEGIN_BYTES: usize = 64;

fn what_it_begins_with(bytes: &[u8]) -> String {
    match bytes {
        [] => "nothing: the file is empty".to_owned(),
        [0xd4 | 0xa1, 0xc3 | 0xb2, 0xb2 | 0xc3, 0xa1 | 0xd4, ..] => "a .pcap head".to_owned(),
        [0x0a, 0x0d, 0x0d, 0x0a, ..] => "a .pcapng head".to_owned(),
        _ => format!("\"{}\"", bytes[..bytes.len().min(16)].escape_ascii()),
    }
}

/// The messages of a recording in file order.
#[derive(Debug)]
pub struct Entries<'a> {
    recording: &'a Recording,
    next_record: usize,
    channels: Channels,
    ready: VecDeque<TimedEntry>,
    ended: bool,
}

impl Entries<'_> {
    /// Takes in one record of the file: a chunk, or a bare schema, channel or message.
    fn read_record(&mut self) -> Result<(), ReadError> {
        let range = self.recording.records[self.next_record].clone();
        self.next_record += 1;
        let at_byte = range.start;
        let damaged = |reason: String| ReadError::Damaged { at_byte, reason };
        let record = self.recording.store.read(range).map_err(|error| damaged(error.to_string()))?;
        let [opcode, ..] = *record else {
            return Err(damaged("an empty record".to_owned()));
        };
        if opcode == op::CHUNK {
            // A chunk counts whole or not at all.
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
            Some(Record::Schema { header, data }) => self.channels.add_schema(header, data.into_owned()),
            Some(Record::Channel(channel)) => self.channels.add_channel(channel)?,
            Some(Record::Message { header, data }) => {
                let entry = self.channels.decode(header.channel_id, &data);
                let entry = entry.map_err(|reason| ReadError::Damaged { at_byte, reason })?;
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
            if self.ended || self.next_record >= self.recording.records.len() {
                return None;
            }
            if let Err(error) = self.read_record() {
                self.ended = true;
                return Some(Err(error));
            }
        }
    }
}
