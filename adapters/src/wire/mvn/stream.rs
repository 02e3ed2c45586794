//! Datagrams out of a byte stream: MVN over TCP puts one after the other, with nothing in between.
//!
//! The header's payload size says where a datagram ends. Where the next does not begin there, the stream is out of step,
//! and the next `MXTP` is the next beginning. No sound payload contains those four letters: as a number they are beyond
//! anything a body does, and a character who bears them as a name is not worth more. So a datagram that holds them has
//! lost its end, and what follows is saved. JSON text between datagrams is stepped over.

use super::header::{HEADER_SIZE, Header, MAGIC};

/// A longer text is none.
const TEXT_MAX: usize = 65_536;

/// What was found at the front of the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cut {
    /// A datagram; [`StreamCutter::datagram`] has it.
    Datagram,
    /// The stream was out of step here; bytes were or will be skipped up to the next datagram.
    LostStep,
}

/// Cuts one stream. Whatever is pushed in whatever portions, the same bytes give the same cuts.
#[derive(Debug, Clone, Default)]
pub struct StreamCutter {
    buffer: Vec<u8>,
    /// Where in the buffer the next cut begins.
    at: usize,
    /// So many bytes from `at` on were searched for a beginning, without success.
    searched: usize,
    /// Where the datagram that was cut last lies.
    datagram: (usize, usize),
    out_of_step: bool,
    skipped_bytes: u64,
}

impl StreamCutter {
    /// A stream that has brought nothing yet.
    pub fn new() -> StreamCutter {
        StreamCutter::default()
    }

    /// Takes in the next bytes. Call [`Self::advance`] until it has nothing more, else the buffer grows.
    pub fn push(&mut self, bytes: &[u8]) {
        // A beginning may lie across the end of the last datagram, if that one was short of some bytes.
        let done = self.at.saturating_sub(MAGIC.len() - 1);
        self.buffer.drain(..done);
        self.at -= done;
        self.datagram = (0, 0);
        self.buffer.extend_from_slice(bytes);
    }

    /// The next cut; `None` if it takes more bytes to know.
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

    /// The datagram of the last [`Cut::Datagram`]; empty once more bytes were pushed.
    pub fn datagram(&self) -> &[u8] {
        self.buffer.get(self.datagram.0..self.datagram.1).unwrap_or_default()
    }

    /// Bytes that belonged to no datagram and no text.
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

    /// What stands at the front of a stream that is in step.
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
        // The last three bytes may be the beginning of a beginning: they are looked at again with what follows.
        let from = self.searched.saturating_sub(MAGIC.len() - 1).max(1);
        if let Some(inside) = self.rest().get(from..there).and_then(find) {
            return Look::Begins { later: from + inside };
        }
        self.searched = there;
        if there == length { Look::Datagram(length) } else { Look::Unknown }
    }

    /// Nothing begins here. If the last datagram was short of a few bytes, something began within its end.
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
    /// It takes more bytes to know.
    Unknown,
    /// Text of so many bytes.
    Text(usize),
    /// A datagram of so many bytes.
    Datagram(usize),
    /// What stands here has no end before something else begins, so many bytes later.
    Begins { later: usize },
    /// Something began so many bytes before.
    Began { before: usize },
    /// Nothing that we know.
    Nothing,
}

fn is_beginning(bytes: &[u8]) -> bool {
    bytes.starts_with(&MAGIC)
}

fn find(bytes: &[u8]) -> Option<usize> {
    bytes.windows(MAGIC.len()).position(is_beginning)
}

/// One JSON object, by its braces.
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
