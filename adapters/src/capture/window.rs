//! A file of any length, seen through a window that moves on: what is parsed lies in memory, the rest of it does not.

use std::io::{self, Read};

/// So much is read at a time, bytes; the longest packet of any capture (262144) lies in it whole.
const STEP_BYTES: usize = 1 << 20;
/// The longest record that is looked for to its end, bytes.
pub(super) const RECORD_BYTES_MAX: usize = 64 << 20;

/// What of a file has not been passed over so far, as far as it was read.
pub(super) struct Window {
    source: Box<dyn Read + Send>,
    bytes: Vec<u8>,
    at: usize,
    /// Bytes of the file before those that are held.
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

    /// What stands there; so far as it was read.
    pub(super) fn rest(&self) -> &[u8] {
        &self.bytes[self.at..]
    }

    /// Where in the file the rest begins.
    pub(super) fn at_byte(&self) -> usize {
        self.before + self.at
    }

    /// Passes over so many bytes of the rest.
    pub(super) fn pass(&mut self, length: usize) {
        self.at += length;
    }

    /// Whether it is time to read on before the next packet is looked at.
    pub(super) fn runs_low(&self) -> bool {
        !self.ended && self.rest().len() < STEP_BYTES / 2
    }

    /// Adds to the rest; whether there was more, and room for it.
    ///
    /// # Errors
    /// What the system said.
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
