//! A file of any length, read through a moving window: only the parsed part is in memory.

use std::io::{self, Read};

/// Size of one read, bytes; larger than the longest packet of any capture (262144).
const STEP_BYTES: usize = 1 << 20;
/// Maximum length of a record, bytes.
pub(super) const RECORD_BYTES_MAX: usize = 64 << 20;

/// The part of a file that was read and not yet consumed.
pub(super) struct Window {
    source: Box<dyn Read + Send>,
    bytes: Vec<u8>,
    at: usize,
    /// Bytes of the file before the window.
    before: usize,
    ended: bool,
}

impl Window {
    /// Reads the beginning.
    pub(super) fn open(source: Box<dyn Read + Send>) -> io::Result<Window> {
        let mut window = Window { source, bytes: Vec::new(), at: 0, before: 0, ended: false };
        window.read_on()?;
        Ok(window)
    }

    /// The bytes read so far and not consumed.
    pub(super) fn rest(&self) -> &[u8] {
        &self.bytes[self.at..]
    }

    /// Position of the rest in the file.
    pub(super) fn at_byte(&self) -> usize {
        self.before + self.at
    }

    /// Consumes bytes.
    pub(super) fn pass(&mut self, length: usize) {
        self.at += length;
    }

    /// Whether more data should be read before the next packet.
    pub(super) fn runs_low(&self) -> bool {
        !self.ended && self.rest().len() < STEP_BYTES / 2
    }

    /// Reads more data; returns whether there was more, and room for it.
    ///
    /// # Errors
    /// The system's error.
    pub(super) fn read_on(&mut self) -> io::Result<bool> {
        if self.ended || self.rest().len() >= RECORD_BYTES_MAX {
            return Ok(false);
        }
        self.bytes.drain(..self.at);
        (self.before, self.at) = (self.before + self.at, 0);
        let wanted = self.bytes.len().max(STEP_BYTES) as u64;
        let read = self.source.by_ref().take(wanted).read_to_end(&mut self.bytes)?;
        self.ended = (read as u64) < wanted;
        Ok(read > 0)
    }
}
