//! Splits a stream into messages with a length prefix, independently of its division into pieces.

/// Bytes at the front of a message that determine its length.
pub(super) const FRONT: usize = 8;

/// Format of such a stream.
#[derive(Debug, Clone, Copy)]
pub(super) struct Form {
    /// The length of a message, front included, from its front.
    pub(super) size: fn([u8; FRONT]) -> usize,
    /// Minimum length.
    pub(super) least: usize,
    /// Maximum length: a larger value is invalid, and later messages cannot be found.
    pub(super) most: usize,
    /// Longer messages are skipped rather than buffered.
    pub(super) kept: usize,
}

/// The next element of a stream.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Cut<'a> {
    /// A message, front included.
    Whole(&'a [u8]),
    /// A message that is too long to buffer; its front.
    PassedOver([u8; FRONT]),
    /// An invalid front.
    Nonsense([u8; FRONT]),
}

/// A stream parser.
#[derive(Debug, Clone, Default)]
pub(super) struct Sized {
    buffer: Vec<u8>,
    /// Bytes at the front of `buffer` that were returned.
    taken: usize,
    /// Remaining bytes of a skipped message.
    skip: usize,
    /// Synchronisation is lost permanently.
    broken: bool,
}

impl Sized {
    /// Discards partially received data.
    pub(super) fn clear(&mut self) {
        self.buffer.clear();
        (self.taken, self.skip, self.broken) = (0, 0, false);
    }

    /// Appends the next piece.
    pub(super) fn push(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.taken);
        self.taken = 0;
        let skipped = self.skip.min(bytes.len());
        self.skip -= skipped;
        if !self.broken {
            self.buffer.extend_from_slice(&bytes[skipped..]);
        }
    }

    /// The next message; `None` until more bytes arrive.
    pub(super) fn cut(&mut self, form: Form) -> Option<Cut<'_>> {
        let from = self.taken;
        let rest = self.buffer.get(from..).unwrap_or_default();
        let front = *rest.first_chunk::<FRONT>()?;
        let size = (form.size)(front);
        if size < form.least.max(FRONT) || size > form.most {
            self.clear();
            self.broken = true;
            return Some(Cut::Nonsense(front));
        }
        if size > form.kept {
            let here = size.min(rest.len());
            self.taken += here;
            self.skip = size - here;
            return Some(Cut::PassedOver(front));
        }
        if rest.len() < size {
            return None;
        }
        self.taken += size;
        Some(Cut::Whole(self.buffer.get(from..from + size).unwrap_or_default()))
    }

    #[cfg(test)]
    pub(super) fn held(&self) -> usize {
        self.buffer.len() - self.taken
    }
}
