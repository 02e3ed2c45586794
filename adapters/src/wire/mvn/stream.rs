//! Extracts datagrams from a byte stream: MVN over TCP sends them consecutively, without separators.
//!
//! The header's payload size gives the end of a datagram. If no datagram begins there, synchronisation is lost, and the
//! next `MXTP` is taken as the next start. No valid payload contains these four letters: as a number they exceed any
//! quantity of a body; a character with this name is not supported. A datagram that contains them has therefore been
//! truncated, and the data after it are recovered. JSON text between datagrams is skipped.

use super::header::{HEADER_SIZE, Header, MAGIC};

/// A longer text is invalid.
const TEXT_MAX: usize = 65_536;

/// Element found at the front of the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cut {
    /// A datagram; returned by [`StreamCutter::datagram`].
    Datagram,
    /// Synchronisation was lost here; bytes were or will be skipped up to the next datagram.
    LostStep,
}

/// Splits one stream into datagrams; the result is independent of its division into pieces.
#[derive(Debug, Clone, Default)]
pub struct StreamCutter {
    buffer: Vec<u8>,
    /// Index in the buffer at which the next element begins.
    at: usize,
    /// Count of bytes from `at` on that were searched for a start without success.
    searched: usize,
    /// Position of the last datagram.
    datagram: (usize, usize),
    out_of_step: bool,
    skipped_bytes: u64,
}

impl StreamCutter {
    /// A stream before any data.
    pub fn new() -> StreamCutter {
        StreamCutter::default()
    }

    /// Appends received bytes. Call [`Self::advance`] until it returns `None`, otherwise the buffer grows.
    pub fn push(&mut self, bytes: &[u8]) {
        // A start may span the end of the last datagram, if that one was short by some bytes.
        let done = self.at.saturating_sub(MAGIC.len() - 1);
        self.buffer.drain(..done);
        self.at -= done;
        self.datagram = (0, 0);
        self.buffer.extend_from_slice(bytes);
    }

    /// The next element; `None` if more bytes are needed.
    pub fn advance(&mut self) -> Option<Cut> {
        loop {
            if self.out_of_step {
                let begins = find(self.rest());
                self.skip(begins.unwrap_or_else(|| self.rest().len().saturating_sub(MAGIC.len() - 1)));
                self.out_of_step = begins.is_none();
                begins?;
            }
            match self.look() {
                Look::Unknown => return None,
                Look::Text(length) => self.step(length),
                Look::Datagram(length) => {
                    self.datagram = (self.at, self.at + length);
                    self.step(length);
                    return Some(Cut::Datagram);
                }
                Look::Begins { later } => {
                    self.skip(later);
                    return Some(Cut::LostStep);
                }
                Look::Began { before } => {
                    self.at -= before;
                    self.searched = 0;
                    return Some(Cut::LostStep);
                }
                Look::Nothing => {
                    self.out_of_step = true;
                    return Some(Cut::LostStep);
                }
            }
        }
    }

    /// The datagram of the last [`Cut::Datagram`]; empty after more bytes were pushed.
    pub fn datagram(&self) -> &[u8] {
        self.buffer.get(self.datagram.0..self.datagram.1).unwrap_or_default()
    }

    /// Count of bytes that belong to no datagram and no text.
    pub fn skipped_bytes(&self) -> u64 {
        self.skipped_bytes
    }

    fn rest(&self) -> &[u8] {
        self.buffer.get(self.at..).unwrap_or_default()
    }

    fn step(&mut self, length: usize) {
        self.at += length;
        self.searched = 0;
    }

    fn skip(&mut self, length: usize) {
        self.skipped_bytes += length as u64;
        self.step(length);
    }

    /// Parses the front of a synchronised stream.
    fn look(&mut self) -> Look {
        let rest = self.rest();
        match rest.first() {
            None => Look::Unknown,
            Some(b'{') => text(rest),
            Some(b' ' | b'\r' | b'\n') => Look::Text(1),
            Some(_) if is_beginning(rest) => self.look_at_datagram(),
            Some(_) if MAGIC.starts_with(rest) => Look::Unknown,
            Some(_) => self.look_back(),
        }
    }

    fn look_at_datagram(&mut self) -> Look {
        let Ok(header) = Header::parse(self.rest()) else { return Look::Unknown };
        let length = HEADER_SIZE + usize::from(header.payload_size);
        let there = self.rest().len().min(length);
        // The last three bytes may begin a start: they are searched again with the following ones.
        let from = self.searched.saturating_sub(MAGIC.len() - 1).max(1);
        if let Some(inside) = self.rest().get(from..there).and_then(find) {
            return Look::Begins { later: from + inside };
        }
        self.searched = there;
        if there == length { Look::Datagram(length) } else { Look::Unknown }
    }

    /// No element begins here. If the last datagram was short by a few bytes, one began within its end.
    fn look_back(&self) -> Look {
        for before in 1..MAGIC.len().min(self.at + 1) {
            let Some(across) = self.buffer.get(self.at - before..) else { continue };
            if is_beginning(across) {
                return Look::Began { before };
            }
            if MAGIC.starts_with(across) {
                return Look::Unknown;
            }
        }
        Look::Nothing
    }
}

enum Look {
    /// More bytes are needed.
    Unknown,
    /// Text of this many bytes.
    Text(usize),
    /// A datagram of this many bytes.
    Datagram(usize),
    /// The element here is incomplete; another one begins this many bytes later.
    Begins { later: usize },
    /// An element began this many bytes earlier.
    Began { before: usize },
    /// No valid element.
    Nothing,
}

fn is_beginning(bytes: &[u8]) -> bool {
    bytes.starts_with(&MAGIC)
}

fn find(bytes: &[u8]) -> Option<usize> {
    bytes.windows(MAGIC.len()).position(is_beginning)
}

/// One JSON object, delimited by its braces.
fn text(bytes: &[u8]) -> Look {
    let (mut depth, mut quoted, mut escaped) = (0u32, false, false);
    for (index, byte) in bytes.iter().enumerate() {
        if index >= TEXT_MAX || is_beginning(&bytes[index..]) {
            return Look::Nothing;
        }
        match byte {
            _ if escaped => escaped = false,
            b'\\' if quoted => escaped = true,
            b'"' => quoted = !quoted,
            b'{' if !quoted => depth += 1,
            b'}' if !quoted => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return Look::Text(index + 1);
        }
    }
    Look::Unknown
}

#[cfg(test)]
mod tests;
