//! Writes a recording so that a crash of the process loses at most its last second; after a failure of the machine, what
//! was synchronised is readable ([`Recorder::second_handle`]).

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Cursor, Seek, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use equipoise_core::time::NS_PER_S;
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, McapError, WriteOptions, Writer};
use thiserror::Error;

use super::hashed_file::HashedFile;
use super::header::{LATER_SUBJECT_NAME, METADATA_NAME, RecordingHeader, Reloaded, TOML_MEDIA_TYPE};
use super::topic::{MESSAGE_ENCODING, Recorded, SCHEMA_ENCODING, TOPICS};

/// Time span after which a chunk is closed, …
const CHUNK_SPAN_NS: u64 = NS_PER_S;
/// … or size before compression.
const CHUNK_BYTES: u64 = 4 << 20;
/// The fastest level, as the recorder shares the machine with the loop.
const ZSTD_LEVEL: u32 = 1;
/// A recording contains a person's motion, so other users of the machine have no access.
const FILE_MODE: u32 = 0o640;

/// Why a recording could not be written.
#[derive(Debug, Error)]
pub enum WriteError {
    /// The file could not be created.
    #[error("cannot create the recording {}: {source}; choose a new name in a writable directory", path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file could not be written.
    #[error("cannot write the recording {}: {source}; what was written before stays readable", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: McapError,
    },
}

/// A kind of message outside the table: for viewers, not for replays.
#[derive(Debug, Clone)]
pub struct ExtraChannel {
    /// The topic.
    pub topic: &'static str,
    /// The schema's name.
    pub schema_name: &'static str,
    /// Encoding of the schema, by its name in MCAP's registry.
    pub schema_encoding: &'static str,
    /// The schema.
    pub schema_text: String,
    /// Encoding of the messages.
    pub message_encoding: &'static str,
}

/// One kind of message in the file.
struct Channel {
    topic: &'static str,
    id: u16,
    next_sequence: u32,
}

/// Writes one recording in zstd chunks of about a second, so a crash or a full disk loses at most the last of them.
///
/// Call [`Recorder::finish`] at the end; a dropped recorder finishes as well, but cannot report an error.
pub struct Recorder<W: Write + Seek = BufWriter<HashedFile>> {
    path: PathBuf,
    writer: Writer<W>,
    channels: Vec<Channel>,
    chunk_start_ns: Option<u64>,
    failed: bool,
    /// Device and inode of the file; `None` in memory.
    file: Option<[u64; 2]>,
    /// Second handle of the file.
    handle: Option<File>,
}

impl Recorder {
    /// Creates a recording and flushes its header to the system. Never overwrites a file.
    ///
    /// # Errors
    /// [`WriteError`] if the file exists, or cannot be created or written.
    pub fn create(path: impl AsRef<Path>, header: &RecordingHeader) -> Result<Recorder, WriteError> {
        let path = path.as_ref().to_owned();
        let file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(FILE_MODE)
            .open(&path)
            .map_err(|source| WriteError::Create { path: path.clone(), source })?;
        // The lock marks the recording as active for programs that delete old recordings. File systems without locks
        // only lack this protection.
        let _ = file.try_lock();
        let failed = |source| WriteError::Create { path: path.clone(), source };
        let found = file.metadata().map_err(failed)?;
        let handle = file.try_clone().map_err(failed)?;
        let mut recorder = Recorder::on(path, BufWriter::new(HashedFile::new(file)), header)?;
        (recorder.file, recorder.handle) = (Some([found.dev(), found.ino()]), Some(handle));
        Ok(recorder)
    }

    /// A second handle of the file, with which another thread writes it from the system's cache to the disk; `None` if it
    /// was taken. The file counts as active until it is closed.
    pub fn second_handle(&mut self) -> Option<File> {
        self.handle.take()
    }

    /// Size of the file under the recording's name, bytes; `None` if it is no longer the file being written: it was
    /// removed or replaced, and further data would be lost.
    pub fn bytes_in_place(&self) -> Option<u64> {
        let found = self.path.symlink_metadata().ok()?;
        (Some([found.dev(), found.ino()]) == self.file).then_some(found.len())
    }

    /// Writes the index and the footer, and waits until all data are on the disk; returns the SHA-256 of the file, 64
    /// hexadecimal digits.
    ///
    /// # Errors
    /// [`WriteError::Write`] if a part cannot be written.
    pub fn finish(self) -> Result<String, WriteError> {
        let path = self.path.clone();
        let (file, sha256) = self.close()?;
        file.sync_all().map_err(|error| WriteError::Write { path, source: McapError::Io(error) })?;
        Ok(sha256)
    }

    /// As [`Recorder::finish`], but does not wait for the disk, to which another thread writes
    /// ([`Recorder::second_handle`]).
    ///
    /// # Errors
    /// As [`Recorder::finish`].
    pub fn finish_unsynchronised(self) -> Result<String, WriteError> {
        self.close().map(|(_, sha256)| sha256)
    }

    fn close(mut self) -> Result<(File, String), WriteError> {
        let path = self.path.clone();
        let failed = |source| WriteError::Write { path: path.clone(), source };
        self.writer.finish().map_err(failed)?;
        let file = self.writer.into_inner();
        let file = file.into_inner().map_err(|error| failed(McapError::Io(error.into_error())))?;
        Ok(file.finish())
    }
}

impl Recorder<Cursor<Vec<u8>>> {
    /// A recording in memory, for a file that must be written atomically; `path` is its name in errors.
    ///
    /// # Errors
    /// [`WriteError::Write`] if the header cannot be encoded.
    pub fn in_memory(path: impl AsRef<Path>, header: &RecordingHeader) -> Result<Self, WriteError> {
        Recorder::on(path.as_ref().to_owned(), Cursor::new(Vec::new()), header)
    }

    /// Writes the index and the footer; returns the bytes of the file.
    ///
    /// # Errors
    /// [`WriteError::Write`] if they cannot be encoded.
    pub fn into_bytes(mut self) -> Result<Vec<u8>, WriteError> {
        self.writer.finish().map_err(|source| WriteError::Write { path: self.path.clone(), source })?;
        Ok(self.writer.into_inner().into_inner())
    }
}

impl<W: Write + Seek> Recorder<W> {
    fn on(path: PathBuf, sink: W, header: &RecordingHeader) -> Result<Self, WriteError> {
        let writer =
            start(sink, header).map_err(|source| WriteError::Write { path: path.clone(), source })?;
        let mut recorder = Recorder {
            path,
            writer,
            channels: Vec::new(),
            chunk_start_ns: None,
            failed: false,
            file: None,
            handle: None,
        };
        recorder.add_channels().map_err(|source| recorder.failed(source))?;
        Ok(recorder)
    }

    /// Defines every topic in the first chunk, so that a reader needs no later part for them.
    fn add_channels(&mut self) -> Result<(), McapError> {
        for table in TOPICS {
            let schema_text = (table.schema_text)();
            let schema =
                self.writer.add_schema(&table.schema_name(), SCHEMA_ENCODING, schema_text.as_bytes())?;
            let id = self.writer.add_channel(schema, table.topic, MESSAGE_ENCODING, &table.metadata())?;
            self.channels.push(Channel { topic: table.topic, id, next_sequence: 0 });
        }
        Ok(())
    }

    /// Defines an additional kind of message, preferably before the first message, so that readers have it from the
    /// beginning.
    ///
    /// # Errors
    /// [`WriteError::Write`].
    pub fn announce(&mut self, extra: &ExtraChannel) -> Result<(), WriteError> {
        let schema_text = extra.schema_text.as_bytes();
        let metadata = BTreeMap::new();
        let added = self.writer.add_schema(extra.schema_name, extra.schema_encoding, schema_text).and_then(
            |schema| self.writer.add_channel(schema, extra.topic, extra.message_encoding, &metadata),
        );
        let id = added.map_err(|source| self.failed(source))?;
        self.channels.push(Channel { topic: extra.topic, id, next_sequence: 0 });
        Ok(())
    }

    /// Writes a message of an additional kind.
    ///
    /// # Errors
    /// As [`Recorder::write`].
    pub fn write_extra(&mut self, topic: &str, log_time_ns: u64, bytes: &[u8]) -> Result<(), WriteError> {
        self.put(topic, log_time_ns, bytes)
    }

    /// Writes one message; `log_time_ns` is the message's own time, CLOCK_MONOTONIC.
    ///
    /// # Errors
    /// [`WriteError::Write`], for example on a full disk; every later call then fails as well, and the file remains
    /// readable up to its last complete chunk.
    pub fn write<M: Recorded>(&mut self, log_time_ns: u64, message: &M) -> Result<(), WriteError> {
        self.put(M::TOPIC, log_time_ns, bytemuck::bytes_of(message))
    }

    fn put(&mut self, topic: &str, log_time_ns: u64, bytes: &[u8]) -> Result<(), WriteError> {
        if self.failed {
            return Err(self.failed(McapError::AttemptedWriteAfterFailure));
        }
        let chunk_start_ns = *self.chunk_start_ns.get_or_insert(log_time_ns);
        // Streams interleave, so times may decrease slightly.
        if log_time_ns.abs_diff(chunk_start_ns) >= CHUNK_SPAN_NS {
            self.flush()?;
            self.chunk_start_ns = Some(log_time_ns);
        }
        let Some(channel) = self.channels.iter_mut().find(|channel| channel.topic == topic) else {
            return Err(self.failed(McapError::UnknownChannel(0, 0)));
        };
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.next_sequence,
            log_time: log_time_ns,
            publish_time: log_time_ns,
        };
        channel.next_sequence = channel.next_sequence.wrapping_add(1);
        self.writer.write_to_known_channel(&header, bytes).map_err(|source| self.failed(source))
    }

    /// Attaches the result of a reload, under the number in its cycle record.
    ///
    /// # Errors
    /// [`WriteError::Write`].
    pub fn add_reload(
        &mut self,
        log_time_ns: u64,
        number: u64,
        reloaded: &Reloaded,
    ) -> Result<(), WriteError> {
        for (name, text) in reloaded.attachments(number) {
            attach(&mut self.writer, log_time_ns, 0, name, text).map_err(|source| self.failed(source))?;
        }
        self.chunk_start_ns = None;
        Ok(())
    }

    /// Attaches the profile of a new subject.
    ///
    /// # Errors
    /// [`WriteError::Write`].
    pub fn add_subject(&mut self, log_time_ns: u64, subject_toml: &str) -> Result<(), WriteError> {
        self.chunk_start_ns = None;
        attach(&mut self.writer, log_time_ns, 0, LATER_SUBJECT_NAME.to_owned(), subject_toml)
            .map_err(|source| self.failed(source))
    }

    /// Closes the current chunk and flushes it to the system: the data written so far survive a crash of the process.
    ///
    /// # Errors
    /// [`WriteError::Write`] if the chunk cannot be written.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        self.chunk_start_ns = None;
        self.writer.flush().map_err(|source| self.failed(source))
    }

    fn failed(&mut self, source: McapError) -> WriteError {
        self.failed = true;
        WriteError::Write { path: self.path.clone(), source }
    }
}

fn start<W: Write + Seek>(sink: W, header: &RecordingHeader) -> Result<Writer<W>, McapError> {
    let options = WriteOptions::new()
        .library(concat!("equipoise ", env!("CARGO_PKG_VERSION")))
        .chunk_size(Some(CHUNK_BYTES))
        // Chunks are assembled in memory and written as a whole; otherwise a crash would leave a chunk without its
        // length.
        .disable_seeking(true)
        .compression_level(ZSTD_LEVEL)
        // In the caller's thread, as the loop needs the other cores.
        .compression_threads(0);
    let mut writer = Writer::with_options(sink, options)?;
    writer.write_metadata(&Metadata { name: METADATA_NAME.to_owned(), metadata: header.metadata() })?;
    for (name, text) in header.attachments() {
        attach(&mut writer, header.started_monotonic_ns, header.started_unix_ns, name.to_owned(), text)?;
    }
    for (text, at_ns) in header.later_subjects_toml.iter().zip(&header.later_subjects_ns) {
        attach(&mut writer, *at_ns, 0, LATER_SUBJECT_NAME.to_owned(), text)?;
    }
    writer.flush()?;
    Ok(writer)
}

fn attach<W: Write + Seek>(
    writer: &mut Writer<W>,
    log_time: u64,
    create_time: u64,
    name: String,
    text: &str,
) -> Result<(), McapError> {
    let (media_type, data) = (TOML_MEDIA_TYPE.to_owned(), Cow::Borrowed(text.as_bytes()));
    writer.attach(&Attachment { log_time, create_time, name, media_type, data })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_an_error_that_names_the_file() {
        let path = PathBuf::from("/dev/full");
        let Ok(file) = OpenOptions::new().write(true).open(&path) else {
            println!("skipped: there is no /dev/full here");
            return;
        };
        let error =
            Recorder::on(path, BufWriter::new(file), &RecordingHeader::default()).err().unwrap().to_string();
        assert!(error.contains("/dev/full") && error.contains("stays readable"), "{error}");
    }
}
